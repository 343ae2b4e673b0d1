//! Distances of the pixels around a traced outline to it, and the nearest of its points.

use nalgebra::Vector2;

use super::band_pixels::Width;
use crate::image::KeptPixels;

/// Distance (px) from an outline up to which all pixels are used; beyond it every second one, in a
/// chequered pattern. Applies to a band of the usual width, as do the other lengths here.
const FULL_DENSITY: f64 = 5.0;

/// Distance (px) from a side up to which it may blur pixels: more than the reach of a band, because
/// the sides of a blunt corner diverge slowly.
const NEAR: f64 = 13.0;

/// Number of pixels of a row that are examined together.
const RUN: usize = 16;

/// Spacing (px) of the points at which a side's image is traced.
pub(super) const TRACE_SPACING: f64 = 4.0;

/// A point of an outline's image, and the side it belongs to.
#[derive(Clone, Copy)]
pub(super) struct TracePoint {
    pub place: Vector2<f64>,
    pub side: usize,
    /// Width (px) of the strip inside the outline whose pixels belong to it.
    pub inward: f64,
}

/// For the pixels around a trace: the nearest of its points, and the sides that are near.
pub(super) struct DistanceMap {
    x0: usize,
    y0: usize,
    width: usize,
    full_density: f64,
    marks: Vec<Mark>,
}

/// A map entry. Small, since there is one for every pixel of a figure's bounding box.
#[derive(Clone, Copy)]
pub(super) struct Mark {
    /// Squared distance to the nearest point of the trace.
    pub square: f32,
    pub nearest: u16,
    pub near: u8,
}

/// The stripe across a trace in which a point may be the nearest one, given its two neighbours: a
/// disc around every point would mark each pixel many times.
enum NearestStripe {
    /// The end of a side: no limit.
    End,
    /// Direction of the trace, and half the stripe's width along it.
    Middle(Vector2<f64>, f64),
}

impl NearestStripe {
    fn of(trace: &[TracePoint], index: usize) -> Self {
        let side = trace[index].side;
        let neighbour = |i: usize| trace.get(i).filter(|p| p.side == side);
        let before = index.checked_sub(1).and_then(neighbour);
        let (Some(before), Some(after)) = (before, neighbour(index + 1)) else {
            return Self::End;
        };
        let along = after.place - before.place;
        let length = along.norm();
        // Half the distance to a neighbour, doubled for traces that bend or are uneven.
        Self::Middle(along / length, 0.5 * length)
    }

    /// Entry and exit of the row `dy` below the point into the stripe, relative to the point's `x`.
    fn row_range(&self, dy: f64) -> (f64, f64) {
        match self {
            Self::End => (f64::NEG_INFINITY, f64::INFINITY),
            Self::Middle(along, half) => {
                let (first, second) = (
                    (-half - dy * along.y) / along.x,
                    (half - dy * along.y) / along.x,
                );
                // For a row along the stripe these are infinite, or NaN exactly on its edge.
                (first.min(second), first.max(second))
            }
        }
    }
}

impl DistanceMap {
    pub fn around(
        trace: &[TracePoint],
        low: Vector2<f64>,
        high: Vector2<f64>,
        picture: &KeptPixels,
        width: Width,
    ) -> Self {
        let near = width.factor() * NEAR;
        let clip = |v: f64, count: usize| v.clamp(0.0, count as f64) as usize;
        let (x0, y0) = (
            clip((low.x - near).floor(), picture.width()),
            clip((low.y - near).floor(), picture.height()),
        );
        let (x1, y1) = (
            clip((high.x + near).ceil() + 1.0, picture.width()),
            clip((high.y + near).ceil() + 1.0, picture.height()),
        );
        let unmarked = Mark {
            square: f32::INFINITY,
            nearest: 0,
            near: 0,
        };
        let mut map = Self {
            x0,
            y0,
            full_density: width.factor() * FULL_DENSITY,
            width: x1 - x0,
            marks: vec![unmarked; (x1 - x0) * (y1 - y0)],
        };
        for (index, point) in trace.iter().enumerate() {
            let p = point.place;
            let stripe = NearestStripe::of(trace, index);
            let (bit, number) = (1 << point.side, index as u16);
            for y in clip((p.y - near).ceil(), y1).max(y0)..clip((p.y + near).floor() + 1.0, y1) {
                let dy = y as f64 - p.y;
                let half = (near * near - dy * dy).max(0.0).sqrt();
                let (from, to) = stripe.row_range(dy);
                let left = clip((p.x + from.max(-half)).ceil(), x1).max(x0);
                let right = clip((p.x + to.min(half)).floor() + 1.0, x1);
                let row = (y - y0) * map.width;
                if left >= right {
                    continue;
                }
                let (mut dx, square_dy) = (left as f64 - p.x, dy * dy);
                for mark in &mut map.marks[row + left - x0..row + right - x0] {
                    let square = (dx * dx + square_dy) as f32;
                    dx += 1.0;
                    mark.near |= bit;
                    // Branchless: a branch here would be unpredictable.
                    let is_nearer = square < mark.square;
                    mark.square = if is_nearer { square } else { mark.square };
                    mark.nearest = if is_nearer { number } else { mark.nearest };
                }
            }
        }
        map
    }

    /// Approximate number of pixels within `reach` of an outline of so many points.
    pub fn expected_count(&self, points: usize, reach: f64) -> usize {
        let dense = self.full_density.min(reach);
        // On both sides; beyond the dense part every second pixel.
        let width = 2.0 * dense + (reach - dense);
        let length = TRACE_SPACING * points as f64;
        ((length * width) as usize).min(self.marks.len())
    }

    /// Visits the pixels that are used: all near the outline, every second one beyond.
    pub fn for_each_within(&self, reach: f64, mut visit: impl FnMut(usize, usize, &Mark)) {
        let (dense, sparse) = (self.full_density.powi(2) as f32, (reach * reach) as f32);
        for (y, row) in self.marks.chunks_exact(self.width.max(1)).enumerate() {
            for (run, marks) in row.chunks(RUN).enumerate() {
                // Most of a bounding box lies far from the outline.
                if !marks.iter().any(|mark| mark.square <= sparse) {
                    continue;
                }
                for (i, mark) in marks.iter().enumerate() {
                    let x = run * RUN + i;
                    let is_used =
                        mark.square <= dense || mark.square <= sparse && (x + y).is_multiple_of(2);
                    if is_used {
                        visit(self.x0 + x, self.y0 + y, mark);
                    }
                }
            }
        }
    }
}
