//! Where the plateaus beside an edge stop being plateaus.

use super::prediction::Prediction;
use super::side::SideModel;

/// A ring of pixels departs from its plateau if its mean does by so many of its deviations ...
const RING_DEVIATIONS: f64 = 3.5;
/// ... and what disturbs it began this many blurs before it could be seen.
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

/// How far, from `near` to at most `far` pixels, the pixels on either side follow the model.
///
/// A thin frame's other edge, a paper's rim or uneven light show in the mean of a ring, one pixel
/// wide along the whole side, long before they show in a pixel: without this the other edge of a
/// frame 8 pixels thick moved a side by 0.015 pixels.
pub(super) fn reach(
    side: &SideModel,
    predictions: &[Prediction],
    noise: f64,
    near: f64,
    far: [f64; 2],
) -> [f64; 2] {
    let mut rings = far.map(|far| vec![Ring::default(); (far - near).ceil().max(0.0) as usize]);
    // Cut off, so that a speck does not pass for a disturbance of the whole ring.
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
