//! What would help where the geometry of an optimum cannot answer: the solver is asked again.

use crate::problem::{Failure, Task, WeakOptimum};
use crate::remedies;
use crate::stages::with_stages;
use crate::{Error, Fixed, Options};

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
            let trial = Task::new(self.size, &options);
            let judged = with_stages(&trial, &planes, |stages| {
                Ok(stages.weakness(&stages.optimum()?).is_none())
            });
            judged.unwrap_or(false)
        };
        weakness.remedies = remedies::holding(&self.options.fixed, succeeds);
        let geometry = self.geometry(&planes, &refined);
        let shown = remedies::showing(&geometry, &weakness);
        weakness.remedies.extend(shown);
        Error::WeakGeometry(Box::new(weakness))
    }
}
