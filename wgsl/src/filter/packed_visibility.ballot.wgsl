
var<workgroup> packed_visibility_shared: atomic<u32>;

// The word of a workgroup of 8 x 4 threads, the same in all of them: lane is
// the local_invocation_index, visible this thread's ray. All threads call it.
// A ballot without the subgroups extension, and right for subgroups of any
// width.
fn packed_visibility_ballot(lane: u32, visible: bool) -> u32 {
    if lane == 0u {
        atomicStore(&packed_visibility_shared, 0u);
    }
    workgroupBarrier();
    if visible {
        atomicOr(&packed_visibility_shared, 1u << (lane & 31u));
    }
    workgroupBarrier();
    let word = atomicLoad(&packed_visibility_shared);
    // The next call may not clear it while another thread still reads.
    workgroupBarrier();
    return word;
}
