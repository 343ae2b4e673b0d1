//! Extent of the surroundings of an edge that belong to it.

use super::band::{Band, SearchLimit};
use super::far_edge::{FarEdge, bar_width};
use super::flip::COMPLETE_BLURS;
use super::grid_crossings::GridCrossings;
use super::lines_beside;
use super::preview::Preview;
use super::side::SideModel;
use super::span::{EdgeSpan, NoEdge};
use crate::numeric::median;

/// Distance from the curve within which pixels show the edge: in blurs, and its minimum in pixels.
const NEAR_BLURS: f64 = 3.5;
const MIN_NEAR: f64 = 3.0;
/// Maximum distance of the plateaus, as a multiple of that one; but at most a fraction of the
/// length, because small targets stand close together.
pub(super) const FAR_RATIO: f64 = 2.5;
const FAR_SHARE: f64 = 0.25;
/// Fraction of the distance between neighbouring grid lines that belongs to a line on either side.
const SPACING_SHARE: f64 = 0.5;
/// Distance from the path's ends within which pixels are not used before the neighbours are known:
/// in pixels or as a fraction of the length, whichever is less.
const END_MARGIN: f64 = 6.0;
const END_MARGIN_SHARE: f64 = 0.2;
/// Distance by which the band extends beyond the path's ends, to meet the neighbours, once they are
/// known, pixels.
const EXTENSION: f64 = 6.0;
/// Distance from a neighbour's curve, in its blurs, beyond which pixels are used. Measured at the
/// corner of a square: the last patch then has an error of 0.05 of its standard deviation at a
/// noise of 2 in 255; with 2 blurs it is 0.2, and with 3 the side loses half a blur more at each
/// end.
const BOUND_CLEARANCE: f64 = 2.5;

/// Width of a bar, in blurs, below which it is not measured: an edge of one of 3.8 was displaced by
/// 0.05 pixels; those of one of 2.5 were found 0.4 blurs too far apart, with too little blur and
/// contrast.
const MIN_WIDTH_BLURS: f64 = 4.5;

/// Distance from a side's curve within which pixels show its edge, pixels: where ink has spread,
/// the edges of a crossed line lie beside the curve.
pub(super) fn near(side: &SideModel) -> f64 {
    MIN_NEAR.max(NEAR_BLURS * side.mean_blur()) + side.spread.unwrap_or(0.0).abs()
}

/// Same, limited to the wider margin.
pub(super) fn near_within(side: &SideModel, margin: [f64; 2]) -> f64 {
    near(side).min(margin[0].max(margin[1]))
}

/// Distance to either side of an edge within which its surroundings belong to it, pixels.
pub(super) fn margin(spans: &[EdgeSpan], index: usize, side: &SideModel) -> [f64; 2] {
    let span = &spans[index];
    if span.crossings.is_empty() {
        return span.margin;
    }
    let spacing = lines_beside::spacing(spans, index, side.curve.along);
    span.margin
        .map(|margin| margin.min(SPACING_SHARE * spacing))
}

/// Limit of the plateaus by the side's length, pixels, as its surroundings may be unknown; infinite
/// for a crossed line.
pub(super) fn far_margin(side: &SideModel, is_crossed: bool) -> f64 {
    match is_crossed {
        true => f64::INFINITY,
        false => FAR_SHARE * side.curve.length(),
    }
}

/// End, along the chord, of the part that certainly is edge while the corners are unknown.
pub(super) fn inner_end(side: &SideModel) -> f64 {
    side.curve.half_length - END_MARGIN.min(END_MARGIN_SHARE * side.curve.length())
}

/// The band of all pixels of a span that was found, once the spans that it meets are known.
pub(super) fn whole_band<'a>(
    spans: &[EdgeSpan],
    index: usize,
    previews: &'a [Result<Preview, NoEdge>],
    preview: &'a Preview,
    crossings: Option<&'a GridCrossings>,
) -> Result<Band<'a>, NoEdge> {
    let (span, side) = (&spans[index], &preview.side);
    let far_preview = span.far_edge.map(|index| previews[index].as_ref());
    let far_preview = far_preview.transpose().map_err(|&reason| reason)?;
    let far_edge = far_preview.map(|Preview { side: far_side, .. }| {
        FarEdge::new(
            (&side.curve, side.contrast[0]),
            (&far_side.curve, far_side.contrast[0]),
            far_side.mean_blur(),
        )
    });
    let (ends, mut limits) = match crossings {
        Some(_) => ([-1.0, 1.0].map(|s| s * side.curve.half_length), Vec::new()),
        None => limits(span, side, previews),
    };
    limits.extend(far_edge.iter().map(far_edge_limit));
    let margin = margin(spans, index, side);
    let near = near_within(side, margin);
    Ok(Band {
        curve: side.curve.clone(),
        near,
        reach: [0, 1].map(|i| preview.reach[i].max(near).min(margin[i])),
        ends,
        limits,
        hidden: &preview.hidden,
        crossings,
        far_edge: far_edge.filter(|far_edge| far_edge.is_modelled),
        stride: 1,
    })
}

/// The range along its chord in which a span's pixels are used, and the neighbours from which they
/// keep clear.
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
            // A neighbour that runs along this span, or is the span itself, is no bound.
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

/// The limit at the far edge of a thin bar: pixels beyond it are not used, nor those that it blurs
/// if it is not modelled.
pub(super) fn far_edge_limit<'a>(far_edge: &FarEdge<'a>) -> SearchLimit<'a> {
    SearchLimit {
        curve: far_edge.curve,
        side: far_edge.sign,
        clearance: match far_edge.is_modelled {
            true => 0.0,
            false => COMPLETE_BLURS * far_edge.blur,
        },
    }
}

/// Rejects the edges of bars that are too thin for the median blur of the picture's edges.
pub(super) fn reject_thin_bars(spans: &[EdgeSpan], previews: &mut [Result<Preview, NoEdge>]) {
    if spans.iter().all(|span| span.far_edge.is_none()) {
        return;
    }
    let found = previews.iter().flatten();
    let Some(blur) = median(found.map(|preview| preview.side.mean_blur()).collect()) else {
        return;
    };
    let curve = |index: usize| Some(&previews.get(index)?.as_ref().ok()?.side.curve);
    let is_thin = |index: &usize| {
        spans[*index].far_edge.is_some_and(|far_edge| {
            let width = curve(*index)
                .zip(curve(far_edge))
                .map(|(near_curve, far_curve)| bar_width(near_curve, far_curve));
            width.is_none_or(|width| width < MIN_WIDTH_BLURS * blur)
        })
    };
    let thin: Vec<usize> = (0..spans.len()).filter(is_thin).collect();
    for index in thin {
        previews[index] = Err(NoEdge::Cramped);
    }
}
