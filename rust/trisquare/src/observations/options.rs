//! Which parameters of the camera are free, and which are held.

use crate::error::Error;
use crate::geometry::KnownIntrinsics;
use crate::lens::{Brown, Lens};

/// No camera is this short; below, products of the focal lengths underflow.
const SMALLEST_FOCAL: f64 = 1e-3;

/// No camera's parameter is this large; beyond it, squares of pixels overflow.
const LARGEST_PARAMETER: f64 = 1e9;

/// The distortion coefficients that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Model {
    /// None: a pinhole.
    None,
    /// `k1`.
    Radial1,
    /// `k1, k2`.
    #[default]
    Radial2,
    /// `k1, k2, k3`.
    Radial3,
    /// `k1, k2, k3, p1, p2`.
    Brown,
}

impl Model {
    /// Number of radial coefficients.
    pub fn radial_coefficients(self) -> usize {
        match self {
            Model::None => 0,
            Model::Radial1 => 1,
            Model::Radial2 => 2,
            Model::Radial3 | Model::Brown => 3,
        }
    }

    pub(crate) fn columns(self) -> std::ops::Range<usize> {
        let tangential = if self == Model::Brown { 2 } else { 0 };
        4..4 + self.radial_coefficients() + tangential
    }
}

/// What is held at the initial camera's values, or else at aspect 1, the image centre and zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Fixed {
    /// The ratio `fy / fx`.
    pub aspect: bool,
    /// `cx` and `cy`.
    pub principal_point: bool,
    /// `fx` and `fy`; needs an initial camera.
    pub focal: bool,
    /// All distortion coefficients.
    pub distortion: bool,
}

/// Everything a caller may decide about a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// Maximum likelihood or the three linear steps alone.
    pub method: Method,
    /// The distortion coefficients estimated.
    pub model: Model,
    /// The parameters held.
    pub fixed: Fixed,
    /// The camera whose values the held parameters keep.
    pub initial: Option<Brown>,
}

/// How far a calibration goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// Joint maximum likelihood, from the linear steps' answer.
    #[default]
    MaximumLikelihood,
    /// The paper's three linear steps alone.
    Linear,
}

impl Options {
    /// The ratio `fy / fx` that a fixed aspect keeps.
    pub(crate) fn aspect(&self) -> f64 {
        self.initial
            .map_or(1.0, |camera| camera.focal().y / camera.focal().x)
    }

    /// What is known of `K` beforehand, the focal length apart.
    pub(crate) fn known_intrinsics(&self, size: &crate::image_size::ImageSize) -> KnownIntrinsics {
        KnownIntrinsics {
            aspect: self.fixed.aspect.then(|| self.aspect()),
            principal_point: self.fixed.principal_point.then(|| {
                self.initial
                    .map_or_else(|| size.centre(), |camera| camera.principal_point())
            }),
        }
    }

    /// # Errors
    /// [`Error::InvalidArgument`] for a focal length held at no value, or a camera of no use.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if let Some(camera) = &self.initial {
            let parameters = camera.parameters();
            if !parameters.iter().all(|v| v.is_finite()) {
                return Err(Error::NotFinite {
                    what: "the initial camera",
                });
            }
            let focals = parameters[..2].iter();
            let far = parameters.iter().any(|v| v.abs() > LARGEST_PARAMETER);
            if focals.copied().any(|f| f < SMALLEST_FOCAL) || far {
                return Err(Error::InvalidArgument(format!(
                    "the initial camera's focal lengths must be at least {SMALLEST_FOCAL} px, \
                     and none of its parameters beyond {LARGEST_PARAMETER:e}"
                )));
            }
        } else if self.fixed.focal {
            return Err(Error::InvalidArgument(
                "fixing the focal length needs an initial camera to hold it at".into(),
            ));
        }
        Ok(())
    }
}
