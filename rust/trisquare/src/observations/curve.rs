//! The curve of a side's samples: a straight line, or a circle about the figure's origin.

use nalgebra::Vector2;

use crate::geometry::Line;

/// A curve of a figure, in its own coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Curve {
    Line(Line),
    /// About the origin.
    Circle(Radius),
}

/// The radius of a circle.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Radius {
    Known(f64),
    /// Estimated: its index among the estimated radii of its figure.
    Free(usize),
}

/// A straight line to which the distances of samples are measured: that of a side, or a tangent of
/// a circle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelLine {
    pub line: Line,
    /// Index of the radius that is its distance from the origin, if that radius is estimated.
    pub radius: Option<usize>,
}

impl ModelLine {
    /// Returns the tangent of a circle, with its normal outward.
    pub fn tangent(outward: Vector2<f64>, radius: f64, index: Option<usize>) -> Self {
        Self {
            line: Line::with_unit_normal(outward, outward * radius),
            radius: index,
        }
    }
}

impl From<Line> for ModelLine {
    fn from(line: Line) -> Self {
        Self { line, radius: None }
    }
}
