//! Choice of the family of lenses.
//!
//! The models of each family are compared by evidence, and those of different families by their
//! [odds](super::family_odds).

use nalgebra::{DMatrix, DVector};

use super::doubt::covariance_increase;
use super::family_odds::{FittedModel, best_comparison, is_clean, is_fisheye_like, subsampled};
use super::models::{ModelChoice, WeighedModels, check_comparable};

use crate::calibrate::{FirstFit, calibrate_photographs};
use crate::error::Error;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, DistortionModel, Fisheye, Lens, SKEW};
use crate::observations::{Options, PlaneEdges};
use crate::photometric::Photographs;
use crate::result::Calibration;
use crate::uncertainty::widen;

/// Maximum ratio of a fisheye's residuals to those of a distorted pinhole with residuals of noise
/// alone: above it the fisheye has no odds.
const AS_GOOD: f64 = 1.1;

/// A calibration with a lens of the chosen family.
#[derive(Debug, Clone, PartialEq)]
pub enum FamilyChoice {
    /// A distorted pinhole.
    Pinhole(ModelChoice<DefaultLens>),
    /// A fisheye.
    Fisheye(ModelChoice<Fisheye>),
}

/// The best model of a rejected family.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RejectedFamily {
    /// Its name.
    pub model: String,
    /// Natural logarithm of its odds against the chosen one; not positive.
    pub log_evidence: f64,
    /// Root mean square distance of the edge samples with it, in pixels.
    pub rms: f64,
}

/// Calibrates with the lens, of any family, that has the largest evidence.
///
/// As [`calibrate_by_evidence`](crate::calibrate_by_evidence) within each family. Fisheyes are only
/// fitted if a distorted pinhole leaves errors shared by whole sides, or bends a wide field as a
/// fisheye does. The other family's estimates of focal length and principal point are included in
/// the covariance, weighted by its probability.
///
/// ```
/// use trisquare::{Error, FamilyChoice, ImageSize, Options, PlaneEdges, calibrate_by_family};
///
/// fn tell(edges: &[PlaneEdges], size: ImageSize) -> Result<(), Error> {
///     match calibrate_by_family(edges, size, &Options::default(), None)?.0 {
///         FamilyChoice::Pinhole(found) => println!("{:?}", found.calibration.camera),
///         FamilyChoice::Fisheye(found) => println!("{:?}", found.calibration.camera),
///     }
///     Ok(())
/// }
/// ```
///
/// # Errors
/// As [`calibrate_by_evidence`](crate::calibrate_by_evidence) of a distorted pinhole.
// Inlined so that only its callers compile it, as all that is generic: otherwise it would be the
// only function that compiles a calibration with each lens in this crate, too.
#[inline]
pub fn calibrate_by_family(
    edges: &[PlaneEdges],
    size: ImageSize,
    options: &Options<DefaultLens>,
    photographs: Option<&Photographs<'_>>,
) -> Result<(FamilyChoice, Option<RejectedFamily>), Error> {
    check_comparable(options)?;
    let wide_options = options.for_family::<Fisheye>();
    let plain = WeighedModels::of(edges, size, options);
    let may_be_wide = |fit: &Calibration<_>| {
        let limit = AS_GOOD * fit.rms;
        is_fisheye_like(fit)
            && FirstFit::of(&subsampled(edges), size, &wide_options)
                .is_none_or(|wide| wide.rms < limit)
    };
    let is_enough = |fit: &Calibration<_>| is_clean(fit) && !may_be_wide(fit);
    if let Some(plain) = plain.as_ref().filter(|plain| is_enough(plain.chosen().1)) {
        let choice = plain.answer(edges, size, options, photographs)?;
        return Ok((FamilyChoice::Pinhole(choice), None));
    }
    let wide = WeighedModels::of(edges, size, &wide_options);
    let (plain, wide) = match (plain, wide) {
        (Some(plain), Some(wide)) => (plain, wide),
        (None, Some(wide)) => {
            let choice = wide.answer(edges, size, &wide_options, photographs)?;
            return Ok((FamilyChoice::Fisheye(choice), None));
        }
        (Some(plain), None) => {
            let choice = plain.answer(edges, size, options, photographs)?;
            return Ok((FamilyChoice::Pinhole(choice), None));
        }
        (None, None) => {
            // No model converges: the error of the requested one says why.
            let calibration = calibrate_photographs(edges, size, options, photographs)?;
            let choice = ModelChoice::without_alternatives(options.model, calibration);
            return Ok((FamilyChoice::Pinhole(choice), None));
        }
    };
    let best = best_comparison(edges, &wide, &plain);
    if best.odds > 0.0 {
        let mut choice = wide.answer(edges, size, &wide_options, photographs)?;
        let found = &mut choice.calibration;
        add_doubt(found, best.plain.1, (&plain, options), -best.odds);
        let rejected = rejected(best.plain, -best.odds);
        return Ok((FamilyChoice::Fisheye(choice), Some(rejected)));
    }
    let mut choice = plain.answer(edges, size, options, photographs)?;
    let found = &mut choice.calibration;
    add_doubt(found, best.wide.1, (&wide, &wide_options), best.odds);
    let rejected = rejected(best.wide, best.odds);
    Ok((FamilyChoice::Pinhole(choice), Some(rejected)))
}

/// Parameters with the same meaning in both families.
const SHARED: [&str; 5] = ["fx", "fy", "cx", "cy", SKEW];

/// Adds to a covariance the difference of another family's result, and its additional uncertainty,
/// times that family's probability. The uncertainty is that of the model chosen within the family.
fn add_doubt<A: Lens, B: Lens>(
    found: &mut Calibration<A>,
    other: &Calibration<B>,
    (family, options): (&WeighedModels<B>, &Options<B>),
    odds: f64,
) {
    let probability = 1.0 / (1.0 + (-odds).exp());
    let camera_difference = other.camera.camera_matrix() - found.camera.camera_matrix();
    let entries = [
        camera_difference.m11,
        camera_difference.m22,
        camera_difference.m13,
        camera_difference.m23,
        camera_difference.m12,
    ];
    let chosen = family.chosen().1;
    let mut difference = DVector::zeros(found.parameters.len());
    let (mut places, mut other_places) = (Vec::new(), Vec::new());
    for (name, entry) in SHARED.into_iter().zip(entries) {
        let Some(place) = found.position(name) else {
            continue;
        };
        difference[place] = entry;
        if let Some(same) = chosen.position(name) {
            places.push(place);
            other_places.push(same);
        }
    }
    let mut doubt = &difference * difference.transpose();
    let part = |all: &DMatrix<f64>, kept: &[usize]| all.select_rows(kept).select_columns(kept);
    let (to, from) = (family.covariance(options), &found.covariance);
    if let Some(increase) = covariance_increase(part(&to, &other_places), &part(from, &places)) {
        let size = difference.len();
        let spread = DMatrix::<f64>::identity(size, size).select_columns(&places);
        doubt += &spread * increase * spread.transpose();
    }
    widen(found, doubt * probability, options.fixed);
}

fn rejected<L: Lens>((model, fit): FittedModel<'_, L>, log_evidence: f64) -> RejectedFamily {
    RejectedFamily {
        model: model.name(),
        log_evidence,
        rms: fit.rms,
    }
}
