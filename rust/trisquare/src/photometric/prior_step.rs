//! Differences of blurs, and the common shift of all edges of a picture, as estimated from the
//! pixels.

use super::blur_prior::{self, BlurDifferences};
use super::exposure::{BLUR_DIFFERENCES, DIFFERENCES, EXPOSURE_PARAMETERS};
use super::fit::{PixelFit, PixelState, PixelSystem};
use crate::image::SHIFT;
use crate::lens::Lens;
use crate::numeric::{ArrowStep, ArrowSystem, variance_about_zero};
use crate::observations::POSE_PARAMETERS;

/// Minimum standard deviation (px) of the shift: less shifts an edge by less than the noise of its
/// best samples.
const MIN_SHIFT: f64 = 1e-4;

/// The step from a state with priors on the blurs' differences and the edges' shift, whose widths
/// are estimated per picture from the values after the `free` step, which is without them; `None`
/// if a figure does not determine its exposure.
pub(super) fn step_with_priors<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    found: &mut PixelSystem,
) -> Option<ArrowStep> {
    let covariance_factor = found.spread.covariance_factor(fit.free.len() as f64);
    add_blur_priors(fit, state, free, &mut found.system, covariance_factor)?;
    add_shift_priors(fit, state, free, &mut found.system, covariance_factor)?;
    fit.step(&found.system)
}

fn add_blur_priors<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    system: &mut ArrowSystem,
    covariance_factor: f64,
) -> Option<()> {
    let mut picture_differences: Vec<BlurDifferences> = state
        .pictures
        .iter()
        .map(|_| BlurDifferences::default())
        .collect();
    for (index, figure) in fit.figures.iter().enumerate() {
        let offset = fit.exposure_offset(state, index);
        // Marginal over the pose, which is correlated with them; other figures of the plane hardly
        // matter.
        let exposure = offset..offset + EXPOSURE_PARAMETERS;
        let columns: Vec<usize> = (0..POSE_PARAMETERS).chain(exposure).collect();
        let hessian = &system.blocks[figure.plane].hessian;
        let information = hessian.select_rows(&columns).select_columns(&columns);
        let covariance = information.cholesky()?.inverse() * covariance_factor;
        let first = columns.len() - BLUR_DIFFERENCES;
        let differences = state.exposures[index].differences.all();
        for (k, difference) in differences.into_iter().enumerate() {
            let value = difference + free.blocks[figure.plane][offset + DIFFERENCES + k];
            picture_differences[figure.image].add(k, value, covariance[(first + k, first + k)]);
        }
    }
    let precisions: Vec<_> = picture_differences
        .iter()
        .map(BlurDifferences::precisions)
        .collect();
    for (index, figure) in fit.figures.iter().enumerate() {
        let offset = fit.exposure_offset(state, index);
        let block = &mut system.blocks[figure.plane];
        let exposure = &state.exposures[index];
        blur_prior::add(exposure, precisions[figure.image], block, offset);
    }
    Some(())
}

/// Narrows the prior of a shift that the pixels do not show; otherwise it would widen every
/// interval without need. A curve of gamma 1.8 looks like a usual one of a picture that was made
/// smaller, and is rare. Nearly linear light was mostly blurred.
fn add_shift_priors<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    system: &mut ArrowSystem,
    covariance_factor: f64,
) -> Option<()> {
    let pictures = state.pictures.iter().enumerate().take(fit.free_pictures);
    let uncertain_shifts: Vec<_> = pictures
        .filter_map(|(image, picture)| Some((image, picture.shift, picture.unlikely_shift()?)))
        .collect();
    if uncertain_shifts.is_empty() {
        return Some(());
    }
    let covariance = system.reduced_information()?.cholesky()?.inverse() * covariance_factor;
    for (image, shift, widest) in uncertain_shifts {
        let column = fit.picture_offset(image) + SHIFT;
        let prior = widest.powi(-2);
        // Information of the pixels alone, without the prior.
        let posterior = 1.0 / covariance[(column, column)];
        let information = posterior - prior;
        if information <= 0.0 {
            continue;
        }
        let value = (shift + free.shared[column]) * posterior / information;
        let std = variance_about_zero(&[(value, 1.0 / information)]).sqrt();
        let precision = std.max(MIN_SHIFT).min(widest).powi(-2) - prior;
        system.prior[(column, column)] += precision;
        system.prior_gradient[column] += precision * shift;
    }
    Some(())
}
