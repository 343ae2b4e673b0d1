//! The model of one side, `v = g(b + A Phi(d / w))`, fitted to the pixels of its band.

use nalgebra::{SMatrix, SVector};

use super::band::Pixel;
use super::curve::{COEFFICIENTS, Curve};
use crate::normal::cdf_and_pdf;
use crate::tone::ToneCurve;

/// Bounds of the blur, pixels: a pixel's own box alone is 0.29, and beyond the upper one there is
/// no edge to speak of.
pub(super) const BLUR_RANGE: [f64; 2] = [0.3, 8.0];
/// Residuals up to this many standard deviations count in full, larger ones less and less. Clean
/// data lose 0.3 % to it.
const ROBUST_LIMIT: f64 = 3.0;
/// The edge itself: pixels within so many blurs of the curve tell the noise that matters.
pub(super) const EDGE_BLURS: f64 = 2.0;
/// A step below this many pixels ends the iteration: the next would be quadratically smaller, a
/// hundredth of the best samples' noise.
const SETTLED: f64 = 5e-3;
/// Steps are cut to these: pixels of position, and factor of the blur.
const MAX_SHIFT: f64 = 1.5;
const MAX_BLUR_RATIO: f64 = 1.6;
const FIRST_DAMPING: f64 = 1e-6;
const DAMPING_RATIO: f64 = 30.0;
/// Bins along the side for the normal equations, pixels, and how many there are at least.
const BIN_LENGTH: f64 = 4.0;
const MIN_BINS: f64 = 24.0;

/// Bins are counted from this far along, in `s`: before any pixel, even of a short extended side.
const BIN_ORIGIN: f64 = -4.0;

const BASE: usize = COEFFICIENTS;
const RISE: usize = BASE + 2;
const BLUR: usize = RISE + 2;
const PARAMETERS: usize = BLUR + 1;

type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Gradient = SVector<f64, PARAMETERS>;

/// One side: where it runs, and what a pixel near it holds.
#[derive(Debug, Clone)]
pub(super) struct Side {
    pub curve: Curve,
    /// Light where the distance is negative: constant, and linear in `s`.
    pub base: [f64; 2],
    /// What the light rises by across the edge, likewise.
    pub rise: [f64; 2],
    /// Standard deviation of the blur with the pixel's own box, pixels.
    pub blur: f64,
}

/// A pixel's residual and the derivatives of its modelled value.
pub(super) struct Prediction {
    /// Observed less modelled.
    pub residual: f64,
    /// Distance from the curve in blurs.
    pub blurs: f64,
    /// With respect to the curve's `y`.
    pub by_height: f64,
    pub by_base: f64,
    pub by_rise: f64,
    pub by_blur: f64,
    /// With respect to an offset of the edge along its normal.
    pub by_offset: f64,
}

/// Weight of a residual whose square, in variances, is given: the derivative of the robust cost.
#[inline]
pub(super) fn robust_weight(square: f64) -> f64 {
    const LIMIT: f64 = ROBUST_LIMIT * ROBUST_LIMIT;
    if square <= LIMIT { 1.0 } else { LIMIT / square }
}

fn robust_cost(square: f64) -> f64 {
    const LIMIT: f64 = ROBUST_LIMIT * ROBUST_LIMIT;
    if square <= LIMIT {
        square
    } else {
        LIMIT * (1.0 + (square / LIMIT).ln())
    }
}

impl Side {
    /// Light on the two sides of the middle of the edge, the negative side first.
    pub fn plateaus(&self) -> [f64; 2] {
        [self.base[0], self.base[0] + self.rise[0]]
    }

    /// Predicts one pixel, the curve being moved by `offset` along its normal.
    #[inline(always)]
    pub fn predict(&self, tone: &ToneCurve, pixel: &Pixel, offset: f64) -> Prediction {
        let inverse_blur = 1.0 / self.blur;
        let above = pixel.y - self.curve.height(pixel.s);
        let blurs = (above * pixel.cosine - offset) * inverse_blur;
        let (step, density) = cdf_and_pdf(blurs);
        let rise = self.rise[0] + self.rise[1] * pixel.s;
        let light = self.base[0] + self.base[1] * pixel.s + rise * step;
        let (value, gain) = tone.encode_with_slope(light);
        let by_distance = gain * rise * density * inverse_blur;
        Prediction {
            residual: pixel.value - value,
            blurs,
            by_height: -by_distance * pixel.cosine,
            by_base: gain,
            by_rise: gain * step,
            by_blur: -by_distance * blurs,
            by_offset: -by_distance,
        }
    }

    /// Damped Gauss-Newton on all parameters, `noise` being the residuals' expected scale.
    ///
    /// Returns whether it settled within the steps allowed; the side is left at the lowest cost
    /// seen, except that a last step too small to matter is taken unseen.
    pub fn fit(
        &mut self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        noise: f64,
        max_steps: usize,
    ) -> bool {
        let mut damping = FIRST_DAMPING;
        let mut best = self.normal_equations(tone, pixels, noise);
        for _ in 0..max_steps {
            let Some(step) = solve(&best, self.curve.degree, damping) else {
                damping *= DAMPING_RATIO;
                continue;
            };
            let mut next = self.clone();
            if next.advance(&step) < SETTLED {
                *self = next;
                return true;
            }
            let equations = next.normal_equations(tone, pixels, noise);
            if equations.cost < best.cost {
                (*self, best) = (next, equations);
                damping = (damping / DAMPING_RATIO).max(FIRST_DAMPING);
            } else {
                damping *= DAMPING_RATIO;
            }
        }
        false
    }

    /// Takes a step, cut to what is plausible; returns how far the edge or its blur moved, pixels.
    fn advance(&mut self, step: &Gradient) -> f64 {
        let shift = (0..COEFFICIENTS).map(|k| step[k].abs()).sum::<f64>();
        let scale = (MAX_SHIFT / shift).min(1.0);
        let previous_blur = self.blur;
        for k in 0..COEFFICIENTS {
            self.curve.coefficients[k] += scale * step[k];
        }
        for k in 0..2 {
            self.base[k] += scale * step[BASE + k];
            self.rise[k] += scale * step[RISE + k];
        }
        let ratio =
            (1.0 + scale * step[BLUR] / self.blur).clamp(1.0 / MAX_BLUR_RATIO, MAX_BLUR_RATIO);
        self.blur = (self.blur * ratio).clamp(BLUR_RANGE[0], BLUR_RANGE[1]);
        (scale * shift).max((self.blur - previous_blur).abs())
    }

    fn normal_equations(&self, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> Equations {
        let bins = (self.curve.length() / BIN_LENGTH).max(MIN_BINS);
        let bin_of = |s: f64| (0.5 * (s - BIN_ORIGIN) * bins) as i32;
        let inverse_variance = 1.0 / (noise * noise);
        let mut equations = Equations::default();
        let mut sums = BinSums::default();
        let mut current = i32::MIN;
        for pixel in pixels {
            // Pixels come nearly in order along the side, so that one open bin is enough.
            let bin = bin_of(pixel.s);
            if bin != current {
                equations.add(&sums);
                sums = BinSums::default();
                current = bin;
            }
            let p = self.predict(tone, pixel, 0.0);
            let inverse_variance = inverse_variance * pixel.count;
            let square = p.residual * p.residual * inverse_variance;
            let weight = robust_weight(square) * inverse_variance;
            equations.cost += robust_cost(square);
            sums.add(
                pixel.s,
                weight,
                [p.by_height, p.by_base, p.by_rise, p.by_blur],
                p.residual,
            );
        }
        equations.add(&sums);
        equations
    }

    /// Scale of the residuals at the edge: the middle half of them, freed of outliers.
    ///
    /// `parameters` of the fit are counted against the pixels; not below `floor`.
    pub fn edge_noise(
        &self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        floor: f64,
        residuals: &mut Vec<f64>,
    ) -> f64 {
        /// Median of the absolute value of a standard normal variable.
        const NORMAL_MEDIAN: f64 = 0.674_489_750_196_082;
        /// Beyond three deviations lie 0.27 % of normal residuals; without them the rms is smaller.
        const TRUNCATED_RMS: f64 = 0.986_6;
        residuals.clear();
        for pixel in pixels {
            let p = self.predict(tone, pixel, 0.0);
            if p.blurs.abs() < EDGE_BLURS {
                residuals.push(p.residual.abs());
            }
        }
        if residuals.is_empty() {
            return floor;
        }
        let middle = residuals.len() / 2;
        let (_, median, _) = residuals.select_nth_unstable_by(middle, f64::total_cmp);
        let limit = (ROBUST_LIMIT * *median / NORMAL_MEDIAN).max(floor);
        let (mut sum, mut count) = (0.0, 0.0);
        for residual in residuals.iter().filter(|&&residual| residual <= limit) {
            sum += residual * residual;
            count += 1.0;
        }
        // The edge pixels carry the curve and the blur, and about half of base and rise.
        let fitted = self.curve.degree as f64 + 4.0;
        let freedom = (count - fitted).max(1.0);
        ((sum / freedom).sqrt() / TRUNCATED_RMS).max(floor)
    }
}

/// Sums over a few columns of pixels: products of the four basic derivatives and the residual.
#[derive(Default)]
struct BinSums {
    count: f64,
    s: f64,
    products: [[f64; 4]; 4],
    right: [f64; 4],
}

impl BinSums {
    #[inline]
    fn add(&mut self, s: f64, weight: f64, derivatives: [f64; 4], residual: f64) {
        self.count += 1.0;
        self.s += s;
        for i in 0..4 {
            let weighted = weight * derivatives[i];
            for j in i..4 {
                self.products[i][j] += weighted * derivatives[j];
            }
            self.right[i] += weighted * residual;
        }
    }
}

/// The normal equations of a step, and the cost where they were taken.
#[derive(Default)]
struct Equations {
    normal: Normal,
    right: Gradient,
    cost: f64,
}

impl Equations {
    /// Expands a bin: every parameter's derivative is a basic one times a power of `s`, which
    /// hardly varies within the bin.
    fn add(&mut self, bin: &BinSums) {
        if bin.count == 0.0 {
            return;
        }
        let s = bin.s / bin.count;
        let mut derivative_of = [(0, 1.0); PARAMETERS];
        let mut power = 1.0;
        for k in 0..COEFFICIENTS {
            derivative_of[k] = (0, power);
            power *= s;
        }
        derivative_of[BASE..].copy_from_slice(&[(1, 1.0), (1, s), (2, 1.0), (2, s), (3, 1.0)]);
        for (row, (basic, factor)) in derivative_of.into_iter().enumerate() {
            for (column, (other, other_factor)) in derivative_of.into_iter().enumerate().skip(row) {
                self.normal[(row, column)] += factor * other_factor * bin.products[basic][other];
            }
            self.right[row] += factor * bin.right[basic];
        }
    }
}

/// Solves for a step; the polynomial's coefficients beyond its degree stay as they are.
fn solve(equations: &Equations, degree: usize, damping: f64) -> Option<Gradient> {
    let mut normal = equations.normal;
    let mut right = equations.right;
    for row in 0..PARAMETERS {
        for column in 0..row {
            normal[(row, column)] = normal[(column, row)];
        }
        normal[(row, row)] *= 1.0 + damping;
    }
    for unused in degree + 1..COEFFICIENTS {
        normal.row_mut(unused).fill(0.0);
        normal.column_mut(unused).fill(0.0);
        normal[(unused, unused)] = 1.0;
        right[unused] = 0.0;
    }
    let step = normal.cholesky()?.solve(&right);
    step.iter().all(|value| value.is_finite()).then_some(step)
}
