//! Choosing among candidates: the largest set of squares that one camera explains.
//!
//! Where all candidates agree in one joint fit, all are kept, and nothing more is done. Otherwise
//! cameras are hypothesised (every plausible focal length with the principal point at the image
//! centre; and from pairs and triples of candidates, whatever camera they ask for), each is moved
//! to where it explains most, and the one with the most evidence is taken. Its squares go through
//! the joint fit, which drops what does not agree and takes back what does.

use crate::candidate_pool::Pool;
use crate::choice::{Choice, Doubt, Verdict};
use crate::covariance::check_plane_count;
use crate::explanation::{Explanation, squared_deviation};
use crate::hypotheses::{FOCAL_DOUBT, hypotheses, matrix_of, pinhole, prior, triples};
use crate::joint_fit::Fit;
use crate::linear::{Homographies, Undistortion, first_view};
use crate::misfit::Misfit;
use crate::observations::{ObservedPlane, sort_by_plane};
use crate::refine::{Refined, Residual, residuals, root_mean_square, search};
use crate::side_families::has_grid;
use crate::squareness::{Candidate, Pinhole};
use crate::straightness::Straightness;
use crate::task::Task;
use crate::{Brown, Error, Fixed, ImageSize, Method, Options, PlaneEdges, set_aside};

/// Candidates that must be there: of three, two cannot show which one is false.
const LEAST_CANDIDATES: usize = 4;

/// Boards that show a camera and their own errors: more than half of them are then right.
const LEAST_BOARDS: usize = 3;

/// Samples of each side that the choice looks at: a false square shows in few.
const SAMPLES_PER_SIDE: usize = 16;

/// A plane does not belong if it puts sides in the wrong place by so many times the variance of the
/// noise, per degree of freedom, of which it has two: chance does it once in three thousand times.
const FALSE_PLANE: f64 = 8.0;

/// Excluded candidates whose squared deviation is below this are put to the joint fit.
const WORTH_A_TRIAL: f64 = 60.0;

/// How many at most.
const MAX_TRIALS: usize = 12;

/// Rounds in which those planes are dropped that are so many times farther off than the median one.
const MAX_TRIMS: usize = 12;
const STICKS_OUT: f64 = 2.5;

/// Triples of an explanation's squares that are fitted where these do not agree: all of nine.
const MAX_SEEDS: usize = 84;

/// Squares that are in all explanations, and left out in turn where no joint fit agrees.
const MAX_SHARED: usize = 3;

/// Explanations that are followed up, and by how much less evidence they may have than the best.
const MAX_EXPLANATIONS: usize = 4;
const CONSIDERED: f64 = 8.0;

/// Of more candidates, every hypothesis is first weighed by so many, evenly chosen: they show which
/// cameras are worth weighing by all.
const MAX_WEIGHED: usize = 64;

/// What a square that agrees speaks for a joint fit: what one of median precision has in evidence.
const SQUARE_EVIDENCE: f64 = 5.0;

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

/// Chooses the largest set of planes that one camera sees as true squares.
///
/// Three planes or fewer are all kept, as are planes that agree.
///
/// # Errors
/// [`Error::InvalidArgument`] and its like for bad edges or options. That no camera is found is no
/// error: then nothing is dropped.
pub fn choose(edges: &[PlaneEdges], size: ImageSize, options: &Options) -> Result<Choice, Error> {
    size.check()?;
    options.check()?;
    let planes = sort_by_plane(edges)?;
    if planes.len() < LEAST_CANDIDATES {
        return Ok(Choice::of_all(&planes));
    }
    let thinned: Vec<_> = planes.iter().map(|p| p.thinned(SAMPLES_PER_SIDE)).collect();
    let options = Options {
        method: Method::MaximumLikelihood,
        ..*options
    };
    let task = Task::new(size, &options);
    let Straightness { undistortion, bent } = Straightness::of(&thinned, &task);
    let chooser = Chooser {
        task,
        planes: &thinned,
        bent,
        pool: Pool::of(&thinned, undistortion, size),
    };
    if chooser.all_agree() {
        return Ok(Choice::of_all(&thinned));
    }
    if let Some(choice) = chooser.beside_boards() {
        return Ok(choice);
    }
    let found = chooser.choice();
    Ok(found
        .filter(|choice| !chooser.is_set_aside_anyway(choice))
        .unwrap_or_else(|| Choice::of_all(&thinned)))
}

struct Chooser<'a> {
    task: Task<'a>,
    planes: &'a [ObservedPlane],
    pool: Pool,
    /// Mean square curvature of the sides where they are as straight as a lens can make them, in
    /// units of their noise; at least 1.
    bent: f64,
}

impl Chooser<'_> {
    fn agrees(&self, fit: &Fit) -> bool {
        fit.agrees(self.bent)
    }

    /// Whether the one plane that a choice drops is found false, or bent on one side, by the fit of
    /// all planes as well: that one names it, and may keep its other sides.
    fn is_set_aside_anyway(&self, choice: &Choice) -> bool {
        let mut dropped = (0..self.planes.len()).filter(|i| !choice.verdicts[*i].kept);
        let (Some(one), None, None) = (dropped.next(), dropped.next(), choice.doubt) else {
            return false;
        };
        set_aside::agreeing(&self.task, self.planes)
            .is_ok_and(|(solution, _)| solution.planes[one].sides().any(|side| side.set_aside))
    }

    fn all_agree(&self) -> bool {
        let all: Vec<usize> = (0..self.planes.len()).collect();
        let refined = self.task.optimum(self.planes);
        refined.is_ok_and(|refined| self.agrees(&self.judged(&all, self.planes, refined)))
    }

    /// What agrees with boards as well as these among themselves, where they show the camera alone:
    /// a board is no chance find, and its paper need not be as flat as its noise is small.
    fn beside_boards(&self) -> Option<Choice> {
        let is_board = |i: &usize| self.planes[*i].figures.iter().any(has_grid);
        let boards: Vec<usize> = (0..self.planes.len()).filter(is_board).collect();
        let planes: Vec<_> = boards.iter().map(|i| self.planes[*i].clone()).collect();
        if boards.len() < LEAST_BOARDS {
            return None;
        }
        let refined = self.task.optimum(&planes).ok()?;
        if self.task.weakness(&planes, &refined).is_some() {
            return None;
        }
        let of_board = |own: &Vec<Residual>| root_mean_square(own.iter());
        let distances: Vec<f64> = refined.residuals.iter().map(of_board).collect();
        let mut sorted = distances.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = STICKS_OUT * sorted[sorted.len() / 2];
        let verdict = |(i, plane): (usize, &ObservedPlane)| {
            let residual = match boards.binary_search(&i) {
                Ok(place) => Some(distances[place]),
                Err(_) => self.residual(plane, &refined.view.lens),
            };
            let kept = residual.is_some_and(|residual| residual <= limit);
            Verdict {
                figure: plane.figures[0].index,
                kept,
                residual: residual.filter(|_| !kept),
            }
        };
        let verdicts: Vec<Verdict> = self.planes.iter().enumerate().map(verdict).collect();
        let rejected = (0..self.planes.len()).filter(|i| !verdicts[*i].kept);
        Some(Choice {
            doubt: self.rival_of_boards(&rejected.collect::<Vec<_>>()),
            verdicts,
        })
    }

    /// The doubt that as many others agree on another camera: the boards may be a picture's in the
    /// picture.
    fn rival_of_boards(&self, rejected: &[usize]) -> Option<Doubt> {
        if rejected.len() < LEAST_BOARDS {
            return None;
        }
        let planes: Vec<_> = rejected.iter().map(|i| self.planes[*i].clone()).collect();
        let fit = self.judged(rejected, &planes, self.task.optimum(&planes).ok()?);
        self.agrees(&fit).then(|| Doubt::Rival {
            squares: rejected.len(),
            focal: fit.refined.view.lens.focal().x,
        })
    }

    /// The joint fit of some planes, searched from a camera.
    fn fit(&self, members: &[usize], start: &Pinhole) -> Option<Fit> {
        let Task {
            size,
            options,
            free,
            judged,
        } = &self.task;
        check_plane_count(members.len(), free).ok()?;
        let planes: Vec<_> = members.iter().map(|i| self.planes[*i].clone()).collect();
        let view = first_view(
            &matrix_of(start, self.task.size),
            &self.pool.homographies_of(members),
            &planes,
            &self.pool.undistortion,
            *size,
            options,
        );
        let found = search(&planes, free, view.ok()?)?;
        let refined = Refined::of_linear(&planes, free, judged, found.view)?;
        Some(self.judged(members, &planes, refined))
    }

    fn judged(&self, members: &[usize], planes: &[ObservedPlane], refined: Refined<Brown>) -> Fit {
        let misfit = match refined.is_exact() {
            true => Misfit::NONE,
            false => Misfit::of(
                planes,
                &refined.view,
                &self.task.free,
                &refined.noise(planes),
            ),
        };
        Fit {
            members: members.to_vec(),
            camera: pinhole(&refined.view.lens.camera_matrix(), self.task.size),
            refined,
            misfit,
        }
    }

    fn choice(&self) -> Option<Choice> {
        let explanations = self.explanations();
        let best = explanations.first()?;
        let mut fits = self.fits(&explanations);
        if !fits.iter().any(|fit| self.agrees(fit)) {
            fits.extend(self.fits_without_one_of_all(&explanations));
        }
        let order = |fit: &Fit| (self.agrees(fit), self.worth(fit));
        fits.sort_by(|a, b| {
            let ((a_agrees, a), (b_agrees, b)) = (order(a), order(b));
            b_agrees.cmp(&a_agrees).then(b.total_cmp(&a))
        });
        let (members, lens) = match fits.first() {
            Some(fit) => (fit.members.clone(), Some(fit.refined.view.lens)),
            None => (self.pool.squares(best), None),
        };
        let verdict = |(i, plane): (usize, &ObservedPlane)| {
            let kept = members.contains(&i);
            let lens = lens.as_ref().filter(|_| !kept);
            Verdict {
                figure: plane.figures[0].index,
                kept,
                residual: lens.and_then(|lens| self.residual(plane, lens)),
            }
        };
        Some(Choice {
            verdicts: self.planes.iter().enumerate().map(verdict).collect(),
            doubt: self.doubt(best, &fits),
        })
    }

    /// The joint fits that the best of some explanations lead to.
    fn fits(&self, explanations: &[Explanation]) -> Vec<Fit> {
        let mut fits = Vec::new();
        for explanation in explanations {
            if explanations[0].evidence - explanation.evidence < CONSIDERED {
                self.add_fits(explanation, &mut fits);
            }
        }
        fits
    }

    /// The joint fits that agree once a square is left out which is in all explanations: one that
    /// is known so well as a board is in any, also where another camera saw it.
    fn fits_without_one_of_all(&self, explanations: &[Explanation]) -> Vec<Fit> {
        let in_all = |plane: &usize| {
            let mut sets = explanations.iter().map(|one| self.pool.squares(one));
            sets.all(|squares| squares.contains(plane))
        };
        let places = self.pool.places.iter().copied();
        let shared = places.filter(in_all).take(MAX_SHARED);
        let mut fits = Vec::new();
        for plane in shared {
            let others = Chooser {
                task: Task::new(self.task.size, self.task.options),
                planes: self.planes,
                pool: self.pool.without(plane),
                bent: self.bent,
            };
            fits.extend(others.fits(&others.explanations()));
        }
        fits.retain(|fit| self.agrees(fit));
        fits
    }

    /// The joint fits that an explanation leads to: of its squares, or of those that agree.
    fn add_fits(&self, explanation: &Explanation, fits: &mut Vec<Fit>) {
        let squares = self.pool.squares(explanation);
        let start = &explanation.camera;
        let mut keep = |fit: Fit| {
            let known = |members: &[usize]| {
                let within = |known: &&Fit| members.iter().all(|i| known.members.contains(i));
                fits.iter().any(|fit| self.agrees(fit) && within(&fit))
            };
            if !known(&fit.members) {
                let grown = self.with_others(fit, explanation);
                if !known(&grown.members) {
                    fits.push(grown);
                }
            }
        };
        match self.fit(&squares, start) {
            Some(fit) if self.agrees(&fit) || squares.len() < LEAST_CANDIDATES => keep(fit),
            Some(fit) => {
                if let Some(trimmed) = self.trimmed(&fit) {
                    keep(trimmed);
                }
                for seed in triples(&squares, MAX_SEEDS) {
                    if let Some(seed) = self.fit(&seed, start).filter(|seed| self.agrees(seed)) {
                        keep(seed);
                    }
                }
                if fits.is_empty() {
                    fits.push(fit);
                }
            }
            None => {}
        }
    }

    /// What speaks for a joint fit: squares that do not stand alike, and an ordinary camera.
    fn worth(&self, fit: &Fit) -> f64 {
        fit.standing_apart() * SQUARE_EVIDENCE - prior(&self.task).cost(&fit.camera)
    }

    /// All that cameras make of the candidates, from the most evidence to the least.
    fn explanations(&self) -> Vec<Explanation> {
        let prior = prior(&self.task);
        let mut doubt = prior.std;
        doubt[0] = doubt[0].min(FOCAL_DOUBT);
        let all = &self.pool.candidates;
        let starts = hypotheses(&self.task, &self.pool, &prior);
        let explained = |candidates: &[Candidate], starts: Vec<Pinhole>| {
            let settled = |start| Explanation::settled(candidates, &prior, start, &doubt);
            best_different(starts.into_iter().filter_map(settled).collect())
        };
        if all.len() <= MAX_WEIGHED {
            return explained(all, starts);
        }
        let step = all.len().div_ceil(MAX_WEIGHED);
        let some: Vec<Candidate> = all.iter().step_by(step).cloned().collect();
        let best = explained(&some, starts);
        explained(all, best.into_iter().map(|found| found.camera).collect())
    }

    /// What agrees of a fit once the planes that stick out are dropped, if anything does.
    fn trimmed(&self, fit: &Fit) -> Option<Fit> {
        let mut rest = self.fit(&fit.members, &fit.camera)?;
        for _ in 0..MAX_TRIMS {
            if self.agrees(&rest) {
                return Some(rest);
            }
            let mut distances = rest.distances();
            distances.sort_by(|a, b| a.0.total_cmp(&b.0));
            let limit = STICKS_OUT * distances[distances.len() / 2].0;
            let within = distances.iter().filter(|(distance, _)| *distance <= limit);
            let mut members: Vec<usize> = within.map(|(_, plane)| *plane).collect();
            if members.len() == distances.len() {
                // Nobody sticks out, but they do not agree: the farthest must go.
                members.pop();
            }
            if members.len() + 1 < LEAST_CANDIDATES {
                return None;
            }
            members.sort_unstable();
            rest = self.fit(&members, &rest.camera)?;
        }
        None
    }

    /// Takes back what agrees in the joint fit, the most promising first.
    fn with_others(&self, mut fit: Fit, explanation: &Explanation) -> Fit {
        let mut others: Vec<(f64, usize)> = self
            .pool
            .candidates
            .iter()
            .zip(&self.pool.places)
            .filter(|(_, place)| !fit.members.contains(place))
            .filter_map(|(c, place)| Some((squared_deviation(c, explanation)?, *place)))
            .filter(|(square, _)| *square < WORTH_A_TRIAL)
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, other) in others.into_iter().take(MAX_TRIALS) {
            let mut members = fit.members.clone();
            members.push(other);
            members.sort_unstable();
            if let Some(more) = self.fit(&members, &fit.camera)
                && fit.strain(&more) < FALSE_PLANE * self.bent
                && self.agrees(&more)
            {
                fit = more;
            }
        }
        fit
    }

    /// How far a plane's samples are from the best square that a camera allows.
    fn residual(&self, plane: &ObservedPlane, lens: &Brown) -> Option<f64> {
        let options = Options {
            fixed: Fixed {
                aspect: true,
                principal_point: true,
                focal: true,
                distortion: true,
            },
            initial: Some(*lens),
            ..*self.task.options
        };
        let one = std::slice::from_ref(plane);
        let known = Undistortion::Known(*lens);
        let homographies = Homographies::estimate(one, &known).ok()?;
        let matrix = lens.camera_matrix();
        let start = first_view(
            &matrix,
            &homographies,
            one,
            &known,
            self.task.size,
            &options,
        );
        let found = search(one, &options.free_parameters(), start.ok()?)?;
        let residuals = residuals(one, &found.view)?;
        let distance = root_mean_square(residuals.iter().flatten());
        distance.is_finite().then_some(distance)
    }

    fn doubt(&self, best: &Explanation, fits: &[Fit]) -> Option<Doubt> {
        let (chosen, others) = fits.split_first()?;
        let lens = chosen.refined.view.lens;
        let focal = |fit: &Fit| fit.refined.view.lens.focal().x;
        let close = self.worth(chosen) - CLOSE_RIVAL;
        let rival = others.iter().find(|other| {
            (focal(other) / focal(chosen)).ln().abs() > DIFFERENT_FOCAL && self.worth(other) > close
        });
        if let Some(rival) = rival {
            return Some(Doubt::Rival {
                squares: rival.members.len(),
                focal: focal(rival),
            });
        }
        let unknowns = self
            .task
            .options
            .known_intrinsics(&self.task.size)
            .unknowns();
        // Two equations each: where no more are left than unknowns, any squares agree.
        let exact =
            !self.task.options.fixed.focal && 2.0 * chosen.standing_apart() < unknowns as f64 + 1.0;
        if exact || best.evidence < LEAST_EVIDENCE {
            return Some(Doubt::Chance);
        }
        let aspect = lens.focal().y / lens.focal().x;
        let offset = (lens.principal_point() - self.task.size.centre()).norm();
        let unit = self.task.size.half_diagonal();
        let odd = aspect.ln().abs() > ODD_ASPECT || offset > ODD_CENTRE * unit;
        (odd && self.task.options.initial.is_none()).then_some(Doubt::OddCamera { aspect, offset })
    }
}

/// The explanations with the most evidence, of those that take the same squares only one.
fn best_different(mut found: Vec<Explanation>) -> Vec<Explanation> {
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    let mut different: Vec<Explanation> = Vec::new();
    for explanation in found {
        if different
            .iter()
            .all(|known| !known.squares().eq(explanation.squares()))
        {
            different.push(explanation);
        }
        if different.len() == MAX_EXPLANATIONS {
            break;
        }
    }
    different
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::Vector2;

    const NOISE: f64 = 0.1;

    /// Squares of three pictures of one camera.
    fn squares(seed: u64) -> (Scene, Vec<PlaneEdges>) {
        let first = Scene::random(seed, SceneOptions::default());
        let mut edges = first.edges(seed, NOISE, 8.0);
        for (image, another) in [
            (1, first.another(seed + 100)),
            (2, first.another(seed + 200)),
        ] {
            edges.extend(
                another
                    .edges(seed + image, NOISE, 8.0)
                    .into_iter()
                    .map(|figure| PlaneEdges {
                        image: image as usize,
                        ..figure
                    }),
            );
        }
        (first, edges)
    }

    /// Stretches a figure's image about its middle: no camera sees a square there.
    fn stretched(mut figure: PlaneEdges, by: f64) -> PlaneEdges {
        let all: Vec<Vector2<f64>> = figure.points.iter().flatten().copied().collect();
        let middle = all.iter().sum::<Vector2<f64>>() / all.len() as f64;
        for point in figure.points.iter_mut().flatten() {
            point.x = middle.x + (point.x - middle.x) * by;
        }
        figure
    }

    fn kept(choice: &Choice) -> Vec<bool> {
        choice.verdicts.iter().map(|verdict| verdict.kept).collect()
    }

    #[test]
    fn squares_that_agree_are_all_kept() {
        for seed in 0..4 {
            let (scene, edges) = squares(seed);
            let found = choose(&edges, scene.size, &Options::default()).unwrap();
            assert_eq!(kept(&found), [true; 9]);
            assert_eq!(found.doubt, None);
        }
    }

    #[test]
    fn what_one_camera_does_not_see_as_squares_is_dropped_with_its_residual() {
        for seed in 0..4 {
            let (scene, mut edges) = squares(seed);
            // More than half are false, each in its own way.
            for (i, by) in [(0, 0.6), (2, 0.75), (4, 1.3), (5, 0.8), (8, 0.5)] {
                edges[i] = stretched(edges[i].clone(), by);
            }
            let found = choose(&edges, scene.size, &Options::default()).unwrap();
            let expected = [false, true, false, true, false, false, true, true, false];
            assert_eq!(kept(&found), expected, "seed {seed}");
            for verdict in &found.verdicts {
                match verdict.kept {
                    true => assert_eq!(verdict.residual, None),
                    false => assert!(verdict.residual.unwrap() > 2.0 * NOISE),
                }
            }
        }
    }

    #[test]
    fn three_planes_are_never_dropped() {
        let (scene, mut edges) = squares(7);
        edges.truncate(3);
        edges[1] = stretched(edges[1].clone(), 0.7);
        let found = choose(&edges, scene.size, &Options::default()).unwrap();
        assert_eq!(kept(&found), [true; 3]);
    }

    #[test]
    fn figures_of_no_extent_are_no_crash() {
        let (scene, mut edges) = squares(8);
        for figure in &mut edges[..6] {
            for point in figure.points.iter_mut().flatten() {
                *point = Vector2::new(100.0, 100.0);
            }
        }
        let found = choose(&edges, scene.size, &Options::default()).unwrap();
        assert_eq!(found.verdicts.len(), 9);
    }
}
