//! What would help where the geometry of an optimum cannot answer: the solver is asked again.

use super::problem::{Failure, IllConditionedOptimum, JointProblem};
use super::starts::with_starts;
use crate::error::Error;
use crate::lens::Lens;
use crate::observations::{Fixed, Options};
use crate::uncertainty::{remedies_by_holding, remedy_by_showing};

impl<L: Lens> JointProblem<'_, L> {
    /// The error of a failure; a weak geometry is told with what would help.
    pub fn advised(&self, failure: Failure<L>) -> Error {
        let found = match failure {
            Failure::Other(error) => return error,
            Failure::IllConditioned(found) => found,
        };
        let IllConditionedOptimum {
            planes,
            refined,
            mut ill_conditioning,
        } = *found;
        let succeeds = |fixed: Fixed| {
            let options = Options {
                fixed,
                ..*self.options
            };
            if self.work.is_spent() {
                return false;
            }
            let trial = JointProblem::new(self.size, &options).within(&self.work);
            let judged = with_starts(&trial, &planes, |starts| {
                Ok(starts.ill_conditioning(&starts.optimum()?).is_none())
            });
            judged.unwrap_or(false)
        };
        ill_conditioning.remedies = remedies_by_holding(&self.options.fixed, succeeds);
        let conditioning = self.conditioning(&planes, &refined);
        let shown = remedy_by_showing(&conditioning, &ill_conditioning);
        ill_conditioning.remedies.extend(shown);
        Error::IllConditioned(Box::new(ill_conditioning))
    }
}
