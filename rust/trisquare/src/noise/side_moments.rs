//! One pass over a side's residuals: the sums that its smooth displacement follows from.

use nalgebra::{SMatrix, Vector2};

use super::side_basis::{Basis, ORDERS, basis, direction, places, places_on_arc};
use crate::numeric::Loss;
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

impl Moments {
    const ZERO: Self = Self {
        gram: Gram::from_array_storage(nalgebra::ArrayStorage([[0.0; ORDERS]; ORDERS])),
        gradient: Basis::from_array_storage(nalgebra::ArrayStorage([[0.0; ORDERS]])),
    };

    fn add(&mut self, row: &Basis, weight: f64, distance: f64) {
        self.gram.ger(weight, row, row, 1.0);
        self.gradient.axpy(weight * distance, row, 1.0);
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
        let (mut robust, mut plain) = (Moments::ZERO, Moments::ZERO);
        let mut strongest = f64::MIN_POSITIVE;
        for (row, residual) in rows.iter().zip(residuals) {
            let to_noise = residual.weight / scale;
            strongest = strongest.max(to_noise);
            let value = residual.distance * to_noise;
            let (_, weight) = Loss::Tukey.cost_and_weight(value);
            let square = to_noise * to_noise;
            robust.add(row, weight * square, residual.distance);
            let near = value.clamp(-FARTHEST, FARTHEST) / to_noise;
            plain.add(row, square, near);
        }
        Self {
            along,
            places,
            rows,
            robust,
            plain,
            strongest,
        }
    }
}
