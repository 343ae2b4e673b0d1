//! The pixels around the outlines of squares.

use nalgebra::Vector2;

use super::coverage::PLATEAU;
use super::photographs::{Photographs, Refusal};
use crate::geometry::Line;
use crate::image::{KeptPixels, KeptReader};
use crate::lens::Lens;
use crate::observations::{ObservedPlane, PlaneEdges, PlaneState, Polarity, Side, View};

/// Pixels this near (px) to an outline are used: farther ones still tell the plateaus' light.
const REACH: f64 = 12.0;

/// Beyond this (px) every second pixel does, in a chequered pattern.
const FULL_DENSITY: f64 = 5.0;

/// But no farther than this part of the outline's size, and at least so many px.
const REACH_PART: f64 = 0.03;
const MIN_FULL_REACH: f64 = 5.0;

/// Between two outlines of one plane, at most this part of their distance is used from each.
const SHARED_REACH: f64 = 0.45;

/// An outline whose reach is cut below this (px) shows no plateau beside its blur.
const MIN_REACH: f64 = 3.0;

/// Of the plain border within an outline this part is used: its other half is blurred by what comes
/// next.
const BORDER_SHARE: f64 = 0.5;

/// A side blurs the pixels within so many px of its ends and itself: more than the reach, because
/// a blunt corner's sides part slowly.
const NEAR: f64 = 13.0;

/// How wide a band along the outlines is: the lengths above are of the usual one.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Width {
    Usual,
    /// Twice as wide, where the usual one does not hold the blur.
    Wide,
}

impl Width {
    /// What the lengths are multiplied by.
    fn factor(self) -> f64 {
        match self {
            Self::Usual => 1.0,
            Self::Wide => 2.0,
        }
    }

    /// The narrower one that is sure to hold edges of this blur (px), measured by its sides alone.
    pub fn of_blur(blur: f64) -> Self {
        match blur < SURELY_HELD * Self::Usual.widest_blur() {
            true => Self::Usual,
            false => Self::Wide,
        }
    }

    /// The largest blur (px) that a band holds: 3.8 of it are an edge.
    pub fn widest_blur(self) -> f64 {
        self.factor() * REACH / PLATEAU
    }

    /// How far (px) a band reaches from an outline of this size (px) that stands alone.
    pub fn reach(self, size: f64) -> f64 {
        self.factor() * (REACH_PART * size).clamp(MIN_FULL_REACH, REACH)
    }
}

/// A blur that was measured as less than this part of the widest one fits into the band: the blur of
/// a figure's sides, fitted together, differs from that of a single one.
const SURELY_HELD: f64 = 0.65;

/// Pixels of a row that are looked at together.
const RUN: usize = 16;

/// Spacing (px) of the points at which a side's image is traced.
const TRACE_SPACING: f64 = 4.0;

/// Points of an outline's trace that make a stretch: 16 px, half of the shortest thing that hides
/// a twelfth of a side of 400 px.
const STRETCH_POINTS: usize = 4;

/// Points of a side's trace at most, so that 16 bits number those of an outline.
const MAX_TRACE: f64 = 16_000.0;

/// A pixel near an outline, in few bytes: there are some hundred thousand in a photograph.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandPixel {
    column: u32,
    row: u32,
    /// Coded grey, 1 being white.
    pub value: f64,
    depth: f32,
    /// The stretch of the outline that it is nearest to.
    pub stretch: u16,
    /// The sides that may blur it, one bit each.
    pub near: u8,
    /// Whether the value only bounds the light from below.
    pub is_clipped: bool,
}

impl BandPixel {
    #[inline]
    pub fn place(&self) -> Vector2<f64> {
        Vector2::new(f64::from(self.column), f64::from(self.row))
    }

    /// Distance to the outline as first seen, px, positive inside; good to half a pixel.
    #[inline]
    pub fn depth(&self) -> f64 {
        f64::from(self.depth)
    }
}

/// A square outline with the pixels around it.
#[derive(Debug, Clone)]
pub(crate) struct PixelFigure {
    /// Index of the picture that shows it.
    pub image: usize,
    pub plane: usize,
    pub figure: usize,
    /// The four sides with their normals turned inward, in cyclic order.
    pub sides: [Line; 4],
    /// The corners in the figure's coordinates; corner `i` is where sides `i - 1` and `i` meet.
    pub corners: [Vector2<f64>; 4],
    pub dark_inside: bool,
    /// Middle and size (px) of the outline, for the linear terms of the exposure.
    pub centre: Vector2<f64>,
    pub size: f64,
    /// Of its band.
    pub width: Width,
    /// How far (px) from the outline its pixels lie.
    reach: f64,
    /// Empty where they are read again for every use: see [`Bands::pixels`].
    pub pixels: Vec<BandPixel>,
    /// The side that each stretch of the outline belongs to.
    pub stretch_sides: Vec<u8>,
    /// The stretches whose pixels are dropped; empty if none are.
    dropped: Vec<bool>,
}

impl PixelFigure {
    /// The same with about one pixel in `stride`, spread evenly.
    pub fn subsampled(&self, stride: u32) -> Self {
        self.with_some_of(&self.pixels, stride)
    }

    /// The same with about one in `stride` of these pixels.
    pub fn with_some_of(&self, pixels: &[BandPixel], stride: u32) -> Self {
        // Neighbours along rows, columns and diagonals fall into different classes.
        let class = |p: &BandPixel| 3 * u64::from(p.column) + 5 * u64::from(p.row);
        let keep = |p: &&BandPixel| class(p).is_multiple_of(u64::from(stride));
        Self {
            pixels: pixels.iter().filter(keep).copied().collect(),
            stretch_sides: self.stretch_sides.clone(),
            dropped: self.dropped.clone(),
            ..*self
        }
    }

    /// Drops the pixels farther off than `reach` (px), which leaves the edge at least.
    pub fn limit_reach(&mut self, reach: f64) {
        if reach < self.reach {
            self.reach = reach.max(MIN_REACH);
            let limit = self.reach;
            self.pixels.retain(|pixel| pixel.depth().abs() <= limit);
        }
    }

    /// Drops the pixels along marked stretches.
    pub fn drop_stretches(&mut self, marked: Vec<bool>) {
        if marked.contains(&true) {
            retain_used(&mut self.pixels, &marked);
            self.dropped = marked;
        }
    }
}

fn retain_used(pixels: &mut Vec<BandPixel>, dropped: &[bool]) {
    pixels.retain(|pixel| !dropped[usize::from(pixel.stretch)]);
}

/// The corners of the upright rectangle around points.
pub(super) fn bounds<'a>(
    points: impl Iterator<Item = &'a Vector2<f64>>,
) -> (Vector2<f64>, Vector2<f64>) {
    let far = Vector2::repeat(f64::INFINITY);
    points.fold((far, -far), |(low, high), p| (low.inf(p), high.sup(p)))
}

/// Where the pixels around the outlines of the figures come from.
pub(super) struct Bands<'a, L> {
    edges: &'a [PlaneEdges],
    planes: &'a [ObservedPlane],
    /// The outlines are traced under it.
    view: &'a View<L>,
    readers: Vec<KeptReader<'a>>,
}

impl<'a, L: Lens> Bands<'a, L> {
    pub fn new(
        edges: &'a [PlaneEdges],
        planes: &'a [ObservedPlane],
        view: &'a View<L>,
        photographs: &Photographs<'a>,
    ) -> Self {
        let pictures = photographs.pictures.iter().zip(photographs.tones);
        Self {
            edges,
            planes,
            view,
            readers: pictures.map(|(p, tone)| p.reader(tone.tone())).collect(),
        }
    }

    /// The figures of a plane, none of an outlier; not applicable unless all are squares of known
    /// polarity.
    pub fn of_plane(&self, p: usize, width: Width) -> Result<Vec<PixelFigure>, Refusal> {
        let plane = &self.planes[p];
        if plane.is_outlier() {
            return Ok(Vec::new());
        }
        let reader = self
            .readers
            .get(plane.image)
            .ok_or(Refusal::NotApplicable)?;
        let outlines: Option<Vec<Outline>> = (0..plane.figures.len())
            .map(|f| self.outline(p, f))
            .collect();
        let outlines = outlines.ok_or(Refusal::NotApplicable)?;
        let figure = |(f, outline): (usize, &Outline)| {
            let polarity = self.edges[plane.figures[f].index].polarity;
            let dark_inside = polarity.ok_or(Refusal::NotApplicable)? == Polarity::DarkInside;
            let reach = outline.reach_beside(&outlines, f, width);
            if reach < MIN_REACH {
                return Err(Refusal::Reason(
                    "two outlines of a plane are too close together",
                ));
            }
            let mut found = outline.figure(reader, (p, f), (reach, width), dark_inside);
            found.image = plane.image;
            Ok(found)
        };
        outlines.iter().enumerate().map(figure).collect()
    }

    fn outline(&self, p: usize, f: usize) -> Option<Outline> {
        let plane = &self.planes[p];
        let border = self.edges[plane.figures[f].index].border;
        Outline::of(plane, &self.view.planes[p], f, (&self.view.lens, border))
    }
}

/// What gives the pixels of a figure that does not hold them.
pub(super) trait Pixels: Sync {
    fn read(&self, figure: &PixelFigure) -> Option<Vec<BandPixel>>;
}

impl<L: Lens> Pixels for Bands<'_, L> {
    fn read(&self, figure: &PixelFigure) -> Option<Vec<BandPixel>> {
        let outline = self.outline(figure.plane, figure.figure)?;
        let (mut pixels, ..) =
            outline.pixels(&self.readers[figure.image], figure.reach, figure.width);
        if !figure.dropped.is_empty() {
            retain_used(&mut pixels, &figure.dropped);
        }
        Some(pixels)
    }
}

/// A figure's sides and the points of their images.
struct Outline {
    sides: [Line; 4],
    corners: [Vector2<f64>; 4],
    trace: Vec<TracePoint>,
}

/// A point of an outline's image, and the side it belongs to.
#[derive(Clone, Copy)]
struct TracePoint {
    place: Vector2<f64>,
    side: usize,
    /// How far inside (px) pixels are the outline's own.
    inward: f64,
}

impl Outline {
    fn of<L: Lens>(
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
            let see_beside = |t: f64, depth: f64| {
                let point = a.lerp(&b, t) + inside * depth;
                let point = state.figures[figure].point(point);
                lens.project(&state.pose.transform(&point))
            };
            let see = |t: f64| see_beside(t, 0.0);
            let length = (see(1.0)? - see(0.0)?).norm();
            let count = (length / TRACE_SPACING).ceil().clamp(1.0, MAX_TRACE);
            // Both ends included: a corner belongs to both of its sides.
            for step in 0..=count as usize {
                let t = step as f64 / count;
                let place = see(t)?;
                let along = (see(1.0)? - see(0.0)?).normalize();
                let inward = match border.and_then(|border| see_beside(t, BORDER_SHARE * border)) {
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

    /// How far from this outline pixels are its own.
    fn reach_beside(&self, outlines: &[Outline], own: usize, width: Width) -> f64 {
        let mut nearest = f64::INFINITY;
        for (other, outline) in outlines.iter().enumerate() {
            if other == own {
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

    fn figure(
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

    /// The pixels within a reach, and the side of each stretch.
    fn pixels(
        &self,
        reader: &KeptReader<'_>,
        reach: f64,
        width: Width,
    ) -> (Vec<BandPixel>, Vec<u8>) {
        let (low, high) = self.bounds();
        let map = DistanceMap::around(&self.trace, low, high, reader.kept(), width);
        let (stretches, stretch_sides) = self.stretches();
        let inward = self.inward_normals();
        let own = |x: usize, y: usize, mark: &Mark| {
            let place = Vector2::new(x as f64, y as f64);
            let nearest = usize::from(mark.nearest);
            let point = &self.trace[nearest];
            // Whatever is nearest to a corner lies outside: the square is convex.
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
        map.for_each_within(reach, |x, y, mark| pixels.extend(own(x, y, mark)));
        (pixels, stretch_sides)
    }

    /// The stretch that each point of the trace belongs to, and the side of each stretch.
    fn stretches(&self) -> (Vec<u16>, Vec<u8>) {
        let mut sides: Vec<u8> = Vec::new();
        let mut points = Vec::with_capacity(self.trace.len());
        for side in self.trace.chunk_by(|a, b| a.side == b.side) {
            // Of equal length, lest a short one be left over at a corner.
            let count = (side.len() / STRETCH_POINTS).max(1);
            let first = sides.len();
            points.extend((0..side.len()).map(|i| (first + i * count / side.len()) as u16));
            sides.extend(std::iter::repeat_n(side[0].side as u8, count));
        }
        (points, sides)
    }

    /// Across the outline at every point of its trace, of any length; `None` at a corner.
    fn inward_normals(&self) -> Vec<Option<Vector2<f64>>> {
        let winding = self.winding();
        let across = |along: Vector2<f64>| Vector2::new(-along.y, along.x) * winding;
        let points = 0..self.trace.len();
        points.map(|i| self.direction(i).map(across)).collect()
    }

    /// Direction of the outline at a point of its trace; `None` at a corner.
    fn direction(&self, index: usize) -> Option<Vector2<f64>> {
        let side = self.trace[index].side;
        let other = |i: usize| self.trace.get(i).filter(|p| p.side == side);
        let (previous, next) = (other(index.checked_sub(1)?)?, other(index + 1)?);
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

/// For the pixels around a trace: which of its points is nearest, and which sides are near.
struct DistanceMap {
    x0: usize,
    y0: usize,
    width: usize,
    full_density: f64,
    marks: Vec<Mark>,
}

/// Kept small: there is one for every pixel of a figure's bounding box.
#[derive(Clone, Copy)]
struct Mark {
    /// Squared distance to the nearest point of the trace.
    square: f32,
    nearest: u16,
    near: u8,
}

/// The stripe across a trace that a point of it may be the nearest to, neighbours being on either
/// side: a disc round every point would mark each pixel many times over.
enum Across {
    /// At the end of a side: all round.
    End,
    /// Direction of the trace, and half the stripe's width along it.
    Middle(Vector2<f64>, f64),
}

impl Across {
    fn of(trace: &[TracePoint], index: usize) -> Self {
        let side = trace[index].side;
        let other = |i: usize| trace.get(i).filter(|p| p.side == side);
        let before = index.checked_sub(1).and_then(other);
        let (Some(before), Some(after)) = (before, other(index + 1)) else {
            return Self::End;
        };
        let along = after.place - before.place;
        let length = along.norm();
        // Half way to a neighbour, and as much again where the trace bends or is uneven.
        Self::Middle(along / length, 0.5 * length)
    }

    /// Where the row `dy` below the point enters the stripe and leaves it, from the point's `x`.
    fn stripe(&self, dy: f64) -> (f64, f64) {
        match self {
            Self::End => (f64::NEG_INFINITY, f64::INFINITY),
            Self::Middle(along, half) => {
                let (one, other) = (
                    (-half - dy * along.y) / along.x,
                    (half - dy * along.y) / along.x,
                );
                // Where the row runs along the stripe these are infinite, or NaN on its very rim.
                (one.min(other), one.max(other))
            }
        }
    }
}

impl DistanceMap {
    fn around(
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
        let far = Mark {
            square: f32::INFINITY,
            nearest: 0,
            near: 0,
        };
        let mut map = Self {
            x0,
            y0,
            full_density: width.factor() * FULL_DENSITY,
            width: x1 - x0,
            marks: vec![far; (x1 - x0) * (y1 - y0)],
        };
        for (index, point) in trace.iter().enumerate() {
            let p = point.place;
            let across = Across::of(trace, index);
            let (bit, number) = (1 << point.side, index as u16);
            for y in clip((p.y - near).ceil(), y1).max(y0)..clip((p.y + near).floor() + 1.0, y1) {
                let dy = y as f64 - p.y;
                let half = (near * near - dy * dy).max(0.0).sqrt();
                let (from, to) = across.stripe(dy);
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
                    // Without a branch: which way it went nobody could foresee.
                    let nearer = square < mark.square;
                    mark.square = if nearer { square } else { mark.square };
                    mark.nearest = if nearer { number } else { mark.nearest };
                }
            }
        }
        map
    }

    /// About how many pixels lie within `reach` of an outline of so many points.
    fn expected_count(&self, points: usize, reach: f64) -> usize {
        let dense = self.full_density.min(reach);
        // On both sides, beyond the density every second one.
        let across = 2.0 * dense + (reach - dense);
        let along = TRACE_SPACING * points as f64;
        ((along * across) as usize).min(self.marks.len())
    }

    /// Gives the pixels that are used: all near the outline, beyond every second one.
    fn for_each_within(&self, reach: f64, mut give: impl FnMut(usize, usize, &Mark)) {
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
                        give(self.x0 + x, self.y0 + y, mark);
                    }
                }
            }
        }
    }
}
