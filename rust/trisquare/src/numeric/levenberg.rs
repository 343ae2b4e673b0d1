//! Levenberg-Marquardt for a problem with arrowhead structure: bounded, with a reason of its
//! termination.
//!
//! (D. W. Marquardt, SIAM J. Appl. Math. 11 (1963) 431-441.)

use super::arrowhead::{ArrowStep, ArrowSystem};

/// Initial damping: nearly Gauss-Newton, since the linear steps start close.
const INITIAL_DAMPING: f64 = 1e-4;

/// Maximum damping: above it a step is too short to have an effect, and no descent is possible.
const MAX_DAMPING: f64 = 1e12;

/// Damping below which it is set to zero.
const MIN_DAMPING: f64 = 1e-9;

/// Predicted relative decrease of the cost below which rounding exceeds it.
const ROUNDING: f64 = 1e-13;

/// Termination reason of an iteration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Termination {
    /// The next step would not change the cost noticeably.
    Converged,
    /// The maximum number of iterations was reached.
    IterationLimit,
    /// No damping gave a descent, or the equations were singular.
    Stuck,
}

/// A least-squares problem whose normal equations have arrowhead structure.
pub(crate) trait Problem {
    /// The parameters' values.
    type State: Clone;

    /// Half the (robust) sum of squares and its normal equations; `None` if they are not defined.
    fn evaluate(&self, state: &Self::State) -> Option<(f64, ArrowSystem)>;

    /// The state after a step.
    fn advance(&self, state: &Self::State, step: &ArrowStep) -> Self::State;
}

/// Termination limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Maximum number of evaluations.
    pub iterations: usize,
    /// Absolute decrease of the cost below which a step is the last.
    pub decrease: f64,
}

/// Result of a minimisation.
pub(crate) struct Minimum<S> {
    pub state: S,
    pub cost: f64,
    pub system: ArrowSystem,
    pub iterations: usize,
    pub termination: Termination,
}

/// Minimises from `start`; `None` if the problem is not defined there, or overflows.
pub(crate) fn minimise<P: Problem>(
    problem: &P,
    start: P::State,
    limits: Limits,
) -> Option<Minimum<P::State>> {
    let evaluated = problem.evaluate(&start);
    let (cost, system) = evaluated.filter(|(cost, _)| cost.is_finite())?;
    let mut best = Minimum {
        state: start,
        cost,
        system,
        iterations: 1,
        termination: Termination::IterationLimit,
    };
    let mut damping = INITIAL_DAMPING;
    let mut growth = 4.0;
    while best.iterations < limits.iterations {
        let Some(step) = best.system.solve(damping) else {
            if damping > MAX_DAMPING {
                best.termination = Termination::Stuck;
                break;
            }
            damping = damping.max(MIN_DAMPING) * growth;
            growth *= 2.0;
            continue;
        };
        let is_last = step.predicted_decrease <= limits.decrease;
        if step.predicted_decrease <= ROUNDING * best.cost {
            best.termination = Termination::Converged;
            break;
        }
        let state = problem.advance(&best.state, &step);
        best.iterations += 1;
        let evaluated = problem.evaluate(&state).filter(|(c, _)| *c <= best.cost);
        if let Some((cost, system)) = evaluated {
            let gain = (best.cost - cost) / step.predicted_decrease;
            (best.state, best.cost, best.system) = (state, cost, system);
            damping = if gain > 0.75 { damping * 0.1 } else { damping };
            if damping < MIN_DAMPING {
                damping = 0.0;
            }
            growth = 4.0;
            if is_last {
                best.termination = Termination::Converged;
                break;
            }
        } else if is_last {
            // At the optimum to rounding: predicted and actual decrease are negligible.
            best.termination = Termination::Converged;
            break;
        } else {
            damping = damping.max(MIN_DAMPING) * growth;
            growth *= 2.0;
            if damping > MAX_DAMPING {
                best.termination = Termination::Stuck;
                break;
            }
        }
    }
    Some(best)
}
