//! Which parameters of the camera are free, and which are held.

use nalgebra::DVector;

use crate::conic::KnownIntrinsics;
use crate::lens::{CENTRE_COLUMNS, Columns, MAX_LENS_COLUMNS};
use crate::{Brown, Error, Lens};

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

    fn columns(self) -> std::ops::Range<usize> {
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

/// The free parameters of a lens: which Jacobian columns they own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FreeParameters {
    columns: Vec<usize>,
    /// `fy / fx` where `fy` follows `fx`.
    aspect: Option<f64>,
}

impl FreeParameters {
    pub fn new(model: Model, fixed: &Fixed, aspect: f64) -> Self {
        let mut columns = Vec::with_capacity(MAX_LENS_COLUMNS);
        if !fixed.focal {
            columns.push(0);
            if !fixed.aspect {
                columns.push(1);
            }
        }
        if !fixed.principal_point {
            columns.extend([2, 3]);
        }
        if !fixed.distortion {
            columns.extend(model.columns());
        }
        Self {
            columns,
            aspect: (fixed.aspect && !fixed.focal).then_some(aspect),
        }
    }

    /// The same with the centre of distortion freed from the principal point.
    pub fn with_free_centre(&self) -> Self {
        let mut freed = self.clone();
        freed.columns.extend([CENTRE_COLUMNS, CENTRE_COLUMNS + 1]);
        freed
    }

    /// Whether `fy` follows `fx`.
    pub fn aspect_is_fixed(&self) -> bool {
        self.aspect.is_some()
    }

    /// The columns of a lens Jacobian that [`Self::gather`] reads.
    pub fn columns(&self) -> Columns {
        let followed = self.aspect.map(|_| 1);
        Columns::of(self.columns.iter().copied().chain(followed))
    }

    pub fn len(&self) -> usize {
        self.columns.len()
    }

    pub fn names(&self) -> Vec<&'static str> {
        self.columns
            .iter()
            .map(|c| Brown::parameter_names()[*c])
            .collect()
    }

    /// Position of a named parameter among the free ones.
    pub fn position(&self, name: &str) -> Option<usize> {
        self.columns
            .iter()
            .position(|c| Brown::parameter_names().get(*c) == Some(&name))
    }

    /// Picks the free columns out of a lens Jacobian.
    pub fn gather(&self, wrt_lens: &[f64; MAX_LENS_COLUMNS], free: &mut [f64]) {
        for (value, column) in free.iter_mut().zip(&self.columns) {
            *value = wrt_lens[*column];
        }
        if let Some(aspect) = self.aspect {
            free[0] += aspect * wrt_lens[1];
        }
    }

    /// How far two lenses are apart in the free parameters.
    pub fn difference<L: Lens>(&self, a: &L, b: &L) -> DVector<f64> {
        let (a, b) = (a.parameters(), b.parameters());
        DVector::from_fn(self.len(), |i, _| a[self.columns[i]] - b[self.columns[i]])
    }

    /// The lens after a step of the free parameters.
    pub fn advance<L: Lens>(&self, lens: &L, step: &DVector<f64>) -> L {
        let mut parameters = lens.parameters();
        for (column, change) in self.columns.iter().zip(step.iter()) {
            if *column < CENTRE_COLUMNS {
                parameters[*column] += change;
            }
        }
        if let Some(aspect) = self.aspect {
            parameters[1] = aspect * parameters[0];
        }
        lens.with_parameters(&parameters)
    }
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

    pub(crate) fn free_parameters(&self) -> FreeParameters {
        FreeParameters::new(self.model, &self.fixed, self.aspect())
    }

    /// What is known of `K` beforehand, the focal length apart.
    pub(crate) fn known_intrinsics(&self, size: &crate::ImageSize) -> KnownIntrinsics {
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
