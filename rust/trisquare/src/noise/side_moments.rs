//! One pass over a side's residuals: the sums that its smooth displacement follows from.

use nalgebra::{SMatrix, Vector2};

use super::side_basis::{Basis, ORDERS, basis, direction, places, places_on_arc};
use crate::numeric::{Loss, add_rank_one, symmetric};
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
    /// The basis at each sample.
    pub rows: Vec<Basis>,
    /// With the weights of the robust loss.
    pub robust: Moments,
    /// With the samples' own weights.
    pub plain: Moments,
    /// Weight of the best sample.
    pub strongest: f64,
}

/// Sums of outer products of the basis and a residual, by their lower triangle.
type Sums = [[f64; ORDERS + 1]; ORDERS + 1];

impl Moments {
    fn of(sums: &Sums) -> Self {
        Self {
            gram: Gram::from_fn(|i, j| symmetric(sums, i, j)),
            gradient: Basis::from_fn(|i, _| sums[ORDERS][i]),
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
        let rows: Vec<Basis> = places.iter().map(|s| basis(*s)).collect();
        let (mut robust, mut plain): (Sums, Sums) = Default::default();
        let mut strongest = f64::MIN_POSITIVE;
        for (row, residual) in rows.iter().zip(residuals) {
            let to_noise = residual.weight / scale;
            strongest = strongest.max(to_noise);
            let value = residual.distance * to_noise;
            let (_, weight) = Loss::Tukey.cost_and_weight(value);
            let square = to_noise * to_noise;
            let mut with_residual = [residual.distance; ORDERS + 1];
            with_residual[..ORDERS].copy_from_slice(row.as_slice());
            add_rank_one(&mut robust, &with_residual, weight * square);
            with_residual[ORDERS] = value.clamp(-FARTHEST, FARTHEST) / to_noise;
            add_rank_one(&mut plain, &with_residual, square);
        }
        Self {
            along,
            places,
            rows,
            robust: Moments::of(&robust),
            plain: Moments::of(&plain),
            strongest,
        }
    }
}
