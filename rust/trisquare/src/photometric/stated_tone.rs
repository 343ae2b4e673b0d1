//! Whether the pixels contradict the tone curves that were stated.

use nalgebra::DVector;

use super::fit::{PixelFit, PixelState};
use crate::image::{PictureState, PictureTone};
use crate::lens::Lens;
use crate::result::Warning;

/// Standard deviations of the effective gamma from which the pixels contradict a stated curve: JPEG
/// moves it by up to six.
const CONTRADICTED: f64 = 7.0;

/// Frees the tone curves at the optimum of stated ones: one step of the fit tells what the pixels
/// ask for. Where that is something else, a warning of it, and by how much the free parameters change
/// with it, to first order.
pub(super) fn contradicted_tone<L: Lens>(
    fit: &PixelFit<'_>,
    optimum: &PixelState<L>,
) -> Option<(Warning, DVector<f64>)> {
    let stated: Vec<_> = optimum
        .pictures
        .iter()
        .map(|own| own.curve.tone().power())
        .collect();
    let freed = |curve: &_| PictureState::of(PictureTone::Estimated(*curve));
    let state = PixelState {
        pictures: stated.iter().map(freed).collect(),
        ..optimum.clone()
    };
    let fit = PixelFit {
        free_pictures: stated.len(),
        ..fit.clone()
    };
    let found = fit.evaluate(&state)?;
    let step = found
        .system
        .solve(0.0)?
        .lengthened(fit.loss.newton_factor());
    let factor = found.spread.covariance_factor(fit.free.len() as f64);
    let fits = fit.tone_fits(&fit.advance(&state, &step), &found.system, factor)?;
    let asked = fits.iter().zip(&stated).enumerate();
    let asked = asked.filter_map(|(picture, (own, stated))| {
        let (gamma, std) = (own.curve.effective_gamma(), own.effective_gamma_std()?);
        let deviations = (gamma - stated.effective_gamma()).abs() / std;
        Some((deviations, picture, gamma, std))
    });
    let (deviations, picture, gamma, std) = asked.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let change = step.shared.rows(0, fit.free.len()).into_owned();
    let warning = Warning::ToneContradicted {
        picture,
        gamma,
        std,
        parameter: (*fit.free.names().first()?).into(),
        change: change[0],
    };
    (deviations > CONTRADICTED).then_some((warning, change))
}
