//! Test of whether another of OpenCV's models describes a lens that the requested one does not.

use nalgebra::{DMatrix, DVector};

use super::family_odds::{is_comparable_pinhole, subsampled};
use crate::calibrate::{calibrate, calibrate_agreeing};
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens, Rational, RationalModel, ThinPrism, ThinPrismModel};
use crate::numeric::chi_square_tail;
use crate::observations::{Options, PlaneEdges};
use crate::result::{Calibration, Warning};

/// Probability with which noise alone may cause the estimates of the coefficients beyond the
/// requested ones.
const CHANCE: f64 = 1e-4;

/// Inserts a warning about the lens as the first one if planes contradict each other under the
/// requested model, or no richer one describes the lens, and one of OpenCV's models has no such
/// warnings.
///
/// With targets that are not squares that is rare: a few more coefficients hardly ever turn them
/// into squares of a usual camera, with sides that show noise alone. Call this after
/// [`warn_of_fisheye`](crate::warn_of_fisheye), with the same edges, size and options. It costs
/// nothing without such warnings.
pub fn warn_of_opencv_lens<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    calibration: &mut Calibration<L>,
) {
    let is_explained = calibration.warnings.first().is_some_and(|first| {
        let is_cured = first.is_lens_beyond_model() && first.alternative().is_some();
        is_cured || matches!(first, Warning::Sheared { .. })
    });
    let is_suspect = fits_badly(calibration) && !is_explained;
    if !is_suspect || !is_comparable_pinhole(options) {
        return;
    }
    let subset = subsampled(edges);
    let requested = (options, &calibration.parameters[..]);
    let cure = ThinPrismModel::TANGENTIAL
        .into_iter()
        .find_map(|model| cure_by_lens::<L, ThinPrism>(&subset, size, requested, model))
        .or_else(|| cure_by_lens::<L, Rational>(&subset, size, requested, RationalModel::Rational));
    // No lens explains by a part of the edges what these do not show.
    let is_reproduced = || calibrate(&subset, size, options).is_ok_and(|found| fits_badly(&found));
    if cure.is_none() || !is_reproduced() {
        return;
    }
    let mut warnings = calibration.warnings.iter();
    let place = warnings.position(Warning::is_lens_beyond_model);
    let known = place.map(|place| calibration.warnings.remove(place));
    let (parameter, factor) = match known {
        Some(Warning::LensBeyondModel {
            parameter, factor, ..
        }) => (parameter, factor),
        _ => ("fx".into(), 1.0),
    };
    let warning = Warning::LensBeyondModel {
        certain: true,
        parameter,
        factor,
        cure,
        held: options.fixed.names().into_iter().map(Into::into).collect(),
    };
    calibration.warnings.insert(0, warning);
}

/// Whether planes contradict each other, or the first warning is about the lens.
fn fits_badly<L: Lens>(found: &Calibration<L>) -> bool {
    let contradicts = |warning: &Warning| {
        matches!(
            warning,
            Warning::PlanesContradict { .. } | Warning::NoSquares { .. }
        )
    };
    let first = found.warnings.first();
    first.is_some_and(Warning::is_lens_beyond_model) || found.warnings.iter().any(contradicts)
}

/// Whether a warning is only about regions of the picture without targets.
fn is_extrapolation(warning: &Warning) -> bool {
    matches!(warning, Warning::LensExtrapolated { .. })
}

/// The name of a model and `fx` with it, if coefficients beyond the requested ones leave no
/// warnings.
fn cure_by_lens<A: Lens, B: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    (options, requested): (&Options<A>, &[&str]),
    model: B::Model,
) -> Option<(String, f64)> {
    let options = Options {
        model,
        ..options.for_family::<B>()
    };
    let found = calibrate_agreeing(edges, size, &options)?;
    (found.warnings.iter().all(is_extrapolation) && has_other_coefficients(&found, requested))
        .then(|| (model.name(), found.camera.focal().x))
}

/// Whether the coefficients beyond the requested parameters differ significantly from zero: if not,
/// the lens is the same, and the search for the requested one has failed.
fn has_other_coefficients<L: Lens>(found: &Calibration<L>, requested: &[&str]) -> bool {
    let free = found.parameters.iter().enumerate();
    let others: Vec<_> = free.filter(|(_, name)| !requested.contains(name)).collect();
    let estimates = found.estimates();
    let value = |name: &str| estimates.iter().find(|estimate| estimate.name == name);
    let values = others.iter().map(|(_, name)| Some(value(name)?.value));
    let Some(values) = values.collect::<Option<Vec<f64>>>().map(DVector::from_vec) else {
        return false;
    };
    let covariance = DMatrix::from_fn(others.len(), others.len(), |i, j| {
        found.covariance[(others[i].0, others[j].0)]
    });
    let square = covariance
        .cholesky()
        .map(|factor| values.dot(&factor.solve(&values)));
    square.is_some_and(|square| chi_square_tail(square, others.len() as f64) < CHANCE)
}
