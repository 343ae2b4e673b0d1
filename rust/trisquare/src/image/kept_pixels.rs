//! The pixels of a picture near some places; the others are forgotten.

use nalgebra::Vector2;

use super::grey_reader::{Grey, GreyReader};
use super::picture::{Picture, Pixels};
use super::tone::Tone;

/// Pixels along the side of a tile; even, so that even rows stay even.
const TILE: usize = 16;

/// Distance (px) of the points of a path round which tiles are kept.
const STEP: f64 = 4.0;

/// Points of a piece of a path at most: more than any picture is wide.
const MAX_STEPS: f64 = 16_000.0;

const NOT_KEPT: u32 = u32::MAX;

/// The pixels of a picture near some paths, as they were in it.
#[derive(Debug, Clone)]
pub struct KeptPixels {
    width: usize,
    height: usize,
    /// For each tile of the picture, row by row, its place among those that are kept.
    places: Vec<u32>,
    /// The tiles that are kept, one below the other; beyond the picture's borders they are black.
    tiles: Picture,
}

impl Picture {
    /// The pixels within a reach (px) of closed paths, each given with its own; and a few more.
    #[must_use]
    pub fn near<'a>(
        &self,
        paths: impl IntoIterator<Item = (&'a [Vector2<f64>], f64)>,
    ) -> KeptPixels {
        let (across, down) = (self.width.div_ceil(TILE), self.height.div_ceil(TILE));
        let mut places = vec![NOT_KEPT; across * down];
        for (path, reach) in paths {
            let ends = path.iter().cycle().skip(1);
            for (start, end) in path.iter().zip(ends) {
                mark(&mut places, [across, down], [start, end], reach);
            }
        }
        let mut kept = Vec::new();
        for (tile, place) in places.iter_mut().enumerate() {
            if *place != NOT_KEPT {
                *place = kept.len() as u32;
                kept.push([TILE * (tile % across), TILE * (tile / across)]);
            }
        }
        let pixels = match &self.pixels {
            Pixels::U8(values) => Pixels::U8(self.stacked(values, &kept)),
            Pixels::U16(values) => Pixels::U16(self.stacked(values, &kept)),
            Pixels::F32(values) => Pixels::F32(self.stacked(values, &kept)),
        };
        KeptPixels {
            width: self.width,
            height: self.height,
            places,
            tiles: Self {
                width: TILE,
                height: TILE * kept.len(),
                pixels,
                ..*self
            },
        }
    }

    /// The values of tiles, given by their first pixels, one below the other.
    fn stacked<T: Copy + Default>(&self, values: &[T], tiles: &[[usize; 2]]) -> Vec<T> {
        let tile_row = TILE * self.channels;
        let mut stacked = vec![T::default(); tiles.len() * TILE * tile_row];
        for (rows, &[x, y]) in stacked.chunks_exact_mut(TILE * tile_row).zip(tiles) {
            let count = (self.width - x).min(TILE) * self.channels;
            let inside = rows.chunks_exact_mut(tile_row).take(self.height - y);
            for (row, own) in inside.enumerate() {
                let first = ((y + row) * self.width + x) * self.channels;
                own[..count].copy_from_slice(&values[first..first + count]);
            }
        }
        stacked
    }
}

/// Marks the tiles within a reach of a straight piece of path.
fn mark(
    places: &mut [u32],
    [across, down]: [usize; 2],
    [start, end]: [&Vector2<f64>; 2],
    reach: f64,
) {
    let length = (end - start).norm();
    if !length.is_finite() {
        return;
    }
    let steps = (length / STEP).ceil().clamp(1.0, MAX_STEPS);
    // A point of the piece is at most half a step from one that is looked at.
    let reach = reach + 0.5 * length / steps;
    let tile = |v: f64, count: usize| (v / TILE as f64).clamp(0.0, count as f64) as usize;
    for step in 0..=steps as usize {
        let point = start.lerp(end, step as f64 / steps);
        let last = [point.x + reach, point.y + reach];
        for y in tile(point.y - reach, down)..tile(last[1] + TILE as f64, down) {
            for x in tile(point.x - reach, across)..tile(last[0] + TILE as f64, across) {
                let low = Vector2::new((TILE * x) as f64, (TILE * y) as f64);
                let nearest = point.sup(&low).inf(&low.add_scalar((TILE - 1) as f64));
                if (point - nearest).norm_squared() <= reach * reach {
                    places[y * across + x] = 0;
                }
            }
        }
    }
}

impl KeptPixels {
    /// Pixels in a row of the picture.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the picture.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels seen as coded grey under a tone curve.
    pub(crate) fn reader(&self, tone: Tone) -> KeptReader<'_> {
        KeptReader {
            kept: self,
            tiles: self.tiles.reader(tone),
        }
    }
}

/// The coded grey of the pixels that are kept: see [`GreyReader`].
pub(crate) struct KeptReader<'a> {
    kept: &'a KeptPixels,
    tiles: GreyReader<'a>,
}

impl<'a> KeptReader<'a> {
    pub fn kept(&self) -> &'a KeptPixels {
        self.kept
    }

    /// The coded grey at column `x` and row `y`, and whether a channel of it is at the file's limit;
    /// `None` where [`GreyReader::get`] of the picture is, and where the pixel is not kept.
    #[inline]
    pub fn get(&self, x: usize, y: usize) -> Option<(f64, bool)> {
        if x >= self.kept.width || y >= self.kept.height {
            return None;
        }
        let across = self.kept.width.div_ceil(TILE);
        let place = self.kept.places[y / TILE * across + x / TILE];
        if place == NOT_KEPT {
            return None;
        }
        let (x, y) = (x % TILE, place as usize * TILE + y % TILE);
        let Grey { value, is_clipped } = self.tiles.grey(x, y)?;
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
        assert_eq!(kept.tiles.height(), 0);
    }
}
