//! Search for boards, contours with four sides, smooth sides, and edges that are arcs.

use nalgebra::Vector2;
use numpy::ndarray::{Array2, Array3, Array4};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArray2, PyReadonlyArray4, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::internals::{
    ArcLimits, GreyBytes, GreyFloats, POINTS_PER_SIDE, SideLimits, Sides, circular_arcs,
    edge_chains, four_cornered, four_sided,
};

use crate::arrays;
use crate::errors::detached;

/// Crossings of a chessboard's grid lines in rows and columns.
#[pyclass(frozen, module = "trisquare._core")]
pub struct Lattice(trisquare::internals::Lattice);

#[pymethods]
impl Lattice {
    /// Crossings in pixels of the photograph, shape (rows, columns, 2); NaN for missing ones.
    #[getter]
    fn crossings<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        let [rows, columns] = self.0.size();
        let crossings = PyArray3::zeros(py, [rows, columns, 2], false);
        {
            let mut filled = crossings.readwrite();
            let mut filled = filled.as_array_mut();
            filled.fill(f64::NAN);
            for ((row, column), point) in self.0.found() {
                filled[[row as usize, column as usize, 0]] = point.x;
                filled[[row as usize, column as usize, 1]] = point.y;
            }
        }
        crossings
    }
}

/// Finds all lattices of at least 3 x 3 crossings in a grey photograph, the largest first, and
/// counts the crossings outside them.
///
/// The reduced pictures are given from coarse to fine.
#[pyfunction]
#[pyo3(signature = (photograph, pictures))]
pub fn find_lattices(
    py: Python<'_>,
    photograph: PyReadonlyArray2<'_, u8>,
    pictures: Vec<PyReadonlyArray2<'_, u8>>,
) -> PyResult<(Vec<Lattice>, usize)> {
    let bytes: Vec<Vec<u8>> = pictures.iter().map(bytes_of).collect();
    let reduced = pictures.iter().zip(&bytes);
    let reduced = reduced.map(|(picture, bytes)| grey(picture, bytes));
    let reduced = reduced.collect::<PyResult<Vec<_>>>()?;
    let whole = bytes_of(&photograph);
    let whole = grey(&photograph, &whole)?;
    let found = detached(py, || trisquare::internals::find_lattices(&whole, &reduced))?;
    let lattices = found.lattices.into_iter().map(Lattice).collect();
    Ok((lattices, found.crossings_beside))
}

/// Sides of quads, shape (Q, 4, N, 2), the levels at which they were found, shape (Q,), and whether
/// they are dark inside, shape (Q,).
type FourSided<'py> = (
    Bound<'py, PyArray4<f64>>,
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray1<bool>>,
);

/// Finds the contours with four corners at some levels of a grey picture.
///
/// Their sides are at least about `least_side` long, and they are `margin` pixels from the border.
#[pyfunction]
#[pyo3(signature = (picture, levels, least_side, margin))]
pub fn find_four_sided<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    levels: Vec<u8>,
    least_side: f64,
    margin: i32,
) -> PyResult<FourSided<'py>> {
    let values = bytes_of(&picture);
    let picture = grey(&picture, &values)?;
    let found = detached(py, || four_sided(&picture, &levels, least_side, margin))?;
    let sides = Array4::from_shape_fn(
        (found.len(), 4, POINTS_PER_SIDE, 2),
        |(q, side, point, k)| found[q].sides[side][point][k],
    );
    let levels = found.iter().map(|quad| quad.level);
    let is_dark = found.iter().map(|quad| quad.is_dark);
    Ok((
        sides.into_pyarray(py),
        PyArray1::from_iter(py, levels),
        PyArray1::from_iter(py, is_dark),
    ))
}

/// Finds the four corners, shape (Q, 4, 2), of the regions of a mask that have four.
///
/// The regions' bounding boxes are at least `least_side` wide.
#[pyfunction]
#[pyo3(signature = (mask, least_side))]
pub fn find_four_cornered<'py>(
    py: Python<'py>,
    mask: PyReadonlyArray2<'py, u8>,
    least_side: i32,
) -> PyResult<Bound<'py, PyArray3<i32>>> {
    let values = bytes_of(&mask);
    let mask = grey(&mask, &values)?;
    let found = detached(py, || four_cornered(&mask, least_side))?;
    let corners = Array3::from_shape_fn((found.len(), 4, 2), |(q, corner, k)| found[q][corner][k]);
    Ok(corners.into_pyarray(py))
}

/// The values of a grey picture in row order.
fn bytes_of(picture: &PyReadonlyArray2<'_, u8>) -> Vec<u8> {
    match picture.as_slice() {
        Ok(values) => values.to_vec(),
        Err(_) => picture.as_array().iter().copied().collect(),
    }
}

fn grey<'a>(picture: &PyReadonlyArray2<'_, u8>, values: &'a [u8]) -> PyResult<GreyBytes<'a>> {
    let (height, width) = (picture.shape()[0], picture.shape()[1]);
    let picture = GreyBytes::new(width, height, values);
    picture.ok_or_else(|| PyValueError::new_err("the picture is empty"))
}

/// Indices of the quads whose sides are smooth edges, shape (G,); their sides, shape (G, 4, N, 2),
/// the steps across these, shape (G, 4), and whether each point is visible, shape (G, 4, N).
type FittedSides<'py> = (
    Bound<'py, PyArray1<usize>>,
    Bound<'py, PyArray4<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<bool>>,
);

/// Measures the sides of rough quads, shape (Q, 4, N, 2); `is_dark`, shape (Q,), says which are
/// dark inside.
///
/// A fraction of at least `least_inliers` of a side's points must be on its curve, for the weakest
/// side `least_inliers_hidden`; the cosine at a corner is at most `most_cosine`.
#[pyfunction]
#[pyo3(signature = (picture, rough, is_dark, least_inliers, least_inliers_hidden, most_cosine))]
pub fn fit_sides<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    rough: PyReadonlyArray4<'py, f64>,
    is_dark: PyReadonlyArray1<'py, bool>,
    least_inliers: f64,
    least_inliers_hidden: f64,
    most_cosine: f64,
) -> PyResult<FittedSides<'py>> {
    if rough.shape() != [is_dark.len(), 4, POINTS_PER_SIDE, 2] {
        return Err(PyValueError::new_err("a quad has four sides and a sign"));
    }
    let limits = SideLimits {
        least_inliers,
        least_inliers_hidden,
        most_cosine,
    };
    let rough = rough.as_array();
    let sides_of = |quad: usize| -> Sides {
        std::array::from_fn(|side| {
            std::array::from_fn(|point| Vector2::from_fn(|k, _| rough[[quad, side, point, k]]))
        })
    };
    let signs = is_dark.as_array();
    let quads: Vec<_> = (0..signs.len())
        .map(|quad| (sides_of(quad), signs[quad]))
        .collect();
    let values = bytes_of(&picture);
    let picture = grey(&picture, &values)?;
    let fitted: Vec<_> = detached(py, || {
        let fit = |(quad, (sides, is_dark)): (usize, &(Sides, bool))| {
            let fitted = trisquare::internals::fit_sides(&picture, sides, *is_dark, &limits)?;
            Some((quad, fitted))
        };
        quads.iter().enumerate().filter_map(fit).collect()
    })?;
    let count = fitted.len();
    let sides = Array4::from_shape_fn((count, 4, POINTS_PER_SIDE, 2), |(q, side, point, k)| {
        fitted[q].1.sides[side][point][k]
    });
    let contrasts = Array2::from_shape_fn((count, 4), |(q, side)| fitted[q].1.contrasts[side]);
    let seen = Array3::from_shape_fn((count, 4, POINTS_PER_SIDE), |(q, side, point)| {
        fitted[q].1.seen[side][point]
    });
    Ok((
        PyArray1::from_iter(py, fitted.iter().map(|(quad, _)| *quad)),
        sides.into_pyarray(py),
        contrasts.into_pyarray(py),
        seen.into_pyarray(py),
    ))
}

/// Arcs of circles among the edges of a grey picture, each of shape (N, 2), in pixels.
///
/// An edge's gradient is at least `weak`, and `strong` somewhere; the means of a few points are
/// within `tolerance` of the arc, which has at least `shortest` points and a radius of at least
/// `smallest_radius`.
#[pyfunction]
#[pyo3(signature = (picture, weak, strong, tolerance, shortest, smallest_radius))]
pub fn find_arcs<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, f32>,
    weak: f32,
    strong: f32,
    tolerance: f64,
    shortest: usize,
    smallest_radius: f64,
) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
    let (height, width) = (picture.shape()[0], picture.shape()[1]);
    let values: Vec<f32> = picture.as_array().iter().copied().collect();
    let limits = ArcLimits {
        tolerance,
        shortest,
        smallest_radius,
    };
    let picture = GreyFloats::new(width, height, &values)
        .ok_or_else(|| PyValueError::new_err("a picture has a value for each pixel"))?;
    let arcs: Vec<Vec<_>> = detached(py, || {
        let chains = edge_chains(&picture, weak, strong);
        let arcs = chains.iter().flat_map(|c| circular_arcs(c, &limits));
        arcs.map(<[_]>::to_vec).collect()
    })?;
    Ok(arcs
        .iter()
        .map(|arc| arrays::from_points(py, arc))
        .collect())
}
