//! Models richer than the default begin where the next poorer one ends, and have to be lenses.

use std::rc::Rc;

use super::optimum::Optimum;
use super::problem::{JointProblem, Poorer};
use super::work::Work;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{FreeParameters, Method, ObservedPlane, Options};
use crate::uncertainty::judged_parameters;

/// Pixels to which it is told where a distortion turns back.
const REACH_TOLERANCE: f64 = 0.5;

/// By how much tighter coefficients are held where the distortion turns back, and how often.
const TIGHTENING: f64 = 3.0;
const MAX_TIGHTENINGS: usize = 9;

/// What nested models begin from and find, for the same planes, by models that are asked in turn:
/// each may ask for the poorer ones' again.
#[derive(Clone)]
pub(crate) struct NestedOptima<L: Lens>(Vec<KnownModel<L>>);

#[derive(Clone)]
struct KnownModel<L: Lens> {
    model: L::Model,
    free: FreeParameters,
    poorer: Option<Poorer<L>>,
    optimum: Option<Optimum<L>>,
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

    fn add(&mut self, problem: &JointProblem<'_, L>) {
        let JointProblem { free, poorer, .. } = problem;
        self.0.push(KnownModel {
            model: problem.options.model,
            free: free.clone(),
            poorer: poorer.clone(),
            optimum: problem.found.as_ref().map(|(_, found)| found.clone()),
        });
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
            return Self {
                judged: judged_parameters(&known.free),
                free: known.free.clone(),
                poorer: known.poorer.clone(),
                found: known.optimum.clone().map(|found| (planes, found)),
                ..Self::new(size, options).within(work)
            };
        }
        let poorer = poorer_optimum(planes, size, options, work, nested);
        let found = Self::beginning_at(poorer, planes, size, options, work);
        nested.add(&found);
        found
    }

    /// The same beginning from what a poorer model has found, if any has.
    ///
    /// Where the distortion turns back inside the picture, beyond the samples, further coefficients
    /// are held the tighter until it does not: with none it is the poorer one.
    pub(super) fn beginning_at(
        poorer: Option<Poorer<L>>,
        planes: &'a [ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
    ) -> Self {
        let problem = |tighter: f64| {
            let problem = Self::new(size, options).within(work);
            match &poorer {
                Some(poorer) => problem.beyond(poorer.clone(), tighter),
                None => problem,
            }
        };
        let mut tighter = 1.0;
        let mut found = problem(tighter);
        for _ in 0..MAX_TIGHTENINGS {
            if found.is_rich() && !work.is_spent() {
                let optimum = found.optimum_with_noise(planes);
                found.found = optimum.ok().map(|optimum| (planes, optimum));
            }
            let turns_back =
                |(_, found): &(_, Optimum<L>)| !found.refined.view.lens.sees_all_of(size);
            if !found.found.as_ref().is_some_and(turns_back) {
                break;
            }
            tighter *= TIGHTENING;
            found = problem(tighter);
        }
        found
    }

    /// Refuses the lens of a rich model that turns back inside the picture.
    ///
    /// # Errors
    /// [`Error::TurnsBack`].
    pub fn check_reach(&self, lens: &L) -> Result<(), Error> {
        if !self.is_rich() || lens.sees_all_of(self.size) {
            return Ok(());
        }
        let centre = lens.principal_point();
        let offsets = self.size.corners().map(|corner| corner - centre);
        let farthest = offsets.iter().max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let farthest = farthest.copied().unwrap_or_default();
        let (mut seen, mut unseen) = (0.0, 1.0);
        while (unseen - seen) * farthest.norm() > REACH_TOLERANCE {
            let middle = 0.5 * (seen + unseen);
            match lens.unproject(&(centre + farthest * middle)) {
                Some(_) => seen = middle,
                None => unseen = middle,
            }
        }
        Err(Error::TurnsBack {
            radius: seen * farthest.norm(),
            corner: farthest.norm(),
        })
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
) -> Option<Poorer<L>> {
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
            Some(Poorer {
                lens: found.refined.view.lens,
                free: problem.free,
            })
        }
        Err(_) => problem.poorer,
    }
}
