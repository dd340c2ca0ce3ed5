// What gi/surfel asks for, over storage buffers: entry i of the cells' lists
// names a surfel, which takes two vec4f (position and radius, normal and the
// bits of mesh); its irradiance is a vec4f.

@group(2) @binding(60) var<storage, read> surfel_entries: array<u32>;
@group(2) @binding(61) var<storage, read> surfel_values: array<vec4f>;
@group(2) @binding(62) var<storage, read> surfel_irradiances: array<vec4f>;

// Outside the buffers: no radius, which covers nothing.
fn surfel_read(entry: u32) -> Surfel {
    if entry < arrayLength(&surfel_entries) {
        let index = surfel_entries[entry];
        if index < arrayLength(&surfel_values) / 2u {
            let place = surfel_values[2u * index];
            let shape = surfel_values[2u * index + 1u];
            return Surfel(place.xyz, place.w, shape.xyz, bitcast<u32>(shape.w));
        }
    }
    return Surfel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
}

// Outside the buffers: black.
fn surfel_read_irradiance(entry: u32) -> vec3f {
    if entry < arrayLength(&surfel_entries) {
        let index = surfel_entries[entry];
        if index < arrayLength(&surfel_irradiances) {
            return surfel_irradiances[index].xyz;
        }
    }
    return vec3f(0.0, 0.0, 0.0);
}
