//! What the samples of a side lie on: a straight line, or a circle about the figure's origin.

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
    /// Estimated: its index among those of its figure.
    Free(usize),
}

/// A straight line that samples are measured against: that of a side, or a tangent of a circle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ModelLine {
    pub line: Line,
    /// Index of the radius that is its distance from the origin, if that is estimated.
    pub radius: Option<usize>,
}

impl ModelLine {
    /// The tangent of a circle, its normal outward.
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
