// The number of layers of brdf/layered: put your own here, 1 to 4.
const LAYERED_COUNT: u32 = 2u;
