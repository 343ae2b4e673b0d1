//! From the Python class `PlaneEdges` to the crate's.

use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Freedom, PlaneEdges, Polarity};

use crate::arrays;
use crate::errors::computed;

/// The lines of a unit square whose sides were sampled in order round it, either way round.
#[pyfunction]
#[pyo3(signature = (sides))]
pub fn square_lines<'py>(
    py: Python<'py>,
    sides: Vec<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let sides: Vec<_> = sides.iter().map(arrays::points).collect::<PyResult<_>>()?;
    let square = computed(py, || PlaneEdges::square(sides))?;
    Ok(arrays::from_lines(py, &square.lines))
}

/// Copies a Python `PlaneEdges`, whose own constructor has checked it.
pub fn plane_edges(object: &Bound<'_, PyAny>) -> PyResult<PlaneEdges> {
    let lines: PyReadonlyArray2<'_, f64> = object.getattr("lines")?.extract()?;
    let points: Vec<PyReadonlyArray2<'_, f64>> = object.getattr("points")?.extract()?;
    let std: Option<Vec<PyReadonlyArray1<'_, f64>>> = object.getattr("std")?.extract()?;
    let drift: Option<Vec<PyReadonlyArray2<'_, f64>>> = object.getattr("drift")?.extract()?;
    let drift = drift.map(|all| all.iter().map(arrays::points).collect::<PyResult<_>>());
    let polarity: Option<i64> = object.getattr("polarity")?.extract()?;
    let freedom: String = object.getattr("freedom")?.extract()?;
    Ok(PlaneEdges {
        lines: arrays::lines(&lines)?,
        points: points.iter().map(arrays::points).collect::<PyResult<_>>()?,
        std: std.map(|all| all.iter().map(|s| s.as_array().to_vec()).collect()),
        polarity: polarity.map(|p| match p {
            1.. => Polarity::DarkInside,
            _ => Polarity::LightInside,
        }),
        plane: object.getattr("plane")?.extract()?,
        image: object.getattr("image")?.extract()?,
        tone_drift: drift.transpose()?,
        border: object.getattr("border")?.extract()?,
        freedom: match freedom.as_str() {
            "auto" => Freedom::Auto,
            "fixed" => Freedom::Fixed,
            "size" => Freedom::Size,
            "similarity" => Freedom::Similarity,
            other => return Err(PyValueError::new_err(format!("unknown freedom {other:?}"))),
        },
    })
}
