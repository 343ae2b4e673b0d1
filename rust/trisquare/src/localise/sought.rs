//! The spans to measure in a picture, coarsely found; those beside other objects are divided into
//! pieces.

use nalgebra::Vector2;

use super::coarse::{self, CoarseEdge};
use super::curve::ChordCurve;
use super::flip::EdgeShape;
use super::grid_crossings::GridCrossings;
use super::grid_line;
use super::preview::{self, Preview};
use super::span::{EdgeSpan, NoEdge, SpanEdges};
use crate::image::GreyReader;

/// Length of a piece, pixels.
///
/// The light beside other objects changes along a side. If it is modelled as linear along all of
/// the side, the blur absorbs the difference, and too wide a blur displaces the edges of a coded
/// picture: along one side by 0.17 to -0.2 pixels.
const PIECE_LENGTH: f64 = 60.0;
/// Distance by which a piece extends into its neighbours, pixels, since the first and last pixels
/// are not used.
const OVERLAP: f64 = 6.0;
/// Distance from the curve on which most samples agree, in a sample's standard deviations, above
/// which it is on another edge that its piece met.
const MAX_DEVIATIONS: f64 = 5.0;
/// Minimum fraction of a span's samples that agree.
const MIN_SHARE: f64 = 0.4;
/// Displacement of the crossings of grid lines, pixels, below which it hardly moves the lines.
const MIN_CROSSING_MOVE: f64 = 0.1;
/// Number of points of a piece's path.
const PATH_POINTS: usize = 5;

/// The pieces to measure, with the coarse edge of each.
pub(super) struct Sought<'a> {
    pub spans: Vec<EdgeSpan>,
    pub coarse: Vec<Result<CoarseEdge, NoEdge>>,
    /// The requested spans, and the number of pieces of each.
    requested: &'a [EdgeSpan],
    counts: Vec<usize>,
}

impl<'a> Sought<'a> {
    pub fn of(reader: &GreyReader<'_>, requested: &'a [EdgeSpan]) -> Self {
        let mut sought = Self {
            spans: Vec::with_capacity(requested.len()),
            coarse: Vec::with_capacity(requested.len()),
            requested,
            counts: Vec::with_capacity(requested.len()),
        };
        for (index, span) in requested.iter().enumerate() {
            let found = match span.fault(requested.len()) {
                Some(fault) => Err(NoEdge::InvalidArgument(fault)),
                None if span.crossings.is_empty() => coarse::find(reader, span),
                None => grid_line::find(reader, requested, index),
            };
            let pieces = match &found {
                Ok(found) if span.is_beside_others => pieces(span, &found.curve),
                _ => Vec::new(),
            };
            sought.counts.push(pieces.len().max(1));
            if pieces.is_empty() {
                sought.spans.push(span.clone());
                sought.coarse.push(found);
            } else {
                let near = pieces.iter().map(|piece| coarse::find_near(reader, piece));
                sought.coarse.extend(near);
                sought.spans.extend(pieces);
            }
        }
        sought.renumber();
        sought
    }

    /// Moves the crossings of grid lines to where the fitted lines meet; returns the lines whose
    /// crossings moved so far that they have to be fitted again.
    pub fn move_crossings(
        &mut self,
        reader: &GreyReader<'_>,
        previews: &[Result<Preview, NoEdge>],
    ) -> Vec<usize> {
        let moves = self.spans.iter().zip(previews).enumerate();
        let moves = moves.filter_map(|(index, (span, preview))| {
            if span.crossings.is_empty() {
                return None;
            }
            let (curve, shape) = match (preview, &self.coarse[index]) {
                (Ok(Preview { side, .. }), _) => (&side.curve, side.edge_shape()),
                (_, Ok(coarse)) => (&coarse.curve, EdgeShape::unspread(coarse.blur)),
                _ => return None,
            };
            let found = |line| preview::found(previews, line);
            let crossings = GridCrossings::fitted(&self.spans, index, (curve, shape), found);
            let path: Vec<_> = crossings.points().collect();
            let has_moved =
                |(was, is): (&Vector2<f64>, &Vector2<f64>)| (is - was).norm() > MIN_CROSSING_MOVE;
            let is_moved = span.path.iter().zip(&path).any(has_moved);
            is_moved.then_some((index, path))
        });
        let (moved, paths): (Vec<usize>, Vec<_>) = moves.unzip();
        for (index, path) in moved.iter().zip(paths) {
            self.spans[*index].path = path;
        }
        for &index in &moved {
            self.coarse[index] = grid_line::find(reader, &self.spans, index);
        }
        moved
    }

    /// Replaces the spans' indices of requested spans by those of the pieces.
    fn renumber(&mut self) {
        let mut end = 0;
        let ends: Vec<usize> = self
            .counts
            .iter()
            .map(|count| {
                end += count;
                end
            })
            .collect();
        let first = |span: usize| Some(ends.get(span)? - self.counts[span]);
        let last = |span: usize| Some(ends.get(span)? - 1);
        for span in &mut self.spans {
            let [before, after] = span.bounds;
            span.bounds = [before.and_then(last), after.and_then(first)];
            span.far_edge = span.far_edge.and_then(first);
            for (crossing, _) in &mut span.crossings {
                *crossing = crossing.and_then(first);
            }
        }
    }

    /// Joins the samples of the pieces into those of the requested spans.
    pub fn joined(
        &self,
        edges: impl IntoIterator<Item = Result<SpanEdges, NoEdge>>,
    ) -> Vec<Result<SpanEdges, NoEdge>> {
        let mut edges = edges.into_iter();
        let spans = self.requested.iter().zip(&self.counts);
        spans
            .map(|(span, &count)| match count {
                1 => edges.next().unwrap_or(Err(NoEdge::NoPath)),
                _ => join(span, edges.by_ref().take(count)),
            })
            .collect()
    }
}

/// The pieces of a span whose curve is known; empty if it is too short for two.
fn pieces(span: &EdgeSpan, curve: &ChordCurve) -> Vec<EdgeSpan> {
    let count = (curve.length() / PIECE_LENGTH).round() as usize;
    if count < 2 {
        return Vec::new();
    }
    let overlap = OVERLAP / curve.half_length;
    let piece = |index: usize| {
        let [start, end] = [index, index + 1].map(|cut| 2.0 * cut as f64 / count as f64 - 1.0);
        let (is_first, is_last) = (index == 0, index + 1 == count);
        let start = if is_first { start } else { start - overlap };
        let end = if is_last { end } else { end + overlap };
        let place = |k: usize| start + (end - start) * k as f64 / (PATH_POINTS - 1) as f64;
        EdgeSpan {
            path: (0..PATH_POINTS)
                .map(|k| curve.point(place(k), 0.0))
                .collect(),
            bounds: [
                span.bounds[0].filter(|_| is_first),
                span.bounds[1].filter(|_| is_last),
            ],
            ..span.clone()
        }
    };
    (0..count).map(piece).collect()
}

/// The samples of a span from those of its pieces, in order, without samples on other edges that
/// the pieces met.
fn join(
    span: &EdgeSpan,
    pieces: impl Iterator<Item = Result<SpanEdges, NoEdge>>,
) -> Result<SpanEdges, NoEdge> {
    let mut reason = NoEdge::Inconsistent;
    let found: Vec<SpanEdges> = pieces
        .filter_map(|piece| piece.map_err(|why| reason = why).ok())
        .collect();
    let mean =
        |value: fn(&SpanEdges) -> f64| found.iter().map(value).sum::<f64>() / found.len() as f64;
    let mut whole = SpanEdges {
        points: Vec::new(),
        std: Vec::new(),
        blur: mean(|edges| edges.blur),
        dark: mean(|edges| edges.dark),
        light: mean(|edges| edges.light),
        noise: mean(|edges| edges.noise),
        tone_drift: Vec::new(),
    };
    for piece in found {
        whole.points.extend(piece.points);
        whole.std.extend(piece.std);
        whole.tone_drift.extend(piece.tone_drift);
    }
    let curve = coarse::consensus_curve(span, &whole.points).ok_or(reason)?;
    let is_agreeing = |(point, std): (&Vector2<f64>, &f64)| {
        curve.signed_distance(*point).abs() < MAX_DEVIATIONS * std
    };
    let agreeing: Vec<bool> = whole
        .points
        .iter()
        .zip(&whole.std)
        .map(is_agreeing)
        .collect();
    let count = agreeing.iter().filter(|is_agreeing| **is_agreeing).count();
    if (count as f64) < MIN_SHARE * agreeing.len() as f64 {
        return Err(NoEdge::Inconsistent);
    }
    keep(&mut whole.points, &agreeing);
    keep(&mut whole.std, &agreeing);
    keep(&mut whole.tone_drift, &agreeing);
    Ok(whole)
}

/// Keeps the chosen samples of a list, which may be empty.
fn keep<T>(samples: &mut Vec<T>, chosen: &[bool]) {
    let mut chosen = chosen.iter();
    samples.retain(|_| chosen.next() == Some(&true));
}
