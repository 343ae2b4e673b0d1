//! What fits of models that are compared have in common.

use std::rc::Rc;

use crate::lens::Lens;
use crate::observations::{ObservedPlane, View};
use crate::solver::{NestedOptima, Work};

/// What models that are compared share, and tell beside their calibration.
pub(crate) struct Comparison<L: Lens> {
    pub(super) work: Option<Rc<Work>>,
    pub(super) nested: NestedOptima<L>,
    /// Column and standard deviation of what the last one was held near zero by.
    pub priors: Vec<(usize, f64)>,
    /// The planes with the outliers of the first one, and the view of the last one. Models that are
    /// too poor would reject what they do not describe, side by side.
    pub(super) richer: Option<(Vec<ObservedPlane>, View<L>)>,
}

impl<L: Lens> Default for Comparison<L> {
    fn default() -> Self {
        Self {
            work: None,
            nested: NestedOptima::default(),
            priors: Vec::new(),
            richer: None,
        }
    }
}

impl<L: Lens> Comparison<L> {
    /// Optima that were found, unless work ran out before they were found as they are without
    /// others.
    pub fn into_nested(self) -> NestedOptima<L> {
        match self.work {
            Some(work) if !work.is_spent() => self.nested,
            _ => NestedOptima::default(),
        }
    }
}
