//! A photograph as it was read: one contiguous copy of its raw pixels, read as coded grey.

use crate::error::{Error, counted};

/// Values within one part in this many of the scale from either end count as black or white: JPEG
/// leaves noise on both.
const EXTREME_PART: u8 = 12;

/// Reason why raw pixels are not a picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// The number of channels is neither 1 (grey) nor 3 (BGR).
    #[error("a picture has 1 or 3 channels, not {channels}")]
    Channels {
        /// The number of channels given.
        channels: usize,
    },
    /// The number of values is not `width * height * channels`, or is zero.
    #[error("{}", size_text(*width, *height, *channels, *count))]
    Size {
        /// Number of pixels in a row.
        width: usize,
        /// Number of rows.
        height: usize,
        /// Number of values in a pixel.
        channels: usize,
        /// Number of values given.
        count: usize,
    },
}

impl From<PictureError> for Error {
    fn from(error: PictureError) -> Self {
        Self::InvalidArgument(error.to_string())
    }
}

/// Fraction of a picture's values at the file's limit above which JPEG may have lowered others from
/// the limit.
const MIN_WHITE_SHARE: f64 = 0.01;
/// One value in this many is counted for that; in colour the channels take turns.
const WHITE_STEP: usize = 13;

/// A picture: rows from the top, pixels from the left, the channels of a pixel (BGR) adjacent.
#[derive(Debug, Clone)]
pub struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    pub(super) pixels: Pixels,
    pub(super) has_two_levels: bool,
    /// Whether so many values are at the file's limit that values near the limit may be clipped,
    /// too.
    pub(super) is_overexposed: bool,
    pub(super) has_even_rows_only: bool,
}

#[derive(Debug, Clone)]
pub(super) enum Pixels {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

impl Picture {
    /// Creates a picture of 8-bit values, with 255 as 1.
    ///
    /// # Errors
    /// [`PictureError`] if the number of channels is neither 1 nor 3 or the values do not fill the
    /// size.
    pub fn from_u8(
        width: usize,
        height: usize,
        channels: usize,
        values: Vec<u8>,
    ) -> Result<Self, PictureError> {
        Self::of([width, height, channels], values.len(), Pixels::U8(values))
    }

    /// Creates a picture of 16-bit values, with 65535 as 1.
    ///
    /// # Errors
    /// As [`from_u8`](Self::from_u8).
    pub fn from_u16(
        width: usize,
        height: usize,
        channels: usize,
        values: Vec<u16>,
    ) -> Result<Self, PictureError> {
        Self::of([width, height, channels], values.len(), Pixels::U16(values))
    }

    /// Creates a picture of floating-point values, used as they are; values that are not finite are
    /// missing.
    ///
    /// # Errors
    /// As [`from_u8`](Self::from_u8).
    pub fn from_f32(
        width: usize,
        height: usize,
        channels: usize,
        values: Vec<f32>,
    ) -> Result<Self, PictureError> {
        Self::of([width, height, channels], values.len(), Pixels::F32(values))
    }

    fn of(size: [usize; 3], count: usize, pixels: Pixels) -> Result<Self, PictureError> {
        let [width, height, channels] = size;
        check(width, height, channels, count)?;
        Ok(Self {
            width,
            height,
            channels,
            has_two_levels: pixels.are_black_or_white(),
            is_overexposed: pixels.are_overexposed(),
            has_even_rows_only: false,
            pixels,
        })
    }

    /// The picture's green channel as a grey picture; `None` for a grey picture.
    #[must_use]
    pub fn of_green(&self) -> Option<Self> {
        if self.channels != 3 {
            return None;
        }
        let pixels = match &self.pixels {
            Pixels::U8(values) => Pixels::U8(green(values)),
            Pixels::U16(values) => Pixels::U16(green(values)),
            Pixels::F32(values) => Pixels::F32(green(values)),
        };
        Some(Self {
            channels: 1,
            pixels,
            ..*self
        })
    }

    /// The same picture without its odd rows, which only the bilinear interpolation of coarse
    /// stages still reads.
    #[must_use]
    pub fn of_even_rows(&self) -> Self {
        Self {
            has_even_rows_only: true,
            ..self.clone()
        }
    }

    /// Whether all pixels are black or white, as in a two-level scan.
    #[must_use]
    pub fn has_two_levels(&self) -> bool {
        self.has_two_levels
    }

    /// Number of values in a pixel: 1 for grey, 3 for colour.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of pixels in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Standard deviation of the rounding to whole levels, in normalised coded values.
    #[must_use]
    pub fn rounding_noise(&self) -> f64 {
        let level = match self.pixels {
            Pixels::U8(_) => 1.0 / f64::from(u8::MAX),
            Pixels::U16(_) => 1.0 / f64::from(u16::MAX),
            Pixels::F32(_) => f64::from(f32::EPSILON),
        };
        level / 12.0_f64.sqrt()
    }
}

impl Pixels {
    fn are_black_or_white(&self) -> bool {
        // The search ends at the first grey pixel.
        match self {
            Self::U8(values) => all_extreme(values, u8::MAX, u8::MAX / EXTREME_PART),
            Self::U16(values) => all_extreme(values, u16::MAX, u16::MAX / u16::from(EXTREME_PART)),
            Self::F32(_) => false,
        }
    }

    fn are_overexposed(&self) -> bool {
        match self {
            Self::U8(values) => has_many(values, u8::MAX),
            Self::U16(values) => has_many(values, u16::MAX),
            Self::F32(_) => false,
        }
    }
}

/// Whether more than a fraction [`MIN_WHITE_SHARE`] of the values are the largest, from a
/// subsample.
fn has_many<T: PartialEq>(values: &[T], maximum: T) -> bool {
    let sample = values.iter().step_by(WHITE_STEP);
    let white = sample.filter(|value| **value == maximum).count();
    (white * WHITE_STEP) as f64 > MIN_WHITE_SHARE * values.len() as f64
}

/// Whether all values are near either end of the scale, with some near each: values of 12 bits in
/// 16 are all near one end.
fn all_extreme<T>(values: &[T], maximum: T, margin: T) -> bool
where
    T: PartialOrd + Copy + std::ops::Sub<Output = T>,
{
    let is_low = |value: &T| *value <= margin;
    let is_high = |value: &T| *value >= maximum - margin;
    values.iter().all(|value| is_low(value) || is_high(value))
        && values.iter().any(is_low)
        && values.iter().any(is_high)
}

fn green<T: Copy>(values: &[T]) -> Vec<T> {
    values.iter().skip(1).step_by(3).copied().collect()
}

/// Describes what is wrong with the number of values; suggests padding as the cause if rows are too
/// long.
fn size_text(width: usize, height: usize, channels: usize, count: usize) -> String {
    let channels_text = counted(channels, "channel");
    let picture = format!("a picture of {width} x {height} pixels with {channels_text}");
    let Some(row) = width
        .checked_mul(channels)
        .filter(|row| *row > 0 && height > 0)
    else {
        return format!("{picture} is empty, but {count} values are given");
    };
    let needed = row.saturating_mul(height);
    let stride = count / height;
    let padded = match count.is_multiple_of(height) && stride > row {
        true => format!(
            ": if each row of {stride} values ends in {} of padding, leave these out",
            stride - row
        ),
        false => String::new(),
    };
    format!(
        "{picture} needs {needed} values ({row} in each row, without padding), not {count}{padded}"
    )
}

fn check(width: usize, height: usize, channels: usize, count: usize) -> Result<(), PictureError> {
    if channels != 1 && channels != 3 {
        return Err(PictureError::Channels { channels });
    }
    let expected = width
        .checked_mul(height)
        .and_then(|area| area.checked_mul(channels));
    if count == 0 || expected != Some(count) {
        return Err(PictureError::Size {
            width,
            height,
            channels,
            count,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_sizes_and_channels_are_refused() {
        assert_eq!(
            Picture::from_u8(2, 2, 2, vec![0; 8]).unwrap_err(),
            PictureError::Channels { channels: 2 }
        );
        assert!(Picture::from_u8(2, 2, 1, vec![0; 5]).is_err());
        let message = |width, height, count| {
            let refused = Picture::from_u8(width, height, 3, vec![0; count]).unwrap_err();
            let text = refused.to_string();
            assert_eq!(Error::from(refused).to_string(), text);
            text
        };
        assert_eq!(
            message(5, 4, 64),
            "a picture of 5 x 4 pixels with 3 channels needs 60 values (15 in each row, without \
             padding), not 64: if each row of 16 values ends in 1 of padding, leave these out"
        );
        assert!(
            message(5, 4, 63)
                .ends_with("needs 60 values (15 in each row, without padding), not 63")
        );
        assert!(message(0, 4, 64).ends_with("is empty, but 64 values are given"));
        assert!(message(usize::MAX, 1, 1).ends_with("is empty, but 1 values are given"));
        assert!(Picture::from_f32(0, 2, 1, vec![]).is_err());
        assert!(Picture::from_u16(usize::MAX, 2, 3, vec![0; 6]).is_err());
    }

    #[test]
    fn a_picture_of_two_levels_has_both() {
        let of = |values: [u16; 3]| Picture::from_u16(3, 1, 1, values.into()).unwrap();
        assert!(of([0, 65_535, 100]).has_two_levels());
        assert!(!of([0, 65_535, 30_000]).has_two_levels());
        assert!(!of([0, 4095, 1000]).has_two_levels());
        assert!(!of([65_535, 65_000, 65_300]).has_two_levels());
    }
}
