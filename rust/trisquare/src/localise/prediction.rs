//! What a side predicts of a pixel.

/// The edge itself: pixels within so many blurs of the curve tell the noise that matters.
const EDGE_BLURS: f64 = 2.0;

/// A pixel's residual and the derivatives of its modelled value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prediction {
    /// Observed less modelled.
    pub residual: f64,
    /// Light that falls on the pixel, modelled.
    pub light: f64,
    /// Whether the pixel is clipped and the model lies beyond it: it tells nothing, and residual and
    /// derivatives are zero.
    pub is_silent: bool,
    /// Distance from the curve in blurs.
    pub blurs: f64,
    /// With respect to the curve's `y`.
    pub by_height: f64,
    pub by_base: f64,
    pub by_contrast: f64,
    pub by_blur: f64,
    /// With respect to an offset of the edge along its normal.
    pub by_offset: f64,
}

impl Prediction {
    /// Whether the pixel tells the noise at the edge.
    #[inline]
    pub fn is_at_edge(&self) -> bool {
        self.blurs.abs() < EDGE_BLURS && !self.is_silent
    }
}
