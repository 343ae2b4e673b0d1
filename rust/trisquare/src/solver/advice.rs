//! Remedies for a geometry that does not determine the camera, verified by further solutions.

use nalgebra::{Matrix3, Vector2};

use super::problem::{Failure, IllConditionedOptimum, JointProblem};
use crate::error::Error;
use crate::ill_conditioning::{IllConditioning, Remedy};
use crate::lens::Lens;
use crate::observations::{Fixed, ObservedPlane, Options};
use crate::refine::Refined;
use crate::uncertainty::{MARGIN, add_remedies};

/// Principal points for each of which fixing it must help, as fractions of the picture's width from
/// its current value: the value that the user will find is unknown yet. Those of most cameras are
/// this near to the image centre.
const PRINCIPAL_POINTS: [(f64, f64); 4] =
    [(0.0, 0.0), (0.015, 0.0), (-0.01, 0.01), (-0.005, -0.015)];

impl<L: Lens> JointProblem<'_, L> {
    /// The error of a failure of some planes; that of a weak geometry includes remedies.
    pub fn advised(&self, planes: &[ObservedPlane], failure: Failure<L>) -> Error {
        let found = match failure {
            Failure::IllConditioned(found) => found,
            Failure::Other(error @ Error::NotConverged { .. }) => {
                let contradicted = self.contradicted_value(planes).map(Box::new);
                return contradicted.map_or(error, Error::IllConditioned);
            }
            Failure::Other(error) => return error,
        };
        let IllConditionedOptimum {
            planes,
            refined,
            mut ill_conditioning,
        } = *found;
        let conditioning = self.conditioning(&planes, &refined);
        let succeeds = |fixed: Fixed| self.is_sound_with_held(fixed, &planes);
        add_remedies(&mut ill_conditioning, &conditioning, succeeds);
        Error::IllConditioned(Box::new(ill_conditioning))
    }

    /// Fixed value of the camera matrix with which no search converges: the focal lengths or the
    /// principal point, if the planes determine the camera without it.
    fn contradicted_value(&self, planes: &[ObservedPlane]) -> Option<IllConditioning> {
        let (fixed, held) = (self.options.fixed, self.options.initial?);
        let pair = |held: Vector2<f64>| (held.x, held.y);
        let (parameter, remedy) = match (fixed.focal, fixed.principal_point) {
            (true, false) => (
                "cx",
                Remedy::FreeFocal {
                    held: pair(held.focal()),
                },
            ),
            (false, true) => {
                let held = pair(held.principal_point());
                ("fx", Remedy::FreePrincipalPoint { held })
            }
            _ => return None,
        };
        let options = Options {
            fixed: Fixed {
                focal: false,
                principal_point: false,
                ..fixed
            },
            ..*self.options
        };
        let trial = JointProblem::new(self.size, &options).with_work(&self.work);
        let found = trial.sound_optimum(planes)?;
        let conditioning = trial.conditioning(planes, &found);
        Some(conditioning.held_refusal(parameter, fixed, remedy))
    }

    /// Whether the planes determine the camera with a margin if `fixed` is held, for any principal
    /// point.
    fn is_sound_with_held(&self, fixed: Fixed, planes: &[ObservedPlane]) -> bool {
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
            self.is_sound_with_options(&options, planes)
        })
    }

    /// Whether the planes determine the camera with a margin under other options.
    fn is_sound_with_options(&self, options: &Options<L>, planes: &[ObservedPlane]) -> bool {
        let trial = JointProblem::new(self.size, options).with_work(&self.work);
        trial.sound_optimum(planes).is_some()
    }

    /// The optimum of planes that determine the camera with a margin; `None` if they do not, or if
    /// no work is left.
    fn sound_optimum(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        let found = self.trial_optimum(planes)?;
        let conditioning = self.conditioning(planes, &found);
        let weakest = conditioning.weakest(&found.system, &self.free, found.covariance_factor);
        let is_sound = weakest.is_none_or(|weakest| weakest.ratio() <= MARGIN);
        is_sound.then_some(found)
    }
}
