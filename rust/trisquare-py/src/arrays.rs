//! Between numpy arrays and nalgebra, always by copy.

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector2, Vector3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::Line;

use crate::errors::exception;

/// Points of an `(N, 2)` array.
pub fn points(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Vector2<f64>>> {
    columns(array, 2)?;
    let view = array.as_array();
    Ok(view
        .rows()
        .into_iter()
        .map(|r| Vector2::new(r[0], r[1]))
        .collect())
}

/// Points of an `(N, 3)` array.
pub fn space_points(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Vector3<f64>>> {
    columns(array, 3)?;
    let view = array.as_array();
    Ok(view
        .rows()
        .into_iter()
        .map(|r| Vector3::new(r[0], r[1], r[2]))
        .collect())
}

/// A matrix of any shape.
pub fn matrix(array: &PyReadonlyArray2<'_, f64>) -> DMatrix<f64> {
    let view = array.as_array();
    DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| view[[i, j]])
}

/// Lines of an `(L, 3)` array.
pub fn lines(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Line>> {
    columns(array, 3)?;
    let view = array.as_array();
    view.rows()
        .into_iter()
        .map(|r| Line::new(r[0], r[1], r[2]).map_err(exception))
        .collect()
}

/// A `(3, 3)` array.
pub fn matrix3(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Matrix3<f64>> {
    sized_matrix(array)
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

fn columns(array: &PyReadonlyArray2<'_, f64>, count: usize) -> PyResult<()> {
    if array.shape()[1] != count {
        return Err(shape_error(&format!("(N, {count})"), array.shape()));
    }
    Ok(())
}

fn shape_error(expected: &str, found: &[usize]) -> PyErr {
    PyValueError::new_err(format!(
        "expected an array of shape {expected}, got {found:?}"
    ))
}

/// An `(N, 2)` array of points.
pub fn from_points<'py>(py: Python<'py>, points: &[Vector2<f64>]) -> Bound<'py, PyArray2<f64>> {
    let rows = points.len();
    from_rows(py, rows, 2, points.iter().flat_map(|p| [p.x, p.y]))
}

/// An `(N, 3)` array of points.
pub fn from_space_points<'py>(
    py: Python<'py>,
    points: &[Vector3<f64>],
) -> Bound<'py, PyArray2<f64>> {
    let values = points.iter().flat_map(|p| [p.x, p.y, p.z]);
    from_rows(py, points.len(), 3, values)
}

/// An `(N, R, C)` array of matrices.
pub fn from_matrices<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    matrices: &[SMatrix<f64, R, C>],
) -> Bound<'py, PyArray3<f64>> {
    let array = PyArray3::zeros(py, [matrices.len(), R, C], false);
    {
        let mut filled = array.readwrite();
        let mut places = filled.as_array_mut();
        for ((i, row, column), value) in places.indexed_iter_mut() {
            *value = matrices[i][(row, column)];
        }
    }
    array
}

/// An `(L, 3)` array of lines.
pub fn from_lines<'py>(py: Python<'py>, lines: &[Line]) -> Bound<'py, PyArray2<f64>> {
    let coefficients = lines.iter().map(Line::coefficients);
    from_rows(
        py,
        lines.len(),
        3,
        coefficients.flat_map(|l| [l.x, l.y, l.z]),
    )
}

/// A `(3, 3)` array.
pub fn from_matrix3<'py>(py: Python<'py>, matrix: &Matrix3<f64>) -> Bound<'py, PyArray2<f64>> {
    from_rows(py, 3, 3, matrix.transpose().iter().copied())
}

/// A matrix of any size.
pub fn from_matrix<'py>(py: Python<'py>, matrix: &DMatrix<f64>) -> Bound<'py, PyArray2<f64>> {
    from_rows(
        py,
        matrix.nrows(),
        matrix.ncols(),
        matrix.transpose().iter().copied(),
    )
}

/// A two-dimensional array of values in row order.
pub fn from_rows<'py>(
    py: Python<'py>,
    rows: usize,
    columns: usize,
    values: impl Iterator<Item = f64>,
) -> Bound<'py, PyArray2<f64>> {
    let array = PyArray2::zeros(py, [rows, columns], false);
    {
        let mut filled = array.readwrite();
        for (place, value) in filled.as_array_mut().iter_mut().zip(values) {
            *place = value;
        }
    }
    array
}

/// A one-dimensional array.
pub fn from_slice<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, values)
}
