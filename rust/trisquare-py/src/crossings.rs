//! Crossings of a chessboard's grid lines and how they follow one another.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::Vector2;
use numpy::{
    PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Crossing, GreyBytes, Lattice, Site};

use crate::arrays;
use crate::errors::detached;

type Grown<'py> = (Bound<'py, PyArray3<f64>>, Site);
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
    let crossings = crossings_of(&points, &edges)?;
    let (width, height, values) = bytes_of(&picture);
    let values = values.into_owned();
    let grey = GreyBytes::new(width, height, &values).ok_or_else(no_picture)?;
    let linked = detached(py, || trisquare::link_crossings(&grey, &crossings))?;
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

/// The lattice with all neighbouring crossings that fit, and the row and column of its new first
/// site relative to the old one's; NaN where there is none.
#[pyfunction]
#[pyo3(signature = (picture, points, edges, grid, dark_first))]
pub fn grow_lattice<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    points: PyReadonlyArray2<'py, f64>,
    edges: PyReadonlyArray2<'py, f64>,
    grid: PyReadonlyArray3<'py, f64>,
    dark_first: bool,
) -> PyResult<Grown<'py>> {
    let crossings = crossings_of(&points, &edges)?;
    let (width, height, values) = bytes_of(&picture);
    let values = values.into_owned();
    let grey = GreyBytes::new(width, height, &values).ok_or_else(no_picture)?;
    let mut lattice = Lattice {
        crossings: sites_of(&grid)?,
        dark_first,
    };
    detached(py, || lattice.grow(&grey, &crossings))?;
    let sites = || lattice.crossings.keys();
    let first = (
        sites().map(|site| site.0).min().unwrap_or(0),
        sites().map(|site| site.1).min().unwrap_or(0),
    );
    let rows = sites().map(|s| s.0 - first.0 + 1).max().unwrap_or(0) as usize;
    let columns = sites().map(|s| s.1 - first.1 + 1).max().unwrap_or(0) as usize;
    let grown = PyArray3::zeros(py, [rows, columns, 2], false);
    {
        let mut grown = grown.readwrite();
        let mut grown = grown.as_array_mut();
        grown.fill(f64::NAN);
        for (site, point) in &lattice.crossings {
            let (row, column) = ((site.0 - first.0) as usize, (site.1 - first.1) as usize);
            grown[[row, column, 0]] = point.x;
            grown[[row, column, 1]] = point.y;
        }
    }
    Ok((grown, first))
}

fn crossings_of(
    points: &PyReadonlyArray2<'_, f64>,
    edges: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<Crossing>> {
    let points = arrays::points(points)?;
    let edges = arrays::points(edges)?;
    if edges.len() != 2 * points.len() {
        return Err(PyValueError::new_err("a crossing has two edges"));
    }
    let pairs = points.iter().zip(edges.chunks_exact(2));
    Ok(pairs
        .map(|(&point, edges)| Crossing {
            point,
            edges: [edges[0], edges[1]],
        })
        .collect())
}

/// Sites of a lattice, shape `(rows, columns, 2)`, that hold a crossing.
pub fn sites_of(grid: &PyReadonlyArray3<'_, f64>) -> PyResult<BTreeMap<Site, Vector2<f64>>> {
    let view = grid.as_array();
    if view.shape()[2] != 2 {
        return Err(PyValueError::new_err("a point has two coordinates"));
    }
    let mut sites = BTreeMap::new();
    for row in 0..view.shape()[0] {
        for column in 0..view.shape()[1] {
            let point = Vector2::new(view[[row, column, 0]], view[[row, column, 1]]);
            if point.iter().all(|value| value.is_finite()) {
                sites.insert((row as i32, column as i32), point);
            }
        }
    }
    Ok(sites)
}

/// Width, height and the values of a grey picture in row order, borrowed if they lie so.
pub fn bytes_of<'a>(picture: &'a PyReadonlyArray2<'_, u8>) -> (usize, usize, Cow<'a, [u8]>) {
    let (height, width) = (picture.shape()[0], picture.shape()[1]);
    let values = match picture.as_slice() {
        Ok(values) if picture.is_c_contiguous() => Cow::Borrowed(values),
        _ => Cow::Owned(picture.as_array().iter().copied().collect()),
    };
    (width, height, values)
}

pub fn no_picture() -> PyErr {
    PyValueError::new_err("the picture is empty")
}
