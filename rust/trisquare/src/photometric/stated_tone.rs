//! Whether the pixels contradict the tone curves that were stated.

use nalgebra::DVector;

use super::fit::{PixelFit, PixelState};
use super::misfit::misfit;
use super::optimum::optimum;
use super::told_step::told_step;
use crate::image::{PictureState, PictureTone};
use crate::lens::Lens;
use crate::result::Warning;

/// Standard deviations of the effective gamma from which the pixels contradict a stated curve: JPEG
/// moves it by up to six.
const CONTRADICTED: f64 = 7.0;

/// A curve that leaves more than this part of the profiles' misfit is not what they ask for: it makes
/// up for a blur that is not normal. Of 60 pictures in sRGB through a lens whose blur has wings, free
/// curves left 0.6 to 7 of it; of other curves taken for sRGB none, and up to 0.65 after JPEG 85.
const UNEXPLAINED: f64 = 0.6;

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
    let freed = |curve: &_| PictureState::of(PictureTone::Estimated(*curve));
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
    let near = fit.advance(&state, &step);
    let fits = fit.tone_fits(&near, &found.system, factor)?;
    let asked = fits.iter().zip(&stated).enumerate();
    let asked = asked.filter_map(|(picture, (own, stated))| {
        let (gamma, std) = (own.curve.effective_gamma(), own.effective_gamma_std()?);
        let deviations = (gamma - stated.effective_gamma()).abs() / std;
        Some((deviations, picture, gamma, std))
    });
    let (deviations, picture, gamma, std) = asked.max_by(|a, b| a.0.total_cmp(&b.0))?;
    if deviations <= CONTRADICTED {
        return None;
    }
    // Where the steps do not arrive, the first of them tells to first order.
    let free = optimum(&fit, near.clone()).map_or(near, |(free, _)| free);
    let left = misfit(&fit, &free, picture)?;
    if left > UNEXPLAINED * misfit(&fit, of_stated, picture)? {
        return None;
    }
    let change = fit.free.difference(&free.view.lens, &of_stated.view.lens);
    let warning = Warning::ToneContradicted {
        picture,
        gamma,
        std,
        parameter: (*fit.free.names().first()?).into(),
        change: change[0],
    };
    Some((warning, change))
}
