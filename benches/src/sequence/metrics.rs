//! How far a picture is from its reference.

use glam::{UVec2, Vec3};
use image::GrayImage;

use crate::stages::srgb8;

/// Mean squared error of a channel, and that over the reference's square plus
/// 0.01, over the chosen pixels.
pub(crate) fn errors(image: &[Vec3], reference: &[Vec3], chosen: &[bool]) -> (f64, f64) {
    let (mut squared, mut relative, mut count) = (0.0, 0.0, 0.0);
    for i in (0..image.len()).filter(|i| chosen[*i]) {
        for (x, r) in image[i].to_array().into_iter().zip(reference[i].to_array()) {
            let (x, r) = (f64::from(x), f64::from(r));
            squared += (x - r).powi(2);
            relative += (x - r).powi(2) / (r * r + 0.01);
            count += 1.0;
        }
    }
    let count = f64::max(count, 1.0);
    (squared / count, relative / count)
}

/// Mean change of the error from one frame to the next, over the chosen pixels:
/// what flickers is not in the references.
pub(crate) fn flicker(
    [before, after]: [&[Vec3]; 2],
    references: [&[Vec3]; 2],
    chosen: &[bool],
) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (0..after.len()).filter(|i| chosen[*i]) {
        let change = (after[i] - references[1][i]) - (before[i] - references[0][i]);
        sum += f64::from(change.abs().element_sum()) / 3.0;
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

/// How much of the picture before a jump is left in one after it: 1 all, 0
/// nothing. The noise of single pixels averages out.
pub(crate) fn ghost(image: &[Vec3], before: &[Vec3], after: &[Vec3]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for ((x, b), a) in image.iter().zip(before).zip(after) {
        let change = (*b - *a).as_dvec3();
        left += (*x - *a).as_dvec3().dot(change);
        all += change.length_squared();
    }
    left / f64::max(all, 1e-12)
}

fn bytes(values: &[Vec3]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|v| v.to_array().map(srgb8))
        .collect()
}

/// Structural similarity of the brightness as the library has it; `NaN` if it
/// has none, as for a picture of a few pixels.
pub(crate) fn similarity(size: UVec2, image: &[Vec3], reference: &[Vec3]) -> f64 {
    use image_compare::{Algorithm, gray_similarity_structure};
    let grey = |values: &[Vec3]| {
        GrayImage::from_fn(size.x, size.y, |x, y| {
            let v = values[(y * size.x + x) as usize];
            image::Luma([srgb8(raytwin::math::luminance::luminance(v))])
        })
    };
    gray_similarity_structure(&Algorithm::MSSIMSimple, &grey(image), &grey(reference))
        .map_or(f64::NAN, |s| s.score)
}

/// FLIP by NVIDIA's library, for a monitor of its default density: the mean,
/// and the map as 8-bit RGB in its colours.
pub(crate) fn flip(size: UVec2, image: &[Vec3], reference: &[Vec3]) -> (f64, Vec<u8>) {
    let take = |v: &[Vec3]| nv_flip::FlipImageRgb8::with_data(size.x, size.y, &bytes(v));
    let map = nv_flip::flip(
        take(reference),
        take(image),
        nv_flip::DEFAULT_PIXELS_PER_DEGREE,
    );
    let mean = nv_flip::FlipPool::from_image(&map).mean();
    (
        f64::from(mean),
        map.apply_color_lut(&nv_flip::magma_lut()).to_vec(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ghosts() {
        let of = |v: [f32; 3]| v.map(Vec3::splat);
        let (before, after) = (of([1.0, 0.0, 0.5]), of([0.0, 0.0, 1.0]));
        assert_eq!(ghost(&before, &before, &after), 1.0);
        assert_eq!(ghost(&after, &before, &after), 0.0);
        assert_eq!(ghost(&of([0.5, 7.0, 0.75]), &before, &after), 0.5);
        assert_eq!(ghost(&after, &after, &after), 0.0);
    }

    #[test]
    fn a_picture_does_not_differ_from_itself() {
        let size = UVec2::new(32, 24);
        let image: Vec<Vec3> = (0..32 * 24u16)
            .map(|i| Vec3::splat(f32::from(i % 32) / 31.0))
            .collect();
        let mut other = image.clone();
        for v in &mut other[..256] {
            *v = Vec3::ONE - *v;
        }
        let all = vec![true; image.len()];
        assert_eq!(errors(&image, &image, &all), (0.0, 0.0));
        assert_eq!(flicker([&image, &other], [&image, &other], &all), 0.0);
        assert!(flicker([&image, &other], [&image, &image], &all) > 0.1);
        let (same, map) = flip(size, &image, &image);
        let (differs, _) = flip(size, &other, &image);
        assert!(same < 1e-6 && differs > 0.1, "{same} {differs}");
        assert_eq!(map.len(), 3 * image.len());
        let [same, differs] = [&image, &other].map(|v| similarity(size, v, &image));
        assert!(same > 0.999 && differs < 0.9, "{same} {differs}");
    }
}
