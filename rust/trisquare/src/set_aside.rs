//! Sides and planes that do not belong to the scene: bent, torn or covered sides, and targets that
//! are no squares. They are found by how much better the rest agrees without them.

use crate::Error;
use crate::covariance::check_plane_count;
use crate::local_noise::Noise;
use crate::misfit::Misfit;
use crate::observations::ObservedPlane;
use crate::refine::Residual;
use crate::result::Warning;
use crate::task::{Solution, Task};

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

/// A side is set aside if what it adds to the misfit is, per degree of freedom, so many times what
/// remains without it: chance makes it 7 once in ten thousand times, and there are some twelve.
const FALSE_SIDE: f64 = 10.0;

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
    let mut solution = match without_false_plane(task, planes, task.solve(planes)) {
        Err(error @ (Error::NotConverged { .. } | Error::WeakGeometry(_))) => {
            solved_without_bent_side(task, planes).ok_or(error)?
        }
        other => other?,
    };
    let sides: usize = planes.iter().map(|plane| plane.sides().count()).sum();
    for _ in 0..sides / SIDES_PER_OUTLIER {
        match without_bent_side(task, &solution) {
            Some(straighter) => solution = straighter,
            None => break,
        }
    }
    // A bent side may lead to a wrong optimum, which looks weak, and from which no step leads back.
    if solution.misfit(task).mean() > DOUBTED && task.is_weak(&solution) {
        solution = solved_without_bent_side(task, planes).unwrap_or(solution);
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
        let noise = refined.noise(&rest);
        let misfit = Misfit::of(&rest, &refined.view, &task.free, &noise);
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
    let curvatures = curvatures(&found, plane);
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
        let view = &self.refined.view;
        self.noise.as_ref().map_or(Misfit::NONE, |noise| {
            Misfit::of(&self.planes, view, &task.free, noise)
        })
    }
}

/// Plane, and index over all figures of the plane, of every side of a square that counts.
fn sides_of_squares(planes: &[ObservedPlane]) -> impl Iterator<Item = (usize, usize)> {
    planes.iter().enumerate().flat_map(|(p, plane)| {
        let squares = plane.figures.iter().all(|figure| figure.sides.len() == 4);
        let sides = plane.sides().enumerate().filter(move |_| squares);
        sides.filter_map(move |(s, side)| (!side.set_aside).then_some((p, s)))
    })
}

/// Leaves out each side of a square from the start on, where all of them together gave no camera.
fn solved_without_bent_side(task: &Task<'_>, planes: &[ObservedPlane]) -> Option<Solution> {
    let without = |(plane, side): (usize, usize)| {
        let mut rest = planes.to_vec();
        rest[plane].side_mut(side)?.set_aside = true;
        let refined = task.optimum(&rest).ok()?;
        let misfit = Misfit::of(&rest, &refined.view, &task.free, &refined.noise(&rest));
        Some((plane, side, rest, refined, misfit))
    };
    let (plane, side, rest, refined, misfit) = sides_of_squares(planes)
        .filter_map(without)
        .min_by(|a, b| a.4.mean().total_cmp(&b.4.mean()))?;
    let found = task.settle(&rest, refined).ok()?;
    let bent = curvatures(&found, plane).get(side) > Some(&(BENT * misfit.mean().max(1.0)));
    (misfit.mean() < DOUBTED && bent).then_some(found)
}

/// Leaves out each side of a square in turn where the sides disagree, and sets the one aside
/// without which the others agree much better; `None` if there is none, or if it is straight: a
/// straight side in the wrong place belongs to a square that is none.
fn without_bent_side(task: &Task<'_>, solution: &Solution) -> Option<Solution> {
    let misfit = solution.misfit(task);
    if misfit.mean() < DOUBTED {
        return None;
    }
    let without = |(plane, side): (usize, usize)| {
        let mut planes = solution.planes.clone();
        planes[plane].side_mut(side)?.set_aside = true;
        let refined = task.again(&planes, &solution.refined)?;
        let noise = refined.noise(&planes);
        let remaining = Misfit::of(&planes, &refined.view, &task.free, &noise);
        Some((plane, side, planes, refined, remaining))
    };
    let (plane, side, planes, refined, remaining) = sides_of_squares(&solution.planes)
        .filter_map(without)
        .min_by(|a, b| a.4.mean().total_cmp(&b.4.mean()))?;
    let ordinary = remaining.mean().max(1.0);
    let added = misfit.total() - remaining.total();
    let freedom = (misfit.freedom() - remaining.freedom()).max(1.0);
    if added < FALSE_SIDE * freedom * ordinary {
        return None;
    }
    let found = task.settle(&planes, refined).ok()?;
    let bent = curvatures(&found, plane).get(side) > Some(&(BENT * ordinary));
    bent.then_some(found)
}

/// Mean square curvature of every side of a plane, in units of the noise.
fn curvatures(solution: &Solution, plane: usize) -> Vec<f64> {
    let curvature = |noise: &Noise| {
        let mean = |side: usize| {
            let misfit = Misfit::of_side(noise, plane, side);
            misfit.curved / misfit.curved_freedom.max(1.0)
        };
        (0..noise.sides[plane].len()).map(mean).collect()
    };
    solution.noise.as_ref().map(curvature).unwrap_or_default()
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
