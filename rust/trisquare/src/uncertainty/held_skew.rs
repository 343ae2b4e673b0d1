//! A skew that is held at zero, and that the planes ask for: the picture was sheared, as by a rolling
//! shutter or a scanner.

use super::covariance::covariance;
use crate::lens::{Lens, SKEW};
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Options};
use crate::refine::{Refined, system_at};
use crate::result::{Calibration, Warning};

/// A skew matters beyond this part of the focal length.
const NOTABLE_SKEW: f64 = 5e-4;

/// It is evident beyond so many of its standard deviations.
const EVIDENT: f64 = 4.0;

/// So many samples of each side are asked first, as they are quick to answer, ...
const FIRST_SAMPLES: usize = 50;

/// ... and all of them where the skew is beyond so many standard deviations of what the first tell.
const POSSIBLE: f64 = 1.5;

/// Warns of a skew that all planes agree with, and that is not zero.
///
/// `freed` gives the calibration where so much is held. It is asked where one step from the optimum says
/// that the skew is not zero.
pub(crate) fn held_skew<L: Lens>(
    planes: &[ObservedPlane],
    refined: &Refined<L>,
    options: &Options<L>,
    freed: impl Fn(Fixed) -> Option<Calibration<L>>,
) -> Option<Warning> {
    let held = options.fixed;
    // Beside what else is held a skew would make up for that.
    let alone = !(held.focal || held.principal_point || held.distortion);
    if !(held.skew && alone) || L::skew_column().is_none() {
        return None;
    }
    let fixed = Fixed {
        skew: false,
        ..held
    };
    let free = Options { fixed, ..*options }.free_parameters();
    let first: Vec<_> = planes.iter().map(|p| p.subsampled(FIRST_SAMPLES)).collect();
    if deviations(&first, refined, &free)? < POSSIBLE
        || deviations(planes, refined, &free)? < EVIDENT
    {
        return None;
    }
    let found = freed(fixed)?;
    if found.warnings.iter().any(is_of_a_target) {
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

/// Whether a target is blamed, which a skew would only make up for.
fn is_of_a_target(warning: &Warning) -> bool {
    use Warning::{PlaneRejected, PlanesContradict, SideRejected};
    matches!(
        warning,
        PlaneRejected { .. } | PlanesContradict { .. } | SideRejected { .. }
    )
}

/// The skew after one step of all parameters from an optimum, in its standard deviations; `None` where
/// it is open.
fn deviations<L: Lens>(
    planes: &[ObservedPlane],
    optimum: &Refined<L>,
    free: &FreeParameters,
) -> Option<f64> {
    let place = free.position(SKEW)?;
    let system = system_at(planes, free, optimum)?;
    let covariance = covariance(&system, optimum.covariance_factor)?;
    Some(system.solve(0.0)?.shared[place].abs() / covariance[(place, place)].sqrt())
}
