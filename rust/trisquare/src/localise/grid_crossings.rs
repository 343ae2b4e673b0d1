//! The crossings of a grid line with other lines: at each of them light and dark change sides.
//!
//! The light near a crossing of two blurred edges, at distances of `d` and `e` blurs, is the mean
//! of the two shades plus half their contrast times the expectation of `sign(d + x) sign(e + y)`,
//! with `x` and `y` normal and correlated by the cosine `rho` of the angle between the edges'
//! normals. That is `(2 Phi(d) - 1) (2 Phi(e) - 1)` and, where they are not at right angles, an
//! integral over the correlation (Drezner & Wesolowsky, J. Statist. Comput. Simul. 35 (1990)
//! 101-107). Its derivative with respect to `d` is
//! `2 phi(d) (2 Phi((e - rho d) / sqrt(1 - rho^2)) - 1)`. A pixel's flip consists of that slope and
//! the remainder of the value, so that lines can be measured right up to their crossings.

use std::f64::consts::FRAC_2_PI;

use nalgebra::Vector2;

use super::curve::ChordCurve;
use super::flip::{COMPLETE_BLURS, EdgeShape, Flip};
use super::lines_beside::{LineBeside, crossing_index, line_distances, next_crossings, next_line};
use super::span::EdgeSpan;
use super::tag_cells::TagCells;
use crate::numeric::cdf_and_pdf;

/// Distance, in blurs, beyond which a line's change of sides is complete to rounding.
const ROUNDING_BLURS: f64 = 7.0;
/// Pixels nearer to a marker than this many blurs are not used, since its border may be a twentieth
/// of a pixel from its modelled place ...
const MARKER_CLEARANCE: f64 = 3.0;
/// ... but pixels within this many blurs of the line are used all the same.
const MIN_REACH: f64 = 2.0;
/// Number of steps to the crossing of two curves; each squares the error, at first a pixel or two.
const STEPS: usize = 3;
/// Largest correlation in use: that of lines at 18 degrees to each other.
const MAX_CORRELATION: f64 = 0.95;
/// Gauss-Legendre nodes and weights on -1 to 1 for the integral over the correlation: three are
/// exact to 6e-7 up to a correlation of `MAX_FEW_CORRELATION` ...
const FEW_NODES: [(f64, f64); 3] = [
    (-0.774_596_669_241_483, 0.555_555_555_555_556),
    (0.0, 0.888_888_888_888_889),
    (0.774_596_669_241_483, 0.555_555_555_555_556),
];
const MAX_FEW_CORRELATION: f64 = 0.5;
/// ... and five are exact to 6e-7 at a correlation of 0.8.
const NODES: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189),
    (-0.538_469_310_105_683, 0.478_628_670_499_366),
    (0.0, 0.568_888_888_888_889),
    (0.538_469_310_105_683, 0.478_628_670_499_366),
    (0.906_179_845_938_664, 0.236_926_885_056_189),
];

/// The crossings of a line, in their order along it.
#[derive(Debug, Clone, Default)]
pub(super) struct GridCrossings {
    places: Vec<Crossing>,
    /// The tag beside the stretch after each crossing.
    tags: Vec<Option<TagCells>>,
    /// +1 if the line's step rises, -1 if it falls.
    polarity: f64,
}

/// A crossing; the line that crosses is taken to be straight as far as the band reaches.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    s: f64,
    point: Vector2<f64>,
    /// The crossing line's unit normal, in the direction in which this line runs.
    forward: Vector2<f64>,
    inverse_blur: f64,
    /// Displacement of the crossing line's edges from it towards the light, blurs.
    spread: f64,
    angle: Angle,
    /// Sign of the contrast after the crossing, relative to that after the first.
    sign: f64,
    /// The nearest grid lines beside this one, on its negative side and on the other.
    lines_beside: [LineBeside; 2],
    /// The marker in the light cell after the crossing.
    marker: Option<Marker>,
}

/// A dark square within a light cell, surrounded by white.
///
/// The step at its border is modelled as far as it blurs into the white: by `Phi` of the distances
/// from the three near sides. The marker is as dark as the dark cells, as it is printed in the same
/// ink.
#[derive(Debug, Clone, Copy)]
struct Marker {
    /// Sign of the distances from the line on the cell's side.
    side: f64,
    /// Distance (px) of the marker from the line, and from the lines that bound the cell.
    depth: f64,
    margin: f64,
}

impl GridCrossings {
    /// The crossings of the coarse paths.
    pub fn coarse(spans: &[EdgeSpan], index: usize, curve: &ChordCurve, shape: EdgeShape) -> Self {
        let span = &spans[index];
        let places = span.path.iter().zip(&span.crossings).enumerate();
        let places = places.map(|(number, (point, other))| {
            let along = other.0.and_then(|line| direction_at(spans, line, index));
            let along = along.unwrap_or(curve.across);
            Crossing {
                lines_beside: [-curve.along, curve.along]
                    .map(|along| next_line(spans, index, number, along)),
                marker: marker_after(spans, index, number),
                ..Crossing::new(*point, along, shape, (curve, span.contrast_sign(other.1)))
            }
        });
        let numbers = 0..span.crossings.len();
        Self {
            places: places.collect(),
            tags: numbers
                .map(|number| tag_after(spans, index, number))
                .collect(),
            polarity: span.polarity.signum(),
        }
    }

    /// The crossings of the fitted curves of both lines.
    ///
    /// `found` returns the curve and the shape of a span, if it was found.
    pub fn fitted<'a>(
        spans: &[EdgeSpan],
        index: usize,
        (curve, shape): (&ChordCurve, EdgeShape),
        found: impl Fn(usize) -> Option<(&'a ChordCurve, EdgeShape)>,
    ) -> Self {
        let coarse = Self::coarse(spans, index, curve, shape);
        let pairs = coarse.places.iter().zip(&spans[index].crossings);
        let places = pairs.map(|(place, (other, _))| match other.and_then(&found) {
            Some((other, shape)) => place.moved_to(curve, other, shape),
            None => *place,
        });
        Self {
            places: places.collect(),
            ..coarse
        }
    }

    /// The points of the crossings, in order.
    pub fn points(&self) -> impl Iterator<Item = Vector2<f64>> {
        self.places.iter().map(|place| place.point)
    }

    /// The crossings before and after a column of pixels, given by its crossing with the line.
    pub fn adjacent_to(&self, s: f64) -> AdjacentCrossings<'_> {
        let next = self.places.partition_point(|place| place.s < s);
        let sign = match next {
            0 => self.places.first().map_or(1.0, |first| -first.sign),
            _ => self.places[next - 1].sign,
        };
        let before = next.checked_sub(1).map(|i| &self.places[i]);
        let after = self.places.get(next);
        AdjacentCrossings {
            before,
            after,
            sign,
            polarity: self.polarity,
            lines_beside: [0, 1].map(|side| {
                let line_at = |crossing: &Crossing| (crossing.s, crossing.lines_beside[side]);
                LineBeside::interpolated(s, before.map(line_at), after.map(line_at))
            }),
            tag: after.and_then(|_| self.tags.get(next.checked_sub(1)?)?.as_ref()),
            marker: before.zip(after).and_then(|(before, _)| before.marker),
        }
    }
}

/// The two crossings next to a place on a line, and the sign of the contrast between them.
pub(super) struct AdjacentCrossings<'a> {
    before: Option<&'a Crossing>,
    after: Option<&'a Crossing>,
    sign: f64,
    polarity: f64,
    lines_beside: [LineBeside; 2],
    tag: Option<&'a TagCells>,
    marker: Option<Marker>,
}

impl AdjacentCrossings<'_> {
    /// The flip of a pixel at a distance from the line.
    pub fn flip(&self, point: Vector2<f64>, distance: f64) -> Flip {
        let before = self.before.map_or(Flip::NONE, |c| c.flip(point, distance));
        let after = self
            .after
            .map_or(Flip::NONE, |c| c.flip(point, distance).opposite());
        // Between the two, the product of their signs is their sum minus 1.
        Flip {
            slope: self.sign * (before.slope + after.slope - 1.0),
            // Doubled, as the step is from -1 to 1.
            shift: self.sign * (before.shift + after.shift)
                + self.change_beside(point, distance)
                + 2.0
                    * self.polarity
                    * (self.tag_light(point)
                        - self.marker_loss(point, distance)
                        - self.spread_loss(point)),
        }
    }

    /// Reduction of the light by the spread of the lines that cross, over the contrast: to first
    /// order in the spread it is the same on both sides of this line, and at any angle.
    fn spread_loss(&self, point: Vector2<f64>) -> f64 {
        let crossings = self.before.into_iter().chain(self.after);
        // Most lines have no spread.
        let spread = crossings.filter(|crossing| crossing.spread != 0.0);
        spread
            .map(|crossing| crossing.spread * cdf_and_pdf(crossing.blurs(point)).1)
            .sum()
    }

    /// Change of the step from -1 to 1 by the lines beside this one.
    fn change_beside(&self, point: Vector2<f64>, distance: f64) -> f64 {
        let inverse_blur = self.inverse_blur();
        let change = |side: usize, sign: f64| {
            let line = self.lines_beside[side];
            let distance = distance - sign * line.distance;
            let blurs = sign * distance * inverse_blur;
            if blurs < -COMPLETE_BLURS {
                return 0.0;
            }
            let before = self.before.map_or(1.0, |c| step(c.skewed(point, distance)));
            let after = self.after.map_or(1.0, |c| -step(c.skewed(point, distance)));
            let slope = self.sign * (before + after - 1.0);
            // Beyond the outline only the dark cells change.
            let share = match line.is_outline {
                true => 0.5 * (slope - sign * self.polarity),
                false => slope,
            };
            -sign * share * (1.0 + step(blurs))
        };
        change(0, -1.0) + change(1, 1.0)
    }

    fn inverse_blur(&self) -> f64 {
        self.before
            .or(self.after)
            .map_or(0.0, |crossing| crossing.inverse_blur)
    }

    /// Light that a tag's cells add to the dark, over the contrast.
    fn tag_light(&self, point: Vector2<f64>) -> f64 {
        let inverse_blur = self.inverse_blur();
        let tag = self.tag.filter(|tag| !tag.is_far(point, inverse_blur));
        tag.map_or(0.0, |tag| tag.light(point, inverse_blur))
    }

    /// Whether a pixel is too near to the cells of a tag.
    pub fn is_near_tag(&self, point: Vector2<f64>) -> bool {
        self.tag
            .is_some_and(|tag| tag.is_near(point, self.inverse_blur()))
    }

    /// Whether a pixel at this distance from the line is too near to a marker.
    pub fn is_near_marker(&self, distance: f64) -> bool {
        let (Some(marker), Some(before)) = (self.marker, self.before) else {
            return false;
        };
        let blurs = marker.depth * before.inverse_blur;
        let reach = (blurs - MARKER_CLEARANCE).max(blurs.min(MIN_REACH));
        marker.side * distance * before.inverse_blur > reach
    }

    /// Light that a marker removes, over the contrast.
    fn marker_loss(&self, point: Vector2<f64>, distance: f64) -> f64 {
        let (Some(marker), Some(before), Some(after)) = (self.marker, self.before, self.after)
        else {
            return 0.0;
        };
        let within = [
            (marker.side * distance - marker.depth) * before.inverse_blur,
            before.blurs(point) - marker.margin * before.inverse_blur,
            -after.blurs(point) - marker.margin * after.inverse_blur,
        ];
        if within.iter().any(|blurs| *blurs < -COMPLETE_BLURS) {
            return 0.0;
        }
        within.iter().map(|blurs| cdf_and_pdf(*blurs).0).product()
    }

    /// The flip of two pixels and all between them, if it is the same for all.
    pub fn constant_flip(&self, ends: [(Vector2<f64>, f64); 2]) -> Option<Flip> {
        let is_far = |crossing: &Crossing, side: f64| {
            ends.iter().all(|(point, distance)| {
                let line = self.lines_beside[usize::from(*distance > 0.0)];
                let clear = line.distance - distance.abs();
                side * crossing.blurs(*point) > COMPLETE_BLURS
                    && clear * crossing.inverse_blur > COMPLETE_BLURS
            })
        };
        let all = self.before.is_none_or(|c| is_far(c, 1.0))
            && self.after.is_none_or(|c| is_far(c, -1.0));
        let inverse_blur = self.inverse_blur();
        let is_dark = |tag: &TagCells| {
            ends.iter()
                .all(|(point, _)| tag.is_far(*point, inverse_blur))
        };
        (all && self.marker.is_none() && self.tag.is_none_or(is_dark)).then_some(Flip {
            slope: self.sign,
            shift: 0.0,
        })
    }
}

impl Crossing {
    fn new(
        point: Vector2<f64>,
        crossing_direction: Vector2<f64>,
        shape: EdgeShape,
        (curve, sign): (&ChordCurve, f64),
    ) -> Self {
        let normal = Vector2::new(-crossing_direction.y, crossing_direction.x);
        let forward = normal * normal.dot(&curve.along).signum();
        Self {
            s: curve.local(point).0,
            point,
            forward,
            inverse_blur: 1.0 / shape.blur,
            spread: shape.spread / shape.blur,
            angle: Angle::from_cosine(forward.dot(&curve.across)),
            sign,
            lines_beside: [LineBeside::NONE; 2],
            marker: None,
        }
    }

    /// The same crossing, moved to where the fitted curves meet.
    fn moved_to(&self, curve: &ChordCurve, crossing_line: &ChordCurve, shape: EdgeShape) -> Self {
        let (mut point, mut forward, mut cosine) = (self.point, self.forward, self.angle.rho);
        for _ in 0..STEPS {
            let (s, _) = curve.local(point);
            let on_curve = curve.point(s, 0.0);
            let normal = curve.point(s, 1.0) - on_curve;
            let along = Vector2::new(normal.y, -normal.x);
            let (t, _) = crossing_line.local(on_curve);
            let across = crossing_line.point(t, 1.0) - crossing_line.point(t, 0.0);
            let crossing_rate = across.dot(&along);
            if crossing_rate == 0.0 {
                return *self;
            }
            point = on_curve - along * (crossing_line.signed_distance(on_curve) / crossing_rate);
            forward = across * crossing_rate.signum();
            cosine = forward.dot(&normal);
        }
        Self {
            s: curve.local(point).0,
            point,
            forward,
            inverse_blur: 1.0 / shape.blur,
            spread: shape.spread / shape.blur,
            angle: Angle::from_cosine(cosine),
            ..*self
        }
    }

    fn blurs(&self, point: Vector2<f64>) -> f64 {
        self.forward.dot(&(point - self.point)) * self.inverse_blur
    }

    /// `(e - rho d) / sqrt(1 - rho^2)` for an edge parallel to this line at a distance from the
    /// point: the distance in blurs, along that edge, from the crossing line to the point's foot.
    fn skewed(&self, point: Vector2<f64>, distance: f64) -> f64 {
        let Angle { rho, sine, .. } = self.angle;
        (self.blurs(point) - rho * (distance * self.inverse_blur)) / sine
    }

    /// The flip, from a slope of -1 before the crossing to 1 after it.
    fn flip(&self, point: Vector2<f64>, distance: f64) -> Flip {
        let (line_blurs, crossing_blurs) = (distance * self.inverse_blur, self.blurs(point));
        let skewed = self.skewed(point, distance);
        if crossing_blurs.min(skewed) > ROUNDING_BLURS {
            return Flip::NONE;
        }
        if crossing_blurs.max(skewed) < -ROUNDING_BLURS {
            return Flip::NONE.opposite();
        }
        let line_step = step(line_blurs);
        let slope = step(skewed);
        let mut value = line_step * step(crossing_blurs);
        if line_blurs.abs() < COMPLETE_BLURS && crossing_blurs.abs() < COMPLETE_BLURS {
            value += self.angle.excess(line_blurs, crossing_blurs);
        }
        Flip {
            slope,
            shift: value - line_step * slope,
        }
    }
}

/// The angle between two crossing lines.
#[derive(Debug, Clone, Copy)]
struct Angle {
    /// Cosine of the angle between the normals: the correlation of the distances from the two lines
    /// under isotropic blur.
    rho: f64,
    sine: f64,
    /// For each node the correlation, `1 / (1 - correlation^2)`, and the node's weight.
    nodes: [[f64; 3]; NODES.len()],
    /// Number of nodes in use.
    used: usize,
}

impl Angle {
    fn from_cosine(cosine: f64) -> Self {
        let rho = cosine.clamp(-MAX_CORRELATION, MAX_CORRELATION);
        let half_angle = 0.5 * rho.asin();
        let node = |(node, weight): (f64, f64)| {
            let sine = (half_angle * (1.0 + node)).sin();
            let scale = 1.0 / (1.0 - sine * sine);
            [sine, scale, FRAC_2_PI * half_angle * weight]
        };
        let chosen: &[(f64, f64)] = if rho.abs() <= MAX_FEW_CORRELATION {
            &FEW_NODES
        } else {
            &NODES
        };
        let mut nodes = [[0.0; 3]; NODES.len()];
        for (entry, chosen) in nodes.iter_mut().zip(chosen) {
            *entry = node(*chosen);
        }
        Self {
            rho,
            sine: (1.0 - rho * rho).sqrt(),
            nodes,
            used: chosen.len(),
        }
    }

    /// Increase of the expectation over the product of the two steps by the correlation.
    fn excess(&self, d: f64, e: f64) -> f64 {
        let (squares, product) = (0.5 * (d * d + e * e), d * e);
        let nodes = self.nodes[..self.used].iter();
        nodes
            .map(|[sine, scale, weight]| weight * ((sine * product - squares) * scale).exp())
            .sum()
    }
}

/// A blurred step from -1 to 1.
fn step(blurs: f64) -> f64 {
    2.0 * cdf_and_pdf(blurs).0 - 1.0
}

impl EdgeSpan {
    /// Sign of the contrast after a crossing of the given number, relative to that after the first.
    pub(super) fn contrast_sign(&self, number: usize) -> f64 {
        let first = self.crossings.first().map_or(0, |first| first.1);
        if number.abs_diff(first).is_multiple_of(2) {
            1.0
        } else {
            -1.0
        }
    }

    /// Ranges of `s` between crossings that are neighbours in the list but not on the board.
    pub(super) fn gaps(&self, curve: &ChordCurve) -> Vec<[f64; 2]> {
        let pairs = self.crossings.windows(2).zip(self.path.windows(2));
        let gaps = pairs.filter(|(numbers, _)| numbers[1].1.abs_diff(numbers[0].1) > 1);
        gaps.map(|(_, ends)| [curve.local(ends[0]).0, curve.local(ends[1]).0])
            .collect()
    }
}

/// Direction of a line's coarse path where another one crosses it.
fn direction_at(spans: &[EdgeSpan], line: usize, crossing_line: usize) -> Option<Vector2<f64>> {
    let place = crossing_index(spans, line, crossing_line)?;
    let path = &spans[line].path;
    let before = path.get(place.saturating_sub(1))?;
    let after = path.get(place + 1).or(path.get(place))?;
    (after - before).try_normalize(f64::MIN_POSITIVE)
}

/// The marker in the light cell beside the stretch after a crossing, if there is one.
fn marker_after(spans: &[EdgeSpan], index: usize, number: usize) -> Option<Marker> {
    let span = &spans[index];
    let rim = *span.rims.get(number).filter(|rim| **rim > 0.0)?;
    let ends = [*span.path.get(number)?, *span.path.get(number + 1)?];
    let along = (ends[1] - ends[0]).try_normalize(f64::MIN_POSITIVE)?;
    let side = span.polarity.signum() * span.contrast_sign(span.crossings.get(number)?.1);
    let [cell_depth, across_depth] = [side, -side].map(|side| {
        let depths = [number, number + 1].into_iter().filter_map(|end| {
            line_distances(spans, index, end, side * along)
                .first()
                .copied()
        });
        depths.reduce(|one, other| 0.5 * (one + other))
    });
    // A cell at the board's rim is about as deep as its neighbour across the line.
    let (cell_depth, across_depth) = (cell_depth.or(across_depth)?, across_depth.or(cell_depth)?);
    // The change of scale by perspective, for lines at equal distances.
    let narrowing = (across_depth - cell_depth) / (across_depth + cell_depth);
    Some(Marker {
        side,
        depth: rim * cell_depth * (1.0 + narrowing) / (1.0 + rim * narrowing),
        margin: rim * (ends[1] - ends[0]).norm(),
    })
}

/// The dark tag beside the stretch after a crossing, if its cells are known.
fn tag_after(spans: &[EdgeSpan], index: usize, number: usize) -> Option<TagCells> {
    let span = &spans[index];
    let cells = span.tags.get(number).filter(|cells| !cells.is_empty())?;
    let near = [*span.path.get(number)?, *span.path.get(number + 1)?];
    let along = (near[1] - near[0]).try_normalize(f64::MIN_POSITIVE)?;
    // The side of the dark cell.
    let side = -span.polarity.signum() * span.contrast_sign(span.crossings.get(number)?.1);
    let opposite = |end| {
        next_crossings(spans, index, end, side * along)?
            .first()
            .copied()
    };
    let far = [opposite(number)?, opposite(number + 1)?];
    TagCells::new(near, far, span.tag_border, cells)
}
