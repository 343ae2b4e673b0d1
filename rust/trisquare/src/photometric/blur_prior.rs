//! Prior on the differences between the blurs of a picture's edges, estimated from those edges.
//!
//! Free differences cost a fifth of the accuracy under a curved tone. They should be fixed where
//! there are none, and free where there are, since a single blur does not fit then. They are
//! therefore normal about zero, with a variance estimated from all of a picture's figures together.

use super::exposure::{DIFFERENCES, Exposure, SIDES};
use crate::numeric::{Block, variance_about_zero};

/// Prior standard deviation of a difference, as a fraction of the blur, before any of the picture's
/// data.
const MAX_STD: f64 = 0.5;
/// Lower bound of the standard deviation: differences of this size shift an edge by less than the
/// noise of its best samples.
const MIN_STD: f64 = 1e-3;

/// Number of variances: one of the sides' own differences, one of the variation over the figure.
const KINDS: usize = 2;

/// Estimated differences of figures, by kind: the value, and the variance of its error.
#[derive(Default)]
pub(super) struct BlurDifferences([Vec<(f64, f64)>; KINDS]);

impl BlurDifferences {
    /// Adds one of a figure's differences.
    pub fn add(&mut self, difference: usize, value: f64, variance: f64) {
        self.0[kind(difference)].push((value, variance));
    }

    /// Precisions to be added to those of the prior.
    pub fn precisions(&self) -> [f64; KINDS] {
        std::array::from_fn(|kind| {
            let std = variance_about_zero(&self.0[kind]).sqrt();
            std.clamp(MIN_STD, MAX_STD).powi(-2) - MAX_STD.powi(-2)
        })
    }
}

fn kind(difference: usize) -> usize {
    usize::from(difference >= SIDES)
}

/// Adds the prior on the differences to a block, in which the exposure's parameters begin at
/// `offset`; returns the cost.
pub(super) fn add_wide(exposure: &Exposure, block: &mut Block, offset: usize) -> f64 {
    add(exposure, [MAX_STD.powi(-2); KINDS], block, offset)
}

/// `add_wide` with differences of these precisions.
pub(super) fn add(
    exposure: &Exposure,
    precisions: [f64; KINDS],
    block: &mut Block,
    offset: usize,
) -> f64 {
    let mut cost = 0.0;
    for (k, difference) in exposure.differences.all().into_iter().enumerate() {
        let (column, precision) = (offset + DIFFERENCES + k, precisions[kind(k)]);
        block.hessian[(column, column)] += precision;
        block.gradient[column] += precision * difference;
        cost += 0.5 * precision * difference * difference;
    }
    cost
}
