//! What a choice among candidates returns, and why it may be wrong.

use super::hypothesis::Hypothesis;
use super::inliers::{CLOSE_RIVAL, Inliers, MAX_FITTED, MIN_EVIDENCE};
use super::joint_fit::JointFit;
use crate::lens::Lens;
use crate::observations::{ObservedPlane, PlaneEdges};

/// Boards that show a camera and their own errors: more than half of them are then right.
pub(crate) const MIN_BOARDS: usize = 3;

/// Cameras whose focal lengths differ by more than this part are different hypotheses.
const DIFFERENT_FOCAL: f64 = 0.02;

/// Of more candidates than are tried one by one, a smaller part that agrees is doubted.
const MINORITY: f64 = 0.5;

/// An aspect, and a principal point (over half the diagonal), this far from the ordinary are
/// plausible for no ordinary picture: 4 standard deviations of those in use.
const ODD_ASPECT: f64 = 0.03;
const ODD_CENTRE: f64 = 0.12;

/// What was chosen.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Choice {
    /// One for each plane, in the order of the planes' first figures.
    pub verdicts: Vec<Verdict>,
    /// Root mean square distance of the samples from the squares of the camera that explains those
    /// planes that agree (px); `None` where none was found, or sought among three planes or fewer.
    pub residual: Option<f64>,
    /// Why the choice may be wrong, if so.
    pub doubt: Option<Doubt>,
}

/// What became of a candidate plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Verdict {
    /// Index of its first figure.
    pub figure: usize,
    /// Whether it is a square to the camera that was found.
    pub kept: bool,
    /// Root mean square distance of its samples from the best square that the camera allows (px),
    /// of what was not kept.
    pub residual: Option<f64>,
}

/// Why a choice may be wrong.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Doubt {
    /// Another camera makes squares of others.
    #[error(
        "another choice of squares is nearly as good: {squares} of them and a focal length of \
         {focal:.0} px"
    )]
    Rival {
        /// How many squares it has.
        squares: usize,
        /// Its focal length, px.
        focal: f64,
    },
    /// What agrees may do so by chance.
    #[error("so few planes agree that it may be chance")]
    Chance,
    /// Of many candidates too few agree: a camera makes squares of some of them by chance.
    #[error("fewer than half of the candidates agree, and so many may agree by chance")]
    Minority,
    /// The camera is no ordinary one.
    #[error(
        "they imply an unusual camera: aspect {aspect:.3}, principal point {offset:.0} px from \
         the image centre"
    )]
    OddCamera {
        /// `fy / fx`.
        aspect: f64,
        /// Distance of the principal point from the image centre, px.
        offset: f64,
    },
}

impl Choice {
    /// Drops, of the figures among which was chosen, those on planes that are not kept, and the
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
        // Relations name figures by their places.
        for figure in edges {
            let relations = figure.relations.iter();
            figure.relations = relations
                .filter_map(|(other, relation)| Some((kept.binary_search(other).ok()?, *relation)))
                .collect();
        }
    }

    /// The choice that keeps all.
    pub(crate) fn of_all(planes: &[ObservedPlane], residual: Option<f64>) -> Self {
        let kept = |plane: &ObservedPlane| Verdict {
            figure: plane.figures[0].index,
            kept: true,
            residual: None,
        };
        Self {
            verdicts: planes.iter().map(kept).collect(),
            residual,
            doubt: None,
        }
    }
}

/// That a choice has a rival, comes about by chance, or asks for an odd camera.
pub(crate) fn doubt_of_choice<L: Lens>(
    inliers: &Inliers<'_, L>,
    best: &Hypothesis,
    chosen: &JointFit<L>,
    others: Vec<JointFit<L>>,
) -> Option<Doubt> {
    let problem = inliers.problem;
    let lens = chosen.refined.view.lens;
    let focal = |fit: &JointFit<L>| fit.refined.view.lens.focal().x;
    let close = inliers.worth(chosen) - CLOSE_RIVAL;
    let rival = others.into_iter().find(|other| {
        (focal(other) / focal(chosen)).ln().abs() > DIFFERENT_FOCAL && inliers.worth(other) > close
    });
    if let Some(rival) = rival {
        let rival = inliers.completed(rival);
        return Some(Doubt::Rival {
            squares: rival.members.len(),
            focal: focal(&rival),
        });
    }
    let unknowns = problem.options.known_intrinsics(&problem.size).unknowns();
    // Two equations each: where no more are left than unknowns, any squares agree.
    let exact =
        !problem.options.fixed.focal && 2.0 * chosen.standing_apart() < unknowns as f64 + 1.0;
    let candidates = inliers.planes.len();
    if candidates > MAX_FITTED && (chosen.members.len() as f64) < MINORITY * candidates as f64 {
        return Some(Doubt::Minority);
    }
    if exact || best.evidence < MIN_EVIDENCE {
        return Some(Doubt::Chance);
    }
    let aspect = lens.focal().y / lens.focal().x;
    let offset = (lens.principal_point() - problem.size.centre()).norm();
    let unit = problem.size.half_diagonal();
    let odd = aspect.ln().abs() > ODD_ASPECT || offset > ODD_CENTRE * unit;
    (odd && problem.options.initial.is_none()).then_some(Doubt::OddCamera { aspect, offset })
}

/// That as many others as boards show another camera as well: the boards may be those of a picture
/// in the picture.
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
    let fit = inliers.judged(rejected, &planes, inliers.problem.optimum(&planes).ok()?);
    let is_open = inliers
        .problem
        .ill_conditioning(&planes, &fit.refined)
        .is_some();
    (!is_open && inliers.agrees(&fit)).then(|| Doubt::Rival {
        squares: rejected.len(),
        focal: fit.refined.view.lens.focal().x,
    })
}
