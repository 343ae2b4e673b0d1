//! Choosing among candidates: the largest set of squares that one camera explains.
//!
//! Where all candidates agree in one joint fit, all are kept, and nothing more is done. Otherwise
//! cameras are hypothesised (every plausible focal length with the principal point at the image
//! centre; and from pairs and triples of candidates, whatever camera they ask for), each is moved
//! to where it explains most, and the one with the most evidence is taken. Its squares go through
//! the joint fit, which drops what does not agree and takes back what does.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::conic::camera_matrix;
use crate::covariance::check_plane_count;
use crate::explanation::{ALIKE_SHARE, Explanation, Prior, alike, squared_deviation};
use crate::linear::{Homographies, Undistortion, first_view};
use crate::local_noise::Noise;
use crate::misfit::Misfit;
use crate::observations::{ObservedPlane, Sample, Side, sort_by_plane};
use crate::refine::{
    Refined, Residual, Residuals, residuals, robust_scale, root_mean_square, search,
};
use crate::squareness::{Candidate, Pinhole};
use crate::task::Task;
use crate::{
    Brown, Error, Fixed, ImageSize, Line, Method, Options, PlaneEdges, Straightening, set_aside,
};

/// Candidates that must be there: of three, two cannot show which one is false.
const LEAST_CANDIDATES: usize = 4;

/// Samples of each side that the choice looks at: a false square shows in few.
const SAMPLES_PER_SIDE: usize = 16;

/// A joint fit agrees if its sides are in the wrong place, and bent, by less than so many times the
/// variance of the curvature that no lens takes out: paper that is not flat does both.
const AGREED: f64 = 2.0;

/// Standard deviations of chance that are allowed beyond what is expected.
const CHANCE: f64 = 4.0;

/// A plane does not belong if it puts sides in the wrong place by so many times the variance of the
/// noise, per degree of freedom, of which it has two: chance does it once in three thousand times.
const FALSE_PLANE: f64 = 8.0;

/// Focal lengths tried, over half the image diagonal, and how many: neighbours differ by 8 %.
const FOCAL_LENGTHS: (f64, f64) = (0.4, 18.0);
const FOCAL_STEPS: usize = 48;

/// Pairs and triples of candidates that are asked for their camera.
const MAX_SUBSETS: usize = 160;

/// Of more candidates, only so many are combined.
const MAX_COMBINED: usize = 24;

/// What the prior knows of cameras: focal length (its logarithm), aspect, and principal point over
/// half the diagonal. Nearly all pixels are square and principal points near the centre; of the
/// focal length nothing is known but its order.
const PRIOR_STD: [f64; 4] = [1.0, 0.01, 0.03, 0.03];

/// Logarithm of an ordinary focal length, over half the diagonal: a 40 mm lens on 36 x 24 mm.
const ORDINARY_FOCAL: f64 = 0.6;

/// Standard deviation of a parameter that is held.
const HELD: f64 = 1e-6;

/// Doubt about the logarithm of a hypothesised focal length.
const FOCAL_DOUBT: f64 = 0.04;

/// Excluded candidates whose squared deviation is below this are put to the joint fit.
const WORTH_A_TRIAL: f64 = 60.0;

/// How many at most.
const MAX_TRIALS: usize = 12;

/// Rounds in which those planes are dropped that are so many times farther off than the median one.
const MAX_TRIMS: usize = 12;
const STICKS_OUT: f64 = 2.5;

/// Triples of an explanation's squares that are fitted where these do not agree: all of nine.
const MAX_SEEDS: usize = 84;

/// Explanations that are followed up, and by how much less evidence they may have than the best.
const MAX_EXPLANATIONS: usize = 4;
const CONSIDERED: f64 = 8.0;

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

/// What was chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// One for each plane, in the order of the planes' first figures.
    pub verdicts: Vec<Verdict>,
    /// Why the choice may be wrong, if so.
    pub doubt: Option<Doubt>,
}

/// What became of a candidate plane.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    #[error("so few agree that it may be chance")]
    Chance,
    /// The camera is no ordinary one.
    #[error(
        "they ask for an unusual camera: aspect {aspect:.3}, principal point {offset:.0} px from \
         the image centre"
    )]
    OddCamera {
        /// `fy / fx`.
        aspect: f64,
        /// Distance of the principal point from the image centre, px.
        offset: f64,
    },
}

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
    let thinned: Vec<_> = planes.iter().map(|p| p.thinned(SAMPLES_PER_SIDE)).collect();
    let options = Options {
        method: Method::MaximumLikelihood,
        ..*options
    };
    if planes.len() < LEAST_CANDIDATES {
        return Ok(everything(&thinned));
    }
    let task = Task::new(size, &options);
    let undistortion = undistortion(&thinned, &task);
    let chooser = Chooser {
        task,
        planes: &thinned,
        bent: curvature(&thinned, &undistortion),
        pool: Pool::of(&thinned, undistortion, size),
    };
    if chooser.all_agree() {
        return Ok(everything(&thinned));
    }
    let found = chooser.choice();
    Ok(found
        .filter(|choice| !chooser.is_set_aside_anyway(choice))
        .unwrap_or_else(|| everything(&thinned)))
}

struct Chooser<'a> {
    task: Task<'a>,
    planes: &'a [ObservedPlane],
    pool: Pool,
    /// Mean square curvature of the sides where they are as straight as a lens can make them, in
    /// units of their noise; at least 1.
    bent: f64,
}

/// The joint fit of some planes.
struct Fit {
    /// Their indices, ascending.
    members: Vec<usize>,
    camera: Pinhole,
    refined: Refined<Brown>,
    misfit: Misfit,
}

impl Fit {
    /// Whether its sides lie where they should, and are straight, but for the noise and for what
    /// bends them anyway.
    fn agrees(&self, bent: f64) -> bool {
        let within = |sum: f64, freedom: f64| {
            let limit = AGREED.max(1.0 + CHANCE * (2.0 / freedom).sqrt());
            sum / freedom < limit * bent
        };
        let misfit = &self.misfit;
        within(misfit.straight, misfit.straight_freedom)
            && within(misfit.curved, misfit.curved_freedom)
    }

    /// The number of members, of which those that stand alike count as little more than one.
    fn standing_apart(&self) -> f64 {
        let mut counted: Vec<[Vector3<f64>; 2]> = Vec::new();
        let mut number = 0.0;
        for state in &self.refined.view.planes {
            let axes = [0, 1].map(|i| state.pose.rotation.column(i).into_owned());
            let known = counted.iter().any(|other| alike(other, &axes));
            number += if known { ALIKE_SHARE } else { 1.0 };
            counted.push(axes);
        }
        number
    }

    /// By how much further planes put sides in the wrong place, per degree of freedom.
    fn strain(&self, more: &Self) -> f64 {
        let (before, after) = (&self.misfit, &more.misfit);
        let freedom = (after.straight_freedom - before.straight_freedom).max(1.0);
        (after.straight - before.straight) / freedom
    }

    /// How far the samples of every member are from its lines, root mean square, px.
    fn distances(&self) -> Vec<(f64, usize)> {
        let own = self.refined.residuals.iter();
        let distances = own.map(|own| root_mean_square(own.iter()));
        distances.zip(self.members.iter().copied()).collect()
    }
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
            &self.matrix(start),
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
            camera: self.pinhole(&refined.view.lens.camera_matrix()),
            refined,
            misfit,
        }
    }

    fn matrix(&self, camera: &Pinhole) -> Matrix3<f64> {
        let (unit, centre) = (self.task.size.half_diagonal(), self.task.size.centre());
        let fx = camera[0].exp() * unit;
        let (cx, cy) = (centre.x + camera[2] * unit, centre.y + camera[3] * unit);
        Matrix3::new(fx, 0.0, cx, 0.0, fx * camera[1].exp(), cy, 0.0, 0.0, 1.0)
    }

    fn choice(&self) -> Option<Choice> {
        let explanations = self.explanations();
        let best = explanations.first()?;
        let mut fits: Vec<Fit> = Vec::new();
        for explanation in &explanations {
            if best.evidence - explanation.evidence < CONSIDERED {
                self.add_fits(explanation, &mut fits);
            }
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
                for seed in triples(&squares) {
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
        fit.standing_apart() * SQUARE_EVIDENCE - self.prior().cost(&fit.camera)
    }

    fn prior(&self) -> Prior {
        let Options { fixed, initial, .. } = *self.task.options;
        let mut mean = Pinhole::new(ORDINARY_FOCAL, 0.0, 0.0, 0.0);
        let mut std = Pinhole::from(PRIOR_STD);
        if let Some(lens) = initial {
            mean = self.pinhole(&lens.camera_matrix());
        }
        let held = [
            fixed.focal,
            fixed.aspect || fixed.focal,
            fixed.principal_point,
            fixed.principal_point,
        ];
        for i in 0..4 {
            if held[i] {
                std[i] = HELD;
            } else if i != 0 || initial.is_none() {
                mean[i] = Pinhole::new(ORDINARY_FOCAL, 0.0, 0.0, 0.0)[i];
            }
        }
        Prior { mean, std }
    }

    /// All that cameras make of the candidates, from the most evidence to the least.
    fn explanations(&self) -> Vec<Explanation> {
        let prior = self.prior();
        let mut doubt = prior.std;
        doubt[0] = doubt[0].min(FOCAL_DOUBT);
        let mut found: Vec<Explanation> = self
            .hypotheses(&prior)
            .into_iter()
            .filter_map(|start| Explanation::settled(&self.pool.candidates, &prior, start, &doubt))
            .collect();
        found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut different: Vec<Explanation> = Vec::new();
        for explanation in found {
            let squares: Vec<usize> = explanation.squares().collect();
            if different
                .iter()
                .all(|known| !known.squares().eq(squares.iter().copied()))
            {
                different.push(explanation);
            }
            if different.len() == MAX_EXPLANATIONS {
                break;
            }
        }
        different
    }

    fn hypotheses(&self, prior: &Prior) -> Vec<Pinhole> {
        let mut cameras = vec![prior.mean];
        if self.task.options.fixed.focal {
            return cameras;
        }
        let (shortest, longest) = (FOCAL_LENGTHS.0.ln(), FOCAL_LENGTHS.1.ln());
        for i in 0..FOCAL_STEPS {
            let mut camera = prior.mean;
            camera[0] = shortest + (longest - shortest) * i as f64 / (FOCAL_STEPS - 1) as f64;
            cameras.push(camera);
        }
        let planes = self.pool.homographies.iter();
        let homographies: Vec<_> = planes.flat_map(Homographies::of_planes).collect();
        let known = self.task.options.known_intrinsics(&self.task.size);
        for subset in subsets(homographies.len()) {
            let own: Vec<Matrix3<f64>> = subset.iter().map(|i| homographies[*i]).collect();
            if let Ok(matrix) = camera_matrix(&own, &known) {
                let camera = self.pinhole(&matrix);
                if camera.iter().all(|v| v.is_finite()) && camera[0] < FOCAL_LENGTHS.1.ln() {
                    cameras.push(camera);
                }
            }
        }
        cameras
    }

    fn pinhole(&self, matrix: &Matrix3<f64>) -> Pinhole {
        let (unit, centre) = (self.task.size.half_diagonal(), self.task.size.centre());
        Pinhole::new(
            (matrix.m11 / unit).ln(),
            (matrix.m22 / matrix.m11).ln(),
            (matrix.m13 - centre.x) / unit,
            (matrix.m23 - centre.y) / unit,
        )
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

/// The planes that have homographies, and what these show.
struct Pool {
    undistortion: Undistortion,
    places: Vec<usize>,
    candidates: Vec<Candidate>,
    /// In the order of `places`.
    homographies: Vec<Homographies>,
}

impl Pool {
    fn of(planes: &[ObservedPlane], undistortion: Undistortion, size: ImageSize) -> Self {
        let mut pool = Self {
            undistortion,
            places: Vec::new(),
            candidates: Vec::new(),
            homographies: Vec::new(),
        };
        for (i, plane) in planes.iter().enumerate() {
            let one = std::slice::from_ref(plane);
            let candidate = Candidate::of(plane, &pool.undistortion, size);
            let homographies = Homographies::estimate(one, &pool.undistortion);
            if let (Ok(candidate), Ok(homographies)) = (candidate, homographies) {
                pool.places.push(i);
                pool.candidates.push(candidate);
                pool.homographies.push(homographies);
            }
        }
        pool
    }

    fn homographies_of(&self, planes: &[usize]) -> Homographies {
        let place = |plane: &usize| self.places.binary_search(plane).ok();
        Homographies::joined(
            planes
                .iter()
                .filter_map(place)
                .map(|i| &self.homographies[i]),
        )
    }

    /// The planes that an explanation takes for squares.
    fn squares(&self, explanation: &Explanation) -> Vec<usize> {
        explanation.squares().map(|i| self.places[i]).collect()
    }
}

/// From straightness alone: the sides of false squares are straight, too.
fn undistortion(planes: &[ObservedPlane], task: &Task<'_>) -> Undistortion {
    Undistortion::estimate(planes, task.size, task.options)
        .unwrap_or_else(|_| Undistortion::Straightened(Straightening::identity(task.size)))
}

/// Mean square curvature of undistorted sides in units of their noise, at least 1.
fn curvature(planes: &[ObservedPlane], undistortion: &Undistortion) -> f64 {
    let of_side = |side: &Side| -> Option<Vec<Residual>> {
        let pixels = side
            .samples
            .iter()
            .map(|s| undistortion.undistort(&s.pixel));
        let ideal: Vec<_> = pixels.collect::<Option<_>>()?;
        let line = Line::fit(ideal.iter().map(|pixel| (*pixel, 1.0)))?;
        let residual = |(pixel, sample): (&Vector2<f64>, &Sample)| Residual {
            distance: line.distance(pixel),
            weight: sample.weight,
            counts: true,
        };
        Some(ideal.iter().zip(&side.samples).map(residual).collect())
    };
    let own = |plane: &ObservedPlane| -> Option<Vec<Residual>> {
        let sides: Vec<_> = plane.sides().map(of_side).collect::<Option<_>>()?;
        Some(sides.concat())
    };
    let Some(residuals) = planes.iter().map(own).collect::<Option<Residuals>>() else {
        return 1.0;
    };
    let noise = Noise::of(planes, &residuals, robust_scale(&residuals));
    let (mut curved, mut freedom) = (0.0, 0.0);
    for (p, plane) in planes.iter().enumerate() {
        for s in 0..plane.sides().count() {
            let misfit = Misfit::of_side(&noise, p, s);
            curved += misfit.curved;
            freedom += misfit.curved_freedom;
        }
    }
    f64::max(curved / f64::max(freedom, 1.0), 1.0)
}

/// The choice that keeps all.
fn everything(planes: &[ObservedPlane]) -> Choice {
    let kept = |plane: &ObservedPlane| Verdict {
        figure: plane.figures[0].index,
        kept: true,
        residual: None,
    };
    Choice {
        verdicts: planes.iter().map(kept).collect(),
        doubt: None,
    }
}

/// Triples of some planes, evenly chosen where there are too many.
fn triples(planes: &[usize]) -> Vec<[usize; 3]> {
    let mut all = Vec::new();
    for (i, a) in planes.iter().enumerate().take(MAX_COMBINED) {
        for (j, b) in planes.iter().enumerate().take(MAX_COMBINED).skip(i + 1) {
            let rest = planes.iter().take(MAX_COMBINED).skip(j + 1);
            all.extend(rest.map(|c| [*a, *b, *c]));
        }
    }
    let step = all.len().div_ceil(MAX_SEEDS).max(1);
    all.into_iter().step_by(step).collect()
}

/// Pairs and triples of so many things, evenly chosen.
fn subsets(count: usize) -> Vec<Vec<usize>> {
    let things: Vec<usize> = (0..count)
        .step_by(count.div_ceil(MAX_COMBINED).max(1))
        .collect();
    let mut all = Vec::new();
    for (i, a) in things.iter().enumerate() {
        for (j, b) in things.iter().enumerate().skip(i + 1) {
            all.push(vec![*a, *b]);
            all.extend(things[j + 1..].iter().map(|c| vec![*a, *b, *c]));
        }
    }
    let step = all.len().div_ceil(MAX_SUBSETS).max(1);
    all.into_iter().step_by(step).collect()
}
