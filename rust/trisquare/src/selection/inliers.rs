//! Joint fits of candidates that agree: subsets of a hypothesis' squares, and further candidates
//! that agree with them.
//!
//! The cost of a joint fit grows with its planes. Trials one by one are limited to a few dozen
//! planes that determine the camera best; the camera on which they agree is then applied to all
//! planes.

use std::cell::OnceCell;

use nalgebra::Vector3;

use super::candidates::Pool;
use super::hypothesis::{Hypothesis, alike, squared_deviation};
use super::joint_fit::JointFit;
use super::propose::{FOCAL_DOUBT, matrix_of, pinhole, prior, propose};
use super::squareness::Pinhole;
use super::straightness::{CURVED, Straightness};
use super::subsets::triples;
use crate::geometry::camera_matrix_from_planes;
use crate::lens::Lens;
use crate::linear::{first_view, view_by_lens};
use crate::noise::{Misfit, Noise, account_for_drift};
use crate::observations::{Fixed, ObservedPlane, Options, PlaneState, View, relations_of};
use crate::refine::{Refined, search};
use crate::solver::JointProblem;
use crate::uncertainty::check_plane_count;

/// Minimum number of candidates for a set of inliers: with three, two cannot show which one is
/// false.
pub(crate) const MIN_CANDIDATES: usize = 4;

/// Threshold on a plane's misfit, the variance of its sides' displacements over that of the noise,
/// per degree of freedom, above which the plane does not belong. With its two degrees of freedom
/// chance exceeds it once in three thousand times.
const FALSE_PLANE: f64 = 8.0;

/// Squared deviation below which excluded candidates are tried in the joint fit.
const MAX_TRIED_DEVIATION: f64 = 60.0;

/// Maximum number of such trials.
const MAX_TRIALS: usize = 12;

/// Maximum number of rounds of trimming, and the ratio of a plane's distance to the median one
/// above which a round drops the plane.
const MAX_TRIMS: usize = 12;
pub(crate) const MAX_DISTANCE_RATIO: f64 = 2.5;

/// Maximum number of triples of a hypothesis' squares that are fitted if these do not agree: all of
/// nine.
const MAX_SEEDS: usize = 84;

/// Maximum number of squares that are tried one by one; more hardly determine the camera better.
pub(crate) const MAX_FITTED: usize = 32;

/// One in so many of the planes that do not agree is dropped per round, if none of many sticks out.
const PART_DROPPED: usize = 8;

/// Maximum number of squares common to all hypotheses that are left out in turn if no joint fit
/// agrees.
const MAX_SHARED: usize = 3;

/// Maximum difference in evidence to the best hypothesis for one to be considered.
const MAX_EVIDENCE_GAP: f64 = 8.0;

/// Log odds below which another hypothesis is nearly as good.
pub(super) const CLOSE_RIVAL: f64 = 4.0;

/// Evidence of a square that agrees for a joint fit: the evidence of one with median precision.
const SQUARE_EVIDENCE: f64 = 5.0;

/// Maximum worth of the joint fit grown from a triple: none of its planes alike.
const MAX_WORTH_OF_SEED: f64 = SQUARE_EVIDENCE * (3 + MAX_TRIALS) as f64;

/// Minimum evidence of a hypothesis to stand out from chance, above that of no square at all.
pub(super) const MIN_EVIDENCE: f64 = 8.0;

/// Whether a joint fit has enough planes to contradict each other.
pub(super) fn is_triple<L>(fit: &JointFit<L>) -> bool {
    fit.members.len() + 1 >= MIN_CANDIDATES
}

/// Search for planes that agree.
#[derive(Clone, Copy)]
pub(crate) struct Inliers<'a, L: Lens> {
    pub problem: &'a JointProblem<'a, L>,
    pub planes: &'a [ObservedPlane],
    /// Created on first use.
    pub pool: &'a OnceCell<Pool<L>>,
}

impl<L: Lens> Inliers<'_, L> {
    /// Whether the planes of a joint fit agree: all of them together and, if they are so many that
    /// a false one would be lost among them, each separately.
    pub fn agrees(&self, fit: &JointFit<L>) -> bool {
        let agrees = |curvature: f64| {
            let all = fit.members.len();
            fit.agrees(curvature)
                && (all <= MAX_FITTED || Self::agreeing_members(fit, curvature).len() == all)
        };
        // Agreement under the assumption of straight sides suffices; the pool is not computed then.
        agrees(1.0) || agrees(self.pool().curvature)
    }

    /// The planes without their distortion.
    pub fn pool(&self) -> &Pool<L> {
        self.pool
            .get_or_init(|| Pool::of(self.planes, self.problem))
    }

    /// The members of a joint fit that do not stick out of it, given the mean square curvature of
    /// sides.
    fn agreeing_members(fit: &JointFit<L>, curvature: f64) -> Vec<usize> {
        let limit = FALSE_PLANE * curvature * fit.typical_misfit();
        let misfits = fit.members.iter().zip(&fit.member_misfits);
        misfits
            .filter(|(_, misfit)| **misfit <= limit)
            .map(|(plane, _)| *plane)
            .collect()
    }

    /// The joint fit of some planes, starting from a camera.
    fn fit(&self, members: &[usize], start: &Pinhole) -> Option<JointFit<L>> {
        let JointProblem {
            size,
            options,
            free,
            judged,
            ..
        } = self.problem;
        check_plane_count(members.len(), free).ok()?;
        let planes = self.planes_of(members);
        let view = first_view(
            &matrix_of(start, self.problem.size),
            &self.pool().homographies_of(members),
            &planes,
            &self.pool().undistortion,
            *size,
            options,
        );
        let found = search(&planes, free, view.ok()?)?;
        let refined = Refined::of_linear(&planes, free, judged, found.view)?;
        Some(self.evaluated(members, &planes, refined))
    }

    /// The joint fit of many planes, starting from a lens determined by some of them.
    fn fit_of_many(&self, members: &[usize], lens: &L) -> Option<JointFit<L>> {
        check_plane_count(members.len(), &self.problem.free).ok()?;
        let planes = self.planes_of(members);
        let refined = self.problem.optimum_from(lens, &planes)?;
        Some(self.evaluated(members, &planes, refined))
    }

    fn planes_of(&self, members: &[usize]) -> Vec<ObservedPlane> {
        members.iter().map(|i| self.planes[*i].clone()).collect()
    }

    /// Evaluates a joint fit; if its planes disagree, after correction of their edges for the
    /// effect of the pictures' tone curves.
    pub fn evaluated(
        &self,
        members: &[usize],
        planes: &[ObservedPlane],
        refined: Refined<L>,
    ) -> JointFit<L> {
        let fit = self.evaluated_as_given(members, planes, refined);
        if self.agrees(&fit) {
            return fit;
        }
        let JointProblem { free, judged, .. } = self.problem;
        match account_for_drift(planes, free, judged, &fit.refined) {
            Some((corrected, refined)) => self.evaluated_as_given(members, &corrected, refined),
            None => fit,
        }
    }

    fn evaluated_as_given(
        &self,
        members: &[usize],
        planes: &[ObservedPlane],
        refined: Refined<L>,
    ) -> JointFit<L> {
        let noise = (!refined.is_exact()).then(|| Noise::of_optimum(planes, &refined));
        let misfit = noise.as_ref().map_or(Misfit::NONE, |noise| {
            Misfit::of(planes, &refined.view, &self.problem.free, noise)
        });
        let member_misfits = |noise: &Noise| {
            let states = refined.view.planes.iter().enumerate();
            let plane_misfit = |(p, state): (usize, &PlaneState)| {
                let misfit = Misfit::of_plane(noise, p);
                let freedom = misfit.straight_freedom - state.unknowns() as f64;
                misfit.straight / freedom.max(1.0)
            };
            states.map(plane_misfit).collect()
        };
        JointFit {
            members: members.to_vec(),
            camera: pinhole(&refined.view.lens.camera_matrix(), self.problem.size),
            member_misfits: noise
                .as_ref()
                .map_or(vec![0.0; members.len()], member_misfits),
            refined,
            misfit,
        }
    }

    /// The joint fits found from the best of some hypotheses.
    pub fn fits(&self, hypotheses: &[Hypothesis]) -> Vec<JointFit<L>> {
        let mut fits = Vec::new();
        for hypothesis in hypotheses {
            if hypotheses[0].evidence - hypothesis.evidence < MAX_EVIDENCE_GAP {
                self.add_fits(hypothesis, &mut fits);
            }
        }
        fits
    }

    /// The joint fits that agree after leaving out a square common to all hypotheses: a plane known
    /// as precisely as a board is in all of them, even if it was seen by another camera.
    pub fn fits_without_common_square(&self, found: &[Hypothesis]) -> Vec<JointFit<L>> {
        let is_in_all = |plane: &usize| {
            let mut sets = found
                .iter()
                .map(|hypothesis| self.pool().squares(hypothesis));
            sets.all(|squares| squares.contains(plane))
        };
        let places = self.pool().places.iter().copied();
        let shared = places.filter(is_in_all).take(MAX_SHARED);
        let mut fits = Vec::new();
        for plane in shared {
            let others = self.pool().without(plane);
            let hypotheses = propose(self.problem, &others);
            fits.extend(
                Inliers {
                    pool: &OnceCell::from(others),
                    ..*self
                }
                .fits(&hypotheses),
            );
        }
        fits.retain(|fit| self.agrees(fit));
        fits
    }

    /// The joint fits of three planes that agree, extended by further planes that agree, regardless
    /// of the hypotheses: these approximate a wide lens too poorly to distinguish its squares from
    /// other shapes.
    pub fn fits_of_triples(&self, best: &Hypothesis) -> Vec<JointFit<L>> {
        let known = self.problem.options.known_intrinsics(&self.problem.size);
        let mut fits = Vec::new();
        for seed in triples(&self.pool().places, MAX_SEEDS) {
            let homographies = self.pool().homographies_of(&seed).of_planes();
            let start = match camera_matrix_from_planes(&homographies, &known) {
                Ok(matrix) => pinhole(&matrix, self.problem.size),
                Err(_) => best.camera,
            };
            let agrees = |fit: &JointFit<L>| fit.is_converged() && self.agrees(fit);
            if let Some(seed) = self.fit(&seed, &start).filter(agrees) {
                let seed_hypothesis = Hypothesis {
                    camera: seed.camera,
                    ..best.clone()
                };
                self.keep(seed, &seed_hypothesis, &mut fits);
            }
        }
        fits
    }

    /// Adds the joint fits found from a hypothesis: of its squares, or of those that agree.
    fn add_fits(&self, hypothesis: &Hypothesis, fits: &mut Vec<JointFit<L>>) {
        let squares = self.most_informative(self.pool().squares(hypothesis), hypothesis);
        let start = &hypothesis.camera;
        match self.fit(&squares, start) {
            Some(fit) if self.agrees(&fit) || squares.len() < MIN_CANDIDATES => {
                self.keep(fit, hypothesis, fits);
            }
            Some(fit) => {
                if let Some(trimmed) = self.trimmed(&fit) {
                    self.keep(trimmed, hypothesis, fits);
                }
                let mut agreeing = fits.iter().filter(|fit| self.agrees(fit));
                if agreeing.any(|fit| self.worth(fit) > MAX_WORTH_OF_SEED + CLOSE_RIVAL) {
                    return;
                }
                for seed in triples(&squares, MAX_SEEDS) {
                    if let Some(seed) = self.fit(&seed, start).filter(|seed| self.agrees(seed)) {
                        self.keep(seed, hypothesis, fits);
                    }
                }
                if fits.is_empty() {
                    fits.push(fit);
                }
            }
            None => {}
        }
    }

    /// Keeps a joint fit with all that agree with it, unless it is contained in another one.
    fn keep(&self, fit: JointFit<L>, hypothesis: &Hypothesis, fits: &mut Vec<JointFit<L>>) {
        let is_known = |members: &[usize]| {
            let contains_all =
                |known: &&JointFit<L>| members.iter().all(|i| known.members.contains(i));
            fits.iter()
                .any(|fit| self.agrees(fit) && contains_all(&fit))
        };
        if is_known(&fit.members) {
            return;
        }
        let grown = self.with_candidates(fit, hypothesis);
        if !is_known(&grown.members) {
            fits.push(grown);
        }
    }

    /// Worth of a joint fit: the evidence of squares that do not stand alike, less the prior cost
    /// of the camera.
    pub fn worth(&self, fit: &JointFit<L>) -> f64 {
        fit.effective_count() * SQUARE_EVIDENCE - prior(self.problem).cost(&fit.camera)
    }

    /// The pool under the lens of the joint fit that makes all sides straightest, if straight sides
    /// alone did not determine the lens well: a fit also estimates its centre, which displaces a
    /// fisheye's sides considerably.
    pub fn pool_by_fits(&self, best: &Hypothesis, fits: &[JointFit<L>]) -> Option<Pool<L>> {
        let curvature = self.pool().curvature;
        if curvature < CURVED && best.evidence >= MIN_EVIDENCE {
            return None;
        }
        let agreeing = fits.iter().filter(|fit| is_triple(fit) && self.agrees(fit));
        let straightnesses =
            agreeing.filter_map(|fit| Straightness::by_lens(self.planes, fit.refined.view.lens));
        let straightness = straightnesses.min_by(|a, b| a.curvature.total_cmp(&b.curvature))?;
        let is_better = straightness.curvature < curvature.max(CURVED);
        is_better.then(|| Pool::under_lens(straightness, self.planes, self.problem))
    }

    /// The squares of a hypothesis that determine its camera best: one of those that stand alike
    /// before the others, and in order of decreasing certainty.
    fn most_informative(&self, squares: Vec<usize>, hypothesis: &Hypothesis) -> Vec<usize> {
        if squares.len() <= MAX_FITTED {
            return squares;
        }
        let ranked = hypothesis
            .squares()
            .zip(squares)
            .filter_map(|(index, place)| {
                let deviation = self.pool().candidates[index].deviation(&hypothesis.camera)?;
                Some((
                    deviation.covariance.determinant(),
                    deviation.directions,
                    place,
                ))
            });
        let mut ranked: Vec<_> = ranked.collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut directions: Vec<[Vector3<f64>; 2]> = Vec::new();
        let (mut first, mut others) = (Vec::new(), Vec::new());
        for (_, sides, place) in ranked {
            if directions.iter().any(|other| alike(other, &sides)) {
                others.push(place);
            } else {
                directions.push(sides);
                first.push(place);
            }
        }
        first.extend(others);
        first.truncate(MAX_FITTED);
        first.sort_unstable();
        first
    }

    /// The part of a fit that agrees after dropping the planes that stick out; `None` if there is
    /// none.
    fn trimmed(&self, fit: &JointFit<L>) -> Option<JointFit<L>> {
        let mut rest = self.fit(&fit.members, &fit.camera)?;
        for _ in 0..MAX_TRIMS {
            if self.agrees(&rest) {
                return Some(rest);
            }
            let mut distances = rest.distances();
            distances.sort_by(|a, b| a.0.total_cmp(&b.0));
            let limit = MAX_DISTANCE_RATIO * distances[distances.len() / 2].0;
            let within = distances.iter().filter(|(distance, _)| *distance <= limit);
            let mut members: Vec<usize> = within.map(|(_, plane)| *plane).collect();
            if members.len() == distances.len() {
                // No plane sticks out, but they do not agree: the farthest is dropped.
                members.pop();
            }
            if members.len() + 1 < MIN_CANDIDATES {
                return None;
            }
            members.sort_unstable();
            rest = self.fit(&members, &rest.camera)?;
        }
        None
    }

    /// Adds candidates that agree in the joint fit, the most promising first, up to the maximum
    /// number of planes tried one by one.
    fn with_candidates(&self, mut fit: JointFit<L>, hypothesis: &Hypothesis) -> JointFit<L> {
        let mut others: Vec<(f64, usize)> = self
            .pool()
            .candidates
            .iter()
            .zip(&self.pool().places)
            .filter(|(_, place)| !fit.members.contains(place))
            .filter_map(|(c, place)| Some((squared_deviation(c, hypothesis)?, *place)))
            .filter(|(square, _)| *square < MAX_TRIED_DEVIATION)
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, other) in others.into_iter().take(MAX_TRIALS) {
            if fit.members.len() >= MAX_FITTED {
                break;
            }
            let mut members = fit.members.clone();
            members.push(other);
            members.sort_unstable();
            if let Some(more) = self.fit(&members, &fit.camera)
                && fit.added_misfit(&more) < FALSE_PLANE * self.pool().curvature
                && self.agrees(&more)
            {
                fit = more;
            }
        }
        fit
    }

    /// The best pose of a plane under a known lens.
    pub fn placed(&self, plane: &ObservedPlane, lens: &L) -> Option<View<L>> {
        let options = Options {
            fixed: Fixed {
                aspect: true,
                principal_point: true,
                focal: true,
                distortion: true,
                skew: true,
            },
            initial: Some(*lens),
            ..*self.problem.options
        };
        let single = std::slice::from_ref(plane);
        let start = view_by_lens(lens, single, single, self.problem.size, &options).ok()?;
        Some(search(single, &options.free_parameters(), start)?.view)
    }

    /// Some planes with their best poses under a known lens, without those that it does not see.
    fn all_placed(&self, planes: &[usize], lens: &L) -> Option<JointFit<L>> {
        let place = |plane: &usize| {
            let state = self.placed(&self.planes[*plane], lens)?.planes.pop()?;
            Some((*plane, state))
        };
        let (members, states): (Vec<usize>, Vec<PlaneState>) =
            planes.iter().filter_map(place).unzip();
        let planes = self.planes_of(&members);
        let view = View {
            lens: *lens,
            planes: states,
            relations: relations_of(&planes),
        };
        let JointProblem { free, judged, .. } = self.problem;
        let refined = Refined::of_linear(&planes, free, judged, view)?;
        Some(self.evaluated(&members, &planes, refined))
    }

    /// Extends a joint fit by all planes that agree, if there are too many to be tried one by one.
    ///
    /// The camera on which dozens of planes agree shows separately for each other plane whether it
    /// is a square.
    pub fn completed(&self, fit: JointFit<L>) -> JointFit<L> {
        if self.pool().places.len() <= MAX_FITTED {
            return fit;
        }
        let prior = prior(self.problem);
        let mut doubt = prior.std;
        doubt[0] = doubt[0].min(FOCAL_DOUBT);
        let all = &self.pool().candidates;
        let Some(hypothesis) = Hypothesis::converged(all, &prior, fit.camera, &doubt) else {
            return fit;
        };
        let fit_hypothesis = Hypothesis {
            camera: fit.camera,
            ..hypothesis
        };
        let candidates = all.iter().zip(&self.pool().places);
        let promising = candidates.filter(|(candidate, place)| {
            let square = squared_deviation(candidate, &fit_hypothesis);
            fit.members.binary_search(place).is_ok()
                || square.is_some_and(|square| square < MAX_TRIED_DEVIATION)
        });
        let promising: Vec<usize> = promising.map(|(_, place)| *place).collect();
        let lens = &fit.refined.view.lens;
        let placed = self.all_placed(&promising, lens);
        let mut next = placed.and_then(|all| {
            self.fit_of_many(&Self::agreeing_members(&all, self.pool().curvature), lens)
        });
        for _ in 0..MAX_TRIMS {
            let Some(more) = next else {
                break;
            };
            if self.agrees(&more) {
                return if more.members.len() > fit.members.len() {
                    more
                } else {
                    fit
                };
            }
            let mut members = Self::agreeing_members(&more, self.pool().curvature);
            if members.len() == more.members.len() {
                let mut distances = more.distances();
                distances.sort_by(|a, b| a.0.total_cmp(&b.0));
                distances.truncate(distances.len() - distances.len().div_ceil(PART_DROPPED));
                members = distances.into_iter().map(|(_, plane)| plane).collect();
                members.sort_unstable();
            }
            next = self.fit_of_many(&members, &more.refined.view.lens);
        }
        fit
    }
}
