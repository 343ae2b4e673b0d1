//! Choice of the distortion coefficients.
//!
//! The models of a lens are nested: each is the next richer one with coefficients at zero. All are
//! fitted, and weighed by their [evidence](super::evidence). The results of the others are included
//! in the covariance of the chosen one, as its [doubt](super::doubt).

use nalgebra::DMatrix;

use super::doubt::doubt;
use super::evidence::{WeighedModel, log_evidence};
use crate::calibrate::{
    Comparison, calibrate_photographs, calibrate_unjudged, calibrate_with_nested,
};
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, DistortionModel, Lens};
use crate::observations::{Method, Options, PlaneEdges};
use crate::photometric::Photographs;
use crate::result::{Calibration, Warning};
use crate::solver::NestedOptima;
use crate::uncertainty::widen;

/// Penalty on the log evidence of a model whose valid radius ends inside the picture, as no real
/// camera's does. One unit is too little evidence to prefer such a model.
const ENDS_IN_PICTURE: f64 = 1.0;
/// Loss of log evidence of the models that are too poor for the lens according to the residuals at
/// one place of the picture, which the evidence does not use: these have odds of 400 for it.
const CONTRADICTED: f64 = 6.0;

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

/// A calibration with the model of the largest evidence.
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
    /// The calibration with it; its covariance includes the doubt about the model.
    pub calibration: Calibration<L>,
    /// The models that were rejected, the simplest first; models that did not converge are left
    /// out.
    pub alternatives: Vec<ModelAlternative<L>>,
}

/// Calibrates with the lens model that has the largest evidence.
///
/// The models are compared on edge samples; the photographs, if any, are fitted with the chosen
/// one. `options.model` is only used if no model converges.
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
    match WeighedModels::of(edges, size, options) {
        Some(weighed) => weighed.answer(edges, size, options, photographs),
        // No model converges: the error of the requested one says why.
        None => {
            let calibration = calibrate_photographs(edges, size, options, photographs)?;
            Ok(ModelChoice::without_alternatives(
                options.model,
                calibration,
            ))
        }
    }
}

/// Checks that the options allow a comparison of models.
///
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
    /// A calibration with the requested model only.
    pub fn without_alternatives(model: L::Model, calibration: Calibration<L>) -> Self {
        Self {
            model,
            calibration,
            alternatives: Vec::new(),
        }
    }
}

/// The models of a lens, fitted to the edge samples and weighed.
pub(crate) struct WeighedModels<L: Lens> {
    models: Vec<WeighedModel<L>>,
    chosen: usize,
    nested: NestedOptima<L>,
}

impl<L: Lens> WeighedModels<L> {
    /// Fits all with the outliers of the richest that converges; `None` if none does.
    pub(crate) fn of(edges: &[PlaneEdges], size: ImageSize, options: &Options<L>) -> Option<Self> {
        let mut shared = Comparison::default();
        let models = fitted_models(edges, size, options, &mut shared);
        let chosen = best(&models)?;
        Some(Self {
            models,
            chosen,
            nested: shared.into_nested(),
        })
    }

    /// The model with the largest evidence, and its fit to the edge samples.
    pub(crate) fn chosen(&self) -> (L::Model, &Calibration<L>) {
        let chosen = &self.models[self.chosen];
        (chosen.model, &chosen.fit)
    }

    /// Every model, the simplest first, and its fit to the edge samples.
    pub(crate) fn fits(&self) -> impl Iterator<Item = (L::Model, &Calibration<L>)> {
        self.models
            .iter()
            .map(|weighed| (weighed.model, &weighed.fit))
    }

    /// The fit of a model to the edge samples, if it converged.
    pub(crate) fn fit_with(&self, model: L::Model) -> Option<&Calibration<L>> {
        let mut models = self.models.iter();
        models.find_map(|weighed| (weighed.model == model).then_some(&weighed.fit))
    }

    /// Contribution of the doubt about the chosen model to its covariance.
    fn doubt(&self, options: &Options<L>) -> Option<DMatrix<f64>> {
        let model = self.chosen().0;
        let options = Options { model, ..*options };
        doubt(&self.models, self.chosen, &options.free_parameters())
    }

    /// The covariance of the chosen fit, including the doubt about the model.
    pub(crate) fn covariance(&self, options: &Options<L>) -> DMatrix<f64> {
        let covariance = &self.chosen().1.covariance;
        self.doubt(options)
            .map_or_else(|| covariance.clone(), |doubt| covariance + doubt)
    }

    /// The calibration with the chosen model, including the doubt about it.
    pub(crate) fn answer(
        &self,
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
        photographs: Option<&Photographs<'_>>,
    ) -> Result<ModelChoice<L>, Error> {
        let found = self.answer_with_chosen(edges, size, options, photographs)?;
        match self.without_contradicted(&found.calibration) {
            Some(others) => others.answer_with_chosen(edges, size, options, photographs),
            None => Ok(found),
        }
    }

    /// The models with less evidence for those that the residuals of the chosen one contradict;
    /// `None` if the choice remains.
    fn without_contradicted(&self, found: &Calibration<L>) -> Option<Self> {
        let cure = found.warnings.iter().find_map(|warning| match warning {
            Warning::LensBeyondModel { cure, .. } => cure.as_ref(),
            _ => None,
        });
        let (name, _) = cure?;
        let mut models = self.models.clone();
        let cure = models.iter().position(|own| own.model.name() == *name)?;
        for poorer in &mut models[..cure] {
            poorer.log_evidence -= CONTRADICTED;
        }
        let chosen = best(&models)?;
        (chosen != self.chosen).then(|| Self {
            models,
            chosen,
            nested: self.nested.clone(),
        })
    }

    /// The calibration with the chosen model, whatever its residuals say about the lens.
    fn answer_with_chosen(
        &self,
        edges: &[PlaneEdges],
        size: ImageSize,
        options: &Options<L>,
        photographs: Option<&Photographs<'_>>,
    ) -> Result<ModelChoice<L>, Error> {
        let WeighedModel {
            model,
            log_evidence: reference,
            ..
        } = self.models[self.chosen];
        let options = Options { model, ..*options };
        let nested = self.nested.clone();
        let mut calibration = calibrate_with_nested(edges, size, &options, photographs, nested)?;
        if let Some(doubt) = self.doubt(&options) {
            widen(&mut calibration, doubt, options.fixed);
        }
        // The evidence was not in favour of a model that would describe the lens.
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
        let rejected = self.models.iter().filter(|other| other.model != model);
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

/// Fits every model, and weighs those that converge. They share their work.
fn fitted_models<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    shared: &mut Comparison<L>,
) -> Vec<WeighedModel<L>> {
    let mut fits = Vec::with_capacity(L::Model::NESTED.len());
    // The richest first: the others may leave out the outliers that it rejects.
    for &model in L::Model::NESTED.iter().rev() {
        let options = Options { model, ..*options };
        if let Ok(fit) = calibrate_unjudged(edges, size, &options, shared) {
            fits.push((model, fit, std::mem::take(&mut shared.priors)));
        }
    }
    fits.reverse();
    // The evidence of all nested models follows from the richest whose covariance can be used.
    while let Some((richest, fit, priors)) = fits.last() {
        if let Some(evidence) = log_evidence(*richest, fit, priors) {
            let evidence_of = |model: L::Model| {
                let place = L::Model::NESTED.iter().position(|other| *other == model)?;
                evidence.get(place).copied()
            };
            let weighed = fits.into_iter().filter_map(|(model, fit, _)| {
                let sees_all = fit.camera.sees_all_of(fit.image_size);
                Some(WeighedModel {
                    model,
                    log_evidence: evidence_of(model)?
                        - if sees_all { 0.0 } else { ENDS_IN_PICTURE },
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
fn best<L: Lens>(models: &[WeighedModel<L>]) -> Option<usize> {
    (0..models.len()).reduce(|best, next| {
        let is_better = models[next].log_evidence > models[best].log_evidence;
        if is_better { next } else { best }
    })
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
    fn a_model_that_residuals_contradict_yields_to_its_cure() {
        let lens = bent(&scene(false), [-0.15, 0.0, 0.0, 0.0, 0.0]);
        let edges = lens.edges(3, 0.05, 6.0);
        let weighed = WeighedModels::of(&edges, lens.size, &Options::<Brown>::default()).unwrap();
        let (model, fit) = weighed.chosen();
        assert_eq!(model, BrownModel::Radial1);
        let mut found = fit.clone();
        assert!(weighed.without_contradicted(&found).is_none());
        found.warnings.push(Warning::LensBeyondModel {
            certain: false,
            parameter: "k1".into(),
            factor: 2.0,
            cure: Some(("radial2".into(), 900.0)),
            held: Vec::new(),
        });
        let others = weighed.without_contradicted(&found).unwrap();
        assert_eq!(others.chosen().0, BrownModel::Radial2);
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
        let weighed = WeighedModels::of(&edges, scene.size, &options).unwrap();
        for &model in BrownModel::NESTED {
            let options = Options { model, ..options };
            let nested = weighed.nested.clone();
            let known = calibrate_with_nested(&edges, scene.size, &options, None, nested).unwrap();
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
        // Squares about the centre of the picture hardly determine the lens beyond them.
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
