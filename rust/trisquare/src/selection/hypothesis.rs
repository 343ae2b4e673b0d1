//! Interpretation of many quadrilaterals by one camera: which are squares, which rectangles, and
//! the probability of the whole.
//!
//! Every candidate is a square, a rectangle, or something else. A square's deviation is near zero
//! in both numbers, a rectangle's in one (its sides are perpendicular), the rest are uniformly
//! distributed. The evidence for a camera is the log likelihood ratio of this against chance over
//! all deviations, integrated over the camera's neighbourhood (Laplace's method), which penalises a
//! camera that is adapted to a few squares. Windows in a wall are alike, so that one camera may
//! turn all of them into squares at once: candidates of the same orientation count little more than
//! one.

use nalgebra::{Matrix4, Vector2, Vector3};

use super::squareness::{CandidatePlane, Deviation, Pinhole};

/// Class of a candidate under a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Square,
    Rectangle,
    Other,
}

/// Prior fractions of squares, rectangles, and other quadrilaterals among the candidates.
const SHARES: [f64; 3] = [0.3, 0.5, 0.2];

/// Ranges of the uniform distribution of a chance deviation: of the cosine and of the logarithm of
/// the sides' ratio.
const SPREADS: [f64; 2] = [1.0, 2.0];

/// Difference in direction (radians) below which sides have the same orientation.
const ALIKE: f64 = 0.06;

/// Weight of the second and every further candidate of the same orientation.
pub(crate) const ALIKE_SHARE: f64 = 0.15;

/// Maximum number of steps of a camera; six converge.
const MAX_STEPS: usize = 12;

/// Maximum step of the logarithm of the focal length: the model is approximately linear up to it.
const LONGEST_STEP: f64 = 0.3;

/// Step, in standard deviations, below which the iteration ends.
const SETTLED: f64 = 0.05;

/// Prior of the camera: independent parameters, each with Student's distribution of two degrees of
/// freedom, so that a cropped picture is improbable but not impossible.
#[derive(Debug, Clone)]
pub(crate) struct Prior {
    pub mean: Pinhole,
    pub std: Pinhole,
}

/// Degrees of freedom of the prior's distribution.
const PRIOR_FREEDOM: f64 = 2.0;

impl Prior {
    pub fn cost(&self, camera: &Pinhole) -> f64 {
        let scaled = (camera - self.mean).component_div(&self.std);
        let parameter_cost = |z: f64| 0.5 * (PRIOR_FREEDOM + 1.0) * (z * z / PRIOR_FREEDOM).ln_1p();
        scaled.iter().map(|z| parameter_cost(*z)).sum()
    }

    /// Curvature of the parabola about the mean that has the cost's gradient at the camera.
    fn information(&self, camera: &Pinhole) -> Matrix4<f64> {
        let scaled = (camera - self.mean).component_div(&self.std);
        let tail_weight = scaled.map(|z| (PRIOR_FREEDOM + 1.0) / (PRIOR_FREEDOM + z * z));
        let precision = self.std.map(|s| 1.0 / (s * s));
        Matrix4::from_diagonal(&tail_weight.component_mul(&precision))
    }

    fn log_volume(&self) -> f64 {
        self.std.map(f64::ln).sum()
    }
}

/// A camera and its interpretation of the candidates.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    pub camera: Pinhole,
    pub covariance: Matrix4<f64>,
    pub shapes: Vec<Shape>,
    /// Log likelihood ratio of the observations under the camera against chance.
    pub evidence: f64,
}

impl Hypothesis {
    pub fn squares(&self) -> impl Iterator<Item = usize> {
        let shapes = self.shapes.iter().enumerate();
        shapes.filter_map(|(i, shape)| (*shape == Shape::Square).then_some(i))
    }

    /// The hypothesis after the camera has moved to its best explanation; `None` if it is not
    /// determined.
    ///
    /// `doubt` is the standard deviations of the first guess.
    pub fn converged(
        candidates: &[CandidatePlane],
        prior: &Prior,
        start: Pinhole,
        doubt: &Pinhole,
    ) -> Option<Self> {
        let mut camera = start;
        let mut covariance = Matrix4::from_diagonal(&doubt.component_mul(doubt));
        let mut best: Option<Self> = None;
        for _ in 0..MAX_STEPS {
            let deviations: Vec<Option<Deviation>> =
                candidates.iter().map(|c| c.deviation(&camera)).collect();
            let shapes: Vec<Shape> = deviations
                .iter()
                .map(|deviation| {
                    deviation
                        .as_ref()
                        .map_or(Shape::Other, |d| shape(d, &covariance))
                })
                .collect();
            let mut information = prior.information(&camera);
            let mut gradient = information * (camera - prior.mean);
            for (deviation, shape) in deviations.iter().zip(&shapes) {
                if let Some(deviation) = deviation {
                    add(deviation, *shape, &mut information, &mut gradient);
                }
            }
            let factor = information.cholesky()?;
            covariance = factor.inverse();
            let current = Self::at(&deviations, prior, camera, covariance);
            if best.as_ref().is_none_or(|b| current.evidence > b.evidence) {
                best = Some(current);
            }
            let mut step = -factor.solve(&gradient);
            step *= (LONGEST_STEP / step[0].abs().max(LONGEST_STEP)).min(1.0);
            camera += step;
            if step.dot(&(information * step)) < SETTLED * SETTLED {
                break;
            }
        }
        best
    }

    /// The hypothesis of a camera with known covariance.
    fn at(
        deviations: &[Option<Deviation>],
        prior: &Prior,
        camera: Pinhole,
        covariance: Matrix4<f64>,
    ) -> Self {
        let volume = covariance.determinant().max(f64::MIN_POSITIVE).ln();
        let mut evidence = 0.5 * volume - prior.log_volume() - prior.cost(&camera);
        let mut gains: Vec<(usize, Shape, f64)> = Vec::new();
        for (i, deviation) in deviations.iter().enumerate() {
            if let Some(deviation) = deviation {
                let (shape, gain) = best_gain(deviation, &nalgebra::Matrix2::zeros());
                gains.push((i, shape, gain));
            }
        }
        gains.sort_by(|a, b| b.2.total_cmp(&a.2));
        let mut shapes = vec![Shape::Other; deviations.len()];
        let mut counted: Vec<[Vector3<f64>; 2]> = Vec::new();
        for (i, shape, gain) in gains {
            shapes[i] = shape;
            let Some(deviation) = &deviations[i] else {
                continue;
            };
            let is_known = counted
                .iter()
                .any(|other| alike(other, &deviation.directions));
            evidence += if is_known { ALIKE_SHARE * gain } else { gain };
            counted.push(deviation.directions);
        }
        Self {
            camera,
            covariance,
            shapes,
            evidence,
        }
    }
}

/// The likeliest shape for a deviation, under an uncertain camera.
fn shape(deviation: &Deviation, covariance: &Matrix4<f64>) -> Shape {
    let wrt_camera = &deviation.wrt_camera;
    best_gain(
        deviation,
        &(wrt_camera * covariance * wrt_camera.transpose()),
    )
    .0
}

/// The likeliest shape for a deviation, and its log likelihood ratio against chance.
fn best_gain(deviation: &Deviation, further: &nalgebra::Matrix2<f64>) -> (Shape, f64) {
    let covariance = deviation.covariance + further;
    let value = deviation.value;
    let [squares, rectangles, others] = SHARES;
    let tau = std::f64::consts::TAU;
    let mut best = (Shape::Other, 0.0);
    let variance = covariance[(0, 0)];
    let rectangle = -0.5 * (value.x * value.x / variance + (tau * variance).ln())
        + (SPREADS[0] * rectangles / others).ln();
    if rectangle > best.1 {
        best = (Shape::Rectangle, rectangle);
    }
    if deviation.has_any_aspect {
        // Any aspect is accepted; "square" denotes the shape searched for.
        return match best.0 {
            Shape::Rectangle => (Shape::Square, best.1),
            _ => best,
        };
    }
    if let Some(inverse) = covariance.try_inverse() {
        let square = -0.5 * value.dot(&(inverse * value))
            - (tau * covariance.determinant().sqrt()).ln()
            + (SPREADS[0] * SPREADS[1] * squares / others).ln();
        if square > best.1 {
            best = (Shape::Square, square);
        }
    }
    best
}

/// Adds the information of a candidate of known shape on the camera.
fn add(
    deviation: &Deviation,
    shape: Shape,
    information: &mut Matrix4<f64>,
    gradient: &mut Pinhole,
) {
    match shape {
        Shape::Square => {
            if let Some(inverse) = deviation.covariance.try_inverse() {
                let weighted = deviation.wrt_camera.transpose() * inverse;
                *information += weighted * deviation.wrt_camera;
                *gradient += weighted * deviation.value;
            }
        }
        Shape::Rectangle => {
            let row = deviation.wrt_camera.row(0).transpose();
            let variance = deviation.covariance[(0, 0)];
            information.ger(1.0 / variance, &row, &row, 1.0);
            *gradient += row * (deviation.value.x / variance);
        }
        Shape::Other => {}
    }
}

/// Whether the sides of two candidates have the same directions, in either order.
pub(crate) fn alike(a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 2]) -> bool {
    let is_same = |u: &Vector3<f64>, v: &Vector3<f64>| u.cross(v).norm() < ALIKE;
    is_same(&a[0], &b[0]) && is_same(&a[1], &b[1]) || is_same(&a[0], &b[1]) && is_same(&a[1], &b[0])
}

/// Squared deviation of a candidate from a square, in units of its own variance and of the
/// camera's.
pub(crate) fn squared_deviation(
    candidate: &CandidatePlane,
    hypothesis: &Hypothesis,
) -> Option<f64> {
    let deviation = candidate.deviation(&hypothesis.camera)?;
    let wrt_camera = deviation.wrt_camera;
    let covariance =
        deviation.covariance + wrt_camera * hypothesis.covariance * wrt_camera.transpose();
    let value: Vector2<f64> = deviation.value;
    Some(value.dot(&(covariance.try_inverse()? * value)))
}
