//! Test whether one plane disagrees with the rest, by leaving out each in turn.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::numeric::{ArrowSystem, normal_deviate};
use crate::observations::FreeParameters;
use crate::result::Disagreement;

/// Maximum number of sweeps of the symmetric eigenvalue iteration; a few per column suffice.
const MAX_SWEEPS: usize = 1000;

/// Eigenvalue, as a fraction of the largest, below which a plane does not determine its direction.
const RANK_TOLERANCE: f64 = 1e-6;

/// Normal deviate above which a disagreement is not chance: one in thirty thousand.
const DISAGREEMENT: f64 = 4.0;

/// Change of a focal length or principal point when a plane is left out, as a fraction of the focal
/// length, below which it is of no consequence, however significant.
const CONSEQUENCE: f64 = 0.002;

/// Returns the plane that disagrees most with the rest, if any does beyond chance, and the change
/// of the free parameters without it.
///
/// At the optimum, plane `p` has the reduced gradient `g_p`, whose covariance is
/// `S_p - S_p S^-1 S_p` with `S_p` its information and `S` that of all planes; leaving it out moves
/// the parameters by `(S - S_p)^-1 g_p` in one Gauss-Newton step. `factor` turns the inverse of the
/// weighted information into a covariance.
pub(crate) fn disagreement(
    system: &ArrowSystem,
    free: &FreeParameters,
    focal: f64,
    factor: f64,
) -> Option<(Disagreement, DVector<f64>)> {
    let contributions = system.contributions()?;
    if contributions.len() < 3 || free.len() == 0 {
        return None;
    }
    let total = system.reduced_information()?;
    let inverse = total.clone().cholesky()?.inverse();
    // The optimum is only reached to the iteration's tolerance: the remaining total gradient does
    // not belong to any plane.
    let remaining_step = contributions
        .iter()
        .map(|part| &part.gradient)
        .sum::<DVector<f64>>();
    let remaining_step = &inverse * (remaining_step + &system.prior_gradient);
    let mut worst: Option<(Disagreement, DVector<f64>)> = None;
    for (plane, part) in contributions.iter().enumerate() {
        let information = &part.information;
        let gradient = &part.gradient - information * &remaining_step;
        let spread = information - information * &inverse * information;
        let Some((square, rank)) = mahalanobis(&spread, &gradient) else {
            continue;
        };
        let sigmas = normal_deviate(square / factor, rank as f64);
        let rest = &total - information;
        let Some(rest) = rest.cholesky() else {
            continue;
        };
        let change = rest.solve(&gradient);
        let largest_change = ["fx", "fy", "cx", "cy"]
            .iter()
            .filter_map(|name| free.position(name))
            .map(|i| (change[i] / focal).abs())
            .fold(0.0f64, f64::max);
        if sigmas > DISAGREEMENT
            && largest_change > CONSEQUENCE
            && worst.as_ref().is_none_or(|(w, _)| sigmas > w.sigmas)
        {
            let found = Disagreement {
                plane,
                focal_change: free.position("fx").map_or(0.0, |i| change[i] / focal),
                sigmas,
            };
            worst = Some((found, change));
        }
    }
    worst
}

/// `g^T A^+ g` and the rank of `A`.
fn mahalanobis(a: &DMatrix<f64>, g: &DVector<f64>) -> Option<(f64, usize)> {
    if a.is_empty() {
        return None;
    }
    // Scaled so that parameters of very different units are comparable.
    let scale = a
        .diagonal()
        .map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaling = DMatrix::from_diagonal(&scale);
    let eigen = SymmetricEigen::try_new(&scaling * a * &scaling, f64::EPSILON, MAX_SWEEPS)?;
    let g = eigen.eigenvectors.tr_mul(&(scaling * g));
    let limit = RANK_TOLERANCE * eigen.eigenvalues.amax();
    let (mut square, mut rank) = (0.0, 0);
    for (value, g) in eigen.eigenvalues.iter().zip(g.iter()) {
        if *value > limit {
            square += g * g / value;
            rank += 1;
        }
    }
    (rank > 0).then_some((square, rank))
}
