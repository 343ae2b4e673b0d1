//! The search for boards: saddle points, the crossings that edges link, lattices, the surface that
//! their crossings lie on, and cubics along sides.
//!
//! Newton's method on saddle points is so short a work that it needs no copy of the picture: the GIL
//! is held.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::{Vector2, Vector4};
use numpy::{
    PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::internals::{
    Crossing, GreyBytes, Lattice, LatticeSurface, SaddleStep, SidePoints, Site, refine_corner,
    trimmed_cubics,
};

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
    let linked = detached(py, || {
        trisquare::internals::link_crossings(&grey, &crossings)
    })?;
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
fn bytes_of<'a>(picture: &'a PyReadonlyArray2<'_, u8>) -> (usize, usize, Cow<'a, [u8]>) {
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
        .map(|point| refine_corner(&grey, point))
        .collect();
    Ok(arrays::from_points(py, &settled))
}

type Fitted<'py> = (Bound<'py, PyArray2<f64>>, f64);

/// Homography and bend of a lattice, shape (rows, columns, 2), NaN where there is no crossing.
#[pyfunction]
#[pyo3(signature = (grid, middle, size))]
pub fn fit_lattice_surface<'py>(
    py: Python<'py>,
    grid: PyReadonlyArray3<'py, f64>,
    middle: (f64, f64),
    size: f64,
) -> PyResult<Fitted<'py>> {
    let middle = Vector2::new(middle.0, middle.1);
    let (sites, points): (Vec<_>, Vec<_>) = sites_of(&grid)?
        .into_iter()
        .map(|((row, column), point)| {
            let site = Vector2::new(f64::from(column), f64::from(row));
            (site, (point - middle) / size)
        })
        .unzip();
    let surface = detached(py, || LatticeSurface::fitted(&sites, &points, size))?;
    Ok((arrays::from_matrix3(py, &surface.homography), surface.bend))
}

/// Points of a surface, in half diagonals from the picture's middle, at columns and rows, shape
/// (N, 2); NaN where there is none.
#[pyfunction]
#[pyo3(signature = (homography, bend, sites))]
pub fn lattice_surface_points<'py>(
    py: Python<'py>,
    homography: PyReadonlyArray2<'py, f64>,
    bend: f64,
    sites: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let surface = surface(&homography, bend)?;
    let sites = arrays::points(&sites)?;
    let points: Vec<_> = sites.into_iter().map(|site| surface.at(site)).collect();
    Ok(arrays::from_points(py, &points))
}

/// Columns and rows of points, shape (N, 2), in half diagonals from the picture's middle.
#[pyfunction]
#[pyo3(signature = (homography, bend, points))]
pub fn lattice_surface_sites<'py>(
    py: Python<'py>,
    homography: PyReadonlyArray2<'py, f64>,
    bend: f64,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let surface = surface(&homography, bend)?;
    let sites = surface.sites(&arrays::points(&points)?);
    Ok(arrays::from_points(py, &sites))
}

fn surface(homography: &PyReadonlyArray2<'_, f64>, bend: f64) -> PyResult<LatticeSurface> {
    let homography = arrays::matrix3(homography)?;
    Ok(LatticeSurface { homography, bend })
}

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
