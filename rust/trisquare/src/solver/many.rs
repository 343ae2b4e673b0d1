//! The optimum of many planes, from that of some of them: what a search from afar costs does not
//! grow with the planes, and a step or two lead all of them to where they agree.

use super::problem::JointProblem;
use super::starts::Starts;
use crate::lens::Lens;
use crate::linear::view_by_lens;
use crate::observations::{Method, ObservedPlane};
use crate::refine::Refined;

/// Of twice as many planes or more, so many, evenly chosen, are searched for the camera first.
const SOME_PLANES: usize = 48;

/// One in so many of the planes stands for all of them where there are many.
pub(crate) fn step_of_some(planes: usize) -> Option<usize> {
    Some(planes / SOME_PLANES).filter(|step| *step > 1)
}

/// Starts of theirs that must lead to an optimum, of which the better one is taken: the conic of a
/// few planes may lead to a wrong one. Where that is doubtful, all starts are tried.
const STARTS: usize = 2;

/// Samples of each side with which all of them are searched: of so many sides few tell enough.
const SAMPLES_PER_SIDE: usize = 5;

impl<L: Lens> JointProblem<'_, L> {
    /// The better of the first optima that some planes have.
    pub fn sketched(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        Starts::of(self, planes).ok()?.best_of_first(STARTS)
    }

    /// The optimum of many planes; `None` where there are few, or it is not found so.
    pub(super) fn optimum_of_many(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        let step = step_of_some(planes.len())?;
        if self.options.method == Method::Linear {
            return None;
        }
        let lens = match &self.beginning {
            // They leave a poorer model's optimum in no doubt: a search from there is enough.
            Some(beginning) => beginning.view.lens,
            None => {
                let some: Vec<_> = planes.iter().step_by(step).cloned().collect();
                self.sketched(&some)?.view.lens
            }
        };
        self.optimum_from(&lens, planes)
    }

    /// The optimum of many planes of which some have shown the lens; `None` where it is not found so.
    pub fn optimum_from(&self, lens: &L, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        let few = planes.iter().map(|p| p.subsampled(SAMPLES_PER_SIDE));
        let few: Vec<_> = few.collect();
        let view = view_by_lens(lens, &few, planes, self.size, self.options).ok()?;
        let found = self.searched(&few, &self.free, view)?.converged()?;
        let view = found.view.clone();
        self.finished(planes, found).or_else(|| {
            // Where one of the planes is far from a parabola, Newton's undamped steps do not arrive.
            let found = self.searched(planes, &self.free, view)?.converged()?;
            Refined::of_linear(planes, &self.free, &self.judged, found.view)
        })
    }
}
