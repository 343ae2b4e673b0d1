//! How much has been searched: what bounds searches of which each is bounded, but there are many.
//!
//! Work is counted and not timed, so that the answer does not depend on the machine.

use std::cell::Cell;

use crate::observations::ObservedPlane;

/// A plane's elimination costs as much as so many of its samples.
const SAMPLES_PER_PLANE: usize = 32;

/// Evaluations of all samples that a calibration may take. Sound ones take some dozens, those
/// that reject sides or look for remedies up to 2,750.
const EVALUATIONS: usize = 5_000;

/// Work that is allowed to the smallest calibrations, in samples evaluated: about a second.
const LEAST: usize = 2_500_000;

/// Work done, and how much is allowed; in samples evaluated.
#[derive(Debug)]
pub(crate) struct Work {
    done: Cell<usize>,
    allowed: usize,
}

impl Work {
    /// Without a bound.
    pub fn unbounded() -> Self {
        Self {
            done: Cell::new(0),
            allowed: usize::MAX,
        }
    }

    /// What a calibration of some planes may take.
    pub fn for_planes(planes: &[ObservedPlane]) -> Self {
        Self {
            done: Cell::new(0),
            allowed: LEAST.max(EVALUATIONS.saturating_mul(cost(planes))),
        }
    }

    /// Counts evaluations of all samples of some planes.
    pub fn count(&self, planes: &[ObservedPlane], evaluations: usize) {
        let more = evaluations.saturating_mul(cost(planes));
        self.done.set(self.done.get().saturating_add(more));
    }

    /// Whether no further search should begin.
    pub fn is_spent(&self) -> bool {
        self.done.get() >= self.allowed
    }
}

/// What one evaluation of all samples of some planes costs.
fn cost(planes: &[ObservedPlane]) -> usize {
    let samples: usize = planes.iter().map(|plane| plane.samples().count()).sum();
    samples + SAMPLES_PER_PLANE * planes.len()
}
