// An orthonormal basis around a normal (Duff et al., JCGT 6(1), 2017, listing
// 3), with a comparison in the place of copysign: WGSL has none and may ignore
// the sign of a zero, so -0 counts as positive.

// tangent x bitangent = normal.
struct BasisFrame {
    tangent: vec3f,
    bitangent: vec3f,
}

// The basis whose z axis is the unit vector n. Exact on the axes.
fn basis_from_normal(n: vec3f) -> BasisFrame {
    let signed = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (signed + n.z);
    let b = (n.x * n.y) * a;
    return BasisFrame(
        vec3f(1.0 + (signed * n.x) * (n.x * a), signed * b, -signed * n.x),
        vec3f(b, signed + n.y * (n.y * a), -n.y),
    );
}

// From the basis' coordinates to the world.
fn basis_to_world(frame: BasisFrame, n: vec3f, v: vec3f) -> vec3f {
    return vec3f(
        (v.x * frame.tangent.x + v.y * frame.bitangent.x) + v.z * n.x,
        (v.x * frame.tangent.y + v.y * frame.bitangent.y) + v.z * n.y,
        (v.x * frame.tangent.z + v.y * frame.bitangent.z) + v.z * n.z,
    );
}

// From the world to the basis' coordinates.
fn basis_to_local(frame: BasisFrame, n: vec3f, v: vec3f) -> vec3f {
    let t = frame.tangent;
    let b = frame.bitangent;
    return vec3f(
        (v.x * t.x + v.y * t.y) + v.z * t.z,
        (v.x * b.x + v.y * b.y) + v.z * b.z,
        (v.x * n.x + v.y * n.y) + v.z * n.z,
    );
}
