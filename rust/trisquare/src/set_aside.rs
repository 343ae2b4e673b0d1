//! Sides and planes that do not belong to the scene: bent, torn or covered sides, and targets that
//! are no squares. They are found by how much better the rest agrees without them.

use crate::Error;
use crate::covariance::check_plane_count;
use crate::misfit::Misfit;
use crate::observations::ObservedPlane;
use crate::refine::Residual;
use crate::result::Warning;
use crate::robust::Loss;
use crate::stages::{Solution, Task};

/// Planes that must remain where one is set aside: two cannot show which of three is false.
const LEAST_PLANES: usize = 3;

/// Mean square misfit from which the planes are doubted.
const DOUBTED: f64 = 2.0;

/// A plane is set aside if what it adds to the misfit is, per degree of freedom, so many times
/// what remains without it: chance makes it 4 once in ten thousand times.
const FALSE_PLANE: f64 = 6.0;

/// A side is bent if its mean square curvature is so many times that of the noise and of the other
/// sides.
const BENT: f64 = 10.0;

/// Twice the log likelihood gained from which a side certainly errs more than the others: a chance
/// of one in ten thousand, for each of some twelve sides.
const CERTAINLY: f64 = 20.0;

/// A side most of whose samples the robust loss ignores is no side of this square.
const MOST: f64 = 0.5;

/// At most one side in so many is set aside: beyond, nobody can tell who is right.
const SIDES_PER_OUTLIER: usize = 4;

/// The best camera for the sides and planes that agree, and the warnings that name the others.
///
/// # Errors
/// If no camera is found for any of the planes.
pub(crate) fn agreeing(
    task: &Task<'_>,
    planes: &[ObservedPlane],
) -> Result<(Solution, Vec<Warning>), Error> {
    let mut solution = without_false_plane(task, planes, task.solve(planes))?;
    let sides: usize = planes.iter().map(|plane| plane.sides().count()).sum();
    for _ in 0..sides / SIDES_PER_OUTLIER {
        let Some((plane, side)) = outlying_side(&solution) else {
            break;
        };
        let mut remaining = solution.planes.clone();
        if let Some(side) = remaining[plane].side_mut(side) {
            side.set_aside = true;
        }
        let settled = task
            .again(&remaining, &solution.refined)
            .and_then(|refined| task.settle(&remaining, refined).ok());
        match settled.filter(|settled| is_bent(settled, plane, side)) {
            Some(settled) => solution = settled,
            None => break,
        }
    }
    let warnings = warnings(&solution);
    Ok((solution, warnings))
}

/// Leaves out each plane in turn where they disagree, and sets aside the one without which the
/// others agree much better, or only its one bent side.
fn without_false_plane(
    task: &Task<'_>,
    planes: &[ObservedPlane],
    all: Result<Solution, Error>,
) -> Result<Solution, Error> {
    let enough =
        planes.len() > LEAST_PLANES && check_plane_count(planes.len() - 1, &task.free).is_ok();
    let misfit = match &all {
        Ok(solution) => Some(solution.misfit(task)),
        Err(Error::NotConverged { .. } | Error::WeakGeometry(_)) => None,
        Err(_) => return all,
    };
    if !enough || misfit.is_some_and(|misfit| misfit.mean() < DOUBTED) {
        return all;
    }
    let without = |left_out: usize| {
        let mut rest = planes.to_vec();
        rest.remove(left_out);
        let refined = task.optimum(&rest).ok()?;
        let noise = refined.noise(&rest).scale;
        let misfit = Misfit::of(&rest, &refined, &task.free, noise);
        Some((left_out, rest, refined, misfit))
    };
    let best = (0..planes.len())
        .filter_map(without)
        .min_by(|a, b| a.3.mean().total_cmp(&b.3.mean()));
    let Some((index, rest, refined, remaining)) = best else {
        return all;
    };
    let is_false = misfit.is_none_or(|misfit| {
        let added = misfit.total() - remaining.total();
        let freedom = (misfit.freedom() - remaining.freedom()).max(1.0);
        added / freedom > FALSE_PLANE * remaining.mean().max(1.0)
    });
    if !is_false {
        return all;
    }
    let followed = task
        .settle(&rest, refined)
        .ok()
        .and_then(|found| task.with_follower(&found, index, &planes[index]));
    match followed {
        Some(found) => Ok(with_its_straight_sides(task, found, index)),
        None => all,
    }
}

/// A plane of which one side alone is bent comes back with the others.
fn with_its_straight_sides(task: &Task<'_>, found: Solution, plane: usize) -> Solution {
    let noise = found.refined.noise(&found.planes).scale;
    let mut rest = &found.refined.residuals[plane][..];
    let mut curvatures = Vec::new();
    for side in found.planes[plane].sides() {
        let (own, others) = rest.split_at(side.samples.len());
        rest = others;
        let misfit = Misfit::of_side(side, own, noise);
        curvatures.push(misfit.curved / misfit.curved_freedom.max(1.0));
    }
    let bent: Vec<usize> = (0..curvatures.len())
        .filter(|s| curvatures[*s] > BENT)
        .collect();
    let [bent] = bent[..] else {
        return found;
    };
    let mut planes = found.planes.clone();
    for index in 0..curvatures.len() {
        if let Some(side) = planes[plane].side_mut(index) {
            side.set_aside = index == bent;
        }
    }
    let again = task
        .again(&planes, &found.refined)
        .and_then(|refined| task.settle(&planes, refined).ok());
    again
        .filter(|again| again.misfit(task).mean() < DOUBTED * found.misfit(task).mean().max(1.0))
        .unwrap_or(found)
}

impl Solution {
    fn misfit(&self, task: &Task<'_>) -> Misfit {
        let noise = self.refined.noise(&self.planes).scale;
        Misfit::of(&self.planes, &self.refined, &task.free, noise)
    }

    /// Plane, index over all figures of the plane, and residuals of every side that counts.
    fn sides(&self) -> impl Iterator<Item = (usize, usize, &[Residual])> {
        let planes = self.planes.iter().zip(&self.refined.residuals).enumerate();
        planes.flat_map(|(p, (plane, residuals))| {
            let mut rest = &residuals[..];
            plane.sides().enumerate().filter_map(move |(s, side)| {
                let (own, others) = rest.split_at(side.samples.len());
                rest = others;
                (!side.set_aside).then_some((p, s, own))
            })
        })
    }
}

/// The part of a side's samples that the robust loss ignores.
fn ignored(residuals: &[Residual], scale: f64) -> f64 {
    let without = residuals
        .iter()
        .filter(|r| Loss::Tukey.cost_and_weight(r.distance * r.weight / scale).1 == 0.0);
    without.count() as f64 / residuals.len().max(1) as f64
}

/// The side that least belongs to the others, if one certainly does not.
fn outlying_side(solution: &Solution) -> Option<(usize, usize)> {
    let most_ignored = solution
        .sides()
        .map(|(plane, side, own)| (plane, side, ignored(own, solution.refined.scale)))
        .filter(|(_, _, share)| *share > MOST)
        .max_by(|a, b| a.2.total_cmp(&b.2));
    if let Some((plane, side, _)) = most_ignored {
        return Some((plane, side));
    }
    let (plane, side, gain) = solution.correlated.worst_side?;
    (gain > CERTAINLY).then_some((plane, side))
}

/// Whether a side that was set aside is curved, as bent paper is, or mostly something else: a
/// straight one in the wrong place belongs to a square that is none.
fn is_bent(solution: &Solution, plane: usize, index: usize) -> bool {
    let noise = solution.refined.noise(&solution.planes).scale;
    let mut rest = &solution.refined.residuals[plane][..];
    for (s, side) in solution.planes[plane].sides().enumerate() {
        let (own, others) = rest.split_at(side.samples.len());
        rest = others;
        if s == index {
            let misfit = Misfit::of_side(side, own, noise);
            return misfit.curved > BENT * misfit.curved_freedom;
        }
    }
    false
}

/// Names what was set aside.
fn warnings(solution: &Solution) -> Vec<Warning> {
    let mut warnings = Vec::new();
    for (p, plane) in solution.planes.iter().enumerate() {
        let residuals = &solution.refined.residuals[p];
        if plane.is_set_aside() {
            let distance = root_mean_square(residuals);
            warnings.push(Warning::PlaneSetAside { plane: p, distance });
            continue;
        }
        let mut rest = &residuals[..];
        for (f, figure) in plane.figures.iter().enumerate() {
            for (s, side) in figure.sides.iter().enumerate() {
                let (own, others) = rest.split_at(side.samples.len());
                rest = others;
                if side.set_aside {
                    warnings.push(Warning::SideSetAside {
                        plane: p,
                        figure: f,
                        side: s,
                        distance: root_mean_square(own),
                    });
                }
            }
        }
    }
    warnings
}

fn root_mean_square(residuals: &[Residual]) -> f64 {
    let squares: f64 = residuals.iter().map(|r| r.distance * r.distance).sum();
    (squares / residuals.len().max(1) as f64).sqrt()
}
