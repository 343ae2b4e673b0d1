//! What the first fit finds of a side.

use super::band::Pixel;
use super::curve::ChordCurve;
use super::flip::EdgeShape;
use super::prediction::Prediction;
use super::side::SideModel;
use super::span::NoEdge;
use super::thinning::some_of;

/// A side found by the first fit, and the noise about it.
pub(super) struct Preview {
    pub side: SideModel,
    pub noise: f64,
    /// How far the plateaus on either side are clean, pixels.
    pub reach: [f64; 2],
    /// Ranges along the side where something else lies over it.
    pub hidden: Vec<[f64; 2]>,
    /// The pixels within reach, which tell the tone curve and the picture's faults.
    pub pixels: Vec<Pixel>,
    /// What the side as it was found predicts of them.
    pub predictions: Vec<Prediction>,
}

/// The curve and the shape of a line, if it was found.
pub(super) fn found(
    previews: &[Result<Preview, NoEdge>],
    line: usize,
) -> Option<(&ChordCurve, EdgeShape)> {
    let Preview { side, .. } = previews.get(line)?.as_ref().ok()?;
    Some((&side.curve, side.edge_shape()))
}

impl Preview {
    /// Leaves one in so many pixels.
    pub fn thin(&mut self, stride: usize) {
        if stride > 1 {
            self.pixels = some_of(self.pixels.iter().copied(), stride).collect();
            self.predictions = some_of(self.predictions.iter().copied(), stride).collect();
        }
    }
}
