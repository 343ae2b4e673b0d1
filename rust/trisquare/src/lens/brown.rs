//! The Brown-Conrady lens: three radial and two tangential coefficients (OpenCV's first five).

use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

use super::brown_model::BrownModel;
use super::{
    Columns, INTRINSICS, Lens, LineDistance, MAX_LENS_COLUMNS, PointMaps, ProjectionJacobian,
    covering_coefficients, radial,
};
use crate::image_size::ImageSize;

/// Names of the parameters in the order of the Jacobian's columns.
const NAMES: [&str; 9] = ["fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2"];

/// Prior standard deviations of what `k1, k2, k3, p1, p2` do at the picture's corner, as a part of
/// its radius: `k1 r^2, k2 r^4, k3 r^6, p1 r, p2 r`. Lenses bend it by up to 0.3, each further term
/// does about half as much as the one before, and decentred elements move it by some thousandths.
const PRIOR_EFFECTS: [f64; 5] = [0.2, 0.1, 0.05, 0.002, 0.002];

/// Powers of the corner's radius in these effects. Beyond the radius 1 they count no further: what
/// sees more than 45 degrees from its axis has coefficients like those of `atan`, of 1/3, 1/5, 1/7.
const EFFECT_POWERS: [i32; 5] = [2, 4, 6, 1, 1];

/// Pinhole camera with Brown-Conrady distortion.
///
/// `x_d = x (1 + k1 s + k2 s^2 + k3 s^3) + 2 p1 x y + p2 (s + 2 x^2)`, likewise `y_d`, with
/// `s = x^2 + y^2` of the ideal point; the pixel is `(fx x_d + cx, fy y_d + cy)`
/// (D. C. Brown, Photogrammetric Engineering 32 (1966) 444-462; OpenCV's convention).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Brown {
    /// `fx, fy, cx, cy` (pixels), `k1, k2, k3, p1, p2`.
    pub(super) parameters: [f64; 9],
    /// Ideal radius up to which the distortion is trusted, and at most monotonic.
    pub(super) valid_radius: f64,
    /// `1 / fx, 1 / fy`: every pixel asks for them.
    inverse_focal: Vector2<f64>,
}

/// A pixel followed back to its ideal point, with what its derivatives need.
#[derive(Debug, Clone, Copy)]
pub struct BrownPixelRay {
    ideal: Vector2<f64>,
    distorted: Vector2<f64>,
    square: f64,
    /// Inverse transpose of the distortion's Jacobian.
    inverse_transpose: Matrix2<f64>,
}

impl BrownPixelRay {
    /// The ideal normalised image point `(x, y)`.
    pub fn ideal(&self) -> Vector2<f64> {
        self.ideal
    }
}

impl Brown {
    /// From `fx, fy, cx, cy, k1, k2, k3, p1, p2`.
    pub fn new(parameters: [f64; 9]) -> Self {
        let [fx, fy, _, _, k1, k2, k3, p1, p2] = parameters;
        Self {
            parameters,
            valid_radius: radial::invertible_radius([k1, k2, k3], [p1, p2]),
            inverse_focal: Vector2::new(1.0 / fx, 1.0 / fy),
        }
    }

    /// Maps an ideal normalised point to the observed one.
    pub fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        let [.., p1, p2] = self.parameters;
        let (x, y) = (ideal.x, ideal.y);
        let square = x * x + y * y;
        ideal * self.radial_factor(square)
            + Vector2::new(
                2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
    }

    /// `1 + k1 s + k2 s^2 + k3 s^3`.
    pub(super) fn radial_factor(&self, square: f64) -> f64 {
        let [_, _, _, _, k1, k2, k3, ..] = self.parameters;
        1.0 + square * (k1 + square * (k2 + square * k3))
    }

    /// First and second derivative of the radial factor with respect to `s`.
    pub(super) fn radial_slopes(&self, square: f64) -> (f64, f64) {
        let [_, _, _, _, k1, k2, k3, ..] = self.parameters;
        (
            k1 + square * (2.0 * k2 + square * 3.0 * k3),
            2.0 * k2 + square * 6.0 * k3,
        )
    }

    /// The symmetric Jacobian `d(observed)/d(ideal)`.
    pub(crate) fn distortion_jacobian(&self, ideal: &Vector2<f64>) -> Matrix2<f64> {
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

/// Whether nothing has overflowed.
pub(super) fn is_finite(point: &Vector2<f64>) -> bool {
    point.norm_squared().is_finite()
}

pub(super) fn adjugate(m: &Matrix2<f64>) -> Matrix2<f64> {
    Matrix2::new(m.m22, -m.m12, -m.m21, m.m11)
}

impl Lens for Brown {
    type PixelRay = BrownPixelRay;
    type Model = BrownModel;

    fn parameter_names() -> &'static [&'static str] {
        &NAMES
    }

    fn centre_columns() -> Range<usize> {
        NAMES.len()..NAMES.len() + 2
    }

    fn from_camera_matrix(camera_matrix: &Matrix3<f64>) -> Self {
        let k = camera_matrix;
        Self::new([k.m11, k.m22, k.m13, k.m23, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// With the forward coefficients `(k1, k2, k3)` that fit best over the radii which the image
    /// covers.
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
        Self::new([fx, fy, cx, cy, k[0], k[1], k[2], 0.0, 0.0])
    }

    fn intrinsics(&self) -> [f64; INTRINSICS] {
        let [fx, fy, cx, cy, ..] = self.parameters;
        [fx, fy, cx, cy]
    }

    fn parameters(&self) -> Vec<f64> {
        self.parameters.to_vec()
    }

    fn with_parameters(&self, parameters: &[f64]) -> Self {
        let mut values = self.parameters;
        values.copy_from_slice(parameters);
        Self::new(values)
    }

    /// `k1, k2, p1, p2, k3`.
    fn distortion(&self) -> Vec<f64> {
        let [.., k1, k2, k3, p1, p2] = self.parameters;
        vec![k1, k2, p1, p2, k3]
    }

    fn coefficient_priors(&self, size: ImageSize) -> Vec<f64> {
        let [fx, fy, ..] = self.parameters;
        let corner = (size.half_diagonal() / (fx * fy).sqrt()).min(1.0);
        let effects = PRIOR_EFFECTS.iter().zip(EFFECT_POWERS);
        effects
            .map(|(effect, power)| effect / corner.powi(power))
            .collect()
    }

    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let ideal = point.xy() / point.z;
        let inside = point.z > 0.0 && ideal.norm() <= self.valid_radius;
        let pixel = self.pixel_of(&self.distort(&ideal));
        (inside && is_finite(&pixel)).then_some(pixel)
    }

    /// Beyond the valid radius where a pinhole would see it.
    fn project_extended(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.project(point)
            .unwrap_or_else(|| self.pixel_of(&(point.xy() / point.z)))
    }

    fn projection_jacobian(&self, pixel_ray: &BrownPixelRay) -> ProjectionJacobian {
        self.jacobian_of_projection(&pixel_ray.ideal)
    }

    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<BrownPixelRay> {
        let distorted = (pixel - self.principal_point()).component_mul(&self.inverse_focal);
        let ideal = self.undistort(&distorted)?;
        let jacobian = self.distortion_jacobian(&ideal);
        Some(BrownPixelRay {
            ideal,
            distorted,
            square: ideal.norm_squared(),
            // The Jacobian is symmetric, so its inverse is its own transpose.
            inverse_transpose: adjugate(&jacobian) * (1.0 / jacobian.determinant()),
        })
    }

    fn direction(&self, pixel_ray: &BrownPixelRay) -> Vector3<f64> {
        pixel_ray.ideal.push(1.0)
    }

    fn direction_jacobian(&self, pixel_ray: &BrownPixelRay) -> Matrix3x2<f64> {
        // The inverse is symmetric, as the Jacobian of the distortion is.
        let by_pixel = pixel_ray.inverse_transpose * Matrix2::from_diagonal(&self.inverse_focal);
        by_pixel.insert_row(2, 0.0)
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
    /// `R (1 + k1 R^2 + ...) - 3 |q| R^2`, `q = (p2, p1)`, in every direction; the smaller focal
    /// length makes it pixels.
    fn valid_pixel_radius(&self) -> f64 {
        let radius = self.valid_radius;
        if radius.is_infinite() {
            return radius;
        }
        let [.., p1, p2] = self.parameters;
        let square = radius * radius;
        let reach = radius * self.radial_factor(square) - 3.0 * p1.hypot(p2) * square;
        reach.max(0.0) * self.focal().min()
    }

    fn line_distance_and_normal(
        &self,
        pixel_ray: &BrownPixelRay,
        line: &Vector3<f64>,
    ) -> (f64, Vector2<f64>) {
        let pulled = pixel_ray.inverse_transpose * line.xy();
        let gradient = pulled.component_mul(&self.inverse_focal);
        let norm = gradient.norm();
        let distance = (line.xy().dot(&pixel_ray.ideal) + line.z) / norm;
        (distance, gradient / norm)
    }

    /// With `u` the ideal point, `J = du_d/du`, `q = J^-T (l1, l2)` and `G = q / f`, the distance
    /// is `n / |G|`, `n = l . (u, 1)`. A parameter moves `u` (the pixel stays) by
    /// `-J^-1 du_d`, hence `dn = -q . du_d`; and `J^T q = (l1, l2)` gives
    /// `dq = -J^-T (d(J^T) q)`, where the change of `J^T q` at constant `q` is the gradient of
    /// `q . u_d`, differentiated by the parameter, plus its Hessian times `du`.
    fn line_distance_jacobian(
        &self,
        pixel_ray: &BrownPixelRay,
        line: &Vector3<f64>,
        wanted: Columns,
    ) -> LineDistance {
        let [.., p1, p2] = self.parameters;
        let BrownPixelRay {
            ideal: u,
            distorted,
            square: s,
            inverse_transpose,
        } = *pixel_ray;
        let q = inverse_transpose * line.xy();
        let gradient = q.component_mul(&self.inverse_focal);
        let inverse_norm = 1.0 / gradient.norm();
        let numerator = line.xy().dot(&u) + line.z;
        let value = numerator * inverse_norm;

        // d(value) = (dn - value d|G|) / |G|, d|G| = G . dG / |G| = (G / f) . dq / |G| + ...
        let unit = gradient * inverse_norm;
        let unit_over_focal = unit.component_mul(&self.inverse_focal);
        // d|G| = pull . (J^T dq): the change of J^T q, contracted.
        let pull = inverse_transpose * unit_over_focal;

        let (slope, curvature) = self.radial_slopes(s);
        let qu = q.dot(&u);
        let hessian_u = |v: Vector2<f64>| {
            let (uv, qv) = (u.dot(&v), q.dot(&v));
            let tangential = Vector2::new(
                (6.0 * p2 * q.x + 2.0 * p1 * q.y) * v.x + 2.0 * (p1 * q.x + p2 * q.y) * v.y,
                2.0 * (p1 * q.x + p2 * q.y) * v.x + (2.0 * p2 * q.x + 6.0 * p1 * q.y) * v.y,
            );
            q * (2.0 * slope * uv)
                + u * (2.0 * slope * qv + 4.0 * curvature * qu * uv)
                + v * (2.0 * slope * qu)
                + tangential
        };
        // How |G| answers to a movement of u: -(H pull) . du, with H symmetric.
        let hessian_pull = hessian_u(pull);
        // The same for du = J^-1 d(u_d), so that a change of u_d is all that is needed.
        let bend = inverse_transpose * hessian_pull;

        // A change `shift` of u_d at fixed pixel, and `twist` of J^T q at fixed u.
        let column = |shift: Vector2<f64>, twist: Vector2<f64>| {
            let dn = -q.dot(&shift);
            let dg = -pull.dot(&twist) + bend.dot(&shift);
            (dn - value * dg) * inverse_norm
        };
        let radial = |power: i32, lower: f64| {
            let twist = u * (2.0 * f64::from(power) * lower * qu);
            column(u * (lower * s), q * (lower * s) + twist)
        };
        // u_d of the tangential part by the coefficient of its `along` axis.
        let tangential = |along: usize| {
            let across = 1 - along;
            let (mut shift, mut twist) = (Vector2::zeros(), Vector2::zeros());
            shift[along] = s + 2.0 * u[along] * u[along];
            shift[across] = 2.0 * u.x * u.y;
            twist[along] = 6.0 * q[along] * u[along] + 2.0 * q[across] * u[across];
            twist[across] = 2.0 * (q.x * u.y + q.y * u.x);
            column(shift, twist)
        };
        // fx, cx move the observed point itself: the pixel is fixed, u_d = (p - c) / f changes.
        let moved = |axis: usize, amount: f64| {
            let mut shift = Vector2::zeros();
            shift[axis] = -amount;
            column(shift, Vector2::zeros())
        };
        // G = q / f also holds f itself.
        let focal_column = |axis: usize| {
            moved(axis, -distorted[axis] * self.inverse_focal[axis])
                + value * inverse_norm * unit[axis] * gradient[axis] * self.inverse_focal[axis]
        };

        let mut wrt_lens = [0.0; MAX_LENS_COLUMNS];
        wrt_lens[0] = focal_column(0);
        wrt_lens[1] = focal_column(1);
        wrt_lens[2] = moved(0, -self.inverse_focal.x);
        wrt_lens[3] = moved(1, -self.inverse_focal.y);
        wrt_lens[4] = radial(1, 1.0);
        wrt_lens[5] = radial(2, s);
        if wanted.contains(6) {
            wrt_lens[6] = radial(3, s * s);
        }
        if wanted.contains(7) {
            wrt_lens[7] = tangential(1);
            wrt_lens[8] = tangential(0);
        }
        // A centre of distortion at e: u_d = e + D(u - e), so du_d = (I - J) de.
        let centre = (line.xy() - q) * inverse_norm;
        wrt_lens[9] = centre.x;
        wrt_lens[10] = centre.y;

        let along = u.push(1.0) * inverse_norm;
        let bent = pull * (value * inverse_norm);
        LineDistance {
            value,
            wrt_line: along - Vector3::new(bent.x, bent.y, 0.0),
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
