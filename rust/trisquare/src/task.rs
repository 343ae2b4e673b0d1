//! What is asked of the planes, and what a solution knows: its optimum weighed by the planes' own
//! noise, its covariance, its judgement.

use std::rc::Rc;

use crate::consistency::disagreement;
use crate::correlated::{Coherence, Correlated, correlated_covariance, weighed_by_noise};
use crate::covariance::covariance;
use crate::drift;
use crate::geometry::{Geometry, judged_parameters};
use crate::linear::{Homographies, Undistortion, first_view};
use crate::local_noise::Noise;
use crate::observations::ObservedPlane;
use crate::paper;
use crate::parameters::FreeParameters;
use crate::refine::{Refined, Search, finish, search};
use crate::remedies;
use crate::stages::with_stages;
use crate::view::View;
use crate::weakness::Weakness;
use crate::work::Work;
use crate::{Brown, Error, Fixed, ImageSize, Method, Options};

/// Evaluations that the last steps on all samples take, about.
const FINAL_STEPS: usize = 6;

/// What is asked of the planes.
pub(crate) struct Task<'a> {
    pub size: ImageSize,
    pub options: &'a Options,
    pub free: FreeParameters,
    pub judged: FreeParameters,
    /// Shared with the tasks that try what would help.
    pub work: Rc<Work>,
    /// Whether a refusal says what would help; one that nobody reads need not.
    pub advising: bool,
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
            work: Rc::new(Work::unbounded()),
            advising: true,
        }
    }

    /// The same, whose searches end where they have cost so much.
    pub fn within(self, work: &Rc<Work>) -> Self {
        Self {
            work: Rc::clone(work),
            ..self
        }
    }

    /// The optimum of planes that are only tried; `None` where there is none, or no work is left.
    pub fn tried(&self, planes: &[ObservedPlane]) -> Option<Refined<Brown>> {
        if self.work.is_spent() {
            return None;
        }
        let trial = Self {
            advising: false,
            ..Self::new(self.size, self.options).within(&self.work)
        };
        trial.optimum(planes).ok()
    }

    /// The answer of the method asked for.
    pub fn optimum(&self, planes: &[ObservedPlane]) -> Result<Refined<Brown>, Error> {
        with_stages(self, planes, |stages| stages.optimum())
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
        if let Some(found) = paper::accounted(&planes, &self.free, &self.judged, &refined) {
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
        self.finished(planes, before.as_start()).or_else(|| {
            let found = self.searched(planes, &self.free, before.view.clone())?;
            self.finished(planes, found)
        })
    }

    /// As [`search`], its work counted.
    pub fn searched(
        &self,
        planes: &[ObservedPlane],
        free: &FreeParameters,
        start: View<Brown>,
    ) -> Option<Search<Brown>> {
        let found = search(planes, free, start);
        self.work
            .count(planes, found.as_ref().map_or(1, |found| found.iterations));
        found
    }

    /// As [`finish`], its work counted.
    pub fn finished(
        &self,
        planes: &[ObservedPlane],
        start: Search<Brown>,
    ) -> Option<Refined<Brown>> {
        self.work.count(planes, FINAL_STEPS);
        finish(planes, &self.free, &self.judged, start)
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

    /// Whether the geometry cannot answer.
    pub fn is_weak(&self, solution: &Solution) -> bool {
        self.weakness(&solution.planes, &solution.refined).is_some()
    }

    /// Refuses geometry that cannot answer, and says what would help.
    ///
    /// # Errors
    /// [`Error::WeakGeometry`].
    pub fn judge(&self, solution: &Solution) -> Result<(), Error> {
        let (planes, refined) = (&solution.planes, &solution.refined);
        match self.weakness(planes, refined) {
            Some(weakness) => Err(self.advised(planes, refined, weakness)),
            None => Ok(()),
        }
    }

    /// Why there is no covariance: most likely the geometry.
    fn singular(&self, planes: &[ObservedPlane], refined: &Refined<Brown>) -> Error {
        match self.weakness(planes, refined) {
            Some(weakness) => self.advised(planes, refined, weakness),
            None => Error::NotConverged {
                stage: "the covariance",
                iterations: refined.iterations,
                rms: refined.noise_scale,
            },
        }
    }

    /// Why the geometry of an optimum cannot answer, if it cannot.
    pub fn weakness(&self, planes: &[ObservedPlane], refined: &Refined<Brown>) -> Option<Weakness> {
        let factor = refined.covariance_factor;
        let geometry = self.geometry(planes, refined);
        geometry.judge(&refined.system, &self.free, factor).err()
    }

    pub fn geometry<'b>(
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
    pub fn advised(
        &self,
        planes: &[ObservedPlane],
        refined: &Refined<Brown>,
        mut weakness: Weakness,
    ) -> Error {
        if !self.advising {
            return Error::WeakGeometry(Box::new(weakness));
        }
        let succeeds = |fixed: Fixed| {
            let options = Options {
                fixed,
                ..*self.options
            };
            if self.work.is_spent() {
                return false;
            }
            let trial = Task {
                advising: false,
                ..Task::new(self.size, &options).within(&self.work)
            };
            let judged = with_stages(&trial, planes, |stages| {
                Ok(stages.weakness(&stages.optimum()?).is_none())
            });
            judged.unwrap_or(false)
        };
        weakness.remedies = remedies::holding(&self.options.fixed, succeeds);
        let geometry = self.geometry(planes, refined);
        let shown = remedies::showing(&geometry, &weakness);
        weakness.remedies.extend(shown);
        Error::WeakGeometry(Box::new(weakness))
    }
}
