//! The pose of a plane: `cam_from_plane` from a camera matrix and a homography.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};

use crate::error::Error;

/// Largest length of a column of a homography, scaled so that the two have a geometric mean of 1;
/// larger ones show no plane in any picture.
const MAX_STRETCH: f64 = 1e8;

/// Sine of an angle below which it is rounding: columns that span no plane, or a plane seen
/// edge-on.
const MIN_SINE: f64 = 1e-12;

/// Largest distance of the plane's origin, in the plane's unit; no picture shows the unit from
/// farther.
const MAX_DISTANCE: f64 = 1e12;

/// Maximum number of sweeps of the 3 x 3 singular value decomposition; a handful suffice.
const MAX_SVD_SWEEPS: usize = 100;

/// A rigid motion `X_cam = R X_plane + t`; lengths in the plane's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pose {
    /// The rotation `R`.
    pub rotation: Matrix3<f64>,
    /// The translation `t`.
    pub translation: Vector3<f64>,
}

#[cfg(feature = "serde")]
crate::stored::read_checked!(Pose {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
});

impl Pose {
    /// Checks that this is a rigid motion.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if it is not, [`Error::NotFinite`] for a translation with NaN or
    /// infinity.
    #[cfg(feature = "serde")]
    fn check(&self) -> Result<(), Error> {
        let gap = (self.rotation.transpose() * self.rotation - Matrix3::identity()).norm();
        // Written so that NaN is refused, too.
        if !(gap < crate::stored::CUT_DIGITS && self.rotation.determinant() > 0.0) {
            return Err(Error::InvalidArgument(
                "the rotation of a pose must be a rotation matrix: columns of length 1 at right \
                 angles, determinant 1"
                    .into(),
            ));
        }
        if !self.translation.iter().all(|v| v.is_finite()) {
            return Err(Error::NotFinite {
                what: "the translation of a pose",
            });
        }
        Ok(())
    }

    /// The pose that a homography `H_image_from_plane ~ K [r1 r2 t]` implies, with the plane's
    /// point `witness` in front of the camera.
    ///
    /// The scale makes the geometric mean of the lengths of `r1` and `r2` equal to 1; the rotation
    /// is the one nearest to `[r1 r2 r1 x r2]` in the Frobenius norm (Zhang, IEEE PAMI 22 (2000),
    /// appendix C).
    ///
    /// # Errors
    /// [`Error::NotFinite`] for NaN or infinity, [`Error::DegenerateHomography`] if the homography
    /// or the camera matrix is singular, or if they show a plane through the camera's centre or at
    /// no finite distance.
    pub fn from_homography(
        camera_matrix: &Matrix3<f64>,
        homography: &Matrix3<f64>,
        witness: &Vector2<f64>,
    ) -> Result<Self, Error> {
        let singular = || Error::DegenerateHomography {
            figure: 0,
            reason: "it is singular",
        };
        for (values, what) in [
            (camera_matrix.as_slice(), "a camera matrix"),
            (homography.as_slice(), "a homography"),
            (witness.as_slice(), "a point of the plane"),
        ] {
            if !values.iter().all(|value| value.is_finite()) {
                return Err(Error::NotFinite { what });
            }
        }
        let inverse = camera_matrix.try_inverse().ok_or_else(singular)?;
        let columns = inverse * homography;
        let (c1, c2) = (columns.column(0), columns.column(1));
        let mut scale = 1.0 / (c1.norm() * c2.norm()).sqrt();
        if (columns * witness.push(1.0)).z * scale < 0.0 {
            scale = -scale;
        }
        let (r1, r2) = (c1 * scale, c2 * scale);
        let translation = columns.column(2) * scale;
        let is_stretched = !(r1.norm() < MAX_STRETCH && r2.norm() < MAX_STRETCH);
        if is_stretched || !translation.iter().all(|v| v.is_finite()) {
            return Err(singular());
        }
        let (normal, distance) = (r1.cross(&r2), translation.norm());
        let depth = (columns * witness.push(1.0)).z * scale;
        // Written so that NaN is refused, too.
        let is_regular =
            normal.norm() > MIN_SINE && normal.dot(&translation).abs() > MIN_SINE * distance;
        if !(is_regular && depth > 0.0 && (1.0 / MAX_DISTANCE..MAX_DISTANCE).contains(&distance)) {
            return Err(singular());
        }
        let approximate_rotation = Matrix3::from_columns(&[r1, r2, normal]);
        let svd = approximate_rotation
            .try_svd(true, true, f64::EPSILON, MAX_SVD_SWEEPS)
            .ok_or_else(singular)?;
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            return Err(singular());
        };
        let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant()));
        Ok(Self {
            rotation: u * sign * v_t,
            translation,
        })
    }

    /// The homography `[r1 r2 t]` from the plane to normalised image coordinates.
    pub fn homography(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[
            self.rotation.column(0).into_owned(),
            self.rotation.column(1).into_owned(),
            self.translation,
        ])
    }

    /// The matrix `L` with `l = L (a, b, c)`: `l` is the normal of the plane through the camera
    /// centre and the line `a X + b Y + c = 0` of this plane, oriented so that `l . X_cam` has the
    /// sign of `a X + b Y + c` wherever `r3 . t > 0`.
    pub fn line_map(&self) -> Matrix3<f64> {
        let [r1, r2, r3] = [0, 1, 2].map(|i| self.rotation.column(i).into_owned());
        Matrix3::from_columns(&[r2.cross(&self.translation), self.translation.cross(&r1), r3])
    }

    /// The pose after a further small rotation (a rotation vector in the camera frame) and
    /// translation.
    #[must_use]
    pub fn moved(&self, rotation: &Vector3<f64>, translation: &Vector3<f64>) -> Self {
        Self {
            rotation: Rotation3::new(*rotation).matrix() * self.rotation,
            translation: self.translation + translation,
        }
    }

    /// Maps a point of the plane to camera coordinates.
    pub fn transform(&self, point: &Vector2<f64>) -> Vector3<f64> {
        self.rotation * point.push(0.0) + self.translation
    }

    /// The plane's normal `r3` in camera coordinates.
    pub fn normal(&self) -> Vector3<f64> {
        self.rotation.column(2).into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> (Matrix3<f64>, Pose) {
        let camera_matrix = Matrix3::new(1000.0, 0.0, 640.0, 0.0, 1010.0, 480.0, 0.0, 0.0, 1.0);
        let pose = Pose {
            rotation: *Rotation3::from_euler_angles(0.5, -0.4, 1.0).matrix(),
            translation: Vector3::new(0.3, -0.2, 3.0),
        };
        (camera_matrix, pose)
    }

    #[test]
    fn pose_survives_the_homography_at_any_scale() {
        let (camera_matrix, pose) = example();
        for scale in [1.0, -0.3, 1e-6, -1e6] {
            let homography = camera_matrix * pose.homography() * scale;
            let found =
                Pose::from_homography(&camera_matrix, &homography, &Vector2::zeros()).unwrap();
            assert!((found.rotation - pose.rotation).norm() < 1e-12);
            assert!((found.translation - pose.translation).norm() < 1e-12);
        }
        let singular = Matrix3::zeros();
        assert!(Pose::from_homography(&camera_matrix, &singular, &Vector2::zeros()).is_err());
    }

    #[test]
    fn a_homography_that_shows_no_plane_is_refused() {
        let (camera_matrix, pose) = example();
        let columns = |a: Vector3<f64>, b: Vector3<f64>, t: Vector3<f64>| {
            let homography = camera_matrix * Matrix3::from_columns(&[a, b, t]);
            Pose::from_homography(&camera_matrix, &homography, &Vector2::zeros())
        };
        let [r1, r2] = [0, 1].map(|i| pose.rotation.column(i).into_owned());
        let t = pose.translation;
        assert!(columns(r1, r2, t).is_ok());
        let singular = [
            (r1, r2, t * 0.0),
            (r1, r2, t * 1e-300),
            (r1, r2, t * 1e300),
            (r1, r2, r1 + r2),
            (r1, r2, Vector3::new(1.0, 0.0, 0.0)),
            (r1, r1 * 2.0, t),
            (r1, r2 * 0.0, t),
            (r1 * 1e-200, r2 * 1e-200, t),
        ];
        for (a, b, t) in singular {
            let found = columns(a, b, t);
            let refused = matches!(found, Err(Error::DegenerateHomography { .. }));
            assert!(refused, "{a} {b} {t}: {found:?}");
        }
        let found = columns(r1 * f64::NAN, r2, t);
        let what = "a homography";
        assert_eq!(found, Err(Error::NotFinite { what }));
        let (homography, unknown) = (pose.homography(), Vector2::new(f64::NAN, 0.0));
        let found = Pose::from_homography(&camera_matrix, &homography, &unknown);
        let what = "a point of the plane";
        assert_eq!(found, Err(Error::NotFinite { what }));
    }

    #[test]
    fn line_map_keeps_incidence_and_sign() {
        let (_, pose) = example();
        let line = Vector3::new(0.6, -0.8, 0.2);
        let seen = pose.line_map() * line;
        let depth = pose.normal().dot(&pose.translation);
        for (x, y) in [(0.1, 0.2), (-0.5, 0.5), (0.0, 0.25)] {
            let point = Vector2::new(x, y);
            let expected = depth * line.dot(&point.push(1.0));
            assert!((seen.dot(&pose.transform(&point)) - expected).abs() < 1e-14);
        }
    }
}
