//! From the planes of a scene to the best camera: linear steps, starts, and the joint optimum.

use nalgebra::Matrix3;

use crate::consistency::disagreement;
use crate::correlated::{Coherence, Correlated, correlated_covariance, weighed_by_noise};
use crate::covariance::covariance;
use crate::drift;
use crate::geometry::{Geometry, judged_parameters};
use crate::levenberg::Termination;
use crate::linear::{
    Homographies, Undistortion, conic_camera_matrix, fallback_camera_matrices, first_view,
};
use crate::local_noise::Noise;
use crate::observations::{ObservedPlane, Sample};
use crate::parameters::FreeParameters;
use crate::refine::{Refined, Search, finish, search};
use crate::remedies;
use crate::view::View;
use crate::weakness::Weakness;
use crate::{Brown, Error, Fixed, ImageSize, Method, Options};

/// Samples of each side with which the search for the optimum starts: enough for the robust
/// scale, and within a few standard deviations of what all samples will say.
const START_SAMPLES_PER_SIDE: usize = 16;

/// Residuals with the principal point held may be this part of those with it free, for chance;
/// where they are smaller, the free optimum is a wrong one.
const BEATEN: f64 = 0.98;

/// What is asked of the planes.
pub(crate) struct Task<'a> {
    pub size: ImageSize,
    pub options: &'a Options,
    pub free: FreeParameters,
    judged: FreeParameters,
}

/// The best camera for some planes, and what is known of it.
#[derive(Clone)]
pub(crate) struct Solution {
    /// The planes, each weighed by its own noise.
    pub planes: Vec<ObservedPlane>,
    pub refined: Refined<Brown>,
    pub correlated: Correlated,
    /// What the residuals say of their noise; nothing where they are exact, or not asked.
    pub noise: Option<Noise>,
}

impl<'a> Task<'a> {
    pub fn new(size: ImageSize, options: &'a Options) -> Self {
        let free = options.free_parameters();
        Self {
            size,
            options,
            judged: judged_parameters(&free),
            free,
        }
    }

    /// The answer of the method asked for.
    pub fn optimum(&self, planes: &[ObservedPlane]) -> Result<Refined<Brown>, Error> {
        self.with_stages(planes, |stages| stages.optimum())
    }

    /// The same, with what is known of it.
    pub fn solve(&self, planes: &[ObservedPlane]) -> Result<Solution, Error> {
        let refined = self.optimum(planes)?;
        match self.options.method {
            Method::MaximumLikelihood => self.settle(planes, refined),
            Method::Linear => self.independent_solution(planes, refined),
        }
    }

    /// Weighs the planes of an optimum by their own noise, and asks the residuals how far they
    /// are independent.
    pub fn settle(
        &self,
        planes: &[ObservedPlane],
        mut refined: Refined<Brown>,
    ) -> Result<Solution, Error> {
        if refined.is_exact() {
            return self.independent_solution(planes, refined);
        }
        let mut noise = refined.noise(planes);
        let mut planes = planes.to_vec();
        if let Some(weighed) = weighed_by_noise(&planes, &noise)
            && let Some(again) = self.again(&weighed, &refined)
        {
            noise = again.noise(&weighed);
            (planes, refined) = (weighed, again);
        }
        if let Some(found) = drift::accounted(&planes, &self.free, &self.judged, &refined) {
            (planes, refined) = found;
            noise = refined.noise(&planes);
        }
        let correlated = correlated_covariance(&planes, &self.free, &refined, &noise);
        Ok(Solution {
            correlated: correlated.ok_or_else(|| self.singular(&planes, &refined))?,
            planes,
            refined,
            noise: Some(noise),
        })
    }

    /// The optimum of planes that are weighed otherwise than before.
    pub fn again(
        &self,
        planes: &[ObservedPlane],
        before: &Refined<Brown>,
    ) -> Option<Refined<Brown>> {
        let start = before.as_start();
        finish(planes, &self.free, &self.judged, start).or_else(|| {
            let found = search(planes, &self.free, before.view.clone())?;
            finish(planes, &self.free, &self.judged, found)
        })
    }

    /// A solution for some planes, with one more that follows its camera without moving it.
    pub fn with_follower(
        &self,
        solution: &Solution,
        index: usize,
        plane: &ObservedPlane,
    ) -> Option<Solution> {
        let mut follower = plane.clone();
        follower.set_aside();
        let lens = solution.refined.view.lens;
        let one = std::slice::from_ref(&follower);
        let undistortion = Undistortion::Known(lens);
        let homographies = Homographies::estimate(one, &undistortion).ok()?;
        let matrix = lens.camera_matrix();
        let (size, options) = (self.size, self.options);
        let placed = first_view(&matrix, &homographies, one, &undistortion, size, options).ok()?;
        let (mut planes, mut refined) = (solution.planes.clone(), solution.refined.clone());
        planes.insert(index, follower);
        refined.view.planes.insert(index, placed.planes[0].clone());
        let refined = self.again(&planes, &refined)?;
        self.settle(&planes, refined).ok()
    }

    /// A solution whose residuals are not asked about their correlation.
    fn independent_solution(
        &self,
        planes: &[ObservedPlane],
        refined: Refined<Brown>,
    ) -> Result<Solution, Error> {
        let system = refined.system.leading(self.free.len());
        let focal = refined.view.lens.focal().x;
        let factor = refined.covariance_factor;
        let covariance =
            covariance(&system, factor).ok_or_else(|| self.singular(planes, &refined))?;
        let correlated = Correlated {
            covariance,
            disagreement: disagreement(&system, &self.free, focal, factor),
            coherence: Coherence::none(planes.len(), self.free.len()),
        };
        Ok(Solution {
            planes: planes.to_vec(),
            refined,
            correlated,
            noise: None,
        })
    }

    /// Refuses geometry that cannot answer, and says what would help.
    ///
    /// # Errors
    /// [`Error::WeakGeometry`].
    pub fn judge(&self, solution: &Solution) -> Result<(), Error> {
        let Solution {
            planes, refined, ..
        } = solution;
        let weak = self.geometry(planes, refined).judge(
            &refined.system,
            &self.free,
            refined.covariance_factor,
        );
        weak.map_err(|weakness| self.advised(planes, refined, weakness))
    }

    /// Why there is no covariance: most likely the geometry.
    fn singular(&self, planes: &[ObservedPlane], refined: &Refined<Brown>) -> Error {
        let geometry = self.geometry(planes, refined);
        let factor = refined.covariance_factor;
        match geometry.judge(&refined.system, &self.free, factor) {
            Err(weakness) => self.advised(planes, refined, weakness),
            Ok(()) => Error::NotConverged {
                stage: "the covariance",
                iterations: refined.iterations,
                rms: refined.noise_scale,
            },
        }
    }

    fn geometry<'b>(
        &'b self,
        planes: &'b [ObservedPlane],
        refined: &'b Refined<Brown>,
    ) -> Geometry<'b, Brown> {
        Geometry {
            view: &refined.view,
            planes,
            size: self.size,
            options: self.options,
            noise_scale: refined.noise_scale,
        }
    }

    /// A refusal with what would help.
    fn advised(
        &self,
        planes: &[ObservedPlane],
        refined: &Refined<Brown>,
        mut weakness: Weakness,
    ) -> Error {
        let succeeds = |fixed: Fixed| {
            let options = Options {
                fixed,
                ..*self.options
            };
            let trial = Task::new(self.size, &options);
            let judged = trial.with_stages(planes, |stages| {
                Ok(stages.judge(&stages.optimum()?).is_ok())
            });
            judged.unwrap_or(false)
        };
        weakness.remedies = remedies::holding(&self.options.fixed, succeeds);
        let geometry = self.geometry(planes, refined);
        let shown = remedies::showing(&geometry, &weakness);
        weakness.remedies.extend(shown);
        Error::WeakGeometry(Box::new(weakness))
    }

    /// The paper's steps 1 and 2, and on them what `answer` makes of all stages.
    fn with_stages<T>(
        &self,
        planes: &[ObservedPlane],
        answer: impl FnOnce(&Stages<'_>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let sample_limit = match self.options.method {
            Method::Linear => usize::MAX,
            Method::MaximumLikelihood => START_SAMPLES_PER_SIDE,
        };
        let some: Vec<ObservedPlane> = planes.iter().map(|p| p.thinned(sample_limit)).collect();
        let undistortion = Undistortion::estimate(&some, self.size, self.options)?;
        let homographies = Homographies::estimate(&some, &undistortion)?;
        answer(&Stages {
            task: self,
            planes,
            some: &some,
            undistortion: &undistortion,
            homographies: &homographies,
        })
    }
}

/// Keeps the optimum with the smaller residuals.
fn keep_better(best: &mut Option<Refined<Brown>>, found: Refined<Brown>) {
    if best
        .as_ref()
        .is_none_or(|b| found.noise_scale < b.noise_scale)
    {
        *best = Some(found);
    }
}

/// What every stage may look at.
struct Stages<'a> {
    task: &'a Task<'a>,
    planes: &'a [ObservedPlane],
    /// The same with fewer samples: from these the search starts.
    some: &'a [ObservedPlane],
    undistortion: &'a Undistortion,
    homographies: &'a Homographies,
}

impl Stages<'_> {
    fn view(&self, camera_matrix: &Matrix3<f64>) -> Result<View<Brown>, Error> {
        let view = first_view(
            camera_matrix,
            self.homographies,
            self.planes,
            self.undistortion,
            self.task.size,
            self.task.options,
        )?;
        let unknowns = view.unknowns(&self.task.free);
        let samples = self.samples().count();
        if samples <= unknowns {
            return Err(Error::TooFewDegreesOfFreedom { samples, unknowns });
        }
        Ok(view)
    }

    fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.planes.iter().flat_map(ObservedPlane::samples)
    }

    /// The answer of the method asked for.
    fn optimum(&self) -> Result<Refined<Brown>, Error> {
        match self.task.options.method {
            Method::Linear => self.linear().map_err(|error| self.why_not_linear(error)),
            Method::MaximumLikelihood => self.refine(),
        }
    }

    /// The linear steps' own answer.
    fn linear(&self) -> Result<Refined<Brown>, Error> {
        let camera_matrix =
            conic_camera_matrix(self.homographies, self.task.size, self.task.options)?;
        let view = self.view(&camera_matrix)?;
        self.around(view).ok_or(Error::NotConverged {
            stage: "the linear solution (its distortion is not invertible at a sample)",
            iterations: 0,
            rms: 0.0,
        })
    }

    /// Where the linear steps give no camera, its geometry is the likeliest reason, and the
    /// refinement can tell.
    fn why_not_linear(&self, error: Error) -> Error {
        match self.refine() {
            Err(weak @ Error::WeakGeometry(_)) => weak,
            Err(_) => error,
            Ok(refined) => match self.judge(&refined) {
                Err(weakness) => self.advised(&refined, weakness),
                Ok(()) => error,
            },
        }
    }

    /// Joint maximum likelihood from the conic's camera matrix, or from the first fallback that
    /// settles where that one does not.
    ///
    /// A doubtful answer may be a wrong optimum, with the principal point far off and the planes
    /// turned to match: then all starts are tried and the one that fits best is taken.
    fn refine(&self) -> Result<Refined<Brown>, Error> {
        let conic = conic_camera_matrix(self.homographies, self.task.size, self.task.options);
        let starts = conic.into_iter().chain(fallback_camera_matrices(
            self.homographies,
            self.task.size,
            self.task.options,
        ));
        let mut unsettled: Option<Search<Brown>> = None;
        let mut best: Option<Refined<Brown>> = None;
        for camera_matrix in starts {
            let start = match self.view(&camera_matrix) {
                Err(error @ Error::TooFewDegreesOfFreedom { .. }) => return Err(error),
                Err(_) => continue,
                Ok(start) => start,
            };
            let Some(found) = self.search(&self.task.free, start) else {
                continue;
            };
            match self.finish(found.clone()) {
                Some(refined) if !self.is_doubtful(&refined) => return Ok(refined),
                Some(refined) => keep_better(&mut best, refined),
                None => unsettled = unsettled.or(Some(found)),
            }
        }
        let centred = self.centred();
        let again = centred
            .clone()
            .and_then(|c| self.search(&self.task.free, c.view));
        if let Some(refined) = again.and_then(|found| self.finish(found)) {
            keep_better(&mut best, refined);
        }
        let beaten = |b: &Refined<Brown>| {
            let held = centred.as_ref().and_then(|c| self.around(c.view.clone()));
            held.is_some_and(|held| held.noise_scale < BEATEN * b.noise_scale)
        };
        best.filter(|b| !beaten(b))
            .ok_or_else(|| self.no_convergence(centred.or(unsettled)))
    }

    /// A view with the spread of all residuals around it.
    fn around(&self, view: View<Brown>) -> Option<Refined<Brown>> {
        Refined::of_linear(self.planes, &self.task.free, &self.task.judged, view)
    }

    /// Searches the optimum of some samples from a start.
    fn search(&self, free: &FreeParameters, start: View<Brown>) -> Option<Search<Brown>> {
        // Where the straightening's polynomial does not reach a sample, start without.
        let pinhole = View {
            lens: start.lens.without_distortion(),
            ..start.clone()
        };
        search(self.some, free, start).or_else(|| search(self.some, free, pinhole))
    }

    /// The optimum with the principal point held where it is known to be, or at the image centre:
    /// parallel planes have one there, though none without.
    fn centred(&self) -> Option<Search<Brown>> {
        let fixed = Fixed {
            principal_point: true,
            ..self.task.options.fixed
        };
        let options = Options {
            fixed,
            ..*self.task.options
        };
        let free = options.free_parameters();
        fallback_camera_matrices(self.homographies, self.task.size, &options)
            .iter()
            .filter_map(|camera_matrix| self.search(&free, self.view(camera_matrix).ok()?))
            .find(|found| found.termination == Termination::Converged)
    }

    /// From the optimum of some samples to that of all.
    fn finish(&self, found: Search<Brown>) -> Option<Refined<Brown>> {
        if found.termination != Termination::Converged {
            return None;
        }
        let view = found.view.clone();
        finish(self.planes, &self.task.free, &self.task.judged, found).or_else(|| {
            // Some samples misled: search among all of them.
            let found = search(self.planes, &self.task.free, view)?;
            let converged = found.termination == Termination::Converged;
            let found = converged.then_some(found)?;
            let view = found.view.clone();
            // Where the cost is far from a parabola, Newton's undamped steps may not settle.
            finish(self.planes, &self.task.free, &self.task.judged, found)
                .or_else(|| self.around(view))
        })
    }

    /// A geometry that cannot answer is the likeliest reason, and has its own error.
    fn no_convergence(&self, unsettled: Option<Search<Brown>>) -> Error {
        let iterations = unsettled.as_ref().map_or(0, |found| found.iterations);
        let refined = unsettled.and_then(|found| self.around(found.view));
        let rms = refined.as_ref().map_or(0.0, |refined| refined.noise_scale);
        if let Some(refined) = &refined
            && let Err(weakness) = self.judge(refined)
        {
            return self.advised(refined, weakness);
        }
        Error::NotConverged {
            stage: "the joint refinement",
            iterations,
            rms,
        }
    }

    fn judge(&self, refined: &Refined<Brown>) -> Result<(), Weakness> {
        let geometry = self.task.geometry(self.planes, refined);
        geometry.judge(&refined.system, &self.task.free, refined.covariance_factor)
    }

    fn is_doubtful(&self, refined: &Refined<Brown>) -> bool {
        let geometry = self.task.geometry(self.planes, refined);
        let factor = refined.covariance_factor;
        let weakest = geometry.weakest(&refined.system, &self.task.free, factor);
        weakest.is_some_and(|weakest| weakest.is_doubtful())
    }

    fn advised(&self, refined: &Refined<Brown>, weakness: Weakness) -> Error {
        self.task.advised(self.planes, refined, weakness)
    }
}
