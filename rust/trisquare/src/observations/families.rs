//! Two orthogonal families of parallel lines on a plane, whose offsets are unknown.
//!
//! The outermost two lines of each family form a rectangle of unknown aspect: four lines determine
//! the plane's homography up to a stretch. Every further line adds one unknown, its offset.

use nalgebra::Vector2;

use super::plane_edges::{Freedom, PlaneEdges, rectangle_lines};
use crate::error::Error;
use crate::geometry::{Line, MIN_LINE_SAMPLES};

/// Minimum number of lines of each family that determines a plane.
const MIN_LINES: usize = 2;

/// Straight approximation of a line in the picture, which a lens may bend.
struct Chord {
    line: Line,
    middle: Vector2<f64>,
    ends: [Vector2<f64>; 2],
    /// Largest distance of the samples from it, in pixels.
    deviation: f64,
}

impl Chord {
    /// `None` if the samples have no direction.
    fn of(points: &[Vector2<f64>]) -> Option<Self> {
        let line = Line::fit(points.iter().map(|point| (*point, 1.0)))?;
        let along = |point: &&Vector2<f64>| line.normal().perp(point);
        let ends = [
            points.iter().min_by(|a, b| along(a).total_cmp(&along(b)))?,
            points.iter().max_by(|a, b| along(a).total_cmp(&along(b)))?,
        ];
        let distances = points.iter().map(|point| line.distance(point).abs());
        Some(Self {
            line,
            middle: points.iter().sum::<Vector2<f64>>() / points.len() as f64,
            ends: ends.map(|end| *end),
            deviation: distances.fold(0.0, f64::max),
        })
    }

    /// Whether two chords cross between their ends by more than noise and distortion explain.
    fn crosses(&self, other: &Self) -> bool {
        let tolerance = self.deviation.max(other.deviation);
        let passes = |chord: &Self, line: &Line| {
            let [first, last] = chord.ends.map(|end| line.distance(&end));
            first * last < 0.0 && first.abs().min(last.abs()) > tolerance
        };
        passes(self, &other.line) && passes(other, &self.line)
    }

    fn distance(&self, other: &Self) -> f64 {
        self.line.distance(&other.middle).abs() + other.line.distance(&self.middle).abs()
    }
}

/// Returns the outermost two lines of each family as the sides of a rectangle: clockwise on the
/// screen, the first along X, the second the later one along Y.
///
/// # Errors
/// [`Error::InvalidArgument`] if a line runs neither along X nor along Y,
/// [`Error::TooFewParallels`], [`Error::CrossedParallels`].
pub(super) fn outermost_lines(
    figure: usize,
    lines: &[Line],
    points: &[Vec<Vector2<f64>>],
) -> Result<[usize; 4], Error> {
    let runs_along = |line: &Line, across: Vector2<f64>| line.normal().dot(&across) == 0.0;
    let family = |across| {
        let indices = (0..lines.len()).filter(|line| runs_along(&lines[*line], across));
        indices.collect::<Vec<_>>()
    };
    let (along_x, along_y) = (family(Vector2::x()), family(Vector2::y()));
    if along_x.len() + along_y.len() != lines.len() {
        return Err(Error::InvalidArgument(format!(
            "a line of figure {figure} runs neither along X nor along Y"
        )));
    }
    let found = along_x.len().min(along_y.len());
    if found < MIN_LINES {
        return Err(Error::TooFewParallels {
            figure,
            found,
            needed: MIN_LINES,
        });
    }
    let chord = |(line, points): (usize, &Vec<_>)| {
        Chord::of(points).ok_or(Error::TooFewSamples {
            figure,
            line,
            found: 1,
            needed: MIN_LINE_SAMPLES,
        })
    };
    let chords = points.iter().enumerate().map(chord);
    let chords = chords.collect::<Result<Vec<_>, _>>()?;
    let [low, high] = farthest_apart(figure, &along_x, &chords)?;
    let [left, right] = farthest_apart(figure, &along_y, &chords)?;
    Ok(
        match turns_clockwise([low, right, high, left].map(|line| &chords[line].line)) {
            true => [low, right, high, left],
            false => [high, right, low, left],
        },
    )
}

impl PlaneEdges {
    /// Returns, for two families of lines, the rectangle of unknown aspect that the outermost ones
    /// form, whose sides need not be at right angles; any other figure unchanged.
    pub(crate) fn as_rectangle(&self) -> Self {
        let outermost = match self.freedom {
            Freedom::Offsets => outermost_lines(0, &self.lines, &self.points).ok(),
            _ => None,
        };
        let Some(sides) = outermost else {
            return self.clone();
        };
        fn select_sides<T: Clone>(lines: &[Vec<T>], sides: [usize; 4]) -> Vec<Vec<T>> {
            sides.iter().map(|side| lines[*side].clone()).collect()
        }
        let chosen = |lines: &Vec<Vec<f64>>| select_sides(lines, sides);
        Self {
            lines: rectangle_lines(1.0, 1.0).to_vec(),
            points: select_sides(&self.points, sides),
            std: self.std.as_ref().map(chosen),
            tone_drift: self
                .tone_drift
                .as_ref()
                .map(|drift| select_sides(drift, sides)),
            freedom: Freedom::Aspect,
            ..self.clone()
        }
    }
}

/// Returns the two lines of a family that are farthest apart, in the order given.
fn farthest_apart(figure: usize, family: &[usize], chords: &[Chord]) -> Result<[usize; 2], Error> {
    let mut farthest = (-1.0, [0, 0]);
    for (place, first) in family.iter().enumerate() {
        for second in &family[place + 1..] {
            let pair = [*first, *second];
            let [first_chord, second_chord] = pair.map(|line| &chords[line]);
            if first_chord.crosses(second_chord) {
                return Err(Error::CrossedParallels {
                    figure,
                    lines: pair,
                });
            }
            let distance = first_chord.distance(second_chord);
            if distance > farthest.0 {
                farthest = (distance, pair);
            }
        }
    }
    Ok(farthest.1)
}

/// Whether four lines follow each other clockwise on the screen (x right, y down).
fn turns_clockwise(sides: [&Line; 4]) -> bool {
    let corner = |i: usize| sides[(i + 3) % 4].intersection(sides[i]);
    let corners: Option<Vec<_>> = (0..4).map(corner).collect();
    let twice_area = |corners: Vec<Vector2<f64>>| {
        let edges = (0..4).map(|i| corners[i].perp(&corners[(i + 1) % 4]));
        edges.sum::<f64>()
    };
    corners.map(twice_area).is_none_or(|area| area > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observations::PlaneEdges;

    /// Samples of a line that a lens bends by `bend` pixels.
    fn bent(from: (f64, f64), to: (f64, f64), bend: f64) -> Vec<Vector2<f64>> {
        let (a, b) = (Vector2::new(from.0, from.1), Vector2::new(to.0, to.1));
        let across = Vector2::new(a.y - b.y, b.x - a.x).normalize();
        let at = |t: f64| a.lerp(&b, t) + across * (bend * t * (1.0 - t) * 4.0);
        (0..21).map(|i| at(f64::from(i) / 20.0)).collect()
    }

    fn level(y: f64) -> Vec<Vector2<f64>> {
        bent((100.0, y), (500.0, 1.1 * y), 0.0)
    }

    fn upright(x: f64) -> Vec<Vector2<f64>> {
        bent((x, 100.0), (1.05 * x, 400.0), 0.0)
    }

    fn outermost(edges: &PlaneEdges) -> [usize; 4] {
        outermost_lines(0, &edges.lines, &edges.points).unwrap()
    }

    #[test]
    fn the_outermost_lines_go_round_clockwise() {
        let levels = vec![level(200.0), level(350.0), level(120.0)];
        let uprights = vec![upright(300.0), upright(150.0), upright(480.0)];
        let edges = PlaneEdges::families(levels.clone(), uprights.clone()).unwrap();
        assert_eq!(outermost(&edges), [2, 5, 1, 4]);
        // X runs to the left now, and Y up.
        let turned = uprights.into_iter().rev().collect();
        let edges = PlaneEdges::families(levels, turned).unwrap();
        assert_eq!(outermost(&edges), [1, 4, 2, 3]);
    }

    #[test]
    fn lines_that_cross_are_no_family_and_bent_ones_may_be() {
        let uprights = || vec![upright(150.0), upright(480.0)];
        let crossing = vec![
            level(200.0),
            level(300.0),
            bent((100.0, 180.0), (500.0, 360.0), 0.0),
        ];
        let refused = PlaneEdges::families(crossing, uprights());
        assert!(matches!(
            refused,
            Err(Error::CrossedParallels { lines: [0, 2], .. })
        ));
        let long = bent((100.0, 200.0), (900.0, 200.0), 20.0);
        let short = bent((180.0, 218.0), (300.0, 232.0), 0.5);
        assert!(PlaneEdges::families(vec![long, short, level(350.0)], uprights()).is_ok());
    }

    #[test]
    fn one_line_is_no_family() {
        let refused = PlaneEdges::families(vec![level(200.0); 4], vec![upright(150.0)]);
        assert!(matches!(
            refused,
            Err(Error::TooFewParallels { found: 1, .. })
        ));
        let mut edges =
            PlaneEdges::families(vec![level(200.0); 2], vec![upright(150.0); 2]).unwrap();
        edges.lines[0] = Line::new(0.6, 0.8, 0.0).unwrap();
        assert!(edges.check(0).is_err());
    }
}
