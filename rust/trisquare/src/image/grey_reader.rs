//! A picture as coded grey under a tone curve.

use super::picture::{Picture, Pixels};
use super::tone::{Tone, ToneCurve};

/// Weights of blue, green and red in the grey that edges are measured in (ITU-R BT.601).
const GREY_FROM_BGR: [f64; 3] = [0.114, 0.587, 0.299];

/// Number of levels by which JPEG lowers clipped pixels beside an edge.
const RINGING: u8 = 6;

/// The coded grey of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grey {
    pub value: f64,
    /// Whether a channel has the largest value that the file can hold: its light was at least that.
    pub is_clipped: bool,
}

/// A picture's coded grey, normalised so that 1 is the largest value the file can hold.
///
/// A coloured pixel is mixed in light and coded again,
/// `v = g(0.114 g^-1(B) + 0.587 g^-1(G) + 0.299 g^-1(R))`, so that the blurred edge between two
/// tinted surfaces still is `g` of a blurred step.
#[derive(Debug)]
pub struct GreyReader<'a> {
    picture: &'a Picture,
    tone: Tone,
    curve: ToneCurve,
    /// Value of each 8-bit level in each channel: the normalised value (grey), or the weighted
    /// light (BGR).
    levels: [[f64; 256]; 3],
    /// Lowest 8-bit level at which a channel is clipped.
    clipping_level: u8,
}

impl Picture {
    /// Returns a reader of the picture as coded grey under a tone curve.
    #[must_use]
    pub fn reader(&self, tone: Tone) -> GreyReader<'_> {
        GreyReader::new(self, tone)
    }
}

impl<'a> GreyReader<'a> {
    pub(super) fn new(picture: &'a Picture, tone: Tone) -> Self {
        let levels = GREY_FROM_BGR.map(|weight| {
            std::array::from_fn(|level| {
                let value = level as f64 / f64::from(u8::MAX);
                if picture.channels == 1 {
                    value
                } else {
                    weight * tone.decode(value)
                }
            })
        });
        Self {
            picture,
            tone,
            curve: tone.curve(),
            levels,
            clipping_level: match picture.is_overexposed {
                true => u8::MAX - RINGING,
                false => u8::MAX,
            },
        }
    }

    /// The tone curve, prepared for loops over pixels.
    #[must_use]
    pub fn curve(&self) -> &ToneCurve {
        &self.curve
    }

    /// The picture that is read.
    #[must_use]
    pub fn picture(&self) -> &'a Picture {
        self.picture
    }

    /// The tone curve.
    pub(crate) fn tone(&self) -> Tone {
        self.tone
    }

    /// The coded grey at column `x` and row `y`; `None` outside the picture, in an odd row if only
    /// even rows are used, or if it is not finite.
    #[inline]
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<f64> {
        if self.picture.has_even_rows_only && y % 2 == 1 {
            return None;
        }
        self.get_in_any_row(x, y)
    }

    /// Same as [`get`](Self::get), for all rows.
    #[inline]
    fn get_in_any_row(&self, x: usize, y: usize) -> Option<f64> {
        if x >= self.picture.width || y >= self.picture.height {
            return None;
        }
        let index = y * self.picture.width + x;
        match &self.picture.pixels {
            // This function is kept small enough to be inlined: by far the most pixels are of this
            // kind.
            Pixels::U8(values) if self.picture.channels == 1 => {
                Some(self.levels[0][usize::from(values[index])])
            }
            _ => self.get_indirectly(index),
        }
    }

    /// The coded grey of a pixel in colour, or of more than 8 bits.
    fn get_indirectly(&self, index: usize) -> Option<f64> {
        if self.picture.channels == 3 {
            return self.mixed_grey(3 * index);
        }
        match &self.picture.pixels {
            Pixels::U8(values) => Some(self.levels[0][usize::from(values[index])]),
            Pixels::U16(values) => Some(f64::from(values[index]) / f64::from(u16::MAX)),
            Pixels::F32(values) => Some(f64::from(values[index])).filter(|value| value.is_finite()),
        }
    }

    /// The light in blue, green and red of a pixel inside a colour picture, each channel in its own
    /// unit.
    pub(crate) fn lights(&self, x: usize, y: usize) -> [f64; 3] {
        let start = 3 * (y * self.picture.width + x);
        [0, 1, 2].map(|channel| match &self.picture.pixels {
            Pixels::U8(values) => self.levels[channel][usize::from(values[start + channel])],
            Pixels::U16(values) => {
                let value = f64::from(values[start + channel]) / f64::from(u16::MAX);
                self.tone.decode(value)
            }
            Pixels::F32(values) => self.tone.decode(f64::from(values[start + channel])),
        })
    }

    /// Whether a channel of a pixel inside the picture is at the file's limit. Floats have no
    /// limit, and the white of a picture of two levels is not a lower bound of the light.
    pub(crate) fn is_clipped(&self, x: usize, y: usize) -> bool {
        if self.picture.has_two_levels {
            return false;
        }
        let channels = self.picture.channels;
        let start = channels * (y * self.picture.width + x);
        let channel_range = start..start + channels;
        match &self.picture.pixels {
            Pixels::U8(values) => any_reaches(&values[channel_range], self.clipping_level),
            Pixels::U16(values) => {
                any_reaches(&values[channel_range], u16::from(self.clipping_level) * 257)
            }
            Pixels::F32(_) => false,
        }
    }

    /// The coded grey of a pixel inside the picture, and whether it is clipped; `None` where
    /// [`get`](Self::get) returns it.
    #[inline]
    pub(super) fn grey(&self, x: usize, y: usize) -> Option<Grey> {
        if let Some(bytes) = self.grey_bytes() {
            return Some(self.grey_from_byte(bytes[y * self.picture.width + x]));
        }
        Some(Grey {
            value: self.get(x, y)?,
            is_clipped: self.is_clipped(x, y),
        })
    }

    /// The bytes of an 8-bit grey picture, if all of its rows are used.
    #[inline]
    fn grey_bytes(&self) -> Option<&'a [u8]> {
        match &self.picture.pixels {
            Pixels::U8(values)
                if self.picture.channels == 1 && !self.picture.has_even_rows_only =>
            {
                Some(values)
            }
            _ => None,
        }
    }

    #[inline]
    fn grey_from_byte(&self, byte: u8) -> Grey {
        Grey {
            value: self.levels[0][usize::from(byte)],
            is_clipped: byte >= self.clipping_level && !self.picture.has_two_levels,
        }
    }

    /// Reads `count` pixels from column `x` and row `y` on, to the right or downwards. All of them
    /// must be inside the picture; values that are not finite are read as NaN.
    pub(crate) fn read_line(
        &self,
        [x, y]: [usize; 2],
        is_downwards: bool,
        count: usize,
        greys: &mut Vec<Grey>,
    ) {
        greys.clear();
        if let Some(bytes) = self.grey_bytes() {
            let step = if is_downwards { self.picture.width } else { 1 };
            let line = bytes[y * self.picture.width + x..].iter().step_by(step);
            greys.extend(line.take(count).map(|&byte| self.grey_from_byte(byte)));
            return;
        }
        greys.extend((0..count).map(|index| {
            let [x, y] = match is_downwards {
                true => [x, y + index],
                false => [x + index, y],
            };
            Grey {
                value: self.get(x, y).unwrap_or(f64::NAN),
                is_clipped: self.is_clipped(x, y),
            }
        }));
    }

    #[inline]
    fn mixed_grey(&self, start: usize) -> Option<f64> {
        let light: f64 = match &self.picture.pixels {
            Pixels::U8(values) => {
                let [blue, green, red] = &self.levels;
                let bgr = &values[start..start + 3];
                blue[usize::from(bgr[0])] + green[usize::from(bgr[1])] + red[usize::from(bgr[2])]
            }
            Pixels::U16(values) => self.mixed_light(start, |index| {
                f64::from(values[index]) / f64::from(u16::MAX)
            }),
            Pixels::F32(values) => self.mixed_light(start, |index| f64::from(values[index])),
        };
        Some(self.curve.encode_with_slope(light).0).filter(|value| value.is_finite())
    }

    fn mixed_light(&self, start: usize, value: impl Fn(usize) -> f64) -> f64 {
        (0..3)
            .map(|channel| GREY_FROM_BGR[channel] * self.tone.decode(value(start + channel)))
            .sum()
    }

    /// Bilinear interpolation of the grey at continuous pixel coordinates, from all rows. `None`
    /// outside the picture, even if only rounding puts a point of the border there: callers clamp
    /// such points.
    #[must_use]
    pub fn bilinear(&self, x: f64, y: f64) -> Option<f64> {
        let (right, bottom) = (
            (self.picture.width - 1) as f64,
            (self.picture.height - 1) as f64,
        );
        if !((0.0..=right).contains(&x) && (0.0..=bottom).contains(&y)) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (across, down) = (x - column as f64, y - row as f64);
        let next_column = (column + 1).min(self.picture.width - 1);
        let next_row = (row + 1).min(self.picture.height - 1);
        let upper = self.get_in_any_row(column, row)? * (1.0 - across)
            + self.get_in_any_row(next_column, row)? * across;
        let lower = self.get_in_any_row(column, next_row)? * (1.0 - across)
            + self.get_in_any_row(next_column, next_row)? * across;
        Some(upper * (1.0 - down) + lower * down)
    }
}

fn any_reaches<T: PartialOrd>(values: &[T], clipping_level: T) -> bool {
    values.iter().any(|value| *value >= clipping_level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_normalised() {
        let bytes = Picture::from_u8(2, 1, 1, vec![0, 51]).unwrap();
        let words = Picture::from_u16(2, 1, 1, vec![0, 13_107]).unwrap();
        let floats = Picture::from_f32(2, 1, 1, vec![f32::NAN, 0.2]).unwrap();
        for picture in [&bytes, &words, &floats] {
            let reader = picture.reader(Tone::Srgb);
            assert!((reader.get(1, 0).unwrap() - 0.2).abs() < 1e-8);
            assert_eq!(reader.get(2, 0), None);
            assert_eq!(reader.get(0, 1), None);
        }
        assert_eq!(floats.reader(Tone::Linear).get(0, 0), None);
        assert_eq!(bytes.reader(Tone::Linear).get(0, 0), Some(0.0));
    }

    #[test]
    fn colour_is_mixed_in_light() {
        let [blue, green, red] = [40_u8, 90, 200];
        for tone in [Tone::Linear, Tone::Srgb, Tone::Gamma(2.2)] {
            let light = |level: u8| tone.decode(f64::from(level) / 255.0);
            let grey = tone.encode(0.114 * light(blue) + 0.587 * light(green) + 0.299 * light(red));
            let bytes = Picture::from_u8(1, 1, 3, vec![blue, green, red]).unwrap();
            let wide = [blue, green, red]
                .map(|level| u16::from(level) * 257)
                .to_vec();
            let words = Picture::from_u16(1, 1, 3, wide).unwrap();
            for picture in [&bytes, &words] {
                let value = picture.reader(tone).get(0, 0).unwrap();
                assert!((value - grey).abs() < 1e-7, "{tone:?}: {value} {grey}");
            }
        }
    }

    #[test]
    fn a_line_of_pixels_reads_as_the_pixels_do() {
        let bytes: Vec<u8> = (0..60).map(|index| 4 * index).collect();
        let floats = bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect();
        let pictures = [
            Picture::from_u8(10, 6, 1, bytes.clone()).unwrap(),
            Picture::from_f32(10, 6, 1, floats).unwrap(),
            Picture::from_u8(5, 4, 3, bytes).unwrap(),
        ];
        for picture in &pictures {
            let reader = picture.reader(Tone::Srgb);
            let mut greys = Vec::new();
            for is_downwards in [true, false] {
                reader.read_line([2, 1], is_downwards, 3, &mut greys);
                let steps = if is_downwards { [0, 1] } else { [1, 0] };
                let pixels = (0..3).map(|k| reader.get(2 + k * steps[0], 1 + k * steps[1]));
                let values = greys.iter().map(|grey| Some(grey.value));
                assert_eq!(values.collect::<Vec<_>>(), pixels.collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn the_largest_value_of_any_channel_is_clipped() {
        // With a grey level, since in a picture of two levels nothing is clipped.
        let bytes = Picture::from_u8(2, 1, 3, vec![254, 254, 99, 9, 255, 9]).unwrap();
        let words = Picture::from_u16(3, 1, 1, vec![65_534, 65_535, 30_000]).unwrap();
        let floats = Picture::from_f32(2, 1, 1, vec![0.5, 1.0]).unwrap();
        let mut greys = Vec::new();
        for (picture, clipped) in [(bytes, true), (words, true), (floats, false)] {
            let reader = picture.reader(Tone::Srgb);
            reader.read_line([0, 0], false, 2, &mut greys);
            assert_eq!([false, clipped], [0, 1].map(|x| greys[x].is_clipped));
        }
    }

    #[test]
    fn bilinear_stays_inside() {
        let picture = Picture::from_f32(2, 2, 1, vec![0.0, 1.0, 2.0, 3.0]).unwrap();
        let reader = picture.reader(Tone::Linear);
        assert_eq!(reader.bilinear(0.5, 0.25), Some(1.0));
        assert_eq!(reader.bilinear(1.0, 1.0), Some(3.0));
        assert_eq!(reader.bilinear(1.01, 0.0), None);
        assert_eq!(reader.bilinear(f64::NAN, 0.0), None);
    }
}
