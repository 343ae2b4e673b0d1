//! The optimum of many planes, from that of some of them: the cost of a search from a distant start
//! does not grow with the planes, and a step or two lead to the optimum of all.

use super::problem::JointProblem;
use super::starts::Starts;
use crate::lens::Lens;
use crate::linear::view_by_lens;
use crate::observations::{Method, ObservedPlane};
use crate::refine::Refined;

/// Number of planes, evenly chosen, from which the camera is estimated first if there are at least
/// twice as many.
const SOME_PLANES: usize = 48;

/// Stride of the planes that represent all of them if there are many.
pub(crate) fn subset_stride(planes: usize) -> Option<usize> {
    Some(planes / SOME_PLANES).filter(|step| *step > 1)
}

/// Number of starts that must lead to an optimum, of which the better one is used: the conic of a
/// few planes may lead to a wrong one. In case of doubt all starts are tried.
const STARTS: usize = 2;

/// Number of samples per side in the search with all planes: with so many sides few are enough.
const SAMPLES_PER_SIDE: usize = 5;

impl<L: Lens> JointProblem<'_, L> {
    /// The better of the first optima of some planes.
    pub fn subset_optimum(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        Starts::of(self, planes).ok()?.best_of_first(STARTS)
    }

    /// The optimum of many planes; `None` if there are few, or if it is not found this way.
    pub(super) fn optimum_of_many(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        let step = subset_stride(planes.len())?;
        if self.options.method == Method::Linear {
            return None;
        }
        let lens = match &self.beginning {
            // A poorer model's optimum is a sufficient start: many planes determine it without
            // doubt.
            Some(beginning) => beginning.view.lens,
            None => {
                let subset: Vec<_> = planes.iter().step_by(step).cloned().collect();
                self.subset_optimum(&subset)?.view.lens
            }
        };
        self.optimum_from(&lens, planes)
    }

    /// The optimum of many planes, from a lens determined by some of them; `None` if it is not
    /// found this way.
    pub fn optimum_from(&self, lens: &L, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        let subsampled = planes.iter().map(|p| p.subsampled(SAMPLES_PER_SIDE));
        let subsampled: Vec<_> = subsampled.collect();
        let view = view_by_lens(lens, &subsampled, planes, self.size, self.options).ok()?;
        let found = self.searched(&subsampled, &self.free, view)?.converged()?;
        let view = found.view.clone();
        self.finished(planes, found).or_else(|| {
            // If the cost of one of the planes is far from a parabola, Newton's undamped steps do
            // not converge.
            let found = self.searched(planes, &self.free, view)?.converged()?;
            Refined::of_linear(planes, &self.free, &self.judged, found.view)
        })
    }
}
