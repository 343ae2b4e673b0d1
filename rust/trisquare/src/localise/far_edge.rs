//! The far edge of a thin bar, where the light changes back.

use nalgebra::Vector2;

use super::curve::ChordCurve;
use super::flip::{COMPLETE_BLURS, Flip};
use crate::numeric::cdf;

/// Distance, in blurs, beyond which the far edge of a side need not be modelled: the side's pixels
/// are within 3.5, and the other edge has an effect within 4.
const MODELLED_BLURS: f64 = 3.5 + COMPLETE_BLURS;

/// The edge on the other side of a thin bar.
#[derive(Clone, Copy)]
pub(super) struct FarEdge<'a> {
    pub curve: &'a ChordCurve,
    /// Standard deviation of its blur, pixels.
    pub blur: f64,
    /// +1 if distances from the curve are positive on the side's side, else -1.
    pub sign: f64,
    /// Change of the light beyond it, over the side's own contrast: -1 or 1 if the light is the
    /// same there as before the bar.
    relative_contrast: f64,
    /// Whether it is near enough to affect the side's profile.
    pub is_modelled: bool,
}

impl<'a> FarEdge<'a> {
    /// The edge with the given curve and contrast, beside a side with its own.
    pub fn new(
        (side, contrast): (&ChordCurve, f64),
        (curve, far_contrast): (&'a ChordCurve, f64),
        blur: f64,
    ) -> Self {
        let sign = curve.signed_distance(side.point(0.0, 0.0)).signum();
        Self {
            curve,
            blur,
            sign,
            relative_contrast: -sign * far_contrast / contrast,
            is_modelled: bar_width(side, curve) < MODELLED_BLURS * blur,
        }
    }

    /// The change of the side's step by this edge at a point.
    pub fn flip(&self, place: Vector2<f64>) -> Flip {
        let beyond = -self.sign * self.curve.signed_distance(place) / self.blur;
        Flip {
            slope: 1.0,
            shift: 2.0 * self.relative_contrast * cdf(beyond),
        }
    }
}

/// The smallest distance of a curve from another, at its ends and in its middle, pixels.
pub(super) fn bar_width(curve: &ChordCurve, far_curve: &ChordCurve) -> f64 {
    let distance_at = |s: f64| far_curve.signed_distance(curve.point(s, 0.0)).abs();
    distance_at(-1.0)
        .min(distance_at(0.0))
        .min(distance_at(1.0))
}
