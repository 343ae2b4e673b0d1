//! Points of a plane from the pixels at which they are seen, and their covariance.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix, Vector2};

use super::projection::ProjectionUncertainty;
use crate::error::Error;
use crate::geometry::Pose;
use crate::lens::{Lens, ProjectionJacobian, of_all};
use crate::result::PoseUncertainty;

/// Cosine of the angle between ray and normal below which a point's position is meaningless.
const GRAZING: f64 = 1e-3;

/// The point at which a pixel's ray meets a plane.
struct PlanePoint {
    /// The point in the plane's coordinates and unit.
    point: Vector2<f64>,
    by_pixel: Matrix2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    /// Derivative of the pixel of the point's direction with respect to the lens's parameters.
    by_lens: ProjectionJacobian,
}

/// Returns the points of a plane that are seen at pixels, in the plane's own coordinates and unit.
///
/// ```
/// use nalgebra::Vector2;
/// use trisquare::{Calibration, Error, points_on_plane};
///
/// /// How far apart two pixels lie on the plane of the first square, whose side is 84 mm.
/// fn millimetres(found: &Calibration, pixels: [Vector2<f64>; 2]) -> Result<f64, Error> {
///     let points = points_on_plane(&found.camera, &found.planes[0].pose, &pixels)?;
///     Ok(84.0 * (points[1] - points[0]).norm())
/// }
/// ```
///
/// # Errors
/// [`Error::BeyondValidRadius`], [`Error::InvalidArgument`] for a pixel at or beyond the plane's
/// horizon, or [`Error::NotFinite`] for a pixel, a pose, or a point that is not finite.
pub fn points_on_plane<L: Lens>(
    lens: &L,
    pose: &Pose,
    pixels: &[Vector2<f64>],
) -> Result<Vec<Vector2<f64>>, Error> {
    let intersections = intersect(lens, pose, pixels)?;
    Ok(intersections
        .iter()
        .map(|intersection| intersection.point)
        .collect())
}

/// Intersects the rays of pixels with a plane.
///
/// The direction `d` of a pixel meets the plane at `lambda d = R (p, 0) + t`. A change of the point
/// of the plane by `s` in camera coordinates, or of the direction by `-s / lambda`, moves `p` so
/// that `[r1 r2 -d] (dp, dlambda) = -s`; a rotation vector `w` gives `s = w x R (p, 0)`.
fn intersect<L: Lens>(
    lens: &L,
    pose: &Pose,
    pixels: &[Vector2<f64>],
) -> Result<Vec<PlanePoint>, Error> {
    let mut numbers = pose.rotation.iter().chain(pose.translation.iter());
    if !numbers.all(|v| v.is_finite()) {
        return Err(Error::NotFinite { what: "the pose" });
    }
    let rays = of_all(lens, pixels, |pixel| lens.unproject_with_jacobian(pixel))?;
    let normal = pose.normal();
    let distance = normal.dot(&pose.translation);
    let intersect = |(index, (ray, pixel)): (usize, (&L::PixelRay, &Vector2<f64>))| {
        let direction = lens.direction(ray);
        let normal_part = normal.dot(&direction);
        // A ray meets the plane ahead of the camera if it points to the plane's side.
        if !(distance.signum() * normal_part > GRAZING * direction.norm()) {
            return Err(Error::InvalidArgument(format!(
                "point {index}, ({}, {}), is at or beyond the plane's horizon",
                pixel.x, pixel.y
            )));
        }
        let depth = distance / normal_part;
        let arm = direction * depth - pose.translation;
        let point = (pose.rotation.transpose() * arm).xy();
        if !point.iter().all(|v| v.is_finite()) {
            return Err(Error::NotFinite {
                what: "a point of the plane",
            });
        }
        let (x, y) = (pose.rotation.column(0), pose.rotation.column(1));
        let system = Matrix3::from_columns(&[x.into(), y.into(), -direction]);
        let inverse = system.try_inverse().ok_or(Error::NotFinite {
            what: "the derivative of a point of a plane",
        })?;
        let inverse = inverse.fixed_rows::<2>(0).into_owned();
        let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
        by_pose
            .fixed_columns_mut::<3>(0)
            .copy_from(&(inverse * arm.cross_matrix()));
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-inverse);
        Ok(PlanePoint {
            point,
            by_pixel: inverse * lens.direction_jacobian(ray) * depth,
            by_pose,
            by_lens: lens.projection_jacobian(ray),
        })
    };
    rays.iter().zip(pixels).enumerate().map(intersect).collect()
}

impl<L: Lens> ProjectionUncertainty<'_, L> {
    /// Returns the points of a plane that are seen at pixels, and their covariance, `(2 N, 2 N)` of
    /// `x0, y0, x1, ...`.
    ///
    /// The covariance contains the contributions of the pixels (`pixel_std`, one standard deviation
    /// of each coordinate), the pose and the camera, jointly: the pose follows the camera.
    ///
    /// # Errors
    /// As [`points_on_plane`]; [`Error::InvalidArgument`] for a `pixel_std` that is negative or not
    /// finite, or an uncertainty of another lens; [`Error::NotFinite`] for a covariance that is not
    /// finite.
    pub fn points_on_plane(
        &self,
        pose: &Pose,
        uncertainty: &PoseUncertainty,
        pixels: &[Vector2<f64>],
        pixel_std: f64,
    ) -> Result<(Vec<Vector2<f64>>, DMatrix<f64>), Error> {
        if !(pixel_std >= 0.0 && pixel_std.is_finite()) {
            return Err(Error::InvalidArgument(format!(
                "the standard deviation of pixels must be finite and not negative, not {pixel_std}"
            )));
        }
        let pose_by_free = self.pose_by_free(uncertainty)?;
        let intersections = intersect(self.camera(), pose, pixels)?;
        let (rows, variance) = (2 * intersections.len(), pixel_std * pixel_std);
        let mut covariance = DMatrix::zeros(rows, rows);
        let mut by_pose = DMatrix::zeros(rows, 6);
        let mut by_camera = DMatrix::zeros(rows, self.free().len());
        for (i, intersection) in intersections.iter().enumerate() {
            let pixel_covariance =
                intersection.by_pixel * intersection.by_pixel.transpose() * variance;
            covariance
                .fixed_view_mut::<2, 2>(2 * i, 2 * i)
                .copy_from(&pixel_covariance);
            by_pose
                .fixed_rows_mut::<2>(2 * i)
                .copy_from(&intersection.by_pose);
            // If a parameter moves the pixel of a fixed ray forward, it moves the ray of a fixed
            // pixel back.
            let ray_change = intersection.by_pixel * self.free().of(&intersection.by_lens);
            let pose_change = intersection.by_pose * &pose_by_free;
            by_camera
                .rows_mut(2 * i, 2)
                .copy_from(&(pose_change - ray_change));
        }
        covariance += &by_pose * uncertainty.given_camera * by_pose.transpose();
        covariance += &by_camera * self.free().covariance() * by_camera.transpose();
        if !covariance.iter().all(|v| v.is_finite()) {
            return Err(Error::NotFinite {
                what: "the covariance of points of a plane",
            });
        }
        Ok((
            intersections
                .iter()
                .map(|intersection| intersection.point)
                .collect(),
            covariance,
        ))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Rotation3, Vector3};

    use super::*;
    use crate::lens::Brown;

    fn camera() -> Brown {
        Brown::new([500.0, 505.0, 320.0, 240.0, -0.25, 0.08, -0.01, 2e-3, -1e-3])
    }

    fn pose() -> Pose {
        Pose {
            rotation: *Rotation3::from_euler_angles(0.5, -0.4, 1.0).matrix(),
            translation: Vector3::new(0.3, -0.2, 3.0),
        }
    }

    #[test]
    fn points_come_back_and_derivatives_agree_with_central_differences() {
        let (camera, pose) = (camera(), pose());
        let point = Vector2::new(0.4, -0.7);
        let pixel = camera.project(&pose.transform(&point)).unwrap();
        let intersection = &intersect(&camera, &pose, &[pixel]).unwrap()[0];
        assert!((intersection.point - point).norm() < 1e-12);
        let at = |pose: &Pose, pixel| points_on_plane(&camera, pose, &[pixel]).unwrap()[0];
        for axis in 0..2 {
            let step = Vector2::ith(axis, 1e-3);
            let numeric = (at(&pose, pixel + step) - at(&pose, pixel - step)) / 2e-3;
            assert!((numeric - intersection.by_pixel.column(axis)).norm() < 1e-9);
        }
        for i in 0..6 {
            let by = |size: f64| {
                let step = nalgebra::Vector6::ith(i, size);
                let (turn, shift) = (step.fixed_rows::<3>(0), step.fixed_rows::<3>(3));
                at(&pose.moved(&turn.into_owned(), &shift.into_owned()), pixel)
            };
            let numeric = (by(1e-6) - by(-1e-6)) / 2e-6;
            assert!(
                (numeric - intersection.by_pose.column(i)).norm() < 1e-8,
                "{i}"
            );
        }
    }

    #[test]
    fn a_camera_s_error_that_the_pose_follows_moves_no_point_of_it() {
        // The principal point moves, and every pixel with it: only a pose that does not follow the
        // camera is wrong.
        let camera = camera().without_distortion();
        let uncertain =
            ProjectionUncertainty::new(&camera, &["cx"], false, DMatrix::identity(1, 1)).unwrap();
        let mut uncertainty = PoseUncertainty {
            given_camera: Matrix6::zeros(),
            by_camera: nalgebra::Matrix6xX::zeros(10),
        };
        let pixels = [Vector2::new(300.0, 200.0), Vector2::new(350.0, 260.0)];
        let (points, covariance) = uncertain
            .points_on_plane(&pose(), &uncertainty, &pixels, 0.0)
            .unwrap();
        let moved = Brown::new([500.0, 505.0, 321.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let others = points_on_plane(&moved, &pose(), &pixels).unwrap();
        for i in 0..2 {
            let change = (others[i] - points[i]).norm();
            let std = covariance.view((2 * i, 2 * i), (2, 2)).trace().sqrt();
            assert!((change / std - 1.0).abs() < 0.01);
        }
        uncertainty.given_camera = Matrix6::identity();
        let (_, more) = uncertain
            .points_on_plane(&pose(), &uncertainty, &pixels, 0.5)
            .unwrap();
        assert!((0..4).all(|i| more[(i, i)] > covariance[(i, i)]));

        let refused = |uncertainty: &PoseUncertainty, pixel_std| {
            uncertain.points_on_plane(&pose(), uncertainty, &pixels, pixel_std)
        };
        for pixel_std in [-1.0, f64::NAN] {
            let found = refused(&uncertainty, pixel_std);
            assert!(matches!(found, Err(Error::InvalidArgument(_))), "{found:?}");
        }
        uncertainty.given_camera[(0, 0)] = f64::NAN;
        let found = refused(&uncertainty, 0.5);
        assert!(matches!(found, Err(Error::NotFinite { .. })), "{found:?}");
        uncertainty.by_camera = nalgebra::Matrix6xX::zeros(2);
        let found = refused(&uncertainty, 0.5);
        assert!(matches!(found, Err(Error::InvalidArgument(_))), "{found:?}");
    }

    #[test]
    fn no_pose_and_no_pixel_gives_a_point_that_is_nan() {
        let pixel = Vector2::new(320.0, 240.0);
        for far in [f64::NAN, f64::INFINITY, f64::MAX] {
            let moved = Pose {
                translation: Vector3::repeat(far),
                ..pose()
            };
            let found = points_on_plane(&camera(), &moved, &[pixel]);
            assert!(found.is_err(), "{found:?}");
        }
        let found = points_on_plane(&camera(), &pose(), &[Vector2::new(f64::NAN, 0.0)]);
        assert!(matches!(found, Err(Error::NotFinite { .. })), "{found:?}");
    }

    #[test]
    fn the_horizon_is_refused() {
        let (camera, mut pose) = (camera().without_distortion(), pose());
        pose.rotation = *Rotation3::from_euler_angles(1.5, 0.0, 0.0).matrix();
        pose.translation = Vector3::new(0.0, 1.0, 3.0);
        let found = points_on_plane(&camera, &pose, &[Vector2::new(320.0, 0.0)]);
        assert!(found.is_err(), "{found:?}");
    }
}
