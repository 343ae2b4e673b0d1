//! How much the blurs of a picture's edges differ, which its own edges tell.
//!
//! Free differences cost a fifth of the accuracy under a curved tone; where there are none, they
//! should be held, and where there are, no one blur stands for all. So they are normal about zero,
//! with a variance that all of a picture's figures tell together.

use super::exposure::{DIFFERENCES, Exposure, SIDES};
use crate::numeric::{Block, variance_about_zero};

/// Parts of the blur (standard deviation) by which it may differ before a picture has told more.
const WIDEST: f64 = 0.5;
/// Differences of this size move no edge by as much as its best samples' noise.
const LEAST: f64 = 1e-3;

/// Of the sides' own differences there is one variance, and one of those over the figure.
const KINDS: usize = 2;

/// What figures tell of their differences, by kind: the value, and the variance of its error.
#[derive(Default)]
pub(super) struct Told([Vec<(f64, f64)>; KINDS]);

impl Told {
    /// Adds one of a figure's differences.
    pub fn add(&mut self, difference: usize, value: f64, variance: f64) {
        self.0[kind(difference)].push((value, variance));
    }

    /// What this adds to that which is known beforehand.
    pub fn precisions(&self) -> [f64; KINDS] {
        std::array::from_fn(|kind| {
            let std = variance_about_zero(&self.0[kind]).sqrt();
            std.clamp(LEAST, WIDEST).powi(-2) - WIDEST.powi(-2)
        })
    }
}

fn kind(difference: usize) -> usize {
    usize::from(difference >= SIDES)
}

/// Adds what is known beforehand of differences to a block, among the parameters of which the
/// exposure begins there; returns the cost.
pub(super) fn add_wide(exposure: &Exposure, block: &mut Block, offset: usize) -> f64 {
    add(exposure, [WIDEST.powi(-2); KINDS], block, offset)
}

/// The same with differences of these precisions.
pub(super) fn add(
    exposure: &Exposure,
    precisions: [f64; KINDS],
    block: &mut Block,
    offset: usize,
) -> f64 {
    let mut cost = 0.0;
    for (k, difference) in exposure.differences.all().into_iter().enumerate() {
        let (own, precision) = (offset + DIFFERENCES + k, precisions[kind(k)]);
        block.hessian[(own, own)] += precision;
        block.gradient[own] += precision * difference;
        cost += 0.5 * precision * difference * difference;
    }
    cost
}
