//! Test of whether a fisheye explains edges for which a distorted pinhole has large residuals, or
//! no solution.

use super::family_odds::{
    MAX_RATIO_WITH_SQUARES, best_comparison, is_clean, is_comparable_pinhole, is_fisheye_like,
    subsampled,
};
use super::models::WeighedModels;
use crate::calibrate::{FirstFit, calibrate};
use crate::error::{Error, ErrorKind};
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Fisheye, Lens};
use crate::observations::{Fixed, Options, PlaneEdges};
use crate::result::{Calibration, Warning};
use crate::uncertainty::unlikely_camera;

/// Ratio of the residuals of a first fit of a fisheye to those of the requested lens below which
/// its models are compared. The residuals are of some edges for the fit, and of all for the
/// requested lens.
const MAX_FIRST_RATIO: f64 = 0.75;

/// Inserts a warning as the first one if a fisheye explains the edges of a calibration with a
/// distorted pinhole better than any of the pinhole's models.
///
/// [`calibrate`](crate::calibrate) does not do this itself, as it takes fits with the models of
/// both lenses: call this after it if the lens may be a fisheye, with the same edges, size and
/// options. It costs nothing if the calibration has no warnings that suggest it.
/// [`calibrate_by_family`](crate::calibrate_by_family) chooses the lens instead.
pub fn warn_of_fisheye<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    calibration: &mut Calibration<L>,
) {
    let has_warning = |is_shown: fn(&Warning) -> bool| calibration.warnings.iter().any(is_shown);
    // Planes that contradict their stated relations, or one skew, explain all residuals.
    let is_explanation = |warning: &Warning| {
        matches!(
            warning,
            Warning::RelationContradicted { .. } | Warning::Sheared { .. }
        )
    };
    let is_suspect = has_warning(is_symptom) && !has_warning(is_explanation);
    if !is_suspect || !is_comparable_pinhole(options) {
        return;
    }
    // Nothing is left to explain if a lens that bends as a pinhole's does leaves noise alone.
    if is_clean(calibration) && !is_fisheye_like(calibration) {
        return;
    }
    let subset = subsampled(edges);
    let wide_options = options.for_family::<Fisheye>();
    // Real boards are never quite flat, and a fisheye does not change that.
    let limit = MAX_FIRST_RATIO * calibration.rms;
    let may_explain = |fit: FirstFit| fit.agrees || fit.rms < limit;
    if !FirstFit::of(&subset, size, &wide_options).is_none_or(may_explain) {
        return;
    }
    let wide = WeighedModels::of(&subset, size, &wide_options);
    let pinhole = WeighedModels::of(&subset, size, options);
    // Deformed sheets explain such residuals as well, and a fisheye would partly fit them.
    let is_deformation = |warning: &Warning| {
        matches!(
            warning,
            Warning::SidesErrTogether {
                height: Some(_),
                ..
            } | Warning::PlaneStretched { .. }
        )
    };
    let is_deformed = calibration.warnings.iter().any(is_deformation);
    let (Some(wide), Some(pinhole)) = (wide, pinhole) else {
        return;
    };
    let best = best_comparison(&subset, &wide, &pinhole);
    let (model, fit) = best.wide;
    let pinhole_fit = pinhole.fit_with(options.model);
    let pinhole_rms = pinhole_fit.map_or(calibration.rms, |fit| fit.rms);
    let follows_deformation =
        is_deformed && !is_clean(fit) && fit.rms > MAX_RATIO_WITH_SQUARES * pinhole_rms;
    if best.odds > 0.0 && !follows_deformation {
        let warning = Warning::LensOfAnotherFamily {
            model: model.name(),
            rms: fit.rms,
            own: pinhole_rms,
            focal: fit.camera.focal().x,
        };
        calibration
            .warnings
            .retain(|other| !other.is_lens_beyond_model());
        calibration.warnings.insert(0, warning);
    }
}

/// Whether a lens of another family may be the cause of a warning.
fn is_symptom(warning: &Warning) -> bool {
    warning.is_lens_beyond_model()
        || matches!(
            warning,
            Warning::PlanesContradict { .. }
                | Warning::NoSquares { .. }
                | Warning::Disagreement(_)
                | Warning::SideRejected { .. }
                | Warning::PlaneRejected { .. }
                | Warning::PixelsNotSquare { .. }
                | Warning::Sheared { .. }
                | Warning::PrincipalPointOffCentre { .. }
                | Warning::SidesErrTogether { .. }
                | Warning::PlaneStretched { .. }
                | Warning::PixelsNotUsed { .. }
        )
}

/// The error for edges that had no solution with a distorted pinhole: that the lens is a fisheye,
/// if one has a solution and explains them better than any distorted pinhole.
///
/// [`calibrate`](crate::calibrate) does not do this itself: call this with its error if the lens
/// may be a fisheye, and with the same edges, size and options. Any other error is returned
/// unchanged.
pub fn or_fisheye<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
    error: Error,
) -> Error {
    if !may_be_lens_error(&error) || !is_comparable_pinhole(options) {
        return error;
    }
    let subset = subsampled(edges);
    explaining_fisheye(&subset, size, options).unwrap_or(error)
}

/// Whether an error may be due to a lens of another family.
fn may_be_lens_error(error: &Error) -> bool {
    match error.kind() {
        ErrorKind::NotEnoughPlanes | ErrorKind::Convergence => true,
        ErrorKind::DegenerateGeometry => !matches!(error, Error::ContradictedRelation(_)),
        _ => false,
    }
}

fn explaining_fisheye<L: Lens>(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<L>,
) -> Option<Error> {
    let wide_options = options.for_family::<Fisheye>();
    let wide = WeighedModels::of(edges, size, &wide_options)?;
    let pinhole = WeighedModels::of(edges, size, options);
    let (model, fit) = match &pinhole {
        Some(pinhole) => {
            let best = best_comparison(edges, &wide, pinhole);
            (best.odds > 0.0).then_some(best.wide)?
        }
        None => Some(wide.chosen()).filter(|(_, fit)| is_clean(fit))?,
    };
    let options = &Options {
        model,
        ..wide_options
    };
    let is_usual = unlikely_camera(fit, Fixed::default(), |_| None).is_empty();
    let can_calibrate = || calibrate(edges, size, options).is_ok();
    let is_explained = is_usual && is_fisheye_like(fit) && can_calibrate();
    is_explained.then(|| Error::LensOfAnotherFamily {
        model: model.name(),
        rms: fit.rms,
        focal: fit.camera.focal().x,
    })
}
