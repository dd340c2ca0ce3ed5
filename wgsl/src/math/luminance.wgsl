// Relative luminance of a linear colour with Rec. 709 (sRGB) primaries
// (ITU-R BT.709-6, item 3.2).
fn luminance(rgb: vec3f) -> f32 {
    return (0.2126 * rgb.x + 0.7152 * rgb.y) + 0.0722 * rgb.z;
}
