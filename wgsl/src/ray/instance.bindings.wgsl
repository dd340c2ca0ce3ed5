// The instances of ray/instance in a storage buffer of vec4u, beside the trees
// of ray/bvh.bindings: four vectors each, the rows of the map and then root,
// mesh, mask and index. The integers are stored as bits: a small integer read
// as a float is subnormal, and may be flushed.

@group(2) @binding(2) var<storage, read> instance_list: array<vec4u>;

// What ray/instance asks for. Outside the buffer: an instance that no ray
// sees.
fn instance_read(index: u32) -> Instance {
    if index >= arrayLength(&instance_list) / 4u {
        return Instance(vec4f(0.0), vec4f(0.0), vec4f(0.0), 0u, 0u, 0u, 0u);
    }
    let last = instance_list[4u * index + 3u];
    return Instance(
        bitcast<vec4f>(instance_list[4u * index]),
        bitcast<vec4f>(instance_list[4u * index + 1u]),
        bitcast<vec4f>(instance_list[4u * index + 2u]),
        last.x,
        last.y,
        last.z,
        last.w,
    );
}
