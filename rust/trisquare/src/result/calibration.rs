//! What a calibration returns.

use std::cmp::Reverse;

use nalgebra::{DMatrix, Matrix6, Matrix6xX, Vector2};

use super::residual_correlation::ResidualCorrelation;
use super::warning::{Stage, Warning};
use crate::geometry::Pose;
use crate::image::ToneFit;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, Lens};

/// How well a pose is known, and how it would follow another camera.
///
/// A pose's parameters are a rotation vector applied after its rotation, in camera coordinates
/// (radians), and the translation (units of the plane). A tone curve that was estimated is as unknown
/// as the pose, and follows the camera with it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PoseUncertainty {
    /// Covariance of the pose where the camera is given.
    pub given_camera: Matrix6<f64>,
    /// Derivative of the pose by all of the camera's parameters, free or held, in the order of
    /// [`Lens::parameter_names`](crate::lens::Lens::parameter_names).
    pub by_camera: Matrix6xX<f64>,
}

/// How far the samples of a figure of a plane are from the images of its lines.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FigureResiduals {
    /// Index of its plane among the calibration's planes.
    pub plane: usize,
    /// One for each of its lines, in the order in which they were given.
    pub sides: Vec<SideResiduals>,
}

/// How far the samples of a line are from its image, in the order in which they were given.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SideResiduals {
    /// Signed distances, in pixels.
    pub distances: Vec<f64>,
    /// Unit normals of the line's image, towards which the distances are positive.
    pub normals: Vec<Vector2<f64>>,
}

/// A plane of the scene.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Plane {
    /// Index of its first figure among the edges given.
    pub figure: usize,
    /// The picture that shows it, numbered as in the edges given.
    pub image: usize,
    /// `cam_from_plane`, in units of the first figure's coordinates.
    pub pose: Pose,
    /// Its four corners as observed (distorted), in pixels.
    pub corners: [Vector2<f64>; 4],
    /// Root mean square distance of its samples that count, in pixels.
    pub rms: f64,
    /// Number of its samples.
    pub samples: usize,
    /// How well its pose is known; `None` where its own samples do not determine it.
    pub uncertainty: Option<PoseUncertainty>,
    /// Of a rectangle of unknown aspect, its extent along X over that along Y.
    pub aspect: Option<Aspect>,
    /// Of circles of which some radii were unknown, all radii of the first figure; else empty.
    #[cfg_attr(feature = "serde", serde(default))]
    pub radii: Vec<CircleRadius>,
}

/// A line of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SceneLine {
    /// Its index among the edges given.
    pub figure: usize,
    /// The picture that shows it, numbered as in the edges given.
    pub image: usize,
    /// Root mean square distance of its samples from the image of the line that fits them best, in
    /// pixels; `None` where the lens does not see all of them.
    pub rms: Option<f64>,
    /// Number of its samples.
    pub samples: usize,
    /// Whether the camera follows it: not where it is curved, or all lines contradict the planes.
    pub is_used: bool,
}

/// The radius of a circle, in units of its plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct CircleRadius {
    /// The radius.
    pub value: f64,
    /// Its standard deviation, zero where it was known.
    pub std: f64,
}

/// The aspect of a rectangle, estimated with the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Aspect {
    /// Side 0 over side 1.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// A parameter of the camera, and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Its name, of [`Lens::parameter_names`].
    pub name: &'static str,
    /// Its value: pixels of the camera matrix, no unit of a distortion coefficient.
    pub value: f64,
    /// One standard deviation of it; `None` where it was held. The 95 % interval is the value plus
    /// and minus 1.96 of them.
    pub std: Option<f64>,
}

/// A calibrated camera, how well it is known, and where the planes stand.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(bound = ""))]
#[non_exhaustive]
pub struct Calibration<L: Lens = DefaultLens> {
    /// The camera.
    #[cfg_attr(feature = "serde", serde(with = "crate::lens::stored"))]
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
    /// The lines of the scene, in the order in which they were given.
    pub lines: Vec<SceneLine>,
    /// How far the samples of every figure are from the images of its lines, in the order in which
    /// the figures of planes were given: without those that are lines of the scene.
    pub residuals: Vec<FigureResiduals>,
    /// Root mean square distance of the samples that count to the images of their lines, in pixels.
    pub rms: f64,
    /// What the given standard deviations had to be multiplied by to agree with the residuals.
    pub noise_scale: f64,
    /// How far the residuals are from independent noise.
    pub residual_correlation: ResidualCorrelation,
    /// Evaluations of the refinement.
    pub iterations: usize,
    /// What the user should know, the most severe first.
    pub warnings: Vec<Warning>,
    /// The stage the numbers come from.
    pub stage: Stage,
    /// How each picture was coded, where the fit to the pixels found it out.
    pub tones: Vec<ToneFit>,
    /// How many times as large the standard deviation of a lens parameter is, at most, as it would be
    /// if the coding had been known; `None` where it was, or was not fitted.
    pub tone_growth: Option<f64>,
}

impl<L: Lens> Calibration<L> {
    /// Where a parameter is among the free ones, if it is.
    pub(crate) fn position(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|own| *own == name)
    }

    /// Puts the most severe warnings first, and leaves those of one severity in their order.
    pub(crate) fn sort_warnings(&mut self) {
        self.warnings.sort_by_key(|own| Reverse(own.severity()));
    }

    /// The standard deviation of a free parameter.
    pub(crate) fn std_of(&self, name: &str) -> Option<f64> {
        let position = self.position(name)?;
        Some(self.covariance[(position, position)].max(0.0).sqrt())
    }

    /// All parameters of the camera, free or held, in the order of [`Lens::parameter_names`].
    ///
    /// ```
    /// use trisquare::{Calibration, Severity};
    ///
    /// fn tell(found: &Calibration) {
    ///     for estimate in found.estimates() {
    ///         match estimate.std {
    ///             Some(std) => println!("{} {} +- {std}", estimate.name, estimate.value),
    ///             None => println!("{} {} held", estimate.name, estimate.value),
    ///         }
    ///     }
    ///     for warning in &found.warnings {
    ///         if warning.severity() > Severity::Low {
    ///             println!("{}: {warning}", warning.code());
    ///         }
    ///     }
    /// }
    /// ```
    pub fn estimates(&self) -> Vec<Estimate> {
        let all = self.std();
        let std = |name| all.iter().find(|(own, _)| *own == name).map(|own| own.1);
        let names = L::parameter_names().iter().copied();
        names
            .zip(self.camera.parameters())
            .map(|(name, value)| Estimate {
                name,
                value,
                std: std(name),
            })
            .collect()
    }

    /// One standard deviation of every free parameter (and of `fy` where it follows `fx`), in the
    /// order of the covariance: neither that of the camera's parameters nor as many. With their
    /// values: [`Self::estimates`].
    pub fn std(&self) -> Vec<(&'static str, f64)> {
        let focal = self.camera.focal();
        let aspect = self.aspect_fixed.then_some(focal.y / focal.x);
        deviations(&self.parameters, &self.covariance, aspect)
    }
}

/// One standard deviation of every parameter, and of `fy` where it is `aspect` times `fx`.
pub(crate) fn deviations(
    parameters: &[&'static str],
    covariance: &DMatrix<f64>,
    aspect: Option<f64>,
) -> Vec<(&'static str, f64)> {
    let mut all = Vec::with_capacity(parameters.len() + 1);
    for (i, name) in parameters.iter().enumerate() {
        let std = covariance[(i, i)].max(0.0).sqrt();
        all.push((*name, std));
        if let (&"fx", Some(aspect)) = (name, aspect) {
            all.push(("fy", std * aspect));
        }
    }
    all
}
