//! What the pixels tell of how much blurs differ.

use super::blur_prior::{self, Told};
use super::exposure::{BLUR_DIFFERENCES, DIFFERENCES, EXPOSURE_PARAMETERS};
use super::fit::{PixelFit, PixelState, PixelSystem};
use crate::lens::Lens;
use crate::numeric::ArrowStep;
use crate::observations::POSE_PARAMETERS;

/// The step from a state once its equations know what each picture tells of its figures' differences,
/// which are those after the `free` step without; `None` where a figure leaves its exposure open.
pub(super) fn told_step<L: Lens>(
    fit: &PixelFit<'_>,
    state: &PixelState<L>,
    free: &ArrowStep,
    PixelSystem { system, spread, .. }: &mut PixelSystem,
) -> Option<ArrowStep> {
    let covariance_factor = spread.covariance_factor(fit.free.len() as f64);
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
    fit.step(system)
}
