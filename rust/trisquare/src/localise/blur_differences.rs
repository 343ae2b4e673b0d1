//! How much the blur differs along the sides of one picture, which all of them tell together.
//!
//! A blur that is free to change along its side costs a third of the accuracy under a curved tone;
//! where it does not change it should be held, and where it does, one blur must not stand for all. So
//! its changes are normal about zero, with a variance that the picture's sides tell.

use super::curve::COEFFICIENTS;
use super::equations::{BLUR, Normal, Step};
use super::measured::Measured;
use super::side::SideModel;
use super::side_sums::LIGHT;
use crate::numeric::variance_about_zero;

/// Changes of this part of the blur, as a standard deviation, move no sample by as much as a
/// hundredth of its noise.
const LEAST: f64 = 1e-3;

/// Moves the samples of all sides to where they are seen with changes of the blur as small as
/// usual in the picture.
pub(super) fn settle<'a>(measured: impl Iterator<Item = &'a mut Measured>) {
    // What curved light does to a crossed line it does to and fro, and so does a blur that changes.
    let mut sides: Vec<&mut Measured> = measured.filter(|own| !own.is_crossed).collect();
    let told = sides.iter().filter_map(|own| own.changes_of_blur());
    let told: Vec<[(f64, f64); LIGHT]> = told.collect();
    let mut precisions = [0.0; LIGHT];
    for (k, precision) in precisions.iter_mut().enumerate().skip(1) {
        let of_power: Vec<_> = told.iter().map(|changes| changes[k]).collect();
        *precision = variance_about_zero(&of_power).sqrt().max(LEAST).powi(-2);
    }
    for own in &mut sides {
        own.hold_blur(&precisions);
    }
}

impl Measured {
    /// The changes of the blur with the powers of `s`, in parts of the blur, and the variances of
    /// their errors; nothing where the side leaves them open.
    fn changes_of_blur(&self) -> Option<[(f64, f64); LIGHT]> {
        let variances = self.normal.cholesky()?.inverse().diagonal();
        let relative = 1.0 / self.side.mean_blur();
        Some(std::array::from_fn(|k| {
            let variance = variances[BLUR + k] * relative * relative;
            (self.side.blur[k] * relative, variance)
        }))
    }

    /// Moves the samples as the side moves where changes of its blur have these precisions.
    fn hold_blur(&mut self, precisions: &[f64; LIGHT]) {
        let Some(step) = held(&self.side, self.normal, precisions) else {
            return;
        };
        let heights = step.fixed_rows::<COEFFICIENTS>(0);
        for point in &mut self.edges.points {
            let (by_coefficients, normal) = self.side.curve.distances_at(*point);
            *point += normal * heights.dot(&by_coefficients);
        }
    }
}

/// The step of a fitted side's parameters that changes of its blur ask for if they are known
/// beforehand with such precisions, in parts of the blur.
fn held(side: &SideModel, mut normal: Normal, precisions: &[f64; LIGHT]) -> Option<Step> {
    let relative = 1.0 / side.mean_blur();
    let mut pull = Step::zeros();
    for (k, precision) in precisions.iter().enumerate() {
        let precision = precision * relative * relative;
        normal[(BLUR + k, BLUR + k)] += precision;
        pull[BLUR + k] = -precision * side.blur[k];
    }
    let step: Step = normal.cholesky()?.solve(&pull);
    step.iter().all(|value| value.is_finite()).then_some(step)
}
