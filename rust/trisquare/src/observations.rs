//! The samples of all figures, sorted by the plane they stand on.

use std::collections::HashMap;

use nalgebra::{Vector2, Vector3};

use crate::paper::Relief;
use crate::{Error, Freedom, Line, PlaneEdges};

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
    pub line: Line,
    pub samples: Vec<Sample>,
    /// How far an error that the picture's samples share displaces each, per standard deviation
    /// (px); empty if there is none.
    pub drift: Vec<Vector2<f64>>,
    /// Whether it turned out not to belong to the scene: it then follows the camera that the
    /// others determine.
    pub set_aside: bool,
}

/// Weight of a side that was set aside, over that of others: it still places its own plane where
/// nothing else does, and moves no camera.
const ASIDE: f64 = 1e-5;

impl Side {
    /// By how much its samples' weights are lowered.
    pub fn trust(&self) -> f64 {
        if self.set_aside { ASIDE } else { 1.0 }
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
    /// Of a board whose paper is not flat: what its samples would be on flat paper.
    pub relief: Option<Relief>,
}

impl Figure {
    pub fn samples(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.sides.iter().flat_map(|side| &side.samples)
    }
}

impl ObservedPlane {
    /// The same with at most so many samples of each side, evenly spread.
    pub fn thinned(&self, samples_per_side: usize) -> Self {
        let mut thinned = self.clone();
        for side in thinned.figures.iter_mut().flat_map(|f| &mut f.sides) {
            let step = side.samples.len().div_ceil(samples_per_side);
            side.samples = side.samples.iter().step_by(step).copied().collect();
            side.drift = side.drift.iter().step_by(step).copied().collect();
        }
        thinned
    }

    /// Moves every sample to where it would be with its drift, of so many standard deviations, taken
    /// out.
    pub fn take_out_drift(&mut self, deviations: f64) {
        for side in self.figures.iter_mut().flat_map(|f| &mut f.sides) {
            for (sample, drift) in side.samples.iter_mut().zip(&side.drift) {
                sample.pixel += drift * deviations;
            }
        }
    }

    /// Whether an error that the picture's samples share displaces any of its own.
    pub fn drifts(&self) -> bool {
        self.sides().any(|side| !side.drift.is_empty())
    }

    /// Sets all sides aside.
    pub fn set_aside(&mut self) {
        for side in self.figures.iter_mut().flat_map(|f| &mut f.sides) {
            side.set_aside = true;
        }
    }

    /// A side by its index over all figures.
    pub fn side_mut(&mut self, index: usize) -> Option<&mut Side> {
        let sides = self.figures.iter_mut().flat_map(|figure| &mut figure.sides);
        sides.into_iter().nth(index)
    }

    /// Whether all sides are set aside.
    pub fn is_set_aside(&self) -> bool {
        self.sides().all(|side| side.set_aside)
    }

    /// Multiplies the weight of every sample.
    pub fn weigh(&mut self, factor: f64) {
        for side in self.figures.iter_mut().flat_map(|f| &mut f.sides) {
            side.samples.iter_mut().for_each(|s| s.weight *= factor);
        }
    }

    pub fn samples(&self) -> impl Iterator<Item = &Sample> + Clone {
        self.figures.iter().flat_map(Figure::samples)
    }

    pub fn sides(&self) -> impl Iterator<Item = &Side> + Clone {
        self.figures.iter().flat_map(|figure| &figure.sides)
    }
}

/// Checks all figures and sorts them by plane, in the order in which planes first appear.
pub(crate) fn sort_by_plane(edges: &[PlaneEdges]) -> Result<Vec<ObservedPlane>, Error> {
    let mut planes: Vec<ObservedPlane> = Vec::new();
    let mut known: HashMap<u64, usize> = HashMap::new();
    for (index, figure_edges) in edges.iter().enumerate() {
        figure_edges.check(index)?;
        let figure = figure(index, figure_edges);
        let place = figure_edges.plane.and_then(|key| known.get(&key).copied());
        match place {
            Some(place) if planes[place].image != figure_edges.image => {
                return Err(Error::InvalidArgument(format!(
                    "figure {index} shares a plane with a figure of another picture"
                )));
            }
            Some(place) => planes[place].figures.push(figure),
            None => {
                if let Some(key) = figure_edges.plane {
                    known.insert(key, planes.len());
                }
                planes.push(ObservedPlane {
                    image: figure_edges.image,
                    figures: vec![figure],
                    relief: None,
                });
            }
        }
    }
    Ok(planes)
}

fn figure(index: usize, edges: &PlaneEdges) -> Figure {
    let sides = edges
        .lines
        .iter()
        .zip(&edges.points)
        .enumerate()
        .map(|(side, (line, points))| Side {
            line: *line,
            set_aside: false,
            samples: points
                .iter()
                .enumerate()
                .map(|(i, pixel)| Sample {
                    pixel: *pixel,
                    weight: edges.std.as_ref().map_or(1.0, |std| 1.0 / std[side][i]),
                })
                .collect(),
            drift: edges
                .drift
                .as_ref()
                .map_or_else(Vec::new, |drift| drift[side].clone()),
        })
        .collect();
    Figure {
        index,
        freedom: edges.freedom,
        sides,
    }
}

/// A figure's place on its plane: `P_plane = scale R(angle) P_figure + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placement {
    pub scale: f64,
    pub angle: f64,
    pub shift: Vector2<f64>,
    /// How many of scale, angle, shift x, shift y are estimated: 0, 1 or 4.
    pub free: usize,
}

impl Placement {
    /// The plane's own coordinates.
    pub const IDENTITY: Self = Self {
        scale: 1.0,
        angle: 0.0,
        shift: Vector2::new(0.0, 0.0),
        free: 0,
    };

    /// The line `(a, b, c)` in the plane's coordinates: normal `R n`, offset
    /// `scale c - (R n) . shift`.
    pub fn line(&self, line: &Line) -> Vector3<f64> {
        let normal = self.rotate(line.normal());
        let offset = self.scale * line.coefficients().z - normal.dot(&self.shift);
        Vector3::new(normal.x, normal.y, offset)
    }

    /// Derivatives of [`Self::line`] with respect to scale, angle, shift x, shift y.
    pub fn line_derivatives(&self, line: &Line) -> [Vector3<f64>; 4] {
        let normal = self.rotate(line.normal());
        let turned = Vector2::new(-normal.y, normal.x);
        [
            Vector3::new(0.0, 0.0, line.coefficients().z),
            Vector3::new(turned.x, turned.y, -turned.dot(&self.shift)),
            Vector3::new(0.0, 0.0, -normal.x),
            Vector3::new(0.0, 0.0, -normal.y),
        ]
    }

    /// A point of the figure on the plane.
    pub fn point(&self, point: Vector2<f64>) -> Vector2<f64> {
        self.rotate(point) * self.scale + self.shift
    }

    /// The placement after a step of its free parameters.
    pub fn moved(&self, step: &[f64]) -> Self {
        let mut next = *self;
        if let [scale, rest @ ..] = step {
            next.scale += scale;
            if let [angle, x, y] = rest {
                next.angle += angle;
                next.shift += Vector2::new(*x, *y);
            }
        }
        next
    }

    fn rotate(&self, v: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.angle.sin_cos();
        Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placement_moves_lines_with_their_points() {
        let placement = Placement {
            scale: 0.6,
            angle: 0.7,
            shift: Vector2::new(0.1, -0.3),
            free: 4,
        };
        let line = Line::new(0.6, -0.8, 0.2).unwrap();
        let on_line = Vector2::new(0.4, 0.55);
        assert!(line.distance(&on_line).abs() < 1e-15);
        let moved = placement.line(&line);
        assert!(moved.dot(&placement.point(on_line).push(1.0)).abs() < 1e-15);

        for (i, derivative) in placement.line_derivatives(&line).iter().enumerate() {
            let mut step = [0.0; 4];
            step[i] = 1e-6;
            let forward = placement.moved(&step).line(&line);
            step[i] = -1e-6;
            let backward = placement.moved(&step).line(&line);
            assert!(((forward - backward) / 2e-6 - derivative).norm() < 1e-9);
        }
    }
}
