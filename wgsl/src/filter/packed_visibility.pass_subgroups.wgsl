
// As packed_visibility_ballot, by subgroup operations: an atomic for each
// subgroup in place of one for each visible ray. Right for subgroups of any
// width, and whichever threads they are made of: each sets the bit of its lane.
fn packed_visibility_ballot_subgroups(lane: u32, first: bool, visible: bool) -> u32 {
    if lane == 0u {
        atomicStore(&packed_visibility_shared, 0u);
    }
    let part = subgroupOr(select(0u, 1u << (lane & 31u), visible));
    workgroupBarrier();
    if first {
        atomicOr(&packed_visibility_shared, part);
    }
    workgroupBarrier();
    let word = atomicLoad(&packed_visibility_shared);
    // The next call may not clear it while another thread still reads.
    workgroupBarrier();
    return word;
}

// packed_visibility_pass_pack by subgroup operations: 32 threads in a row, since
// which of them make a subgroup is only known in one dimension.
@compute @workgroup_size(32)
fn packed_visibility_pass_pack_subgroups(
    @builtin(workgroup_id) block: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(subgroup_invocation_id) place: u32,
) {
    let pixel = vec2u(8u * block.x + (lane & 7u), 4u * block.y + (lane >> 3u));
    let visible = packed_visibility_pass_visible(pixel);
    let word = packed_visibility_ballot_subgroups(lane, place == 0u, visible);
    if lane == 0u {
        packed_visibility_write(block.xy, word);
    }
}
