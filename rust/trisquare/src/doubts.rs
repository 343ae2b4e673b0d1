//! Why a choice among candidates may be wrong.

use crate::agreement::Agreement;
use crate::choice::Doubt;
use crate::explanation::Explanation;
use crate::joint_fit::Fit;

/// Boards that show a camera and their own errors: more than half of them are then right.
pub(crate) const LEAST_BOARDS: usize = 3;

/// Logarithm of the odds below which another explanation is nearly as good.
const CLOSE_RIVAL: f64 = 4.0;

/// Evidence that one explanation needs to stand out from chance, over that of no square at all.
const LEAST_EVIDENCE: f64 = 8.0;

/// Cameras whose focal lengths differ by more than this part are different explanations.
const DIFFERENT_FOCAL: f64 = 0.02;

/// An aspect, and a principal point (over half the diagonal), this far from the ordinary are
/// plausible for no ordinary picture: 4 standard deviations of those in use.
const ODD_ASPECT: f64 = 0.03;
const ODD_CENTRE: f64 = 0.12;

/// That a choice has a rival, comes about by chance, or asks for an odd camera.
pub(crate) fn of_choice(
    agreement: &Agreement<'_>,
    best: &Explanation,
    chosen: &Fit,
    others: Vec<Fit>,
) -> Option<Doubt> {
    let task = agreement.task;
    let lens = chosen.refined.view.lens;
    let focal = |fit: &Fit| fit.refined.view.lens.focal().x;
    let close = agreement.worth(chosen) - CLOSE_RIVAL;
    let rival = others.into_iter().find(|other| {
        (focal(other) / focal(chosen)).ln().abs() > DIFFERENT_FOCAL
            && agreement.worth(other) > close
    });
    if let Some(rival) = rival {
        let rival = agreement.completed(rival);
        return Some(Doubt::Rival {
            squares: rival.members.len(),
            focal: focal(&rival),
        });
    }
    let unknowns = task.options.known_intrinsics(&task.size).unknowns();
    // Two equations each: where no more are left than unknowns, any squares agree.
    let exact = !task.options.fixed.focal && 2.0 * chosen.standing_apart() < unknowns as f64 + 1.0;
    if exact || best.evidence < LEAST_EVIDENCE {
        return Some(Doubt::Chance);
    }
    let aspect = lens.focal().y / lens.focal().x;
    let offset = (lens.principal_point() - task.size.centre()).norm();
    let unit = task.size.half_diagonal();
    let odd = aspect.ln().abs() > ODD_ASPECT || offset > ODD_CENTRE * unit;
    (odd && task.options.initial.is_none()).then_some(Doubt::OddCamera { aspect, offset })
}

/// That as many others as boards agree on another camera: these may be a picture's in the picture.
pub(crate) fn of_boards(agreement: &Agreement<'_>, rejected: &[usize]) -> Option<Doubt> {
    if rejected.len() < LEAST_BOARDS {
        return None;
    }
    let planes: Vec<_> = rejected
        .iter()
        .map(|i| agreement.planes[*i].clone())
        .collect();
    let fit = agreement.judged(rejected, &planes, agreement.task.optimum(&planes).ok()?);
    agreement.agrees(&fit).then(|| Doubt::Rival {
        squares: rejected.len(),
        focal: fit.refined.view.lens.focal().x,
    })
}
