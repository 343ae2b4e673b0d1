//! Models richer than the default begin where the next poorer one ends, and have to be lenses.

use std::rc::Rc;

use super::problem::{JointProblem, Poorer};
use super::work::Work;
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{Method, ObservedPlane, Options};

/// Pixels to which it is told where a distortion turns back.
const REACH_TOLERANCE: f64 = 0.5;

/// By how much tighter coefficients are held where the distortion turns back, and how often.
const TIGHTENING: f64 = 3.0;
const MAX_TIGHTENINGS: usize = 9;

impl<'a, L: Lens> JointProblem<'a, L> {
    /// What is asked of some planes, beginning from what the next poorer model finds where the
    /// model is richer than the default.
    pub fn of_planes(
        planes: &[ObservedPlane],
        size: ImageSize,
        options: &'a Options<L>,
        work: &Rc<Work>,
    ) -> Self {
        let poorer = poorer_optimum(planes, size, options, work);
        Self::beginning_at(poorer, planes, size, options, work)
    }

    /// The same beginning from what a poorer model has found, if any has.
    ///
    /// Where the distortion turns back inside the picture, beyond the samples, further coefficients
    /// are held the tighter until it does not: with none it is the poorer one.
    pub(super) fn beginning_at(
        poorer: Option<Poorer<L>>,
        planes: &[ObservedPlane],
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
        let turns_back = |problem: &Self| {
            let tried = problem.is_rich().then(|| problem.tried(planes)).flatten();
            tried.is_some_and(|found| !found.view.lens.sees_all_of(size))
        };
        let mut tighter = 1.0;
        let mut found = problem(tighter);
        for _ in 0..MAX_TIGHTENINGS {
            if !turns_back(&found) {
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
) -> Option<Poorer<L>> {
    if options.fixed.distortion || options.method == Method::Linear {
        return None;
    }
    let poorer = Options {
        model: options.model.poorer()?,
        ..*options
    };
    let problem = JointProblem::of_planes(planes, size, &poorer, work);
    match problem.optimum(planes) {
        Ok(refined) => Some(Poorer {
            lens: refined.view.lens,
            free: problem.free,
        }),
        Err(_) => problem.poorer,
    }
}
