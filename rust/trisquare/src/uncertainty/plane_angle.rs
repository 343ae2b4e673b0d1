//! The angle between two planes of one picture, and its standard deviation.

use nalgebra::Vector6;

use super::projection::ProjectionUncertainty;
use crate::error::Error;
use crate::geometry::Pose;
use crate::lens::Lens;
use crate::result::PoseUncertainty;

/// Sine of the angle between planes above which their normals determine its axis.
const MIN_SINE: f64 = 1e-9;

impl<L: Lens> ProjectionUncertainty<'_, L> {
    /// Returns the angle between the normals of two planes of one picture, 0 to pi, and its
    /// standard deviation, both in radians. It is meaningless for planes of different pictures: the
    /// camera may have turned.
    ///
    /// Both poses follow the camera. A rotation `w` of a plane changes its normal `n` by `w x n`,
    /// and so the angle about its axis `a`, the unit vector along `n x n'`, by `a . (w' - w)`. The
    /// estimated angle of parallel planes is never negative: planes within some standard deviations
    /// of 0 may be parallel.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an uncertainty of another lens, [`Error::NotFinite`] for a
    /// pose or an uncertainty that is not finite.
    pub fn angle_between(
        &self,
        planes: [(&Pose, &PoseUncertainty); 2],
    ) -> Result<(f64, f64), Error> {
        let [first, second] = planes.map(|(pose, _)| pose.normal());
        let across = first.cross(&second);
        let sine = across.norm();
        let axis = match sine > MIN_SINE {
            true => across / sine,
            false => planes[0].0.rotation.column(0).into_owned(),
        };
        let axis_rotation = Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0);
        let [first_uncertainty, second_uncertainty] = planes.map(|(_, uncertainty)| uncertainty);
        let by_camera = (self.pose_by_free(second_uncertainty)?
            - self.pose_by_free(first_uncertainty)?)
        .tr_mul(&axis_rotation);
        let given_camera = first_uncertainty.given_camera + second_uncertainty.given_camera;
        let variance = axis_rotation.dot(&(given_camera * axis_rotation))
            + by_camera.dot(&(self.free().covariance() * &by_camera));
        let angle = sine.atan2(first.dot(&second));
        if !(angle.is_finite() && variance.is_finite()) {
            return Err(Error::NotFinite {
                what: "the angle between two planes",
            });
        }
        Ok((angle, variance.max(0.0).sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, Matrix6, Matrix6xX, Rotation3, Vector3};

    use super::*;
    use crate::calibrate::calibrate;
    use crate::lens::Brown;
    use crate::observations::Options;
    use crate::synthetic::{Scene, SceneOptions};

    fn angle(one: &Pose, other: &Pose) -> f64 {
        one.normal().angle(&other.normal())
    }

    #[test]
    fn errors_over_many_scenes_are_as_large_as_stated() {
        let mut squares = Vec::new();
        for seed in 0..40 {
            let scene = Scene::random(seed, SceneOptions::default());
            let edges = scene.edges(seed, 0.2, 6.0);
            let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
            let uncertainty = found.projection_uncertainty().unwrap();
            for (one, other) in [(0, 1), (0, 2), (1, 2)] {
                let [first, second] = [one, other].map(|plane: usize| {
                    let plane = &found.planes[plane];
                    (&plane.pose, plane.uncertainty.as_ref().unwrap())
                });
                let (value, std) = uncertainty.angle_between([first, second]).unwrap();
                let truth = angle(&scene.poses[one], &scene.poses[other]);
                squares.push(((value - truth) / std).powi(2));
            }
        }
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((0.8..1.2).contains(&rms), "{rms}");
    }

    #[test]
    fn parallel_planes_have_an_angle_of_zero_and_its_uncertainty() {
        let camera = Brown::new([500.0, 500.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let exact = ProjectionUncertainty::new(&camera, &[], false, DMatrix::zeros(0, 0)).unwrap();
        let pose = Pose {
            rotation: *Rotation3::from_euler_angles(0.5, -0.4, 1.0).matrix(),
            translation: Vector3::new(0.3, -0.2, 3.0),
        };
        let mut uncertainty = PoseUncertainty {
            given_camera: Matrix6::identity() * 1e-6,
            by_camera: Matrix6xX::zeros(10),
        };
        let (value, std) = exact.angle_between([(&pose, &uncertainty); 2]).unwrap();
        assert_eq!(value, 0.0);
        assert!((std - 2e-6_f64.sqrt()).abs() < 1e-12);

        uncertainty.given_camera[(0, 0)] = f64::NAN;
        let found = exact.angle_between([(&pose, &uncertainty); 2]);
        assert!(matches!(found, Err(Error::NotFinite { .. })), "{found:?}");
        uncertainty.by_camera = Matrix6xX::zeros(2);
        let found = exact.angle_between([(&pose, &uncertainty); 2]);
        assert!(matches!(found, Err(Error::InvalidArgument(_))), "{found:?}");
    }
}
