//! The joint fit of some of the candidates, and whether they agree.

use nalgebra::Vector3;

use super::hypothesis::{ALIKE_SHARE, alike};
use super::squareness::Pinhole;
use crate::lens::Lens;
use crate::noise::Misfit;
use crate::numeric::upper_median;
use crate::refine::{Refined, root_mean_square};

/// A joint fit agrees if its sides are in the wrong place, and bent, by less than so many times the
/// variance of the curvature that no lens takes out: paper that is not flat does both.
const AGREED: f64 = 2.0;

/// Mean square curvature of straight sides, in units of their noise, is 1; less than this it is where
/// the noise is no noise.
const MIN_CURVED: f64 = 0.25;

/// Standard deviations of chance that are allowed beyond what is expected.
const CHANCE: f64 = 4.0;

/// Median of what chance makes of one square, whose sides have two degrees of freedom in place.
const MEDIAN_OF_CHANCE: f64 = std::f64::consts::LN_2;

/// The joint fit of some planes.
pub(crate) struct JointFit<L> {
    /// Their indices, ascending.
    pub members: Vec<usize>,
    pub camera: Pinhole,
    pub refined: Refined<L>,
    pub misfit: Misfit,
    /// By how much every member puts its sides in the wrong place, per degree of freedom and in
    /// units of the noise.
    pub own_misfits: Vec<f64>,
}

impl<L: Lens> JointFit<L> {
    /// Whether its sides lie where they should, and are straight, but for the noise and for what
    /// bends them anyway.
    pub fn agrees(&self, bent: f64) -> bool {
        let within = |sum: f64, freedom: f64| {
            let limit = AGREED.max(1.0 + CHANCE * (2.0 / freedom).sqrt());
            sum / freedom < limit * bent
        };
        let misfit = &self.misfit;
        within(misfit.straight, misfit.straight_freedom)
            && within(misfit.curved, misfit.curved_freedom)
    }

    /// Whether its residuals are its sides' noise: a fit that has run away leaves so much that nothing
    /// stands out.
    pub fn is_settled(&self) -> bool {
        let misfit = &self.misfit;
        self.refined.is_exact() || misfit.curved > MIN_CURVED * misfit.curved_freedom
    }

    /// By how much an ordinary member puts its sides in the wrong place: more than noise alone, at
    /// least 1, where paper is not flat.
    pub fn ordinary_misfit(&self) -> f64 {
        let median = upper_median(self.own_misfits.clone());
        median.map_or(1.0, |median| (median / MEDIAN_OF_CHANCE).max(1.0))
    }

    /// The number of members, of which those that stand alike count as little more than one.
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

    /// By how much further planes put sides in the wrong place, per degree of freedom.
    pub fn strain(&self, more: &Self) -> f64 {
        let (before, after) = (&self.misfit, &more.misfit);
        let freedom = (after.straight_freedom - before.straight_freedom).max(1.0);
        (after.straight - before.straight) / freedom
    }

    /// How far the samples of every member are from its lines, root mean square, px.
    pub fn distances(&self) -> Vec<(f64, usize)> {
        let own = self.refined.residuals.iter();
        let distances = own.map(|own| root_mean_square(own.iter()));
        distances.zip(self.members.iter().copied()).collect()
    }
}
