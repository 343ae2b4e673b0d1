//! The normal equations of a side, from what it predicts of the pixels of its band.

use nalgebra::{SMatrix, SVector};

use super::band::Pixel;
use super::curve::COEFFICIENTS;
use super::pixel_noise::{robust_cost, robust_weight};
use super::side::{BASE, BLUR, CONTRAST, PARAMETERS, Prediction, Side};

/// Bins along the side for the normal equations, pixels, and how many there are at least.
pub(super) const BIN_LENGTH: f64 = 8.0;
const MIN_BINS: f64 = 24.0;

/// Bins are counted from this far along, in `s`: before any pixel, even of a short extended side.
const BIN_ORIGIN: f64 = -4.0;

/// The basic derivatives, by height, base, contrast and blur: the first parameter of each, and the
/// degree of its polynomial in `s`.
const BASIC: usize = 4;
const FIRST: [usize; BASIC] = [0, BASE, CONTRAST, BLUR];
const DEGREES: [usize; BASIC] = [COEFFICIENTS - 1, 1, 1, 0];
const POWERS: usize = 2 * COEFFICIENTS - 1;

type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
/// A step of all parameters of a side.
pub(super) type Step = SVector<f64, PARAMETERS>;

/// Sums over a few columns of pixels: products of the four basic derivatives and the residual.
#[derive(Default)]
struct BinSums {
    count: f64,
    s: f64,
    products: [[f64; BASIC]; BASIC],
    right: [f64; BASIC],
}

impl BinSums {
    #[inline]
    fn add(&mut self, s: f64, weight: f64, derivatives: [f64; BASIC], residual: f64) {
        self.count += 1.0;
        self.s += s;
        for i in 0..BASIC {
            let weighted = weight * derivatives[i];
            for j in i..BASIC {
                self.products[i][j] += weighted * derivatives[j];
            }
            self.right[i] += weighted * residual;
        }
    }
}

/// The normal equations of a step, and the cost where they were taken.
///
/// Every parameter's derivative is a basic one times a power of `s`, which hardly varies within a
/// bin: the sums of the bins' products with the powers hold each different entry once.
#[derive(Default)]
pub(super) struct Equations {
    products: [[[f64; POWERS]; BASIC]; BASIC],
    right: [[f64; COEFFICIENTS]; BASIC],
    pub cost: f64,
}

impl Equations {
    /// From what a side predicts of pixels, `noise` being the residuals' expected scale.
    pub fn of(side: &Side, pixels: &[Pixel], predictions: &[Prediction], noise: f64) -> Self {
        let bins = (side.curve.length() / BIN_LENGTH).max(MIN_BINS);
        let bin_of = |s: f64| (0.5 * (s - BIN_ORIGIN) * bins) as i32;
        let inverse_variance = 1.0 / (noise * noise);
        let mut equations = Self::default();
        let mut sums = BinSums::default();
        let mut current = i32::MIN;
        for (pixel, p) in pixels.iter().zip(predictions) {
            // Pixels come nearly in order along the side, so that one open bin is enough.
            let bin = bin_of(pixel.s);
            if bin != current {
                equations.add(&sums);
                sums = BinSums::default();
                current = bin;
            }
            let inverse_variance = inverse_variance * pixel.count;
            let square = p.residual * p.residual * inverse_variance;
            let weight = robust_weight(square) * inverse_variance;
            equations.cost += robust_cost(square);
            sums.add(
                pixel.s,
                weight,
                [p.by_height, p.by_base, p.by_contrast, p.by_blur],
                p.residual,
            );
        }
        equations.add(&sums);
        equations
    }

    fn add(&mut self, bin: &BinSums) {
        if bin.count == 0.0 {
            return;
        }
        let s = bin.s / bin.count;
        let mut powers = [1.0; POWERS];
        for k in 1..POWERS {
            powers[k] = powers[k - 1] * s;
        }
        for i in 0..BASIC {
            for j in i..BASIC {
                for k in 0..DEGREES[i] + DEGREES[j] + 1 {
                    self.products[i][j][k] += bin.products[i][j] * powers[k];
                }
            }
            for k in 0..=DEGREES[i] {
                self.right[i][k] += bin.right[i] * powers[k];
            }
        }
    }

    /// The symmetric matrix and the right-hand side, in the parameters' order.
    fn assembled(&self) -> (Normal, Step) {
        let (mut normal, mut right) = (Normal::zeros(), Step::zeros());
        for i in 0..BASIC {
            for power in 0..=DEGREES[i] {
                let row = FIRST[i] + power;
                right[row] = self.right[i][power];
                for j in i..BASIC {
                    for other_power in 0..=DEGREES[j] {
                        let column = FIRST[j] + other_power;
                        normal[(row, column)] = self.products[i][j][power + other_power];
                        normal[(column, row)] = normal[(row, column)];
                    }
                }
            }
        }
        (normal, right)
    }

    /// A step; the polynomial's coefficients beyond its degree stay as they are.
    pub fn step(&self, degree: usize, damping: f64) -> Option<Step> {
        let (mut normal, mut right) = self.assembled();
        for parameter in 0..PARAMETERS {
            normal[(parameter, parameter)] *= 1.0 + damping;
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
}
