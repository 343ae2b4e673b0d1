//! The spread between groups of planes, relative to that expected from the covariance.
//!
//! At the optimum, group `g` of the planes has the gradient `g_g` of the shared parameters, with
//! its own eliminated; with `S` the information of all, `u_g = S^-1 g_g` is the influence of the
//! group on the result (a delete-one-group jackknife to first order: J. A. Reeds, Ann. Statist. 6
//! (1978) 727-739). With `V_g` the group's stated part of the covariance `V` and `A_g = S^-1 S_g`,
//! the fit leaves of it `E_g = V_g - A_g V_g - V_g A_g^T + A_g V A_g^T`. The sum of
//! `u_g^T V^-1 u_g` over that of `tr(V^-1 E_g)` is the ratio of the groups' scatter to the stated
//! covariance: a single number, which ten groups determine well, while they would determine little
//! of a whole matrix.

use nalgebra::{DMatrix, DVector};

use crate::numeric::{ArrowSystem, chi_square_tail};
use crate::observations::ObservedPlane;

/// Minimum number of groups to estimate a spread: with fewer, each has half of the weight in some
/// parameter.
const MIN_GROUPS: usize = 5;

/// Probability of such a scatter by chance below which the covariance is raised: it is seldom
/// raised without cause.
const CHANCE: f64 = 0.01;

/// Number of groups from which they determine the spread better than the residuals do.
const ENOUGH_GROUPS: usize = 10;

/// Scatter of groups of planes.
pub(crate) struct GroupSpread {
    /// Ratio of their variance to that expected from the covariance; 1 where the excess may be
    /// chance.
    pub variance_ratio: f64,
    /// Whether there are enough groups that no other estimate of their scatter is needed.
    pub is_enough: bool,
}

/// Returns the scatter of groups of planes relative to that expected from a covariance; `None` if
/// they are too few.
///
/// `parts` are the planes' parts of the total covariance.
pub(crate) fn spread_of_planes(
    planes: &[ObservedPlane],
    system: &ArrowSystem,
    parts: &[DMatrix<f64>],
    total: &DMatrix<f64>,
) -> Option<GroupSpread> {
    let groups = groups_of(planes);
    if groups.len() < MIN_GROUPS || total.is_empty() {
        return None;
    }
    let contributions = system.contributions()?;
    let inverse = system.reduced_information()?.cholesky()?.inverse();
    let stated = total.clone().cholesky()?;
    // The optimum is only reached to the iteration's tolerance.
    let gradients = contributions.iter().map(|part| &part.gradient);
    let remaining_step = &inverse * (gradients.sum::<DVector<f64>>() + &system.prior_gradient);
    let (mut scatter, mut expected, mut square) = (0.0, 0.0, 0.0);
    for group in &groups {
        let size = total.nrows();
        let mut information = DMatrix::zeros(size, size);
        let (mut gradient, mut part) = (DVector::zeros(size), DMatrix::zeros(size, size));
        for plane in group {
            let contribution = &contributions[*plane];
            information += &contribution.information;
            gradient += &contribution.gradient - &contribution.information * &remaining_step;
            part += &parts[*plane];
        }
        let influence = &inverse * gradient;
        scatter += influence.dot(&stated.solve(&influence));
        let share = &inverse * information;
        let taken = &share * &part;
        let remains = part - &taken - taken.transpose() + &share * total * share.transpose();
        let relative = stated.solve(&remains);
        expected += relative.trace();
        square += (&relative * &relative).trace();
    }
    let freedom = expected * expected / square;
    let ratio = scatter / expected;
    let chance = chi_square_tail(ratio * freedom, freedom);
    ratio.is_finite().then_some(GroupSpread {
        variance_ratio: if chance < CHANCE { ratio } else { 1.0 },
        is_enough: groups.len() >= ENOUGH_GROUPS,
    })
}

/// Returns the planes in groups that share their errors: those of one picture, or, if there is only
/// one, each plane.
fn groups_of(planes: &[ObservedPlane]) -> Vec<Vec<usize>> {
    let counted = (0..planes.len()).filter(|p| !planes[*p].is_outlier());
    let mut pictures = std::collections::BTreeMap::<usize, Vec<usize>>::new();
    for plane in counted {
        pictures.entry(planes[plane].image).or_default().push(plane);
    }
    match pictures.len() {
        1 => pictures
            .into_values()
            .flatten()
            .map(|plane| vec![plane])
            .collect(),
        _ => pictures.into_values().collect(),
    }
}
