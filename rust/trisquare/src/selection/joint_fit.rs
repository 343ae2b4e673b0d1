//! Joint fit of some of the candidates, and whether they agree.

use nalgebra::Vector3;

use super::hypothesis::{ALIKE_SHARE, alike};
use super::squareness::Pinhole;
use crate::lens::Lens;
use crate::noise::Misfit;
use crate::numeric::upper_median;
use crate::refine::{Refined, root_mean_square};

/// Threshold on the displacements and on the curvature of a joint fit's sides, in units of the
/// curvature's variance that no lens removes: paper that is not flat causes both.
const AGREED: f64 = 2.0;

/// Minimum mean square curvature, in units of the noise: it is 1 for straight sides, and lower
/// where the assumed noise is not noise.
const MIN_CURVED: f64 = 0.25;

/// Number of standard deviations of chance allowed above the expectation.
const CHANCE: f64 = 4.0;

/// Median of the misfit by chance of one square, whose sides have two degrees of freedom in
/// position.
const MEDIAN_OF_CHANCE: f64 = std::f64::consts::LN_2;

/// The joint fit of some planes.
pub(crate) struct JointFit<L> {
    /// Their indices, ascending.
    pub members: Vec<usize>,
    pub camera: Pinhole,
    pub refined: Refined<L>,
    pub misfit: Misfit,
    /// Displacement of every member's sides, per degree of freedom and in units of the noise.
    pub member_misfits: Vec<f64>,
}

impl<L: Lens> JointFit<L> {
    /// Whether its sides are in place and straight, up to the noise and to the mean
    /// square `curvature` that no lens removes.
    pub fn agrees(&self, curvature: f64) -> bool {
        let is_within = |sum: f64, freedom: f64| {
            let limit = AGREED.max(1.0 + CHANCE * (2.0 / freedom).sqrt());
            sum / freedom < limit * curvature
        };
        let misfit = &self.misfit;
        is_within(misfit.straight, misfit.straight_freedom)
            && is_within(misfit.curved, misfit.curved_freedom)
    }

    /// Whether its residuals are the noise of its sides: a divergent fit leaves so much that no
    /// plane sticks out.
    pub fn is_converged(&self) -> bool {
        let misfit = &self.misfit;
        self.refined.is_exact() || misfit.curved > MIN_CURVED * misfit.curved_freedom
    }

    /// Typical misfit of a member, at least 1: it exceeds that of noise alone if paper is not flat.
    pub fn typical_misfit(&self) -> f64 {
        let median = upper_median(self.member_misfits.clone());
        median.map_or(1.0, |median| (median / MEDIAN_OF_CHANCE).max(1.0))
    }

    /// The number of members, in which further ones that stand alike have a low weight.
    pub fn effective_count(&self) -> f64 {
        let mut counted: Vec<[Vector3<f64>; 2]> = Vec::new();
        let mut count = 0.0;
        for state in &self.refined.view.planes {
            let axes = [0, 1].map(|i| state.pose.rotation.column(i).into_owned());
            let is_known = counted.iter().any(|other| alike(other, &axes));
            count += if is_known { ALIKE_SHARE } else { 1.0 };
            counted.push(axes);
        }
        count
    }

    /// Misfit added by further planes, per degree of freedom.
    pub fn added_misfit(&self, more: &Self) -> f64 {
        let (before, after) = (&self.misfit, &more.misfit);
        let freedom = (after.straight_freedom - before.straight_freedom).max(1.0);
        (after.straight - before.straight) / freedom
    }

    /// Root mean square distance of every member's samples from its lines, px, with the member's
    /// index.
    pub fn distances(&self) -> Vec<(f64, usize)> {
        let residuals = self.refined.residuals.iter();
        let distances = residuals.map(|member| root_mean_square(member.iter()));
        distances.zip(self.members.iter().copied()).collect()
    }
}
