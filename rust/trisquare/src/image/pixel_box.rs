//! The effect of a square pixel on a blur.

use nalgebra::Vector2;

/// Fourth cumulant of the blur across a side of the given direction, divided by 24 and by the
/// fourth power of the blur. Only the square pixel's box is taken as not normal.
///
/// A box of width `a` has `-a^4 / 120`; along a normal `n` the square pixel is the convolution of
/// two boxes, of widths `n_x` and `n_y`. A purely normal model of a blur of half a pixel's width
/// leaves residuals of a quarter of a grey level, which the estimate of an unknown tone curve would
/// absorb.
pub(crate) fn box_kurtosis(direction: &Vector2<f64>, blur: f64) -> f64 {
    let fourth = direction.x.powi(4) + direction.y.powi(4);
    -fourth / (120.0 * 24.0 * blur.powi(4))
}
