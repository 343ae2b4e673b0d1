//! The far edge of a thin bar, at which the light changes back.

use nalgebra::Vector2;

use super::curve::Curve;
use super::flip::{COMPLETE, Flip};
use crate::numeric::cdf;

/// Beyond so many blurs of a side its far edge need not be modelled: the side is felt within 3.5, and
/// the other one within 4 of its own.
const FELT_BLURS: f64 = 3.5 + COMPLETE;

/// An edge beside a side, with the light before the side beyond it.
#[derive(Clone, Copy)]
pub(super) struct FarEdge<'a> {
    pub curve: &'a Curve,
    /// Pixels.
    pub blur: f64,
    /// +1 if distances from the curve are positive where the side is, else -1.
    pub sign: f64,
    /// +1 if it lies on the positive side of the side's own curve, else -1.
    place: f64,
    /// Whether it is so near that the side is blurred by it.
    pub is_felt: bool,
}

impl<'a> FarEdge<'a> {
    /// Beside a side of this curve, with a curve and a blur of its own.
    pub fn beside(side: &Curve, curve: &'a Curve, blur: f64) -> Self {
        let middle = |curve: &Curve| curve.point(0.0, 0.0);
        Self {
            curve,
            blur,
            sign: curve.signed_distance(middle(side)).signum(),
            place: side.signed_distance(middle(curve)).signum(),
            is_felt: width(side, curve) < FELT_BLURS * blur,
        }
    }

    /// What the edge makes of the side's step at a place.
    pub fn flip(&self, place: Vector2<f64>) -> Flip {
        let beyond = -self.sign * self.curve.signed_distance(place) / self.blur;
        Flip {
            slope: 1.0,
            shift: -2.0 * self.place * cdf(beyond),
        }
    }
}

/// The least distance of a curve from another at its ends and in its middle, pixels.
pub(super) fn width(curve: &Curve, other: &Curve) -> f64 {
    let at = |s: f64| other.signed_distance(curve.point(s, 0.0)).abs();
    at(-1.0).min(at(0.0)).min(at(1.0))
}
