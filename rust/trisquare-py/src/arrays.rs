//! Conversion between numpy arrays and nalgebra, always by copy.

use nalgebra::{Const, DMatrix, Dim, Dyn, Matrix, OMatrix, RawStorage, SMatrix, SVector};
use numpy::ndarray::{Array2, Array3};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::Line;

use crate::errors::exception;

/// Points of an `(N, D)` array.
pub fn points<const D: usize>(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<SVector<f64, D>>> {
    if array.shape()[1] != D {
        return Err(shape_error(&format!("(N, {D})"), array.shape()));
    }
    let view = array.as_array();
    let rows = view.rows().into_iter();
    Ok(rows.map(|row| SVector::from_fn(|i, _| row[i])).collect())
}

/// Lines of an `(L, 3)` array.
pub fn lines(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Line>> {
    let line = |l: &SVector<f64, 3>| Line::new(l.x, l.y, l.z).map_err(exception);
    points(array)?.iter().map(line).collect()
}

/// A matrix of any shape.
pub fn matrix(array: &PyReadonlyArray2<'_, f64>) -> DMatrix<f64> {
    let view = array.as_array();
    DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[[i, j]])
}

/// An array of a known shape.
pub fn sized_matrix<const R: usize, const C: usize>(
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<SMatrix<f64, R, C>> {
    if array.shape() != [R, C] {
        return Err(shape_error(&format!("({R}, {C})"), array.shape()));
    }
    let view = array.as_array();
    Ok(SMatrix::from_fn(|i, j| view[[i, j]]))
}

/// An array of a known number of rows.
pub fn columns<const R: usize>(
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<OMatrix<f64, Const<R>, Dyn>> {
    if array.shape()[0] != R {
        return Err(shape_error(&format!("({R}, n)"), array.shape()));
    }
    let view = array.as_array();
    let columns = view.ncols();
    Ok(OMatrix::<f64, Const<R>, Dyn>::from_fn(columns, |i, j| {
        view[[i, j]]
    }))
}

fn shape_error(expected: &str, found: &[usize]) -> PyErr {
    PyValueError::new_err(format!(
        "expected an array of shape {expected}, got {found:?}"
    ))
}

/// An `(N, D)` array of points.
pub fn from_points<'py, const D: usize>(
    py: Python<'py>,
    points: &[SVector<f64, D>],
) -> Bound<'py, PyArray2<f64>> {
    let array = Array2::from_shape_fn((points.len(), D), |(i, j)| points[i][j]);
    PyArray2::from_owned_array(py, array)
}

/// An `(N, R, C)` array of matrices.
pub fn from_matrices<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    matrices: &[SMatrix<f64, R, C>],
) -> Bound<'py, PyArray3<f64>> {
    let array = Array3::from_shape_fn((matrices.len(), R, C), |(n, i, j)| matrices[n][(i, j)]);
    PyArray3::from_owned_array(py, array)
}

/// An `(L, 3)` array of lines.
pub fn from_lines<'py>(py: Python<'py>, lines: &[Line]) -> Bound<'py, PyArray2<f64>> {
    let coefficients: Vec<_> = lines.iter().map(Line::coefficients).collect();
    from_points(py, &coefficients)
}

/// A matrix of any size.
pub fn from_matrix<'py, R: Dim, C: Dim>(
    py: Python<'py>,
    matrix: &Matrix<f64, R, C, impl RawStorage<f64, R, C>>,
) -> Bound<'py, PyArray2<f64>> {
    let array = Array2::from_shape_fn(matrix.shape(), |place| matrix[place]);
    PyArray2::from_owned_array(py, array)
}

/// A one-dimensional array.
pub fn from_slice<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}
