//! The fisheye lens of Kannala and Brandt with four coefficients (`cv2.fisheye`).

use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};

use super::line_derivatives::CameraMatrixDerivatives;
use super::{
    Columns, DistortionModel, INTRINSICS, Lens, LineDistance, MAX_LENS_COLUMNS, PointMaps,
    ProjectionJacobian, SKEW, assert_count, covering_coefficients, sign_changes,
};
use crate::image_size::ImageSize;

/// Number of coefficients.
const COEFFICIENTS: usize = 4;

/// Names of the parameters in the order of the Jacobian's columns.
const NAMES: [&str; INTRINSICS + COEFFICIENTS + 1] =
    ["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", SKEW];

/// The column of the skew.
const SKEW_COLUMN: usize = NAMES.len() - 1;

/// Prior standard deviations of the effect of each coefficient at a field angle of one radian, as a
/// fraction of that angle. The projection laws of lenses, from `sin` to `2 tan(theta / 2)`, have
/// first coefficients from -1/6 to 1/12, and each further term has about half the effect.
const PRIOR_EFFECTS: [f64; COEFFICIENTS] = [0.1, 0.05, 0.025, 0.0125];

/// Maximum number of steps to unproject a pixel: Newton steps, or bisections where a Newton step
/// leaves the bracket.
const MAX_STEPS: usize = 100;

/// Newton step, as a fraction of the angle, below which the iteration ends: each step squares the
/// error, so that the next one would be rounding.
const LAST_STEP: f64 = 1e-10;

/// Squared observed radius below which the power series is exact to rounding.
const NEAR_AXIS: f64 = 1e-6;

/// The coefficients of a [`Fisheye`] lens that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum FisheyeModel {
    /// None: the observed radius is the angle to the axis.
    Equidistant,
    /// `k1`.
    Fisheye1,
    /// `k1, k2`.
    Fisheye2,
    /// `k1, k2, k3, k4`.
    #[default]
    Fisheye,
}

impl FisheyeModel {
    /// Number of coefficients.
    pub fn coefficients(self) -> usize {
        match self {
            Self::Equidistant => 0,
            Self::Fisheye1 => 1,
            Self::Fisheye2 => 2,
            Self::Fisheye => COEFFICIENTS,
        }
    }
}

impl DistortionModel for FisheyeModel {
    const NESTED: &'static [Self] = &[
        FisheyeModel::Equidistant,
        FisheyeModel::Fisheye1,
        FisheyeModel::Fisheye2,
        FisheyeModel::Fisheye,
    ];

    fn columns(self) -> Columns {
        Columns::of(INTRINSICS..INTRINSICS + self.coefficients())
    }

    fn straightening_coefficients(self) -> usize {
        2
    }
}

/// A lens that maps the angle `theta` of a ray to the axis to the distance `theta (1 + k1 theta^2 +
/// k2 theta^4 + k3 theta^6 + k4 theta^8)` from the principal point, in units of the focal lengths;
/// the pixel of the observed point is `(fx x_d + skew y_d + cx, fy y_d + cy)`.
///
/// J. Kannala & S. S. Brandt, IEEE Trans. Pattern Anal. Mach. Intell. 28 (2006) 1335-1340, without
/// their asymmetric terms. Rays at angles up to 180 degrees are projected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fisheye {
    /// `fx, fy, cx, cy` (pixels), `k1, k2, k3, k4`.
    parameters: [f64; INTRINSICS + COEFFICIENTS],
    /// Pixels.
    skew: f64,
    /// Angle up to which the observed radius increases, radians.
    valid_angle: f64,
}

/// An unprojected pixel, with the quantities that its derivatives need.
///
/// With `w = A^-1 (p - c)` the observed point of the pixel (here `A` is the focal matrix) and
/// `s = |w|^2`, the unit ray is `(A w, C)`, `A = sin(theta) / |w|`, `C = cos(theta)`.
#[derive(Debug, Clone, Copy)]
pub struct FisheyePixelRay {
    w: Vector2<f64>,
    square: f64,
    theta: f64,
    /// `sin(theta)`.
    sine: f64,
    /// `cos(theta)`.
    cosine: f64,
    /// `theta / |w|`.
    inverse_factor: f64,
    /// `d theta / d|w|`.
    inverse_slope: f64,
    /// `d (d|w| / d theta) / d theta / theta`.
    curvature: f64,
    /// `1 / (2 s)`.
    inverse_square: f64,
    /// `A` and its first and second derivative with respect to `s`.
    a: [f64; 3],
    /// The first and second derivative of `C` with respect to `s`.
    c: [f64; 2],
}

impl Fisheye {
    /// Creates a lens from `fx, fy, cx, cy, k1, k2, k3, k4`, without skew.
    pub fn new(parameters: [f64; INTRINSICS + COEFFICIENTS]) -> Self {
        let [.., k1, k2, k3, k4] = parameters;
        // The slope as a polynomial of the squared angle.
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4];
        let turning_angle = sign_changes(&slope, PI * PI).first().map(|t| t.sqrt());
        Self {
            parameters,
            skew: 0.0,
            valid_angle: turning_angle.unwrap_or(PI),
        }
    }

    /// Returns the same lens with a skew, in pixels.
    #[must_use]
    pub fn with_skew(self, skew: f64) -> Self {
        Self { skew, ..self }
    }

    fn coefficients(&self) -> [f64; COEFFICIENTS] {
        let [.., k1, k2, k3, k4] = self.parameters;
        [k1, k2, k3, k4]
    }

    /// `M`, the derivative of a unit ray with respect to `w`.
    fn ray_jacobian(ray: &FisheyePixelRay) -> Matrix3x2<f64> {
        let mut jacobian = Matrix3x2::zeros();
        for i in 0..2 {
            jacobian.set_row(i, &(ray.w * (2.0 * ray.a[1] * ray.w[i])).transpose());
            jacobian[(i, i)] += ray.a[0];
        }
        jacobian.set_row(2, &(ray.w * (2.0 * ray.c[0])).transpose());
        jacobian
    }

    /// Returns, for an angle, the ratio of the observed radius to the angle, the derivative of that
    /// radius, and the ratio of its second derivative to the angle.
    fn factor_slope_curvature(&self, theta: f64) -> [f64; 3] {
        let [k1, k2, k3, k4] = self.coefficients();
        let t = theta * theta;
        [
            1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))),
            1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))),
            6.0 * k1 + t * (20.0 * k2 + t * (42.0 * k3 + t * 72.0 * k4)),
        ]
    }

    /// Returns the angle that is seen at an observed radius; `None` beyond the valid angle.
    fn angle(&self, observed: f64) -> Option<f64> {
        let (mut low, mut high) = (0.0, self.valid_angle);
        let [rim, ..] = self.factor_slope_curvature(high);
        if !(observed <= high * rim) {
            return None;
        }
        let mut theta = observed.min(high);
        for _ in 0..MAX_STEPS {
            let [factor, slope, _] = self.factor_slope_curvature(theta);
            let excess = theta * factor - observed;
            match excess > 0.0 {
                true => high = theta,
                false => low = theta,
            }
            let newton = theta - excess / slope;
            if (newton - theta).abs() <= LAST_STEP * theta {
                return Some(newton.clamp(low, high));
            }
            theta = match low < newton && newton < high {
                true => newton,
                false => 0.5 * (low + high),
            };
        }
        Some(theta)
    }

    /// Sets `A`, its derivatives with respect to `s` and those of `C`; near the axis by the power
    /// series.
    fn with_series(&self, mut ray: FisheyePixelRay) -> FisheyePixelRay {
        let (s, inverse) = (ray.square, ray.inverse_square);
        let (p, f) = (ray.inverse_slope, ray.inverse_factor);
        ray.a = if s < NEAR_AXIS {
            let [k1, k2, ..] = self.coefficients();
            let (first, second) = (-k1 - 1.0 / 6.0, 3.0 * k1 * k1 - k2 + 0.5 * k1 + 1.0 / 120.0);
            [
                1.0 + s * (first + s * second),
                first + 2.0 * s * second,
                2.0 * second,
            ]
        } else {
            let a = ray.sine * f / ray.theta;
            let first = (ray.cosine * p - a) * inverse;
            // d(C / slope) / ds
            let change = -0.5 * p * p * (a + ray.cosine * ray.curvature * f * p);
            [a, first, (change - 3.0 * first) * inverse]
        };
        let [a, first, _] = ray.a;
        ray.c = [
            -0.5 * a * p,
            0.5 * p * (0.5 * a * ray.curvature * f * p * p - first),
        ];
        ray
    }

    /// Returns the derivative of `n = l . ray` with respect to `w`, and a function that gives its
    /// change by a step of `w`.
    fn gradient(
        ray: &FisheyePixelRay,
        line: &Vector3<f64>,
    ) -> (Vector2<f64>, impl Fn(Vector2<f64>) -> Vector2<f64>) {
        let (w, [a, a1, a2], [c1, c2], along) = (ray.w, ray.a, ray.c, line.xy());
        let across = along.dot(&w);
        let radial = 2.0 * (a1 * across + c1 * line.z);
        let z = line.z;
        let change = move |step: Vector2<f64>| {
            let radial_step = 2.0 * w.dot(&step);
            along * (a1 * radial_step)
                + w * (2.0 * a1 * along.dot(&step) + 2.0 * radial_step * (a2 * across + c2 * z))
                + step * radial
        };
        (along * a + w * radial, change)
    }

    /// Returns the derivatives of `n` and of its gradient by `w` with respect to a coefficient at a
    /// fixed pixel; `power` is `theta^(2 index + 2)`.
    #[inline]
    fn coefficient_derivatives(
        &self,
        ray: &FisheyePixelRay,
        line: &Vector3<f64>,
        (index, power): (usize, f64),
    ) -> (f64, Vector2<f64>) {
        let (s, p, a) = (ray.square, ray.inverse_slope, ray.a[0]);
        // The angle changes by -theta power / slope.
        let relative_turn = power * p;
        let da = -ray.cosine * ray.inverse_factor * relative_turn;
        let dc = ray.sine * ray.theta * relative_turn;
        let order = (2 * index + 3) as f64;
        let dp = order * power - ray.curvature * ray.theta * ray.theta * relative_turn;
        let da1 = if s < NEAR_AXIS {
            let [k1, ..] = self.coefficients();
            match index {
                0 => -1.0 + 2.0 * s * (6.0 * k1 + 0.5),
                1 => -2.0 * s,
                _ => 0.0,
            }
        } else {
            ((dc - ray.cosine * dp * p) * p - da) * ray.inverse_square
        };
        let dc1 = 0.5 * p * (a * dp * p - da);
        let (w, along) = (ray.w, line.xy());
        let across = along.dot(&w);
        (
            across * da + line.z * dc,
            along * da + w * (2.0 * (da1 * across + dc1 * line.z)),
        )
    }
}

impl Lens for Fisheye {
    type PixelRay = FisheyePixelRay;
    type Model = FisheyeModel;

    fn parameter_names() -> &'static [&'static str] {
        &NAMES
    }

    /// None: a fisheye distorts directions about the principal point and nowhere else.
    fn centre_columns() -> Range<usize> {
        NAMES.len()..NAMES.len()
    }

    fn from_camera_matrix(k: &Matrix3<f64>) -> Self {
        Self::new([k.m11, k.m22, k.m13, k.m23, 0.0, 0.0, 0.0, 0.0]).with_skew(k.m12)
    }

    /// Returns the lens with the coefficients that fit best over the radii which the image covers.
    fn from_straightening(
        camera_matrix: &Matrix3<f64>,
        ideal_radius: impl Fn(f64) -> f64,
        size: ImageSize,
        model: FisheyeModel,
    ) -> Self {
        let plain = Self::from_camera_matrix(camera_matrix);
        if model == FisheyeModel::Equidistant {
            return plain;
        }
        let count = model.coefficients();
        let [fx, fy, ..] = plain.intrinsics();
        let focal = (fx * fy).sqrt();
        let angle = |radius: f64| (ideal_radius(radius * focal) / focal).atan();
        let picture = (size, plain.principal_point(), focal);
        let mut parameters = plain.parameters;
        let found = covering_coefficients(angle, picture, count);
        parameters[INTRINSICS..]
            .iter_mut()
            .zip(found)
            .for_each(|(k, value)| *k = value);
        Self::new(parameters).with_skew(plain.skew)
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

    /// `k1, k2, k3, k4`.
    fn distortion(&self) -> Vec<f64> {
        self.coefficients().to_vec()
    }

    fn coefficient_priors(&self, _size: ImageSize) -> Vec<f64> {
        PRIOR_EFFECTS.to_vec()
    }

    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let radius = point.xy().norm();
        let theta = radius.atan2(point.z);
        let is_seen = theta <= self.valid_angle && (radius > 0.0 || point.z > 0.0);
        let pixel = self.project_extended(point);
        (is_seen && pixel.norm().is_finite()).then_some(pixel)
    }

    /// Beyond the valid angle, returns the pixel at that angle in the same direction from the axis.
    fn project_extended(&self, point: &Vector3<f64>) -> Vector2<f64> {
        let radius = point.xy().norm();
        if radius == 0.0 {
            return self.principal_point();
        }
        let theta = radius.atan2(point.z).min(self.valid_angle);
        let [factor, ..] = self.factor_slope_curvature(theta);
        let w = point.xy() * (theta * factor / radius);
        self.focal_matrix() * w + self.principal_point()
    }

    fn projection_jacobian(&self, ray: &FisheyePixelRay) -> ProjectionJacobian {
        let mut jacobian = ProjectionJacobian::zeros();
        jacobian[(0, SKEW_COLUMN)] = ray.w.y;
        let offset = self.focal_matrix() * ray.w;
        for axis in 0..2 {
            jacobian[(axis, axis)] = ray.w[axis];
            jacobian[(axis, 2 + axis)] = 1.0;
            // At a fixed angle, coefficient i changes the radius by theta^(2 i + 1) times its own
            // change.
            let mut change = offset[axis] * ray.inverse_factor;
            for column in INTRINSICS..SKEW_COLUMN {
                change *= ray.theta * ray.theta;
                jacobian[(axis, column)] = change;
            }
        }
        jacobian
    }

    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<FisheyePixelRay> {
        let w = self.normalised(pixel);
        let theta = self.angle(w.norm())?;
        let (sine, cosine) = theta.sin_cos();
        let [factor, slope, curvature] = self.factor_slope_curvature(theta);
        Some(self.with_series(FisheyePixelRay {
            w,
            square: w.norm_squared(),
            theta,
            sine,
            cosine,
            inverse_factor: factor.recip(),
            inverse_slope: slope.recip(),
            curvature,
            inverse_square: 0.5 / w.norm_squared(),
            a: [0.0; 3],
            c: [0.0; 2],
        }))
    }

    fn direction(&self, ray: &FisheyePixelRay) -> Vector3<f64> {
        (ray.w * ray.a[0]).push(ray.cosine)
    }

    fn direction_jacobian(&self, ray: &FisheyePixelRay) -> Matrix3x2<f64> {
        Self::ray_jacobian(ray) * self.inverse_focal_matrix()
    }

    /// The field angle, radians.
    fn valid_radius(&self) -> f64 {
        self.valid_angle
    }

    fn within(self, angle: f64) -> Self {
        Self {
            valid_angle: self.valid_angle.min(angle),
            ..self
        }
    }

    fn valid_angle(&self) -> f64 {
        self.valid_angle
    }

    fn valid_pixel_radius(&self) -> f64 {
        let [factor, ..] = self.factor_slope_curvature(self.valid_angle);
        self.valid_angle * factor * self.least_focal()
    }

    fn line_distance_and_normal(
        &self,
        ray: &FisheyePixelRay,
        line: &Vector3<f64>,
    ) -> (f64, Vector2<f64>) {
        let (gradient, _) = Self::gradient(ray, line);
        let gradient = self.inverse_focal_matrix().tr_mul(&gradient);
        let norm = gradient.norm();
        (line.dot(&self.direction(ray)) / norm, gradient / norm)
    }

    /// With `g` the gradient of `n = l . ray` by `w`, the distance is `n / |A^-T g|`. The focal
    /// lengths, the skew and the principal point change `w`, and all but the principal point change
    /// `A^-T` as well; a coefficient changes `n` and `g` at a fixed `w`.
    fn line_distance_jacobian(
        &self,
        ray: &FisheyePixelRay,
        line: &Vector3<f64>,
        wanted: Columns,
    ) -> LineDistance {
        let inverse_focal = self.inverse_focal_matrix();
        let (gradient, change) = Self::gradient(ray, line);
        let pixel_gradient = inverse_focal.tr_mul(&gradient);
        let inverse_norm = pixel_gradient.norm().recip();
        let unit = self.direction(ray);
        let value = line.dot(&unit) * inverse_norm;
        // d|A^-T g| = pull . dg
        let norm_gradient = inverse_focal * pixel_gradient * inverse_norm;
        let distance_change =
            |dn: f64, dg: Vector2<f64>| (dn - value * norm_gradient.dot(&dg)) * inverse_norm;
        let mut wrt_lens = [0.0; MAX_LENS_COLUMNS];
        let wrt_step = |step: Vector2<f64>| distance_change(gradient.dot(&step), change(step));
        let wrt_camera_matrix = CameraMatrixDerivatives::new(
            [
                wrt_step(-inverse_focal.column(0)),
                wrt_step(-inverse_focal.column(1)),
            ],
            ray.w,
            pixel_gradient * (value * inverse_norm),
            norm_gradient,
        );
        wrt_lens[..INTRINSICS].copy_from_slice(&wrt_camera_matrix.intrinsics);
        wrt_lens[SKEW_COLUMN] = wrt_camera_matrix.skew;
        let mut power = 1.0;
        for index in 0..COEFFICIENTS {
            power *= ray.theta * ray.theta;
            if wanted.contains(INTRINSICS + index) {
                let (dn, dg) = self.coefficient_derivatives(ray, line, (index, power));
                wrt_lens[INTRINSICS + index] = distance_change(dn, dg);
            }
        }
        // g = M^T l
        let ray_jacobian = Self::ray_jacobian(ray);
        LineDistance {
            value,
            wrt_line: (unit - ray_jacobian * norm_gradient * value) * inverse_norm,
            wrt_lens,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Fisheye {
        Fisheye::new([420.0, 424.0, 652.0, 471.0, 0.03, -0.012, 0.004, -0.0004]).with_skew(15.0)
    }

    /// Pixels from the axis to far beyond 90 degrees.
    fn pixels() -> impl Iterator<Item = Vector2<f64>> {
        [
            (0.0, 0.0),
            (0.2, -0.1),
            (3.0, -2.0),
            (300.0, 200.0),
            (-600.0, 300.0),
            (700.0, 500.0),
        ]
        .into_iter()
        .map(|(x, y)| lens().principal_point() + Vector2::new(x, y))
    }

    #[test]
    fn a_pixel_comes_back_and_the_distance_vanishes_on_its_line() {
        let lens = lens();
        for pixel in pixels() {
            let ray = lens.unproject(&pixel).unwrap();
            assert!((lens.project(&ray).unwrap() - pixel).norm() < 1e-9);
            let line = ray.cross(&Vector3::new(0.3, -0.5, 0.4));
            let at = |pixel: Vector2<f64>| {
                let ray = lens.unproject_with_jacobian(&pixel).unwrap();
                lens.line_distance_and_normal(&ray, &line)
            };
            let (distance, normal) = at(pixel);
            assert!(distance.abs() < 1e-9);
            // The distance of a pixel that is moved along the normal equals the length of the move.
            let (beside, _) = at(pixel + normal * 1e-3);
            assert!((beside - 1e-3).abs() < 1e-7, "{pixel} {beside}");
        }
        assert!(lens.unproject(&Vector2::new(1e5, 0.0)).is_none());
        assert!(lens.unproject(&Vector2::new(f64::NAN, 0.0)).is_none());
        assert!(lens.project(&Vector3::new(0.0, 0.0, -1.0)).is_none());
    }

    #[test]
    fn jacobians_agree_with_central_differences() {
        let lens = lens();
        let line = Vector3::new(0.4, -0.8, 0.1);
        for pixel in pixels() {
            let distance = |lens: &Fisheye, line: &Vector3<f64>| {
                lens.line_distance(&lens.unproject_with_jacobian(&pixel).unwrap(), line)
            };
            let ray = lens.unproject_with_jacobian(&pixel).unwrap();
            let found = lens.line_distance_jacobian(&ray, &line, Columns::ALL);
            let projection = lens.projection_jacobian(&ray);
            for i in 0..3 {
                let step = Vector3::ith(i, 1e-6);
                let expected =
                    (distance(&lens, &(line + step)) - distance(&lens, &(line - step))) / 2e-6;
                let error = (found.wrt_line[i] - expected).abs();
                assert!(error < 1e-6 * found.wrt_line.norm(), "{pixel} line {i}");
            }
            for i in 0..NAMES.len() {
                let in_pixels = i < INTRINSICS || i == SKEW_COLUMN;
                let step = if in_pixels { 1e-3 } else { 1e-7 };
                let moved = |by: f64| {
                    let mut parameters = lens.parameters();
                    parameters[i] += by;
                    lens.with_parameters(&parameters)
                };
                let expected =
                    (distance(&moved(step), &line) - distance(&moved(-step), &line)) / (2.0 * step);
                let error = (found.wrt_lens[i] - expected).abs();
                let scale = expected.abs().max(1.0);
                assert!(
                    error < 1e-6 * scale,
                    "{pixel} parameter {i}: {error} of {expected}"
                );
                let ray = lens.unproject(&pixel).unwrap();
                let seen = |by: f64| moved(by).project(&ray).unwrap();
                let expected = (seen(step) - seen(-step)) / (2.0 * step);
                let error = (projection.column(i) - expected).norm();
                assert!(
                    error < 1e-6 * expected.norm().max(1.0),
                    "{pixel} {i}: {error}"
                );
            }
        }
    }

    #[test]
    fn it_ends_where_the_radius_no_longer_grows() {
        let lens = Fisheye::new([400.0, 400.0, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0]);
        let rim = (1.0f64 / 0.3).sqrt();
        assert!((lens.valid_radius() - rim).abs() < 1e-12);
        let largest = 400.0 * rim * (1.0 - 0.1 * rim * rim);
        assert!(lens.unproject(&Vector2::new(largest - 1e-6, 0.0)).is_some());
        assert!(lens.unproject(&Vector2::new(largest + 1e-6, 0.0)).is_none());
        let ray = |theta: f64| Vector3::new(theta.sin(), 0.0, theta.cos());
        assert!(lens.project(&ray(rim - 1e-6)).is_some());
        assert!(lens.project(&ray(rim + 1e-6)).is_none());
    }
}
