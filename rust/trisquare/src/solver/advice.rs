//! What would help where the geometry of an optimum cannot answer: the solver is asked again.

use nalgebra::Matrix3;

use super::problem::{Failure, IllConditionedOptimum, JointProblem};
use crate::error::Error;
use crate::lens::Lens;
use crate::observations::{Fixed, ObservedPlane, Options};
use crate::uncertainty::{MARGIN, add_remedies};

/// Principal points for each of which holding it must help, in parts of the picture's width from
/// where it is held so far: nobody knows yet what value the user will find. Most cameras have
/// theirs so near the image centre.
const PRINCIPAL_POINTS: [(f64, f64); 4] =
    [(0.0, 0.0), (0.015, 0.0), (-0.01, 0.01), (-0.005, -0.015)];

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
        let conditioning = self.conditioning(&planes, &refined);
        let succeeds = |fixed: Fixed| self.is_sound_holding(fixed, &planes);
        add_remedies(&mut ill_conditioning, &conditioning, succeeds);
        Error::IllConditioned(Box::new(ill_conditioning))
    }

    /// Whether the planes answer with a margin if so much is held, whatever the principal point.
    fn is_sound_holding(&self, fixed: Fixed, planes: &[ObservedPlane]) -> bool {
        let is_new = fixed.principal_point && !self.options.fixed.principal_point;
        let places = if is_new {
            &PRINCIPAL_POINTS[..]
        } else {
            &[(0.0, 0.0)]
        };
        let (width, centre) = (f64::from(self.size.width), self.size.centre());
        let assumed = Matrix3::new(width, 0.0, centre.x, 0.0, width, centre.y, 0.0, 0.0, 1.0);
        let assumed = || L::from_camera_matrix(&assumed);
        let initial = self.options.initial.unwrap_or_else(assumed);
        places.iter().all(|(x, y)| {
            let mut camera_matrix = initial.camera_matrix();
            camera_matrix.m13 += x * width;
            camera_matrix.m23 += y * width;
            let options = Options {
                fixed,
                initial: Some(initial.with_camera_matrix(&camera_matrix)),
                ..*self.options
            };
            self.is_sound_by(&options, planes)
        })
    }

    /// Whether the planes answer other options with a margin.
    fn is_sound_by(&self, options: &Options<L>, planes: &[ObservedPlane]) -> bool {
        if self.work.is_spent() {
            return false;
        }
        let trial = JointProblem::new(self.size, options).within(&self.work);
        trial.optimum(planes).is_ok_and(|found| {
            let conditioning = trial.conditioning(planes, &found);
            let weakest = conditioning.weakest(&found.system, &trial.free, found.covariance_factor);
            weakest.is_none_or(|weakest| weakest.ratio() <= MARGIN)
        })
    }
}
