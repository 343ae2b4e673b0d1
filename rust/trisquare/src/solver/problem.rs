//! What is asked of the planes, and how a search for the answer may fail.

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

/// What is asked of the planes.
pub(crate) struct JointProblem<'a, L: Lens> {
    pub size: ImageSize,
    pub options: &'a Options<L>,
    pub free: FreeParameters,
    pub judged: FreeParameters,
    /// What the search begins from, where the model is richer than the default.
    pub(super) beginning: Option<Beginning<L>>,
    /// By how much the free parameters would change with the lens that fits best, where it does not
    /// see all of the picture and the samples contradict those that do.
    pub(super) contradicted: Option<DVector<f64>>,
    /// Planes of which the optimum is known already, and that.
    pub(super) found: Option<(&'a [ObservedPlane], Optimum<L>)>,
    /// What the searches have cost: shared by all problems that [`Self::within`] bounds together, as
    /// a calibration, its nested models and the trials of what would help.
    pub work: Rc<Work>,
}

/// An optimum from which another is searched: a poorer model's, or that of a lens that sees all of
/// the picture.
#[derive(Clone)]
pub(super) struct Beginning<L> {
    pub view: View<L>,
    pub free: FreeParameters,
}

/// Why the solver gives no answer.
pub(crate) enum Failure<L> {
    /// The geometry of an optimum cannot answer; what would help has not been asked yet.
    IllConditioned(Box<IllConditionedOptimum<L>>),
    /// Anything else.
    Other(Error),
}

/// An optimum whose geometry cannot answer.
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
    /// Whether fewer planes or sides may give an answer where all of them gave none.
    pub fn may_be_outliers(&self) -> bool {
        matches!(
            self,
            Self::IllConditioned(_) | Self::Other(Error::NotConverged { .. })
        )
    }
}

impl<'a, L: Lens> JointProblem<'a, L> {
    pub fn new(size: ImageSize, options: &'a Options<L>) -> Self {
        let free = options.free_parameters();
        Self {
            size,
            options,
            judged: judged_parameters(&free),
            free,
            beginning: None,
            contradicted: None,
            found: None,
            work: Rc::new(Work::unbounded()),
        }
    }

    /// Where another search may begin: this one's optimum.
    pub(super) fn beginning_at(&self, optimum: View<L>) -> Beginning<L> {
        Beginning {
            view: optimum,
            free: self.free.clone(),
        }
    }

    /// The same beginning from what the next poorer model found, which also says of what size
    /// coefficients are.
    pub(super) fn beyond(self, poorer: Beginning<L>) -> Self {
        let (model, known) = (self.options.model, (&poorer.view.lens, self.size));
        let free = self.free.clone().held_like(model, known, &poorer.free);
        Self {
            beginning: Some(poorer),
            ..self.with_free(free)
        }
    }

    /// The same with other free parameters.
    pub(super) fn with_free(self, free: FreeParameters) -> Self {
        Self {
            judged: judged_parameters(&free),
            free,
            ..self
        }
    }

    /// Whether the model is richer than the default, and all its coefficients estimated.
    pub(super) fn is_rich(&self) -> bool {
        let estimated = !self.options.fixed.distortion;
        estimated && self.options.model.poorer().is_some()
    }

    /// The same, whose searches end where they have cost so much.
    pub fn within(self, work: &Rc<Work>) -> Self {
        Self {
            work: Rc::clone(work),
            ..self
        }
    }

    /// Why the geometry of an optimum cannot answer, if it cannot.
    pub fn ill_conditioning(
        &self,
        planes: &[ObservedPlane],
        refined: &Refined<L>,
    ) -> Option<IllConditioning> {
        let factor = refined.covariance_factor;
        let conditioning = self.conditioning(planes, refined);
        conditioning.ill_conditioning(&refined.system, &self.free, factor)
    }

    /// The refusal of an optimum whose geometry cannot answer; `None` where it can.
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
