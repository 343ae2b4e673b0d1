//! The joint problem of some planes, and the failures of its solution.

use std::rc::Rc;

use nalgebra::DVector;

use super::optimum::Optimum;
use super::work::Work;
use crate::error::Error;
use crate::ill_conditioning::IllConditioning;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{FreeParameters, ObservedPlane, Options, View};
use crate::refine::Refined;
use crate::uncertainty::{Conditioning, judged_parameters};

/// Joint problem of some planes.
pub(crate) struct JointProblem<'a, L: Lens> {
    pub size: ImageSize,
    pub options: &'a Options<L>,
    pub free: FreeParameters,
    /// The parameters of the normal equations at an optimum: the free ones first, then those that
    /// are only tested, the centre of distortion and the skew.
    pub judged: FreeParameters,
    /// Start of the search, if the model is richer than the default.
    pub(super) beginning: Option<Beginning<L>>,
    /// Change of the free parameters to those of the lens that fits best, if that does not see all
    /// of the picture and the samples contradict those that do.
    pub(super) contradicted: Option<DVector<f64>>,
    /// Planes whose optimum is already known, and that optimum.
    pub(super) found: Option<(&'a [ObservedPlane], Optimum<L>)>,
    /// Work done by the searches: shared by all problems that [`Self::with_work`] bounds together,
    /// such as a calibration, its nested models and the trials of remedies.
    pub work: Rc<Work>,
}

/// An optimum from which another is searched: that of a poorer model, or of a lens that sees all of
/// the picture.
#[derive(Clone)]
pub(super) struct Beginning<L> {
    pub view: View<L>,
    pub free: FreeParameters,
}

/// Failure of the solver.
pub(crate) enum Failure<L> {
    /// The geometry of an optimum does not determine the camera; remedies have not been computed
    /// yet.
    IllConditioned(Box<IllConditionedOptimum<L>>),
    /// Anything else.
    Other(Error),
}

/// An optimum whose geometry does not determine the camera.
pub(crate) struct IllConditionedOptimum<L> {
    pub planes: Vec<ObservedPlane>,
    pub refined: Refined<L>,
    pub ill_conditioning: IllConditioning,
}

impl<L> From<Error> for Failure<L> {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

impl<L> Failure<L> {
    /// Whether fewer planes or sides may have a solution although all of them had none.
    pub fn may_be_outliers(&self) -> bool {
        matches!(
            self,
            Self::IllConditioned(_) | Self::Other(Error::NotConverged { .. })
        )
    }
}

/// The parameters of the normal equations at an optimum over some free parameters.
fn tested_parameters(free: &FreeParameters) -> FreeParameters {
    judged_parameters(free).with_free_skew()
}

impl<'a, L: Lens> JointProblem<'a, L> {
    pub fn new(size: ImageSize, options: &'a Options<L>) -> Self {
        let free = options.free_parameters();
        Self {
            size,
            options,
            judged: tested_parameters(&free),
            free,
            beginning: None,
            contradicted: None,
            found: None,
            work: Rc::new(Work::unbounded()),
        }
    }

    /// Start of another search: the optimum of this one.
    pub(super) fn beginning_at(&self, optimum: View<L>) -> Beginning<L> {
        Beginning {
            view: optimum,
            free: self.free.clone(),
        }
    }

    /// The problem with a start from the next poorer model's result, which also determines the
    /// scale of the coefficients' priors.
    pub(super) fn with_poorer_start(self, poorer: Beginning<L>) -> Self {
        let (model, known) = (self.options.model, (&poorer.view.lens, self.size));
        let free = self.free.clone().with_priors(model, known, &poorer.free);
        Self {
            beginning: Some(poorer),
            ..self.with_free(free)
        }
    }

    /// The problem with other free parameters.
    pub(super) fn with_free(self, free: FreeParameters) -> Self {
        Self {
            judged: tested_parameters(&free),
            free,
            ..self
        }
    }

    /// Whether the model is richer than the default, and all its coefficients estimated.
    pub(super) fn is_rich(&self) -> bool {
        let is_estimated = !self.options.fixed.distortion;
        is_estimated && self.options.model.poorer().is_some()
    }

    /// The problem with a bound on the work of its searches.
    pub fn with_work(self, work: &Rc<Work>) -> Self {
        Self {
            work: Rc::clone(work),
            ..self
        }
    }

    /// Description of why the geometry of an optimum does not determine the camera; `None` if it
    /// does.
    pub fn ill_conditioning(
        &self,
        planes: &[ObservedPlane],
        refined: &Refined<L>,
    ) -> Option<IllConditioning> {
        let factor = refined.covariance_factor;
        let conditioning = self.conditioning(planes, refined);
        conditioning.ill_conditioning(&refined.system, &self.free, factor)
    }

    /// The refusal of an optimum whose geometry does not determine the camera; `None` if it does.
    pub fn refusal(&self, planes: &[ObservedPlane], refined: &Refined<L>) -> Option<Failure<L>> {
        let ill_conditioning = self.ill_conditioning(planes, refined)?;
        Some(Failure::IllConditioned(Box::new(IllConditionedOptimum {
            planes: planes.to_vec(),
            refined: refined.clone(),
            ill_conditioning,
        })))
    }

    pub fn conditioning<'b>(
        &'b self,
        planes: &'b [ObservedPlane],
        refined: &'b Refined<L>,
    ) -> Conditioning<'b, L> {
        Conditioning {
            view: &refined.view,
            planes,
            size: self.size,
            options: self.options,
            noise_scale: refined.noise_scale,
        }
    }
}
