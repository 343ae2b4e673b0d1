//! Newton's method on saddle points of a picture. So short a work needs no copy of the picture: the
//! GIL is held.

use nalgebra::Vector2;
use numpy::{PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::internals::{GreyBytes, SaddleStep, settled_on_saddle};

use crate::arrays;
use crate::crossings::{bytes_of, no_picture};

type Steps<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Where the slope vanishes relative to pixels, shape (N, 2), and the second derivatives xx, xy, yy
/// and their determinant there, shape (N, 4).
#[pyfunction]
#[pyo3(signature = (picture, pixels))]
pub fn saddle_steps<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    pixels: PyReadonlyArray2<'py, i64>,
) -> PyResult<Steps<'py>> {
    let (width, height, values) = bytes_of(&picture);
    let grey = GreyBytes::new(width, height, &values).ok_or_else(no_picture)?;
    if pixels.shape()[1] != 2 {
        return Err(PyValueError::new_err("a pixel has two coordinates"));
    }
    let view = pixels.as_array();
    let steps: Option<Vec<SaddleStep>> = view
        .rows()
        .into_iter()
        .map(|pixel| {
            let pixel = [pixel[0], pixel[1]].map(|at| usize::try_from(at).unwrap_or(0));
            SaddleStep::from(&grey, pixel)
        })
        .collect();
    let steps = steps.ok_or_else(|| PyValueError::new_err("the picture is too small"))?;
    let offsets: Vec<Vector2<f64>> = steps.iter().map(|step| step.offset).collect();
    let curvatures = steps
        .iter()
        .flat_map(|step| <[f64; 4]>::from(step.curvature));
    Ok((
        arrays::from_points(py, &offsets),
        arrays::from_rows(py, steps.len(), 4, curvatures),
    ))
}

/// Points, shape (N, 2), moved onto the saddle next to them where there is one.
#[pyfunction]
#[pyo3(signature = (picture, points))]
pub fn settle_on_saddles<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (width, height, values) = bytes_of(&picture);
    let grey = GreyBytes::new(width, height, &values).ok_or_else(no_picture)?;
    let settled: Vec<Vector2<f64>> = arrays::points(&points)?
        .into_iter()
        .map(|point| settled_on_saddle(&grey, point))
        .collect();
    Ok(arrays::from_points(py, &settled))
}
