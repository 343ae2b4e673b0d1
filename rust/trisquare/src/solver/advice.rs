//! What would help where the geometry of an optimum cannot answer: the solver is asked again.

use super::problem::{Failure, IllConditionedOptimum, JointProblem};
use crate::error::Error;
use crate::lens::Lens;
use crate::observations::{Fixed, Options};
use crate::uncertainty::add_remedies;

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
            let optimum = trial.optimum(&planes);
            optimum.is_ok_and(|found| trial.ill_conditioning(&planes, &found).is_none())
        };
        let conditioning = self.conditioning(&planes, &refined);
        add_remedies(&mut ill_conditioning, &conditioning, succeeds);
        Error::IllConditioned(Box::new(ill_conditioning))
    }
}
