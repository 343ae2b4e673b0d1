//! Whether the pixels contradict the tone curves that were stated.

use nalgebra::DVector;

use super::fit::{PixelFit, PixelState};
use super::misfit::misfit;
use super::optimum::optimum;
use super::told_step::told_step;
use crate::image::{PictureState, PictureTone, PowerCurve, ToneFit};
use crate::lens::Lens;
use crate::localise::MAX_MISFIT;
use crate::result::Warning;

/// Standard deviations of the effective gamma from which the pixels contradict a stated curve: JPEG
/// moves it by up to six.
const CONTRADICTED: f64 = 7.0;
/// The same where the kurtosis of the blur is free, which a lens out of focus asks for.
const CONTRADICTED_BY_ANY_BLUR: f64 = 3.0;

/// No curve is known better than this, as a part of its effective gamma: of lenses far out of focus
/// pixels asked for up to 0.04 less than sRGB's.
const KNOWN: f64 = 0.05;

/// Frees the tone curves at the optimum of stated ones: one step of the fit tells what the pixels
/// ask for. Where that is something else, a warning of it, and by how much the free parameters change
/// at the optimum of free curves.
pub(super) fn contradicted_tone<L: Lens>(
    fit: &PixelFit<'_>,
    of_stated: &PixelState<L>,
) -> Option<(Warning, DVector<f64>)> {
    let stated: Vec<_> = of_stated
        .pictures
        .iter()
        .map(|own| own.curve.tone().power())
        .collect();
    // As if all blurs were normal, which nearly all cameras' are: the optimum then asks whether another
    // blur would do as well.
    let freed = |curve: &_| PictureState::of(PictureTone::Estimated(*curve)).with_held_kurtosis();
    let state = PixelState {
        pictures: stated.iter().map(freed).collect(),
        ..of_stated.clone()
    };
    let fit = PixelFit {
        free_pictures: stated.len(),
        ..fit.clone()
    };
    let mut found = fit.evaluate(&state)?;
    let free = fit.step(&found.system)?;
    let step = told_step(&fit, &state, &free, &mut found)?;
    let factor = found.spread.covariance_factor(fit.free.len() as f64);
    let near = fit.advance(&state, &step).with_free_kurtosis();
    let fits = fit.tone_fits(&near, &found.system, factor)?;
    let deviations = |(own, stated): (&ToneFit, &PowerCurve)| {
        let away = own.curve.effective_gamma() - stated.effective_gamma();
        Some(away.abs() / own.effective_gamma_std()?)
    };
    let asked = fits.iter().zip(&stated).map(deviations).enumerate();
    let asked = asked.filter_map(|(picture, deviations)| Some((deviations?, picture)));
    let (farthest, picture) = asked.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if farthest <= CONTRADICTED {
        return None;
    }
    // It is far from the stated one. Where the steps do not arrive, the first of them tells to first
    // order.
    let arrived = optimum(&fit, near.clone()).and_then(|(free, _)| optimum(&fit, free));
    let (free, own) = match arrived {
        Some((free, found)) => {
            let own = fit.tone_fits(&free, &found.system, factor)?[picture];
            (free, own)
        }
        None => (near, fits[picture]),
    };
    let ratio = own.curve.effective_gamma() / stated[picture].effective_gamma();
    let is_other = (ratio - 1.0).abs() > KNOWN
        && deviations((&own, &stated[picture]))? > CONTRADICTED_BY_ANY_BLUR;
    if !is_other {
        return None;
    }
    // Profiles of no curve contradict none: of pictures through lenses whose blur has wings free curves
    // left 0.0017 to 0.04, of curves taken for sRGB at most 0.0012, after JPEG 85 as well.
    if misfit(&fit, &free, picture)? > MAX_MISFIT {
        return None;
    }
    let change = fit.free.difference(&free.view.lens, &of_stated.view.lens);
    let warning = Warning::ToneContradicted {
        picture,
        gamma: own.curve.effective_gamma(),
        std: own.effective_gamma_std()?,
        parameter: (*fit.free.names().first()?).into(),
        change: change[0],
    };
    Some((warning, change))
}
