//! Estimate of how much the blur changes along the sides of a picture, from all sides together.
//!
//! A blur that is free to change along its side costs a third of the accuracy under a curved tone.
//! Where it does not change it should be held, and where it does, one blur must not be used for all
//! of the side. So its changes have a normal prior about zero, with a variance estimated from the
//! picture's sides.

use super::curve::COEFFICIENTS;
use super::equations::{BLUR, Normal, Step};
use super::measured::Measured;
use super::side::SideModel;
use super::side_sums::LIGHT;
use crate::numeric::variance_about_zero;

/// Smallest standard deviation of the changes, as a fraction of the blur. Changes of this size move
/// no sample by as much as a hundredth of its noise.
const MIN_CHANGE_STD: f64 = 1e-3;

/// Moves the samples of all sides to their positions under changes of the blur as small as usual in
/// the picture.
pub(super) fn reduce_blur_changes<'a>(measured: impl Iterator<Item = &'a mut Measured>) {
    // On a crossed line the effect of a curved tone changes sign at every crossing, and so does
    // that of a changing blur.
    let mut sides: Vec<&mut Measured> = measured.filter(|side| !side.is_crossed).collect();
    let changes = sides.iter().filter_map(|side| side.blur_changes());
    let changes: Vec<[(f64, f64); LIGHT]> = changes.collect();
    let mut precisions = [0.0; LIGHT];
    for (k, precision) in precisions.iter_mut().enumerate().skip(1) {
        let power_changes: Vec<_> = changes.iter().map(|change| change[k]).collect();
        *precision = variance_about_zero(&power_changes)
            .sqrt()
            .max(MIN_CHANGE_STD)
            .powi(-2);
    }
    for side in &mut sides {
        side.hold_blur(&precisions);
    }
}

impl Measured {
    /// The coefficients of the blur's changes with the powers of `s`, as fractions of the blur, and
    /// their error variances; `None` if the side does not determine them.
    fn blur_changes(&self) -> Option<[(f64, f64); LIGHT]> {
        let variances = self.normal.cholesky()?.inverse().diagonal();
        let relative = 1.0 / self.side.mean_blur();
        Some(std::array::from_fn(|k| {
            let variance = variances[BLUR + k] * relative * relative;
            (self.side.blur[k] * relative, variance)
        }))
    }

    /// Moves the samples by the change of the side if the changes of its blur have these
    /// precisions.
    fn hold_blur(&mut self, precisions: &[f64; LIGHT]) {
        let Some(step) = blur_step(&self.side, self.normal, precisions) else {
            return;
        };
        let heights = step.fixed_rows::<COEFFICIENTS>(0);
        for point in &mut self.edges.points {
            let (by_coefficients, normal) = self.side.curve.displacement_derivatives(*point);
            *point += normal * heights.dot(&by_coefficients);
        }
    }
}

/// The step of a fitted side's parameters for a prior with the given precisions on the changes of
/// its blur, as fractions of the blur.
fn blur_step(side: &SideModel, mut normal: Normal, precisions: &[f64; LIGHT]) -> Option<Step> {
    let relative = 1.0 / side.mean_blur();
    let mut right = Step::zeros();
    for (k, precision) in precisions.iter().enumerate() {
        let precision = precision * relative * relative;
        normal[(BLUR + k, BLUR + k)] += precision;
        right[BLUR + k] = -precision * side.blur[k];
    }
    let step: Step = normal.cholesky()?.solve(&right);
    step.iter().all(|value| value.is_finite()).then_some(step)
}
