//! Result of a choice among candidates, and reasons to doubt it.

use super::hypothesis::Hypothesis;
use super::inliers::{CLOSE_RIVAL, Inliers, MAX_FITTED, MIN_EVIDENCE};
use super::joint_fit::JointFit;
use crate::lens::Lens;
use crate::observations::{ObservedPlane, PlaneEdges};

/// Minimum number of boards that determine a camera and their own errors: more than half of them
/// are right then.
pub(crate) const MIN_BOARDS: usize = 3;

/// Relative difference of focal lengths above which cameras are different hypotheses.
const DIFFERENT_FOCAL: f64 = 0.02;

/// Fraction of the candidates below which agreement is doubted, if there are more than are tried
/// one by one.
const MINORITY: f64 = 0.5;

/// Deviations of the aspect, and of the principal point (over half the diagonal), from the ordinary
/// above which a picture is implausible: 4 standard deviations of those in use.
const ODD_ASPECT: f64 = 0.03;
const ODD_CENTRE: f64 = 0.12;

/// Result of a choice.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Choice {
    /// One for each plane, in the order of the planes' first figures.
    pub verdicts: Vec<Verdict>,
    /// Root mean square distance of the samples from the squares of the camera that explains the
    /// planes that agree (px); `None` if there is none, or if none was searched among three planes
    /// or fewer.
    pub residual: Option<f64>,
    /// Reason for which the choice may be wrong, if any.
    pub doubt: Option<Doubt>,
}

/// Verdict on a candidate plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Verdict {
    /// Index of its first figure.
    pub figure: usize,
    /// Whether it is a square under the camera found.
    pub kept: bool,
    /// Root mean square distance of its samples from the best square under the camera (px), if it
    /// was not kept.
    pub residual: Option<f64>,
}

/// Reason for which a choice may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Doubt {
    /// Under another camera other candidates are squares.
    #[error(
        "another choice is nearly as good: {squares} squares, with a focal length of {focal:.0} px"
    )]
    Rival {
        /// Number of its squares.
        squares: usize,
        /// Its focal length, px.
        focal: f64,
    },
    /// The agreement may be due to chance.
    #[error("so few planes agree that their agreement may be due to chance")]
    Chance,
    /// Too few of many candidates agree: under some camera a few are squares by chance.
    #[error("fewer than half of the candidates agree, and as many may agree by chance")]
    Minority,
    /// The camera is unusual.
    #[error(
        "they imply an unusual camera: aspect {aspect:.3}, principal point {offset:.0} px from the \
         picture's centre"
    )]
    OddCamera {
        /// `fy / fx`.
        aspect: f64,
        /// Distance of the principal point from the image centre, px.
        offset: f64,
    },
}

impl Choice {
    /// Removes the figures on planes that are not kept from those among which was chosen, and the
    /// relations to them.
    pub fn keep(&self, edges: &mut Vec<PlaneEdges>) {
        let dropped = self.verdicts.iter().filter(|verdict| !verdict.kept);
        let dropped: Vec<(usize, Option<u64>)> = dropped
            .map(|verdict| (verdict.figure, edges[verdict.figure].plane))
            .collect();
        let is_kept = |index: usize, figure: &PlaneEdges| {
            !dropped
                .iter()
                .any(|(first, plane)| *first == index || plane.is_some() && *plane == figure.plane)
        };
        let kept: Vec<usize> = (0..edges.len())
            .filter(|index| is_kept(*index, &edges[*index]))
            .collect();
        let mut indices = 0..edges.len();
        edges.retain(|_| {
            indices
                .next()
                .is_some_and(|i| kept.binary_search(&i).is_ok())
        });
        // Relations refer to figures by index.
        for figure in edges {
            let relations = figure.relations.iter();
            figure.relations = relations
                .filter_map(|(other, relation)| Some((kept.binary_search(other).ok()?, *relation)))
                .collect();
        }
    }

    /// The choice that keeps all.
    pub(crate) fn keeping_all(planes: &[ObservedPlane], residual: Option<f64>) -> Self {
        let keep = |plane: &ObservedPlane| Verdict {
            figure: plane.figures[0].index,
            kept: true,
            residual: None,
        };
        Self {
            verdicts: planes.iter().map(keep).collect(),
            residual,
            doubt: None,
        }
    }
}

/// Doubt of a choice that has a rival, may be due to chance, or implies an unusual camera.
pub(crate) fn doubt_of_choice<L: Lens>(
    inliers: &Inliers<'_, L>,
    best: &Hypothesis,
    chosen: &JointFit<L>,
    others: Vec<JointFit<L>>,
) -> Option<Doubt> {
    let problem = inliers.problem;
    let lens = chosen.refined.view.lens;
    let focal = |fit: &JointFit<L>| fit.refined.view.lens.focal().x;
    let close_worth = inliers.worth(chosen) - CLOSE_RIVAL;
    let rival = others.into_iter().find(|other| {
        (focal(other) / focal(chosen)).ln().abs() > DIFFERENT_FOCAL
            && inliers.worth(other) > close_worth
    });
    if let Some(rival) = rival {
        let rival = inliers.completed(rival);
        return Some(Doubt::Rival {
            squares: rival.members.len(),
            focal: focal(&rival),
        });
    }
    let unknowns = problem.options.known_intrinsics(&problem.size).unknowns();
    // Two equations per square: if no more than unknowns are left, any squares agree.
    let is_exact =
        !problem.options.fixed.focal && 2.0 * chosen.effective_count() < unknowns as f64 + 1.0;
    let candidates = inliers.planes.len();
    if candidates > MAX_FITTED && (chosen.members.len() as f64) < MINORITY * candidates as f64 {
        return Some(Doubt::Minority);
    }
    if is_exact || best.evidence < MIN_EVIDENCE {
        return Some(Doubt::Chance);
    }
    let aspect = lens.focal().y / lens.focal().x;
    let offset = (lens.principal_point() - problem.size.centre()).norm();
    let unit = problem.size.half_diagonal();
    let is_odd = aspect.ln().abs() > ODD_ASPECT || offset > ODD_CENTRE * unit;
    (is_odd && problem.options.initial.is_none()).then_some(Doubt::OddCamera { aspect, offset })
}

/// Doubt if at least `MIN_BOARDS` rejected planes determine another camera as well: the boards may
/// be in a picture within the picture.
pub(crate) fn doubt_of_boards<L: Lens>(
    inliers: &Inliers<'_, L>,
    rejected: &[usize],
) -> Option<Doubt> {
    if rejected.len() < MIN_BOARDS {
        return None;
    }
    let planes: Vec<_> = rejected
        .iter()
        .map(|i| inliers.planes[*i].clone())
        .collect();
    let fit = inliers.evaluated(rejected, &planes, inliers.problem.optimum(&planes).ok()?);
    let is_undetermined = inliers
        .problem
        .ill_conditioning(&planes, &fit.refined)
        .is_some();
    (!is_undetermined && inliers.agrees(&fit)).then(|| Doubt::Rival {
        squares: rejected.len(),
        focal: fit.refined.view.lens.focal().x,
    })
}
