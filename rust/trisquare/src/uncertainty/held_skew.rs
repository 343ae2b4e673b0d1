//! Test for a skew where it is held at zero: the picture may have been sheared, as by a rolling
//! shutter or a scanner.

use super::covariance::covariance;
use crate::lens::{Lens, SKEW};
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Options};
use crate::refine::{Refined, system_at};
use crate::result::{Calibration, Warning};

/// Skew, as a fraction of the focal length, above which it matters.
const NOTABLE_SKEW: f64 = 5e-4;

/// Skew, in its standard deviations, above which it is evident.
const EVIDENT: f64 = 4.0;

/// Number of samples of each side in the first, quick test.
const FIRST_SAMPLES: usize = 50;

/// Skew, in the standard deviations of the first test, above which all samples are tested.
const POSSIBLE: f64 = 1.5;

/// Warns of a skew that all planes agree with, and that is not zero.
///
/// `freed` returns the calibration with the given parameters held. It is called only if one step
/// from the optimum shows that the skew is not zero.
pub(crate) fn held_skew<L: Lens>(
    planes: &[ObservedPlane],
    refined: &Refined<L>,
    options: &Options<L>,
    freed: impl Fn(Fixed) -> Option<Calibration<L>>,
) -> Option<Warning> {
    let held = options.fixed;
    // If something else is held, a skew would compensate for its error.
    let is_rest_free = !(held.focal || held.principal_point || held.distortion);
    if !(held.skew && is_rest_free) || L::skew_column().is_none() {
        return None;
    }
    let fixed = Fixed {
        skew: false,
        ..held
    };
    let free = Options { fixed, ..*options }.free_parameters();
    let first: Vec<_> = planes.iter().map(|p| p.subsampled(FIRST_SAMPLES)).collect();
    if skew_deviations(&first, refined, &free)? < POSSIBLE
        || skew_deviations(planes, refined, &free)? < EVIDENT
    {
        return None;
    }
    let found = freed(fixed)?;
    if found.warnings.iter().any(is_target_warning) {
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

/// Whether a warning is about a target, whose error a skew would only compensate for.
fn is_target_warning(warning: &Warning) -> bool {
    use Warning::{PlaneRejected, PlanesContradict, SideRejected};
    matches!(
        warning,
        PlaneRejected { .. } | PlanesContradict { .. } | SideRejected { .. }
    )
}

/// Returns the skew after one step of all parameters from an optimum, in its standard deviations;
/// `None` if it is not determined.
fn skew_deviations<L: Lens>(
    planes: &[ObservedPlane],
    optimum: &Refined<L>,
    free: &FreeParameters,
) -> Option<f64> {
    let place = free.position(SKEW)?;
    let system = system_at(planes, free, optimum)?;
    let covariance = covariance(&system, optimum.covariance_factor)?;
    Some(system.solve(0.0)?.shared[place].abs() / covariance[(place, place)].sqrt())
}
