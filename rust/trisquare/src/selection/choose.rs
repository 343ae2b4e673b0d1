//! Choice among candidates: the largest set of squares that one camera explains.
//!
//! If all candidates agree in one joint fit, all are kept. Otherwise cameras are hypothesised
//! (every plausible focal length with the principal point at the image centre, and the cameras
//! determined by pairs and triples of candidates), each is moved to where it explains most, and the
//! one with the most evidence is used. Its squares go through the joint fit, which drops those that
//! do not agree and restores those that do.

use std::cell::{LazyCell, OnceCell};

use super::hypothesis::Hypothesis;
use super::inliers::{Inliers, MAX_DISTANCE_RATIO, MAX_FITTED, MIN_CANDIDATES, is_triple};
use super::joint_fit::JointFit;
use super::propose::propose;
use super::straightness::CURVED;
use super::verdict::{Choice, MIN_BOARDS, Verdict, doubt_of_boards, doubt_of_choice};
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::numeric::upper_median;
use crate::observations::{Method, ObservedPlane, Options, PlaneEdges, has_grid, sort_by_plane};
use crate::refine::{Refined, Residual, residuals, root_mean_square};
use crate::solver::{JointProblem, reject_outliers};

/// Residual (px) under the boards' camera up to which a board is always kept: paper is not flatter
/// than that.
const MAX_BOARD_RESIDUAL: f64 = 0.1;

/// Number of samples per side used for the choice: they suffice to show a false square.
const SAMPLES_PER_SIDE: usize = 16;

/// Maximum number of times the choice is repeated with a better lens: a lens clearly wrong in the
/// first round is right in the third.
const MAX_LENSES: usize = 2;

/// Chooses the largest set of planes that one camera sees as true squares.
///
/// Three planes or fewer are all kept, and so are planes that agree.
///
/// ```
/// use trisquare::{Calibration, Error, ImageSize, Options, PlaneEdges, calibrate, choose};
///
/// /// From outlines of which some may be windows or tiles that are no squares.
/// fn camera_of(edges: &[PlaneEdges], size: ImageSize) -> Result<Calibration, Error> {
///     let options = Options::default();
///     let mut kept = edges.to_vec();
///     choose(edges, size, &options)?.keep(&mut kept);
///     calibrate(&kept, size, &options)
/// }
/// ```
///
/// # Errors
/// [`Error::InvalidArgument`] or another error for bad edges or options. It is no error if no
/// camera is found: nothing is dropped then.
pub fn choose<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Result<Choice, Error> {
    size.check()?;
    options.check()?;
    let planes = sort_by_plane(edges)?;
    if planes.len() < MIN_CANDIDATES {
        return Ok(Choice::keeping_all(&planes, None));
    }
    let subsampled: Vec<_> = planes
        .iter()
        .map(|p| p.subsampled(SAMPLES_PER_SIDE))
        .collect();
    let options = Options {
        method: Method::MaximumLikelihood,
        ..*options
    };
    let problem = JointProblem::new(size, &options);
    let chooser = Chooser(Inliers {
        problem: &problem,
        planes: &subsampled,
        pool: &OnceCell::new(),
    });
    let boards = chooser.boards();
    let are_mixed = boards.len() < subsampled.len();
    let camera = LazyCell::new(|| chooser.board_camera(boards));
    let has_bent_boards = are_mixed && camera.as_ref().is_some_and(BoardCamera::are_bent);
    if !has_bent_boards && let Some(residual) = chooser.residual_if_agreed() {
        return Ok(Choice::keeping_all(&subsampled, Some(residual)));
    }
    if let Some(camera) = camera.as_ref() {
        return Ok(chooser.choice_by_boards(camera));
    }
    Ok(match chooser.choice() {
        Some(choice) if !chooser.is_outlier_in_fit(&choice) => choice,
        found => Choice::keeping_all(&subsampled, found.and_then(|choice| choice.residual)),
    })
}

struct Chooser<'a, L: Lens>(Inliers<'a, L>);

/// The camera determined by the boards alone, under the assumption that they are flat.
struct BoardCamera<L: Lens> {
    boards: Vec<usize>,
    refined: Refined<L>,
    /// Root mean square distance of each board's samples from its lines, px.
    distances: Vec<f64>,
    /// Upper median of them.
    median_distance: f64,
}

impl<L: Lens> BoardCamera<L> {
    fn are_bent(&self) -> bool {
        self.median_distance > MAX_BOARD_RESIDUAL
    }
}

impl<L: Lens> Chooser<'_, L> {
    /// Whether the fit of all planes also rejects sides of the one plane that a choice drops: that
    /// fit names them, and may keep its other sides.
    fn is_outlier_in_fit(&self, choice: &Choice) -> bool {
        let mut dropped = (0..self.0.planes.len()).filter(|i| !choice.verdicts[*i].kept);
        let (Some(plane), None, None) = (dropped.next(), dropped.next(), choice.doubt) else {
            return false;
        };
        reject_outliers(self.0.problem, self.0.planes)
            .is_ok_and(|(solution, _)| solution.planes[plane].sides().any(|side| side.is_outlier))
    }

    /// Root mean square residual (px) under the camera of all planes, if they agree.
    fn residual_if_agreed(&self) -> Option<f64> {
        let all: Vec<usize> = (0..self.0.planes.len()).collect();
        // Among many planes, a part of them shows a disagreement as well, and otherwise
        // approximates the camera.
        let step = all.len().div_ceil(MAX_FITTED);
        let refined = if step > 1 {
            let subset: Vec<usize> = all.iter().copied().step_by(step).collect();
            let planes: Vec<_> = subset.iter().map(|i| self.0.planes[*i].clone()).collect();
            let subset_fit = self.0.problem.subset_optimum(&planes)?;
            let subset_fit = self.0.evaluated(&subset, &planes, subset_fit);
            if !self.0.agrees(&subset_fit) {
                return None;
            }
            let lens = &subset_fit.refined.view.lens;
            self.0.problem.optimum_from(lens, self.0.planes)
        } else {
            None
        };
        let refined = refined.or_else(|| self.0.problem.optimum(self.0.planes).ok())?;
        let fit = self.0.evaluated(&all, self.0.planes, refined);
        self.0.agrees(&fit).then(|| fit.refined.rms())
    }

    fn boards(&self) -> Vec<usize> {
        let is_board = |i: &usize| self.0.planes[*i].figures.iter().any(has_grid);
        (0..self.0.planes.len()).filter(is_board).collect()
    }

    /// The camera determined by the boards alone; `None` if they do not determine it.
    fn board_camera(&self, boards: Vec<usize>) -> Option<BoardCamera<L>> {
        if boards.len() < MIN_BOARDS {
            return None;
        }
        let planes: Vec<_> = boards.iter().map(|i| self.0.planes[*i].clone()).collect();
        let refined = self.0.problem.optimum(&planes).ok()?;
        if self.0.problem.ill_conditioning(&planes, &refined).is_some() {
            return None;
        }
        let board_distance = |residuals: &Vec<Residual>| root_mean_square(residuals.iter());
        let distances: Vec<f64> = refined.residuals.iter().map(board_distance).collect();
        Some(BoardCamera {
            median_distance: upper_median(distances.clone())?,
            boards,
            distances,
            refined,
        })
    }

    /// Keeps the planes that agree with the boards as well as these do with each other: a board is
    /// not found by chance, and its paper need not be as flat as its noise is small.
    fn choice_by_boards(&self, camera: &BoardCamera<L>) -> Choice {
        let lens = &camera.refined.view.lens;
        let limit = MAX_DISTANCE_RATIO * camera.median_distance;
        // With bent boards the limit would accept anything.
        let other_limit = if camera.are_bent() { 0.0 } else { limit };
        let verdict = |(i, plane): (usize, &ObservedPlane)| {
            let (residual, limit) = match camera.boards.binary_search(&i) {
                Ok(place) => (Some(camera.distances[place]), limit.max(MAX_BOARD_RESIDUAL)),
                Err(_) => (self.residual(plane, lens), other_limit),
            };
            let kept = residual.is_some_and(|residual| residual <= limit);
            Verdict {
                figure: plane.figures[0].index,
                kept,
                residual: residual.filter(|_| !kept),
            }
        };
        let verdicts: Vec<Verdict> = self.0.planes.iter().enumerate().map(verdict).collect();
        let rejected = (0..self.0.planes.len()).filter(|i| !verdicts[*i].kept);
        Choice {
            doubt: doubt_of_boards(&self.0, &rejected.collect::<Vec<_>>()),
            residual: Some(camera.refined.rms()),
            verdicts,
        }
    }

    fn choice(&self) -> Option<Choice> {
        self.choice_with_lenses(MAX_LENSES)
    }

    /// The choice with the lens improved up to `lenses` times from the planes fitted so far.
    fn choice_with_lenses(&self, lenses: usize) -> Option<Choice> {
        let (best, fits) = self.fits()?;
        let pool = (lenses > 0).then(|| self.0.pool_by_fits(&best, &fits));
        let Some(pool) = pool.flatten() else {
            return Some(self.choice_of(&best, fits));
        };
        let pool = OnceCell::from(pool);
        let next_chooser = Chooser(Inliers {
            pool: &pool,
            ..self.0
        });
        next_chooser.choice_with_lenses(lenses - 1)
    }

    /// The best hypothesis, and the joint fits of all.
    fn fits(&self) -> Option<(Hypothesis, Vec<JointFit<L>>)> {
        let inliers = &self.0;
        let hypotheses = propose(inliers.problem, inliers.pool());
        let best = hypotheses.first()?.clone();
        let mut fits = inliers.fits(&hypotheses);
        if !fits.iter().any(|fit| inliers.agrees(fit)) {
            fits.extend(inliers.fits_without_common_square(&hypotheses));
        }
        let curvature = inliers.pool().curvature.min(CURVED);
        if !fits
            .iter()
            .any(|fit| is_triple(fit) && fit.agrees(curvature))
        {
            fits.extend(inliers.fits_of_triples(&best));
        }
        Some((best, fits))
    }

    /// The choice of the joint fit that agrees and is worth most.
    fn choice_of(&self, best: &Hypothesis, mut fits: Vec<JointFit<L>>) -> Choice {
        let inliers = &self.0;
        let rank = |fit: &JointFit<L>| (inliers.agrees(fit), inliers.worth(fit));
        fits.sort_by(|a, b| {
            let ((a_agrees, a), (b_agrees, b)) = (rank(a), rank(b));
            b_agrees.cmp(&a_agrees).then(b.total_cmp(&a))
        });
        let mut fits = fits.into_iter();
        let chosen = fits.next().map(|fit| inliers.completed(fit));
        let (members, lens) = match &chosen {
            Some(fit) => (fit.members.clone(), Some(fit.refined.view.lens)),
            None => (inliers.pool().squares(best), None),
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
        Choice {
            verdicts: self.0.planes.iter().enumerate().map(verdict).collect(),
            residual: chosen.as_ref().map(|fit| fit.refined.rms()),
            doubt: chosen.and_then(|fit| doubt_of_choice(inliers, best, &fit, fits.collect())),
        }
    }

    /// Distance (px) of a plane's samples from the best square under a camera.
    fn residual(&self, plane: &ObservedPlane, lens: &L) -> Option<f64> {
        let view = self.0.placed(plane, lens)?;
        let residuals = residuals(std::slice::from_ref(plane), &view)?;
        let distance = root_mean_square(residuals.iter().flatten());
        distance.is_finite().then_some(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::super::verdict::{Doubt, Verdict};
    use super::*;
    use crate::observations::{Relation, relate_planes};
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::Vector2;

    const NOISE: f64 = 0.1;

    /// Squares of three pictures of one camera.
    fn squares(seed: u64) -> (Scene, Vec<PlaneEdges>) {
        squares_of(3, seed)
    }

    /// Three squares in each of so many pictures of one camera.
    fn squares_of(pictures: u64, seed: u64) -> (Scene, Vec<PlaneEdges>) {
        let first = Scene::random(seed, SceneOptions::default());
        let mut edges = first.edges(seed, NOISE, 8.0);
        for image in 1..pictures {
            let another = first.another(seed + 100 * image);
            let own = another.edges(seed + image, NOISE, 8.0).into_iter();
            edges.extend(own.map(|figure| PlaneEdges {
                image: image as usize,
                ..figure
            }));
        }
        (first, edges)
    }

    /// Stretches a figure's image about its centre, so that no camera sees a square there.
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
    fn relations_follow_the_figures_that_are_kept() {
        let (_, mut edges) = squares(1);
        relate_planes(&mut edges, [1, 2], Relation::Orthogonal).unwrap();
        relate_planes(&mut edges, [0, 1], Relation::Parallel).unwrap();
        let verdict = |figure| Verdict {
            figure,
            kept: figure != 0,
            residual: None,
        };
        let found = Choice {
            verdicts: (0..edges.len()).map(verdict).collect(),
            residual: None,
            doubt: None,
        };
        found.keep(&mut edges);
        assert_eq!(edges.len(), 8);
        let related: Vec<_> = edges.iter().flat_map(|own| &own.relations).collect();
        assert_eq!(related, [&(1, Relation::Orthogonal)]);
        assert!(!edges[0].relations.is_empty());
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
    fn false_squares_among_many_are_dropped() {
        let (scene, mut edges) = squares_of(34, 5);
        let is_false = |i: usize| i % 5 == 2;
        for i in (0..edges.len()).filter(|i| is_false(*i)) {
            edges[i] = stretched(edges[i].clone(), 0.6 + 0.003 * i as f64);
        }
        let found = choose(&edges, scene.size, &Options::default()).unwrap();
        let expected: Vec<bool> = (0..edges.len()).map(|i| !is_false(i)).collect();
        assert_eq!(kept(&found), expected);
        assert_eq!(found.doubt, None);
    }

    #[test]
    fn a_choice_of_few_among_many_is_doubted() {
        let (scene, mut edges) = squares_of(13, 6);
        for i in (0..edges.len()).filter(|i| i % 3 > 0) {
            edges[i] = stretched(edges[i].clone(), [0.5, 0.7, 1.5, 2.0][i % 4]);
        }
        let found = choose(&edges, scene.size, &Options::default()).unwrap();
        let expected: Vec<bool> = (0..edges.len()).map(|i| i % 3 == 0).collect();
        assert_eq!(kept(&found), expected);
        assert_eq!(found.doubt, Some(Doubt::Minority));
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
                // Coincident samples are an error: these differ by next to rounding.
                *point = Vector2::new(100.0, 100.0) + 1e-12 * *point;
            }
        }
        let found = choose(&edges, scene.size, &Options::default()).unwrap();
        assert_eq!(found.verdicts.len(), 9);
    }
}
