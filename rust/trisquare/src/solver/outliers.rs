//! Rejection of sides and planes that do not belong to the scene: bent, torn or covered sides, and
//! targets that are not squares. The criterion is how much better the rest agrees without them.

use super::problem::{Failure, JointProblem};
use super::solve::Solution;
use crate::lens::Lens;
use crate::noise::{Misfit, Moments, Noise, SideMoments};
use crate::observations::{Figure, ObservedPlane, Side, has_grid, relations_of};
use crate::refine::{Refined, root_mean_square, straightness_residuals};
use crate::result::Warning;
use crate::uncertainty::check_plane_count;

/// Distance of a plane's samples from a target, as a fraction of its mean side, above which it has
/// another shape: that of a rectangle of 1.06 : 1 from a square. Below, it may be a target of wrong
/// size, in which case the others are in doubt as well.
const OTHER_SHAPE: f64 = 0.01;

/// Minimum number of planes that remain after a rejection: with three, two cannot show which is
/// false.
const MIN_PLANES: usize = 3;

/// Mean square misfit above which the planes are in doubt.
const DOUBTED: f64 = 2.0;

/// Threshold for the rejection of a plane, on its contribution to the misfit per degree of freedom
/// over the misfit of the rest: by chance 4 is exceeded once in ten thousand times.
const FALSE_PLANE: f64 = 6.0;

/// Threshold on a side's mean square curvature, over that of the noise and of the other sides,
/// above which it is bent.
const BENT: f64 = 10.0;

/// Threshold for the rejection of a side, on its contribution to the misfit per degree of freedom
/// over the misfit of the rest: by chance 7 is exceeded once in ten thousand times, and there are
/// some twelve sides.
const FALSE_SIDE: f64 = 10.0;

/// Minimum fraction of the weight of every side left by the robust loss if a bent one is kept: the
/// standard deviations do not include the bend of a side that is mostly ignored.
const MIN_WEIGHT: f64 = 0.5;

/// Number of sides per rejected one, at least: with more outliers it cannot be decided which sides
/// are right.
const SIDES_PER_OUTLIER: usize = 4;

/// Number of planes up to which all planes and sides are tried. Every trial fits all planes, so
/// with more of them fewer are tried, those with the largest misfit first: the more planes
/// determine the camera, the less a false one biases it, and the more clearly it shows in its own
/// residuals.
const ALL_TRIED: usize = 16;

/// Total number of planes fitted in the trials, and in the rounds, each of which rejects one side.
const PLANES_FITTED: usize = ALL_TRIED * ALL_TRIED;

/// Minimum number of trials: the plane with the largest misfit may be a true one beside a false
/// one.
const MIN_TRIALS: usize = 3;

/// Number of sides of a square.
const SIDES: usize = 4;

/// Minimum number of sides that a plane keeps: these just determine its pose. Fewer would fit in
/// any case.
const MIN_SIDES: usize = 3;

/// The best camera for the sides and planes that agree, and warnings about the others.
///
/// # Errors
/// If no camera is found for any of the planes.
pub(crate) fn reject_outliers<L: Lens>(
    problem: &JointProblem<'_, L>,
    planes: &[ObservedPlane],
) -> Result<(Solution<L>, Vec<Warning>), Failure<L>> {
    let mut solution = match without_false_plane(problem, planes, problem.solve(planes)) {
        Err(failure) if failure.may_be_outliers() => {
            solved_without_bent_side(problem, planes).ok_or(failure)?
        }
        other => other?,
    };
    if solution.misfit(problem).mean() < DOUBTED {
        let warnings = warnings(&solution);
        return Ok((solution, warnings));
    }
    let sides: usize = planes.iter().map(|plane| plane.sides().count()).sum();
    let rounds = match planes.len() {
        ..=ALL_TRIED => sides / SIDES_PER_OUTLIER,
        many => trials(many),
    };
    let with_all_sides = solution.clone();
    let mut last_sound = None;
    for _ in 0..rounds {
        let Some(straighter) = without_bent_side(problem, &solution) else {
            break;
        };
        let before = std::mem::replace(&mut solution, straighter);
        if before.has_weight_on_all_sides() && !problem.is_ill_conditioned(&before) {
            last_sound = Some(before);
        }
    }
    // Sides are rejected only if the others agree without them, or if only one plane is bent.
    if solution.misfit(problem).mean() > DOUBTED && bent_plane(&with_all_sides).is_none() {
        (solution, last_sound) = (with_all_sides, None);
    }
    // A bent side may lead to a wrong optimum that appears weak, and from which no step leads back.
    if solution.misfit(problem).mean() > DOUBTED && problem.is_ill_conditioned(&solution) {
        solution = solved_without_bent_side(problem, planes).unwrap_or(solution);
    }
    if let Some(flatter) = without_bent_plane(problem, &solution) {
        (solution, last_sound) = (flatter, None);
    }
    // A side that the others cannot replace is kept: its bend increases the standard deviations.
    if let Some(sound) = last_sound
        && problem.is_ill_conditioned(&solution)
    {
        solution = sound;
    }
    let warnings = warnings(&solution);
    Ok((solution, warnings))
}

/// The best camera for all sides and planes, with its warnings: the result of [`reject_outliers`]
/// if that rejects none of them, without the search. `None` if they disagree, or if no camera is
/// found.
pub(crate) fn solution_if_agreed<L: Lens>(
    problem: &JointProblem<'_, L>,
    planes: &[ObservedPlane],
) -> Option<(Solution<L>, Vec<Warning>)> {
    let solution = problem.solve(planes).ok()?;
    let warnings = warnings(&solution);
    solution.agrees(problem).then_some((solution, warnings))
}

/// Number of planes, out of `planes`, that are left out in turn.
fn trials(planes: usize) -> usize {
    match planes {
        ..=ALL_TRIED => planes,
        many => (PLANES_FITTED / many).max(MIN_TRIALS),
    }
}

/// The items with the largest misfit.
fn largest_misfits<T: Copy>(mut items: Vec<(T, Misfit)>, count: usize) -> Vec<T> {
    items.sort_by(|(_, a), (_, b)| b.total().total_cmp(&a.total()));
    items.iter().take(count).map(|(item, _)| *item).collect()
}

/// Leaves out each plane in turn if they disagree, and rejects the one without which the others
/// agree much better, or only its one bent side. Of many planes only those with the largest misfit
/// are left out, starting from the optimum of all.
fn without_false_plane<L: Lens>(
    problem: &JointProblem<'_, L>,
    planes: &[ObservedPlane],
    all: Result<Solution<L>, Failure<L>>,
) -> Result<Solution<L>, Failure<L>> {
    let has_enough =
        planes.len() > MIN_PLANES && check_plane_count(planes.len() - 1, &problem.free).is_ok();
    let misfit = match &all {
        Ok(solution) => Some(solution.misfit(problem)),
        Err(failure) if failure.may_be_outliers() => None,
        Err(_) => return all,
    };
    if !has_enough || misfit.is_some_and(|misfit| misfit.mean() < DOUBTED) {
        return all;
    }
    let are_many = planes.len() > ALL_TRIED;
    let suspects = match &all {
        Ok(solution) if are_many => suspected_planes(solution),
        // Without a camera, nothing shows which of many planes to leave out.
        Err(_) if are_many => Vec::new(),
        _ => (0..planes.len()).collect(),
    };
    let without = |left_out: usize| {
        let mut rest = planes.to_vec();
        rest.remove(left_out);
        let refined = match &all {
            Ok(solution) if are_many => optimum_without_plane(problem, &rest, solution, left_out)?,
            _ => problem.trial_optimum(&rest)?,
        };
        Some((left_out, Trial::of(problem, rest, refined)))
    };
    let Some((index, trial)) = best(problem, suspects.into_iter().filter_map(without)) else {
        return all;
    };
    let is_false = misfit.is_none_or(|misfit| trial.gain(&misfit) > FALSE_PLANE);
    if !is_false {
        return all;
    }
    let with_follower = trial
        .converged(problem)
        .and_then(|found| problem.with_follower(&found, index, &planes[index]));
    match with_follower {
        Some(found) => Ok(with_straight_sides(problem, found, index)),
        None => all,
    }
}

/// The optimum of a solution's planes without one, starting from the optimum of all.
fn optimum_without_plane<L: Lens>(
    problem: &JointProblem<'_, L>,
    rest: &[ObservedPlane],
    all: &Solution<L>,
    left_out: usize,
) -> Option<Refined<L>> {
    let mut before = all.refined.clone();
    before.view = before.view.without_plane(left_out);
    problem.refit(rest, &before)
}

/// Restores the other sides of a rejected plane if only one of its sides is bent.
fn with_straight_sides<L: Lens>(
    problem: &JointProblem<'_, L>,
    found: Solution<L>,
    plane: usize,
) -> Solution<L> {
    let curvatures = curvatures(&found, plane);
    let bent: Vec<usize> = (0..curvatures.len())
        .filter(|s| curvatures[*s] > BENT)
        .collect();
    let [bent] = bent[..] else {
        return found;
    };
    let mut planes = found.planes.clone();
    for (index, side) in planes[plane].sides_mut().enumerate() {
        side.is_outlier = index == bent;
    }
    let mut refined = found.refined.clone();
    refined.view.relations = relations_of(&planes);
    refined.view.hold_relations();
    let refitted = problem
        .refit(&planes, &refined)
        .and_then(|refined| problem.converge(&planes, refined).ok());
    refitted
        .filter(|refitted| {
            refitted.misfit(problem).mean() < DOUBTED * found.misfit(problem).mean().max(1.0)
        })
        .unwrap_or(found)
}

impl<L: Lens> Solution<L> {
    fn misfit(&self, problem: &JointProblem<'_, L>) -> Misfit {
        let view = &self.refined.view;
        self.noise.as_ref().map_or(Misfit::NONE, |noise| {
            Misfit::of(&self.planes, view, &problem.free, noise)
        })
    }

    /// Whether no plane or side is in doubt.
    pub(crate) fn agrees(&self, problem: &JointProblem<'_, L>) -> bool {
        self.misfit(problem).mean() < DOUBTED
    }

    /// Whether the robust loss leaves every side in use most of its weight.
    fn has_weight_on_all_sides(&self) -> bool {
        self.ignored_sides().is_empty()
    }

    /// The sides in use from which the robust loss takes most of the weight: plane, and index over
    /// all its figures.
    fn ignored_sides(&self) -> Vec<(usize, usize)> {
        let Some(noise) = &self.noise else {
            return Vec::new();
        };
        let weight = |moments: &Moments| moments.gram[(0, 0)];
        let is_ignored = |side: &Side, moments: &SideMoments| {
            !side.is_outlier && weight(&moments.robust) <= MIN_WEIGHT * weight(&moments.plain)
        };
        let mut ignored = Vec::new();
        for (p, (plane, moments)) in self.planes.iter().zip(&noise.sides).enumerate() {
            let sides = plane.sides().zip(moments).enumerate();
            let ignored_of_plane = sides.filter(|(_, (side, moments))| is_ignored(side, moments));
            ignored.extend(ignored_of_plane.map(|(s, _)| (p, s)));
        }
        ignored
    }
}

/// The planes to be left out in trials: those with the largest misfit.
fn suspected_planes<L: Lens>(solution: &Solution<L>) -> Vec<usize> {
    let plane_misfits = |noise: &Noise| {
        let planes = 0..noise.sides.len();
        planes
            .map(|p| (p, Misfit::of_plane(noise, p)))
            .collect::<Vec<_>>()
    };
    let misfits = solution
        .noise
        .as_ref()
        .map(plane_misfits)
        .unwrap_or_default();
    largest_misfits(misfits, trials(solution.planes.len()))
}

/// The sides of squares to be left out in trials: all, or of many planes those with the largest
/// misfit.
fn suspected_sides<L: Lens>(solution: &Solution<L>) -> Vec<(usize, usize)> {
    let sides = sides_of_squares(&solution.planes);
    match &solution.noise {
        Some(noise) if solution.planes.len() > ALL_TRIED => {
            let side_misfit = |(p, s): (usize, usize)| ((p, s), Misfit::of_side(noise, p, s));
            let count = SIDES * trials(solution.planes.len());
            largest_misfits(sides.map(side_misfit).collect(), count)
        }
        _ => sides.collect(),
    }
}

fn has_only_squares(plane: &ObservedPlane) -> bool {
    plane.figures.iter().all(Figure::has_four_sides)
}

/// Plane, and index over all figures of the plane, of every side of a square that is in use and
/// without which its plane keeps enough sides.
fn sides_of_squares(planes: &[ObservedPlane]) -> impl Iterator<Item = (usize, usize)> {
    planes.iter().enumerate().flat_map(|(p, plane)| {
        let used_sides = plane.sides().filter(|side| !side.is_outlier).count();
        let can_lose_side = has_only_squares(plane) && used_sides > MIN_SIDES;
        let sides = plane.sides().enumerate().filter(move |_| can_lose_side);
        sides.filter_map(move |(s, side)| (!side.is_outlier).then_some((p, s)))
    })
}

/// Leaves out each side of a square from the start on, if all of them together gave no camera. Only
/// for few planes: among many, a single side is not the cause.
fn solved_without_bent_side<L: Lens>(
    problem: &JointProblem<'_, L>,
    planes: &[ObservedPlane],
) -> Option<Solution<L>> {
    if planes.len() > ALL_TRIED {
        return None;
    }
    let without = |place| {
        let rest = without_side(planes, place)?;
        let refined = problem.trial_optimum(&rest)?;
        Some((place, Trial::of(problem, rest, refined)))
    };
    let (place, trial) = best(problem, sides_of_squares(planes).filter_map(without))?;
    let found = trial.converged(problem)?;
    (trial.misfit.mean() < DOUBTED && trial.is_side_bent(&found, place)).then_some(found)
}

/// Leaves out each side of a square in turn if the sides disagree, and rejects the one without
/// which the others agree much better; `None` if there is none, or if it is straight: a straight
/// side in the wrong place belongs to a figure that is not a square.
fn without_bent_side<L: Lens>(
    problem: &JointProblem<'_, L>,
    solution: &Solution<L>,
) -> Option<Solution<L>> {
    let misfit = solution.misfit(problem);
    if misfit.mean() < DOUBTED {
        return None;
    }
    let without = |place| {
        if problem.work.is_spent() {
            return None;
        }
        let rest = without_side(&solution.planes, place)?;
        let refined = problem.refit(&rest, &solution.refined)?;
        Some((place, Trial::of(problem, rest, refined)))
    };
    let (place, trial) = best(
        problem,
        suspected_sides(solution).into_iter().filter_map(without),
    )?;
    if trial.gain(&misfit) < FALSE_SIDE {
        return None;
    }
    let found = trial.converged(problem)?;
    trial.is_side_bent(&found, place).then_some(found)
}

/// The only plane of squares with sides that are bent and ignored by the robust loss. A wrong lens
/// bends the sides of several planes.
fn bent_plane<L: Lens>(solution: &Solution<L>) -> Option<usize> {
    let ignored = solution.ignored_sides();
    let (index, _) = *ignored.first()?;
    let mut others = (0..solution.planes.len()).filter(|p| *p != index);
    let is_bent = |p: usize| {
        curvatures(solution, p)
            .iter()
            .any(|curvature| *curvature > BENT)
    };
    let is_only_bent = has_only_squares(&solution.planes[index])
        && ignored.iter().all(|(p, _)| *p == index)
        && is_bent(index)
        && !others.any(is_bent);
    is_only_bent.then_some(index)
}

/// Rejects a bent plane that cannot spare sides: of a sheet that curves about two of them, the
/// other two are bent alike. `None` if there is none, or if the rest do not determine the camera.
fn without_bent_plane<L: Lens>(
    problem: &JointProblem<'_, L>,
    solution: &Solution<L>,
) -> Option<Solution<L>> {
    let index = bent_plane(solution)?;
    let mut rest = solution.planes.clone();
    let plane = rest.remove(index);
    check_plane_count(rest.len(), &problem.free).ok()?;
    let refined = optimum_without_plane(problem, &rest, solution, index)?;
    let found = problem.converge(&rest, refined).ok()?;
    let found = problem.with_follower(&found, index, &plane)?;
    (!problem.is_ill_conditioned(&found)).then_some(found)
}

/// The planes with one more side rejected, given by plane and index over all its figures.
fn without_side(
    planes: &[ObservedPlane],
    (plane, side): (usize, usize),
) -> Option<Vec<ObservedPlane>> {
    let mut rest = planes.to_vec();
    rest[plane].sides_mut().nth(side)?.is_outlier = true;
    Some(rest)
}

/// The rest without a plane or a side, and its misfit.
struct Trial<L> {
    planes: Vec<ObservedPlane>,
    refined: Refined<L>,
    misfit: Misfit,
}

impl<L: Lens> Trial<L> {
    fn of(problem: &JointProblem<'_, L>, planes: Vec<ObservedPlane>, refined: Refined<L>) -> Self {
        let noise = Noise::of_optimum(&planes, &refined);
        let misfit = Misfit::of(&planes, &refined.view, &problem.free, &noise);
        Self {
            planes,
            refined,
            misfit,
        }
    }

    fn converged(&self, problem: &JointProblem<'_, L>) -> Option<Solution<L>> {
        problem.converge(&self.planes, self.refined.clone()).ok()
    }

    /// Mean square misfit, at least that of noise alone.
    fn base_misfit(&self) -> f64 {
        self.misfit.mean().max(1.0)
    }

    /// Contribution of the left-out part to the misfit of all, per degree of freedom and over the
    /// misfit of the rest.
    fn gain(&self, all: &Misfit) -> f64 {
        let added = all.total() - self.misfit.total();
        let freedom = (all.freedom() - self.misfit.freedom()).max(1.0);
        added / freedom / self.base_misfit()
    }

    /// Whether the left-out side is clearly more curved than the others.
    fn is_side_bent(&self, found: &Solution<L>, (plane, side): (usize, usize)) -> bool {
        curvatures(found, plane).get(side) > Some(&(BENT * self.base_misfit()))
    }
}

/// The trial whose rest agrees best; `None` if the work was spent before all were made.
fn best<L: Lens, T>(
    problem: &JointProblem<'_, L>,
    trials: impl Iterator<Item = (T, Trial<L>)>,
) -> Option<(T, Trial<L>)> {
    let found = trials.min_by(|(_, a), (_, b)| a.misfit.mean().total_cmp(&b.misfit.mean()));
    found.filter(|_| !problem.work.is_spent())
}

/// Mean square curvature of every side of a plane, in units of the noise.
///
/// Computed for the side's own line: the image of a straight side in the wrong place is curved
/// differently from that of its nominal line.
fn curvatures<L: Lens>(solution: &Solution<L>, plane: usize) -> Vec<f64> {
    let lens = &solution.refined.view.lens;
    let curvature = |noise: &Noise, side: &Side| {
        let residuals = straightness_residuals(lens, side)?;
        let misfit = Misfit::of_moments(
            &SideMoments::of(side, &residuals, noise.moment_scale),
            noise,
        );
        Some(misfit.curved / misfit.curved_freedom.max(1.0))
    };
    let sides = solution.planes[plane].sides();
    let noise = solution.noise.as_ref();
    let curvatures = sides.map(|side| {
        noise
            .and_then(|noise| curvature(noise, side))
            .unwrap_or(0.0)
    });
    curvatures.collect()
}

/// Whether a plane that does not fit is not a target, by the distance of its samples from one (px).
fn has_other_shape(plane: &ObservedPlane, distance: f64) -> bool {
    let length = |side: &Side| {
        let ends = side.samples.first().zip(side.samples.last());
        ends.map_or(0.0, |(first, last)| (last.pixel - first.pixel).norm())
    };
    let lengths: f64 = plane.sides().map(length).sum();
    let mean = lengths / plane.sides().count() as f64;
    distance > OTHER_SHAPE * mean && !plane.figures.iter().any(has_grid)
}

/// Warnings about the outliers.
fn warnings<L: Lens>(solution: &Solution<L>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut strays = Vec::new();
    for (p, plane) in solution.planes.iter().enumerate() {
        let residuals = &solution.refined.residuals[p];
        if plane.is_outlier() {
            let distance = root_mean_square(residuals.iter());
            warnings.push(Warning::PlaneRejected {
                plane: p,
                distance,
                is_other: has_other_shape(plane, distance),
            });
            continue;
        }
        let mut rest = &residuals[..];
        for (f, side) in plane.sides_by_figure() {
            let (side_residuals, others) = rest.split_at(side.samples.len());
            rest = others;
            if side.is_outlier {
                warnings.push(Warning::SideRejected {
                    plane: p,
                    figure: f,
                    side: side.number,
                    distance: root_mean_square(side_residuals.iter()),
                });
                continue;
            }
            let side_samples = side_residuals.iter().zip(&side.samples);
            let stray = side_samples.filter(|(residual, _)| !residual.is_counted);
            strays.extend(stray.map(|(residual, sample)| Stray {
                distance: residual.distance.abs(),
                place: [p, f, side.number, sample.index],
            }));
        }
    }
    let farthest = strays
        .iter()
        .max_by(|a, b| a.distance.total_cmp(&b.distance));
    warnings.extend(farthest.map(|stray| {
        let [plane, figure, side, sample] = stray.place;
        Warning::StraySamples {
            samples: strays.len(),
            plane,
            figure,
            side,
            sample,
            distance: stray.distance,
        }
    }));
    warnings
}

/// A sample far from its neighbours.
struct Stray {
    /// Distance from its line, pixels.
    distance: f64,
    /// Plane, outline, side and sample.
    place: [usize; 4],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observations::sort_by_plane;
    use crate::synthetic::{Scene, SceneOptions};

    #[test]
    fn a_square_that_lost_a_side_keeps_the_others() {
        let scene = Scene::random(4, SceneOptions::default());
        let mut planes = sort_by_plane(&scene.edges(3, 0.1, 6.0)).unwrap();
        let of_first = |planes: &[ObservedPlane]| {
            sides_of_squares(planes)
                .filter(|(plane, _)| *plane == 0)
                .count()
        };
        assert_eq!(of_first(&planes), SIDES);
        planes[0].sides_mut().next().unwrap().is_outlier = true;
        assert_eq!(of_first(&planes), 0);
        assert_eq!(
            sides_of_squares(&planes).count(),
            (planes.len() - 1) * SIDES
        );
    }
}
