//! Options of a calibration: the lens model, and the parameters that are held.

use nalgebra::Matrix3;

use crate::error::Error;
use crate::geometry::KnownIntrinsics;
use crate::lens::{DISTORTION, DefaultLens, Lens};

/// Smallest focal length, pixels: no camera's is as short, and products of smaller ones underflow.
const SMALLEST_FOCAL: f64 = 1e-3;

/// Largest absolute value of a parameter: no camera's is as large, and squares of larger pixel
/// coordinates overflow.
const LARGEST_PARAMETER: f64 = 1e9;

/// Parameters that are held at the initial camera's values, or else at aspect 1, the image centre
/// and zero: by default only the skew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Fixed {
    /// The ratio `fy / fx`.
    pub aspect: bool,
    /// `cx` and `cy`.
    pub principal_point: bool,
    /// `fx` and `fy`; needs an initial camera.
    pub focal: bool,
    /// All distortion coefficients.
    pub distortion: bool,
    /// The skew.
    pub skew: bool,
}

impl Fixed {
    /// Returns the names of the held parts of the camera in warnings.
    pub(crate) fn names(self) -> Vec<&'static str> {
        let held = [
            (self.principal_point, "principal point"),
            (self.focal, "focal length"),
            (self.aspect && !self.focal, "aspect"),
            (self.distortion, DISTORTION),
        ];
        let held = held.into_iter().filter(|(is_held, _)| *is_held);
        held.map(|(_, name)| name).collect()
    }
}

impl Default for Fixed {
    fn default() -> Self {
        Self {
            aspect: false,
            principal_point: false,
            focal: false,
            distortion: false,
            skew: true,
        }
    }
}

/// Options of a calibration, with the lens `L` that it estimates.
///
/// In stored options, absent members have their defaults, as in those of an older version; unknown
/// members are refused.
///
/// `Options::default()` calibrates the default lens, `Options::<L>::new()` any other; fields that
/// differ from the defaults are named:
///
/// ```
/// use trisquare::{Fisheye, FisheyeModel, Fixed, Options};
///
/// let options = Options::<Fisheye> {
///     model: FisheyeModel::Fisheye2,
///     fixed: Fixed { aspect: true, ..Fixed::default() },
///     ..Options::new()
/// };
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(
        default = "Options::new",
        deny_unknown_fields,
        bound(
            serialize = "L::Model: serde::Serialize",
            deserialize = "L::Model: serde::Deserialize<'de>"
        )
    )
)]
pub struct Options<L: Lens = DefaultLens> {
    /// Maximum likelihood, or only the three linear steps.
    pub method: Method,
    /// Lens model: the distortion coefficients that are estimated.
    pub model: L::Model,
    /// The parameters that are held.
    pub fixed: Fixed,
    /// The camera whose values the held parameters keep.
    #[cfg_attr(feature = "serde", serde(with = "crate::lens::stored::option"))]
    pub initial: Option<L>,
}

/// Method of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// Joint maximum likelihood, starting from the result of the linear steps.
    #[default]
    MaximumLikelihood,
    /// Only the paper's three linear steps. Standard deviations are those that maximum likelihood
    /// would have with residuals of that size: they do not include the errors of the steps
    /// themselves, which for the coefficients of a strong distortion are most of the error.
    Linear,
}

impl Default for Options {
    fn default() -> Self {
        Self::new()
    }
}

impl<L: Lens> Options<L> {
    /// Creates options with maximum likelihood, the lens's default model, and only the skew held.
    ///
    /// The default model has few of a lens's coefficients, since each free one makes the others
    /// less certain: `k1` and `k2` of [`Brown`](crate::Brown), and likewise of
    /// [`Rational`](crate::Rational) and [`ThinPrism`](crate::ThinPrism), all four of a
    /// [`Fisheye`](crate::Fisheye). All coefficients of a lens are free in its richest model:
    ///
    /// ```
    /// use trisquare::{Options, Rational, RationalModel};
    ///
    /// let few = Options::<Rational>::new();
    /// assert_eq!(few.model, RationalModel::Brown(trisquare::BrownModel::Radial2));
    /// let all = Options::<Rational> { model: RationalModel::Rational, ..Options::new() };
    /// ```
    pub fn new() -> Self {
        Self {
            method: Method::default(),
            model: L::Model::default(),
            fixed: Fixed::default(),
            initial: None,
        }
    }

    /// Returns the same options for a lens of another family, with its default model. Only the
    /// camera matrix of the initial camera is kept.
    pub fn for_family<B: Lens>(&self) -> Options<B> {
        let camera = |lens: L| B::from_camera_matrix(&lens.camera_matrix());
        Options {
            method: self.method,
            fixed: self.fixed,
            initial: self.initial.map(camera),
            model: B::Model::default(),
        }
    }

    /// The ratio `fy / fx` that a fixed aspect keeps.
    pub(crate) fn aspect(&self) -> f64 {
        self.initial
            .map_or(1.0, |camera| camera.focal().y / camera.focal().x)
    }

    /// Sets the skew of a camera matrix to that of the initial camera, or zero.
    pub(crate) fn with_known_skew(&self, mut camera_matrix: Matrix3<f64>) -> Matrix3<f64> {
        camera_matrix.m12 = self.initial.map_or(0.0, |camera| camera.skew());
        camera_matrix
    }

    /// Returns the entries of `K` that are known beforehand, the focal length apart.
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
    /// [`Error::InvalidArgument`] for a focal length held without an initial camera, a skew that
    /// cannot be freed, or an initial camera out of range; `Error::NotFinite` for one that is not
    /// finite.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if !self.fixed.skew && (self.method == Method::Linear || L::skew_column().is_none()) {
            return Err(Error::InvalidArgument(
                "the skew can be free only in the maximum-likelihood fit, and for a lens model \
                 that has a skew: the linear steps assume that it is zero"
                    .into(),
            ));
        }
        if let Some(camera) = &self.initial {
            let parameters = camera.parameters();
            if !parameters.iter().all(|v| v.is_finite()) {
                return Err(Error::NotFinite {
                    what: "the initial camera",
                });
            }
            let focals = parameters[..2].iter();
            let is_too_large = parameters.iter().any(|v| v.abs() > LARGEST_PARAMETER);
            if focals.copied().any(|f| f < SMALLEST_FOCAL) || is_too_large {
                return Err(Error::InvalidArgument(format!(
                    "the initial camera's focal lengths must be at least {SMALLEST_FOCAL} px, \
                     and none of its parameters beyond {LARGEST_PARAMETER:e}"
                )));
            }
        } else if self.fixed.focal {
            return Err(Error::InvalidArgument(
                "fixing the focal length needs an initial camera that states its value".into(),
            ));
        }
        Ok(())
    }
}
