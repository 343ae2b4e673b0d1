//! Extent of the plateaus beside an edge.

use super::prediction::Prediction;
use super::side::SideModel;

/// Number of standard deviations of a ring's mean above which it departs from its plateau ...
const RING_DEVIATIONS: f64 = 3.5;
/// ... and distance, in blurs, by which the disturbance begins before it is visible.
const GUARD_BLURS: f64 = 1.5;

/// Sum and number of the residuals of pixels at one distance from the edge.
#[derive(Debug, Clone, Copy, Default)]
struct Ring {
    sum: f64,
    count: f64,
}

impl Ring {
    fn is_clean(&self, noise: f64) -> bool {
        self.count > 0.0 && self.sum.abs() < RING_DEVIATIONS * noise * self.count.sqrt()
    }
}

/// Distance, from `near` to at most `far` pixels, up to which the pixels on either side follow the
/// model.
///
/// A thin frame's other edge, a paper's rim or uneven light show in the mean of a ring, one pixel
/// wide along the whole side, at smaller distances than in single pixels. Without this check the
/// other edge of a frame 8 pixels thick moved a side by 0.015 pixels.
pub(super) fn reach(
    side: &SideModel,
    predictions: &[Prediction],
    noise: f64,
    near: f64,
    far: [f64; 2],
) -> [f64; 2] {
    let mut rings = far.map(|far| vec![Ring::default(); (far - near).ceil().max(0.0) as usize]);
    // Clamped, so that a speck does not look like a disturbance of the whole ring.
    let limit = RING_DEVIATIONS * noise;
    for prediction in predictions {
        let distance = prediction.blurs * side.mean_blur();
        let beyond = distance.abs() - near;
        if beyond < 0.0 {
            continue;
        }
        if let Some(ring) = rings[usize::from(distance > 0.0)].get_mut(beyond as usize) {
            ring.sum += prediction.residual.clamp(-limit, limit);
            ring.count += 1.0;
        }
    }
    [0, 1].map(
        |i| match rings[i].iter().position(|ring| !ring.is_clean(noise)) {
            Some(first) => (near + first as f64 - GUARD_BLURS * side.mean_blur()).max(near),
            None => far[i],
        },
    )
}
