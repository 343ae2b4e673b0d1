//! Test of stated tone curves against the pixels.

use nalgebra::DVector;

use super::fit::{PixelFit, PixelState};
use super::misfit::misfit;
use super::optimum::optimum;
use super::prior_step::step_with_priors;
use crate::image::{PictureState, PictureTone, PowerCurve, ToneFit};
use crate::lens::Lens;
use crate::localise::MAX_MISFIT;
use crate::result::Warning;

/// Deviation of the effective gamma, in standard deviations, above which the pixels contradict a
/// stated curve: JPEG causes up to six.
const CONTRADICTED: f64 = 7.0;
/// The same with a free kurtosis of the blur, which a lens out of focus requires.
const CONTRADICTED_BY_ANY_BLUR: f64 = 3.0;

/// Uncertainty of any stated curve, as a fraction of its effective gamma: with lenses far out of
/// focus the fit gave up to 0.04 less than sRGB's.
const KNOWN: f64 = 0.05;

/// Frees the tone curves at the optimum of stated ones and estimates them with one step of the fit.
/// If they differ clearly, returns a warning, and the change of the free parameters at the optimum
/// of free curves.
pub(super) fn contradicted_tone<L: Lens>(
    fit: &PixelFit<'_>,
    stated_state: &PixelState<L>,
) -> Option<(Warning, DVector<f64>)> {
    let stated: Vec<_> = stated_state
        .pictures
        .iter()
        .map(|picture| picture.curve.tone().power())
        .collect();
    // First as if all blurs were normal, as those of nearly all cameras are: whether another blur
    // would do as well is tested at the optimum below.
    let freed = |curve: &_| PictureState::of(PictureTone::Estimated(*curve)).with_held_kurtosis();
    let state = PixelState {
        pictures: stated.iter().map(freed).collect(),
        ..stated_state.clone()
    };
    let fit = PixelFit {
        free_pictures: stated.len(),
        ..fit.clone()
    };
    let mut found = fit.evaluate(&state)?;
    let free = fit.step(&found.system)?;
    let step = step_with_priors(&fit, &state, &free, &mut found)?;
    let factor = found.spread.covariance_factor(fit.free.len() as f64);
    let near = fit.advance(&state, &step).with_free_kurtosis();
    let fits = fit.tone_fits(&near, &found.system, factor)?;
    let deviations = |(fitted, stated): (&ToneFit, &PowerCurve)| {
        let difference = fitted.curve.effective_gamma() - stated.effective_gamma();
        Some(difference.abs() / fitted.effective_gamma_std()?)
    };
    let tested = fits.iter().zip(&stated).map(deviations).enumerate();
    let tested = tested.filter_map(|(picture, deviations)| Some((deviations?, picture)));
    let (farthest, picture) = tested.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if farthest <= CONTRADICTED {
        return None;
    }
    // It is far from the stated one. If the steps do not converge, the first step is used: it is
    // accurate to first order.
    let optima = optimum(&fit, near.clone()).and_then(|(free, _)| optimum(&fit, free));
    let (free, fitted) = match optima {
        Some((free, found)) => {
            let fitted = fit.tone_fits(&free, &found.system, factor)?[picture];
            (free, fitted)
        }
        None => (near, fits[picture]),
    };
    let ratio = fitted.curve.effective_gamma() / stated[picture].effective_gamma();
    let is_contradicted = (ratio - 1.0).abs() > KNOWN
        && deviations((&fitted, &stated[picture]))? > CONTRADICTED_BY_ANY_BLUR;
    if !is_contradicted {
        return None;
    }
    // Profiles that fit no curve contradict none: free curves left 0.0017 to 0.04 in pictures
    // through lenses whose blur has wings, and at most 0.0012 with curves mistaken for sRGB, after
    // JPEG 85 as well.
    if misfit(&fit, &free, picture)? > MAX_MISFIT {
        return None;
    }
    let change = fit
        .free
        .difference(&free.view.lens, &stated_state.view.lens);
    let warning = Warning::ToneContradicted {
        picture,
        gamma: fitted.curve.effective_gamma(),
        std: fitted.effective_gamma_std()?,
        parameter: (*fit.free.names().first()?).into(),
        change: change[0],
    };
    Some((warning, change))
}
