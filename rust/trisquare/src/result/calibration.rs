//! Result of a calibration.

use std::cmp::Reverse;

use nalgebra::{DMatrix, Matrix6, Matrix6xX, Vector2};

use super::residual_correlation::ResidualCorrelation;
use super::warning::{Stage, Warning};
use crate::geometry::Pose;
use crate::image::ToneFit;
use crate::image_size::ImageSize;
use crate::lens::{DefaultLens, Lens};

/// Uncertainty of a pose, and its dependence on the camera.
///
/// A pose's parameters are a rotation vector applied after its rotation, in camera coordinates
/// (radians), and the translation (units of the plane). An estimated tone curve is unknown like the
/// pose, and follows the camera with it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PoseUncertainty {
    /// Covariance of the pose where the camera is given.
    pub given_camera: Matrix6<f64>,
    /// Derivative of the pose with respect to all of the camera's parameters, free or held, in the
    /// order of [`Lens::parameter_names`](crate::lens::Lens::parameter_names).
    pub by_camera: Matrix6xX<f64>,
}

/// Distances of the samples of a figure of a plane from the images of its lines.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FigureResiduals {
    /// Index of its plane among the calibration's planes.
    pub plane: usize,
    /// One for each of its lines, in the order in which they were given.
    pub sides: Vec<SideResiduals>,
}

/// Distances of the samples of a line from its image, in the order in which the samples were given.
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
    /// Index of its first figure among the given edges.
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
    /// Uncertainty of its pose; `None` where its own samples do not determine it.
    pub uncertainty: Option<PoseUncertainty>,
    /// Extent along X over that along Y, for a rectangle of unknown aspect.
    pub aspect: Option<Aspect>,
    /// All radii of the first figure, for circles of which some radii were unknown; else empty.
    #[cfg_attr(feature = "serde", serde(default))]
    pub radii: Vec<CircleRadius>,
}

/// A line of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SceneLine {
    /// Its index among the given edges.
    pub figure: usize,
    /// The picture that shows it, numbered as in the edges given.
    pub image: usize,
    /// Root mean square distance of its samples from the image of the line that fits them best, in
    /// pixels; `None` where the lens does not see all of them.
    pub rms: Option<f64>,
    /// Number of its samples.
    pub samples: usize,
    /// Whether it is used for the camera: not where it is curved, or all lines contradict the
    /// planes.
    pub is_used: bool,
}

/// The radius of a circle, in units of its plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct CircleRadius {
    /// The radius.
    pub value: f64,
    /// Its standard deviation; zero if the radius was known.
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

/// A parameter of the camera, with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Its name, one of [`Lens::parameter_names`].
    pub name: &'static str,
    /// Its value: in pixels for the camera matrix, without unit for a distortion coefficient.
    pub value: f64,
    /// Its standard deviation; `None` if it was held. The 95 % interval is the value plus and minus
    /// 1.96 standard deviations.
    pub std: Option<f64>,
}

/// A calibrated camera, its covariance, and the poses of the planes.
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
    /// Whether `fy` follows `fx`, so that it has a standard deviation as well.
    pub aspect_fixed: bool,
    /// The planes, in the order in which their first figures were given.
    pub planes: Vec<Plane>,
    /// The lines of the scene, in the order in which they were given.
    pub lines: Vec<SceneLine>,
    /// Distances of the samples of every figure from the images of its lines, in the order in which
    /// the figures of planes were given: without those that are lines of the scene.
    pub residuals: Vec<FigureResiduals>,
    /// Root mean square distance of the samples that count to the images of their lines, in pixels.
    pub rms: f64,
    /// Factor on the given standard deviations that makes them agree with the residuals.
    pub noise_scale: f64,
    /// Departure of the residuals from independent noise.
    pub residual_correlation: ResidualCorrelation,
    /// Number of evaluations of the refinement.
    pub iterations: usize,
    /// Warnings, the most severe first.
    pub warnings: Vec<Warning>,
    /// The stage that the numbers come from.
    pub stage: Stage,
    /// Tone curve of each picture, where the fit to the pixels estimated it.
    pub tones: Vec<ToneFit>,
    /// Largest factor by which the unknown tone curve raises the standard deviation of a lens
    /// parameter; `None` where the curve was known, or was not fitted.
    pub tone_growth: Option<f64>,
}

impl<L: Lens> Calibration<L> {
    /// Returns the index of a parameter among the free ones, if it is free.
    pub(crate) fn position(&self, name: &str) -> Option<usize> {
        self.parameters
            .iter()
            .position(|parameter| *parameter == name)
    }

    /// Sorts the warnings, the most severe first; those of one severity keep their order.
    pub(crate) fn sort_warnings(&mut self) {
        self.warnings
            .sort_by_key(|warning| Reverse(warning.severity()));
    }

    /// Returns the standard deviation of a free parameter.
    pub(crate) fn std_of(&self, name: &str) -> Option<f64> {
        let position = self.position(name)?;
        Some(self.covariance[(position, position)].max(0.0).sqrt())
    }

    /// Returns all parameters of the camera, free or held, in the order of
    /// [`Lens::parameter_names`].
    ///
    /// ```
    /// use trisquare::{Calibration, Severity};
    ///
    /// fn tell(found: &Calibration) {
    ///     for estimate in found.estimates() {
    ///         match estimate.std {
    ///             Some(std) => println!("{} {} +- {std}", estimate.name, estimate.value),
    ///             None => println!("{} {} fixed", estimate.name, estimate.value),
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
        let std = |name| {
            all.iter()
                .find(|(parameter, _)| *parameter == name)
                .map(|entry| entry.1)
        };
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

    /// Returns one standard deviation of every free parameter (and of `fy` where it follows `fx`),
    /// in the order of the covariance. Their order and number differ from those of the camera's
    /// parameters; [`Self::estimates`] returns all of these, with their values.
    pub fn std(&self) -> Vec<(&'static str, f64)> {
        let focal = self.camera.focal();
        let aspect = self.aspect_fixed.then_some(focal.y / focal.x);
        deviations(&self.parameters, &self.covariance, aspect)
    }
}

/// Returns one standard deviation of every parameter, and of `fy` where it is `aspect` times `fx`.
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
