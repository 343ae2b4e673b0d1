//! Contribution of the doubt about the model to the covariance of the chosen one.
//!
//! A coefficient that is not significantly different from zero may still not be zero. The results
//! of the other models are therefore included in the covariance of the chosen one, weighted by
//! their probabilities, with all models equally likely a priori (J. A. Hoeting et al., Statistical
//! Science 14 (1999) 382-417). The coefficients that the chosen model omits are assumed to be small
//! rather than zero.

use nalgebra::{Cholesky, DMatrix, SymmetricEigen};

use super::evidence::WeighedModel;
use crate::lens::{DistortionModel, INTRINSICS, Lens, MAX_LENS_COLUMNS};
use crate::observations::FreeParameters;
use crate::result::Calibration;

/// Prior standard deviation of an omitted coefficient, as a fraction of its usual spread over
/// lenses.
const SMALL: f64 = 0.03;

/// Maximum number of iterations of an eigenvalue problem of a handful of rows; it takes a few per
/// row.
const MAX_EIGEN_ITERATIONS: usize = 100 * MAX_LENS_COLUMNS;

/// Contribution of the doubt about the model to the covariance of the chosen one, over its free
/// parameters.
///
/// With `w` a model's probability, `d` its difference from the chosen one in the latter's free
/// parameters and `C` the covariances: `sum w (C_model - C_chosen + d d^T)`. Of the covariance
/// differences only the part that increases the covariance is used, and none of simpler models,
/// whose certainty follows from their assumption. The effect of omitted coefficients, with a prior
/// of [`SMALL`], is added regardless of the probabilities.
pub(super) fn doubt<L: Lens>(
    models: &[WeighedModel<L>],
    chosen: usize,
    free: &FreeParameters,
) -> Option<DMatrix<f64>> {
    let reference = &models[chosen];
    let weight = |c: &WeighedModel<L>| (c.log_evidence - reference.log_evidence).exp();
    let total: f64 = models.iter().map(weight).sum();
    let mut doubt = DMatrix::zeros(free.len(), free.len());
    if free.len() == 0 {
        return Some(doubt); // everything else is held, and the simplest model was chosen
    }
    for (i, other) in models.iter().enumerate() {
        if i == chosen {
            continue;
        }
        let difference = free.difference(&other.fit.camera, &reference.fit.camera);
        let mut contribution = &difference * difference.transpose();
        if i > chosen {
            let restricted = restricted(&other.fit.covariance, &other.fit, &reference.fit)?;
            contribution += covariance_increase(restricted, &reference.fit.covariance)?;
        }
        doubt += contribution * (weight(other) / total);
    }
    if let Some(richest) = models.last().filter(|_| chosen + 1 < models.len()) {
        let restricted = with_small_coefficients(reference, richest)?;
        doubt += covariance_increase(restricted, &reference.fit.covariance)?;
    }
    doubt.iter().all(|v| v.is_finite()).then_some(doubt)
}

/// The covariance of a richer fit, in the free parameters of `simpler`, with a prior of mean zero
/// and standard deviation [`SMALL`] on the coefficients that `simpler` omits.
fn with_small_coefficients<L: Lens>(
    simpler: &WeighedModel<L>,
    richer: &WeighedModel<L>,
) -> Option<DMatrix<f64>> {
    let fit = &richer.fit;
    let priors = fit.camera.coefficient_priors(fit.image_size);
    let kept = simpler.model.columns();
    let omitted: Vec<usize> = (richer.model.columns().iter())
        .filter(|column| !kept.contains(*column))
        .collect();
    let place = |column: &usize| fit.position(L::parameter_names()[*column]);
    let places: Vec<usize> = omitted.iter().map(place).collect::<Option<_>>()?;
    let cross = fit.covariance.select_columns(&places);
    let mut omitted_covariance = cross.select_rows(&places);
    for (i, column) in omitted.iter().enumerate() {
        omitted_covariance[(i, i)] += (SMALL * priors[column - INTRINSICS]).powi(2);
    }
    let conditional =
        &fit.covariance - &cross * Cholesky::new(omitted_covariance)?.solve(&cross.transpose());
    restricted(&conditional, fit, &simpler.fit)
}

/// A covariance of a richer fit's free parameters, restricted to those of `reference`.
fn restricted<L: Lens>(
    covariance: &DMatrix<f64>,
    richer: &Calibration<L>,
    reference: &Calibration<L>,
) -> Option<DMatrix<f64>> {
    let names = reference.parameters.iter();
    let places: Option<Vec<usize>> = names.map(|name| richer.position(name)).collect();
    let places = places?;
    Some(covariance.select_rows(&places).select_columns(&places))
}

/// The increase from one covariance to another: their difference without its negative eigenvalues,
/// in units of the first one's standard deviations.
pub(super) fn covariance_increase(to: DMatrix<f64>, from: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = to.nrows();
    let unit = from.diagonal().map(|d| d.sqrt().max(f64::MIN_POSITIVE));
    let difference = to - from;
    let scaled = DMatrix::from_fn(size, size, |i, j| difference[(i, j)] / (unit[i] * unit[j]));
    let eigen = SymmetricEigen::try_new(scaled, f64::EPSILON, MAX_EIGEN_ITERATIONS)?;
    let values = eigen.eigenvalues.map(|v| v.max(0.0));
    let vectors = &eigen.eigenvectors;
    let increase = vectors * DMatrix::from_diagonal(&values) * vectors.transpose();
    Some(DMatrix::from_fn(size, size, |i, j| {
        0.5 * (increase[(i, j)] + increase[(j, i)]) * unit[i] * unit[j]
    }))
}
