//! From the Python class `PlaneEdges` to the crate's.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Freedom, PlaneEdges, Polarity};

use crate::arrays;

/// Copies a Python `PlaneEdges`, whose own constructor has checked it.
pub fn plane_edges(object: &Bound<'_, PyAny>) -> PyResult<PlaneEdges> {
    let lines: PyReadonlyArray2<'_, f64> = object.getattr("lines")?.extract()?;
    let points: Vec<PyReadonlyArray2<'_, f64>> = object.getattr("points")?.extract()?;
    let std: Option<Vec<PyReadonlyArray1<'_, f64>>> = object.getattr("std")?.extract()?;
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
        freedom: match freedom.as_str() {
            "auto" => Freedom::Auto,
            "fixed" => Freedom::Fixed,
            "size" => Freedom::Size,
            "similarity" => Freedom::Similarity,
            other => return Err(PyValueError::new_err(format!("unknown freedom {other:?}"))),
        },
    })
}
