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
    pub own_misfits: Vec<f64>,
}

impl<L: Lens> JointFit<L> {
    /// Whether its sides are in place and straight, up to the noise and to the curvature `bent`
    /// that no lens removes.
    pub fn agrees(&self, bent: f64) -> bool {
        let within = |sum: f64, freedom: f64| {
            let limit = AGREED.max(1.0 + CHANCE * (2.0 / freedom).sqrt());
            sum / freedom < limit * bent
        };
        let misfit = &self.misfit;
        within(misfit.straight, misfit.straight_freedom)
            && within(misfit.curved, misfit.curved_freedom)
    }

    /// Whether its residuals are the noise of its sides: a divergent fit leaves so much that no
    /// plane sticks out.
    pub fn is_settled(&self) -> bool {
        let misfit = &self.misfit;
        self.refined.is_exact() || misfit.curved > MIN_CURVED * misfit.curved_freedom
    }

    /// Typical misfit of a member, at least 1: it exceeds that of noise alone if paper is not flat.
    pub fn ordinary_misfit(&self) -> f64 {
        let median = upper_median(self.own_misfits.clone());
        median.map_or(1.0, |median| (median / MEDIAN_OF_CHANCE).max(1.0))
    }

    /// The number of members, in which further ones that stand alike have a low weight.
    pub fn standing_apart(&self) -> f64 {
        let mut counted: Vec<[Vector3<f64>; 2]> = Vec::new();
        let mut number = 0.0;
        for state in &self.refined.view.planes {
            let axes = [0, 1].map(|i| state.pose.rotation.column(i).into_owned());
            let known = counted.iter().any(|other| alike(other, &axes));
            number += if known { ALIKE_SHARE } else { 1.0 };
            counted.push(axes);
        }
        number
    }

    /// Misfit added by further planes, per degree of freedom.
    pub fn strain(&self, more: &Self) -> f64 {
        let (before, after) = (&self.misfit, &more.misfit);
        let freedom = (after.straight_freedom - before.straight_freedom).max(1.0);
        (after.straight - before.straight) / freedom
    }

    /// Root mean square distance of every member's samples from its lines, px, with the member's
    /// index.
    pub fn distances(&self) -> Vec<(f64, usize)> {
        let own = self.refined.residuals.iter();
        let distances = own.map(|own| root_mean_square(own.iter()));
        distances.zip(self.members.iter().copied()).collect()
    }
}
