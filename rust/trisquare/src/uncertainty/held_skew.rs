//! Test for a skew where it is held at zero: the picture may have been sheared, as by a rolling
//! shutter or a scanner.

use super::covariance::covariance;
use crate::lens::{Lens, SKEW};
use crate::observations::{Fixed, FreeParameters, Options};
use crate::refine::Refined;
use crate::result::{Calibration, Warning};

/// Skew, as a fraction of the focal length, above which it matters.
const NOTABLE_SKEW: f64 = 5e-4;

/// Skew, in its standard deviations, above which it is evident.
const EVIDENT: f64 = 4.0;

/// Warns of a skew that all planes agree with, and that is not zero.
///
/// The equations of the optimum are over `judged`, of which `free` are the first. `freed` returns the
/// calibration with the given parameters held, and its warnings. It is called only if one step from
/// the optimum shows that the skew is not zero.
pub(crate) fn held_skew<L: Lens>(
    refined: &Refined<L>,
    (free, judged): (&FreeParameters, &FreeParameters),
    options: &Options<L>,
    freed: impl Fn(Fixed) -> Option<Calibration<L>>,
) -> Option<Warning> {
    let held = options.fixed;
    // If something else is held, a skew would compensate for its error.
    let is_rest_free = !(held.focal || held.principal_point || held.distortion);
    if !(held.skew && is_rest_free) {
        return None;
    }
    let skew = judged.position(SKEW)?;
    if skew_deviations(refined, free.len(), skew)? < EVIDENT {
        return None;
    }
    let fixed = Fixed {
        skew: false,
        ..held
    };
    let found = freed(fixed)?;
    if found.warnings.iter().any(is_other_cause) {
        return None;
    }
    let (skew, std) = (found.camera.skew(), found.std_of(SKEW)?);
    let focal = found.camera.focal().x;
    (skew.abs() > (NOTABLE_SKEW * focal).max(EVIDENT * std)).then_some(Warning::Sheared {
        skew,
        std,
        focal,
    })
}

/// Whether a warning is about a target or the lens, whose error a skew would only compensate for.
fn is_other_cause(warning: &Warning) -> bool {
    use Warning::{
        LensBeyondModel, LensOfAnotherFamily, PlaneRejected, PlanesContradict, SideRejected,
    };
    matches!(
        warning,
        LensBeyondModel { .. }
            | LensOfAnotherFamily { .. }
            | PlaneRejected { .. }
            | PlanesContradict { .. }
            | SideRejected { .. }
    )
}

/// Returns the skew after one step of it and of the free parameters from an optimum, in its standard
/// deviations; `None` if it is not determined. `skew` is its position in the equations.
fn skew_deviations<L: Lens>(optimum: &Refined<L>, free: usize, skew: usize) -> Option<f64> {
    let tested: Vec<usize> = (0..free).chain([skew]).collect();
    let system = optimum.system.selected(&tested);
    let covariance = covariance(&system, optimum.covariance_factor)?;
    Some(system.solve(0.0)?.shared[free].abs() / covariance[(free, free)].sqrt())
}
