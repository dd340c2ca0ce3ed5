//! `NoContraction` for every float operation of a SPIR-V module.
//!
//! naga has no switch for it, and without it a driver may rewrite float
//! algebra. Decorating changes no instruction, so the module stays valid.

// SPIR-V 1.x, section 3: opcodes and the decoration's number.
const OP_DECORATE: u32 = 71;
const NO_CONTRACTION: u32 = 42;
const FLOAT_OPS: [u32; 14] = [
    127, // FNegate
    129, // FAdd
    131, // FSub
    133, // FMul
    136, // FDiv
    140, // FRem
    141, // FMod
    142, // VectorTimesScalar
    143, // MatrixTimesScalar
    144, // VectorTimesMatrix
    145, // MatrixTimesVector
    146, // MatrixTimesMatrix
    147, // OuterProduct
    148, // Dot
];
const OP_FUNCTION: u32 = 54;
/// First opcodes of the annotation section's successors: type declarations.
const OP_TYPE_VOID: u32 = 19;
const OP_TYPE_LAST: u32 = 39;
const HEADER: usize = 5;

/// The module with `NoContraction` on every float operation's result.
pub fn no_contraction(module: &[u32]) -> Vec<u32> {
    let mut decorations = Vec::new();
    // Decorations end where the types begin.
    let mut insert_at = None;
    let mut at = HEADER;
    let mut in_function = false;
    while at < module.len() {
        let opcode = module[at] & 0xffff;
        let length = (module[at] >> 16) as usize;
        assert!(length > 0, "SPIR-V instruction without a length");
        if insert_at.is_none() && (OP_TYPE_VOID..=OP_TYPE_LAST).contains(&opcode) {
            insert_at = Some(at);
        }
        in_function |= opcode == OP_FUNCTION;
        if in_function && FLOAT_OPS.contains(&opcode) {
            // Word 1 is the result type, word 2 the result.
            let result = module[at + 2];
            decorations.extend([(3 << 16) | OP_DECORATE, result, NO_CONTRACTION]);
        }
        at += length;
    }
    let insert_at = insert_at.expect("a shader declares types");
    let mut out = Vec::with_capacity(module.len() + decorations.len());
    out.extend_from_slice(&module[..insert_at]);
    out.extend(decorations);
    out.extend_from_slice(&module[insert_at..]);
    out
}
