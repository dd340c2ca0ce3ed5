//! Linear pictures, and 8-bit PNGs of them.

use super::StageError;

/// A picture of linear `f32` values, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values in a pixel: 1 (grey) or 3 (linear sRGB primaries).
    pub channels: usize,
    /// `width · height · channels` values; 0 is black, 1 is white.
    pub data: Vec<f32>,
}

impl Image {
    /// The values of one pixel.
    ///
    /// # Panics
    /// If `index` is not below `width · height`.
    #[must_use]
    pub fn pixel(&self, index: usize) -> &[f32] {
        &self.data[index * self.channels..(index + 1) * self.channels]
    }

    /// Root of the mean squared difference to another picture of the same
    /// shape, over the pixels that `mask` marks (all without one) and all
    /// channels. 0 if there are none.
    ///
    /// # Panics
    /// If the shapes differ.
    #[must_use]
    pub fn rmse(&self, other: &Self, mask: Option<&[bool]>) -> f64 {
        assert_eq!(self.data.len(), other.data.len(), "pictures of one shape");
        let (mut sum, mut count) = (0.0, 0usize);
        for i in 0..self.data.len() {
            if mask.is_none_or(|m| m[i / self.channels]) {
                let d = f64::from(self.data[i]) - f64::from(other.data[i]);
                sum += d * d;
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }

    /// How many pixels differ from another picture of the same shape by more
    /// than `threshold` in some channel.
    ///
    /// # Panics
    /// If the shapes differ.
    #[must_use]
    pub fn differing(&self, other: &Self, threshold: f32) -> usize {
        assert_eq!(self.data.len(), other.data.len(), "pictures of one shape");
        let pairs = self
            .data
            .chunks_exact(self.channels)
            .zip(other.data.chunks_exact(self.channels));
        pairs
            .filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| (a - b).abs() > threshold))
            .count()
    }

    /// The absolute difference to another picture of the same shape, times
    /// `factor`.
    ///
    /// # Panics
    /// If the shapes differ.
    #[must_use]
    pub fn difference(&self, other: &Self, factor: f32) -> Self {
        assert_eq!(self.data.len(), other.data.len(), "pictures of one shape");
        Self {
            data: self
                .data
                .iter()
                .zip(&other.data)
                .map(|(a, b)| (a - b).abs() * factor)
                .collect(),
            ..self.clone()
        }
    }

    /// 8-bit values: clamped to `[0, 1]` and encoded by the sRGB curve, the
    /// same for every picture.
    #[must_use]
    pub fn to_srgb8(&self) -> Vec<u8> {
        self.data.iter().map(|&v| srgb8(v)).collect()
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// If the encoder fails.
    pub fn to_png(&self) -> Result<Vec<u8>, StageError> {
        use image::ImageEncoder;
        let colour = if self.channels == 1 {
            image::ExtendedColorType::L8
        } else {
            image::ExtendedColorType::Rgb8
        };
        let mut out = Vec::new();
        image::codecs::png::PngEncoder::new(&mut out)
            .write_image(&self.to_srgb8(), self.width, self.height, colour)
            .map_err(|e| StageError::Png(e.to_string()))?;
        Ok(out)
    }
}

/// IEC 61966-2-1, in f64 so that the bytes do not depend on the build.
pub(crate) fn srgb8(linear: f32) -> u8 {
    let v = f64::from(linear.clamp(0.0, 1.0));
    let encoded = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve() {
        assert_eq!([0.0, 0.5, 1.0, 7.0, -1.0].map(srgb8), [0, 188, 255, 255, 0]);
    }

    #[test]
    fn difference_and_error() {
        let a = Image {
            width: 2,
            height: 1,
            channels: 1,
            data: vec![0.0, 1.0],
        };
        let b = Image {
            data: vec![0.0, 0.5],
            ..a.clone()
        };
        assert_eq!(a.differing(&b, 0.25), 1);
        assert_eq!(a.difference(&b, 4.0).data, [0.0, 2.0]);
        assert_eq!(a.rmse(&b, None), 0.125f64.sqrt());
        assert_eq!(a.rmse(&b, Some(&[false, true])), 0.5);
        assert_eq!(a.rmse(&b, Some(&[false, false])), 0.0);
        let png = a.to_png().unwrap();
        assert_eq!(&png[1..4], b"PNG");
    }
}
