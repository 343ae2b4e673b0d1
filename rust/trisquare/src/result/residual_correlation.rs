//! Departure of the residuals from independent noise.

use nalgebra::DMatrix;

/// Probability above which sides are taken to have common errors.
const LIKELIER: f64 = 0.5;

/// Departure of the residuals from independent noise of the stated standard deviations.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ResidualCorrelation {
    /// Variance of the mean of many neighbouring samples, relative to that of independent ones.
    pub neighbours: f64,
    /// Probability that the samples of a side share an error beyond their noise.
    pub probability: f64,
    /// Root mean square of that error, if there is one, for every plane, px.
    pub displacements: Vec<f64>,
    /// Variance between the planes, relative to that expected from their sides' curvature; 1 where
    /// they agree.
    pub between_plane_variance_ratio: f64,
    /// Root mean square distance of the sides, as straight lines, from those of one camera, px.
    #[cfg_attr(feature = "serde", serde(default))]
    pub(crate) line_displacement: f64,
    /// Variance between groups of planes (the pictures, or the planes of one), relative to that
    /// expected from all the above; 1 where they agree, or are too few to tell.
    pub group_variance_ratio: f64,
    /// Height difference between the lowest and the highest place of every plane's sheet, over its
    /// extent; 0 for planes that are taken as flat.
    pub heights: Vec<f64>,
    /// Ratio of width to height of every plane's targets, relative to the stated one, minus 1; 0 for
    /// planes that are taken as exact.
    #[cfg_attr(feature = "serde", serde(default))]
    pub stretches: Vec<f64>,
    /// Covariance that all of this adds to that of the free parameters.
    pub added: DMatrix<f64>,
    /// Variance of the samples, relative to that from pixels with independent noise, if the
    /// samples' stated standard deviations are based on such noise.
    pub(crate) pixels: f64,
}

impl ResidualCorrelation {
    /// Returns the values for independent noise.
    pub(crate) fn none(planes: usize, parameters: usize) -> Self {
        Self {
            neighbours: 1.0,
            probability: 0.0,
            displacements: vec![0.0; planes],
            between_plane_variance_ratio: 1.0,
            line_displacement: 0.0,
            group_variance_ratio: 1.0,
            heights: vec![0.0; planes],
            stretches: vec![0.0; planes],
            added: DMatrix::zeros(parameters, parameters),
            pixels: 1.0,
        }
    }

    /// Whether common errors of sides are more likely than not.
    pub fn is_likely(&self) -> bool {
        self.probability > LIKELIER
    }
}
