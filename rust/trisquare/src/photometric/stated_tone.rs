//! Whether the pixels contradict the tone curves that were stated.

use nalgebra::DVector;

use super::fit::{PixelFit, PixelState};
use crate::image::{PictureState, PictureTone};
use crate::lens::Lens;

/// Standard deviations of the effective gamma from which the pixels contradict a stated curve: JPEG
/// moves it by up to six.
const CONTRADICTED: f64 = 7.0;

/// A stated tone curve that the pixels contradict.
pub(super) struct ContradictedTone {
    /// The picture that contradicts its own the most.
    pub picture: usize,
    /// The effective gamma that its pixels show, and its standard deviation.
    pub gamma: f64,
    pub std: f64,
    /// By how much the free parameters change, to first order, where the curves are estimated.
    pub change: DVector<f64>,
}

/// Frees the tone curves at the optimum of stated ones: one step of the fit tells what the pixels
/// ask for. `None` where they ask for nothing else.
pub(super) fn contradicted_tone<L: Lens>(
    fit: &PixelFit<'_>,
    optimum: &PixelState<L>,
) -> Option<ContradictedTone> {
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
    let (deviations, picture, gamma, gamma_std) = asked.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (deviations > CONTRADICTED).then(|| ContradictedTone {
        picture,
        gamma,
        std: gamma_std,
        change: step.shared.rows(0, fit.free.len()).into_owned(),
    })
}
