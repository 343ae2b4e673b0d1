//! Start of models richer than the default: the optimum of the next poorer one. They have to be
//! lenses.

use std::rc::Rc;

use nalgebra::DVector;

use super::optimum::Optimum;
use super::problem::{Beginning, JointProblem};
use super::work::Work;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{FreeParameters, Method, ObservedPlane, Options};

/// Starts and results of nested models for the same planes: each model may need the poorer ones'
/// again.
#[derive(Clone)]
pub(crate) struct NestedOptima<L: Lens>(Vec<KnownModel<L>>);

#[derive(Clone)]
struct KnownModel<L: Lens> {
    model: L::Model,
    free: FreeParameters,
    beginning: Option<Beginning<L>>,
    contradicted: Option<DVector<f64>>,
    optimum: Option<Optimum<L>>,
}

impl<L: Lens> KnownModel<L> {
    fn of(problem: &JointProblem<'_, L>) -> Self {
        Self {
            model: problem.options.model,
            free: problem.free.clone(),
            beginning: problem.beginning.clone(),
            contradicted: problem.contradicted.clone(),
            optimum: problem.found.as_ref().map(|(_, found)| found.clone()),
        }
    }

    /// A problem with everything known of its model for these planes.
    fn problem<'a>(
        &self,
        planes: &'a [ObservedPlane],
        problem: JointProblem<'a, L>,
    ) -> JointProblem<'a, L> {
        JointProblem {
            beginning: self.beginning.clone(),
            contradicted: self.contradicted.clone(),
            found: self.optimum.clone().map(|found| (planes, found)),
            ..problem.with_free(self.free.clone())
        }
    }
}

impl<L: Lens> Default for NestedOptima<L> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<L: Lens> NestedOptima<L> {
    fn known_model(&self, model: L::Model) -> Option<&KnownModel<L>> {
        self.0.iter().find(|known| known.model == model)
    }

    fn set_optimum(&mut self, model: L::Model, optimum: &Optimum<L>) {
        for known in self.0.iter_mut().filter(|known| known.model == model) {
            known.optimum = Some(optimum.clone());
        }
    }
}

impl<'a, L: Lens> JointProblem<'a, L> {
    /// The problem of some planes, starting from the optimum of the next poorer model if the model
    /// is richer than the default. `nested` must be of the same planes, with the same options
    /// except the model.
    pub fn of_planes(
        planes: &'a [ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
        nested: &mut NestedOptima<L>,
    ) -> Self {
        if let Some(known) = nested.known_model(options.model) {
            return known.problem(planes, Self::new(size, options).with_work(work));
        }
        let poorer = poorer_optimum(planes, size, options, work, nested);
        let found = Self::from_poorer_model(poorer, planes, size, options, work);
        nested.0.push(KnownModel::of(&found));
        found
    }

    /// The problem starting from the result of a poorer model, if there is one.
    ///
    /// If its distortion turns back inside the picture, beyond the samples, the search is
    /// restricted to distortions that do not.
    pub(super) fn from_poorer_model(
        poorer: Option<Beginning<L>>,
        planes: &'a [ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
    ) -> Self {
        let problem = Self::new(size, options).with_work(work);
        let problem = match poorer {
            Some(poorer) => problem.with_poorer_start(poorer),
            None => problem,
        };
        if !problem.is_rich() {
            return problem;
        }
        problem.with_optimum(planes).seeing_whole_picture()
    }

    /// The problem with its optimum, if there is one.
    fn with_optimum(mut self, planes: &'a [ObservedPlane]) -> Self {
        if !self.work.is_spent() {
            let optimum = self.optimum_with_noise(planes);
            self.found = optimum.ok().map(|optimum| (planes, optimum));
        }
        self
    }
}

/// The result of the richest model poorer than the requested one; `None` if that is no richer than
/// the default, or nothing converges.
fn poorer_optimum<L: Lens>(
    planes: &[ObservedPlane],
    size: ImageSize,
    options: &Options<L>,
    work: &Rc<Work>,
    nested: &mut NestedOptima<L>,
) -> Option<Beginning<L>> {
    if options.fixed.distortion || options.method == Method::Linear {
        return None;
    }
    let poorer = Options {
        model: options.model.poorer()?,
        ..*options
    };
    let problem = JointProblem::of_planes(planes, size, &poorer, work, nested);
    match problem.optimum_with_noise(planes) {
        Ok(found) => {
            nested.set_optimum(poorer.model, &found);
            Some(problem.beginning_at(found.refined.view))
        }
        Err(_) => problem.beginning,
    }
}
