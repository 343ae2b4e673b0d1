//! The far edge of a thin bar, at which the light changes again.

use nalgebra::Vector2;

use super::curve::ChordCurve;
use super::flip::{COMPLETE, Flip};
use crate::numeric::cdf;

/// Beyond so many blurs of a side its far edge need not be modelled: the side is felt within 3.5, and
/// the other one within 4 of its own.
const FELT_BLURS: f64 = 3.5 + COMPLETE;

/// An edge beside a side.
#[derive(Clone, Copy)]
pub(super) struct FarEdge<'a> {
    pub curve: &'a ChordCurve,
    /// Pixels.
    pub blur: f64,
    /// +1 if distances from the curve are positive where the side is, else -1.
    pub sign: f64,
    /// What the light rises by beyond it, over the side's own contrast: -1 or 1 where it is again as
    /// before the bar.
    rise: f64,
    /// Whether it is so near that the side is blurred by it.
    pub is_felt: bool,
}

impl<'a> FarEdge<'a> {
    /// Of a curve and a contrast, beside a side with its own.
    pub fn beside(
        (side, contrast): (&ChordCurve, f64),
        (curve, own_contrast): (&'a ChordCurve, f64),
        blur: f64,
    ) -> Self {
        let sign = curve.signed_distance(side.point(0.0, 0.0)).signum();
        Self {
            curve,
            blur,
            sign,
            rise: -sign * own_contrast / contrast,
            is_felt: width(side, curve) < FELT_BLURS * blur,
        }
    }

    /// What the edge makes of the side's step at a place.
    pub fn flip(&self, place: Vector2<f64>) -> Flip {
        let beyond = -self.sign * self.curve.signed_distance(place) / self.blur;
        Flip {
            slope: 1.0,
            shift: 2.0 * self.rise * cdf(beyond),
        }
    }
}

/// The least distance of a curve from another at its ends and in its middle, pixels.
pub(super) fn width(curve: &ChordCurve, other: &ChordCurve) -> f64 {
    let at = |s: f64| other.signed_distance(curve.point(s, 0.0)).abs();
    at(-1.0).min(at(0.0)).min(at(1.0))
}
