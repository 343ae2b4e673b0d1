//! Pixels where the grey levels have the curvature of a saddle: possible corners of cells.
//!
//! Next to a crossing the grey levels rise toward two opposite cells and fall toward the other two,
//! for any lens and perspective. Hence the determinant of their second derivatives is negative.

use super::sectors::SaddleCandidate;
use crate::image::GreyBytes;

/// Smallest saddle, the geometric mean of its two curvatures, in grey levels per square pixel. A
/// crossing of contrast 30 whose edges are blurred by 2 pixels of the searched picture has 1.6;
/// noise of 8 grey levels, halved once, leaves 0.4.
const MIN_SADDLE: f32 = 1.1;

/// Response of the derivative filters to a second derivative of one grey level per square pixel.
/// They are five pixels wide, which smooths by about one pixel; cells of five pixels are preserved.
const FILTER_GAIN: f32 = 64.0;
const MIN_STRENGTH: f32 = (FILTER_GAIN * MIN_SADDLE) * (FILTER_GAIN * MIN_SADDLE);

/// Ratio of a saddle to a stronger one within some pairs of pixels below which it is dropped: print
/// in a cell, or beside an edge, is finer than the cell and more blurred.
const MIN_RIVAL_RATIO: f32 = 0.6;
const RIVAL_PAIRS: usize = 2;

/// Width (px) of the border in which no saddle is sought: the reach of the filters and of the
/// rivals.
const MARGIN: usize = 6;

/// Number of pixels from a filter's middle to its rim.
const REACH: usize = 2;

/// Number of pixels of a row that are examined together.
const RUN: usize = 16;

/// Number of rows of a picture that are searched at a time, which bounds the memory for the
/// filters. Even, so that pairs of pixels are whole.
const STRIP: usize = 128;

/// Finds the pixels where the curvature of a saddle is strongest in their neighbourhood, in row
/// order.
pub(super) fn candidates(picture: &GreyBytes<'_>) -> Vec<SaddleCandidate> {
    let [width, height] = picture.size();
    let mut found = Vec::new();
    if width.min(height) <= 2 * MARGIN {
        return found;
    }
    for top in (0..height).step_by(STRIP) {
        let first = top.saturating_sub(MARGIN);
        let last = (top + STRIP + MARGIN).min(height);
        let strip = Strengths::of(picture, first, last);
        for row in top.max(MARGIN)..(top + STRIP).min(height - MARGIN) {
            strip.add_peaks(row - first, first, &mut found);
        }
    }
    found
}

/// Negative determinants of the second derivatives, times the square of `FILTER_GAIN`.
struct Strengths {
    values: Vec<f32>,
    width: usize,
}

/// A row of a picture, smoothed and differentiated along it.
struct FilteredRow {
    smooth: Vec<i16>,
    slope: Vec<i16>,
    curve: Vec<i16>,
}

impl Strengths {
    /// The strengths in the rows from `first` to before `last`.
    fn of(picture: &GreyBytes<'_>, first: usize, last: usize) -> Self {
        let [width, height] = picture.size();
        let mut padded = vec![0; width + 2 * REACH];
        let rows: Vec<_> = (first..last + 2 * REACH)
            .map(|row| {
                // The picture is mirrored at its border.
                let row = row.abs_diff(REACH);
                let row = row.min(2 * (height - 1) - row);
                let values = &picture.values()[row * width..(row + 1) * width];
                FilteredRow::of(values, &mut padded)
            })
            .collect();
        let mut values = vec![0.0; (last - first) * width];
        for (strengths, rows) in values
            .chunks_exact_mut(width)
            .zip(rows.windows(2 * REACH + 1))
        {
            fill_strengths(strengths, rows);
        }
        Self { values, width }
    }

    /// Adds the peaks of a row, whose index is `row` here and `row + first_row` in the picture.
    fn add_peaks(&self, row: usize, first_row: usize, found: &mut Vec<SaddleCandidate>) {
        let strengths = &self.values[row * self.width..(row + 1) * self.width];
        let inner = &strengths[MARGIN..self.width - MARGIN];
        for (number, run) in inner.chunks(RUN).enumerate() {
            // Most pixels have no such curvature.
            if !run
                .iter()
                .fold(false, |any, strength| any | (*strength > MIN_STRENGTH))
            {
                continue;
            }
            for (column, &strength) in (MARGIN + number * RUN..).zip(run) {
                if strength > MIN_STRENGTH && self.is_peak(strength, column, row) {
                    found.push(SaddleCandidate {
                        pixel: [column, row + first_row],
                        strength: f64::from(strength),
                    });
                }
            }
        }
    }

    fn is_peak(&self, strength: f32, column: usize, row: usize) -> bool {
        let around = self.strongest([column - 1, column + 2], [row - 1, row + 2]);
        if strength < around {
            return false;
        }
        // Each pair of an even and an odd coordinate, with those next to it.
        let pairs = |at: usize| {
            let pair = 2 * (at / 2);
            [pair - 2 * RIVAL_PAIRS - 1, pair + 2 * RIVAL_PAIRS + 2]
        };
        let rival = self.strongest(pairs(column), pairs(row));
        strength >= MIN_RIVAL_RATIO * MIN_RIVAL_RATIO * rival
    }

    /// The largest strength in ranges of columns and rows, whose ends are exclusive.
    fn strongest(&self, columns: [usize; 2], rows: [usize; 2]) -> f32 {
        let columns = columns[0]..columns[1].min(self.width);
        let height = self.values.len() / self.width;
        let mut strongest = f32::NEG_INFINITY;
        for row in rows[0]..rows[1].min(height) {
            for &strength in &self.values[row * self.width..][columns.clone()] {
                if strength > strongest {
                    strongest = strength;
                }
            }
        }
        strongest
    }
}

impl FilteredRow {
    /// Filters some grey levels; `padded` has room for them and their mirrored ends.
    fn of(values: &[u8], padded: &mut [i16]) -> Self {
        let width = values.len();
        for (level, value) in padded[REACH..].iter_mut().zip(values) {
            *level = i16::from(*value);
        }
        for offset in 1..=REACH {
            padded[REACH - offset] = padded[REACH + offset];
            padded[REACH + width - 1 + offset] = padded[REACH + width - 1 - offset];
        }
        let from = |k: usize| &padded[k..k + width];
        let (a, b, c, d, e) = (from(0), from(1), from(2), from(3), from(4));
        let mut row = Self {
            smooth: vec![0; width],
            slope: vec![0; width],
            curve: vec![0; width],
        };
        let (smoothed, sloping, curved) = (
            &mut row.smooth[..width],
            &mut row.slope[..width],
            &mut row.curve[..width],
        );
        for x in 0..width {
            let levels = [a[x], b[x], c[x], d[x], e[x]];
            smoothed[x] = smooth(levels);
            sloping[x] = slope(levels);
            curved[x] = curve(levels);
        }
        row
    }
}

#[inline]
fn smooth([a, b, c, d, e]: [i16; 5]) -> i16 {
    a + e + 4 * (b + d) + 6 * c
}

#[inline]
fn slope([a, b, _, d, e]: [i16; 5]) -> i16 {
    e - a + 2 * (d - b)
}

#[inline]
fn curve([a, _, c, _, e]: [i16; 5]) -> i16 {
    a + e - 2 * c
}

fn fill_strengths(strengths: &mut [f32], rows: &[FilteredRow]) {
    let width = strengths.len();
    let row = |k: usize| {
        let row = &rows[k];
        (
            &row.smooth[..width],
            &row.slope[..width],
            &row.curve[..width],
        )
    };
    let (a, b, c, d, e) = (row(0), row(1), row(2), row(3), row(4));
    for x in 0..width {
        let xx = f32::from(smooth([a.2[x], b.2[x], c.2[x], d.2[x], e.2[x]]));
        let xy = f32::from(slope([a.1[x], b.1[x], c.1[x], d.1[x], e.1[x]]));
        let yy = f32::from(curve([a.0[x], b.0[x], c.0[x], d.0[x], e.0[x]]));
        strengths[x] = xy * xy - xx * yy;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [90, 300];

    /// Dark and light cells that meet at a pixel's corner, on an even ground.
    fn picture(meeting: [usize; 2]) -> Vec<u8> {
        let level = |index: usize| {
            let (x, y) = (index % SIZE[0], index / SIZE[0]);
            let is_light = (x < meeting[0]) == (y < meeting[1]);
            let near = x.abs_diff(meeting[0]).max(y.abs_diff(meeting[1])) < 20;
            if near {
                100 + 60 * u8::from(is_light)
            } else {
                130
            }
        };
        (0..SIZE[0] * SIZE[1]).map(level).collect()
    }

    #[test]
    fn where_cells_meet_there_is_a_candidate_in_every_strip() {
        for row in [30, STRIP - 1, STRIP, STRIP + 1, 2 * STRIP, 270] {
            let values = picture([41, row]);
            let picture = GreyBytes::new(SIZE[0], SIZE[1], &values).unwrap();
            let found = candidates(&picture);
            let near = |it: &&SaddleCandidate| {
                it.pixel[0].abs_diff(41) <= 1 && it.pixel[1].abs_diff(row) <= 1
            };
            let strongest = found
                .iter()
                .max_by(|a, b| a.strength.total_cmp(&b.strength))
                .unwrap();
            assert!(near(&strongest), "{row}: {found:?}");
            assert!(found.is_sorted_by_key(|it| (it.pixel[1], it.pixel[0])));
        }
    }

    #[test]
    fn an_edge_a_plain_ground_and_a_small_picture_have_none() {
        let edge: Vec<u8> = (0..SIZE[0] * SIZE[1])
            .map(|index| 200 * u8::from(index % SIZE[0] > 40))
            .collect();
        let plain = vec![100; SIZE[0] * SIZE[1]];
        for values in [edge, plain] {
            let picture = GreyBytes::new(SIZE[0], SIZE[1], &values).unwrap();
            assert_eq!(candidates(&picture), []);
        }
        let small: Vec<u8> = (0..144).map(|index| (index * 7 % 251) as u8).collect();
        for size in [[12, 12], [144, 1], [2, 72]] {
            let picture = GreyBytes::new(size[0], size[1], &small).unwrap();
            assert_eq!(candidates(&picture), []);
        }
    }

    #[test]
    fn the_filters_are_second_derivatives() {
        // A paraboloid x^2 / 2 - 3 x y - y^2, whose determinant is -1 * 2 - 9.
        let level = |index: usize| {
            let (x, y) = ((index % 20) as f64 - 9.0, (index / 20) as f64 - 9.0);
            let height = 0.5 * x * x - 3.0 * x * y - y * y;
            (height * 0.2 + 128.0) as i32
        };
        let values: Vec<u8> = (0..400).map(|index| level(index) as u8).collect();
        let picture = GreyBytes::new(20, 20, &values).unwrap();
        let strengths = Strengths::of(&picture, 0, 20);
        let middle = strengths.values[9 * 20 + 9] / (FILTER_GAIN * FILTER_GAIN);
        assert!((middle - 0.04 * 11.0).abs() < 0.06, "{middle}");
    }
}
