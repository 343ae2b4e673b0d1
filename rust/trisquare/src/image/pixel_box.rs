//! What a square pixel does to a blur.

use nalgebra::Vector2;

/// Fourth cumulant, over 24 and the blur's fourth power, of the blur across a side of the given
/// direction: a square pixel's box is not normal, and stands for all that is not.
///
/// A box of width `a` has `-a^4 / 120`; along a normal `n` the square pixel is two of them, of
/// widths `n_x` and `n_y`. A normal blur of half a pixel's width alone leaves residuals of a
/// quarter of a grey level, which an unknown tone curve takes for its own.
pub(crate) fn box_kurtosis(direction: &Vector2<f64>, blur: f64) -> f64 {
    let fourth = direction.x.powi(4) + direction.y.powi(4);
    -fourth / (120.0 * 24.0 * blur.powi(4))
}
