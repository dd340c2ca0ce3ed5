// The tree of ray/bvh in two storage buffers. A node takes two vec4f: lower
// corner and first, upper corner and count; a triangle takes three: its
// vertices, with the primitive index beside the first. The integers are stored
// as bits, so the buffers are arrays of vec4u: a small integer read as a float
// is subnormal, and may be flushed. An empty tree is one node of zeros.

@group(2) @binding(0) var<storage, read> bvh_nodes: array<vec4u>;
@group(2) @binding(1) var<storage, read> bvh_triangles: array<vec4u>;

// What ray/bvh asks for. Outside the buffer: a node without children.
fn bvh_read_node(index: u32) -> BvhNode {
    if index >= arrayLength(&bvh_nodes) / 2u {
        return BvhNode(vec3f(0.0), 0u, vec3f(0.0), 0u);
    }
    let lower = bvh_nodes[2u * index];
    let upper = bvh_nodes[2u * index + 1u];
    return BvhNode(bitcast<vec3f>(lower.xyz), lower.w, bitcast<vec3f>(upper.xyz), upper.w);
}

// What ray/bvh asks for. Outside the buffer: a triangle without area.
fn bvh_read_triangle(index: u32) -> BvhTriangle {
    if index >= arrayLength(&bvh_triangles) / 3u {
        return BvhTriangle(vec3f(0.0), vec3f(0.0), vec3f(0.0), BVH_MISS);
    }
    let a = bvh_triangles[3u * index];
    let b = bvh_triangles[3u * index + 1u];
    let c = bvh_triangles[3u * index + 2u];
    return BvhTriangle(
        bitcast<vec3f>(a.xyz),
        bitcast<vec3f>(b.xyz),
        bitcast<vec3f>(c.xyz),
        a.w,
    );
}
