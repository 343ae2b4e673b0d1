//! Predictions of a side for its pixels.

/// Distance from the curve, in blurs, within which pixels are at the edge and determine the noise.
const EDGE_BLURS: f64 = 2.0;

/// A pixel's residual and the derivatives of its modelled value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prediction {
    /// Observed minus modelled value.
    pub residual: f64,
    /// Modelled light on the pixel.
    pub light: f64,
    /// Whether the pixel is clipped and the modelled value is beyond the limit: such a pixel has no
    /// information, and its residual and derivatives are zero.
    pub is_silent: bool,
    /// Distance from the curve in blurs.
    pub blurs: f64,
    /// Derivative with respect to the curve's `y`.
    pub by_height: f64,
    pub by_base: f64,
    pub by_contrast: f64,
    pub by_blur: f64,
    /// Derivative with respect to an offset of the edge along its normal.
    pub by_offset: f64,
}

impl Prediction {
    /// Whether the pixel is one of those that determine the noise at the edge.
    #[inline]
    pub fn is_at_edge(&self) -> bool {
        self.blurs.abs() < EDGE_BLURS && !self.is_silent
    }
}
