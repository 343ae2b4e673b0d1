//! Hypotheses of cameras for the candidates, before any of these is known to be a square.

use nalgebra::Matrix3;

use super::candidates::Pool;
use super::hypothesis::{Hypothesis, Prior};
use super::squareness::{CandidatePlane, Pinhole};
use super::subsets::subsets;
use crate::geometry::camera_matrix_from_planes;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::linear::Homographies;
use crate::observations::Options;
use crate::solver::JointProblem;

/// Range of focal lengths tried, over half the image diagonal, and their number: neighbours differ
/// by 8 %.
const FOCAL_LENGTHS: (f64, f64) = (0.4, 18.0);
const FOCAL_STEPS: usize = 48;

/// Maximum number of hypotheses that are kept.
const MAX_HYPOTHESES: usize = 4;

/// Number of candidates, evenly chosen, by which every hypothesis is weighed first if there are
/// more: they show which cameras are worth weighing by all.
const MAX_WEIGHED: usize = 64;

/// Prior standard deviations of the camera: focal length (its logarithm), aspect, and principal
/// point over half the diagonal. Nearly all pixels are square and principal points near the centre;
/// of the focal length only the order of magnitude is known.
const PRIOR_STD: [f64; 4] = [1.0, 0.01, 0.03, 0.03];

/// Logarithm of an ordinary focal length, over half the diagonal: a 40 mm lens on 36 x 24 mm.
const ORDINARY_FOCAL: f64 = 0.6;

/// Standard deviation of a fixed parameter.
const HELD: f64 = 1e-6;

/// Standard deviation of the logarithm of a hypothesised focal length.
pub(crate) const FOCAL_DOUBT: f64 = 0.04;

/// Prior of the camera.
pub(crate) fn prior<L: Lens>(problem: &JointProblem<'_, L>) -> Prior {
    let Options { fixed, initial, .. } = *problem.options;
    let mut mean = Pinhole::new(ORDINARY_FOCAL, 0.0, 0.0, 0.0);
    let mut std = Pinhole::from(PRIOR_STD);
    if let Some(lens) = initial {
        mean = pinhole(&lens.camera_matrix(), problem.size);
    }
    let is_held = [
        fixed.focal,
        fixed.aspect || fixed.focal,
        fixed.principal_point,
        fixed.principal_point,
    ];
    for i in 0..4 {
        if is_held[i] {
            std[i] = HELD;
        } else if i != 0 || initial.is_none() {
            mean[i] = Pinhole::new(ORDINARY_FOCAL, 0.0, 0.0, 0.0)[i];
        }
    }
    Prior { mean, std }
}

/// The hypotheses of all cameras, in order of decreasing evidence.
pub(crate) fn propose<L: Lens>(problem: &JointProblem<'_, L>, pool: &Pool<L>) -> Vec<Hypothesis> {
    let prior = prior(problem);
    let mut doubt = prior.std;
    doubt[0] = doubt[0].min(FOCAL_DOUBT);
    let all = &pool.candidates;
    let starts = candidate_cameras(problem, pool, &prior);
    let hypotheses = |candidates: &[CandidatePlane], starts: Vec<Pinhole>| {
        let converged = |start| Hypothesis::converged(candidates, &prior, start, &doubt);
        best_distinct(starts.into_iter().filter_map(converged).collect())
    };
    if all.len() <= MAX_WEIGHED {
        return hypotheses(all, starts);
    }
    let step = all.len().div_ceil(MAX_WEIGHED);
    let sample: Vec<CandidatePlane> = all.iter().step_by(step).cloned().collect();
    let best = hypotheses(&sample, starts);
    hypotheses(all, best.into_iter().map(|found| found.camera).collect())
}

/// The hypotheses with the most evidence, one for each set of squares.
fn best_distinct(mut found: Vec<Hypothesis>) -> Vec<Hypothesis> {
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let mut distinct: Vec<Hypothesis> = Vec::new();
    for hypothesis in found {
        if distinct
            .iter()
            .all(|known| !known.squares().eq(hypothesis.squares()))
        {
            distinct.push(hypothesis);
        }
        if distinct.len() == MAX_HYPOTHESES {
            break;
        }
    }
    distinct
}

/// Cameras that may explain candidates: every plausible focal length, and the cameras determined by
/// pairs and triples of candidates.
fn candidate_cameras<L: Lens>(
    problem: &JointProblem<'_, L>,
    pool: &Pool<L>,
    prior: &Prior,
) -> Vec<Pinhole> {
    let mut cameras = vec![prior.mean];
    if problem.options.fixed.focal {
        return cameras;
    }
    let (shortest, longest) = (FOCAL_LENGTHS.0.ln(), FOCAL_LENGTHS.1.ln());
    for i in 0..FOCAL_STEPS {
        let mut camera = prior.mean;
        camera[0] = shortest + (longest - shortest) * i as f64 / (FOCAL_STEPS - 1) as f64;
        cameras.push(camera);
    }
    let planes = pool.homographies.iter();
    let homographies: Vec<_> = planes.flat_map(Homographies::of_planes).collect();
    let known = problem.options.known_intrinsics(&problem.size);
    for subset in subsets(homographies.len()) {
        let chosen: Vec<_> = subset.iter().map(|i| homographies[*i]).collect();
        if let Ok(matrix) = camera_matrix_from_planes(&chosen, &known) {
            let camera = pinhole(&matrix, problem.size);
            if camera.iter().all(|v| v.is_finite()) && camera[0] < FOCAL_LENGTHS.1.ln() {
                cameras.push(camera);
            }
        }
    }
    cameras
}

/// The camera of a camera matrix.
pub(crate) fn pinhole(matrix: &Matrix3<f64>, size: ImageSize) -> Pinhole {
    let (unit, centre) = (size.half_diagonal(), size.centre());
    Pinhole::new(
        (matrix.m11 / unit).ln(),
        (matrix.m22 / matrix.m11).ln(),
        (matrix.m13 - centre.x) / unit,
        (matrix.m23 - centre.y) / unit,
    )
}

/// The camera matrix of a camera.
pub(crate) fn matrix_of(camera: &Pinhole, size: ImageSize) -> Matrix3<f64> {
    let (unit, centre) = (size.half_diagonal(), size.centre());
    let fx = camera[0].exp() * unit;
    let (cx, cy) = (centre.x + camera[2] * unit, centre.y + camera[3] * unit);
    Matrix3::new(fx, 0.0, cx, 0.0, fx * camera[1].exp(), cy, 0.0, 0.0, 1.0)
}
