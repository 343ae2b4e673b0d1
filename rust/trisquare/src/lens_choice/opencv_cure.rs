//! Whether another of OpenCV's models would hold a lens that the asked one does not.

use nalgebra::{DMatrix, DVector};

use super::family_odds::{may_be_another, subsampled};
use crate::calibrate::{calibrate, calibrate_agreeing};
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens, Rational, RationalModel, ThinPrism, ThinPrismModel};
use crate::numeric::chi_square_tail;
use crate::observations::{Options, PlaneEdges};
use crate::result::{Calibration, Warning};

/// How often noise alone shows so much of the coefficients that a model has beyond the asked ones.
const CHANCE: f64 = 1e-4;

/// Warns first of all of the lens where planes contradict each other under the asked model, or no
/// richer one holds the lens, and one of OpenCV's models leaves nothing to warn of.
///
/// Targets that are no squares hardly ever let that happen: a few coefficients more make them no
/// squares of a usual camera, with sides that show noise alone. Call this after
/// [`heed_fisheye`](crate::heed_fisheye), with the same edges, size and options. Without such warnings
/// it costs nothing.
pub fn heed_opencv_lens<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    calibration: &mut Calibration<L>,
) {
    let first = calibration.warnings.first();
    let is_cured =
        first.is_some_and(|first| first.is_lens_beyond_model() && first.alternative().is_some());
    let is_suspect = fits_badly(calibration) && !is_cured;
    if !is_suspect || !may_be_another(options) {
        return;
    }
    let some = subsampled(edges);
    let asked = (options, &calibration.parameters[..]);
    let cure = ThinPrismModel::TANGENTIAL
        .into_iter()
        .find_map(|model| of_lens::<L, ThinPrism>(&some, size, asked, model))
        .or_else(|| of_lens::<L, Rational>(&some, size, asked, RationalModel::Rational));
    // What a part of the edges does not show no lens can explain by them.
    let is_shown = || calibrate(&some, size, options).is_ok_and(|own| fits_badly(&own));
    if cure.is_none() || !is_shown() {
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

/// Whether planes contradict each other, or the lens comes first of what is warned of.
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

/// Whether a warning only tells where targets are missing in the picture.
fn is_of_places(warning: &Warning) -> bool {
    matches!(warning, Warning::LensExtrapolated { .. })
}

/// The name of a model and `fx` with it, if it leaves nothing to warn of by coefficients that are
/// not asked for.
fn of_lens<A: Lens, B: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    (options, asked): (&Options<A>, &[&str]),
    model: B::Model,
) -> Option<(String, f64)> {
    let options = Options {
        model,
        ..options.for_family::<B>()
    };
    let found = calibrate_agreeing(edges, size, &options)?;
    (found.warnings.iter().all(is_of_places) && has_other_coefficients(&found, asked))
        .then(|| (model.name(), found.camera.focal().x))
}

/// Whether the coefficients beyond the asked parameters are other than zero: if not, the lens is no
/// other, and the search for the asked one has gone astray.
fn has_other_coefficients<L: Lens>(found: &Calibration<L>, asked: &[&str]) -> bool {
    let free = found.parameters.iter().enumerate();
    let others: Vec<_> = free.filter(|(_, name)| !asked.contains(name)).collect();
    let estimates = found.estimates();
    let value = |name: &str| estimates.iter().find(|own| own.name == name);
    let values = others.iter().map(|(_, name)| Some(value(name)?.value));
    let Some(values) = values.collect::<Option<Vec<f64>>>().map(DVector::from_vec) else {
        return false;
    };
    let covariance = DMatrix::from_fn(others.len(), others.len(), |i, j| {
        found.covariance[(others[i].0, others[j].0)]
    });
    let square = covariance
        .cholesky()
        .map(|own| values.dot(&own.solve(&values)));
    square.is_some_and(|square| chi_square_tail(square, others.len() as f64) < CHANCE)
}
