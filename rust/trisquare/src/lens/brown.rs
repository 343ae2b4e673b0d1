//! The Brown-Conrady lens: three radial and two tangential coefficients (OpenCV's first five).

use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

use super::brown_model::BrownModel;
use super::distortion::DistortionTerm;
use super::line_derivatives::{LineDerivatives, hessian};
use super::plane_distortion::{PlaneDistortion, PlanePixelRay, is_finite};
use super::plane_inverse::Inverse;
use super::{
    Columns, INTRINSICS, Lens, LineDistance, MAX_LENS_COLUMNS, PointMaps, ProjectionJacobian, SKEW,
    assert_count, covering_coefficients, radial,
};
use crate::image_size::ImageSize;

/// Names of the parameters in the order of the Jacobian's columns.
const NAMES: [&str; 10] = ["fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2", SKEW];

/// The column of the skew.
const SKEW_COLUMN: usize = NAMES.len() - 1;

/// Distortion terms of the coefficients `k1, k2, k3, p1, p2`.
const TERMS: [DistortionTerm; 5] = [
    DistortionTerm::Radial(2),
    DistortionTerm::Radial(4),
    DistortionTerm::Radial(6),
    DistortionTerm::TangentialY,
    DistortionTerm::TangentialX,
];

/// Prior standard deviations of the displacements by `k1, k2, k3, p1, p2` at the picture's corner,
/// as a fraction of its radius: `k1 r^2, k2 r^4, k3 r^6, p1 r, p2 r`. Lenses displace the corner by
/// up to 0.3 of its radius, each further radial term by about half as much as the one before, and
/// decentred elements by some thousandths.
const PRIOR_EFFECTS: [Effect; 5] = [(0.2, 2), (0.1, 4), (0.05, 6), (0.002, 1), (0.002, 1)];

/// Displacement of a picture's corner by a coefficient, as a fraction of the corner's radius, and
/// the power of that radius in it.
pub(super) type Effect = (f64, i32);

/// Returns the coefficients that have the given effects at the corner of a lens's picture.
///
/// The corner's radius is limited to 1: lenses that see more than 45 degrees from their axis have
/// coefficients like those of `atan`, 1/3, 1/5, 1/7.
pub(super) fn coefficients_of(effects: &[Effect], lens: &impl Lens, size: ImageSize) -> Vec<f64> {
    let focal = lens.focal();
    let corner = (size.half_diagonal() / (focal.x * focal.y).sqrt()).min(1.0);
    let effects = effects.iter();
    effects
        .map(|(effect, power)| effect / corner.powi(*power))
        .collect()
}

/// Pinhole camera with Brown-Conrady distortion.
///
/// `x_d = x (1 + k1 s + k2 s^2 + k3 s^3) + 2 p1 x y + p2 (s + 2 x^2)`, likewise `y_d`, with
/// `s = x^2 + y^2` of the ideal point; the pixel is `(fx x_d + skew y_d + cx, fy y_d + cy)`
/// (D. C. Brown, Photogrammetric Engineering 32 (1966) 444-462; OpenCV's convention).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brown {
    /// `fx, fy, cx, cy` (pixels), `k1, k2, k3, p1, p2`.
    parameters: [f64; 9],
    /// Pixels.
    skew: f64,
    /// Ideal radius up to which the distortion is trusted; at most that up to which it is
    /// monotonic.
    valid_radius: f64,
    /// `A^-1`, stored because every pixel needs it.
    inverse_focal: Matrix2<f64>,
}

impl Brown {
    /// Creates a lens from `fx, fy, cx, cy, k1, k2, k3, p1, p2`, without skew. The focal lengths
    /// must be positive: calibrations and files are checked for that, this function does not check
    /// it.
    pub fn new(parameters: [f64; 9]) -> Self {
        let [fx, fy, _, _, k1, k2, k3, p1, p2] = parameters;
        Self {
            parameters,
            skew: 0.0,
            valid_radius: radial::invertible_radius([k1, k2, k3], [p1, p2]),
            inverse_focal: Matrix2::new(1.0 / fx, 0.0, 0.0, 1.0 / fy),
        }
    }

    /// Returns the same lens with a skew, in pixels.
    #[must_use]
    pub fn with_skew(self, skew: f64) -> Self {
        let skewed = Self { skew, ..self };
        Self {
            inverse_focal: skewed.inverse_focal_matrix(),
            ..skewed
        }
    }
}

impl PlaneDistortion for Brown {
    fn trusted_radius(&self) -> f64 {
        self.valid_radius
    }

    fn is_radial(&self) -> bool {
        let [.., p1, p2] = self.parameters;
        p1 == 0.0 && p2 == 0.0
    }

    /// `1 + k1 s + k2 s^2 + k3 s^3`.
    fn radial_factor(&self, square: f64) -> f64 {
        let [_, _, _, _, k1, k2, k3, ..] = self.parameters;
        1.0 + square * (k1 + square * (k2 + square * k3))
    }

    fn radial_slopes(&self, square: f64) -> (f64, f64) {
        let [_, _, _, _, k1, k2, k3, ..] = self.parameters;
        (
            k1 + square * (2.0 * k2 + square * 3.0 * k3),
            2.0 * k2 + square * 6.0 * k3,
        )
    }

    fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        let [.., p1, p2] = self.parameters;
        let (x, y) = (ideal.x, ideal.y);
        let square = x * x + y * y;
        ideal * self.radial_factor(square)
            + Vector2::new(
                2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
    }

    /// The Jacobian, which is symmetric.
    fn distortion_jacobian(&self, ideal: &Vector2<f64>) -> Matrix2<f64> {
        let [.., p1, p2] = self.parameters;
        let (x, y, square) = (ideal.x, ideal.y, ideal.norm_squared());
        let factor = self.radial_factor(square);
        let slope = 2.0 * self.radial_slopes(square).0;
        let xy = slope * x * y + 2.0 * (p1 * x + p2 * y);
        Matrix2::new(
            factor + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            xy,
            xy,
            factor + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )
    }
}

impl Lens for Brown {
    type PixelRay = PlanePixelRay;
    type Model = BrownModel;

    fn parameter_names() -> &'static [&'static str] {
        &NAMES
    }

    fn centre_columns() -> Range<usize> {
        NAMES.len()..NAMES.len() + 2
    }

    fn from_camera_matrix(camera_matrix: &Matrix3<f64>) -> Self {
        let k = camera_matrix;
        Self::new([k.m11, k.m22, k.m13, k.m23, 0.0, 0.0, 0.0, 0.0, 0.0]).with_skew(k.m12)
    }

    /// Returns the lens with the forward coefficients `(k1, k2, k3)` that fit best over the radii
    /// which the image covers.
    fn from_straightening(
        camera_matrix: &Matrix3<f64>,
        ideal_radius: impl Fn(f64) -> f64,
        size: ImageSize,
        model: BrownModel,
    ) -> Self {
        let pinhole = Self::from_camera_matrix(camera_matrix);
        let count = model.radial_coefficients();
        if count == 0 {
            return pinhole;
        }
        let [fx, fy, cx, cy] = pinhole.intrinsics();
        let focal = (fx * fy).sqrt();
        let ideal = |r: f64| ideal_radius(r * focal) / focal;
        let found = covering_coefficients(ideal, (size, pinhole.principal_point(), focal), count);
        let mut k = [0.0; 3];
        for (k, value) in k.iter_mut().zip(found) {
            *k = value;
        }
        Self::new([fx, fy, cx, cy, k[0], k[1], k[2], 0.0, 0.0]).with_skew(camera_matrix.m12)
    }

    fn intrinsics(&self) -> [f64; INTRINSICS] {
        let [fx, fy, cx, cy, ..] = self.parameters;
        [fx, fy, cx, cy]
    }

    fn skew(&self) -> f64 {
        self.skew
    }

    fn parameters(&self) -> Vec<f64> {
        [&self.parameters[..], &[self.skew]].concat()
    }

    fn with_parameters(&self, parameters: &[f64]) -> Self {
        assert_count::<Self>(parameters);
        let mut values = self.parameters;
        values.copy_from_slice(&parameters[..SKEW_COLUMN]);
        Self::new(values).with_skew(parameters[SKEW_COLUMN])
    }

    /// `k1, k2, p1, p2, k3`.
    fn distortion(&self) -> Vec<f64> {
        let [.., k1, k2, k3, p1, p2] = self.parameters;
        vec![k1, k2, p1, p2, k3]
    }

    fn coefficient_priors(&self, size: ImageSize) -> Vec<f64> {
        coefficients_of(&PRIOR_EFFECTS, self, size)
    }

    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let pixel = self.pixel_of(&self.seen(point)?);
        is_finite(&pixel).then_some(pixel)
    }

    /// Beyond the valid radius, returns the pixel of a pinhole.
    fn project_extended(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.project(point)
            .unwrap_or_else(|| self.pixel_of(&(point.xy() / point.z)))
    }

    fn projection_jacobian(&self, pixel_ray: &PlanePixelRay) -> ProjectionJacobian {
        let shifts = TERMS.iter().map(|term| term.shift(&pixel_ray.ideal));
        pixel_ray.projection_jacobian(&self.focal_matrix(), shifts)
    }

    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<PlanePixelRay> {
        let distorted = self.inverse_focal * (pixel - self.principal_point());
        let ideal = self.undistort(&distorted)?;
        Some(PlanePixelRay::of(self, ideal, distorted))
    }

    fn direction(&self, pixel_ray: &PlanePixelRay) -> Vector3<f64> {
        pixel_ray.direction()
    }

    fn direction_jacobian(&self, pixel_ray: &PlanePixelRay) -> Matrix3x2<f64> {
        pixel_ray.direction_jacobian(&self.inverse_focal)
    }

    fn valid_radius(&self) -> f64 {
        self.valid_radius
    }

    fn within(self, radius: f64) -> Self {
        Self {
            valid_radius: self.valid_radius.min(radius),
            ..self
        }
    }

    fn valid_angle(&self) -> f64 {
        self.valid_radius.atan()
    }

    /// The image of the disc of valid radius `R` reaches at least
    /// `R (1 + k1 R^2 + ...) - 3 |q| R^2`, `q = (p2, p1)`, in every direction; the least focal
    /// length converts this to pixels.
    fn valid_pixel_radius(&self) -> f64 {
        let radius = self.valid_radius;
        if radius.is_infinite() {
            return radius;
        }
        let [.., p1, p2] = self.parameters;
        let square = radius * radius;
        let reach = radius * self.radial_factor(square) - 3.0 * p1.hypot(p2) * square;
        reach.max(0.0) * self.least_focal()
    }

    fn line_distance_and_normal(
        &self,
        pixel_ray: &PlanePixelRay,
        line: &Vector3<f64>,
    ) -> (f64, Vector2<f64>) {
        pixel_ray.line_distance_and_normal(line, &self.inverse_focal)
    }

    fn line_distance_jacobian(
        &self,
        pixel_ray: &PlanePixelRay,
        line: &Vector3<f64>,
        wanted: Columns,
    ) -> LineDistance {
        let [.., p1, p2] = self.parameters;
        let (u, s) = (pixel_ray.ideal, pixel_ray.square);
        let slopes = self.radial_slopes(s);
        let derivatives = LineDerivatives::new(pixel_ray, line, &self.inverse_focal, |q, v| {
            hessian(u, (q, v), slopes, [p1, p2])
        });
        let mut wrt_lens = [0.0; MAX_LENS_COLUMNS];
        let wrt_camera_matrix = derivatives.intrinsics();
        wrt_lens[..INTRINSICS].copy_from_slice(&wrt_camera_matrix.intrinsics);
        wrt_lens[SKEW_COLUMN] = wrt_camera_matrix.skew;
        wrt_lens[4] = derivatives.radial(s, 1.0);
        wrt_lens[5] = derivatives.radial(s * s, 2.0 * s);
        if wanted.contains(6) {
            wrt_lens[6] = derivatives.radial(s * s * s, 3.0 * s * s);
        }
        if wanted.contains(7) {
            wrt_lens[7] = derivatives.tangential(1);
            wrt_lens[8] = derivatives.tangential(0);
        }
        wrt_lens[Self::centre_columns()].copy_from_slice(&derivatives.centre());
        LineDistance {
            value: derivatives.value,
            wrt_line: derivatives.wrt_line(),
            wrt_lens,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unproject_inverts_project() {
        let lens = Brown::new([1000.0, 1010.0, 640.0, 470.0, -0.3, 0.1, 0.02, 0.003, -0.002]);
        for (x, y) in [(0.0, 0.0), (0.4, -0.3), (-0.6, 0.5), (0.1, 0.7)] {
            let ray = Vector3::new(x, y, 1.0);
            let pixel = lens.project(&ray).unwrap();
            let back = lens.unproject(&pixel).unwrap();
            assert!((back - ray.normalize()).norm() < 1e-13);
        }
    }

    #[test]
    fn nothing_comes_back_from_beyond_the_valid_radius() {
        let lens = Brown::new([1000.0, 1000.0, 500.0, 500.0, -0.3, 0.0, 0.0, 0.0, 0.0]);
        assert!((lens.valid_radius() - (1.0f64 / 0.9).sqrt()).abs() < 1e-12);
        let largest = lens.valid_radius() * 2.0 / 3.0 * 1000.0;
        assert!(
            lens.unproject(&Vector2::new(500.0 + largest - 1.0, 500.0))
                .is_some()
        );
        assert!(
            lens.unproject(&Vector2::new(500.0 + largest + 1.0, 500.0))
                .is_none()
        );
        assert!(lens.unproject(&Vector2::new(f64::NAN, 500.0)).is_none());
        assert!(lens.project(&Vector3::new(1.2, 0.0, 1.0)).is_none());
        assert!(lens.project(&Vector3::new(0.0, 0.0, -1.0)).is_none());
    }
}
