//! The samples of all figures, sorted by plane.

use std::collections::HashMap;

use nalgebra::Vector2;

use super::coinciding::{check_duplicates, check_place};
use super::curve::{Curve, Radius};
use super::deformation::Deformation;
use super::families::outermost_lines;
use super::plane_edges::{Freedom, PlaneEdges, rectangle_lines};
use super::relation::Relation;
use crate::error::Error;
use crate::geometry::Line;

/// One sample: its measured position and its weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub pixel: Vector2<f64>,
    /// Reciprocal of its standard deviation across the line.
    pub weight: f64,
    /// Its index among the samples of its curve.
    pub index: usize,
}

/// A line of a figure, or an arc of a circle, with the samples on its image.
#[derive(Debug, Clone)]
pub(crate) struct Side {
    pub curve: Curve,
    /// Index of the curve among those of its figure.
    pub number: usize,
    /// The samples in their order along the curve.
    pub samples: Vec<Sample>,
    /// Displacement of each sample (px) by one standard deviation of an error that the picture's
    /// samples share; empty if there is none.
    pub tone_drift: Vec<Vector2<f64>>,
    /// Whether the side is an outlier: it then has no influence on the camera, which the other
    /// sides determine.
    pub is_outlier: bool,
}

/// Sine of the angle below which two lines of a plane count as parallel.
const PARALLEL: f64 = 0.1;

/// Number of arcs of a circle, as a square has sides.
const ARCS: usize = 4;

/// Minimum number of samples of an arc.
const MIN_OF_ARC: usize = 2;

/// Weight of an outlier side relative to the others: it still determines its own plane where
/// nothing else does, but has no influence on the camera.
const OUTLIER_WEIGHT: f64 = 1e-5;

impl Side {
    /// Factor on the weights of its samples.
    pub fn weight_factor(&self) -> f64 {
        if self.is_outlier { OUTLIER_WEIGHT } else { 1.0 }
    }

    /// Returns the side's line, if it is straight.
    pub fn line(&self) -> Option<Line> {
        match self.curve {
            Curve::Line(line) => Some(line),
            Curve::Circle(_) => None,
        }
    }
}

/// A figure and its index among the given edges.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    pub index: usize,
    pub freedom: Freedom,
    pub sides: Vec<Side>,
}

/// A physical plane with its figures; the first one defines the plane's coordinates.
#[derive(Debug, Clone)]
pub(crate) struct ObservedPlane {
    pub image: usize,
    pub figures: Vec<Figure>,
    /// Out-of-plane shape of a board that is not flat; it has been removed from the samples.
    pub deformation: Option<Deformation>,
    /// Prior standard deviation (px) of an error that the samples of a side share.
    pub side_error: f64,
    /// Known relations to the planes of other figures, by the indices of these figures.
    pub relations: Vec<(usize, Relation)>,
}

impl Figure {
    pub fn samples(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.sides.iter().flat_map(|side| &side.samples)
    }

    /// Whether the figure consists of circles.
    pub fn is_round(&self) -> bool {
        self.sides[0].line().is_none()
    }

    /// Whether it has the four sides of a square.
    pub fn has_four_sides(&self) -> bool {
        self.sides.len() == 4 && !self.is_round()
    }
}

impl ObservedPlane {
    /// Returns the same plane with at most `samples_per_side` samples of each side, evenly spread.
    pub fn subsampled(&self, samples_per_side: usize) -> Self {
        let subsampled_side = |side: &Side| {
            let step = side.samples.len().div_ceil(samples_per_side).max(1);
            Side {
                samples: side.samples.iter().step_by(step).copied().collect(),
                tone_drift: side.tone_drift.iter().step_by(step).copied().collect(),
                ..*side
            }
        };
        let subsampled_figure = |figure: &Figure| Figure {
            sides: figure.sides.iter().map(subsampled_side).collect(),
            ..*figure
        };
        Self {
            figures: self.figures.iter().map(subsampled_figure).collect(),
            relations: self.relations.clone(),
            ..*self
        }
    }

    /// Removes a tone drift of `deviations` standard deviations from every sample.
    pub fn remove_tone_drift(&mut self, deviations: f64) {
        for side in self.sides_mut() {
            for (sample, tone_drift) in side.samples.iter_mut().zip(&side.tone_drift) {
                sample.pixel += tone_drift * deviations;
            }
        }
    }

    /// Whether an error that the picture's samples share displaces any sample of the plane.
    pub fn has_tone_drift(&self) -> bool {
        self.sides().any(|side| !side.tone_drift.is_empty())
    }

    /// Largest displacement (px) of a sample by one standard deviation of such an error.
    pub fn largest_tone_drift(&self) -> f64 {
        let drifts = self.sides().flat_map(|side| &side.tone_drift);
        drifts.map(|drift| drift.norm()).fold(0.0, f64::max)
    }

    /// Marks all sides as outliers.
    pub fn mark_as_outlier(&mut self) {
        for side in self.sides_mut() {
            side.is_outlier = true;
        }
    }

    /// All sides, in the order of the figures.
    pub fn sides_mut(&mut self) -> impl Iterator<Item = &mut Side> {
        self.figures.iter_mut().flat_map(|figure| &mut figure.sides)
    }

    /// Whether it shows a rectangle of unknown aspect.
    pub fn has_any_aspect(&self) -> bool {
        self.figures[0].freedom == Freedom::Aspect
    }

    /// Number of equations for the camera matrix: one where only the right angle between its sides
    /// is known and not their lengths, otherwise two.
    pub fn equation_count(&self) -> usize {
        let is_right_angle_only =
            |figure: &Figure| matches!(figure.freedom, Freedom::Aspect | Freedom::Offsets);
        match self.figures.iter().all(is_right_angle_only) {
            true => 1,
            false => 2,
        }
    }

    /// Whether all sides are outliers.
    pub fn is_outlier(&self) -> bool {
        self.sides().all(|side| side.is_outlier)
    }

    /// Multiplies the weight of every sample.
    pub fn scale_weights(&mut self, factor: f64) {
        for side in self.sides_mut() {
            side.samples.iter_mut().for_each(|s| s.weight *= factor);
        }
    }

    pub fn samples(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.figures.iter().flat_map(Figure::samples)
    }

    pub fn sides(&self) -> impl Iterator<Item = &Side> + Clone {
        self.figures.iter().flat_map(|figure| &figure.sides)
    }

    /// All sides with the indices of their figures.
    pub fn sides_by_figure(&self) -> impl Iterator<Item = (usize, &Side)> {
        let figures = self.figures.iter().enumerate();
        figures.flat_map(|(f, figure)| figure.sides.iter().map(move |side| (f, side)))
    }
}

/// Groups a figure's sides, without outliers, into families: sides that run in one direction, and
/// every arc by itself.
pub(crate) fn directions(figure: &Figure) -> Vec<Vec<usize>> {
    let line = |side: usize| figure.sides[side].line();
    let parallel = |a: usize, b: usize| match (line(a), line(b)) {
        (Some(a), Some(b)) => a.normal().perp(&b.normal()).abs() < PARALLEL,
        _ => false,
    };
    let mut families: Vec<Vec<usize>> = Vec::new();
    for side in (0..figure.sides.len()).filter(|side| !figure.sides[*side].is_outlier) {
        match families.iter_mut().find(|family| parallel(family[0], side)) {
            Some(family) => family.push(side),
            None => families.push(vec![side]),
        }
    }
    families
}

/// Whether a figure has more lines than a square in two directions.
pub(crate) fn has_grid(figure: &Figure) -> bool {
    let many = |family: &Vec<usize>| family.len() > 2;
    figure.sides.len() > 4 && directions(figure).into_iter().filter(many).count() >= 2
}

/// Checks the lines of the scene among the figures and returns each as a plane with one side.
pub(crate) fn lines_of_scene(edges: &[PlaneEdges]) -> Result<Vec<ObservedPlane>, Error> {
    let lines = edges
        .iter()
        .enumerate()
        .filter(|(_, figure_edges)| is_line(figure_edges));
    let observed = |(index, figure_edges): (usize, &PlaneEdges)| {
        figure_edges.check(index)?;
        Ok(ObservedPlane {
            image: figure_edges.image,
            figures: vec![figure(index, figure_edges)],
            deformation: None,
            side_error: figure_edges.side_error,
            relations: Vec::new(),
        })
    };
    lines.map(observed).collect()
}

fn is_line(edges: &PlaneEdges) -> bool {
    edges.freedom == Freedom::Line
}

/// Checks all figures and sorts them by plane, in the order in which planes first appear; lines of
/// the scene are left out.
pub(crate) fn sort_by_plane(edges: &[PlaneEdges]) -> Result<Vec<ObservedPlane>, Error> {
    check_duplicates(edges)?;
    let mut planes: Vec<ObservedPlane> = Vec::new();
    let mut known: HashMap<u64, usize> = HashMap::new();
    let figures_of_planes = edges
        .iter()
        .enumerate()
        .filter(|(_, figure_edges)| !is_line(figure_edges));
    for (index, figure_edges) in figures_of_planes {
        figure_edges.check(index)?;
        check_place(index, edges)?;
        let figures = figures(index, figure_edges)?;
        let place = figure_edges.plane.and_then(|key| known.get(&key).copied());
        match place {
            Some(place) if planes[place].image != figure_edges.image => {
                return Err(Error::InvalidArgument(format!(
                    "figure {index} shares a plane with a figure of another picture: give it a \
                     plane of its own"
                )));
            }
            Some(place) => {
                let plane = &mut planes[place];
                if plane.has_any_aspect() || figures[0].freedom == Freedom::Aspect {
                    return Err(Error::InvalidArgument(format!(
                        "figure {index} shares a plane with another, and one of them is of unknown \
                         aspect: give it a plane of its own"
                    )));
                }
                plane.figures.extend(figures);
                plane.side_error = plane.side_error.max(figure_edges.side_error);
                plane.relations.extend(&figure_edges.relations);
            }
            None => {
                if let Some(key) = figure_edges.plane {
                    known.insert(key, planes.len());
                }
                planes.push(ObservedPlane {
                    image: figure_edges.image,
                    figures,
                    deformation: None,
                    side_error: figure_edges.side_error,
                    relations: figure_edges.relations.clone(),
                });
            }
        }
    }
    planes
        .iter()
        .try_for_each(|plane| check_partners(plane, &planes))?;
    Ok(planes)
}

/// Refuses relations with figures that do not exist, are in another picture, or are on the same
/// plane.
fn check_partners(plane: &ObservedPlane, planes: &[ObservedPlane]) -> Result<(), Error> {
    let own = plane.figures[0].index;
    for (index, _) in &plane.relations {
        let shows = |other: &&ObservedPlane| other.figures.iter().any(|f| f.index == *index);
        let problem = match planes.iter().find(shows) {
            None => "which does not exist",
            Some(other) if other.image != plane.image => "which is in another picture",
            Some(other) if std::ptr::eq(other, plane) => "which is on its own plane",
            Some(_) => continue,
        };
        return Err(Error::InvalidArgument(format!(
            "figure {own} is related to figure {index}, {problem}"
        )));
    }
    Ok(())
}

/// Returns the given figure; for families of lines, the rectangle of the outermost ones, and each
/// further line as a figure whose offset is free.
fn figures(index: usize, edges: &PlaneEdges) -> Result<Vec<Figure>, Error> {
    let given = figure(index, edges);
    if edges.freedom != Freedom::Offsets {
        return Ok(vec![given]);
    }
    let figure = |freedom, sides| Figure {
        index,
        freedom,
        sides,
    };
    let moved = |side: &Side, line| Side {
        curve: Curve::Line(line),
        ..side.clone()
    };
    let outermost = outermost_lines(index, &edges.lines, &edges.points)?;
    let rectangle = outermost.into_iter().zip(rectangle_lines(1.0, 1.0));
    let rectangle = rectangle.map(|(side, line)| moved(&given.sides[side], line));
    let mut figures = vec![figure(Freedom::Aspect, rectangle.collect())];
    let further = given.sides.iter();
    for side in further.filter(|side| !outermost.contains(&side.number)) {
        let normal = edges.lines[side.number].normal();
        let line = Line::with_unit_normal(normal, Vector2::zeros());
        figures.push(figure(Freedom::Offsets, vec![moved(side, line)]));
    }
    Ok(figures)
}

fn figure(index: usize, edges: &PlaneEdges) -> Figure {
    let mut free = 0;
    let mut circle = |radius: &Option<f64>| {
        Curve::Circle(radius.map_or_else(
            || {
                free += 1;
                Radius::Free(free - 1)
            },
            Radius::Known,
        ))
    };
    let lines = edges.lines.iter().map(|line| Curve::Line(*line));
    let curves: Vec<Curve> = lines.chain(edges.radii.iter().map(&mut circle)).collect();
    let sides =
        curves
            .into_iter()
            .zip(&edges.points)
            .enumerate()
            .flat_map(|(number, (curve, points))| {
                let stretches = match curve {
                    Curve::Line(_) => vec![ordered_along_line(points)],
                    Curve::Circle(_) => arcs(points),
                };
                stretches
                    .into_iter()
                    .map(move |stretch| side(edges, (number, curve), &stretch))
            });
    Figure {
        index,
        freedom: edges.freedom,
        sides: sides.collect(),
    }
}

fn side(edges: &PlaneEdges, (number, curve): (usize, Curve), stretch: &[usize]) -> Side {
    let std = edges.std.as_ref().map(|std| &std[number]);
    let sample = |&index: &usize| Sample {
        pixel: edges.points[number][index],
        weight: std.map_or(1.0, |std| 1.0 / std[index]),
        index,
    };
    let drift = edges.tone_drift.iter().map(|drift| &drift[number]);
    Side {
        curve,
        number,
        is_outlier: false,
        samples: stretch.iter().map(sample).collect(),
        tone_drift: drift
            .flat_map(|drift| stretch.iter().map(|&i| drift[i]))
            .collect(),
    }
}

/// Returns the indices of a straight side's samples, from one end to the other.
fn ordered_along_line(points: &[Vector2<f64>]) -> Vec<usize> {
    let line = Line::fit(points.iter().map(|point| (*point, 1.0)));
    let normal = line.map_or_else(Vector2::zeros, |line| line.normal());
    let along = normal
        * match points {
            [first, .., last] if normal.perp(first) > normal.perp(last) => -1.0,
            _ => 1.0,
        };
    let mut places: Vec<(f64, usize)> = points.iter().map(|p| along.perp(p)).zip(0..).collect();
    places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    places.into_iter().map(|(_, index)| index).collect()
}

/// Divides the samples of a circle, in order around it from its widest gap on, into arcs of equal
/// numbers of samples: errors are correlated over parts of a circle as over parts of a line.
fn arcs(points: &[Vector2<f64>]) -> Vec<Vec<usize>> {
    let count = points.len();
    let middle = points.iter().sum::<Vector2<f64>>() / count as f64;
    let angle = |i: usize| (points[i].y - middle.y).atan2(points[i].x - middle.x);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| angle(*a).total_cmp(&angle(*b)));
    let gap = |i: &usize| {
        let before = order[(i + count - 1) % count];
        (angle(order[*i]) - angle(before)).rem_euclid(std::f64::consts::TAU)
    };
    let first = (0..count).max_by(|a, b| gap(a).total_cmp(&gap(b)));
    order.rotate_left(first.unwrap_or(0));
    let parts = (count / MIN_OF_ARC).clamp(1, ARCS);
    let part = |i: usize| order[i * count / parts..(i + 1) * count / parts].to_vec();
    (0..parts).map(part).collect()
}
