//! The surface that a lattice's crossings lie on.

use nalgebra::Vector2;
use numpy::{PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use trisquare::LatticeSurface;

use crate::arrays;
use crate::crossings::sites_of;
use crate::errors::detached;

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
