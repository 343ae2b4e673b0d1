//! The simplest lens besides the pinhole: `r = f theta`, without coefficients.

use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};
use trisquare::lens::{Columns, INTRINSICS, LineDistance, MAX_LENS_COLUMNS, ProjectionJacobian};
use trisquare::{DistortionModel, ImageSize, Lens};

/// Number of terms of the power series: up to 180 degrees, only rounding errors remain.
const TERMS: i32 = 20;

/// Equidistant lens: the angle between a ray and the axis is the distance of the pixel from the
/// principal point divided by the focal length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equidistant {
    pub intrinsics: [f64; INTRINSICS],
}

/// The law has no coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NoCoefficients;

impl DistortionModel for NoCoefficients {
    const NESTED: &'static [Self] = &[NoCoefficients];

    fn columns(self) -> Columns {
        Columns::NONE
    }

    fn straightening_coefficients(self) -> usize {
        2
    }
}

/// A pixel in units of the focal lengths, `q`, and its unit ray `(S q, cos theta)`, `S = sin(theta)
/// / theta`, `theta = |q|`.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    q: Vector2<f64>,
    unit: Vector3<f64>,
    /// `S`, `A = S' / theta` and `B = A' / theta`.
    series: [f64; 3],
}

/// Returns `S = sum (-s)^k / (2k + 1)!`, `s = theta^2`, with `A` and `B`: a derivative by `theta`,
/// divided by `theta`, is twice the derivative by `s`.
fn series(s: f64) -> [f64; 3] {
    let (mut sum, mut inverse_factorial) = ([0.0; 3], 1.0);
    for k in 0..TERMS {
        let order = f64::from(2 * k);
        let factors = [1.0, order, order * (order - 2.0)];
        for (power, factor) in (0..=k.min(2)).zip(factors) {
            sum[power as usize] += inverse_factorial * factor * s.powi(k - power);
        }
        inverse_factorial /= -(order + 2.0) * (order + 3.0);
    }
    sum
}

/// Returns `M`, the derivative of a unit ray by `q`.
fn ray_jacobian(ray: &Ray) -> Matrix3x2<f64> {
    let [s, a, _] = ray.series;
    let mut jacobian = Matrix3x2::zeros();
    for i in 0..2 {
        jacobian.set_row(i, &(ray.q * (ray.q[i] * a)).transpose());
        jacobian[(i, i)] += s;
    }
    jacobian.set_row(2, &(-ray.q * s).transpose());
    jacobian
}

impl Equidistant {
    /// Returns the derivative of `n = l . ray` by `q`, and its change with a step of `q`.
    fn gradient(
        ray: &Ray,
        line: &Vector3<f64>,
    ) -> (Vector2<f64>, impl Fn(Vector2<f64>) -> Vector2<f64>) {
        let (q, [s, a, b], along) = (ray.q, ray.series, line.xy());
        let across = along.dot(&q);
        let gradient = along * s + q * (across * a - line.z * s);
        let z = line.z;
        let change = move |step: Vector2<f64>| {
            let out = q.dot(&step);
            along * (a * out)
                + q * (a * along.dot(&step) + across * b * out - z * a * out)
                + step * (across * a - z * s)
        };
        (gradient, change)
    }
}

impl Lens for Equidistant {
    type PixelRay = Ray;
    type Model = NoCoefficients;

    fn parameter_names() -> &'static [&'static str] {
        &["fx", "fy", "cx", "cy"]
    }

    /// None: the principal point is the only centre of the distortion.
    fn centre_columns() -> Range<usize> {
        INTRINSICS..INTRINSICS
    }

    fn from_camera_matrix(k: &Matrix3<f64>) -> Self {
        Self {
            intrinsics: [k.m11, k.m22, k.m13, k.m23],
        }
    }

    fn from_straightening(
        camera_matrix: &Matrix3<f64>,
        _ideal_radius: impl Fn(f64) -> f64,
        _size: ImageSize,
        _model: NoCoefficients,
    ) -> Self {
        Self::from_camera_matrix(camera_matrix)
    }

    fn intrinsics(&self) -> [f64; INTRINSICS] {
        self.intrinsics
    }

    fn parameters(&self) -> Vec<f64> {
        self.intrinsics.to_vec()
    }

    fn with_parameters(&self, parameters: &[f64]) -> Self {
        let mut intrinsics = self.intrinsics;
        intrinsics.copy_from_slice(parameters);
        Self { intrinsics }
    }

    fn coefficient_priors(&self, _size: ImageSize) -> Vec<f64> {
        Vec::new()
    }

    fn distortion(&self) -> Vec<f64> {
        Vec::new()
    }

    fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let radius = point.xy().norm();
        let per_radius = match radius > 0.0 {
            true => radius.atan2(point.z) / radius,
            false if point.z > 0.0 => 0.0,
            false => return None,
        };
        let q = point.xy() * per_radius;
        let pixel = q.component_mul(&self.focal()) + self.principal_point();
        pixel.norm().is_finite().then_some(pixel)
    }

    fn project_extended(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.project(point)
            .unwrap_or_else(|| self.principal_point())
    }

    fn projection_jacobian(&self, ray: &Ray) -> ProjectionJacobian {
        let mut jacobian = ProjectionJacobian::zeros();
        for axis in 0..2 {
            jacobian[(axis, axis)] = ray.q[axis];
            jacobian[(axis, 2 + axis)] = 1.0;
        }
        jacobian
    }

    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<Ray> {
        let q = (pixel - self.principal_point()).component_div(&self.focal());
        let theta = q.norm();
        let series = series(theta * theta);
        (theta < self.valid_radius()).then(|| Ray {
            q,
            unit: (q * series[0]).push(theta.cos()),
            series,
        })
    }

    fn direction(&self, ray: &Ray) -> Vector3<f64> {
        ray.unit
    }

    fn direction_jacobian(&self, ray: &Ray) -> Matrix3x2<f64> {
        ray_jacobian(ray) * Matrix2::from_diagonal(&self.focal().map(|f| 1.0 / f))
    }

    /// The angle from the axis, in radians.
    fn valid_radius(&self) -> f64 {
        std::f64::consts::PI
    }

    /// Returns the lens unchanged: it is valid everywhere.
    fn within(self, _radius: f64) -> Self {
        self
    }

    fn valid_angle(&self) -> f64 {
        self.valid_radius()
    }

    fn valid_pixel_radius(&self) -> f64 {
        self.valid_radius() * self.focal().min()
    }

    fn line_distance_and_normal(&self, ray: &Ray, line: &Vector3<f64>) -> (f64, Vector2<f64>) {
        let (gradient, _) = Self::gradient(ray, line);
        let gradient = gradient.component_div(&self.focal());
        let norm = gradient.norm();
        (line.dot(&ray.unit) / norm, gradient / norm)
    }

    /// With `g` the gradient of `n = l . ray` by `q`, the distance is `n / |g / f|`. A parameter
    /// changes `q` only; the focal lengths also divide `g`.
    fn line_distance_jacobian(
        &self,
        ray: &Ray,
        line: &Vector3<f64>,
        _wanted: Columns,
    ) -> LineDistance {
        let focal = self.focal();
        let (gradient, change) = Self::gradient(ray, line);
        let norm = gradient.component_div(&focal).norm();
        let value = line.dot(&ray.unit) / norm;
        // d|g / f| = pull . dg
        let pull = gradient.component_div(&focal).component_div(&focal) / norm;
        let mut wrt_lens = [0.0; MAX_LENS_COLUMNS];
        for axis in 0..2 {
            let mut step = Vector2::zeros();
            step[axis] = -1.0 / focal[axis];
            let moved =
                |step: Vector2<f64>| (gradient.dot(&step) - value * pull.dot(&change(step))) / norm;
            wrt_lens[2 + axis] = moved(step);
            let divided = value * pull[axis] * gradient[axis] / (focal[axis] * norm);
            wrt_lens[axis] = moved(step * ray.q[axis]) + divided;
        }
        // g = M^T l
        let by_line = ray_jacobian(ray);
        LineDistance {
            value,
            wrt_line: (ray.unit - by_line * pull * value) / norm,
            wrt_lens,
        }
    }
}
