//! What would help where the geometry of an optimum cannot answer: the solver is asked again.

use super::problem::{Failure, Task, WeakOptimum};
use super::starts::with_stages;
use crate::error::Error;
use crate::observations::{Fixed, Options};
use crate::uncertainty::{remedies_by_holding, remedy_by_showing};

impl Task<'_> {
    /// The error of a failure; a weak geometry is told with what would help.
    pub fn advised(&self, failure: Failure) -> Error {
        let weak = match failure {
            Failure::Other(error) => return error,
            Failure::Weak(weak) => weak,
        };
        let WeakOptimum {
            planes,
            refined,
            mut weakness,
        } = *weak;
        let succeeds = |fixed: Fixed| {
            let options = Options {
                fixed,
                ..*self.options
            };
            if self.work.is_spent() {
                return false;
            }
            let trial = Task::new(self.size, &options).within(&self.work);
            let judged = with_stages(&trial, &planes, |stages| {
                Ok(stages.weakness(&stages.optimum()?).is_none())
            });
            judged.unwrap_or(false)
        };
        weakness.remedies = remedies_by_holding(&self.options.fixed, succeeds);
        let geometry = self.geometry(&planes, &refined);
        let shown = remedy_by_showing(&geometry, &weakness);
        weakness.remedies.extend(shown);
        Error::WeakGeometry(Box::new(weakness))
    }
}
