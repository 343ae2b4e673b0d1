//! One pass over a side's residuals: the sums that its smooth displacement follows from.

use nalgebra::{SMatrix, Vector2};

use super::side_basis::{Basis, ORDERS, basis_by_polynomials, direction, places, places_on_arc};
use crate::numeric::{LANES, Loss, PolynomialSums, polynomials};
use crate::observations::{Curve, Side};
use crate::refine::Residual;

/// A sample tells no more of a misfit than one so many times the noise away.
const FARTHEST: f64 = 1e3;

/// `B^T W B` of the basis at the samples.
pub(crate) type Gram = SMatrix<f64, ORDERS, ORDERS>;

/// `B^T W B` and `B^T W r`, `W` in units of the noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moments {
    pub gram: Gram,
    pub gradient: Basis,
}

/// What the residuals of one side sum to.
#[derive(Debug, Clone)]
pub(crate) struct SideMoments {
    /// The way the side runs.
    pub along: Vector2<f64>,
    /// Where each sample lies, from -1 to 1.
    pub places: Vec<f64>,
    /// With the weights of the robust loss.
    pub robust: Moments,
    /// With the samples' own weights.
    pub plain: Moments,
    /// Weight of the best sample.
    pub strongest: f64,
}

/// Sums from which the moments follow.
type Sums = PolynomialSums<ORDERS, MOMENTS>;

/// Polynomials at each sample from which the products of the first [`ORDERS`] follow.
const MOMENTS: usize = 2 * ORDERS - 1;

impl Moments {
    fn of(sums: &Sums) -> Self {
        let (products, values) = sums.finish();
        let basis = basis_by_polynomials();
        Self {
            gram: basis * Gram::from_fn(|i, j| products[i][j]) * basis.transpose(),
            gradient: basis * Basis::from(values),
        }
    }
}

impl SideMoments {
    /// At a scale of the noise.
    pub fn of(side: &Side, residuals: &[Residual], scale: f64) -> Self {
        let along = direction(&side.samples).unwrap_or_default();
        let places = match side.curve {
            Curve::Line(_) => places(&side.samples, &along),
            Curve::Circle(_) => places_on_arc(&side.samples),
        };
        let (robust, plain, strongest) = summed(&places, residuals, scale);
        Self {
            along,
            places,
            robust: Moments::of(&robust),
            plain: Moments::of(&plain),
            strongest,
        }
    }
}

/// The sums with the weights of the robust loss and with the samples' own, and the largest weight.
fn summed(places: &[f64], residuals: &[Residual], scale: f64) -> (Sums, Sums, f64) {
    let (mut robust, mut plain) = (Sums::new(), Sums::new());
    let mut strongest = f64::MIN_POSITIVE;
    for (places, residuals) in places.chunks(LANES).zip(residuals.chunks(LANES)) {
        let mut at = [0.0; LANES];
        at[..places.len()].copy_from_slice(places);
        let [mut weights, mut values, mut plain_weights, mut plain_values] = [[0.0; LANES]; 4];
        for (i, residual) in residuals.iter().enumerate() {
            let to_noise = residual.weight / scale;
            strongest = strongest.max(to_noise);
            let value = residual.distance * to_noise;
            let (_, weight) = Loss::Tukey.cost_and_weight(value);
            let square = to_noise * to_noise;
            weights[i] = weight * square;
            values[i] = weights[i] * residual.distance;
            plain_weights[i] = square;
            plain_values[i] = to_noise * value.clamp(-FARTHEST, FARTHEST);
        }
        let terms = polynomials(&at);
        robust.add(&terms, &weights, &values);
        plain.add(&terms, &plain_weights, &plain_values);
    }
    (robust, plain, strongest)
}
