//! Common parts of the lenses that distort the normalised plane of a pinhole.

use nalgebra::{Matrix2, Matrix3x2, Vector2, Vector3};

use super::ProjectionJacobian;

/// A map `u_d = d(u)` from ideal to observed normalised points.
///
/// Up to the trusted radius it is invertible, and its radial part, `u F(s)` with `s = u . u`,
/// increases.
pub(super) trait PlaneDistortion {
    /// Ideal radius up to which the distortion is trusted.
    fn trusted_radius(&self) -> f64;

    /// Whether the distortion is radial only.
    fn is_radial(&self) -> bool;

    /// `F(s)`.
    fn radial_factor(&self, square: f64) -> f64;

    /// The first and second derivative of `F` with respect to `s`.
    fn radial_slopes(&self, square: f64) -> (f64, f64);

    /// Maps an ideal normalised point to the observed one.
    fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64>;

    /// `J = d(observed)/d(ideal)`.
    fn distortion_jacobian(&self, ideal: &Vector2<f64>) -> Matrix2<f64>;

    /// Returns the observed normalised point of a point in camera coordinates; `None` behind the
    /// camera and beyond the trusted radius.
    fn seen(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let ideal = point.xy() / point.z;
        let is_seen = point.z > 0.0 && ideal.norm() <= self.trusted_radius();
        is_seen.then(|| self.distort(&ideal))
    }
}

/// Whether neither the point nor its squared norm has overflowed.
pub(super) fn is_finite(point: &Vector2<f64>) -> bool {
    point.norm_squared().is_finite()
}

pub(super) fn adjugate(m: &Matrix2<f64>) -> Matrix2<f64> {
    Matrix2::new(m.m22, -m.m12, -m.m21, m.m11)
}

/// A pixel unprojected to its ideal point, with the quantities that its derivatives need.
#[derive(Debug, Clone, Copy)]
pub struct PlanePixelRay {
    pub(super) ideal: Vector2<f64>,
    pub(super) distorted: Vector2<f64>,
    pub(super) square: f64,
    /// `J^-1`.
    pub(super) inverse: Matrix2<f64>,
}

impl PlanePixelRay {
    /// Creates it from an ideal point and its observed point.
    pub(super) fn of(
        lens: &impl PlaneDistortion,
        ideal: Vector2<f64>,
        distorted: Vector2<f64>,
    ) -> Self {
        let jacobian = lens.distortion_jacobian(&ideal);
        Self {
            ideal,
            distorted,
            square: ideal.norm_squared(),
            inverse: adjugate(&jacobian) * (1.0 / jacobian.determinant()),
        }
    }

    /// The ideal normalised image point `(x, y)`.
    pub fn ideal(&self) -> Vector2<f64> {
        self.ideal
    }

    pub(super) fn direction(&self) -> Vector3<f64> {
        self.ideal.push(1.0)
    }

    /// Derivative of the direction with respect to the pixel; `inverse_focal` is `A^-1`.
    pub(super) fn direction_jacobian(&self, inverse_focal: &Matrix2<f64>) -> Matrix3x2<f64> {
        (self.inverse * inverse_focal).insert_row(2, 0.0)
    }

    /// Signed distance in pixels to the image of a line, and the unit normal of the image.
    pub(super) fn line_distance_and_normal(
        &self,
        line: &Vector3<f64>,
        inverse_focal: &Matrix2<f64>,
    ) -> (f64, Vector2<f64>) {
        let gradient = self.inverse.tr_mul(&line.xy());
        let gradient = inverse_focal.tr_mul(&gradient);
        let norm = gradient.norm();
        let distance = (line.xy().dot(&self.ideal) + line.z) / norm;
        (distance, gradient / norm)
    }

    /// Derivative of the pixel `A u_d + c` with respect to `fx, fy, cx, cy`, the coefficients, each
    /// of which moves the observed point by its shift, and the skew.
    pub(super) fn projection_jacobian(
        &self,
        focal: &Matrix2<f64>,
        shifts: impl Iterator<Item = Vector2<f64>>,
    ) -> ProjectionJacobian {
        let mut jacobian = ProjectionJacobian::zeros();
        for axis in 0..2 {
            jacobian[(axis, axis)] = self.distorted[axis];
            jacobian[(axis, 2 + axis)] = 1.0;
        }
        let mut column = super::INTRINSICS;
        for shift in shifts {
            jacobian.set_column(column, &(focal * shift));
            column += 1;
        }
        jacobian[(0, column)] = self.distorted.y;
        jacobian
    }
}
