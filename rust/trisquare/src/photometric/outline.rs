//! Traced image of a square outline, and the pixels around it.

use nalgebra::Vector2;

use super::band_pixels::{BandPixel, PixelFigure, Width};
use super::distance_map::{DistanceMap, Mark, TRACE_SPACING, TracePoint};
use crate::geometry::Line;
use crate::image::KeptReader;
use crate::lens::Lens;
use crate::observations::{ObservedPlane, PlaneState, Side};

/// Maximum reach of an outline, as a fraction of its distance to another outline of the same plane.
const SHARED_REACH: f64 = 0.45;

/// Fraction of the plain border inside an outline that is used: the rest is blurred by what is
/// beyond it.
const BORDER_SHARE: f64 = 0.5;

/// Number of trace points per stretch: 16 px, half of the shortest object that hides a twelfth of a
/// side of 400 px.
const STRETCH_POINTS: usize = 4;

/// Maximum number of trace points per side, so that 16 bits index those of an outline.
const MAX_TRACE: f64 = 16_000.0;

/// The sides of a figure and the points of their images.
pub(super) struct Outline {
    sides: [Line; 4],
    corners: [Vector2<f64>; 4],
    trace: Vec<TracePoint>,
}

impl Outline {
    pub fn of<L: Lens>(
        plane: &ObservedPlane,
        state: &PlaneState,
        figure: usize,
        (lens, border): (&L, Option<f64>),
    ) -> Option<Self> {
        let sides = plane.figures[figure].sides.iter();
        let sides: Option<Vec<Line>> = sides.map(Side::line).collect();
        let mut sides: [Line; 4] = sides?.try_into().ok()?;
        let mut corners = [Vector2::zeros(); 4];
        for i in 0..4 {
            corners[i] = sides[(i + 3) % 4].intersection(&sides[i])?;
        }
        let middle = corners.iter().sum::<Vector2<f64>>() / 4.0;
        for side in &mut sides {
            if side.distance(&middle) < 0.0 {
                *side = side.reversed();
            }
        }
        let mut trace = Vec::new();
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let inside = sides[i].normal();
            let projection = |t: f64, depth: f64| {
                let point = a.lerp(&b, t) + inside * depth;
                let point = state.figures[figure].point(point);
                lens.project(&state.pose.transform(&point))
            };
            let side_pixel = |t: f64| projection(t, 0.0);
            let length = (side_pixel(1.0)? - side_pixel(0.0)?).norm();
            let count = (length / TRACE_SPACING).ceil().clamp(1.0, MAX_TRACE);
            // Both ends included: a corner belongs to both of its sides.
            for step in 0..=count as usize {
                let t = step as f64 / count;
                let place = side_pixel(t)?;
                let along = (side_pixel(1.0)? - side_pixel(0.0)?).normalize();
                let inward = match border.and_then(|border| projection(t, BORDER_SHARE * border)) {
                    Some(end) => along.perp(&(end - place)).abs(),
                    None => f64::INFINITY,
                };
                trace.push(TracePoint {
                    place,
                    side: i,
                    inward,
                });
            }
        }
        Some(Self {
            sides,
            corners,
            trace,
        })
    }

    /// The corners of the upright rectangle around the outline.
    fn bounds(&self) -> (Vector2<f64>, Vector2<f64>) {
        bounds(self.trace.iter().map(|point| &point.place))
    }

    fn size(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).norm()
    }

    /// Distance (px) from this outline up to which pixels belong to it.
    pub fn reach(&self, outlines: &[Outline], index: usize, width: Width) -> f64 {
        let mut nearest = f64::INFINITY;
        for (other, outline) in outlines.iter().enumerate() {
            if other == index {
                continue;
            }
            for a in self.trace.iter().step_by(4) {
                for b in outline.trace.iter().step_by(2) {
                    nearest = nearest.min((a.place - b.place).norm_squared());
                }
            }
        }
        width.reach(self.size()).min(SHARED_REACH * nearest.sqrt())
    }

    pub fn figure(
        &self,
        reader: &KeptReader<'_>,
        (plane, figure): (usize, usize),
        (reach, width): (f64, Width),
        dark_inside: bool,
    ) -> PixelFigure {
        let (low, high) = self.bounds();
        let (pixels, stretch_sides) = self.pixels(reader, reach, width);
        PixelFigure {
            image: 0,
            plane,
            figure,
            sides: self.sides,
            corners: self.corners,
            dark_inside,
            centre: (low + high) / 2.0,
            size: (high - low).norm(),
            width,
            reach,
            pixels,
            stretch_sides,
            dropped: Vec::new(),
        }
    }

    /// The pixels within `reach`, and the side of each stretch.
    pub fn pixels(
        &self,
        reader: &KeptReader<'_>,
        reach: f64,
        width: Width,
    ) -> (Vec<BandPixel>, Vec<u8>) {
        let (low, high) = self.bounds();
        let map = DistanceMap::around(&self.trace, low, high, reader.kept(), width);
        let (stretches, stretch_sides) = self.stretches();
        let inward = self.inward_normals();
        let band_pixel = |x: usize, y: usize, mark: &Mark| {
            let place = Vector2::new(x as f64, y as f64);
            let nearest = usize::from(mark.nearest);
            let point = &self.trace[nearest];
            // Pixels nearest to a corner lie outside: the square is convex.
            let inside = inward[nearest].map_or(-1.0, |n| n.dot(&(place - point.place)));
            let depth = f64::from(mark.square).sqrt().copysign(inside);
            if depth > point.inward {
                return None;
            }
            let (value, is_clipped) = reader.get(x, y)?;
            Some(BandPixel {
                column: x as u32,
                row: y as u32,
                value,
                is_clipped,
                near: mark.near,
                depth: depth as f32,
                stretch: stretches[nearest],
            })
        };
        let mut pixels = Vec::with_capacity(map.expected_count(self.trace.len(), reach));
        map.for_each_within(reach, |x, y, mark| pixels.extend(band_pixel(x, y, mark)));
        (pixels, stretch_sides)
    }

    /// The stretch that each point of the trace belongs to, and the side of each stretch.
    fn stretches(&self) -> (Vec<u16>, Vec<u8>) {
        let mut sides: Vec<u8> = Vec::new();
        let mut points = Vec::with_capacity(self.trace.len());
        for side in self.trace.chunk_by(|a, b| a.side == b.side) {
            // Of equal length, so that no short one is left over at a corner.
            let count = (side.len() / STRETCH_POINTS).max(1);
            let first = sides.len();
            points.extend((0..side.len()).map(|i| (first + i * count / side.len()) as u16));
            sides.extend(std::iter::repeat_n(side[0].side as u8, count));
        }
        (points, sides)
    }

    /// Inward normal, not normalised, at every point of the trace; `None` at a corner.
    fn inward_normals(&self) -> Vec<Option<Vector2<f64>>> {
        let winding = self.winding();
        let across = |along: Vector2<f64>| Vector2::new(-along.y, along.x) * winding;
        let points = 0..self.trace.len();
        points.map(|i| self.direction(i).map(across)).collect()
    }

    /// Direction of the outline at a point of its trace; `None` at a corner.
    fn direction(&self, index: usize) -> Option<Vector2<f64>> {
        let side = self.trace[index].side;
        let neighbour = |i: usize| self.trace.get(i).filter(|p| p.side == side);
        let (previous, next) = (neighbour(index.checked_sub(1)?)?, neighbour(index + 1)?);
        Some(next.place - previous.place)
    }

    /// +1 if the trace runs clockwise on the screen, so that the inside lies to its right.
    fn winding(&self) -> f64 {
        let origin = self.trace[0].place;
        let area: f64 = self
            .trace
            .windows(2)
            .map(|pair| (pair[0].place - origin).perp(&(pair[1].place - origin)))
            .sum();
        area.signum()
    }
}

/// Opposite corners of the bounding box of points.
pub(super) fn bounds<'a>(
    points: impl Iterator<Item = &'a Vector2<f64>>,
) -> (Vector2<f64>, Vector2<f64>) {
    let infinity = Vector2::repeat(f64::INFINITY);
    points.fold((infinity, -infinity), |(low, high), p| {
        (low.inf(p), high.sup(p))
    })
}
