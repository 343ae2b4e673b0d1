//! Steps to the joint optimum of camera, planes and exposures.

use super::fit::{PixelFit, PixelState, PixelSystem};
use super::prior_step::step_with_priors;
use crate::lens::Lens;
use crate::numeric::ArrowStep;

/// Maximum number of Gauss-Newton steps of the joint fit.
const MAX_STEPS: usize = 8;

/// Predicted decrease of the cost, per parameter and in units of the noise variance, below which a
/// step is the last. The geometry comes from the edge samples, all else from some of the pixels:
/// both start within a few standard deviations of the optimum, so that one more step is accurate to
/// second order and efficient without iteration (L. Le Cam, Univ. California Publ. Statist. 1
/// (1953) 277-330).
const LAST_DECREASE: f64 = 6.0;

/// Iterates to the joint optimum: returns the state before the last step, the normal equations
/// there, and that step; `None` if the steps do not converge.
pub(super) fn converge<L: Lens>(
    fit: &PixelFit<'_>,
    mut state: PixelState<L>,
) -> Option<(PixelState<L>, PixelSystem, ArrowStep)> {
    let mut last_cost = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let found = fit.evaluate(&state)?;
        if found.cost > last_cost {
            return None;
        }
        last_cost = found.cost;
        let step = fit.step(&found.system)?;
        if step.predicted_decrease < LAST_DECREASE * step.parameter_count() as f64 {
            return Some((state, found, step));
        }
        state = fit.advance(&state, &step);
    }
    None
}

/// The joint optimum with differences of the blur as estimated from the pictures, and its normal
/// equations; `None` if the steps do not converge.
pub(super) fn optimum<L: Lens>(
    fit: &PixelFit<'_>,
    near: PixelState<L>,
) -> Option<(PixelState<L>, PixelSystem)> {
    let (state, mut found, free) = converge(fit, near)?;
    let step = step_with_priors(fit, &state, &free, &mut found)?;
    Some((fit.advance(&state, &step), found))
}
