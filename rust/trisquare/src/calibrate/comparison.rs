//! State shared by the fits of models that are compared.

use std::rc::Rc;

use crate::lens::Lens;
use crate::observations::{ObservedPlane, View};
use crate::solver::{NestedOptima, Work};

/// State shared by models that are compared, and their results besides the calibration.
pub(crate) struct Comparison<L: Lens> {
    pub(super) work: Option<Rc<Work>>,
    pub(super) nested: NestedOptima<L>,
    /// Column and standard deviation of the last model's priors about zero.
    pub priors: Vec<(usize, f64)>,
    /// The planes with the outliers of the first model, and the view of the last one. Models that
    /// are too poor would reject sides that they do not describe, one by one.
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
    /// The optima found; none if the work ran out, as they might differ from those found without a
    /// comparison.
    pub fn into_nested(self) -> NestedOptima<L> {
        match self.work {
            Some(work) if !work.is_spent() => self.nested,
            _ => NestedOptima::default(),
        }
    }
}
