//! A fine pattern over the picture (moire, a screen's grid, a print's raster), found as waves of
//! the light beside the edges.

use std::f64::consts::TAU;

use nalgebra::Complex;

use super::preview::Preview;
use crate::image::GreyReader;

/// Minimum fraction of the sides on which ...
const MIN_SIDES: f64 = 0.5;
/// ... one wave explains this fraction of the variance of the light beside them.
const MIN_PART: f64 = 0.5;
/// Minimum number of periods along a side: light that changes slowly is shading or a shadow, and a
/// pattern along a side is its own blur.
const MIN_PERIODS: f64 = 3.0;
/// Variation of the light (rms), as a fraction of a side's contrast, below which it hardly
/// displaces the side.
const MIN_VARIATION: f64 = 0.02;
/// Distance from an edge, in blurs, within which pixels show more of the edge than of the light
/// beside it.
const EDGE_BLURS: f64 = 2.0;
/// Minimum number of columns of pixels of a side that is used.
const MIN_COLUMNS: usize = 12;
/// Number of frequencies tried per frequency that the pixels can resolve.
const OVERSAMPLING: f64 = 2.0;

/// Residuals of the pixels in one column, or row, across a side.
struct ResidualColumn {
    number: i64,
    /// Coordinate along the chord's normal, and residual.
    pixels: Vec<(f64, f64)>,
}

/// Median amplitude, as a fraction of the contrast, of the waves on the sides; `None` if too few
/// sides show one.
pub(super) fn pattern<'a>(
    reader: &GreyReader<'_>,
    previews: impl Iterator<Item = &'a Preview>,
) -> Option<f64> {
    let (mut waves, mut sides) = (Vec::new(), 0.0);
    for preview in previews {
        sides += 1.0;
        let [before, after] = preview.side.plateaus();
        let contrast = reader.tone().encode(after) - reader.tone().encode(before);
        waves.extend(wave(preview, contrast.abs()));
    }
    if waves.is_empty() || (waves.len() as f64) < MIN_SIDES * sides {
        return None;
    }
    let middle = waves.len() / 2;
    Some(*waves.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Amplitude, over the contrast, of the wave that explains the light beside a side.
fn wave(preview: &Preview, contrast: f64) -> Option<f64> {
    let mut columns = columns(preview);
    let count: f64 = columns
        .iter()
        .map(|column| column.pixels.len() as f64)
        .sum();
    let values = columns.iter().flat_map(|column| &column.pixels);
    // A constant error of the light looks like a wave if it shows in every other cell of a board.
    let mean = values.map(|(_, value)| value).sum::<f64>() / count;
    for (_, value) in columns.iter_mut().flat_map(|column| &mut column.pixels) {
        *value -= mean;
    }
    let values = || columns.iter().flat_map(|column| &column.pixels);
    let power: f64 = values().map(|(_, value)| value * value).sum();
    let is_even = power < count * (MIN_VARIATION * contrast).powi(2);
    if columns.len() < MIN_COLUMNS || is_even {
        return None;
    }
    // For real values, half of the plane of frequencies suffices.
    let across = preview.side.curve.across;
    let spread = |low: f64, high: f64| (high - low).max(1.0);
    let (low, high) = values().fold((f64::MAX, f64::MIN), |(low, high), (y, _)| {
        (low.min(*y), high.max(*y))
    });
    let highest = 0.5 / across.amax();
    let steps = (OVERSAMPLING * highest * spread(low, high)).ceil();
    let step = highest / steps;
    let mut across: Vec<Wave> = values().map(|(y, _)| Wave::new(step * y)).collect();
    let along = AlongWaves::of(&columns);
    let mut strongest = 0f64;
    for _ in 0..=steps as usize {
        let mut waves = across.iter_mut();
        let sums = columns.iter().map(|column| {
            let terms = column.pixels.iter().zip(waves.by_ref());
            terms.map(|((_, value), wave)| wave.next() * *value).sum()
        });
        strongest = strongest.max(along.strongest(sums));
    }
    // A wave of amplitude `a` sums to `a n / 2`, and its squares to `a^2 n / 2`.
    let part = 2.0 * strongest * strongest / (count * power);
    (part > MIN_PART).then(|| 2.0 * strongest / (count * contrast))
}

/// A wave at one place, for frequencies at equal steps.
#[derive(Clone, Copy)]
struct Wave {
    now: Complex<f64>,
    turn: Complex<f64>,
}

impl Wave {
    /// A wave whose phase increases by `turns` from each frequency to the next.
    fn new(turns: f64) -> Self {
        Self {
            now: Complex::new(1.0, 0.0),
            turn: Complex::from_polar(1.0, TAU * turns),
        }
    }

    /// Returns the wave at the current frequency, and advances to the next one.
    fn next(&mut self) -> Complex<f64> {
        let now = self.now;
        self.now *= self.turn;
        now
    }
}

/// Waves along a side, for the frequencies that its columns resolve.
struct AlongWaves {
    /// For each column, the wave of the lowest frequency.
    lowest: Vec<Wave>,
    frequencies: usize,
}

impl AlongWaves {
    fn of(columns: &[ResidualColumn]) -> Self {
        let first = columns[0].number;
        let spacings = columns
            .windows(2)
            .map(|pair| pair[1].number - pair[0].number);
        // If only one column in several was read, frequencies that differ by a multiple of the
        // sampling rate are the same.
        let spacing = spacings.min().unwrap_or(1).max(1) as f64;
        let last = columns[columns.len() - 1].number;
        let periods = (last - first) as f64 / spacing + 1.0;
        let frequencies = (OVERSAMPLING * periods) as usize;
        let lowest = (OVERSAMPLING * MIN_PERIODS) as usize;
        let at = |column: &ResidualColumn| {
            let turns = (column.number - first) as f64 / (frequencies as f64 * spacing);
            Wave {
                now: Complex::from_polar(1.0, TAU * turns * lowest as f64),
                ..Wave::new(turns)
            }
        };
        Self {
            lowest: columns.iter().map(at).collect(),
            frequencies: frequencies.saturating_sub(2 * lowest),
        }
    }

    /// The largest absolute value, over the frequencies, of the sums over the columns of their
    /// terms times the wave.
    fn strongest(&self, columns: impl Iterator<Item = Complex<f64>>) -> f64 {
        let mut terms = self.lowest.clone();
        terms
            .iter_mut()
            .zip(columns)
            .for_each(|(term, factor)| term.now *= factor);
        let norms = (0..self.frequencies).map(|_| {
            terms
                .iter_mut()
                .map(Wave::next)
                .sum::<Complex<f64>>()
                .norm()
        });
        norms.fold(0.0, f64::max)
    }
}

/// The light pixels beside a side, by column.
fn columns(preview: &Preview) -> Vec<ResidualColumn> {
    let side = &preview.side;
    let curve = &side.curve;
    let u = usize::from(curve.along.x.abs() < curve.along.y.abs());
    let mut columns: Vec<ResidualColumn> = Vec::new();
    for (pixel, p) in preview.pixels.iter().zip(&preview.predictions) {
        let is_light = p.blurs * side.contrast[0] * pixel.flip.slope > 0.0;
        if !is_light || p.is_silent || p.blurs.abs() < EDGE_BLURS {
            continue;
        }
        let place = curve.origin[u]
            + pixel.s * curve.half_length * curve.along[u]
            + pixel.y * curve.across[u];
        let number = place.round() as i64;
        match columns.last_mut().filter(|column| column.number == number) {
            Some(column) => column.pixels.push((pixel.y, p.residual)),
            None => columns.push(ResidualColumn {
                number,
                pixels: vec![(pixel.y, p.residual)],
            }),
        }
    }
    columns
}
