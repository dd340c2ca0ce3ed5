// The masks of ray/bvh_filter in a storage buffer: a word for each triangle of
// the mesh, by its primitive index.

@group(2) @binding(125) var<storage, read> bvh_masks: array<u32>;

// What ray/bvh_filter asks for. Beyond the buffer: all bits.
fn bvh_read_mask(primitive: u32) -> u32 {
    if primitive >= arrayLength(&bvh_masks) {
        return 0xffffffffu;
    }
    return bvh_masks[primitive];
}
