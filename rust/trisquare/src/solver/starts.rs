//! From the planes of a scene to the best camera: linear steps, starts, and the joint optimum.

use std::cell::OnceCell;
use std::iter;

use nalgebra::Matrix3;

use super::optimum::Optimum;
use super::problem::{Beginning, Failure, JointProblem};
use crate::error::Error;
use crate::lens::Lens;
use crate::linear::{
    Homographies, Undistortion, conic_camera_matrix, fallback_camera_matrices, first_view,
    guessed_camera_matrices, view_by_lens,
};
use crate::noise::{Misfit, Noise};
use crate::observations::{Fixed, FreeParameters, Method, ObservedPlane, Options, Sample, View};
use crate::refine::{Refined, Search};

/// Number of samples per side with which the search for the optimum starts: enough for the robust
/// scale, and for a result within a few standard deviations of that of all samples.
const START_SAMPLES_PER_SIDE: usize = 16;

/// Ratio of the residuals with the principal point fixed to those with it free, below which the
/// free optimum is a wrong one: ratios above it may be chance.
const BEATEN: f64 = 0.98;

/// Keeps the optimum with the smaller residuals.
fn keep_better<L>(best: &mut Option<Optimum<L>>, found: Optimum<L>) {
    if best
        .as_ref()
        .is_none_or(|b| found.refined.noise_scale < b.refined.noise_scale)
    {
        *best = Some(found);
    }
}

/// Mean square misfit above which an optimum may be a wrong one; that of noise alone is 1.
const LARGE_MISFIT: f64 = 2.0;

/// Focal lengths, in image widths, of wide lenses: half a picture's width covers 80, 50 and 115
/// degrees.
const WIDE_FOCALS: [f64; 3] = [0.36, 0.57, 0.25];

/// Starting lenses with the undistorted law of models that bend directions: no pinhole has the same
/// field of view, and no polynomial straightens their images.
fn wide_start_lenses<L: Lens>(problem: &JointProblem<'_, L>) -> impl Iterator<Item = L> {
    let options = problem.options;
    let is_applicable = L::centre_columns().is_empty() && !options.fixed.distortion;
    let guessed = guessed_camera_matrices(WIDE_FOCALS, problem.size, options);
    let guessed = guessed.filter(move |_| is_applicable);
    guessed.map(|camera_matrix| L::from_camera_matrix(&camera_matrix))
}

/// Starts of the searches for an optimum.
pub(crate) struct Starts<'a, L: Lens> {
    problem: &'a JointProblem<'a, L>,
    planes: &'a [ObservedPlane],
    /// The planes with fewer samples, used at the start of the search.
    subsampled: Vec<ObservedPlane>,
    /// Computed on first use.
    linear_steps: OnceCell<Result<LinearSteps<L>, Error>>,
}

/// The paper's steps 1 and 2.
struct LinearSteps<L> {
    undistortion: Undistortion<L>,
    homographies: Homographies,
}

impl<'a, L: Lens> Starts<'a, L> {
    pub fn of(
        problem: &'a JointProblem<'a, L>,
        planes: &'a [ObservedPlane],
    ) -> Result<Self, Error> {
        let starts = Self::without_linear_steps(problem, planes);
        // With a start by the lens's law or by a poorer model, the polynomials may never be needed.
        if problem.beginning.is_none() && wide_start_lenses(problem).next().is_none() {
            starts.linear_steps()?;
        }
        Ok(starts)
    }

    fn without_linear_steps(problem: &'a JointProblem<'a, L>, planes: &'a [ObservedPlane]) -> Self {
        let sample_limit = match problem.options.method {
            Method::Linear => usize::MAX,
            Method::MaximumLikelihood => START_SAMPLES_PER_SIDE,
        };
        let subsampled: Vec<_> = planes.iter().map(|p| p.subsampled(sample_limit)).collect();
        Self {
            problem,
            planes,
            subsampled,
            linear_steps: OnceCell::new(),
        }
    }

    /// The optimum found by a search from a view.
    pub fn optimum_near(
        problem: &'a JointProblem<'a, L>,
        planes: &'a [ObservedPlane],
        view: View<L>,
    ) -> Option<Refined<L>> {
        let starts = Self::without_linear_steps(problem, planes);
        starts.finish(problem.searched(&starts.subsampled, &problem.free, view)?)
    }

    fn linear_steps(&self) -> Result<&LinearSteps<L>, Error> {
        let (problem, subsampled) = (self.problem, &self.subsampled);
        let steps = |undistortion| {
            Ok(LinearSteps {
                homographies: Homographies::estimate(subsampled, &undistortion)?,
                undistortion,
            })
        };
        let found = self.linear_steps.get_or_init(|| {
            let straightened = Undistortion::estimate(subsampled, problem.size, problem.options);
            straightened.and_then(steps).or_else(|error| {
                let wide_lenses = wide_start_lenses(problem).map(Undistortion::Known);
                wide_lenses
                    .filter_map(|lens| steps(lens).ok())
                    .next()
                    .ok_or(error)
            })
        });
        found.as_ref().map_err(Clone::clone)
    }

    /// The view implied by a camera matrix.
    fn view(&self, camera_matrix: &Matrix3<f64>) -> Result<View<L>, Error> {
        let steps = self.linear_steps()?;
        self.with_checked_samples(first_view(
            camera_matrix,
            &steps.homographies,
            self.planes,
            &steps.undistortion,
            self.problem.size,
            self.problem.options,
        )?)
    }

    /// The view implied by a lens.
    fn view_of_lens(&self, lens: &L) -> Result<View<L>, Error> {
        let (size, options) = (self.problem.size, self.problem.options);
        self.with_checked_samples(view_by_lens(
            lens,
            &self.subsampled,
            self.planes,
            size,
            options,
        )?)
    }

    /// Checks that there are more samples than the view has unknowns, and returns it.
    fn with_checked_samples(&self, view: View<L>) -> Result<View<L>, Error> {
        let unknowns = view.unknowns(&self.problem.free);
        let samples = self.samples().count();
        if samples <= unknowns {
            return Err(Error::TooFewDegreesOfFreedom { samples, unknowns });
        }
        Ok(view)
    }

    fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.planes.iter().flat_map(ObservedPlane::samples)
    }

    /// The optimum by the selected method.
    pub fn optimum(&self) -> Result<Optimum<L>, Failure<L>> {
        match self.problem.options.method {
            Method::Linear => match self.linear() {
                Ok(found) => Ok(found.into()),
                Err(error) => Err(self.linear_failure(error)),
            },
            Method::MaximumLikelihood => match self.continued() {
                Some(found) => Ok(found.into()),
                None => self.refine(),
            },
        }
    }

    /// The optimum of the model, searched from the beginning's optimum, such as that of a poorer
    /// model; it therefore fits no worse.
    fn continued(&self) -> Option<Refined<L>> {
        let problem = self.problem;
        let Beginning { view, free } = problem.beginning.as_ref()?;
        // If planes were left out, it is unknown which of the view's planes these are.
        let start = match view.planes.len() == self.planes.len() {
            true => view.clone(),
            false => self.view_of_lens(&view.lens).ok()?,
        };
        let search_with = |planes: &[ObservedPlane]| {
            let found = problem.searched(planes, free, start.clone())?;
            self.finish(problem.searched(planes, &problem.free, found.view)?)
        };
        // With some of the samples the distortion may turn back before others.
        search_with(&self.subsampled).or_else(|| search_with(self.planes))
    }

    /// The solution of the linear steps.
    fn linear(&self) -> Result<Refined<L>, Error> {
        let view = self.view(&self.conic_camera_matrix()?)?;
        self.refined_at(view).ok_or(Error::NotConverged {
            stage: "the linear solution (its distortion is not invertible at a sample)",
            iterations: 0,
            rms: 0.0,
        })
    }

    /// The failure if the linear steps give no camera: the geometry is the likeliest reason, and
    /// the refinement can show it.
    fn linear_failure(&self, error: Error) -> Failure<L> {
        match self.refine() {
            Err(found @ Failure::IllConditioned(_)) => found,
            Err(_) => error.into(),
            Ok(found) => {
                let refusal = self.problem.refusal(self.planes, &found.refined);
                refusal.unwrap_or_else(|| error.into())
            }
        }
    }

    fn conic_camera_matrix(&self) -> Result<Matrix3<f64>, Error> {
        let homographies = &self.linear_steps()?.homographies;
        conic_camera_matrix(homographies, self.problem.size, self.problem.options)
    }

    fn fallback_camera_matrices(&self, options: &Options<L>) -> Vec<Matrix3<f64>> {
        self.linear_steps().map_or_else(
            |_| Vec::new(),
            |steps| fallback_camera_matrices(&steps.homographies, self.problem.size, options),
        )
    }

    /// The views from which a search may start, the likeliest first.
    fn starts(&self) -> impl Iterator<Item = Result<View<L>, Error>> {
        let wide_views = wide_start_lenses(self.problem).map(|lens| self.view_of_lens(&lens));
        let linear = || {
            let fallbacks = self.fallback_camera_matrices(self.problem.options);
            let all = self.conic_camera_matrix().into_iter().chain(fallbacks);
            all.map(|camera_matrix| self.view(&camera_matrix))
        };
        wide_views.chain(iter::once_with(linear).flatten())
    }

    /// The best of the first `count` optima; if that is doubtful, the best of all.
    pub fn best_of_first(&self, count: usize) -> Option<Refined<L>> {
        let optimum =
            |start: Result<_, _>| self.finish(self.search(&self.problem.free, start.ok()?)?);
        let mut found = self.starts().filter_map(optimum);
        let mut best = None;
        for refined in found.by_ref().take(count) {
            keep_better(&mut best, refined.into());
        }
        if best
            .as_ref()
            .is_some_and(|best| self.is_doubtful(&best.refined))
        {
            for refined in found {
                keep_better(&mut best, refined.into());
            }
        }
        best.map(|best| best.refined)
    }

    /// Joint maximum likelihood from the first start that converges: a lens that bends directions
    /// starts by its law, others by the conic's camera matrix.
    ///
    /// A doubtful result may be a wrong optimum, with the principal point far off and the planes
    /// turned to match: then all starts are tried and the one that fits best is used. A result with
    /// residuals well above the noise may be wrong, too, where the robust loss ignores a part of
    /// the samples in favour of the rest: it is compared with that of another start, or with all
    /// starts by the lens's law.
    fn refine(&self) -> Result<Optimum<L>, Failure<L>> {
        let starts = self.starts();
        let rivals = wide_start_lenses(self.problem).count().max(1);
        let mut found_count = 0;
        let mut unconverged: Option<Search<L>> = None;
        let mut best: Option<Optimum<L>> = None;
        for start in starts {
            // At least one is tried.
            let has_tried = best.is_some() || unconverged.is_some();
            if has_tried && self.problem.work.is_spent() {
                break;
            }
            let start = match start {
                Err(error @ Error::TooFewDegreesOfFreedom { .. }) => return Err(error.into()),
                Err(_) => continue,
                Ok(start) => start,
            };
            let Some(found) = self.search(&self.problem.free, start) else {
                continue;
            };
            match self.finish(found.clone()) {
                Some(refined) => {
                    let mut found = Optimum::from(refined);
                    // With a doubtful geometry all starts are tried, with large residuals the
                    // rivals.
                    let is_enough = found_count >= rivals || !self.has_large_misfit(&mut found);
                    found_count += 1;
                    keep_better(&mut best, found);
                    let is_sound = |best: &mut Optimum<L>| !self.is_doubtful(&best.refined);
                    if is_enough && let Some(sound) = best.take_if(is_sound) {
                        return Ok(sound);
                    }
                }
                None => unconverged = unconverged.or(Some(found)),
            }
        }
        let centred = self.centred();
        let from_centred = centred
            .clone()
            .and_then(|c| self.search(&self.problem.free, c.view));
        if let Some(refined) = from_centred.and_then(|found| self.finish(found)) {
            keep_better(&mut best, refined.into());
        }
        let is_beaten = |b: &Optimum<L>| {
            let centred_fit = centred
                .as_ref()
                .and_then(|c| self.refined_at(c.view.clone()));
            centred_fit
                .is_some_and(|centred_fit| centred_fit.noise_scale < BEATEN * b.refined.noise_scale)
        };
        if best.is_none() && unconverged.is_none() {
            self.linear_steps()?;
        }
        best.filter(|b| !is_beaten(b))
            .ok_or_else(|| self.no_convergence(centred.or(unconverged)))
    }

    /// A view with the spread of all residuals around it.
    fn refined_at(&self, view: View<L>) -> Option<Refined<L>> {
        Refined::of_linear(self.planes, &self.problem.free, &self.problem.judged, view)
    }

    /// Searches the optimum of some samples from a start.
    fn search(&self, free: &FreeParameters, start: View<L>) -> Option<Search<L>> {
        // If the straightening's polynomial is not defined at a sample, start without it.
        let pinhole = View {
            lens: start.lens.without_distortion(),
            ..start.clone()
        };
        let problem = self.problem;
        let found = problem.searched(&self.subsampled, free, start);
        found.or_else(|| problem.searched(&self.subsampled, free, pinhole))
    }

    /// The optimum with the principal point fixed at its known value, or at the image centre:
    /// parallel planes have one there, though none without.
    fn centred(&self) -> Option<Search<L>> {
        let fixed = Fixed {
            principal_point: true,
            ..self.problem.options.fixed
        };
        let options = Options {
            fixed,
            ..*self.problem.options
        };
        let free = options.free_parameters();
        self.fallback_camera_matrices(&options)
            .iter()
            .take_while(|_| !self.problem.work.is_spent())
            .filter_map(|camera_matrix| self.search(&free, self.view(camera_matrix).ok()?))
            .find_map(Search::converged)
    }

    /// The optimum of all samples, from that of some.
    fn finish(&self, found: Search<L>) -> Option<Refined<L>> {
        let found = found.converged()?;
        let view = found.view.clone();
        let problem = self.problem;
        problem.finished(self.planes, found).or_else(|| {
            // Some samples were misleading: search with all of them.
            let found = problem.searched(self.planes, &problem.free, view)?;
            let found = found.converged()?;
            let view = found.view.clone();
            // If the cost is far from a parabola, Newton's undamped steps may not converge.
            problem
                .finished(self.planes, found)
                .or_else(|| self.refined_at(view))
        })
    }

    /// The failure to converge: the likeliest reason is a geometry that does not determine the
    /// camera, which has its own error.
    fn no_convergence(&self, unconverged: Option<Search<L>>) -> Failure<L> {
        let iterations = unconverged.as_ref().map_or(0, |found| found.iterations);
        let refined = unconverged.and_then(|found| self.refined_at(found.view));
        let refusal = refined
            .as_ref()
            .and_then(|refined| self.problem.refusal(self.planes, refined));
        refusal.unwrap_or_else(|| {
            Failure::Other(Error::NotConverged {
                stage: "the joint refinement",
                iterations,
                rms: refined.map_or(0.0, |refined| refined.rms()),
            })
        })
    }

    fn is_doubtful(&self, refined: &Refined<L>) -> bool {
        let conditioning = self.problem.conditioning(self.planes, refined);
        let factor = refined.covariance_factor;
        let weakest = conditioning.weakest(&refined.system, &self.problem.free, factor);
        weakest.is_some_and(|weakest| weakest.is_doubtful())
    }

    /// Whether the distances of the sides from their lines greatly exceed the noise.
    fn has_large_misfit(&self, found: &mut Optimum<L>) -> bool {
        let Optimum { refined, noise } = found;
        let noise = noise.insert(Noise::of_optimum(self.planes, refined));
        Misfit::of(self.planes, &refined.view, &self.problem.free, noise).mean() > LARGE_MISFIT
    }
}
