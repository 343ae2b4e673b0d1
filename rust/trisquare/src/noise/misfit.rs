//! Misfit of sides beyond the noise: displacement of straight lines, and curvature.

use super::local::Noise;
use super::side_basis::ORDERS;
use super::side_moments::{Moments, SideMoments};
use crate::lens::MATRIX;
use crate::observations::{FreeParameters, ObservedPlane, View};

/// Threshold on the ratio of the variance of sides' displacements to that of their curvature: by
/// chance it is exceeded once in two thousand times, with two degrees of freedom.
const CONTRADICTION: f64 = 9.0;

/// Number of orders of a displacement that leave a side straight.
const STRAIGHT: usize = 2;

/// Sums of squared smooth displacements, in units of their value under independent noise.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Misfit {
    pub straight: f64,
    pub curved: f64,
    pub straight_freedom: f64,
    pub curved_freedom: f64,
    /// Contribution of the known errors of sides to `straight`, per degree of freedom.
    pub expected: f64,
    /// Sum of the squared displacements in `straight`, px^2, ...
    pub squared_displacements: f64,
    /// ... and the number of sides.
    pub sides: f64,
}

impl Misfit {
    /// Misfit of exact samples.
    pub const NONE: Self = Self {
        straight: 0.0,
        curved: 0.0,
        straight_freedom: 1.0,
        curved_freedom: 1.0,
        expected: 0.0,
        squared_displacements: 0.0,
        sides: 0.0,
    };

    /// Misfit of one side, in units of the noise.
    pub fn of_side(noise: &Noise, plane: usize, side: usize) -> Self {
        Self::of_moments(&noise.sides[plane][side], noise)
    }

    /// Misfit of a side from the moments of its residuals, in units of the noise.
    pub fn of_moments(moments: &SideMoments, noise: &Noise) -> Self {
        let Moments { gram, gradient } = &moments.plain;
        let power = |orders: usize| {
            let factor = gram.view((0, 0), (orders, orders)).into_owned().cholesky();
            let leading_gradient = gradient.rows(0, orders).into_owned();
            factor.map_or(0.0, |factor| {
                leading_gradient.dot(&factor.solve(&leading_gradient))
            })
        };
        let orders = ORDERS.min(moments.places.len());
        let to_noise = (noise.moment_scale / noise.scale).powi(2);
        let straight_power = power(STRAIGHT.min(orders));
        let straight = straight_power * to_noise;
        Self {
            straight,
            curved: (power(orders) * to_noise - straight).max(0.0),
            straight_freedom: STRAIGHT.min(orders) as f64,
            curved_freedom: orders.saturating_sub(STRAIGHT) as f64,
            expected: 0.0,
            squared_displacements: straight_power / gram[(0, 0)].max(f64::MIN_POSITIVE),
            sides: 1.0,
        }
    }

    /// Misfit of all sides of one plane, in units of the noise.
    pub fn of_plane(noise: &Noise, plane: usize) -> Self {
        let mut all = Self::default();
        for side in 0..noise.sides[plane].len() {
            all.add(&Self::of_side(noise, plane, side));
        }
        all
    }

    /// Misfit of all sides used at an optimum, with the degrees of freedom of the parameters
    /// subtracted.
    pub fn of<L>(
        planes: &[ObservedPlane],
        view: &View<L>,
        free: &FreeParameters,
        noise: &Noise,
    ) -> Self {
        let mut all = Self::default();
        let mut straight_count = 0.0;
        for (p, (plane, state)) in planes.iter().zip(&view.planes).enumerate() {
            if plane.is_outlier() {
                continue;
            }
            for (s, side) in plane.sides().enumerate() {
                if !side.is_outlier {
                    all.add(&Self::of_side(noise, p, s));
                    let information = noise.sides[p][s].plain.gram[(0, 0)];
                    let to_noise = (noise.moment_scale / noise.scale).powi(2);
                    all.expected += plane.side_error.powi(2) * information * to_noise;
                }
            }
            straight_count +=
                STRAIGHT as f64 * plane.sides().filter(|side| !side.is_outlier).count() as f64;
            all.straight_freedom -= state.unknowns() as f64;
        }
        // The parameters absorb the same fraction of these errors as of any others.
        all.expected /= straight_count.max(1.0);
        // The camera matrix displaces lines; the other parameters of the camera curve them.
        let matrix_parameters = MATRIX.iter().filter(|name| free.position(name).is_some());
        let matrix_parameters = matrix_parameters.count() as f64;
        all.straight_freedom = (all.straight_freedom - matrix_parameters).max(1.0);
        all.curved_freedom =
            (all.curved_freedom - (free.len() as f64 - matrix_parameters)).max(1.0);
        all
    }

    fn add(&mut self, other: &Self) {
        self.straight += other.straight;
        self.curved += other.curved;
        self.straight_freedom += other.straight_freedom;
        self.curved_freedom += other.curved_freedom;
        self.squared_displacements += other.squared_displacements;
        self.sides += other.sides;
    }

    /// Root mean square distance, px, of the sides from their lines at the optimum.
    pub fn displacement(&self) -> f64 {
        (self.squared_displacements / self.sides.max(1.0)).sqrt()
    }

    pub fn total(&self) -> f64 {
        self.straight + self.curved
    }

    pub fn freedom(&self) -> f64 {
        self.straight_freedom + self.curved_freedom
    }

    /// Mean square over all degrees of freedom: 1 under independent noise.
    pub fn mean(&self) -> f64 {
        self.total() / self.freedom()
    }

    /// Ratio of the variance of the sides' displacements to that of their curvature; 1 if it may be
    /// chance.
    pub fn between_plane_variance_ratio(&self) -> f64 {
        let curvature_variance = (self.curved / self.curved_freedom).max(1.0);
        let ratio = self.straight / self.straight_freedom / (curvature_variance + self.expected);
        if ratio > CONTRADICTION { ratio } else { 1.0 }
    }
}
