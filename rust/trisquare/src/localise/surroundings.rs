//! How far to all sides the pixels about an edge are its own.

use super::band::{Band, SearchLimit};
use super::far_edge::{FarEdge, width};
use super::flip::COMPLETE;
use super::grid_crossings::GridCrossings;
use super::lines_beside;
use super::preview::Preview;
use super::side::SideModel;
use super::span::{EdgeSpan, NoEdge};
use crate::numeric::median;

/// How far from the curve pixels hold an edge: so many blurs, and at least so many pixels.
const NEAR_BLURS: f64 = 3.5;
const MIN_NEAR: f64 = 3.0;
/// How far the plateaus beside it are read, at most: so many times further, but only a share of the
/// length, because small targets stand close together.
pub(super) const FAR_RATIO: f64 = 2.5;
const FAR_SHARE: f64 = 0.25;
/// Of the distance between neighbouring grid lines a line has this much to either side.
const SPACING_SHARE: f64 = 0.5;
/// Before the neighbours are known, pixels this near to the path's ends are left out, in pixels or
/// as a share of the length, whichever is less.
const END_MARGIN: f64 = 6.0;
const END_MARGIN_SHARE: f64 = 0.2;
/// Once they are known, the band runs this far beyond the path's ends, to meet them.
const EXTENSION: f64 = 6.0;
/// Distance from a neighbour's curve, in its blurs, from which pixels are used. Measured on the
/// corner of a square: the last patch is then off by 0.05 of its standard deviation at a noise of
/// 2 in 255; at 2 blurs it is 0.2, and at 3 the side loses half a blur more at each end.
const BOUND_CLEARANCE: f64 = 2.5;

/// Bars narrower than so many blurs are not measured: of one of 3.8 an edge was 0.05 pixels off; those of
/// one of 2.5 were seen 0.4 blurs too far apart, with less blur and contrast than they have.
const MIN_WIDTH_BLURS: f64 = 4.5;

/// How far from a side's curve its edge is felt, pixels.
pub(super) fn near(side: &SideModel) -> f64 {
    MIN_NEAR.max(NEAR_BLURS * side.mean_blur())
}

/// The same, no farther than the wider margin.
pub(super) fn near_within(side: &SideModel, margin: [f64; 2]) -> f64 {
    near(side).min(margin[0].max(margin[1]))
}

/// How far to either side of an edge its surroundings are its own, pixels.
pub(super) fn margin(spans: &[EdgeSpan], index: usize, side: &SideModel) -> [f64; 2] {
    let span = &spans[index];
    if span.crossings.is_empty() {
        return span.margin;
    }
    let spacing = lines_beside::spacing(spans, index, side.curve.along);
    span.margin
        .map(|margin| margin.min(SPACING_SHARE * spacing))
}

/// The same for plateaus, where nothing crosses the edge and its length has to tell what is not
/// known.
pub(super) fn far_margin(side: &SideModel, is_crossed: bool) -> f64 {
    match is_crossed {
        true => f64::INFINITY,
        false => FAR_SHARE * side.curve.length(),
    }
}

/// The end, along the chord, of what surely is edge while the corners are not known.
pub(super) fn inner_end(side: &SideModel) -> f64 {
    side.curve.half_length - END_MARGIN.min(END_MARGIN_SHARE * side.curve.length())
}

/// All pixels of a span that was found, once those that it meets are known.
pub(super) fn whole_band<'a>(
    spans: &[EdgeSpan],
    index: usize,
    previews: &'a [Result<Preview, NoEdge>],
    own: &'a Preview,
    crossings: Option<&'a GridCrossings>,
) -> Result<Band<'a>, NoEdge> {
    let (span, side) = (&spans[index], &own.side);
    let other = span.far_edge.map(|other| previews[other].as_ref());
    let other = other.transpose().map_err(|&reason| reason)?;
    let far_edge = other.map(|Preview { side: other, .. }| {
        FarEdge::beside(
            (&side.curve, side.contrast[0]),
            (&other.curve, other.contrast[0]),
            other.mean_blur(),
        )
    });
    let (ends, mut limits) = match crossings {
        Some(_) => ([-1.0, 1.0].map(|s| s * side.curve.half_length), Vec::new()),
        None => limits(span, side, previews),
    };
    limits.extend(far_edge.iter().map(limit_at));
    let margin = margin(spans, index, side);
    let near = near_within(side, margin);
    Ok(Band {
        curve: side.curve.clone(),
        near,
        reach: [0, 1].map(|i| own.reach[i].max(near).min(margin[i])),
        ends,
        limits,
        hidden: &own.hidden,
        crossings,
        far_edge: far_edge.filter(|far_edge| far_edge.is_felt),
        stride: 1,
    })
}

/// How far along its chord a span's pixels are used, and the neighbours they keep clear of.
fn limits<'a>(
    span: &EdgeSpan,
    side: &SideModel,
    previews: &'a [Result<Preview, NoEdge>],
) -> ([f64; 2], Vec<SearchLimit<'a>>) {
    let middle = side.curve.point(0.0, 0.0);
    let mut ends = [-inner_end(side), inner_end(side)];
    let mut limits = Vec::with_capacity(2);
    for (end, bound) in ends.iter_mut().zip(span.bounds) {
        if let Some(Ok(neighbour)) = bound.and_then(|bound| previews.get(bound)) {
            let curve = &neighbour.side.curve;
            let distance = curve.signed_distance(middle);
            let clearance = BOUND_CLEARANCE * neighbour.side.mean_blur();
            // A neighbour that runs along this span, or is it, bounds nothing.
            if distance.abs() > clearance {
                let side_of_curve = distance.signum();
                *end = (side.curve.half_length + EXTENSION).copysign(*end);
                limits.push(SearchLimit {
                    curve,
                    side: side_of_curve,
                    clearance,
                });
            }
        }
    }
    (ends, limits)
}

/// Beyond the far edge of a thin bar nothing is used, nor what it blurs where it is not modelled.
pub(super) fn limit_at<'a>(far_edge: &FarEdge<'a>) -> SearchLimit<'a> {
    SearchLimit {
        curve: far_edge.curve,
        side: far_edge.sign,
        clearance: match far_edge.is_felt {
            true => 0.0,
            false => COMPLETE * far_edge.blur,
        },
    }
}

/// Refuses the edges of bars that are too thin for the blur that the picture's edges have.
pub(super) fn refuse_thin_bars(spans: &[EdgeSpan], previews: &mut [Result<Preview, NoEdge>]) {
    if spans.iter().all(|span| span.far_edge.is_none()) {
        return;
    }
    let found = previews.iter().flatten();
    let Some(blur) = median(found.map(|own| own.side.mean_blur()).collect()) else {
        return;
    };
    let curve = |index: usize| Some(&previews.get(index)?.as_ref().ok()?.side.curve);
    let is_thin = |index: &usize| {
        spans[*index].far_edge.is_some_and(|other| {
            let width = curve(*index)
                .zip(curve(other))
                .map(|(own, other)| width(own, other));
            width.is_none_or(|width| width < MIN_WIDTH_BLURS * blur)
        })
    };
    let thin: Vec<usize> = (0..spans.len()).filter(is_thin).collect();
    for index in thin {
        previews[index] = Err(NoEdge::Cramped);
    }
}
