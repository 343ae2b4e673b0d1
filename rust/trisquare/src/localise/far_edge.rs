//! The far edge of a thin bar, at which the light changes back.

use nalgebra::Vector2;

use super::band::SearchLimit;
use super::curve::Curve;
use super::flip::{COMPLETE, Flip};
use super::preview::Preview;
use super::side::Side;
use super::span::{EdgeSpan, NoEdge};
use super::surroundings::NEAR_BLURS;
use crate::numeric::{cdf, median};

/// Bars narrower than so many blurs are not measured: of one of 3.8 an edge was 0.05 pixels off; those of
/// one of 2.5 were seen 0.4 blurs too far apart, with less blur and contrast than they have.
const LEAST_WIDTH_BLURS: f64 = 4.5;
/// Beyond so many blurs of a side its far edge need not be modelled: its own blur ends before the
/// other begins.
const FELT_BLURS: f64 = NEAR_BLURS + COMPLETE;

/// An edge beside a side, with the light before the side beyond it.
#[derive(Clone, Copy)]
pub(super) struct FarEdge<'a> {
    curve: &'a Curve,
    /// Pixels.
    blur: f64,
    /// +1 if distances from the curve are positive where the side is, else -1.
    sign: f64,
    /// +1 if it lies on the positive side of the side's own curve, else -1.
    place: f64,
    /// Whether it is so near that the side is blurred by it.
    pub is_felt: bool,
}

impl<'a> FarEdge<'a> {
    pub fn beside(side: &Side, curve: &'a Curve, blur: f64) -> Self {
        let middle = |curve: &Curve| curve.point(0.0, 0.0);
        Self {
            curve,
            blur,
            sign: curve.signed_distance(middle(&side.curve)).signum(),
            place: side.curve.signed_distance(middle(curve)).signum(),
            is_felt: width(&side.curve, curve) < FELT_BLURS * blur,
        }
    }

    /// Pixels beyond the edge are not the side's, nor those that it blurs where it is not modelled.
    pub fn limit(&self) -> SearchLimit<'a> {
        SearchLimit {
            curve: self.curve,
            side: self.sign,
            clearance: if self.is_felt {
                0.0
            } else {
                COMPLETE * self.blur
            },
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

/// Refuses the edges of bars that are too thin for the blur that the picture's edges have.
pub(super) fn refuse_thin_bars(spans: &[EdgeSpan], previews: &mut [Result<Preview, NoEdge>]) {
    let found = previews.iter().flatten();
    let Some(blur) = median(found.map(|own| own.side.mean_blur()).collect()) else {
        return;
    };
    let least = LEAST_WIDTH_BLURS * blur;
    let is_thin = |(index, span): &(usize, &EdgeSpan)| {
        let curve = |index: usize| Some(&previews.get(index)?.as_ref().ok()?.side.curve);
        match (curve(*index), span.far_edge.and_then(curve)) {
            (Some(own), Some(other)) => width(own, other) < least,
            _ => span.far_edge.is_some(),
        }
    };
    let thin: Vec<usize> = spans
        .iter()
        .enumerate()
        .filter(is_thin)
        .map(|(index, _)| index)
        .collect();
    for index in thin {
        previews[index] = Err(NoEdge::Cramped);
    }
}

/// The least distance of a curve from another at its ends and in its middle, pixels.
fn width(curve: &Curve, other: &Curve) -> f64 {
    let at = |s: f64| other.signed_distance(curve.point(s, 0.0)).abs();
    at(-1.0).min(at(0.0)).min(at(1.0))
}
