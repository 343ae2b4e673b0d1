//! Moments of a side's residuals, from which its smooth displacement is computed.

use std::array;

use nalgebra::{SMatrix, Vector2};

use super::side_basis::{Basis, ORDERS, basis_by_polynomials, direction, places, places_on_arc};
use crate::numeric::{LANES, Loss, PolynomialSums, polynomials};
use crate::observations::{Curve, Side};
use crate::refine::Residual;

/// Limit of a sample's residual, in standard deviations, in the plain moments.
const MAX_RESIDUAL: f64 = 1e3;

/// Window of neighbours, including the sample itself, within which a sample may be stray: two
/// adjacent stray samples are still distinguished from a bend.
const NEIGHBOURS: usize = 5;

/// `B^T W B` of the basis at the samples.
pub(crate) type Gram = SMatrix<f64, ORDERS, ORDERS>;

/// `B^T W B` and `B^T W r`, `W` in units of the noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moments {
    pub gram: Gram,
    pub gradient: Basis,
}

/// Moments of the residuals of one side.
#[derive(Debug, Clone)]
pub(crate) struct SideMoments {
    /// Direction of the side.
    pub along: Vector2<f64>,
    /// Position of each sample, from -1 to 1.
    pub places: Vec<f64>,
    /// Moments with the weights of the robust loss.
    pub robust: Moments,
    /// Moments with the samples' own weights, without stray samples.
    pub plain: Moments,
    /// Indices of the stray samples: far from the line, and far from their neighbours. At a bend
    /// the neighbours are displaced as well.
    pub strays: Vec<usize>,
    /// Weight of the best sample.
    pub largest_weight: f64,
}

/// Sums from which the moments follow.
type Sums = PolynomialSums<ORDERS, MOMENTS>;

/// Number of polynomials at each sample that determine the products of the first [`ORDERS`].
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
    /// Moments at a scale of the noise.
    pub fn of(side: &Side, residuals: &[Residual], scale: f64) -> Self {
        let along = direction(&side.samples).unwrap_or_default();
        let places = match side.curve {
            Curve::Line(_) => places(&side.samples, &along),
            Curve::Circle(_) => places_on_arc(&side.samples),
        };
        let (robust, plain, largest_weight, strays) = moment_sums(&places, residuals, scale);
        Self {
            along,
            places,
            robust: Moments::of(&robust),
            plain: Moments::of(&plain),
            strays,
            largest_weight,
        }
    }
}

/// The sums with the weights of the robust loss and with the samples' own, the largest weight, and
/// the stray samples.
fn moment_sums(
    places: &[f64],
    residuals: &[Residual],
    scale: f64,
) -> (Sums, Sums, f64, Vec<usize>) {
    let (mut robust, mut plain) = (Sums::new(), Sums::new());
    let (mut largest_weight, mut strays) = (f64::MIN_POSITIVE, Vec::new());
    for first in (0..places.len()).step_by(LANES) {
        let (places, remaining) = (&places[first..], &residuals[first..]);
        let mut lane_places = [0.0; LANES];
        let [mut weights, mut values, mut plain_weights, mut plain_values] = [[0.0; LANES]; 4];
        for (i, (place, residual)) in places.iter().zip(remaining).take(LANES).enumerate() {
            lane_places[i] = *place;
            let to_noise = residual.weight / scale;
            largest_weight = largest_weight.max(to_noise);
            let value = residual.distance * to_noise;
            let (_, weight) = Loss::Tukey.cost_and_weight(value);
            if weight == 0.0 && is_stray(residuals, first + i, scale) {
                strays.push(first + i);
                continue;
            }
            let square = to_noise * to_noise;
            weights[i] = weight * square;
            values[i] = weights[i] * residual.distance;
            plain_weights[i] = square;
            plain_values[i] = to_noise * value.clamp(-MAX_RESIDUAL, MAX_RESIDUAL);
        }
        let terms = polynomials(&lane_places);
        robust.add(&terms, &weights, &values);
        plain.add(&terms, &plain_weights, &plain_values);
    }
    (robust, plain, largest_weight, strays)
}

/// Whether the robust loss would give a sample no weight relative to its neighbours' median,
/// either.
fn is_stray(residuals: &[Residual], index: usize, scale: f64) -> bool {
    let Some(last) = residuals.len().checked_sub(NEIGHBOURS) else {
        return false;
    };
    let first = index.saturating_sub(NEIGHBOURS / 2).min(last);
    let to_noise = |residual: &Residual| residual.distance * residual.weight / scale;
    let mut neighbours: [f64; NEIGHBOURS] = array::from_fn(|k| to_noise(&residuals[first + k]));
    neighbours.sort_unstable_by(f64::total_cmp);
    let departure = to_noise(&residuals[index]) - neighbours[NEIGHBOURS / 2];
    Loss::Tukey.cost_and_weight(departure).1 == 0.0
}
