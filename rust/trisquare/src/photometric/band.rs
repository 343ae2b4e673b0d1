//! The pixels around the outlines of squares.

use nalgebra::Vector2;

use crate::observations::{ObservedPlane, Side};
use crate::photometric::{Photographs, Refusal};
use crate::picture::GreyReader;
use crate::refine::{PlaneState, View};
use crate::{Brown, Lens, PlaneEdges, Polarity};

/// Pixels this near (px) to an outline are used.
const REACH: f64 = 5.0;

/// Between two outlines of one plane, at most this part of their distance is used from each.
const SHARED_REACH: f64 = 0.45;

/// An outline whose reach is cut below this (px) shows no plateau beside its blur.
const MIN_REACH: f64 = 3.0;

/// Distance (px) from which a side no longer blurs a pixel, for the blurs that can be fitted.
const NEAR: f64 = 6.0;

/// Spacing (px) of the points at which a side's image is marked.
const MARK_SPACING: f64 = 1.5;

/// A pixel near an outline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandPixel {
    pub place: Vector2<f64>,
    /// Coded grey, 1 being white.
    pub value: f64,
    /// The sides that may blur it, one bit each; none for a pixel well inside.
    pub near: u8,
}

/// A square outline with the pixels around it.
#[derive(Debug, Clone)]
pub(crate) struct PixelFigure {
    pub plane: usize,
    pub figure: usize,
    /// The four sides with their normals turned inward, in cyclic order.
    pub sides: [Side; 4],
    /// The corners in the figure's coordinates; corner `i` is where sides `i - 1` and `i` meet.
    pub corners: [Vector2<f64>; 4],
    pub dark_inside: bool,
    /// Middle and size (px) of the outline, for the linear terms of the exposure.
    pub centre: Vector2<f64>,
    pub size: f64,
    pub pixels: Vec<BandPixel>,
}

impl PixelFigure {
    /// The same with about one pixel in `stride`, spread evenly.
    pub fn thinned(&self, stride: usize) -> Self {
        // A step that is odd against any row length keeps no direction together.
        let keep = |p: &&BandPixel| {
            (p.place.x as usize * 3 + p.place.y as usize * 5).is_multiple_of(stride)
        };
        Self {
            pixels: self.pixels.iter().filter(keep).copied().collect(),
            sides: self.sides.clone(),
            ..*self
        }
    }

    /// Place in the figure, from -1/2 to 1/2: the variables of its linear shading.
    pub fn shading_place(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        (pixel - self.centre) / self.size
    }
}

/// Collects the pixels around every figure; not applicable unless all are squares of known
/// polarity.
pub(super) fn collect(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    view: &View<Brown>,
    photographs: &Photographs<'_>,
) -> Result<Vec<PixelFigure>, Refusal> {
    let readers: Vec<GreyReader<'_>> = photographs
        .pictures
        .iter()
        .map(|picture| picture.reader(photographs.tone))
        .collect();
    let mut figures = Vec::new();
    for (p, plane) in planes.iter().enumerate() {
        let reader = readers.get(plane.image).ok_or(Refusal::NotApplicable)?;
        let outlines: Option<Vec<Outline>> = (0..plane.figures.len())
            .map(|f| Outline::of(plane, &view.planes[p], f, &view.lens))
            .collect();
        let outlines = outlines.ok_or(Refusal::NotApplicable)?;
        for (f, outline) in outlines.iter().enumerate() {
            let polarity = edges[plane.figures[f].index].polarity;
            let dark_inside = polarity.ok_or(Refusal::NotApplicable)? == Polarity::DarkInside;
            let reach = outline.reach_beside(&outlines, f);
            if reach < MIN_REACH {
                return Err(Refusal::Reason(
                    "two outlines of a plane are too close together",
                ));
            }
            figures.push(outline.figure(reader, view, (p, f), reach, dark_inside));
        }
    }
    Ok(figures)
}

/// A figure's sides and the points of their images.
struct Outline {
    sides: [Side; 4],
    corners: [Vector2<f64>; 4],
    trace: Vec<Vector2<f64>>,
}

impl Outline {
    fn of(plane: &ObservedPlane, state: &PlaneState, figure: usize, lens: &Brown) -> Option<Self> {
        let mut sides: [Side; 4] = plane.figures[figure].sides.clone().try_into().ok()?;
        let mut corners = [Vector2::zeros(); 4];
        for i in 0..4 {
            corners[i] = sides[(i + 3) % 4].line.intersection(&sides[i].line)?;
        }
        let middle = corners.iter().sum::<Vector2<f64>>() / 4.0;
        for side in &mut sides {
            if side.line.distance(&middle) < 0.0 {
                side.line = side.line.reversed();
            }
            side.samples = Vec::new(); // the pixels replace them
        }
        let mut trace = Vec::new();
        for i in 0..4 {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let see = |t: f64| {
                let point = state.figures[figure].point(a.lerp(&b, t));
                lens.project(&state.pose.transform(&point))
            };
            let length = (see(1.0)? - see(0.0)?).norm();
            let count = (length / MARK_SPACING).ceil().max(1.0);
            for step in 0..count as usize {
                trace.push(see(step as f64 / count)?);
            }
        }
        Some(Self {
            sides,
            corners,
            trace,
        })
    }

    /// How far from this outline pixels are its own.
    fn reach_beside(&self, outlines: &[Outline], own: usize) -> f64 {
        let mut nearest = f64::INFINITY;
        for (other, outline) in outlines.iter().enumerate() {
            if other == own {
                continue;
            }
            for a in self.trace.iter().step_by(4) {
                for b in outline.trace.iter().step_by(2) {
                    nearest = nearest.min((a - b).norm_squared());
                }
            }
        }
        REACH.min(SHARED_REACH * nearest.sqrt())
    }

    fn figure(
        &self,
        reader: &GreyReader<'_>,
        view: &View<Brown>,
        (plane, figure): (usize, usize),
        reach: f64,
        dark_inside: bool,
    ) -> PixelFigure {
        let far = Vector2::repeat(f64::INFINITY);
        let low = self.trace.iter().fold(far, |low, p| low.inf(p));
        let high = self.trace.iter().fold(-far, |high, p| high.sup(p));
        let state = &view.planes[plane];
        let lines = [0, 1, 2, 3].map(|i| state.line(figure, &self.sides[i]));
        let pixels = marked_pixels(&self.trace, low, high, reach)
            .filter_map(|(x, y)| {
                let place = Vector2::new(x as f64, y as f64);
                let value = reader.get(x, y)?;
                let sight = view.lens.sight(&place)?;
                let mut near = 0;
                for (i, line) in lines.iter().enumerate() {
                    if view.lens.line_distance(&sight, line) < NEAR {
                        near |= 1 << i;
                    }
                }
                Some(BandPixel { place, value, near })
            })
            .collect();
        PixelFigure {
            plane,
            figure,
            sides: self.sides.clone(),
            corners: self.corners,
            dark_inside,
            centre: (low + high) / 2.0,
            size: (high - low).norm(),
            pixels,
        }
    }
}

/// All pixels within `reach` of a trace, once each, in row order.
fn marked_pixels(
    trace: &[Vector2<f64>],
    low: Vector2<f64>,
    high: Vector2<f64>,
    reach: f64,
) -> impl Iterator<Item = (usize, usize)> {
    // Pixels left of or above the picture have no index.
    let first = |v: f64| (v - reach).floor().max(0.0) as usize;
    let (x0, y0) = (first(low.x), first(low.y));
    let width = (high.x + reach).ceil().max(0.0) as usize + 1 - x0.min(high.x.max(0.0) as usize);
    let height = (high.y + reach).ceil().max(0.0) as usize + 1 - y0.min(high.y.max(0.0) as usize);
    let mut marked = vec![false; width * height];
    for point in trace {
        let (top, bottom) = (point.y - reach, point.y + reach);
        for y in top.ceil().max(y0 as f64) as usize..=bottom.floor().max(0.0) as usize {
            let half = (reach * reach - (y as f64 - point.y).powi(2))
                .max(0.0)
                .sqrt();
            let left = (point.x - half).ceil().max(x0 as f64) as usize - x0;
            let right = (point.x + half).floor();
            if y - y0 >= height || right < x0 as f64 {
                continue;
            }
            let end = (right as usize - x0 + 1).min(width);
            let row = (y - y0) * width;
            if left < end {
                marked[row + left..row + end].fill(true);
            }
        }
    }
    marked
        .into_iter()
        .enumerate()
        .filter(|(_, marked)| *marked)
        .map(move |(index, _)| (x0 + index % width, y0 + index / width))
}
