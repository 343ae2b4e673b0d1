//! What a calibration returns.

use nalgebra::{DMatrix, Vector2};

use super::pose_uncertainty::PoseUncertainty;
use super::residual_correlation::ResidualCorrelation;
use super::residuals::FigureResiduals;
use super::warning::{Stage, Warning};
use crate::geometry::Pose;
use crate::image::ToneFit;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, Lens};

/// A plane of the scene.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plane {
    /// Index of its first figure among the edges given.
    pub figure: usize,
    /// Index of the picture that shows it.
    pub image: usize,
    /// `cam_from_plane`, in units of the first figure's coordinates.
    pub pose: Pose,
    /// Its four corners as observed (distorted), in pixels.
    pub corners: [Vector2<f64>; 4],
    /// Root mean square distance of its samples, in pixels.
    pub rms: f64,
    /// Number of its samples.
    pub samples: usize,
    /// How well its pose is known; `None` where its own samples do not determine it.
    pub uncertainty: Option<PoseUncertainty>,
}

/// A calibrated camera, how well it is known, and where the planes stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration<L: Lens = DefaultLens> {
    /// The camera.
    pub camera: L,
    /// Size of the pictures.
    pub image_size: ImageSize,
    /// Names of the free parameters, in the order of the covariance.
    pub parameters: Vec<&'static str>,
    /// Covariance of the free parameters.
    pub covariance: DMatrix<f64>,
    /// Whether `fy` follows `fx`, so that it has its standard deviation.
    pub aspect_fixed: bool,
    /// The planes, in the order in which their first figures were given.
    pub planes: Vec<Plane>,
    /// How far the samples of every figure are from the images of its lines, in the order in which
    /// the figures were given.
    pub residuals: Vec<FigureResiduals>,
    /// Root mean square distance of all samples to the images of their lines, in pixels.
    pub rms: f64,
    /// What the given standard deviations had to be multiplied by to agree with the residuals.
    pub noise_scale: f64,
    /// How far the residuals are from independent noise.
    pub residual_correlation: ResidualCorrelation,
    /// Evaluations of the refinement.
    pub iterations: usize,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The stage the numbers come from.
    pub stage: Stage,
    /// How each picture was coded, where the fit to the pixels found it out.
    pub tones: Vec<ToneFit>,
}

impl<L: Lens> Calibration<L> {
    /// One standard deviation of every free parameter (and of `fy` where it follows `fx`).
    pub fn std(&self) -> Vec<(&'static str, f64)> {
        let mut all = Vec::with_capacity(self.parameters.len() + 1);
        for (i, name) in self.parameters.iter().enumerate() {
            let std = self.covariance[(i, i)].sqrt();
            all.push((*name, std));
            if *name == "fx" && self.aspect_fixed {
                let focal = self.camera.focal();
                all.push(("fy", std * (focal.y / focal.x)));
            }
        }
        all
    }
}
