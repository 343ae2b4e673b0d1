//! The samples of all figures, sorted by the plane they stand on.

use std::collections::HashMap;

use nalgebra::Vector2;

use super::families::outermost_lines;
use super::plane_edges::{Freedom, PlaneEdges, rectangle_lines};
use super::relief::BoardRelief;
use crate::error::Error;
use crate::geometry::Line;

/// One sample: where it was measured, and how well.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub pixel: Vector2<f64>,
    /// One over its standard deviation across the line.
    pub weight: f64,
}

/// A line of a figure and the samples on its image.
#[derive(Debug, Clone)]
pub(crate) struct Side {
    /// Index of its line among those given of its figure.
    pub index: usize,
    pub line: Line,
    pub samples: Vec<Sample>,
    /// How far an error that the picture's samples share displaces each, per standard deviation
    /// (px); empty if there is none.
    pub tone_drift: Vec<Vector2<f64>>,
    /// Whether it turned out not to belong to the scene: it then follows the camera that the
    /// others determine.
    pub is_outlier: bool,
}

/// Sine of the angle below which two lines of a plane have one direction.
const PARALLEL: f64 = 0.1;

/// Weight of an outlier side over that of others: it still places its own plane where
/// nothing else does, and moves no camera.
const ASIDE: f64 = 1e-5;

impl Side {
    /// By how much its samples' weights are lowered.
    pub fn trust(&self) -> f64 {
        if self.is_outlier { ASIDE } else { 1.0 }
    }
}

/// A figure and its index among the edges given.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    pub index: usize,
    pub freedom: Freedom,
    pub sides: Vec<Side>,
}

/// A physical plane with its figures; the first one carries the plane's coordinates.
#[derive(Debug, Clone)]
pub(crate) struct ObservedPlane {
    pub image: usize,
    pub figures: Vec<Figure>,
    /// Out-of-plane shape of a board that is not flat; it has been removed from the samples.
    pub board_relief: Option<BoardRelief>,
    /// Standard deviation (px) of an error that the samples of a side share, known beforehand.
    pub side_error: f64,
}

impl Figure {
    pub fn samples(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.sides.iter().flat_map(|side| &side.samples)
    }
}

impl ObservedPlane {
    /// The same with at most so many samples of each side, evenly spread.
    pub fn subsampled(&self, samples_per_side: usize) -> Self {
        let mut subsampled = self.clone();
        for side in subsampled.sides_mut() {
            let step = side.samples.len().div_ceil(samples_per_side);
            side.samples = side.samples.iter().step_by(step).copied().collect();
            side.tone_drift = side.tone_drift.iter().step_by(step).copied().collect();
        }
        subsampled
    }

    /// Removes the tone drift, of so many standard deviations, from every sample.
    pub fn remove_tone_drift(&mut self, deviations: f64) {
        for side in self.sides_mut() {
            for (sample, tone_drift) in side.samples.iter_mut().zip(&side.tone_drift) {
                sample.pixel += tone_drift * deviations;
            }
        }
    }

    /// Whether an error that the picture's samples share displaces any of its own.
    pub fn has_tone_drift(&self) -> bool {
        self.sides().any(|side| !side.tone_drift.is_empty())
    }

    /// The largest displacement (px) of a sample by one standard deviation of such an error.
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

    /// Whether all sides are outliers.
    pub fn is_outlier(&self) -> bool {
        self.sides().all(|side| side.is_outlier)
    }

    /// Multiplies the weight of every sample.
    pub fn weigh(&mut self, factor: f64) {
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

/// Families of a figure's sides that count: those that run in one direction.
pub(crate) fn directions(figure: &Figure) -> Vec<Vec<usize>> {
    let normal = |side: usize| figure.sides[side].line.normal();
    let parallel = |a: usize, b: usize| normal(a).perp(&normal(b)).abs() < PARALLEL;
    let mut families: Vec<Vec<usize>> = Vec::new();
    for side in (0..figure.sides.len()).filter(|side| !figure.sides[*side].is_outlier) {
        match families.iter_mut().find(|family| parallel(family[0], side)) {
            Some(family) => family.push(side),
            None => families.push(vec![side]),
        }
    }
    families
}

/// Whether a figure has more than a square's lines in two directions.
pub(crate) fn has_grid(figure: &Figure) -> bool {
    let many = |family: &Vec<usize>| family.len() > 2;
    figure.sides.len() > 4 && directions(figure).into_iter().filter(many).count() >= 2
}

/// Checks all figures and sorts them by plane, in the order in which planes first appear.
pub(crate) fn sort_by_plane(edges: &[PlaneEdges]) -> Result<Vec<ObservedPlane>, Error> {
    let mut planes: Vec<ObservedPlane> = Vec::new();
    let mut known: HashMap<u64, usize> = HashMap::new();
    for (index, figure_edges) in edges.iter().enumerate() {
        figure_edges.check(index)?;
        let figures = figures(index, figure_edges)?;
        let place = figure_edges.plane.and_then(|key| known.get(&key).copied());
        match place {
            Some(place) if planes[place].image != figure_edges.image => {
                return Err(Error::InvalidArgument(format!(
                    "figure {index} shares a plane with a figure of another picture"
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
            }
            None => {
                if let Some(key) = figure_edges.plane {
                    known.insert(key, planes.len());
                }
                planes.push(ObservedPlane {
                    image: figure_edges.image,
                    figures,
                    board_relief: None,
                    side_error: figure_edges.side_error,
                });
            }
        }
    }
    Ok(planes)
}

/// The figure that is given; of families of lines, the rectangle of the outermost ones, and each
/// further line as a figure whose offset is free.
fn figures(index: usize, edges: &PlaneEdges) -> Result<Vec<Figure>, Error> {
    let sides = sides(edges);
    let figure = |freedom, sides| Figure {
        index,
        freedom,
        sides,
    };
    if edges.freedom != Freedom::Offsets {
        return Ok(vec![figure(edges.freedom, sides)]);
    }
    let outermost = outermost_lines(index, &edges.lines, &edges.points)?;
    let rectangle = outermost.into_iter().zip(rectangle_lines(1.0, 1.0));
    let rectangle = rectangle.map(|(side, line)| Side {
        line,
        ..sides[side].clone()
    });
    let mut figures = vec![figure(Freedom::Aspect, rectangle.collect())];
    for side in &sides {
        if !outermost.contains(&side.index) {
            let line = Line::with_unit_normal(side.line.normal(), Vector2::zeros());
            let side = Side {
                line,
                ..side.clone()
            };
            figures.push(figure(Freedom::Offsets, vec![side]));
        }
    }
    Ok(figures)
}

fn sides(edges: &PlaneEdges) -> Vec<Side> {
    edges
        .lines
        .iter()
        .zip(&edges.points)
        .enumerate()
        .map(|(side, (line, points))| Side {
            index: side,
            line: *line,
            is_outlier: false,
            samples: points
                .iter()
                .enumerate()
                .map(|(i, pixel)| Sample {
                    pixel: *pixel,
                    weight: edges.std.as_ref().map_or(1.0, |std| 1.0 / std[side][i]),
                })
                .collect(),
            tone_drift: edges
                .tone_drift
                .as_ref()
                .map_or_else(Vec::new, |tone_drift| tone_drift[side].clone()),
        })
        .collect()
}
