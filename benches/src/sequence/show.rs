//! Pictures of sequences: crops beside each other, maps of what is wrong,
//! animations.

use glam::{UVec2, Vec3};
use png::{BitDepth, ColorType, Encoder};

use crate::stages::{StageError, srgb8};

/// Pixels of a crop's sides, and how many times larger it is shown.
pub(super) const CROP: UVec2 = UVec2::new(64, 36);
const ZOOM: u32 = 4;

/// Largest side of an animation's panel.
pub(super) const PANEL: UVec2 = UVec2::new(240, 135);

/// Pixels between panels.
const GAP: u32 = 4;

/// An 8-bit RGB picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Picture {
    pub size: UVec2,
    pub rgb: Vec<u8>,
}

impl Picture {
    pub fn of(size: UVec2, values: &[Vec3]) -> Self {
        Self {
            size,
            rgb: values
                .iter()
                .flat_map(|v| v.to_array().map(srgb8))
                .collect(),
        }
    }

    /// A part, each pixel `zoom` times as large.
    pub fn part(&self, corner: UVec2, size: UVec2, zoom: u32) -> Self {
        let size = size.min(self.size - corner);
        let mut rgb = Vec::new();
        for y in 0..size.y * zoom {
            for x in 0..size.x * zoom {
                let at = corner + UVec2::new(x, y) / zoom;
                let i = 3 * (at.y * self.size.x + at.x) as usize;
                rgb.extend_from_slice(&self.rgb[i..i + 3]);
            }
        }
        Self {
            size: size * zoom,
            rgb,
        }
    }

    pub fn crop(&self, corner: UVec2) -> Self {
        self.part(corner, CROP, ZOOM)
    }
}

/// Rows of pictures of one size, on white.
pub(super) fn sheet(rows: &[Vec<Picture>]) -> Picture {
    let Some(cell) = rows.first().and_then(|r| r.first()).map(|p| p.size) else {
        return Picture {
            size: UVec2::ZERO,
            rgb: Vec::new(),
        };
    };
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let counts = UVec2::new(columns, rows.len() as u32);
    let size = counts * cell + (counts - 1) * GAP;
    let mut rgb = vec![255; 3 * size.element_product() as usize];
    for (j, row) in (0u32..).zip(rows) {
        for (i, picture) in (0u32..).zip(row) {
            let corner = UVec2::new(i, j) * (cell + GAP);
            let width = 3 * picture.size.x as usize;
            for (y, line) in (0u32..).zip(picture.rgb.chunks_exact(width)) {
                let start = 3 * ((corner.y + y) * size.x + corner.x) as usize;
                rgb[start..start + width].copy_from_slice(line);
            }
        }
    }
    Picture { size, rgb }
}

/// The corner of the crop with the largest error.
pub(super) fn worst(size: UVec2, image: &[Vec3], reference: &[Vec3], chosen: &[bool]) -> UVec2 {
    let crop = CROP.min(size);
    let steps = (size - crop) / (crop / 4).max(UVec2::ONE) + 1;
    let mut best = (-1.0, UVec2::ZERO);
    for j in 0..steps.y {
        for i in 0..steps.x {
            let corner = (UVec2::new(i, j) * (crop / 4).max(UVec2::ONE)).min(size - crop);
            let mut sum = 0.0;
            for y in corner.y..corner.y + crop.y {
                for x in corner.x..corner.x + crop.x {
                    let k = (y * size.x + x) as usize;
                    if chosen[k] {
                        sum += f64::from((image[k] - reference[k]).length_squared());
                    }
                }
            }
            if sum > best.0 {
                best = (sum, corner);
            }
        }
    }
    best.1
}

/// Frames of one size as a PNG, animated if there are several.
pub(super) fn png(frames: &[Picture]) -> Result<Vec<u8>, StageError> {
    let failed = |e: png::EncodingError| StageError::Png(e.to_string());
    let size = frames.first().map_or(UVec2::ONE, |f| f.size);
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, size.x, size.y);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    if frames.len() > 1 {
        encoder
            .set_animated(frames.len() as u32, 0)
            .map_err(failed)?;
        encoder.set_frame_delay(1, 10).map_err(failed)?;
    }
    let mut writer = encoder.write_header().map_err(failed)?;
    for frame in frames {
        writer.write_image_data(&frame.rgb).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(size: UVec2, value: f32) -> Picture {
        Picture::of(
            size,
            &vec![Vec3::splat(value); size.element_product() as usize],
        )
    }

    #[test]
    fn sheets_have_a_place_for_each() {
        let size = UVec2::new(6, 4);
        let sheet = sheet(&[
            vec![plain(size, 0.0), plain(size, 1.0)],
            vec![plain(size, 0.0)],
        ]);
        assert_eq!(sheet.size, UVec2::new(16, 12));
        let black = sheet.rgb.chunks_exact(3).filter(|p| *p == [0; 3]).count();
        assert_eq!(black, 2 * 24);
    }

    #[test]
    fn the_crop_shows_what_is_wrong() {
        let size = UVec2::new(200, 100);
        let reference = vec![Vec3::ZERO; 20_000];
        let mut image = reference.clone();
        image[70 * 200 + 150] = Vec3::ONE;
        let corner = worst(size, &image, &reference, &vec![true; 20_000]);
        let picture = Picture::of(size, &image).crop(corner);
        assert_eq!(picture.size, CROP * ZOOM);
        assert!(picture.rgb.contains(&255));
        // Smaller than a crop.
        let size = UVec2::new(5, 3);
        assert_eq!(
            worst(size, &image[..15], &image[..15], &[true; 15]),
            UVec2::ZERO
        );
        assert_eq!(plain(size, 0.5).crop(UVec2::ZERO).size, size * ZOOM);
    }

    #[test]
    fn animations_have_every_frame() {
        let size = UVec2::new(9, 7);
        let frames: Vec<Picture> = (0..5u8).map(|i| plain(size, f32::from(i) / 4.0)).collect();
        let bytes = png(&frames).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
        let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
        for frame in &frames {
            reader.next_frame(&mut buffer).unwrap();
            assert_eq!(buffer, frame.rgb);
        }
        let bytes = png(&frames[..1]).unwrap();
        let reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        assert!(reader.info().animation_control().is_none());
    }
}
