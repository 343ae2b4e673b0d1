//! Removal of the shift of a chessboard's edges before a calibration.
//!
//! A tone curve that differs from the camera's, or clipped white, moves every edge by about the
//! same amount toward its dark side. Shifts are counted toward the light side, and may have either
//! sign. Along a grid line that side alternates from cell to cell, so that the shift appears as a
//! zigzag of the line, which can be measured without a calibration.

use nalgebra::{Matrix5, Matrix5x3, RowVector3, Vector2, Vector5};

use crate::numeric::{median, upper_median};

/// Ratio of a sample's standard deviation to the smallest of its cell above which the sample is at
/// a crossing: the crossing takes part of its contrast, `2 Phi(2) - 1 = 1 / 1.05`, or the sample
/// lies across it. A wrong tone curve shifts such a sample by neither cell's amount, but by an
/// amount that may be larger by up to that ratio.
const FADED: f64 = 1.05;

/// Shift, in standard deviations of a sample, above which samples at crossings are left out: its
/// effect on them exceeds their noise, and alternates with the cells. Below, their standard
/// deviations are increased by as much instead; leaving them out would cost short cells half of the
/// information.
const MAX_DOUBT: f64 = 1.0;

/// Degree of the polynomial that models the image of a grid line: distortion bends it smoothly.
const LINE_DEGREE: usize = 4;

/// Maximum number of rounds of reweighting.
const ROUNDS: usize = 8;

/// Change of the shift, pixels, below which the reweighting ends: a tenth of the shift's standard
/// deviation on the best boards.
const SETTLED: f64 = 2e-4;

/// Fraction of the signs' sum of squares that rounding leaves where the cells of every line have
/// one sign only.
const ROUNDING: f64 = 1e-12;

/// Huber's limit, in medians of the absolute residuals: two robust standard deviations. A sample
/// beyond it has less weight.
const HUBER_LIMIT: f64 = 2.0 * 1.4826;
/// Smallest value of Huber's limit, in standard deviations, for residuals that are all rounding.
const SMALLEST_LIMIT: f64 = 2e-6;

/// Minimum fraction of a line's zigzag that a polynomial must leave unexplained for the line's own
/// shift to be estimated. With two cells a seventh is left, which depends on the samples next to
/// the one crossing.
const MIN_KNOWN: f64 = 0.2;
/// The same where the shift is evident in every sample: such a line then determines its shift
/// better than the other lines do.
const MIN_KNOWN_IF_EVIDENT: f64 = 1e-3;

/// Median of a standard normal variable's square.
const MEDIAN_SQUARE: f64 = 0.455;

/// Excess of one sign, as a fraction of the samples, from which the cells of a line are not all of
/// one length: a change of the shift along such a line acts as a tilt of the line as well.
const MAX_SURPLUS: f64 = 0.4;
/// Prior standard deviation, as a fraction of the shift, of the difference of a line's shift from
/// the board's, and of its increase from the middle of a line to its end.
const PERSPECTIVE: f64 = 0.3;

/// Size of a line's own estimate, in its standard deviations, above which it is used whatever the
/// other lines show.
const EVIDENT: f64 = 3.0;

/// Number of bisections of the range of the variance between lines: to a millionth of it.
const HALVINGS: usize = 20;

/// One edge sample along a grid line of a chessboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellSample {
    /// Its position, pixels.
    pub point: Vector2<f64>,
    /// Its standard deviation across the line, pixels.
    pub std: f64,
    /// Index along the line of the cell that it is beside.
    pub cell: usize,
}

/// Edge samples along one grid line of a chessboard.
#[derive(Debug, Clone, PartialEq)]
pub struct GridLineSamples {
    /// The samples in order along the line; two or more.
    pub samples: Vec<CellSample>,
    /// +1 if the picture gets lighter toward the line's right-hand normal at cells of even index,
    /// else -1; at cells of odd index it is the opposite.
    pub contrast_sign: f64,
}

/// Removes the shift by a wrong tone curve from the edges of one chessboard.
///
/// Returns the shift toward the light side in pixels, 0 if the lines do not determine it. If it
/// exceeds a sample's noise, the samples next to crossings are left out; otherwise their standard
/// deviations are increased.
pub fn remove_edge_shift(lines: &mut [GridLineSamples]) -> f64 {
    let faded: Vec<_> = lines.iter().map(GridLineSamples::faded_samples).collect();
    let pairs = lines.iter().zip(&faded);
    let clear: Vec<_> = pairs.map(|(line, faded)| line.without(faded)).collect();
    let zigzags: Vec<Zigzag> = clear.iter().map(Zigzag::of).collect();
    let shift = common_shift(&zigzags);
    let stds = lines
        .iter()
        .flat_map(|line| &line.samples)
        .map(|sample| sample.std);
    let median_std = median(stds.collect()).unwrap_or(f64::INFINITY);
    let is_evident = shift.abs() > MAX_DOUBT * median_std;
    // The shift differs from line to line with the blur across them, and along a line with its
    // distance from the camera.
    let shifts = shifts_of_lines(&zigzags, shift, is_evident);
    for (((line, clear), faded), line_shift) in lines.iter_mut().zip(clear).zip(faded).zip(shifts) {
        if is_evident {
            *line = clear;
        } else {
            line.increase_stds(&faded, shift);
        }
        line.subtract_shift(line_shift);
    }
    shift
}

impl GridLineSamples {
    /// Marks the samples that do not have the full contrast of their cell.
    fn faded_samples(&self) -> Vec<bool> {
        let cells = self.samples.iter().map(|sample| sample.cell + 1).max();
        let mut smallest_stds = vec![f64::INFINITY; cells.unwrap_or(0)];
        for sample in &self.samples {
            smallest_stds[sample.cell] = smallest_stds[sample.cell].min(sample.std);
        }
        let is_faded = |sample: &CellSample| sample.std > FADED * smallest_stds[sample.cell];
        let faded: Vec<bool> = self.samples.iter().map(is_faded).collect();
        // On a line of few samples, the others may be too few for a line.
        let is_line = faded.iter().filter(|is_faded| !**is_faded).count() > 1;
        faded.iter().map(|is_faded| *is_faded && is_line).collect()
    }

    fn without(&self, faded: &[bool]) -> Self {
        let pairs = self.samples.iter().zip(faded);
        Self {
            samples: pairs.filter(|pair| !pair.1).map(|pair| *pair.0).collect(),
            ..*self
        }
    }

    /// Increases the standard deviations at crossings by the effect of a shift of the edges there.
    fn increase_stds(&mut self, faded: &[bool], shift: f64) {
        let stds = self.samples.iter().map(|sample| sample.std);
        let Some(median_std) = upper_median(stds.collect()) else {
            return;
        };
        let factor = 1f64.hypot(shift / median_std);
        for (sample, _) in self.samples.iter_mut().zip(faded).filter(|pair| *pair.1) {
            sample.std *= factor;
        }
    }

    /// Subtracts a shift from the samples: moves them toward the dark side if it is positive.
    fn subtract_shift(&mut self, shift: LineShift) {
        let (normal, sign) = (self.normal(), self.contrast_sign);
        let places = self.places();
        for (sample, place) in self.samples.iter_mut().zip(places) {
            let distance = shift.middle + shift.increase * place;
            sample.point -= normal * (distance * sample.sign(sign));
        }
    }

    /// Returns the positions of the samples along the chord: from -1 to 1, about their mean.
    fn places(&self) -> Vec<f64> {
        let normal = self.normal();
        let along = Vector2::new(normal.y, -normal.x);
        let places = self.samples.iter().map(|sample| sample.point.dot(&along));
        let middle = places.clone().sum::<f64>() / self.samples.len() as f64;
        let farthest = places.clone().fold(f64::MIN_POSITIVE, |largest, place| {
            largest.max((place - middle).abs())
        });
        places.map(|place| (place - middle) / farthest).collect()
    }

    /// The right-hand normal of the chord.
    fn normal(&self) -> Vector2<f64> {
        let ends = self.samples.first().zip(self.samples.last());
        let along = ends.and_then(|(first, last)| (last.point - first.point).try_normalize(0.0));
        along.map_or(Vector2::zeros(), |along| Vector2::new(-along.y, along.x))
    }
}

impl CellSample {
    fn sign(&self, even_sign: f64) -> f64 {
        even_sign * alternation(self.cell)
    }
}

/// Returns 1 for even numbers, -1 for odd ones.
pub(super) fn alternation(number: usize) -> f64 {
    if number.is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// Shift of a line's edges toward their light side, pixels: in the middle of its samples, and the
/// increase from there to their end.
#[derive(Debug, Clone, Copy)]
struct LineShift {
    middle: f64,
    increase: f64,
}

/// A sample of a zigzag: its offset from the line's chord, the sign of its shift, and that sign
/// times its position along the chord; the Legendre polynomials at that position, zero above the
/// degree that the number of samples allows; and the reciprocal of its standard deviation.
struct ZigzagSample {
    /// Offset, `SIGNS` and `SIGNS_BY_PLACE`.
    values: RowVector3<f64>,
    basis: Vector5<f64>,
    precision: f64,
}

const SIGNS: usize = 1;
const SIGNS_BY_PLACE: usize = 2;

struct Zigzag(Vec<ZigzagSample>);

impl Zigzag {
    fn of(line: &GridLineSamples) -> Self {
        let normal = line.normal();
        let degree = LINE_DEGREE.min(line.samples.len().saturating_sub(2));
        let first = line.samples.first().map(|sample| sample.point);
        let zigzag_sample = |(sample, place): (&CellSample, f64)| {
            let sign = sample.sign(line.contrast_sign);
            let offset = (sample.point - first.unwrap_or_default()).dot(&normal);
            ZigzagSample {
                values: RowVector3::new(offset, sign, sign * place),
                basis: legendre(place, degree),
                precision: 1.0 / sample.std,
            }
        };
        Self(
            line.samples
                .iter()
                .zip(line.places())
                .map(zigzag_sample)
                .collect(),
        )
    }

    /// Returns the weighted offsets and signs without the part that a polynomial explains.
    fn without_polynomial(&self, weights: &[f64]) -> Vec<RowVector3<f64>> {
        let (mut gram, mut right) = (Matrix5::zeros(), Matrix5x3::zeros());
        for (sample, weight) in self.0.iter().zip(weights) {
            let weighted = sample.basis * (weight * weight);
            gram += weighted * sample.basis.transpose();
            right += weighted * sample.values;
        }
        for degree in 0..=LINE_DEGREE {
            if gram[(degree, degree)] == 0.0 {
                gram[(degree, degree)] = 1.0;
            }
        }
        let explained = gram.lu().solve(&right).unwrap_or_default();
        let remainder =
            |sample: &ZigzagSample| sample.values - sample.basis.transpose() * explained;
        let pairs = self.0.iter().zip(weights);
        pairs
            .map(|(sample, weight)| remainder(sample) * *weight)
            .collect()
    }

    /// Whether about as many samples are shifted one way as the other.
    fn has_cells_of_one_length(&self) -> bool {
        let surplus: f64 = self.0.iter().map(|sample| sample.values.y).sum();
        surplus.abs() < MAX_SURPLUS * self.0.len() as f64
    }

    fn precisions(&self) -> Vec<f64> {
        self.0.iter().map(|sample| sample.precision).collect()
    }
}

/// Legendre polynomials up to a degree; those beyond are zero.
fn legendre(x: f64, degree: usize) -> Vector5<f64> {
    let all = Vector5::new(
        1.0,
        x,
        (3.0 * x * x - 1.0) / 2.0,
        (5.0 * x * x - 3.0) * x / 2.0,
        ((35.0 * x * x - 30.0) * x * x + 3.0) / 8.0,
    );
    Vector5::from_fn(|k, _| if k <= degree { all[k] } else { 0.0 })
}

/// Estimates the common shift of all lines toward their light side, pixels; 0 if they show none.
///
/// Least squares over all lines at once, with a polynomial for each and one shift for all,
/// reweighted by Huber's function.
fn common_shift(lines: &[Zigzag]) -> f64 {
    let precisions: Vec<_> = lines.iter().map(Zigzag::precisions).collect();
    let mut weights = precisions.clone();
    let mut shift = 0.0;
    for _ in 0..ROUNDS {
        let pairs = lines.iter().zip(&weights);
        let remainders: Vec<_> = pairs
            .map(|(line, weights)| line.without_polynomial(weights))
            .collect();
        let (squares, products) = sums(remainders.iter().flatten().map(|row| (row.y, row.x)));
        // The polynomials explain the signs up to rounding.
        if squares
            <= ROUNDING
                * weights
                    .iter()
                    .flatten()
                    .map(|weight| weight * weight)
                    .sum::<f64>()
        {
            return 0.0;
        }
        let previous = shift;
        shift = products / squares;
        if (shift - previous).abs() < SETTLED {
            break;
        }
        let used = weights.iter().flatten().zip(precisions.iter().flatten());
        let sizes: Vec<f64> = remainders
            .iter()
            .flatten()
            .zip(used)
            .map(|(row, (weight, precision))| (row.x - shift * row.y).abs() * precision / weight)
            .collect();
        let limit = HUBER_LIMIT * median(sizes.clone()).unwrap_or(0.0);
        let limit = limit.max(SMALLEST_LIMIT);
        let new = precisions.iter().flatten().zip(sizes);
        for (weight, (precision, size)) in weights.iter_mut().flatten().zip(new) {
            *weight = precision * (limit / size.max(limit)).sqrt();
        }
    }
    shift
}

/// Returns the sum of squares of the remaining signs, and the sum of their products with the
/// remaining offsets.
fn sums(remainders: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    remainders.fold((0.0, 0.0), |(squares, products), (sign, offset)| {
        (squares + sign * sign, products + sign * offset)
    })
}

/// Estimates each line's own shift, as far as the lines are seen to differ from the board's shift,
/// and its change along the line, as far as that is seen.
///
/// Ink that spreads evenly on the board does not do so in the picture: nearer edges are shifted by
/// more, in proportion to the distance from the lines' vanishing point.
fn shifts_of_lines(lines: &[Zigzag], shift: f64, is_evident: bool) -> Vec<LineShift> {
    let min_known = if is_evident {
        MIN_KNOWN_IF_EVIDENT
    } else {
        MIN_KNOWN
    };
    let precisions: Vec<_> = lines.iter().map(Zigzag::precisions).collect();
    let pairs = lines.iter().zip(&precisions);
    let remainders: Vec<_> = pairs
        .map(|(line, weights)| line.without_polynomial(weights))
        .collect();
    // Samples whose stated standard deviations a wrong tone curve has raised scatter less than
    // stated.
    let scatter = remainders
        .iter()
        .flatten()
        .map(|row| (row.x - shift * row.y).powi(2));
    let scatter = median(scatter.collect()).unwrap_or(0.0) / MEDIAN_SQUARE;
    // For a line, the coefficient of one of its columns of signs in the remaining offsets, and its
    // variance; `None` if the line hardly determines it.
    let line_estimate = |line: usize, shift: f64, column: usize| {
        let rows = remainders[line].iter();
        let (known, products) = sums(rows.map(|row| (row[column], row.x - shift * row.y)));
        let all: f64 = precisions[line]
            .iter()
            .map(|precision| precision * precision)
            .sum();
        let variance = scatter / known + f64::MIN_POSITIVE;
        (known > min_known * all).then(|| (products / known, variance))
    };
    let departures: Vec<_> = (0..lines.len())
        .map(|line| line_estimate(line, shift, SIGNS))
        .collect();
    let prior_variance = (PERSPECTIVE * shift).powi(2);
    let departures = shrunk_estimates(&departures, prior_variance);
    let middles: Vec<f64> = departures
        .iter()
        .map(|departure| shift + departure)
        .collect();
    let changes = lines.iter().zip(&middles).enumerate();
    let changes = changes.map(|(number, (line, shift))| {
        line_estimate(number, *shift, SIGNS_BY_PLACE).filter(|_| line.has_cells_of_one_length())
    });
    let shifts = middles.iter().zip(changes);
    let shifts = shifts.map(|(&middle, change)| LineShift {
        middle,
        increase: change.map_or(0.0, |estimate| {
            shrunk(estimate, (PERSPECTIVE * middle).powi(2))
        }),
    });
    shifts.collect()
}

/// Shrinks the lines' estimates, given with their variances, towards zero.
///
/// A line of two or three cells hardly determines its own shift: so short a zigzag resembles a bend
/// or a tilt. Each estimate is therefore shrunk by the ratio of its variance to the variance
/// between the lines. That one is chosen such that the median of the squared estimates, in units of
/// both variances together, is that of chance (R. C. Paule & J. Mandel, J. Res. NBS 87 (1982)
/// 377-385), and does not exceed `max_variance`. An estimate that evidently differs from zero is
/// used whatever the others are.
fn shrunk_estimates(estimates: &[Option<(f64, f64)>], max_variance: f64) -> Vec<f64> {
    let known = || estimates.iter().flatten();
    let largest = known().fold(0.0, |largest: f64, (value, _)| largest.max(value.powi(2)));
    let (mut low, mut high) = (0.0, max_variance.min(largest / MEDIAN_SQUARE));
    for _ in 0..HALVINGS {
        let between = 0.5 * (low + high);
        let ratios = known().map(|(value, variance)| value.powi(2) / (variance + between));
        if median(ratios.collect()).is_some_and(|ratio| ratio > MEDIAN_SQUARE) {
            low = between;
        } else {
            high = between;
        }
    }
    let shrink = |estimate: (f64, f64)| shrunk(estimate, evident_variance(estimate).max(low));
    estimates
        .iter()
        .map(|estimate| estimate.map_or(0.0, shrink))
        .collect()
}

/// Shrinks an estimate with its variance towards zero: the posterior mean under a normal prior with
/// the variance `prior_variance`.
fn shrunk((value, variance): (f64, f64), prior_variance: f64) -> f64 {
    value * prior_variance / (prior_variance + variance)
}

/// Prior variance from a line's own estimate: zero unless the estimate is evident.
fn evident_variance((value, variance): (f64, f64)) -> f64 {
    (value * value - EVIDENT.powi(2) * variance).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: f64 = 0.05;
    const PER_CELL: usize = 6;

    /// Reproducible normal noise with the standard deviation `NOISE`.
    struct Noise(u64);

    impl Noise {
        fn uniform(&mut self) -> f64 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        fn next(&mut self) -> f64 {
            NOISE * ((0..12).map(|_| self.uniform()).sum::<f64>() - 6.0)
        }
    }

    /// Gently bent grid lines whose cells are shifted alternately.
    fn zigzag(shift: f64, lines: usize, cells: usize, noise: &mut Noise) -> Vec<GridLineSamples> {
        let line = |line: usize| {
            let count = PER_CELL * cells;
            let contrast_sign = if line.is_multiple_of(2) { 1.0 } else { -1.0 };
            let mut point = |k: usize| {
                let x = 200.0 * k as f64 / (count - 1) as f64;
                let sign = if (k / PER_CELL).is_multiple_of(2) {
                    contrast_sign
                } else {
                    -contrast_sign
                };
                let bent = 20.0 * line as f64 + 1e-4 * (x - 90.0).powi(2);
                Vector2::new(x, bent + shift * sign + noise.next())
            };
            let sample = |k: usize| CellSample {
                point: point(k),
                std: NOISE,
                cell: k / PER_CELL,
            };
            GridLineSamples {
                samples: (0..count).map(sample).collect(),
                contrast_sign,
            }
        };
        (0..lines).map(line).collect()
    }

    fn zigzags(lines: &[GridLineSamples]) -> Vec<Zigzag> {
        lines.iter().map(Zigzag::of).collect()
    }

    #[test]
    fn the_shift_of_bent_lines_is_found_and_taken_out() {
        let mut noise = Noise(1);
        for shift in [-0.4, 0.0, 0.25] {
            let mut lines = zigzag(shift, 9, 8, &mut noise);
            let found = remove_edge_shift(&mut lines);
            let std = NOISE / ((9 * 8 * PER_CELL) as f64).sqrt();
            assert!((found - shift).abs() < 4.0 * std, "{found}");
            let left = common_shift(&zigzags(&lines));
            assert!(left.abs() < 1e-3, "{left}");
        }
    }

    #[test]
    fn a_tenth_of_outliers_hardly_matters() {
        let mut noise = Noise(2);
        let mut lines = zigzag(0.25, 9, 8, &mut noise);
        for line in &mut lines {
            let contrast_sign = line.contrast_sign;
            for sample in &mut line.samples {
                if noise.uniform() < 0.1 {
                    sample.point.y -= 2.0 * sample.sign(contrast_sign);
                }
            }
        }
        assert!((common_shift(&zigzags(&lines)) - 0.25).abs() < 0.05);
    }

    #[test]
    fn long_lines_keep_a_shift_of_their_own() {
        let mut noise = Noise(4);
        let mut lines = zigzag(0.1, 9, 16, &mut noise);
        lines.extend(zigzag(0.3, 9, 16, &mut noise));
        let own = shifts_of_lines(&zigzags(&lines), 0.2, false);
        let mean =
            |part: &[LineShift]| part.iter().map(|own| own.middle).sum::<f64>() / part.len() as f64;
        assert!((mean(&own[..9]) - 0.1).abs() < 0.02);
        assert!((mean(&own[9..]) - 0.3).abs() < 0.02);
    }

    #[test]
    fn lines_that_differ_by_chance_have_the_board_s_shift() {
        let lines = zigzags(&zigzag(0.1, 9, 8, &mut Noise(5)));
        let each = lines
            .iter()
            .map(|line| common_shift(std::slice::from_ref(line)));
        let spread = |shifts: Vec<f64>| shifts.iter().map(|s| (s - 0.1).powi(2)).sum::<f64>();
        let own = shifts_of_lines(&lines, 0.1, false);
        let middle = own.iter().map(|own| own.middle).collect();
        assert!(spread(middle) < 0.25 * spread(each.collect()));
        assert!(own.iter().all(|own| own.increase.abs() < 0.1 * NOISE));
    }

    #[test]
    fn lines_differ_in_proportion_to_their_shift() {
        let mut noise = Noise(9);
        // Two standard deviations of a line's own estimate.
        let off = 2.0 * NOISE / ((16 * PER_CELL) as f64).sqrt();
        for (shift, most) in [(0.0, 0.0), (0.2, 2.0 * off)] {
            let mut lines = zigzag(shift - off, 9, 16, &mut noise);
            lines.extend(zigzag(shift + off, 9, 16, &mut noise));
            let own = shifts_of_lines(&zigzags(&lines), shift, false);
            let departures = own.iter().map(|own| (own.middle - shift).abs());
            let usual = median(departures.collect()).unwrap();
            assert!(usual <= most && usual >= 0.25 * most, "{usual}");
        }
    }

    #[test]
    fn a_shift_that_grows_along_its_line_is_known_at_both_ends() {
        let mut lines = zigzag(0.2, 9, 16, &mut Noise(8));
        let even = zigzag(0.2, 9, 16, &mut Noise(8));
        for (line, flat) in lines.iter_mut().zip(zigzag(0.0, 9, 16, &mut Noise(8))) {
            for (sample, flat) in line.samples.iter_mut().zip(&flat.samples) {
                let place = 0.01 * (flat.point.x - 100.0);
                sample.point.y =
                    flat.point.y + (1.0 + 0.5 * place) * (sample.point.y - flat.point.y);
            }
        }
        for own in shifts_of_lines(&zigzags(&lines), 0.2, false) {
            assert!((own.middle - 0.2).abs() < 0.03, "{own:?}");
            assert!((own.increase - 0.1).abs() < 0.04, "{own:?}");
        }
        for own in shifts_of_lines(&zigzags(&even), 0.2, false) {
            assert!(own.increase.abs() < 0.03, "{own:?}");
        }
    }

    #[test]
    fn lines_of_two_cells_are_left_to_the_board_and_never_run_away() {
        let mut noise = Noise(6);
        let lines = zigzags(&zigzag(0.0, 20, 2, &mut noise));
        for own in shifts_of_lines(&lines, 0.01, false) {
            assert_eq!((own.middle, own.increase), (0.01, 0.0));
        }
        let own = shifts_of_lines(&lines, 0.0, true);
        let most = 10.0 * NOISE;
        let is_small = |own: &LineShift| own.middle.abs() < most && own.increase.abs() < most;
        assert!(own.iter().all(is_small));
    }

    #[test]
    fn one_cell_no_line_and_points_that_coincide_say_nothing() {
        let mut one = zigzag(0.2, 1, 1, &mut Noise(7));
        assert_eq!(common_shift(&zigzags(&one)), 0.0);
        for sample in &mut one[0].samples {
            sample.point = Vector2::new(3.0, 4.0);
        }
        assert_eq!(common_shift(&zigzags(&one)), 0.0);
        assert_eq!(remove_edge_shift(&mut []), 0.0);
    }

    #[test]
    fn samples_at_crossings_are_doubted_or_left_out() {
        for (shift, left) in [(0.02, 48), (0.3, 46)] {
            let mut lines = zigzag(shift, 9, 8, &mut Noise(8));
            for line in &mut lines {
                line.samples[5].std *= 1.5;
                line.samples[6].std *= 1.5;
            }
            remove_edge_shift(&mut lines);
            assert!(lines.iter().all(|line| line.samples.len() == left));
            assert!(left == 46 || lines[0].samples[5].std > 1.5 * NOISE);
        }
    }
}
