//! The pixels of a picture near given paths, without the others.

use nalgebra::Vector2;

use super::grey_reader::{Grey, GreyReader};
use super::picture::{Picture, Pixels};
use super::tone::Tone;

/// Distance (px) between the points of a path around which pixels are kept.
const STEP: f64 = 4.0;

/// Maximum number of points per piece of a path: more than any picture is wide.
const MAX_STEPS: f64 = 16_000.0;

/// The pixels of a picture near some paths, unchanged.
#[derive(Debug, Clone)]
pub struct KeptPixels {
    width: usize,
    height: usize,
    /// Index of the first run of each row, and one past the index of the last run.
    rows: Vec<u32>,
    runs: Vec<Run>,
    /// The pixels of all runs, as one row.
    pixels: Picture,
}

/// Adjacent pixels of a row that are kept.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    /// Index of its first pixel among all kept pixels.
    first: u32,
}

/// Columns of a row: the first one, and one past the last.
type ColumnRange = [usize; 2];

impl Picture {
    /// The pixels within the reach (px) given with each closed path, and a few more.
    #[must_use]
    pub fn near<'a>(
        &self,
        paths: impl IntoIterator<Item = (&'a [Vector2<f64>], f64)>,
    ) -> KeptPixels {
        let mut marked = vec![Vec::new(); self.height];
        for (path, reach) in paths {
            let ends = path.iter().cycle().skip(1);
            for (start, end) in path.iter().zip(ends) {
                mark(&mut marked, self.width, [start, end], reach);
            }
        }
        if self.has_even_rows_only {
            marked.iter_mut().skip(1).step_by(2).for_each(Vec::clear);
        }
        let (mut rows, mut runs, mut count) = (vec![0], Vec::new(), 0);
        for row in &mut marked {
            row.sort_unstable();
            for [start, end] in joined(row) {
                runs.push(Run {
                    start: start as u32,
                    end: end as u32,
                    first: count as u32,
                });
                count += end - start;
            }
            rows.push(runs.len() as u32);
        }
        let pixels = match &self.pixels {
            Pixels::U8(values) => Pixels::U8(self.values_in_runs(values, &rows, &runs)),
            Pixels::U16(values) => Pixels::U16(self.values_in_runs(values, &rows, &runs)),
            Pixels::F32(values) => Pixels::F32(self.values_in_runs(values, &rows, &runs)),
        };
        KeptPixels {
            width: self.width,
            height: self.height,
            rows,
            runs,
            pixels: Self {
                width: count,
                height: 1,
                pixels,
                has_even_rows_only: false,
                ..*self
            },
        }
    }

    fn values_in_runs<T: Copy>(&self, values: &[T], rows: &[u32], runs: &[Run]) -> Vec<T> {
        let count: u32 = runs.iter().map(|run| run.end - run.start).sum();
        let mut kept = Vec::with_capacity(self.channels * count as usize);
        for (y, ends) in rows.windows(2).enumerate() {
            for run in &runs[ends[0] as usize..ends[1] as usize] {
                let columns = [run.start, run.end];
                let [start, end] = columns.map(|x| self.channels * (y * self.width + x as usize));
                kept.extend_from_slice(&values[start..end]);
            }
        }
        kept
    }
}

/// Marks the pixels within `reach` of a straight piece of path, in every row.
fn mark(rows: &mut [Vec<ColumnRange>], width: usize, [start, end]: [&Vector2<f64>; 2], reach: f64) {
    let length = (end - start).norm();
    if !length.is_finite() {
        return;
    }
    let steps = (length / STEP).ceil().clamp(1.0, MAX_STEPS);
    // No point of the piece is farther than half a step from the nearest point that is used.
    let reach = reach.hypot(0.5 * length / steps);
    let clip = |v: f64, count: usize| v.clamp(0.0, count as f64) as usize;
    for step in 0..steps as usize {
        let point = start.lerp(end, step as f64 / steps);
        let first = clip(point.y - reach, rows.len());
        let end = clip(point.y + reach + 1.0, rows.len());
        for (y, row) in (first..end).zip(&mut rows[first..]) {
            let half = (reach.powi(2) - (y as f64 - point.y).powi(2))
                .max(0.0)
                .sqrt();
            let start = clip(point.x - half, width);
            let end = clip(point.x + half + 1.0, width);
            match row.last_mut() {
                // Usually it overlaps the range marked around the previous point.
                Some(last) if start <= last[1] && last[0] <= end => {
                    *last = [last[0].min(start), last[1].max(end)];
                }
                _ if start < end => row.push([start, end]),
                _ => {}
            }
        }
    }
}

/// Sorted column ranges, with those that overlap or touch joined.
fn joined(sorted: &[ColumnRange]) -> impl Iterator<Item = ColumnRange> {
    let mut rest = sorted.iter().copied().peekable();
    std::iter::from_fn(move || {
        let [start, mut end] = rest.next()?;
        while let Some([_, other]) = rest.next_if(|[next, _]| *next <= end) {
            end = end.max(other);
        }
        Some([start, end])
    })
}

impl KeptPixels {
    /// Number of pixels in a row of the picture.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows of the picture.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns a reader of the pixels as coded grey under a tone curve.
    pub(crate) fn reader(&self, tone: Tone) -> KeptReader<'_> {
        KeptReader {
            kept: self,
            pixels: self.pixels.reader(tone),
        }
    }

    /// Index of a pixel among the kept pixels.
    #[inline]
    fn index(&self, x: usize, y: usize) -> Option<usize> {
        let [first, end] = [*self.rows.get(y)?, *self.rows.get(y + 1)?].map(|run| run as usize);
        let x = x as u32;
        let run = self.runs[first..end].iter().find(|run| x < run.end)?;
        Some((run.first + x.checked_sub(run.start)?) as usize)
    }
}

/// The coded grey of the kept pixels: see [`GreyReader`].
pub(crate) struct KeptReader<'a> {
    kept: &'a KeptPixels,
    pixels: GreyReader<'a>,
}

impl<'a> KeptReader<'a> {
    pub fn kept(&self) -> &'a KeptPixels {
        self.kept
    }

    /// The coded grey at column `x` and row `y`, and whether one of its channels is at the file's
    /// limit; `None` where [`GreyReader::get`] of the picture returns it, and for pixels that are
    /// not kept.
    #[inline]
    pub fn get(&self, x: usize, y: usize) -> Option<(f64, bool)> {
        let index = self.kept.index(x, y)?;
        let Grey { value, is_clipped } = self.pixels.grey(index, 0)?;
        Some((value, is_clipped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [115, 83];

    fn pictures() -> Vec<Picture> {
        let [width, height] = SIZE;
        let count = width * height;
        let bytes: Vec<u8> = (0..3 * count).map(|i| (i * 7 % 256) as u8).collect();
        let words = bytes.iter().map(|&byte| u16::from(byte) * 257).collect();
        let floats = bytes[..count].iter().map(|&byte| f32::from(byte) / 255.0);
        let floats = floats.map(|v| if v > 0.9 { f32::NAN } else { v }).collect();
        let grey = Picture::from_u8(width, height, 1, bytes[..count].to_vec()).unwrap();
        vec![
            grey.of_even_rows(),
            grey,
            Picture::from_u8(width, height, 3, bytes).unwrap(),
            Picture::from_u16(width, height, 3, words).unwrap(),
            Picture::from_f32(width, height, 1, floats).unwrap(),
        ]
    }

    #[test]
    fn what_is_kept_reads_as_in_the_picture() {
        let path = [(-3.0, 20.0), (40.0, 9.5), (114.0, 82.0)].map(|(x, y)| Vector2::new(x, y));
        let reach = 5.0;
        // Reference: the distance to the closed path, sampled finely.
        let along = |t: usize| {
            let (from, part) = (t / 500, (t % 500) as f64 / 500.0);
            path[from].lerp(&path[(from + 1) % 3], part)
        };
        for picture in pictures() {
            let kept = picture.near([(&path[..], reach)]);
            assert_eq!([kept.width(), kept.height()], SIZE);
            let (whole, part) = (picture.reader(Tone::Srgb), kept.reader(Tone::Srgb));
            let mut forgotten = 0;
            for y in 0..SIZE[1] + 20 {
                for x in 0..SIZE[0] + 20 {
                    let expected = whole.get(x, y).map(|value| (value, whole.is_clipped(x, y)));
                    let found = part.get(x, y);
                    let place = Vector2::new(x as f64, y as f64);
                    let near = (0..1500).any(|t| (along(t) - place).norm() <= reach);
                    if near || found.is_some() {
                        assert_eq!(found, expected, "({x}, {y})");
                    }
                    forgotten += usize::from(expected.is_some() && found.is_none());
                }
            }
            assert!(forgotten > 500, "{forgotten}");
        }
    }

    #[test]
    fn paths_outside_or_not_finite_keep_nothing() {
        let picture = &pictures()[1];
        let far = [Vector2::new(-1e3, 0.0), Vector2::new(-1e3, 1e5)];
        let open = [
            Vector2::new(f64::NAN, 0.0),
            Vector2::new(3.0, f64::INFINITY),
        ];
        let kept = picture.near([(&far[..], 9.0), (&open[..], 9.0), (&[][..], 9.0)]);
        let reader = kept.reader(Tone::Linear);
        assert!((0..SIZE[0]).all(|x| reader.get(x, 20).is_none()));
        assert_eq!(kept.pixels.width(), 0);
    }
}
