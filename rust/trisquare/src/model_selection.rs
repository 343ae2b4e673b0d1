//! Which distortion coefficients the data ask for.
//!
//! The models are nested: each is the next richer one with coefficients at zero. From the richest
//! that converges, fitted once, the evidence for all follows by the density ratio of J. M. Dickey
//! (Ann. Math. Statist. 42 (1971) 204-223; I. Verdinelli & L. Wasserman, J. Am. Statist. Assoc. 90
//! (1995) 614-618): with `e` the coefficients that a model leaves out,
//! `p(data | model) / p(data | richest) = p(e = 0 | data) / p(e = 0)`. The posterior is taken as
//! normal, with the covariance that the calibration states: where its residuals show that whole
//! sides err together, the covariance says so, and a bent sheet of paper does not buy coefficients.
//! (Information criteria count samples as if each were worth its own.)
//!
//! What could not be told from zero may still not be zero. The other models' answers therefore
//! stay in the covariance of the chosen one, by their probabilities, all models being equally
//! likely beforehand (J. A. Hoeting et al., Statistical Science 14 (1999) 382-417). What the chosen
//! model leaves out is taken to be small rather than nothing.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use crate::calibrate::{Comparison, calibrate_beside, calibrate_photographs, calibrate_unjudged};
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, DistortionModel, INTRINSICS, Lens, MAX_LENS_COLUMNS};
use crate::observations::{FreeParameters, Method, Options, PlaneEdges};
use crate::photometric::Photographs;
use crate::result::{Calibration, Warning};
use crate::solver::NestedOptima;
use crate::uncertainty::widen;

/// What a model's log evidence loses where its lens ends within the picture, which no camera's does:
/// evidence that is not worth a mention does not choose it.
const ENDS_IN_PICTURE: f64 = 1.0;

/// What a coefficient that was left out may be all the same, as a part of what lenses have.
const SMALL: f64 = 0.03;

/// Iterations of an eigenvalue problem of a handful of rows; it takes a few per row.
const MAX_EIGEN_ITERATIONS: usize = 100 * MAX_LENS_COLUMNS;

/// A model that was considered and not chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(bound(
        serialize = "L::Model: serde::Serialize",
        deserialize = "L::Model: serde::Deserialize<'de>"
    ))
)]
#[non_exhaustive]
pub struct ModelAlternative<L: Lens = DefaultLens> {
    /// The model.
    pub model: L::Model,
    /// Natural logarithm of its odds against the chosen one; not positive.
    pub log_evidence: f64,
    /// Root mean square distance of the edge samples with it, in pixels.
    pub rms: f64,
}

/// A calibration with the model that the data ask for.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(bound(
        serialize = "L::Model: serde::Serialize",
        deserialize = "L::Model: serde::Deserialize<'de>"
    ))
)]
#[non_exhaustive]
pub struct ModelChoice<L: Lens = DefaultLens> {
    /// The model chosen.
    pub model: L::Model,
    /// The calibration with it; its covariance holds the doubt about the model as well.
    pub calibration: Calibration<L>,
    /// The models that were rejected, the simplest first; models that did not converge are left
    /// out.
    pub alternatives: Vec<ModelAlternative<L>>,
}

/// Calibrates with the lens model that has the largest evidence.
///
/// The models are compared on edge samples; the photographs, if there are any, are fitted with the
/// chosen one. `options.model` is only used where no model converges.
///
/// ```
/// use trisquare::{Error, ImageSize, Options, PlaneEdges, calibrate_by_evidence};
///
/// fn tell(edges: &[PlaneEdges], size: ImageSize) -> Result<(), Error> {
///     let found = calibrate_by_evidence(edges, size, &Options::default(), None)?;
///     println!("{:?}, rms {:.3} px", found.model, found.calibration.rms);
///     for other in found.alternatives {
///         println!("not {:?}, at odds of {:.1e}", other.model, other.log_evidence.exp());
///     }
///     Ok(())
/// }
/// ```
///
/// # Errors
/// [`Error::InvalidArgument`] for the linear method or a fixed distortion, which leave nothing to
/// compare; otherwise as [`crate::calibrate`] with the chosen model.
pub fn calibrate_by_evidence<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    photographs: Option<&Photographs<'_>>,
) -> Result<ModelChoice<L>, Error> {
    check_comparable(options)?;
    match Weighed::of(edges, size, options) {
        Some(weighed) => weighed.answer(edges, size, options, photographs),
        // No model converges: the error of the one that was asked for tells why.
        None => {
            let calibration = calibrate_photographs(edges, size, options, photographs)?;
            Ok(ModelChoice::without_alternatives(
                options.model,
                calibration,
            ))
        }
    }
}

/// # Errors
/// [`Error::InvalidArgument`] for the linear method or a fixed distortion.
pub(crate) fn check_comparable<L: Lens>(options: &Options<L>) -> Result<(), Error> {
    if options.fixed.distortion || options.method == Method::Linear {
        return Err(Error::InvalidArgument(
            "choosing the model by evidence compares maximum-likelihood fits with the distortion \
             free: name a model for the linear method or a fixed distortion"
                .into(),
        ));
    }
    Ok(())
}

impl<L: Lens> ModelChoice<L> {
    /// A calibration with the one model that was asked for.
    pub fn without_alternatives(model: L::Model, calibration: Calibration<L>) -> Self {
        Self {
            model,
            calibration,
            alternatives: Vec::new(),
        }
    }
}

/// The models of a lens, fitted to the edge samples and weighed.
pub(crate) struct Weighed<L: Lens> {
    candidates: Vec<Candidate<L>>,
    chosen: usize,
    nested: NestedOptima<L>,
}

impl<L: Lens> Weighed<L> {
    /// All with the outliers of the richest that converges; `None` where none does.
    pub(crate) fn of(edges: &[PlaneEdges], size: ImageSize, options: &Options<L>) -> Option<Self> {
        let mut shared = Comparison::default();
        let candidates = candidates(edges, size, options, &mut shared);
        let chosen = best(&candidates)?;
        Some(Self {
            candidates,
            chosen,
            nested: shared.into_nested(),
        })
    }

    /// The model with the largest evidence, and its fit to the edge samples.
    pub(crate) fn chosen(&self) -> (L::Model, &Calibration<L>) {
        let chosen = &self.candidates[self.chosen];
        (chosen.model, &chosen.fit)
    }

    /// Every model, the simplest first, and its fit to the edge samples.
    pub(crate) fn fits(&self) -> impl Iterator<Item = (L::Model, &Calibration<L>)> {
        self.candidates.iter().map(|one| (one.model, &one.fit))
    }

    /// The fit of a model to the edge samples, if it converged.
    pub(crate) fn fit_with(&self, model: L::Model) -> Option<&Calibration<L>> {
        let mut candidates = self.candidates.iter();
        candidates.find_map(|one| (one.model == model).then_some(&one.fit))
    }

    /// What the doubt about the model adds to its covariance.
    fn doubt(&self, options: &Options<L>) -> Option<DMatrix<f64>> {
        let model = self.chosen().0;
        let options = Options { model, ..*options };
        doubt(&self.candidates, self.chosen, &options.free_parameters())
    }

    /// The covariance of that fit, with the doubt about the model.
    pub(crate) fn covariance(&self, options: &Options<L>) -> DMatrix<f64> {
        let own = &self.chosen().1.covariance;
        self.doubt(options)
            .map_or_else(|| own.clone(), |doubt| own + doubt)
    }

    /// The calibration with that model, with the doubt about it.
    pub(crate) fn answer(
        &self,
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
        photographs: Option<&Photographs<'_>>,
    ) -> Result<ModelChoice<L>, Error> {
        let (candidates, chosen) = (&self.candidates, self.chosen);
        let Candidate {
            model,
            log_evidence: reference,
            ..
        } = candidates[chosen];
        let options = Options { model, ..*options };
        let nested = self.nested.clone();
        let mut calibration = calibrate_beside(edges, size, &options, photographs, nested)?;
        if let Some(doubt) = self.doubt(&options) {
            widen(&mut calibration, doubt, options.fixed);
        }
        // The evidence has not asked for a model that would hold the lens.
        for warning in &mut calibration.warnings {
            if let Warning::LensBeyondModel {
                certain,
                cure: Some(_),
                ..
            } = warning
            {
                *certain = false;
            }
        }
        let rejected = candidates.iter().filter(|other| other.model != model);
        let alternatives = rejected.map(|other| ModelAlternative {
            model: other.model,
            log_evidence: other.log_evidence - reference,
            rms: other.fit.rms,
        });
        Ok(ModelChoice {
            model,
            calibration,
            alternatives: alternatives.collect(),
        })
    }
}

/// A model, its fit to the edge samples, and the logarithm of its evidence but for a constant.
struct Candidate<L: Lens> {
    model: L::Model,
    fit: Calibration<L>,
    log_evidence: f64,
}

/// Fits every model, and weighs those that converge. They share their work.
fn candidates<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    shared: &mut Comparison<L>,
) -> Vec<Candidate<L>> {
    let mut fits = Vec::with_capacity(L::Model::NESTED.len());
    // The richest first: what it rejects, the others may leave out.
    for &model in L::Model::NESTED.iter().rev() {
        let options = Options { model, ..*options };
        if let Ok(fit) = calibrate_unjudged(edges, size, &options, shared) {
            fits.push((model, fit, std::mem::take(&mut shared.priors)));
        }
    }
    fits.reverse();
    // The richest whose covariance can be weighed speaks for all models nested in it.
    while let Some((richest, fit, priors)) = fits.last() {
        if let Some(evidence) = log_evidence(*richest, fit, priors) {
            let of = |model: L::Model| {
                let place = L::Model::NESTED.iter().position(|other| *other == model)?;
                evidence.get(place).copied()
            };
            let weighed = fits.into_iter().filter_map(|(model, fit, _)| {
                let sees_all = fit.camera.sees_all_of(fit.image_size);
                Some(Candidate {
                    model,
                    log_evidence: of(model)? - if sees_all { 0.0 } else { ENDS_IN_PICTURE },
                    fit,
                })
            });
            return weighed.collect();
        }
        fits.pop();
    }
    Vec::new()
}

/// The one with the largest evidence; of equals the simplest.
fn best<L: Lens>(candidates: &[Candidate<L>]) -> Option<usize> {
    (0..candidates.len()).reduce(|best, next| {
        let better = candidates[next].log_evidence > candidates[best].log_evidence;
        if better { next } else { best }
    })
}

/// What the doubt about the model adds to the covariance of the chosen one, over its free
/// parameters.
///
/// With `w` a model's probability, `d` its difference from the chosen one in the latter's free
/// parameters and `C` the covariances: `sum w (C_model - C_chosen + d d^T)`; of the covariance
/// differences only what raises it, and none of simpler models, whose certainty is that of
/// their assumption. To that comes, whatever the probabilities, what coefficients may do that were
/// left out and are [`SMALL`].
fn doubt<L: Lens>(
    candidates: &[Candidate<L>],
    chosen: usize,
    free: &FreeParameters,
) -> Option<DMatrix<f64>> {
    let reference = &candidates[chosen];
    let weight = |c: &Candidate<L>| (c.log_evidence - reference.log_evidence).exp();
    let total: f64 = candidates.iter().map(weight).sum();
    let mut doubt = DMatrix::zeros(free.len(), free.len());
    if free.len() == 0 {
        return Some(doubt); // everything else is held, and the simplest model was chosen
    }
    for (i, candidate) in candidates.iter().enumerate() {
        if i == chosen {
            continue;
        }
        let difference = free.difference(&candidate.fit.camera, &reference.fit.camera);
        let mut own = &difference * difference.transpose();
        if i > chosen {
            let shared = shared(&candidate.fit.covariance, &candidate.fit, &reference.fit)?;
            own += raising_part(shared, &reference.fit.covariance)?;
        }
        doubt += own * (weight(candidate) / total);
    }
    if let Some(richest) = candidates.last().filter(|_| chosen + 1 < candidates.len()) {
        let shared = with_small_coefficients(reference, richest)?;
        doubt += raising_part(shared, &reference.fit.covariance)?;
    }
    doubt.iter().all(|v| v.is_finite()).then_some(doubt)
}

/// Logarithm of the evidence for every model up to the fitted one, in the order of
/// [`DistortionModel::NESTED`], against the fitted one.
///
/// In units of the prior's standard deviations, with estimate `d` and covariance `C`, the posterior
/// has the mean `(I + C E)^-1 d` and the covariance `(I + C E)^-1 C`, `E` being the prior's
/// information less that which the fit was held by (column and standard deviation).
fn log_evidence<L: Lens>(
    model: L::Model,
    fit: &Calibration<L>,
    held: &[(usize, f64)],
) -> Option<Vec<f64>> {
    let coefficients: Vec<usize> = model.columns().iter().collect();
    let count = coefficients.len();
    if count == 0 {
        return Some(vec![0.0]); // nothing to leave out, and the LU factors of nothing overflow
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
    let unknown = DVector::from_fn(count, |i, _| {
        let own = held.iter().find(|(column, _)| *column == coefficients[i]);
        1.0 - own.map_or(0.0, |(_, std)| (unit[i] / std).powi(2))
    });
    let total = &covariance * DMatrix::from_diagonal(&unknown) + DMatrix::identity(count, count);
    let total = total.lu();
    let mean = total.solve(&estimate)?;
    let posterior = total.solve(&covariance)?;
    let posterior = (&posterior + posterior.transpose()) * 0.5;
    let richest = L::Model::NESTED.iter().position(|other| *other == model)?;
    let evidence_of = |simpler: &L::Model| {
        let kept = simpler.columns();
        let left_out: Vec<usize> = (0..count)
            .filter(|i| !kept.contains(coefficients[*i]))
            .collect();
        let own = posterior.select_rows(&left_out).select_columns(&left_out);
        let factor = Cholesky::new(own)?;
        let at = mean.select_rows(&left_out);
        let square = at.dot(&factor.solve(&at));
        let evidence = -0.5 * (square + factor.ln_determinant());
        evidence.is_finite().then_some(evidence)
    };
    L::Model::NESTED[..=richest]
        .iter()
        .map(evidence_of)
        .collect()
}

/// The covariance of a richer fit, in the free parameters of `simpler`, once the coefficients that
/// this one leaves out are held to zero with a standard deviation of [`SMALL`].
fn with_small_coefficients<L: Lens>(
    simpler: &Candidate<L>,
    richer: &Candidate<L>,
) -> Option<DMatrix<f64>> {
    let fit = &richer.fit;
    let usual = fit.camera.coefficient_priors(fit.image_size);
    let kept = simpler.model.columns();
    let left_out: Vec<usize> = (richer.model.columns().iter())
        .filter(|column| !kept.contains(*column))
        .collect();
    let place = |column: &usize| fit.position(L::parameter_names()[*column]);
    let places: Vec<usize> = left_out.iter().map(place).collect::<Option<_>>()?;
    let across = fit.covariance.select_columns(&places);
    let mut own = across.select_rows(&places);
    for (i, column) in left_out.iter().enumerate() {
        own[(i, i)] += (SMALL * usual[column - INTRINSICS]).powi(2);
    }
    let held = &fit.covariance - &across * Cholesky::new(own)?.solve(&across.transpose());
    shared(&held, fit, &simpler.fit)
}

/// A covariance of the free parameters of a richer fit, in those of `reference`.
fn shared<L: Lens>(
    covariance: &DMatrix<f64>,
    richer: &Calibration<L>,
    reference: &Calibration<L>,
) -> Option<DMatrix<f64>> {
    let names = reference.parameters.iter();
    let places: Option<Vec<usize>> = names.map(|name| richer.position(name)).collect();
    let places = places?;
    Some(covariance.select_rows(&places).select_columns(&places))
}

/// What raises one covariance to another: their difference without its negative eigenvalues, in units
/// of the first one's standard deviations.
pub(crate) fn raising_part(to: DMatrix<f64>, from: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = to.nrows();
    let unit = from.diagonal().map(|d| d.sqrt().max(f64::MIN_POSITIVE));
    let by = to - from;
    let scaled = DMatrix::from_fn(size, size, |i, j| by[(i, j)] / (unit[i] * unit[j]));
    let eigen = SymmetricEigen::try_new(scaled, f64::EPSILON, MAX_EIGEN_ITERATIONS)?;
    let values = eigen.eigenvalues.map(|v| v.max(0.0));
    let vectors = &eigen.eigenvectors;
    let raised = vectors * DMatrix::from_diagonal(&values) * vectors.transpose();
    Some(DMatrix::from_fn(size, size, |i, j| {
        0.5 * (raised[(i, j)] + raised[(j, i)]) * unit[i] * unit[j]
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::{Brown, BrownModel};
    use crate::observations::Fixed;
    use crate::synthetic::{Scene, SceneOptions};

    fn scene(distortion: bool) -> Scene {
        let options = SceneOptions {
            distortion,
            ..SceneOptions::default()
        };
        Scene::random(4, options)
    }

    fn chosen(scene: &Scene, noise: f64) -> ModelChoice {
        let edges = scene.edges(3, noise, 6.0);
        calibrate_by_evidence(&edges, scene.size, &Options::default(), None).unwrap()
    }

    /// The scene seen by a camera with other distortion.
    fn bent(scene: &Scene, k: [f64; 5]) -> Scene {
        let mut parameters = scene.camera.parameters();
        parameters[4..9].copy_from_slice(&k);
        Scene {
            camera: scene.camera.with_parameters(&parameters),
            ..scene.clone()
        }
    }

    #[test]
    fn the_model_of_the_lens_is_chosen() {
        let pinhole = scene(false);
        for (k, model) in [
            ([0.0; 5], BrownModel::None),
            ([-0.15, 0.0, 0.0, 0.0, 0.0], BrownModel::Radial1),
            ([-0.25, 0.2, 0.0, 0.0, 0.0], BrownModel::Radial2),
            ([-0.15, 0.0, 0.0, 0.004, -0.004], BrownModel::Brown),
        ] {
            let found = chosen(&bent(&pinhole, k), 0.05);
            assert_eq!(found.model, model, "{:?}", found.alternatives);
            assert!(found.alternatives.iter().all(|a| a.log_evidence <= 0.0));
            assert!(found.alternatives.iter().all(|a| a.model != model));
        }
    }

    #[test]
    fn what_a_comparison_has_found_leaves_the_answer_as_it_is() {
        let scene = scene(true);
        let edges = scene.edges(3, 0.3, 6.0);
        let options = Options::<Brown>::default();
        let weighed = Weighed::of(&edges, scene.size, &options).unwrap();
        for &model in BrownModel::NESTED {
            let options = Options { model, ..options };
            let nested = weighed.nested.clone();
            let known = calibrate_beside(&edges, scene.size, &options, None, nested).unwrap();
            let alone = crate::calibrate(&edges, scene.size, &options).unwrap();
            assert_eq!(known, alone, "{model:?}");
        }
    }

    #[test]
    fn doubt_only_widens_the_intervals() {
        let scene = bent(&scene(false), [-0.1, 0.03, 0.0, 0.0, 0.0]);
        let found = chosen(&scene, 0.3);
        let options = Options {
            model: found.model,
            ..Options::default()
        };
        let plain = crate::calibrate(&scene.edges(3, 0.3, 6.0), scene.size, &options).unwrap();
        let own = &found.calibration.covariance;
        assert!(own.clone().cholesky().is_some());
        let widened = (own - &plain.covariance).symmetric_eigenvalues();
        let rounding = 1e-9 * plain.covariance.trace();
        assert!(widened.iter().all(|v| *v > -rounding), "{widened}");
        assert!(found.calibration.std()[0].1 > plain.std()[0].1);
        assert_eq!(found.calibration.camera, plain.camera);
    }

    #[test]
    fn what_the_doubt_leaves_unknown_is_warned_of() {
        // Squares about the middle of the picture tell little of the lens beyond them.
        let is_guess = |found: &Calibration| {
            let mut codes = found.warnings.iter().map(Warning::code);
            codes.any(|code| code == "lens_extrapolated")
        };
        for seed in [0, 2, 6, 7] {
            let mut scene = Scene::random(seed, SceneOptions::default());
            for pose in &mut scene.poses {
                pose.translation.z *= 1.6;
            }
            let found = chosen(&scene, 0.1);
            let options = Options {
                model: found.model,
                ..Options::default()
            };
            let edges = scene.edges(3, 0.1, 6.0);
            let plain = crate::calibrate(&edges, scene.size, &options).unwrap();
            assert!(!is_guess(&plain), "{seed}");
            assert!(is_guess(&found.calibration), "{seed}");
        }
    }

    #[test]
    fn a_model_without_free_parameters_may_be_chosen() {
        let scene = scene(false);
        let options = Options {
            fixed: Fixed {
                focal: true,
                principal_point: true,
                ..Fixed::default()
            },
            initial: Some(scene.camera),
            ..Options::default()
        };
        let edges = scene.edges(3, 0.1, 6.0);
        let found = calibrate_by_evidence(&edges, scene.size, &options, None).unwrap();
        assert_eq!(found.model, BrownModel::None);
        assert!(found.calibration.parameters.is_empty());
    }

    #[test]
    fn evidence_is_the_ratio_of_marginal_likelihoods() {
        // One coefficient: y ~ N(k, s^2) with prior N(0, t^2) against k = 0, in closed form.
        let scene = bent(&scene(false), [-0.01, 0.0, 0.0, 0.0, 0.0]);
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

    #[test]
    fn nothing_to_choose_is_an_error() {
        let edges = scene(true).edges(1, 0.1, 15.0);
        let size = scene(true).size;
        let linear = Options {
            method: Method::Linear,
            ..Options::default()
        };
        let held = Options {
            fixed: Fixed {
                distortion: true,
                ..Fixed::default()
            },
            initial: Some(Brown::new([
                1000.0, 1000.0, 640.0, 480.0, 0.0, 0.0, 0.0, 0.0, 0.0,
            ])),
            ..Options::default()
        };
        for options in [linear, held] {
            let found = calibrate_by_evidence(&edges, size, &options, None);
            assert!(matches!(found, Err(Error::InvalidArgument(_))));
        }
    }
}
