//! Cubics along the sides of quadrilaterals.

use nalgebra::Vector4;
use numpy::{
    PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{SidePoints, trimmed_cubics};

use crate::arrays;
use crate::errors::detached;

/// Coefficients, shape (S, 4), of cubics through offsets, shape (S, N), given their bases, shape
/// (S, N, 4), which of them count, and the lengths of the chords; `trimmed` leaves out strays.
#[pyfunction]
#[pyo3(signature = (basis, offsets, used, lengths, trimmed))]
pub fn fit_side_cubics<'py>(
    py: Python<'py>,
    basis: PyReadonlyArray3<'py, f64>,
    offsets: PyReadonlyArray2<'py, f64>,
    used: PyReadonlyArray2<'py, bool>,
    lengths: PyReadonlyArray1<'py, f64>,
    trimmed: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (sides, points) = (offsets.shape()[0], offsets.shape()[1]);
    let alike = basis.shape() == [sides, points, 4]
        && used.shape() == [sides, points]
        && lengths.shape() == [sides];
    if !alike {
        return Err(PyValueError::new_err("sides have their points alike"));
    }
    let (basis, offsets) = (basis.as_array(), offsets.as_array());
    let (used, lengths) = (used.as_array(), lengths.as_array());
    let side = |side: usize| SidePoints {
        basis: (0..points)
            .map(|point| Vector4::from_fn(|k, _| basis[[side, point, k]]))
            .collect(),
        offsets: (0..points).map(|point| offsets[[side, point]]).collect(),
        used: (0..points).map(|point| used[[side, point]]).collect(),
        length: lengths[side],
    };
    let all: Vec<SidePoints> = (0..sides).map(side).collect();
    let cubics = detached(py, || match trimmed {
        true => trimmed_cubics(&all),
        false => all.iter().map(SidePoints::cubic).collect(),
    })?;
    let values = cubics.iter().flat_map(|cubic| <[f64; 4]>::from(*cubic));
    Ok(arrays::from_rows(py, sides, 4, values))
}
