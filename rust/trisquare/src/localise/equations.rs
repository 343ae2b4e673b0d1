//! The normal equations of a side, from its predictions for the pixels of its band.

use nalgebra::{SMatrix, SVector};

use super::band::Pixel;
use super::curve::COEFFICIENTS;
use super::pixel_noise::{robust_cost, robust_weight};
use super::prediction::Prediction;
use super::side_sums::{BIN_LENGTH, Degrees, LIGHT, SideSums};

/// Index of the first parameter of base, contrast and blur, and the number of parameters.
pub(super) const BASE: usize = COEFFICIENTS;
pub(super) const CONTRAST: usize = BASE + LIGHT;
pub(super) const BLUR: usize = CONTRAST + LIGHT;
pub(super) const PARAMETERS: usize = BLUR + LIGHT;

/// Number of columns of a pixel's row: derivatives with respect to height, base, contrast and blur,
/// and the residual.
const COLUMNS: usize = 5;
/// Minimum number of bins of a side.
const MIN_BINS: f64 = 24.0;
/// Start of the first bin, in `s`: before any pixel, even of a short extended side.
const FIRST_BIN: f64 = -4.0;

/// The matrix of the normal equations of all parameters of a side.
pub(super) type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;
/// A step of all parameters of a side.
pub(super) type Step = SVector<f64, PARAMETERS>;

/// The normal equations of a step, and the cost at the current parameters.
pub(super) struct Equations {
    pub normal: Normal,
    right: Step,
    pub cost: f64,
}

impl Equations {
    /// The equations from the predictions for pixels of a side of the given length, whose
    /// parameters change along it with the given powers; `noise` is the expected scale of the
    /// residuals.
    pub fn of(
        (length, degrees): (f64, Degrees),
        pixels: &[Pixel],
        predictions: &[Prediction],
        noise: f64,
    ) -> Self {
        let bins_per_s = 0.5 * (length / BIN_LENGTH).max(MIN_BINS);
        let inverse_variance = 1.0 / (noise * noise);
        let mut cost = 0.0;
        let rows = pixels.iter().zip(predictions).map(|(pixel, p)| {
            let inverse_variance = inverse_variance * pixel.count;
            let square = p.residual * p.residual * inverse_variance;
            cost += robust_cost(square);
            let weight = robust_weight(square) * inverse_variance;
            let row = [p.by_height, p.by_base, p.by_contrast, p.by_blur, p.residual];
            (pixel.s, weight, row)
        });
        let sums = SideSums::<COLUMNS>::of(rows, bins_per_s, FIRST_BIN * bins_per_s);
        let (normal, right) = sums.assembled(degrees);
        Self {
            normal,
            right,
            cost,
        }
    }

    /// The solution for a step, with the diagonal multiplied by `1 + damping`.
    pub fn step(&self, damping: f64) -> Option<Step> {
        let mut normal = self.normal;
        for parameter in 0..PARAMETERS {
            normal[(parameter, parameter)] *= 1.0 + damping;
        }
        let step = normal.cholesky()?.solve(&self.right);
        step.iter().all(|value| value.is_finite()).then_some(step)
    }
}
