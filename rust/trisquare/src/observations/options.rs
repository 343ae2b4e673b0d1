//! Which parameters of the camera are free, and which are held.

use nalgebra::Matrix3;

use crate::error::Error;
use crate::geometry::KnownIntrinsics;
use crate::lens::{DISTORTION, DefaultLens, Lens};

/// No camera is this short; below, products of the focal lengths underflow.
const SMALLEST_FOCAL: f64 = 1e-3;

/// No camera's parameter is this large; beyond it, squares of pixels overflow.
const LARGEST_PARAMETER: f64 = 1e9;

/// What is held at the initial camera's values, or else at aspect 1, the image centre and zero: by
/// default the skew alone.
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
    /// What of the camera is held, as warnings name it.
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

/// Everything a caller may decide about a calibration, and with which lens.
///
/// Of stored ones, members that are absent have their defaults, as those of an older version may;
/// members that are not known are refused.
///
/// `Options::default()` calibrates the default lens, `Options::<L>::new()` any other; what differs is
/// named:
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
    /// Maximum likelihood or the three linear steps alone.
    pub method: Method,
    /// The distortion coefficients estimated.
    pub model: L::Model,
    /// The parameters held.
    pub fixed: Fixed,
    /// The camera whose values the held parameters keep.
    #[cfg_attr(feature = "serde", serde(with = "crate::lens::stored::option"))]
    pub initial: Option<L>,
}

/// How far a calibration goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// Joint maximum likelihood, from the linear steps' answer.
    #[default]
    MaximumLikelihood,
    /// The paper's three linear steps alone. Standard deviations are those that maximum likelihood
    /// would have with residuals of that size: they leave out what the steps themselves lose, which
    /// for the coefficients of a strong distortion is most of the error.
    Linear,
}

impl Default for Options {
    fn default() -> Self {
        Self::new()
    }
}

impl<L: Lens> Options<L> {
    /// Maximum likelihood, the lens's default model, and nothing but the skew held.
    ///
    /// The default model has few of a lens's coefficients, since each that is free takes certainty
    /// from the others: `k1` and `k2` of [`Brown`](crate::Brown), and likewise of
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

    /// The same wishes for a lens of another family, with its default model. Of the camera whose values
    /// are kept, its camera matrix remains.
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

    /// A camera matrix without skew, with the skew of the initial camera.
    pub(crate) fn with_known_skew(&self, mut camera_matrix: Matrix3<f64>) -> Matrix3<f64> {
        camera_matrix.m12 = self.initial.map_or(0.0, |camera| camera.skew());
        camera_matrix
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
    /// [`Error::InvalidArgument`] for a focal length held at no value, a skew that cannot be freed,
    /// or a camera of no use.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if !self.fixed.skew && (self.method == Method::Linear || L::skew_column().is_none()) {
            return Err(Error::InvalidArgument(
                "the skew can be freed in the maximum-likelihood fit of a lens that has one: the \
                 linear steps take it as zero"
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
