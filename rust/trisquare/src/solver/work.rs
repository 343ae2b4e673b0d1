//! Bound on the total work of searches, each of which is bounded but of which there are many.
//!
//! Work is counted and not timed, so that the result does not depend on the machine.

use std::cell::Cell;

use crate::observations::ObservedPlane;

/// Cost of a plane's elimination, in samples.
const SAMPLES_PER_PLANE: usize = 32;

/// Maximum number of evaluations of all samples in a calibration. Sound ones take some dozens,
/// those that reject sides or search for remedies up to 2,750.
const EVALUATIONS: usize = 5_000;

/// Minimum of the work allowed, for the smallest calibrations, in samples evaluated: about a
/// second.
const MIN_WORK: usize = 2_500_000;

/// Work done, and work allowed, in samples evaluated.
#[derive(Debug)]
pub(crate) struct Work {
    done: Cell<usize>,
    allowed: usize,
}

impl Work {
    /// Work without a bound.
    pub fn unbounded() -> Self {
        Self {
            done: Cell::new(0),
            allowed: usize::MAX,
        }
    }

    /// Work allowed to a calibration of some planes.
    pub fn for_planes(planes: &[ObservedPlane]) -> Self {
        Self {
            done: Cell::new(0),
            allowed: MIN_WORK.max(EVALUATIONS.saturating_mul(cost(planes))),
        }
    }

    /// Counts evaluations of all samples of some planes.
    pub fn count(&self, planes: &[ObservedPlane], evaluations: usize) {
        let more = evaluations.saturating_mul(cost(planes));
        self.done.set(self.done.get().saturating_add(more));
    }

    /// Whether no further search should start.
    pub fn is_spent(&self) -> bool {
        self.done.get() >= self.allowed
    }
}

/// Cost of one evaluation of all samples of some planes, in samples.
fn cost(planes: &[ObservedPlane]) -> usize {
    let samples: usize = planes.iter().map(|plane| plane.samples().count()).sum();
    samples + SAMPLES_PER_PLANE * planes.len()
}
