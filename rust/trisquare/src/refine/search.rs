//! Joint maximum likelihood over the camera, its distortion and all planes, from edge samples: a
//! search with some of them, and a finish with all.

use super::edge_problem::EdgeProblem;
use super::residuals::{
    Residuals, residuals, residuals_near, robust_scale, root_mean_square, scale_near,
};
use super::side_curve::SideCurves;
use crate::lens::Lens;
use crate::numeric::{ArrowSystem, Limits, Loss, Problem, ResidualSpread, Termination, minimise};
use crate::observations::{FreeParameters, ObservedPlane, View};

/// Maximum number of evaluations per round of fixed scale; from the linear start about six are
/// used.
const MAX_ITERATIONS: usize = 100;

/// Maximum number of rounds of re-estimated scale and loss; the second usually changes next to
/// nothing.
const MAX_ROUNDS: usize = 12;

/// Decrease of the cost, in units of the noise variance, below which a step of the search is the
/// last: it is still taken, and the remaining error is of second order. For more than `FEW_PLANES`
/// planes the threshold is proportional to their number.
const LAST_DECREASE: f64 = 0.5;
const FEW_PLANES: f64 = 48.0;

/// Maximum number of Newton steps with all samples, from the optimum of some.
const MAX_FINAL_STEPS: usize = 20;

/// Predicted decrease of the cost, in units of the noise variance, below which a Newton step is the
/// last: the remaining error is its square.
const LAST_FINAL_DECREASE: f64 = 0.03;

/// Relative change of the scale below which it no longer affects the result: it does so by a
/// thousandth of a standard deviation.
const FINAL_SCALE_TOLERANCE: f64 = 0.01;

/// Maximum number of changes of the scale: if it still alternates, the optimum has two modes.
const MAX_RESCALINGS: usize = 4;

/// Relative increase of the cost that may be rounding.
const FINAL_ROUNDING: f64 = 1e-9;

/// Relative change of the scale below which it no longer affects the weights.
const SCALE_TOLERANCE: f64 = 0.1;

/// The optimum, and the quantities needed for its covariance.
#[derive(Clone)]
pub(crate) struct Refined<L> {
    pub view: View<L>,
    /// Normal equations at the optimum, in units of the noise, over the requested parameters.
    pub system: ArrowSystem,
    /// Factor from the inverse of the weighted information to a covariance.
    pub covariance_factor: f64,
    /// Scale of the noise in the weights of the normal equations.
    pub scale: f64,
    /// Factor of the given standard deviations.
    pub noise_scale: f64,
    pub residuals: Residuals,
    pub iterations: usize,
}

impl<L: Lens> Refined<L> {
    /// Root mean square distance of the samples, px.
    pub fn rms(&self) -> f64 {
        root_mean_square(self.residuals.iter().flatten())
    }

    /// Measures the spread of the residuals around a view.
    pub fn with_spread(
        (view, residuals, system): (View<L>, Residuals, ArrowSystem),
        scale: f64,
        unknowns: usize,
        iterations: usize,
    ) -> Self {
        let mut spread = ResidualSpread::default();
        for residual in residuals.iter().flatten().filter(|r| r.is_counted) {
            let x = residual.distance * residual.weight / scale;
            spread.add(Loss::Tukey, x, Loss::Tukey.cost_and_weight(x).1);
        }
        let covariance_factor = spread.covariance_factor(unknowns as f64);
        Self {
            view,
            system,
            covariance_factor,
            scale,
            noise_scale: scale * (covariance_factor / Loss::Tukey.mean_weight()).sqrt(),
            residuals,
            iterations,
        }
    }

    /// The result of the linear steps, with the spread of its residuals.
    pub fn of_linear(
        planes: &[ObservedPlane],
        free: &FreeParameters,
        judged: &FreeParameters,
        view: View<L>,
    ) -> Option<Self> {
        let residuals = residuals(planes, &view)?;
        let unknowns = view.unknowns(free);
        let scale = robust_scale(&residuals, unknowns);
        let (_, system) = information(planes, judged, (&view, scale))?;
        Some(Self::with_spread(
            (view, residuals, system),
            scale,
            unknowns,
            0,
        ))
    }
}

/// Root mean square distance (px) below which samples were computed and not measured: the residuals
/// are rounding errors, and give no estimate of the noise.
const MAX_EXACT_RMS: f64 = 1e-5;

impl<L: Lens> Refined<L> {
    /// Whether the samples' distances are only rounding errors.
    pub fn is_exact(&self) -> bool {
        let all = || self.residuals.iter().flatten();
        let squares: f64 = all().map(|r| r.distance * r.distance).sum();
        squares <= MAX_EXACT_RMS * MAX_EXACT_RMS * all().count() as f64
    }

    /// Start of a search from this optimum.
    pub fn as_start(&self) -> Search<L> {
        Search {
            view: self.view.clone(),
            scale: self.scale,
            iterations: self.iterations,
            termination: Termination::Converged,
        }
    }
}

/// The cost of a view by samples and priors only, without the reach of the lens, and its normal
/// equations.
pub(crate) fn information<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    (view, scale): (&View<L>, f64),
) -> Option<(f64, ArrowSystem)> {
    EdgeProblem::new(planes, &free.without_reach(), scale).evaluate(view)
}

/// Result of a search for the optimum.
#[derive(Clone)]
pub(crate) struct Search<L> {
    pub view: View<L>,
    /// Scale of the noise at the view.
    pub scale: f64,
    pub iterations: usize,
    pub termination: Termination,
}

impl<L> Search<L> {
    /// The search if it has converged.
    pub fn converged(self) -> Option<Self> {
        (self.termination == Termination::Converged).then_some(self)
    }
}

/// Searches the optimum from a start; `None` if the lens is not invertible at a sample there.
///
/// Rounds of fixed scale: Huber's loss first, which is convex, then Tukey's biweight until the
/// scale converges.
pub(crate) fn search<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    start: View<L>,
) -> Option<Search<L>> {
    let limits = Limits {
        iterations: MAX_ITERATIONS,
        decrease: LAST_DECREASE * (planes.len() as f64 / FEW_PLANES).max(1.0),
    };
    let unknowns = start.unknowns(free);
    let mut found = Search {
        scale: scale_near(planes, (&start, unknowns), None)?,
        view: start,
        iterations: 0,
        termination: Termination::IterationLimit,
    };
    for round in 0..MAX_ROUNDS {
        let mut problem = EdgeProblem::new(planes, free, found.scale);
        problem.loss = if round == 0 { Loss::Huber } else { Loss::Tukey };
        let minimum = minimise(&problem, found.view, limits)?;
        found.iterations += minimum.iterations;
        found.termination = minimum.termination;
        found.view = minimum.state;
        let last = std::mem::replace(
            &mut found.scale,
            scale_near(planes, (&found.view, unknowns), None)?,
        );
        let is_settled = round > 0 && (found.scale / last - 1.0).abs() < SCALE_TOLERANCE;
        if is_settled || found.termination != Termination::Converged {
            break;
        }
    }
    // A scale that still alternates after all rounds belongs to an optimum with two modes.
    Some(found)
}

/// Finishes a search with all samples, from the optimum of some of them.
///
/// A few Newton steps, until the scale of all residuals has converged; the normal equations are
/// over the parameters to be judged, of which the free ones are the first. `None` if the steps do
/// not converge: the start was not an optimum.
pub(crate) fn finish<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    start: Search<L>,
) -> Option<Refined<L>> {
    let curves = SideCurves::of(planes, &start.view, start.scale);
    let near = finish_near(planes, (free, judged), &start, Some(&curves));
    // Steps far from the curves may not converge with them.
    match near {
        None if curves.has_any() => finish_near(planes, (free, judged), &start, None),
        near => near,
    }
}

fn finish_near<L: Lens>(
    planes: &[ObservedPlane],
    (free, judged): (&FreeParameters, &FreeParameters),
    start: &Search<L>,
    curves: Option<&SideCurves>,
) -> Option<Refined<L>> {
    let mut view = start.view.clone();
    let mut iterations = start.iterations;
    let unknowns = view.unknowns(free);
    let mut scale = start.scale;
    let mut rescalings = 0;
    let mut last_cost = f64::INFINITY;
    for _ in 0..MAX_FINAL_STEPS {
        let problem = EdgeProblem::new(planes, judged, scale).with_curves(curves);
        let (cost, system) = problem.evaluate(&view)?;
        iterations += 1;
        if cost > last_cost * (1.0 + FINAL_ROUNDING) {
            return None;
        }
        last_cost = cost;
        let step = system
            .leading(free.len())
            .solve(0.0)?
            .scaled(problem.loss.newton_factor());
        view = view.advanced(free, &step);
        let is_converged = step.predicted_decrease < LAST_FINAL_DECREASE;
        if !is_converged && rescalings > 0 {
            continue;
        }
        // The weights must not depend on the start of the search.
        let (next, residuals) = if is_converged {
            let residuals = residuals_near(planes, &view, curves)?;
            (robust_scale(&residuals, unknowns), Some(residuals))
        } else {
            (scale_near(planes, (&view, unknowns), curves)?, None)
        };
        let is_settled = (next / scale - 1.0).abs() < FINAL_SCALE_TOLERANCE;
        if let Some(residuals) = residuals
            && (is_settled || rescalings == MAX_RESCALINGS)
        {
            let system = match judged.has_reach() {
                true => information(planes, judged, (&view, scale))?.1,
                false => system,
            };
            let found = (view, residuals, system);
            return Some(Refined::with_spread(found, scale, unknowns, iterations));
        }
        (scale, last_cost) = (next, f64::INFINITY);
        rescalings += 1;
    }
    None
}
