//! One Python exception per family of errors.

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;
use trisquare::{Error, ErrorKind};

pyo3::import_exception!(trisquare.errors, NotEnoughPlanesError);
pyo3::import_exception!(trisquare.errors, NotEnoughDataError);
pyo3::import_exception!(trisquare.errors, DegenerateGeometryError);
pyo3::import_exception!(trisquare.errors, ConvergenceError);

/// The exception that stands for an error of the crate.
pub fn exception(error: Error) -> PyErr {
    let message = error.to_string();
    match error.kind() {
        ErrorKind::InvalidArgument => PyValueError::new_err(message),
        ErrorKind::NotEnoughPlanes => NotEnoughPlanesError::new_err(message),
        ErrorKind::NotEnoughData => NotEnoughDataError::new_err(message),
        ErrorKind::DegenerateGeometry => DegenerateGeometryError::new_err(message),
        ErrorKind::Convergence => ConvergenceError::new_err(message),
    }
}
