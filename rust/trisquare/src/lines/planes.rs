//! Information of the planes on the lens, at any lens.
//!
//! At the planes' own optimum that is the calibration's covariance `C`, which is larger than the
//! inverse of the edge samples' information `A = L L^T` by everything that reduces their worth.
//! With `M = L^T C L` there, the information at another lens is `L M^-1 L^T` with that lens's `L`,
//! and the planes' optimum is one Newton step away: the fit remains joint where it is not linear.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::follow::{least_squares, planes_under, with_weights_held};
use crate::lens::{INTRINSICS, Lens};
use crate::numeric::Problem;
use crate::observations::{ObservedPlane, PlaneState, View};
use crate::refine::Refined;
use crate::result::Calibration;
use crate::solver::{JointProblem, Solution};

/// Information of the planes at a lens, with free parameters in units of their standard deviations.
pub(super) struct Said {
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
    held: Vec<ObservedPlane>,
    pub lens: L,
    /// Standard deviations of the free parameters.
    pub units: DVector<f64>,
    /// `M^-1`.
    worth: DMatrix<f64>,
    /// Step that remains by the edge samples alone, and their cost.
    left: DVector<f64>,
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
        let own = DMatrix::identity(size, size);
        let mut planes = Self {
            problem,
            optimum: &solution.refined,
            held: with_weights_held(&solution.planes, &solution.refined),
            lens: calibration.camera,
            units,
            worth: own,
            left: DVector::zeros(size),
            cost: 0.0,
        };
        let (factor, left, cost) = planes.normal_equations(planes.lens)?;
        let scaled = DMatrix::from_fn(size, size, |i, j| {
            covariance[(i, j)] / (planes.units[i] * planes.units[j])
        });
        let inflation = factor.l().tr_mul(&(scaled * factor.l()));
        planes.worth = inflation.cholesky()?.inverse();
        (planes.left, planes.cost) = (left, cost);
        (size > 0).then_some(planes)
    }

    /// Information of the planes at a lens; `None` if the lens does not see all samples.
    pub fn at(&self, lens: L) -> Option<Said> {
        let (factor, deviation, cost) = self.normal_equations(lens)?;
        let worth = self.worth.trace() / self.worth.nrows() as f64;
        Some(Said {
            information: factor.l() * &self.worth * factor.l().transpose(),
            deviation: deviation - &self.left,
            square: 2.0 * (cost - self.cost) * worth,
        })
    }

    /// The lens after a step in `units`.
    pub fn moved(&self, step: &DVector<f64>, from: &L) -> L {
        let step = step.component_mul(&self.units);
        self.problem.free.advance(from, &step)
    }

    /// The lens with the usual prior on its distortion: with small squares alone it may not see any
    /// corner of the picture.
    pub fn usual(&self) -> Option<L> {
        let (values, usual) = (
            self.lens.parameters(),
            self.lens.coefficient_priors(self.problem.size),
        );
        let mut information = self.at(self.lens)?.information;
        let mut gradient = DVector::zeros(self.units.len());
        for (i, name) in self.problem.free.names().into_iter().enumerate() {
            let column = L::parameter_names().iter().position(|own| *own == name)?;
            let coefficient = column.checked_sub(INTRINSICS);
            if let Some(usual) = coefficient.and_then(|place| usual.get(place)) {
                let by_std = self.units[i] / usual;
                information[(i, i)] += by_std * by_std;
                gradient[i] = by_std * values[column] / usual;
            }
        }
        let step = -information.cholesky()?.solve(&gradient);
        Some(self.moved(&step, &self.lens))
    }

    /// The planes under a lens; `None` if it does not see all samples.
    pub fn under(&self, lens: L) -> Option<Vec<PlaneState>> {
        planes_under(lens, &self.held, self.optimum, self.problem.options.model)
    }

    /// The factor of the edge samples' information with poses eliminated, the deviation of the lens
    /// from their optimum, and their cost.
    fn normal_equations(&self, lens: L) -> Option<(Cholesky<f64, Dyn>, DVector<f64>, f64)> {
        let view = View {
            lens,
            planes: self.under(lens)?,
            relations: self.optimum.view.relations.clone(),
        };
        let free = &self.problem.free;
        let (cost, system) = least_squares(&self.held, free, self.optimum).evaluate(&view)?;
        let (mut information, mut gradient) = (system.prior.clone(), system.prior_gradient.clone());
        for part in system.contributions()? {
            information += part.information;
            gradient += part.gradient;
        }
        let units = DMatrix::from_diagonal(&self.units);
        let factor = (&units * information * &units).cholesky()?;
        let back = factor.solve(&gradient.component_mul(&self.units));
        Some((factor, back, cost))
    }
}
