// A stack of rough interfaces with absorbing media between them over a diffuse
// base: value, lobe probabilities, sample, density. After Weidlich and Wilkie,
// Arbitrarily Layered Micro-Facet Surfaces, GRAPHITE 2007, refracted about the
// geometric normal, with the solid angle that refraction compresses accounted
// for. Shading frame: normal = +z, both directions point away from the surface.
//
// The program says how many layers there are, 1 to 4:
//     const LAYERED_COUNT: u32 = 2u;

// 1/pi.
const LAYERED_INV_PI: f32 = 0.31830987;

// A rough interface and the medium under it.
struct LayeredLayer {
    // Reflectance at normal incidence, in [0, 1].
    reflectance: vec3f,
    // Refractive index of the medium below over that above, at least 1.
    eta: f32,
    // Optical depth of the medium below when crossed straight.
    depth: vec3f,
    // GGX roughness along x and y, at least GGX_ALPHA_MIN.
    alpha: vec2f,
}

// Layers, the outermost first, over a Lambertian base.
struct LayeredStack {
    layers: array<LayeredLayer, LAYERED_COUNT>,
    // Albedo of the base as layered_diffuse makes it; black for a metal.
    diffuse: vec3f,
}

// How probable each lobe is: each interface's and the base's.
struct LayeredPmf {
    layers: array<f32, LAYERED_COUNT>,
    diffuse: f32,
}

// What layered_sample drew.
struct LayeredSample {
    // Toward the light; unit.
    direction: vec3f,
    // Density under the whole stack; 0 if the sample is to be dropped.
    pdf: f32,
    // Value * cosine / density; black if the sample is to be dropped.
    weight: vec3f,
    // The layer that drew it, or LAYERED_COUNT for the base.
    lobe: u32,
}

// What GGX of this roughness reflects of light from direction cos if its
// Fresnel term is (1 - wo.h)^5: a fit to quadrature that errs upward.
fn layered_grazing(cos: f32, alpha: vec2f) -> f32 {
    let a = sqrt(alpha.x * alpha.y);
    let x = 1.0 - cos;
    let x2 = x * x;
    let root = 1.0 + 8.0 * a;
    let q = root * root;
    return (x2 * x2 * x) * q / (1.0 + 19.0 * (a * x2 * q));
}

// The part of the light from a direction that an interface reflects, as an
// upper bound. One minus this goes through.
fn layered_reflectance(layer: LayeredLayer, cos: f32) -> vec3f {
    let g = layered_grazing(cos, layer.alpha);
    let f = layer.reflectance;
    return vec3f(
        f.x + (1.0 - f.x) * g,
        f.y + (1.0 - f.y) * g,
        f.z + (1.0 - f.z) * g,
    );
}

// A direction above an interface as it goes on below, turned so that it still
// points up. eta >= 1, so it always exists.
fn layered_refract(w: vec3f, eta: f32) -> vec3f {
    let z = sqrt((eta - 1.0) * (eta + 1.0) + w.z * w.z);
    return vec3f(w.x / eta, w.y / eta, z / eta);
}

// Albedo of a Lambertian base under an interface, with the light that the
// interface throws back at it again and again. Once per material.
fn layered_diffuse(albedo: vec3f, layer: LayeredLayer) -> vec3f {
    let a = sqrt(layer.alpha.x * layer.alpha.y);
    let through = (1.0 - 1.0 / (21.0 + 175.0 * a)) / (layer.eta * layer.eta);
    let f = layer.reflectance;
    return vec3f(
        albedo.x / (1.0 - albedo.x * (1.0 - (1.0 - f.x) * through)),
        albedo.y / (1.0 - albedo.y * (1.0 - (1.0 - f.y) * through)),
        albedo.z / (1.0 - albedo.z * (1.0 - (1.0 - f.z) * through)),
    );
}

// What goes through an interface and its medium both ways, over eta^2.
fn layered_through(layer: LayeredLayer, o: vec3f, i: vec3f, below_o: vec3f, below_i: vec3f) -> vec3f {
    let ro = layered_reflectance(layer, o.z);
    let ri = layered_reflectance(layer, i.z);
    let path = 1.0 / below_o.z + 1.0 / below_i.z;
    let t = medium_transmittance(layer.depth, path);
    let scale = 1.0 / (layer.eta * layer.eta);
    return vec3f(
        (1.0 - ro.x) * (1.0 - ri.x) * (t.x * scale),
        (1.0 - ro.y) * (1.0 - ri.y) * (t.y * scale),
        (1.0 - ro.z) * (1.0 - ri.z) * (t.z * scale),
    );
}

// The stack's BRDF without the cosine; 0 at and below the horizon. Reciprocal.
fn layered_eval(stack: LayeredStack, wo: vec3f, wi: vec3f) -> vec3f {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return vec3f(0.0);
    }
    var o = wo;
    var i = wi;
    var through = vec3f(1.0);
    var sum = vec3f(0.0);
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        let layer = stack.layers[k];
        let m = vec3f(o.x + i.x, o.y + i.y, o.z + i.z);
        // Half the length of the sum is the cosine to the half vector.
        let f = fresnel_schlick(layer.reflectance, 0.5 * vec3_length(m));
        let dv = ggx_d_between(o, i, layer.alpha) * ggx_visibility(o, i, layer.alpha);
        sum = vec3f(
            sum.x + through.x * (f.x * dv),
            sum.y + through.y * (f.y * dv),
            sum.z + through.z * (f.z * dv),
        );
        let below_o = layered_refract(o, layer.eta);
        let below_i = layered_refract(i, layer.eta);
        let t = layered_through(layer, o, i, below_o, below_i);
        through = vec3f(through.x * t.x, through.y * t.y, through.z * t.z);
        o = below_o;
        i = below_i;
    }
    return vec3f(
        sum.x + through.x * (stack.diffuse.x * LAYERED_INV_PI),
        sum.y + through.y * (stack.diffuse.y * LAYERED_INV_PI),
        sum.z + through.z * (stack.diffuse.z * LAYERED_INV_PI),
    );
}

// Probability of each lobe for a view direction: its approximate visibility,
// the luminance of what gets there and is reflected. wo.z > 0.
fn layered_pmf(stack: LayeredStack, wo: vec3f) -> LayeredPmf {
    var pmf: LayeredPmf;
    var total = 0.0;
    var o = wo;
    var through = vec3f(1.0);
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        let layer = stack.layers[k];
        let r = layered_reflectance(layer, o.z);
        let w = luminance(vec3f(through.x * r.x, through.y * r.y, through.z * r.z));
        pmf.layers[k] = w;
        total += w;
        let below = layered_refract(o, layer.eta);
        let t = medium_transmittance(layer.depth, 2.0 / below.z);
        let scale = 1.0 / (layer.eta * layer.eta);
        through = vec3f(
            through.x * ((1.0 - r.x) * (t.x * scale)),
            through.y * ((1.0 - r.y) * (t.y * scale)),
            through.z * ((1.0 - r.z) * (t.z * scale)),
        );
        o = below;
    }
    let base = luminance(vec3f(
        through.x * stack.diffuse.x,
        through.y * stack.diffuse.y,
        through.z * stack.diffuse.z,
    ));
    total += base;
    if total <= 0.0 {
        for (var k = 0u; k < LAYERED_COUNT; k++) {
            pmf.layers[k] = 0.0;
        }
        pmf.diffuse = 1.0;
        return pmf;
    }
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        pmf.layers[k] = pmf.layers[k] / total;
    }
    pmf.diffuse = base / total;
    return pmf;
}

// Density of a direction under the whole stack: the sum over the lobes,
// whichever drew it. 0 at and below the horizon.
fn layered_pdf(stack: LayeredStack, wo: vec3f, wi: vec3f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let pmf = layered_pmf(stack, wo);
    var o = wo;
    var i = wi;
    var jacobian = 1.0;
    var sum = pmf.diffuse * hemisphere_cosine_pdf(wi);
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        let layer = stack.layers[k];
        sum += pmf.layers[k] * (jacobian * ggx_bounded_direction_pdf(o, i, layer.alpha));
        let below = layered_refract(i, layer.eta);
        jacobian *= i.z / (layer.eta * layer.eta * below.z);
        o = layered_refract(o, layer.eta);
        i = below;
    }
    return sum;
}

// Draws a direction: a lobe by u.z, its direction by u.xy. Where a layer's
// direction lies below the horizon or is reflected back inside, the sample is
// dropped: pdf and weight are 0 and the direction is +z.
fn layered_sample(stack: LayeredStack, wo: vec3f, u: vec3f) -> LayeredSample {
    if wo.z <= 0.0 {
        return LayeredSample(vec3f(0.0, 0.0, 1.0), 0.0, vec3f(0.0), LAYERED_COUNT);
    }
    let pmf = layered_pmf(stack, wo);
    var lobe = 0u;
    var below = pmf.layers[0];
    while lobe < LAYERED_COUNT && u.z >= below {
        lobe += 1u;
        if lobe < LAYERED_COUNT {
            below += pmf.layers[lobe];
        }
    }
    var direction = hemisphere_cosine_sample(vec2f(u.x, u.y));
    if lobe < LAYERED_COUNT {
        var o = wo;
        for (var k = 0u; k < lobe; k++) {
            o = layered_refract(o, stack.layers[k].eta);
        }
        let h = ggx_bounded_sample(vec2f(u.x, u.y), o, stack.layers[lobe].alpha);
        direction = ggx_reflect(o, h);
        var k = lobe;
        while k > 0u {
            k -= 1u;
            let eta = stack.layers[k].eta;
            let s = eta * direction.z;
            let square = s * s - (eta - 1.0) * (eta + 1.0);
            // Otherwise reflected back inside.
            let leaves = direction.z > 0.0 && square > 0.0;
            let z = select(-1.0, sqrt(max(square, 0.0)), leaves);
            direction = vec3f(eta * direction.x, eta * direction.y, z);
        }
    }
    if direction.z <= 0.0 {
        return LayeredSample(vec3f(0.0, 0.0, 1.0), 0.0, vec3f(0.0), lobe);
    }
    let pdf = layered_pdf(stack, wo, direction);
    let f = layered_eval(stack, wo, direction);
    let divides = pdf > 0.0;
    let scale = select(0.0, direction.z / select(1.0, pdf, divides), divides);
    return LayeredSample(direction, pdf, vec3f(f.x * scale, f.y * scale, f.z * scale), lobe);
}
