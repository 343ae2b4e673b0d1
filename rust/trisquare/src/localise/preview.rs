//! The result of the first fit of a side.

use super::band::Pixel;
use super::curve::ChordCurve;
use super::flip::EdgeShape;
use super::prediction::Prediction;
use super::side::SideModel;
use super::span::NoEdge;
use super::thinning::subset;

/// A side found by the first fit, and the noise about it.
pub(super) struct Preview {
    pub side: SideModel,
    pub noise: f64,
    /// Distance up to which the plateau on either side is undisturbed, pixels.
    pub reach: [f64; 2],
    /// Ranges along the side where another object covers it.
    pub hidden: Vec<[f64; 2]>,
    /// The pixels within reach, for estimating the tone curve and the picture's faults.
    pub pixels: Vec<Pixel>,
    /// The side's predictions for them.
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
    /// Keeps one in `stride` pixels.
    pub fn thin(&mut self, stride: usize) {
        if stride > 1 {
            self.pixels = subset(self.pixels.iter().copied(), stride).collect();
            self.predictions = subset(self.predictions.iter().copied(), stride).collect();
        }
    }
}
