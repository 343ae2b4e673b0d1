//! Solution of a problem: the optimum weighted by the planes' own noise, its covariance, and its
//! refusal.

use nalgebra::DMatrix;

use super::optimum::Optimum;
use super::problem::{Failure, JointProblem};
use super::starts::Starts;
use crate::error::Error;
use crate::lens::Lens;
use crate::linear::view_by_lens;
use crate::noise::{Noise, Sheets, account_for_deformation, account_for_drift};
use crate::observations::{FreeParameters, Method, ObservedPlane, View};
use crate::refine::{Refined, Search, finish, search};
use crate::result::ResidualCorrelation;
use crate::uncertainty::{
    Correlated, correlated_covariance, covariance, disagreement, weighted_by_noise,
};

/// Approximate number of evaluations of the last steps with all samples.
const FINAL_STEPS: usize = 6;

/// The best camera for some planes, with its covariance and noise.
#[derive(Clone)]
pub(crate) struct Solution<L> {
    /// The planes, each weighted by its own noise.
    pub planes: Vec<ObservedPlane>,
    pub refined: Refined<L>,
    pub correlated: Correlated,
    /// Noise of the residuals; `None` if they are exact, or if it was not measured.
    pub noise: Option<Noise>,
}

impl<L> Solution<L> {
    /// The given planes with the outliers of this solution.
    pub fn with_outliers_marked(&self, planes: &[ObservedPlane]) -> Vec<ObservedPlane> {
        let mut planes = planes.to_vec();
        for (plane, found) in planes.iter_mut().zip(&self.planes) {
            for (side, found) in plane.sides_mut().zip(found.sides()) {
                side.is_outlier = found.is_outlier;
            }
        }
        planes
    }
}

impl<L: Lens> JointProblem<'_, L> {
    /// The optimum of planes in a trial; `None` if there is none, or if no work is left.
    pub fn trial_optimum(&self, planes: &[ObservedPlane]) -> Option<Refined<L>> {
        match self.work.is_spent() {
            true => None,
            false => self.optimum(planes).ok(),
        }
    }

    /// The optimum by the selected method.
    pub fn optimum(&self, planes: &[ObservedPlane]) -> Result<Refined<L>, Failure<L>> {
        Ok(self.optimum_with_noise(planes)?.refined)
    }

    pub(super) fn optimum_with_noise(
        &self,
        planes: &[ObservedPlane],
    ) -> Result<Optimum<L>, Failure<L>> {
        if let Some((known_planes, found)) = &self.found
            && std::ptr::eq(*known_planes, planes)
        {
            return Ok(found.clone());
        }
        if let Some(found) = self.optimum_of_many(planes) {
            return Ok(found.into());
        }
        Starts::of(self, planes)?.optimum()
    }

    /// The solution by the selected method.
    pub fn solve(&self, planes: &[ObservedPlane]) -> Result<Solution<L>, Failure<L>> {
        let found = self.optimum_with_noise(planes)?;
        match self.options.method {
            Method::MaximumLikelihood => self.converge_with(planes, found, Sheets::Boards),
            Method::Linear => self.independent_solution(planes, found.refined),
        }
    }

    /// The solution, starting from the view of a richer model.
    pub fn solve_from_richer(
        &self,
        planes: &[ObservedPlane],
        richer: &View<L>,
    ) -> Result<Solution<L>, Failure<L>> {
        let start = View {
            lens: richer.lens.of_model(self.options.model),
            ..richer.clone()
        };
        match Starts::optimum_near(self, planes, start) {
            Some(found) => self.converge(planes, found),
            None => self.solve(planes),
        }
    }

    /// Weights the planes of an optimum by their own noise, and measures the correlation of the
    /// residuals.
    pub fn converge(
        &self,
        planes: &[ObservedPlane],
        refined: Refined<L>,
    ) -> Result<Solution<L>, Failure<L>> {
        self.converge_with(planes, refined.into(), Sheets::Boards)
    }

    /// A solution of the same planes in which the sheets of squares are not flat either; `planes`
    /// are those given.
    pub fn with_deformation(
        &self,
        planes: &[ObservedPlane],
        flat: &Solution<L>,
    ) -> Option<Solution<L>> {
        let planes = flat.with_outliers_marked(planes);
        let refined = self.refit(&planes, &flat.refined)?;
        let found = self.converge_with(&planes, refined.into(), Sheets::All);
        let mut found = found.ok()?;
        let flat = &flat.correlated.residual_correlation;
        let correlation = &mut found.correlated.residual_correlation;
        // A deformation that the fit removes is still an error of the sides.
        correlation.displacements.clone_from(&flat.displacements);
        correlation.probability = flat.probability;
        Some(found)
    }

    fn converge_with(
        &self,
        planes: &[ObservedPlane],
        Optimum { mut refined, noise }: Optimum<L>,
        sheets: Sheets,
    ) -> Result<Solution<L>, Failure<L>> {
        if refined.is_exact() {
            return self.independent_solution(planes, refined);
        }
        let mut noise = noise.unwrap_or_else(|| Noise::of_optimum(planes, &refined));
        let mut planes = planes.to_vec();
        if let Some(weighted) = weighted_by_noise(&planes, &noise)
            && let Some(refitted) = self.refit(&weighted, &refined)
        {
            noise = Noise::of_optimum(&weighted, &refitted);
            (planes, refined) = (weighted, refitted);
        }
        // Sheets that are not flat would be mistaken for an error of the tone curve.
        let found = account_for_deformation(&planes, &self.free, &self.judged, &refined, sheets)
            .or_else(|| account_for_drift(&planes, &self.free, &self.judged, &refined));
        if let Some(found) = found {
            (planes, refined) = found;
            noise = Noise::of_optimum(&planes, &refined);
        }
        let correlated = correlated_covariance(&planes, &self.free, &refined, &noise);
        noise.exclude_strays(&planes, &mut refined.residuals);
        Ok(Solution {
            correlated: correlated.ok_or_else(|| self.singular(&planes, &refined))?,
            planes,
            refined,
            noise: Some(noise),
        })
    }

    /// The optimum of planes with changed weights, starting from the previous one.
    pub fn refit(&self, planes: &[ObservedPlane], before: &Refined<L>) -> Option<Refined<L>> {
        self.finished(planes, before.as_start()).or_else(|| {
            let found = self.searched(planes, &self.free, before.view.clone())?;
            self.finished(planes, found)
        })
    }

    /// [`search`] with its work counted.
    pub fn searched(
        &self,
        planes: &[ObservedPlane],
        free: &FreeParameters,
        start: View<L>,
    ) -> Option<Search<L>> {
        let found = search(planes, free, start);
        self.work
            .count(planes, found.as_ref().map_or(1, |found| found.iterations));
        found
    }

    /// [`finish`] with its work counted.
    pub fn finished(&self, planes: &[ObservedPlane], start: Search<L>) -> Option<Refined<L>> {
        self.work.count(planes, FINAL_STEPS);
        finish(planes, &self.free, &self.judged, start)
    }

    /// A solution with an additional plane that is placed under its camera without affecting it.
    pub fn with_follower(
        &self,
        solution: &Solution<L>,
        index: usize,
        plane: &ObservedPlane,
    ) -> Option<Solution<L>> {
        let mut follower = plane.clone();
        follower.mark_as_outlier();
        let (lens, single) = (&solution.refined.view.lens, std::slice::from_ref(&follower));
        let placed = view_by_lens(lens, single, single, self.size, self.options).ok()?;
        let (mut planes, mut refined) = (solution.planes.clone(), solution.refined.clone());
        planes.insert(index, follower);
        refined.view = refined.view.with_plane(index, placed.planes[0].clone());
        let refined = self.refit(&planes, &refined)?;
        self.converge(&planes, refined).ok()
    }

    /// A solution under the assumption of uncorrelated residuals.
    fn independent_solution(
        &self,
        planes: &[ObservedPlane],
        refined: Refined<L>,
    ) -> Result<Solution<L>, Failure<L>> {
        let system = refined.system.leading(self.free.len());
        let focal = refined.view.lens.focal().x;
        let factor = refined.covariance_factor;
        let covariance =
            covariance(&system, factor).ok_or_else(|| self.singular(planes, &refined))?;
        let correlated = Correlated {
            known: DMatrix::zeros(covariance.nrows(), covariance.ncols()),
            covariance,
            disagreement: disagreement(&system, &self.free, focal, factor),
            residual_correlation: ResidualCorrelation::none(planes.len(), self.free.len()),
        };
        Ok(Solution {
            planes: planes.to_vec(),
            refined,
            correlated,
            noise: None,
        })
    }

    /// Whether the geometry does not determine the camera.
    pub fn is_ill_conditioned(&self, solution: &Solution<L>) -> bool {
        self.ill_conditioning(&solution.planes, &solution.refined)
            .is_some()
    }

    /// Checks that the geometry determines the camera.
    ///
    /// # Errors
    /// [`Failure::IllConditioned`].
    pub fn judge(&self, solution: &Solution<L>) -> Result<(), Failure<L>> {
        let refusal = self.refusal(&solution.planes, &solution.refined);
        refusal.map_or(Ok(()), Err)
    }

    /// Failure because of a singular covariance: most likely due to the geometry.
    fn singular(&self, planes: &[ObservedPlane], refined: &Refined<L>) -> Failure<L> {
        let refusal = self.refusal(planes, refined);
        refusal.unwrap_or(Failure::Other(Error::NotConverged {
            stage: "the covariance",
            iterations: refined.iterations,
            rms: refined.rms(),
        }))
    }
}
