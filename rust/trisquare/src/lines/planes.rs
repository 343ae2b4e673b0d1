//! Information of the planes on the lens, at any lens.
//!
//! At the planes' own optimum that is the calibration's covariance `C`, which is larger than the
//! inverse of the edge samples' information `A = L L^T` by everything that reduces their worth.
//! With `M = L^T C L` there, the information at another lens is `L M^-1 L^T` with that lens's `L`,
//! and the planes' optimum is one Newton step away: the fit remains joint where it is not linear.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::follow::{least_squares, planes_under, with_fixed_weights};
use crate::lens::{INTRINSICS, Lens};
use crate::numeric::Problem;
use crate::observations::{ObservedPlane, PlaneState, View};
use crate::refine::Refined;
use crate::result::Calibration;
use crate::solver::{JointProblem, Solution};

/// Information of the planes at a lens, with free parameters in units of their standard deviations.
pub(super) struct PlaneInformation {
    pub information: DMatrix<f64>,
    /// Deviation of the lens from the planes' optimum.
    pub deviation: DVector<f64>,
    /// Square of the deviation in standard deviations, from the cost of the planes' samples
    /// relative to that at their own lens: a linear step does not give it if there is a second
    /// optimum.
    pub square: f64,
}

/// The planes of a calibration.
pub(super) struct Planes<'a, L: Lens> {
    problem: &'a JointProblem<'a, L>,
    /// The optimum of the edge samples, and the samples with its weights.
    optimum: &'a Refined<L>,
    weighted_planes: Vec<ObservedPlane>,
    pub lens: L,
    /// Standard deviations of the free parameters.
    pub units: DVector<f64>,
    /// `M^-1`.
    inverse_inflation: DMatrix<f64>,
    /// Step that remains by the edge samples alone, and their cost.
    remaining_step: DVector<f64>,
    cost: f64,
}

impl<'a, L: Lens> Planes<'a, L> {
    /// `None` if no parameter is free.
    pub fn of(
        problem: &'a JointProblem<'a, L>,
        solution: &'a Solution<L>,
        calibration: &Calibration<L>,
    ) -> Option<Self> {
        let covariance = &calibration.covariance;
        let units = covariance.diagonal().map(f64::sqrt);
        let size = units.len();
        let identity = DMatrix::identity(size, size);
        let mut planes = Self {
            problem,
            optimum: &solution.refined,
            weighted_planes: with_fixed_weights(&solution.planes, &solution.refined),
            lens: calibration.camera,
            units,
            inverse_inflation: identity,
            remaining_step: DVector::zeros(size),
            cost: 0.0,
        };
        let (factor, remaining_step, cost) = planes.normal_equations(planes.lens)?;
        let scaled = DMatrix::from_fn(size, size, |i, j| {
            covariance[(i, j)] / (planes.units[i] * planes.units[j])
        });
        let inflation = factor.l().tr_mul(&(scaled * factor.l()));
        planes.inverse_inflation = inflation.cholesky()?.inverse();
        (planes.remaining_step, planes.cost) = (remaining_step, cost);
        (size > 0).then_some(planes)
    }

    /// Information of the planes at a lens; `None` if the lens does not see all samples.
    pub fn information_at(&self, lens: L) -> Option<PlaneInformation> {
        let (factor, deviation, cost) = self.normal_equations(lens)?;
        let mean_inverse_inflation =
            self.inverse_inflation.trace() / self.inverse_inflation.nrows() as f64;
        Some(PlaneInformation {
            information: factor.l() * &self.inverse_inflation * factor.l().transpose(),
            deviation: deviation - &self.remaining_step,
            square: 2.0 * (cost - self.cost) * mean_inverse_inflation,
        })
    }

    /// The lens after a step in `units`.
    pub fn stepped_lens(&self, step: &DVector<f64>, from: &L) -> L {
        let step = step.component_mul(&self.units);
        self.problem.free.advance(from, &step)
    }

    /// The lens with the usual prior on its distortion: with small squares alone it may not see any
    /// corner of the picture.
    pub fn lens_with_prior(&self) -> Option<L> {
        let (values, priors) = (
            self.lens.parameters(),
            self.lens.coefficient_priors(self.problem.size),
        );
        let mut information = self.information_at(self.lens)?.information;
        let mut gradient = DVector::zeros(self.units.len());
        for (i, name) in self.problem.free.names().into_iter().enumerate() {
            let column = L::parameter_names()
                .iter()
                .position(|parameter| *parameter == name)?;
            let coefficient = column.checked_sub(INTRINSICS);
            if let Some(prior) = coefficient.and_then(|place| priors.get(place)) {
                let by_std = self.units[i] / prior;
                information[(i, i)] += by_std * by_std;
                gradient[i] = by_std * values[column] / prior;
            }
        }
        let step = -information.cholesky()?.solve(&gradient);
        Some(self.stepped_lens(&step, &self.lens))
    }

    /// The planes under a lens; `None` if it does not see all samples.
    pub fn plane_states(&self, lens: L) -> Option<Vec<PlaneState>> {
        planes_under(
            lens,
            &self.weighted_planes,
            self.optimum,
            self.problem.options.model,
        )
    }

    /// The factor of the edge samples' information with poses eliminated, the deviation of the lens
    /// from their optimum, and their cost.
    fn normal_equations(&self, lens: L) -> Option<(Cholesky<f64, Dyn>, DVector<f64>, f64)> {
        let view = View {
            lens,
            planes: self.plane_states(lens)?,
            relations: self.optimum.view.relations.clone(),
        };
        let free = &self.problem.free;
        let (cost, system) =
            least_squares(&self.weighted_planes, free, self.optimum).evaluate(&view)?;
        let (mut information, mut gradient) = (system.prior.clone(), system.prior_gradient.clone());
        for part in system.contributions()? {
            information += part.information;
            gradient += part.gradient;
        }
        let units = DMatrix::from_diagonal(&self.units);
        let factor = (&units * information * &units).cholesky()?;
        let deviation = factor.solve(&gradient.component_mul(&self.units));
        Some((factor, deviation, cost))
    }
}
