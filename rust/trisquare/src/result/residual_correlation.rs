//! How far the residuals are from independent noise.

use nalgebra::DMatrix;

/// Sides are said to err together where that is likelier than not.
const LIKELIER: f64 = 0.5;

/// How the residuals differ from independent noise of the stated standard deviations.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ResidualCorrelation {
    /// Variance of the mean of many neighbouring samples over what independent ones would have.
    pub neighbours: f64,
    /// Probability that the samples of a side share an error beyond their noise.
    pub probability: f64,
    /// Root mean square of that error where there is one, for every plane, px.
    pub displacements: Vec<f64>,
    /// Variance between the planes over what their sides' curvature lets
    /// expect; 1 where they agree.
    pub between_plane_variance_ratio: f64,
    /// Root mean square distance of the sides, as straight lines, from those of one camera, px.
    #[cfg_attr(feature = "serde", serde(default))]
    pub(crate) line_displacement: f64,
    /// Variance between groups of planes (the pictures, or the planes of one) over what all that
    /// lets expect; 1 where they agree, or are too few to tell.
    pub group_variance_ratio: f64,
    /// From the lowest to the highest place of every plane's relief, over its extent; 0 where planes
    /// are taken for flat.
    pub heights: Vec<f64>,
    /// What all that adds to the covariance of the free parameters.
    pub added: DMatrix<f64>,
    /// Variance of the samples over what pixels of independent noise would give them, if their
    /// stated standard deviations are those.
    pub(crate) pixels: f64,
}

impl ResidualCorrelation {
    /// Independent noise.
    pub(crate) fn none(planes: usize, parameters: usize) -> Self {
        Self {
            neighbours: 1.0,
            probability: 0.0,
            displacements: vec![0.0; planes],
            between_plane_variance_ratio: 1.0,
            line_displacement: 0.0,
            group_variance_ratio: 1.0,
            heights: vec![0.0; planes],
            added: DMatrix::zeros(parameters, parameters),
            pixels: 1.0,
        }
    }

    /// Whether sides err together, likelier than not.
    pub fn is_likely(&self) -> bool {
        self.probability > LIKELIER
    }
}
