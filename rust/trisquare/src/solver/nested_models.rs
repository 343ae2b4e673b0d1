//! Models richer than the default begin where the next poorer one ends, and have to be lenses.

use std::rc::Rc;

use nalgebra::DVector;

use super::optimum::Optimum;
use super::problem::{Beginning, JointProblem};
use super::work::Work;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{FreeParameters, Method, ObservedPlane, Options};

/// What nested models begin from and find, for the same planes, by models that are asked in turn:
/// each may ask for the poorer ones' again.
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

    /// A problem that knows of its planes what is known of its model.
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
    fn of_model(&self, model: L::Model) -> Option<&KnownModel<L>> {
        self.0.iter().find(|known| known.model == model)
    }

    fn set_optimum(&mut self, model: L::Model, optimum: &Optimum<L>) {
        for known in self.0.iter_mut().filter(|known| known.model == model) {
            known.optimum = Some(optimum.clone());
        }
    }
}

impl<'a, L: Lens> JointProblem<'a, L> {
    /// What is asked of some planes, beginning from what the next poorer model finds where the
    /// model is richer than the default. What is known of nested models is of the same planes, with
    /// the same options but for the model.
    pub fn of_planes(
        planes: &'a [ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
        nested: &mut NestedOptima<L>,
    ) -> Self {
        if let Some(known) = nested.of_model(options.model) {
            return known.problem(planes, Self::new(size, options).within(work));
        }
        let poorer = poorer_optimum(planes, size, options, work, nested);
        let found = Self::beginning_beyond(poorer, planes, size, options, work);
        nested.0.push(KnownModel::of(&found));
        found
    }

    /// The same beginning from what a poorer model has found, if any has.
    ///
    /// Where its distortion turns back inside the picture, beyond the samples, one is searched among
    /// those that do not.
    pub(super) fn beginning_beyond(
        poorer: Option<Beginning<L>>,
        planes: &'a [ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
    ) -> Self {
        let problem = Self::new(size, options).within(work);
        let problem = match poorer {
            Some(poorer) => problem.beyond(poorer),
            None => problem,
        };
        if !problem.is_rich() {
            return problem;
        }
        problem.with_optimum(planes).seeing_all_of_picture()
    }

    /// The same with its optimum, where there is one.
    fn with_optimum(mut self, planes: &'a [ObservedPlane]) -> Self {
        if !self.work.is_spent() {
            let optimum = self.optimum_with_noise(planes);
            self.found = optimum.ok().map(|optimum| (planes, optimum));
        }
        self
    }
}

/// What the richest model poorer than the one asked for finds; `None` where that is no richer than
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
