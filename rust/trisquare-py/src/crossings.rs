//! Crossings of a chessboard's grid lines and how they follow one another.

use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Crossing, GreyBytes};

use crate::arrays;

type Linked<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray2<i64>>);

/// Number of the crossing that follows in each of four directions, and its direction back, or -1.
#[pyfunction]
#[pyo3(signature = (picture, points, edges))]
pub fn link_crossings<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    points: PyReadonlyArray2<'py, f64>,
    edges: PyReadonlyArray2<'py, f64>,
) -> PyResult<Linked<'py>> {
    let points = arrays::points(&points)?;
    let edges = arrays::points(&edges)?;
    if edges.len() != 2 * points.len() {
        return Err(PyValueError::new_err("a crossing has two edges"));
    }
    let crossings: Vec<Crossing> = points
        .iter()
        .zip(edges.chunks_exact(2))
        .map(|(&point, edges)| Crossing {
            point,
            edges: [edges[0], edges[1]],
        })
        .collect();
    let (height, width) = (picture.shape()[0], picture.shape()[1]);
    let values: Vec<u8> = picture.as_array().iter().copied().collect();
    let grey = GreyBytes::new(width, height, &values)
        .ok_or_else(|| PyValueError::new_err("the picture is empty"))?;
    let linked = py.detach(|| trisquare::link_crossings(&grey, &crossings));
    let following = PyArray2::zeros(py, [linked.len(), 4], false);
    let back = PyArray2::zeros(py, [linked.len(), 4], false);
    {
        let (mut following, mut back) = (following.readwrite(), back.readwrite());
        let (mut following, mut back) = (following.as_array_mut(), back.as_array_mut());
        for (number, followers) in linked.iter().enumerate() {
            for (direction, follower) in followers.iter().enumerate() {
                let place = [number, direction];
                following[place] = follower.map_or(-1, |f| f.crossing as i64);
                back[place] = follower.map_or(-1, |f| f.back as i64);
            }
        }
    }
    Ok((following, back))
}
