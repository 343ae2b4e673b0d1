//! How far the measured edges are from where a calibration says that they should be.

use nalgebra::Vector2;

/// How far the samples of a figure are from the images of its lines.
#[derive(Debug, Clone, PartialEq)]
pub struct FigureResiduals {
    /// Index of its plane among the calibration's planes.
    pub plane: usize,
    /// One for each of its lines, in the order in which they were given.
    pub sides: Vec<SideResiduals>,
}

/// How far the samples of a line are from its image, in the order in which they were given.
#[derive(Debug, Clone, PartialEq)]
pub struct SideResiduals {
    /// Signed distances, in pixels.
    pub distances: Vec<f64>,
    /// Unit normals of the line's image, towards which the distances are positive.
    pub normals: Vec<Vector2<f64>>,
}
