//! Tests whether a lens is beyond its model, searches a richer model for it, and estimates the
//! remaining doubt.

use std::rc::Rc;

use nalgebra::DVector;

use super::problem::JointProblem;
use super::solve::Solution;
use super::work::Work;
use crate::lens::{DistortionModel, Lens};
use crate::noise::PictureFields;
use crate::observations::{ObservedPlane, Options};
use crate::result::{Calibration, Warning};
use crate::uncertainty::{LensVerdict, beyond_lens};

/// Doubt about a lens beyond its model.
struct LensDoubt {
    /// Error of the free parameters.
    change: DVector<f64>,
    /// The poorest richer model that describes the lens, and `fx` with it; `None` if none does.
    cure: Option<(String, f64)>,
}

impl<L: Lens> JointProblem<'_, L> {
    /// Verdict of the residuals on the lens.
    pub fn lens_verdict(&self, solution: &Solution<L>) -> Option<LensVerdict> {
        let noise = solution.noise.as_ref()?;
        let refined = &solution.refined;
        let fields = PictureFields::of(&refined.view.lens, self.size);
        let verdict = beyond_lens(&solution.planes, (&self.free, fields), refined, noise);
        match (verdict, &self.contradicted) {
            (
                None | Some(LensVerdict::Held | LensVerdict::Unclear { is_evident: false }),
                Some(change),
            ) => Some(LensVerdict::Beyond(change.clone())),
            (verdict, _) => verdict,
        }
    }

    /// Adds the uncertainty of a verdict to the covariance of a calibration; returns the warnings
    /// that come first.
    pub fn apply_verdict(
        &self,
        verdict: &LensVerdict,
        (planes, solution): (&[ObservedPlane], &Solution<L>),
        calibration: &mut Calibration<L>,
    ) -> Vec<Warning> {
        let doubt = self.lens_doubt(planes, solution, verdict);
        let mut first = Vec::new();
        let is_cured = doubt.as_ref().is_some_and(|doubt| doubt.cure.is_some());
        let no_squares = match verdict {
            LensVerdict::NoSquares(found) if !is_cured => Some(found),
            _ => None,
        };
        if let Some(found) = no_squares {
            let contradicts =
                |warning: &Warning| matches!(warning, Warning::PlanesContradict { .. });
            calibration.warnings.retain(|warning| !contradicts(warning));
            first.extend(calibration.allow_for_no_squares(found, &self.free));
        }
        if let Some(doubt) = doubt {
            let certain = is_cured || matches!(verdict, LensVerdict::Beyond(_));
            let held = self.options.fixed.names();
            first.extend(calibration.allow_for_lens(&doubt.change, doubt.cure, certain, held));
        }
        first
    }

    /// Doubt about a lens beyond its model; `None` if it is not beyond it, or if bent planes may be
    /// the cause.
    ///
    /// The lens is the cause if fields over the picture explain the residuals, or if a richer model
    /// leaves none to explain. `planes` are those given; outliers of the solution remain outliers.
    fn lens_doubt(
        &self,
        planes: &[ObservedPlane],
        solution: &Solution<L>,
        verdict: &LensVerdict,
    ) -> Option<LensDoubt> {
        let mut change = match verdict {
            LensVerdict::Held
            | LensVerdict::Deformed
            | LensVerdict::Unclear { is_evident: false } => {
                return None;
            }
            LensVerdict::Unclear { is_evident: true } => None,
            LensVerdict::NoSquares(found) => Some(found.lens.clone()?),
            LensVerdict::Beyond(change) | LensVerdict::Likely(change) => Some(change.clone()),
        };
        let planes = solution.with_outliers_marked(planes);
        let mut poorer = self.beginning_at(solution.refined.view.clone());
        // If the distortion is fixed, its own model with other coefficients may suffice.
        let (model, mut fixed) = (self.options.model, self.options.fixed);
        let freed = fixed.distortion.then_some(model);
        fixed.distortion = false;
        for model in freed.into_iter().chain(model.richer().iter().copied()) {
            let options = Options {
                model,
                fixed,
                ..*self.options
            };
            let work = Rc::new(Work::for_planes(&planes));
            let start = model.poorer().map(|_| poorer.clone());
            let richer =
                JointProblem::from_poorer_model(start, &planes, self.size, &options, &work);
            let Ok(found) = richer.solve(&planes) else {
                continue;
            };
            let lens = found.refined.view.lens;
            poorer = richer.beginning_at(found.refined.view.clone());
            if richer.is_ill_conditioned(&found) {
                continue;
            }
            let camera_change = || self.free.difference(&lens, &solution.refined.view.lens);
            // A model that explains the sides' shapes but not their positions is no cure.
            let contradicts = found.correlated.residual_correlation.planes_contradict();
            match richer.lens_verdict(&found) {
                Some(LensVerdict::Held) if !contradicts => {
                    return Some(LensDoubt {
                        change: camera_change(),
                        cure: Some((model.name(), lens.focal().x)),
                    });
                }
                Some(LensVerdict::Beyond(_) | LensVerdict::Likely(_)) => {
                    change = Some(camera_change())
                }
                _ => {}
            }
        }
        change.map(|change| LensDoubt { change, cure: None })
    }
}
