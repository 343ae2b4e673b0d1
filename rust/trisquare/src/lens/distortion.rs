//! Distortions in other programs' camera files: maps from ideal to observed normalised points.

use nalgebra::{Matrix2, Matrix3, Vector2};

use crate::error::Error;

/// Maximum number of Newton steps: near the solution each step doubles the number of digits, and a
/// lens of 170 degrees needs some twenty steps to come near.
const MAX_STEPS: usize = 60;

/// Error of an inverse, in normalised units, below which the iteration ends: a thousandth of a
/// millionth of a pixel for any focal length in use.
const CONVERGED: f64 = 1e-12;

/// Largest accepted error of an inverse, relative to one plus the size of the observed point.
const ROUNDING: f64 = 1e-9;

/// Number of points between the axis and an ideal point at which a lens is checked for folding
/// back.
const FOLD_CHECKS: usize = 10;

/// Term of a distortion: the displacement of the ideal point `u = (x, y)`, `r = |u|`, per unit of
/// its coefficient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DistortionTerm {
    /// `u r^n`: for n = 2, 4, 6, 8 the term of Brown's `k1`, `k2`, `k3`, `k4`; for n = 1, 2, 3 that
    /// of the panorama programs' `c`, `b`, `a`.
    Radial(i32),
    /// Brown's `p1`: `(2 x y, r^2 + 2 y^2)`.
    TangentialY,
    /// Brown's `p2`: `(r^2 + 2 x^2, 2 x y)`.
    TangentialX,
}

impl DistortionTerm {
    /// Returns the terms of coefficients given by name, separated by blanks: `"k1 k2 p1 p2"`,
    /// `"c b a"`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an unknown name.
    pub fn of_names(names: &str) -> Result<Vec<Self>, Error> {
        let named = |name| match name {
            "k1" | "b" => Ok(Self::Radial(2)),
            "k2" => Ok(Self::Radial(4)),
            "k3" => Ok(Self::Radial(6)),
            "k4" => Ok(Self::Radial(8)),
            "c" => Ok(Self::Radial(1)),
            "a" => Ok(Self::Radial(3)),
            "p1" => Ok(Self::TangentialY),
            "p2" => Ok(Self::TangentialX),
            _ => Err(Error::InvalidArgument(format!(
                "no coefficient of a distortion is called {name:?}"
            ))),
        };
        names.split_whitespace().map(named).collect()
    }

    /// Returns the displacement of an ideal point by a coefficient of 1.
    pub fn shift(self, ideal: &Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let square = x * x + y * y;
        match self {
            Self::Radial(power) if power % 2 == 0 => ideal * square.powi(power / 2),
            Self::Radial(power) => ideal * square.sqrt().powi(power),
            Self::TangentialY => Vector2::new(2.0 * x * y, square + 2.0 * y * y),
            Self::TangentialX => Vector2::new(square + 2.0 * x * x, 2.0 * x * y),
        }
    }

    /// Derivative of the shift with respect to the ideal point.
    fn jacobian(self, ideal: &Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        match self {
            Self::Radial(power) => {
                let factor = ideal.norm().powi(power);
                radial_jacobian(ideal, factor, f64::from(power + 1) * factor)
            }
            Self::TangentialY => Matrix2::new(y, x, x, 3.0 * y) * 2.0,
            Self::TangentialX => Matrix2::new(3.0 * x, y, y, x) * 2.0,
        }
    }
}

/// Distortion of ideal normalised points by a lens.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Distortion {
    /// `u_d = u + sum c_i s_i(u)`, with the terms' coefficients.
    Terms(Vec<(DistortionTerm, f64)>),
    /// OpenCV's rational, thin-prism and tilted-sensor model: `k1, k2, p1, p2, k3, k4, k5, k6, s1,
    /// s2, s3, s4, tau_x, tau_y`, the angles in radians (OpenCV's documentation of `calib3d`).
    OpenCv([f64; 14]),
}

impl Distortion {
    /// Creates a distortion from the name of its model: `"opencv"`, whose last coefficients may be
    /// omitted, or the names of coefficients as in [`DistortionTerm::of_names`].
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for an unknown name or a wrong number of coefficients,
    /// [`Error::NotFinite`] for a coefficient that is NaN or infinite.
    pub fn of_model(model: &str, coefficients: &[f64]) -> Result<Self, Error> {
        if !coefficients.iter().all(|c| c.is_finite()) {
            return Err(Error::NotFinite {
                what: "a coefficient of the distortion",
            });
        }
        let miscounted = || {
            let count = coefficients.len();
            Error::InvalidArgument(format!(
                "the model {model:?} does not have {count} coefficients"
            ))
        };
        match model {
            "opencv" => {
                let mut all = [0.0; 14];
                let given = all.get_mut(..coefficients.len()).ok_or_else(miscounted)?;
                given.copy_from_slice(coefficients);
                Ok(Self::OpenCv(all))
            }
            names => {
                let terms = DistortionTerm::of_names(names)?;
                let fits = terms.len() == coefficients.len();
                let pairs = terms.into_iter().zip(coefficients.iter().copied());
                fits.then(|| Self::Terms(pairs.collect()))
                    .ok_or_else(miscounted)
            }
        }
    }

    /// Maps an ideal normalised point to the observed one.
    pub fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        self.with_jacobian(ideal).0
    }

    /// Inverts the distortion; `None` where Newton's method does not converge, or converges to a
    /// point beyond a fold.
    pub fn undistort(&self, observed: &Vector2<f64>) -> Option<Vector2<f64>> {
        let mut ideal = *observed;
        let (mut seen, mut jacobian) = self.with_jacobian(&ideal);
        let mut step_size = 1.0;
        for _ in 0..MAX_STEPS {
            let error = seen - observed;
            if error.amax() < CONVERGED {
                break;
            }
            let inverse = jacobian.try_inverse().unwrap_or_else(Matrix2::identity);
            let tried = ideal - inverse * error * step_size;
            let (tried_seen, tried_jacobian) = self.with_jacobian(&tried);
            if (tried_seen - observed).norm() < error.norm() {
                (ideal, seen, jacobian) = (tried, tried_seen, tried_jacobian);
                step_size = f64::min(1.0, 2.0 * step_size);
            } else {
                step_size *= 0.5;
            }
        }
        let is_converged = (seen - observed).amax() < ROUNDING * (1.0 + observed.amax());
        let is_unfolded = |i: usize| {
            let place = ideal * (i as f64 / FOLD_CHECKS as f64);
            self.with_jacobian(&place).1.determinant() > 0.0
        };
        (is_converged && (1..=FOLD_CHECKS).all(is_unfolded)).then_some(ideal)
    }

    /// Returns the observed point and its derivative with respect to the ideal one.
    fn with_jacobian(&self, ideal: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self {
            Self::Terms(terms) => terms.iter().fold(
                (*ideal, Matrix2::identity()),
                |(seen, jacobian), (term, c)| {
                    (
                        seen + term.shift(ideal) * *c,
                        jacobian + term.jacobian(ideal) * *c,
                    )
                },
            ),
            Self::OpenCv(coefficients) => opencv(coefficients, ideal),
        }
    }
}

/// Derivative of `u g(r)`: `g` across the radius, `slope = d(r g)/dr` along it.
fn radial_jacobian(ideal: &Vector2<f64>, factor: f64, slope: f64) -> Matrix2<f64> {
    let along = ideal.try_normalize(0.0).unwrap_or_else(Vector2::zeros);
    Matrix2::identity() * factor + along * along.transpose() * (slope - factor)
}

/// OpenCV's radial factor `(1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct RadialQuotient {
    /// `k1, k2, k3`.
    pub numerator: [f64; 3],
    /// `k4, k5, k6`.
    pub denominator: [f64; 3],
}

impl RadialQuotient {
    /// Returns the denominator, the factor, and the factor's first and second derivative with
    /// respect to `s`.
    pub fn at(&self, square: f64) -> [f64; 4] {
        let polynomial = |[a, b, c]: [f64; 3]| {
            (
                1.0 + square * (a + square * (b + square * c)),
                a + square * (2.0 * b + square * 3.0 * c),
                2.0 * b + square * 6.0 * c,
            )
        };
        let (numerator, numerator_slope, numerator_curvature) = polynomial(self.numerator);
        let (denominator, denominator_slope, denominator_curvature) = polynomial(self.denominator);
        let factor = numerator / denominator;
        let slope = (numerator_slope - factor * denominator_slope) / denominator;
        let curvature = (numerator_curvature
            - factor * denominator_curvature
            - 2.0 * slope * denominator_slope)
            / denominator;
        [denominator, factor, slope, curvature]
    }
}

/// Returns the observed point of OpenCV's model and its derivative with respect to the ideal one.
pub(super) fn opencv(
    coefficients: &[f64; 14],
    ideal: &Vector2<f64>,
) -> (Vector2<f64>, Matrix2<f64>) {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y] = *coefficients;
    let square = ideal.norm_squared();
    let radial = RadialQuotient {
        numerator: [k1, k2, k3],
        denominator: [k4, k5, k6],
    };
    let [_, factor, slope, _] = radial.at(square);
    let prism = Vector2::new(s1 + s2 * square, s3 + s4 * square);
    let prism_slope = Vector2::new(s1 + 2.0 * s2 * square, s3 + 2.0 * s4 * square);
    let mut seen = ideal * factor + prism * square;
    let mut jacobian =
        Matrix2::identity() * factor + (ideal * slope + prism_slope) * ideal.transpose() * 2.0;
    for (term, p) in [
        (DistortionTerm::TangentialY, p1),
        (DistortionTerm::TangentialX, p2),
    ] {
        seen += term.shift(ideal) * p;
        jacobian += term.jacobian(ideal) * p;
    }
    if tau_x == 0.0 && tau_y == 0.0 {
        return (seen, jacobian);
    }
    let ((sx, cx), (sy, cy)) = (tau_x.sin_cos(), tau_y.sin_cos());
    let turn = Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy)
        * Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx);
    let onto_sensor = Matrix3::new(
        turn.m33, 0.0, -turn.m13, 0.0, turn.m33, -turn.m23, 0.0, 0.0, 1.0,
    ) * turn;
    let tilted = onto_sensor * seen.push(1.0);
    let on_sensor = tilted.xy() / tilted.z;
    let wrt_seen = (onto_sensor.fixed_view::<2, 2>(0, 0)
        - on_sensor * onto_sensor.fixed_view::<1, 2>(2, 0))
        / tilted.z;
    (on_sensor, wrt_seen * jacobian)
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Lens};
    use super::*;

    fn all() -> Vec<Distortion> {
        let opencv = [
            0.3, -0.1, 2e-3, -1e-3, 0.02, 0.4, -0.05, 0.01, 1e-3, -2e-3, 3e-3, 1e-3, 0.02, -0.03,
        ];
        [
            (
                "k1 k2 k3 k4 p1 p2",
                &[-0.2, 0.05, -0.01, 0.003, 2e-3, -1e-3][..],
            ),
            ("c b a", &[0.02, -0.04, 0.01]),
            ("opencv", &opencv),
            ("opencv", &opencv[..8]),
            ("", &[]),
        ]
        .map(|(model, coefficients)| Distortion::of_model(model, coefficients).unwrap())
        .to_vec()
    }

    fn places() -> Vec<Vector2<f64>> {
        let mut places = vec![Vector2::zeros()];
        for i in 1..40 {
            let (sin, cos) = f64::from(i).sin_cos();
            places.push(Vector2::new(cos, sin) * (0.9 * f64::from(i) / 40.0));
        }
        places
    }

    #[test]
    fn inverses_lead_back_and_jacobians_agree_with_central_differences() {
        for distortion in all() {
            for ideal in places() {
                let back = distortion.undistort(&distortion.distort(&ideal)).unwrap();
                assert!((back - ideal).norm() < 1e-11, "{distortion:?} {ideal}");
                let jacobian = distortion.with_jacobian(&ideal).1;
                for axis in 0..2 {
                    let step = Vector2::ith(axis, 1e-6);
                    let change =
                        distortion.distort(&(ideal + step)) - distortion.distort(&(ideal - step));
                    let error = (change / 2e-6 - jacobian.column(axis)).norm();
                    // The derivative of `u r` has a kink at the axis: its differences are off by
                    // the step.
                    assert!(error < 1e-7, "{distortion:?} {ideal} {error}");
                }
            }
        }
    }

    #[test]
    fn brown_s_lens_is_one_of_them() {
        let [k1, k2, p1, p2, k3] = [-0.28, 0.1, 3e-3, -2e-3, -0.02];
        let lens = Brown::new([1.0, 1.0, 0.0, 0.0, k1, k2, k3, p1, p2]);
        let terms = Distortion::of_model("k1 k2 p1 p2 k3", &[k1, k2, p1, p2, k3]).unwrap();
        let opencv = Distortion::of_model("opencv", &[k1, k2, p1, p2, k3]).unwrap();
        for ideal in places() {
            let seen = lens.project(&ideal.push(1.0)).unwrap();
            for same in [&terms, &opencv] {
                assert!((same.distort(&ideal) - seen).norm() < 1e-15);
            }
        }
    }

    #[test]
    fn beyond_a_fold_there_is_nothing() {
        let barrel = Distortion::of_model("k1", &[-0.5]).unwrap();
        assert!(barrel.undistort(&Vector2::new(0.54, 0.0)).is_some());
        assert!(barrel.undistort(&Vector2::new(0.55, 0.0)).is_none());
        for observed in [f64::NAN, f64::INFINITY] {
            assert!(barrel.undistort(&Vector2::new(observed, 0.0)).is_none());
        }
    }

    #[test]
    fn unknown_models_and_wrong_counts_are_refused() {
        for (model, count) in [("k9", 1), ("k1 k2", 1), ("opencv", 15)] {
            assert!(Distortion::of_model(model, &vec![0.0; count]).is_err());
        }
        assert!(Distortion::of_model("k1", &[f64::NAN]).is_err());
    }
}
