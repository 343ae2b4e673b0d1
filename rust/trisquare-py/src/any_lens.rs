//! A camera as passed by Python: a lens of any family.

use nalgebra::Matrix3;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Brown, DistortionModel, Fisheye, Lens, Rational, ThinPrism};

use crate::errors::detached;

/// The name of a model, all parameters of its lens, and the radius up to which that lens is
/// trusted.
#[derive(FromPyObject)]
pub struct CameraMembers(String, Vec<f64>, f64);

/// A lens of one of the families.
#[derive(Clone, Copy)]
pub enum AnyLens {
    Brown(Brown),
    Fisheye(Fisheye),
    Rational(Rational),
    ThinPrism(ThinPrism),
}

/// Evaluates an expression with the lens in an [`AnyLens`].
macro_rules! with_lens {
    ($any:expr, |$lens:ident| $value:expr) => {
        match $any {
            $crate::any_lens::AnyLens::Brown($lens) => $value,
            $crate::any_lens::AnyLens::Fisheye($lens) => $value,
            $crate::any_lens::AnyLens::Rational($lens) => $value,
            $crate::any_lens::AnyLens::ThinPrism($lens) => $value,
        }
    };
}
pub(crate) use with_lens;

impl CameraMembers {
    /// The lens itself.
    pub fn lens(&self, py: Python<'_>) -> PyResult<AnyLens> {
        let Self(name, parameters, radius) = self;
        let family = family_of(name)?;
        with_lens!(family, |lens| Ok(
            filled(py, lens, parameters, *radius)?.into()
        ))
    }
}

/// Implements the conversion of each family's lens to [`AnyLens`].
macro_rules! of_family {
    ($($family:ident),*) => {$(
        impl From<$family> for AnyLens {
            fn from(lens: $family) -> Self {
                Self::$family(lens)
            }
        }
    )*};
}
of_family!(Brown, Fisheye, Rational, ThinPrism);

fn filled<L: Lens>(py: Python<'_>, lens: L, parameters: &[f64], radius: f64) -> PyResult<L> {
    let (expected, given) = (L::parameter_names().len(), parameters.len());
    if given != expected {
        return Err(PyValueError::new_err(format!(
            "the lens has {expected} parameters, not {given}"
        )));
    }
    detached(py, || lens.with_parameters(parameters).within(radius))
}

/// A lens of the first family that has a model of this name; its parameters are arbitrary.
pub fn family_of(model: &str) -> PyResult<AnyLens> {
    let identity = Matrix3::identity();
    let families: [AnyLens; 4] = [
        Brown::from_camera_matrix(&identity).into(),
        Fisheye::from_camera_matrix(&identity).into(),
        Rational::from_camera_matrix(&identity).into(),
        ThinPrism::from_camera_matrix(&identity).into(),
    ];
    let mut known_names = Vec::new();
    for lens in families {
        let lens_names = with_lens!(lens, |lens| names(&lens));
        if lens_names.iter().any(|name| name == model) {
            return Ok(lens);
        }
        known_names.extend(
            lens_names
                .into_iter()
                .filter(|name| !known_names.contains(name))
                .collect::<Vec<_>>(),
        );
    }
    Err(unknown_model(model, &known_names))
}

fn unknown_model(name: &str, known: &[String]) -> PyErr {
    PyValueError::new_err(format!(
        "unknown model {name:?}: choose one of {}",
        known.join(", ")
    ))
}

fn names<L: Lens>(_: &L) -> Vec<String> {
    L::Model::NESTED.iter().map(|model| model.name()).collect()
}

/// The model with a name in a lens's family.
pub fn model_of<L: Lens>(lens: &L, name: &str) -> PyResult<L::Model> {
    let mut models = L::Model::NESTED.iter().copied();
    models
        .find(|model| model.name() == name)
        .ok_or_else(|| unknown_model(name, &names(lens)))
}

/// Converts a lens to a family: unchanged if it belongs to it, otherwise only its camera matrix.
pub fn in_family<L: Lens>(given: &AnyLens) -> L {
    with_lens!(given, |given| {
        let lens = L::from_camera_matrix(&given.camera_matrix());
        match names(given) == names(&lens) {
            true => lens.with_parameters(&given.parameters()),
            false => lens,
        }
    })
}
