//! A chessboard given by its inner corners: the grid lines to measure, and the resulting figure.

use nalgebra::Vector2;

use super::edge_shift::{CellSample, GridLineSamples, alternation, remove_edge_shift};
use super::plane_edges::PlaneEdges;
use super::sample_checks::check_places;
use crate::error::Error;
use crate::geometry::Line;
use crate::image::{Picture, Tone};
use crate::localise::{EdgeSpan, NoEdge, SpanEdges};

/// Distance from a grid line, in cells, at which the shade of a cell is read.
const PROBE: f64 = 0.25;

/// Minimum number of grid lines in each direction: three parallel ones out of four do not determine
/// the plane.
const MIN_LINES: usize = 2;

/// A chessboard whose inner corners are known to a pixel or two, from any detector.
///
/// ```
/// use nalgebra::Vector2;
/// use trisquare::{Chessboard, Error, Picture, PlaneEdges, localise_with_unknown_tone};
///
/// fn measured(picture: &Picture, corners: &[Vec<Vector2<f64>>]) -> Result<PlaneEdges, Error> {
///     let board = Chessboard::new(picture, corners)?;
///     let (lines, _, faults) = localise_with_unknown_tone(picture, &board.spans(0));
///     Ok(PlaneEdges {
///         side_error: faults.line_error,
///         ..board.edges(&lines)?
///     })
/// }
/// ```
#[derive(Debug, Clone)]
pub struct Chessboard {
    /// The rows, then the columns.
    lines: Vec<GridLine>,
    rows: usize,
}

/// A line through corners; light and dark change sides at each corner.
#[derive(Debug, Clone)]
struct GridLine {
    /// The line on the board; the unit is a cell.
    line: Line,
    /// Its corners, pixels.
    path: Vec<Vector2<f64>>,
    /// As [`EdgeSpan::polarity`].
    polarity: f64,
}

impl Chessboard {
    /// Creates a board from `corners[row][column]`, pixels; the picture shows which cells are dark.
    ///
    /// The board's origin is the first corner, its Y axis runs along the columns and its X axis
    /// along the rows, or against them if Z would otherwise point towards the camera. The unit is
    /// the side of a cell.
    ///
    /// # Errors
    /// [`Error::TooFewParallels`] for fewer than two rows or columns, [`Error::InvalidArgument`]
    /// for rows of different length, and [`Error::SampleNotFinite`] with the row as the line.
    pub fn new(picture: &Picture, corners: &[Vec<Vector2<f64>>]) -> Result<Self, Error> {
        let width = corners.first().map_or(0, Vec::len);
        check_families(corners.len(), width)?;
        for (row, row_corners) in corners.iter().enumerate() {
            if row_corners.len() != width {
                return Err(Error::InvalidArgument(format!(
                    "row {row} of the chessboard has {} corners, but row 0 has {width}",
                    row_corners.len()
                )));
            }
            check_places(0, row, row_corners)?;
        }
        let column = |place| corners.iter().map(|row: &Vec<_>| row[place]).collect();
        let columns: Vec<Vec<_>> = (0..width).map(column).collect();
        let right = corners[0][width - 1] - corners[0][0];
        let down = corners[corners.len() - 1][0] - corners[0][0];
        let x_axis = Vector2::x() * right.perp(&down).signum();
        let mut lines = family(picture, corners.to_vec(), Vector2::y());
        lines.extend(family(picture, columns, x_axis));
        Ok(Self {
            lines,
            rows: corners.len(),
        })
    }

    /// Returns the spans to measure by [`localise`](crate::localise) or
    /// [`localise_with_unknown_tone`](crate::localise_with_unknown_tone): the rows, then the
    /// columns. `first` is the index of the first one among all spans of the picture.
    #[must_use]
    pub fn spans(&self, first: usize) -> Vec<EdgeSpan> {
        let span = |(index, grid_line): (usize, &GridLine)| {
            let crossing_offset = if index < self.rows { self.rows } else { 0 };
            let crossing = |place| (Some(first.saturating_add(crossing_offset + place)), place);
            EdgeSpan {
                crossings: (0..grid_line.path.len()).map(crossing).collect(),
                ..EdgeSpan::new(grid_line.path.clone(), grid_line.polarity)
            }
        };
        self.lines.iter().enumerate().map(span).collect()
    }

    /// Returns the board from the measurements along its spans, in their order, without the lines
    /// that could not be measured.
    ///
    /// The shift of its edges by a wrong tone curve or clipped white is removed, as by
    /// [`remove_edge_shift`], so that the board has no [`tone_drift`](PlaneEdges::tone_drift).
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if there is not one element for each span,
    /// [`Error::TooFewParallels`] if fewer than two rows, or columns, were measured.
    pub fn edges(&self, measured: &[Result<SpanEdges, NoEdge>]) -> Result<PlaneEdges, Error> {
        if measured.len() != self.lines.len() {
            return Err(Error::InvalidArgument(format!(
                "the chessboard has {} spans, but {} are measured",
                self.lines.len(),
                measured.len()
            )));
        }
        let rows = measured[..self.rows].iter().flatten().count();
        let columns = measured[self.rows..].iter().flatten().count();
        check_families(rows, columns)?;
        let pairs = self.lines.iter().zip(measured);
        let pairs = pairs.filter_map(|(line, samples)| Some((line, samples.as_ref().ok()?)));
        let (lines, mut samples): (Vec<_>, Vec<_>) = pairs
            .map(|(grid_line, samples)| (grid_line.line, grid_line.samples(samples)))
            .unzip();
        remove_edge_shift(&mut samples);
        let line_points =
            |line: &GridLineSamples| line.samples.iter().map(|sample| sample.point).collect();
        let points = samples.iter().map(line_points).collect();
        let line_stds =
            |line: &GridLineSamples| line.samples.iter().map(|sample| sample.std).collect();
        Ok(PlaneEdges {
            std: Some(samples.iter().map(line_stds).collect()),
            ..PlaneEdges::new(lines, points)
        })
    }
}

impl GridLine {
    /// Returns the samples of the line with the cells that they are beside.
    fn samples(&self, measured: &SpanEdges) -> GridLineSamples {
        let along = self.path[self.path.len() - 1] - self.path[0];
        let inner = &self.path[1..self.path.len() - 1];
        let sample = |(point, std): (&Vector2<f64>, &f64)| CellSample {
            point: *point,
            std: *std,
            cell: inner.partition_point(|corner| corner.dot(&along) < point.dot(&along)),
        };
        let pairs = measured.points.iter().zip(&measured.std);
        GridLineSamples {
            samples: pairs.map(sample).collect(),
            contrast_sign: self.polarity,
        }
    }
}

fn check_families(rows: usize, columns: usize) -> Result<(), Error> {
    let found = rows.min(columns);
    if found < MIN_LINES {
        return Err(Error::TooFewParallels {
            figure: 0,
            found,
            needed: MIN_LINES,
        });
    }
    Ok(())
}

/// Returns the rows or the columns as grid lines, one unit apart along an axis.
fn family(picture: &Picture, paths: Vec<Vec<Vector2<f64>>>, axis: Vector2<f64>) -> Vec<GridLine> {
    let first_polarity = first_line_polarity(picture, &paths);
    let line = |(number, path): (usize, _)| GridLine {
        line: Line::with_unit_normal(axis.abs(), axis * number as f64),
        path,
        polarity: first_polarity * alternation(number),
    };
    paths.into_iter().enumerate().map(line).collect()
}

/// Returns +1 if the picture gets lighter toward the right-hand normal of line 0 after its corner
/// 0, else -1. All stretches of all lines are used, because a cell may be hidden.
fn first_line_polarity(picture: &Picture, lines: &[Vec<Vector2<f64>>]) -> f64 {
    let reader = picture.reader(Tone::Srgb);
    let shade = |point: Vector2<f64>| reader.bilinear(point.x, point.y);
    let mut sum = 0.0;
    for (number, line) in lines.iter().enumerate() {
        for (place, ends) in line.windows(2).enumerate() {
            let along = ends[1] - ends[0];
            let normal = PROBE * Vector2::new(-along.y, along.x);
            let middle = 0.5 * (ends[0] + ends[1]);
            if let (Some(right), Some(left)) = (shade(middle + normal), shade(middle - normal)) {
                sum += alternation(number + place) * (right - left);
            }
        }
    }
    1f64.copysign(sum)
}
