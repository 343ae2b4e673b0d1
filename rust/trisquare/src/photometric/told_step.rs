//! What the pixels tell of how much blurs differ, and of how far all edges of a picture are shifted.

use super::blur_prior::{self, Told};
use super::exposure::{BLUR_DIFFERENCES, DIFFERENCES, EXPOSURE_PARAMETERS};
use super::fit::{PixelFit, PixelState, PixelSystem};
use crate::image::SHIFT;
use crate::lens::Lens;
use crate::numeric::{ArrowStep, ArrowSystem, variance_about_zero};
use crate::observations::POSE_PARAMETERS;

/// A shift of this size (px) moves no edge by as much as its best samples' noise.
const MIN_SHIFT: f64 = 1e-4;

/// The step from a state once its equations know what each picture tells of its figures' differences
/// and its edges' shift, which are those after the `free` step without; `None` where a figure leaves
/// its exposure open.
pub(super) fn told_step<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    found: &mut PixelSystem,
) -> Option<ArrowStep> {
    let covariance_factor = found.spread.covariance_factor(fit.free.len() as f64);
    tell_blurs(fit, state, free, &mut found.system, covariance_factor)?;
    tell_shifts(fit, state, free, &mut found.system, covariance_factor)?;
    fit.step(&found.system)
}

fn tell_blurs<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    system: &mut ArrowSystem,
    covariance_factor: f64,
) -> Option<()> {
    let mut told: Vec<Told> = state.pictures.iter().map(|_| Told::default()).collect();
    for (index, figure) in fit.figures.iter().enumerate() {
        let offset = fit.exposure_offset(state, index);
        // The pose goes with them; on other figures of the plane they hardly depend.
        let exposure = offset..offset + EXPOSURE_PARAMETERS;
        let own: Vec<usize> = (0..POSE_PARAMETERS).chain(exposure).collect();
        let hessian = &system.blocks[figure.plane].hessian;
        let information = hessian.select_rows(&own).select_columns(&own);
        let covariance = information.cholesky()?.inverse() * covariance_factor;
        let first = own.len() - BLUR_DIFFERENCES;
        let differences = state.exposures[index].differences.all();
        for (k, difference) in differences.into_iter().enumerate() {
            let value = difference + free.blocks[figure.plane][offset + DIFFERENCES + k];
            told[figure.image].add(k, value, covariance[(first + k, first + k)]);
        }
    }
    let precisions: Vec<_> = told.iter().map(Told::precisions).collect();
    for (index, figure) in fit.figures.iter().enumerate() {
        let offset = fit.exposure_offset(state, index);
        let block = &mut system.blocks[figure.plane];
        let exposure = &state.exposures[index];
        blur_prior::add(exposure, precisions[figure.image], block, offset);
    }
    Some(())
}

/// A shift that a picture's own geometry does not show would widen every interval for nothing: a
/// curve of gamma 1.8 looks like a usual one that was made smaller, and seldom is one. Nearly linear
/// light mostly was blurred.
fn tell_shifts<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    system: &mut ArrowSystem,
    covariance_factor: f64,
) -> Option<()> {
    let pictures = state.pictures.iter().enumerate().take(fit.free_pictures);
    let unsure: Vec<_> = pictures
        .filter_map(|(image, picture)| Some((image, picture.shift, picture.unlikely_shift()?)))
        .collect();
    if unsure.is_empty() {
        return Some(());
    }
    let covariance = system.reduced_information()?.cholesky()?.inverse() * covariance_factor;
    for (image, shift, widest) in unsure {
        let own = fit.picture_offset(image) + SHIFT;
        let prior = widest.powi(-2);
        // What the pixels tell alone, without what was known beforehand.
        let posterior = 1.0 / covariance[(own, own)];
        let told = posterior - prior;
        if told <= 0.0 {
            continue;
        }
        let value = (shift + free.shared[own]) * posterior / told;
        let std = variance_about_zero(&[(value, 1.0 / told)]).sqrt();
        let precision = std.max(MIN_SHIFT).min(widest).powi(-2) - prior;
        system.prior[(own, own)] += precision;
        system.prior_gradient[own] += precision * shift;
    }
    Some(())
}
