//! The lenses of OpenCV's rational and thin prism models.

use std::marker::PhantomData;
use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

use super::brown::{Effect, coefficients_of};
use super::distortion::{DistortionTerm, RadialQuotient, opencv};
use super::line_derivatives::{LineDerivatives, hessian};
use super::plane_distortion::{PlaneDistortion, PlanePixelRay, is_finite};
use super::plane_inverse::Inverse;
use super::rational_model::{OpenCvModel, RationalModel, ThinPrismModel};
use super::rational_radius::rational_radius;
use super::{
    Brown, Columns, INTRINSICS, Lens, LineDistance, MAX_LENS_COLUMNS, PointMaps,
    ProjectionJacobian, SKEW, assert_count,
};
use crate::image_size::ImageSize;

/// Number of coefficients of the richest model.
const COEFFICIENTS: usize = 12;

/// Names of the parameters in the order of the Jacobian's columns.
const RATIONAL_NAMES: [&str; 13] = [
    "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", SKEW,
];
const NAMES: [&str; INTRINSICS + COEFFICIENTS + 1] = [
    "fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4",
    SKEW,
];

/// Indices of the coefficients in OpenCV's order, in the order of the parameters.
const PLACES: [usize; COEFFICIENTS] = [0, 1, 4, 5, 6, 7, 2, 3, 8, 9, 10, 11];

/// Columns of the first coefficient of the numerator, the denominator, the tangential and the prism
/// terms.
const NUMERATOR: usize = INTRINSICS;
const DENOMINATOR: usize = INTRINSICS + 3;
const TANGENTIAL: usize = INTRINSICS + 6;
const PRISM: usize = INTRINSICS + 8;

/// Prior standard deviations of the displacements by the coefficients at the picture's corner, as a
/// fraction of its radius. The denominator's first coefficient has the effect of the numerator's.
/// Each further one has about a sixth of the effect of the one before, as in the quotients that
/// approximate `atan`: larger ones put poles into the picture beyond the samples. Prisms displace
/// the corner by half as much as decentred elements.
const PRIOR_EFFECTS: [Effect; COEFFICIENTS] = [
    (0.2, 2),
    (0.1, 4),
    (0.05, 6),
    (0.2, 2),
    (0.03, 4),
    (0.005, 6),
    (0.002, 1),
    (0.002, 1),
    (0.001, 1),
    (0.0005, 3),
    (0.001, 1),
    (0.0005, 3),
];

/// The lens with OpenCV's rational model: `k1` to `k6`, `p1, p2`.
pub type Rational = OpenCvLens<RationalModel>;

/// The lens with OpenCV's rational model and the terms of a thin prism, `s1` to `s4`.
pub type ThinPrism = OpenCvLens<ThinPrismModel>;

/// Pinhole camera with the first coefficients of OpenCV's distortion.
///
/// `x_d = x (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3) + 2 p1 x y + p2 (s + 2
/// x^2) + s1 s + s2 s^2`, likewise `y_d` with `s3, s4`, and `s = x^2 +
/// y^2` of the ideal point; the pixel is `(fx x_d + skew y_d + cx, fy y_d + cy)` (OpenCV's
/// documentation of `calib3d`, which has no skew; the prism terms by J. Weng, P. Cohen & M.
/// Herniou, IEEE PAMI 14 (1992) 965-980).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenCvLens<M> {
    /// `fx, fy, cx, cy`, pixels.
    intrinsics: [f64; INTRINSICS],
    /// Pixels.
    skew: f64,
    /// Coefficients in OpenCV's order, for a sensor that is not tilted; those that the lens does
    /// not have are zero.
    coefficients: [f64; 14],
    /// Ideal radius up to which the distortion is trusted; at most that up to which it is
    /// monotonic.
    valid_radius: f64,
    model: PhantomData<M>,
}

impl<M: OpenCvModel> OpenCvLens<M> {
    /// Creates a lens from `fx, fy, cx, cy` and the coefficients that the lens has, of `k1` to
    /// `k6`, `p1, p2`, `s1` to `s4`; omitted ones and the skew are zero.
    ///
    /// # Panics
    /// If more coefficients are given than the lens has: 8 for [`Rational`], 12 for [`ThinPrism`].
    pub fn new(intrinsics: [f64; INTRINSICS], given: &[f64]) -> Self {
        let (most, count) = (M::COEFFICIENTS, given.len());
        assert!(
            count <= most,
            "the lens has {most} coefficients, not {count}"
        );
        let mut coefficients = [0.0; 14];
        for (place, value) in PLACES[..M::COEFFICIENTS].iter().zip(given) {
            coefficients[*place] = *value;
        }
        let mut untilted = [0.0; COEFFICIENTS];
        untilted.copy_from_slice(&coefficients[..COEFFICIENTS]);
        Self {
            intrinsics,
            skew: 0.0,
            coefficients,
            valid_radius: rational_radius(&untilted),
            model: PhantomData,
        }
    }

    fn radial(&self) -> RadialQuotient {
        let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.coefficients;
        RadialQuotient {
            numerator: [k1, k2, k3],
            denominator: [k4, k5, k6],
        }
    }

    /// Returns the same lens with a skew, in pixels.
    #[must_use]
    pub fn with_skew(self, skew: f64) -> Self {
        Self { skew, ..self }
    }
}

impl<M: OpenCvModel> PlaneDistortion for OpenCvLens<M> {
    fn trusted_radius(&self) -> f64 {
        self.valid_radius
    }

    fn is_radial(&self) -> bool {
        let [_, _, p1, p2, _, _, _, _, s1, s2, s3, s4, ..] = self.coefficients;
        [p1, p2, s1, s2, s3, s4].iter().all(|c| *c == 0.0)
    }

    fn radial_factor(&self, square: f64) -> f64 {
        let [_, factor, ..] = self.radial().at(square);
        factor
    }

    fn radial_slopes(&self, square: f64) -> (f64, f64) {
        let [_, _, slope, curvature] = self.radial().at(square);
        (slope, curvature)
    }

    fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        opencv(&self.coefficients, ideal).0
    }

    fn distortion_jacobian(&self, ideal: &Vector2<f64>) -> Matrix2<f64> {
        opencv(&self.coefficients, ideal).1
    }
}

impl<M: OpenCvModel> Lens for OpenCvLens<M> {
    type PixelRay = PlanePixelRay;
    type Model = M;

    fn parameter_names() -> &'static [&'static str] {
        match M::COEFFICIENTS {
            COEFFICIENTS => &NAMES,
            _ => &RATIONAL_NAMES,
        }
    }

    fn centre_columns() -> Range<usize> {
        let count = Self::parameter_names().len();
        count..count + 2
    }

    fn from_camera_matrix(k: &Matrix3<f64>) -> Self {
        Self::new([k.m11, k.m22, k.m13, k.m23], &[]).with_skew(k.m12)
    }

    /// Returns the lens that equals Brown's lens of the same straightening.
    fn from_straightening(
        camera_matrix: &Matrix3<f64>,
        ideal_radius: impl Fn(f64) -> f64,
        size: ImageSize,
        model: M,
    ) -> Self {
        let brown = Brown::from_straightening(camera_matrix, ideal_radius, size, model.brown());
        let distortion = brown.distortion();
        Self::new(
            brown.intrinsics(),
            &[distortion[0], distortion[1], distortion[4]],
        )
        .with_skew(brown.skew())
    }

    fn intrinsics(&self) -> [f64; INTRINSICS] {
        self.intrinsics
    }

    fn skew(&self) -> f64 {
        self.skew
    }

    fn parameters(&self) -> Vec<f64> {
        let places = PLACES[..M::COEFFICIENTS].iter();
        let coefficients = places.map(|place| self.coefficients[*place]);
        let first = self.intrinsics.into_iter().chain(coefficients);
        first.chain([self.skew]).collect()
    }

    fn with_parameters(&self, parameters: &[f64]) -> Self {
        assert_count::<Self>(parameters);
        let (first, others) = parameters.split_at(INTRINSICS);
        let mut intrinsics = self.intrinsics;
        intrinsics.copy_from_slice(first);
        Self::new(intrinsics, &others[..M::COEFFICIENTS]).with_skew(others[M::COEFFICIENTS])
    }

    /// `k1, k2, p1, p2, k3, k4, k5, k6`, and `s1, s2, s3, s4` for a lens that has them.
    fn distortion(&self) -> Vec<f64> {
        self.coefficients[..M::COEFFICIENTS].to_vec()
    }

    fn coefficient_priors(&self, size: ImageSize) -> Vec<f64> {
        coefficients_of(&PRIOR_EFFECTS[..M::COEFFICIENTS], self, size)
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

    fn projection_jacobian(&self, ray: &PlanePixelRay) -> ProjectionJacobian {
        let (u, s) = (ray.ideal, ray.square);
        let [denominator, factor, ..] = self.radial().at(s);
        let powers = [s, s * s, s * s * s];
        let numerator_shifts = powers.map(|power| u * (power / denominator));
        let denominator_shifts = powers.map(|power| u * (-factor * power / denominator));
        let tangential = [DistortionTerm::TangentialY, DistortionTerm::TangentialX];
        let prism = [0, 0, 1, 1].into_iter().zip([s, s * s, s, s * s]);
        let shifts = numerator_shifts
            .into_iter()
            .chain(denominator_shifts)
            .chain(tangential.map(|term| term.shift(&u)))
            .chain(prism.map(|(axis, shift)| Vector2::ith(axis, shift)));
        ray.projection_jacobian(&self.focal_matrix(), shifts.take(M::COEFFICIENTS))
    }

    fn unproject_with_jacobian(&self, pixel: &Vector2<f64>) -> Option<PlanePixelRay> {
        let distorted = self.normalised(pixel);
        let ideal = self.undistort(&distorted)?;
        Some(PlanePixelRay::of(self, ideal, distorted))
    }

    fn direction(&self, ray: &PlanePixelRay) -> Vector3<f64> {
        ray.direction()
    }

    fn direction_jacobian(&self, ray: &PlanePixelRay) -> Matrix3x2<f64> {
        ray.direction_jacobian(&self.inverse_focal_matrix())
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

    /// The image of the disc of valid radius `R` reaches at least `R F(R^2) - 3 |p| R^2 - |(s1,
    /// s3)| R^2 - |(s2, s4)| R^4` in every direction, `F` being the radial factor; the least focal
    /// length converts this to pixels.
    fn valid_pixel_radius(&self) -> f64 {
        let radius = self.valid_radius;
        if radius.is_infinite() {
            return radius;
        }
        let [_, _, p1, p2, _, _, _, _, s1, s2, s3, s4, ..] = self.coefficients;
        let square = radius * radius;
        let displaced = 3.0 * p1.hypot(p2) + s1.hypot(s3) + s2.hypot(s4) * square;
        let reach = radius * self.radial_factor(square) - displaced * square;
        reach.max(0.0) * self.least_focal()
    }

    fn line_distance_and_normal(
        &self,
        ray: &PlanePixelRay,
        line: &Vector3<f64>,
    ) -> (f64, Vector2<f64>) {
        ray.line_distance_and_normal(line, &self.inverse_focal_matrix())
    }

    fn line_distance_jacobian(
        &self,
        ray: &PlanePixelRay,
        line: &Vector3<f64>,
        wanted: Columns,
    ) -> LineDistance {
        let [_, _, p1, p2, _, k4, k5, k6, s1, s2, s3, s4, ..] = self.coefficients;
        let (u, s) = (ray.ideal, ray.square);
        let [denominator, factor, slope, curvature] = self.radial().at(s);
        let prism_slope = Vector2::new(s1 + 2.0 * s2 * s, s3 + 2.0 * s4 * s);
        let prism_curvature = Vector2::new(s2, s4) * 2.0;
        let derivatives = LineDerivatives::new(ray, line, &self.inverse_focal_matrix(), |q, v| {
            hessian(u, (q, v), (slope, curvature), [p1, p2])
                + v * (2.0 * q.dot(&prism_slope))
                + u * (4.0 * q.dot(&prism_curvature) * u.dot(&v))
        });
        let mut wrt_lens = [0.0; MAX_LENS_COLUMNS];
        let wrt_camera_matrix = derivatives.intrinsics();
        wrt_lens[..INTRINSICS].copy_from_slice(&wrt_camera_matrix.intrinsics);
        wrt_lens[INTRINSICS + M::COEFFICIENTS] = wrt_camera_matrix.skew;
        let denominator_slope = k4 + s * (2.0 * k5 + s * 3.0 * k6);
        // `s^n / B` and `-F s^n / B`, with their derivatives by `s`.
        let mut power = 1.0;
        for n in 0..3 {
            let quotient = s * power / denominator;
            let change = ((n + 1) as f64 * power - quotient * denominator_slope) / denominator;
            power *= s;
            wrt_lens[NUMERATOR + n] = derivatives.radial(quotient, change);
            if wanted.contains(DENOMINATOR + n) {
                let change = -slope * quotient - factor * change;
                wrt_lens[DENOMINATOR + n] = derivatives.radial(-factor * quotient, change);
            }
        }
        wrt_lens[TANGENTIAL] = derivatives.tangential(1);
        wrt_lens[TANGENTIAL + 1] = derivatives.tangential(0);
        if M::COEFFICIENTS == COEFFICIENTS && wanted.contains(PRISM) {
            for axis in 0..2 {
                wrt_lens[PRISM + 2 * axis] = derivatives.prism(axis, s, 1.0);
                wrt_lens[PRISM + 2 * axis + 1] = derivatives.prism(axis, s * s, 2.0 * s);
            }
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

    const SOME: [f64; COEFFICIENTS] = [
        -0.1, 0.05, 0.01, 0.15, -0.03, 0.02, 0.002, -0.001, 3e-3, -2e-3, 1e-3, 4e-3,
    ];

    fn lens<M: OpenCvModel>() -> OpenCvLens<M> {
        OpenCvLens::new([1000.0, 1010.0, 640.0, 470.0], &SOME[..M::COEFFICIENTS])
    }

    #[test]
    fn coefficients_are_in_opencv_s_order() {
        let all = [
            -0.1, 0.05, 0.002, -0.001, 0.01, 0.15, -0.03, 0.02, 3e-3, -2e-3, 1e-3, 4e-3,
        ];
        assert_eq!(lens::<ThinPrismModel>().distortion(), all);
        assert_eq!(lens::<RationalModel>().distortion(), all[..8]);
        let parameters = lens::<ThinPrismModel>().parameters();
        assert_eq!(parameters[INTRINSICS..16], SOME);
        let first = [&parameters[..12], &[0.0]].concat();
        let again = lens::<RationalModel>().with_parameters(&first);
        assert_eq!(again, lens());
    }

    #[test]
    fn with_brown_s_coefficients_it_is_brown_s_lens() {
        let brown = Brown::new([1000.0, 1010.0, 640.0, 470.0, -0.2, 0.1, -0.02, 2e-3, -1e-3]);
        let given = [-0.2, 0.1, -0.02, 0.0, 0.0, 0.0, 2e-3, -1e-3];
        let same = Rational::new(brown.intrinsics(), &given);
        let size = ImageSize {
            width: 1280,
            height: 960,
        };
        for pixel in size.corners() {
            let error = same.unproject(&pixel).unwrap() - brown.unproject(&pixel).unwrap();
            assert!(error.norm() < 1e-14);
        }
        let radii = (same.valid_radius(), brown.valid_radius());
        assert!((radii.0 - radii.1).abs() < 1e-9 * radii.1);
        let reaches = (same.valid_pixel_radius(), brown.valid_pixel_radius());
        assert!((reaches.0 - reaches.1).abs() < 1e-9 * reaches.1);
    }

    #[test]
    fn nothing_is_seen_beyond_a_pole() {
        let lens = Rational::new([1000.0, 1000.0, 0.0, 0.0], &[0.0, 0.0, 0.0, -0.25]);
        assert!(lens.project(&Vector3::new(1.9, 0.0, 1.0)).is_some());
        for x in [2.1, 5.0] {
            assert!(lens.project(&Vector3::new(x, 0.0, 1.0)).is_none());
        }
        // The lens sees everything before the pole, and nothing beyond.
        let ray = lens.unproject(&Vector2::new(1e6, 0.0)).unwrap();
        assert!(ray.x / ray.z < 2.0);
    }
}
