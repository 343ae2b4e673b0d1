//! The evidence for nested models, from a fit of the richest.
//!
//! By the density ratio of J. M. Dickey (Ann. Math. Statist. 42 (1971) 204-223; I. Verdinelli & L.
//! Wasserman, J. Am. Statist. Assoc. 90 (1995) 614-618): with `e` the coefficients that a model
//! omits, `p(data | model) / p(data | richest) = p(e = 0 | data) / p(e = 0)`. The posterior is
//! approximated as normal, with the calibration's covariance: that includes errors shared by whole
//! sides, so that a bent sheet of paper is no evidence for coefficients. (Information criteria
//! count all samples as independent.)

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::lens::{DistortionModel, INTRINSICS, Lens};
use crate::result::Calibration;

/// A model, its fit to the edge samples, and the logarithm of its evidence up to a constant.
#[derive(Clone)]
pub(crate) struct WeighedModel<L: Lens> {
    pub model: L::Model,
    pub fit: Calibration<L>,
    pub log_evidence: f64,
}

/// Logarithm of the evidence for every model up to the fitted one, in the order of
/// [`DistortionModel::NESTED`], against the fitted one.
///
/// In units of the prior's standard deviations, with estimate `d` and covariance `C`, the posterior
/// has the mean `(I + C E)^-1 d` and the covariance `(I + C E)^-1 C`, with `E` the prior's
/// information less that of the prior used in the fit (`held`: column and standard deviation).
pub(super) fn log_evidence<L: Lens>(
    model: L::Model,
    fit: &Calibration<L>,
    held: &[(usize, f64)],
) -> Option<Vec<f64>> {
    let coefficients: Vec<usize> = model.columns().iter().collect();
    let count = coefficients.len();
    if count == 0 {
        return Some(vec![0.0]); // nothing to omit, and the LU factors of an empty matrix overflow
    }
    let places: Vec<usize> = coefficients
        .iter()
        .map(|column| fit.position(L::parameter_names()[*column]))
        .collect::<Option<_>>()?;
    let priors = fit.camera.coefficient_priors(fit.image_size);
    let unit: Vec<f64> = coefficients
        .iter()
        .map(|column| priors[column - INTRINSICS])
        .collect();
    let values = fit.camera.parameters();
    let estimate = DVector::from_fn(count, |i, _| values[coefficients[i]] / unit[i]);
    let covariance = DMatrix::from_fn(count, count, |i, j| {
        fit.covariance[(places[i], places[j])] / (unit[i] * unit[j])
    });
    let added_information = DVector::from_fn(count, |i, _| {
        let held_prior = held.iter().find(|(column, _)| *column == coefficients[i]);
        1.0 - held_prior.map_or(0.0, |(_, std)| (unit[i] / std).powi(2))
    });
    let total =
        &covariance * DMatrix::from_diagonal(&added_information) + DMatrix::identity(count, count);
    let total = total.lu();
    let mean = total.solve(&estimate)?;
    let posterior = total.solve(&covariance)?;
    let posterior = (&posterior + posterior.transpose()) * 0.5;
    let richest = L::Model::NESTED.iter().position(|other| *other == model)?;
    let model_evidence = |simpler: &L::Model| {
        let kept = simpler.columns();
        let omitted: Vec<usize> = (0..count)
            .filter(|i| !kept.contains(coefficients[*i]))
            .collect();
        let omitted_covariance = posterior.select_rows(&omitted).select_columns(&omitted);
        let factor = Cholesky::new(omitted_covariance)?;
        let omitted_mean = mean.select_rows(&omitted);
        let square = omitted_mean.dot(&factor.solve(&omitted_mean));
        let evidence = -0.5 * (square + factor.ln_determinant());
        evidence.is_finite().then_some(evidence)
    };
    L::Model::NESTED[..=richest]
        .iter()
        .map(model_evidence)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::{Comparison, calibrate_unjudged};
    use crate::lens::BrownModel;
    use crate::observations::Options;
    use crate::synthetic::{Scene, SceneOptions};

    #[test]
    fn evidence_is_the_ratio_of_marginal_likelihoods() {
        // One coefficient: y ~ N(k, s^2) with prior N(0, t^2) against k = 0, in closed form.
        let options = SceneOptions {
            distortion: false,
            ..SceneOptions::default()
        };
        let mut scene = Scene::random(4, options);
        let mut parameters = scene.camera.parameters();
        parameters[INTRINSICS] = -0.01;
        scene.camera = scene.camera.with_parameters(&parameters);
        let options = Options {
            model: BrownModel::Radial1,
            ..Options::default()
        };
        let fit = calibrate_unjudged(
            &scene.edges(3, 0.3, 6.0),
            scene.size,
            &options,
            &mut Comparison::default(),
        )
        .unwrap();
        let (y, s) = (fit.camera.distortion()[0], fit.std()[4].1);
        let t = fit.camera.coefficient_priors(fit.image_size)[0];
        let normal = |variance: f64| -0.5 * (y * y / variance + variance.ln());
        let expected = normal(s * s) - normal(s * s + t * t);
        let found = log_evidence(BrownModel::Radial1, &fit, &[]).unwrap();
        assert!(
            (found[0] - found[1] - expected).abs() < 1e-9,
            "{found:?} {expected}"
        );
    }
}
