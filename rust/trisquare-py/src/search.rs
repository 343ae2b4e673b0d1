//! The search for boards, cubics along the sides of squares, and the edges of a picture as arcs.

use nalgebra::Vector4;
use numpy::{
    PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::internals::{
    ArcLimits, Candidate, GreyBytes, GreyFloats, ReducedPicture, SidePoints, circular_arcs,
    edge_chains, trimmed_cubics,
};

use crate::arrays;
use crate::errors::detached;

/// Pixels (column, row), shape (N, 2), and how strongly the grey levels are curved there, (N,).
type Candidates<'py> = (PyReadonlyArray2<'py, i64>, PyReadonlyArray1<'py, f64>);

/// Crossings of a chessboard's grid lines in rows and columns.
#[pyclass(frozen, module = "trisquare._core")]
pub struct Lattice(trisquare::internals::Lattice);

#[pymethods]
impl Lattice {
    /// In pixels of the photograph, shape (rows, columns, 2); NaN where there is none.
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

/// Finds every lattice of 3 x 3 crossings and more in a grey photograph, the largest first.
///
/// The reduced pictures come from coarse to fine, each with its candidates; `candidates` returns
/// those of the photograph itself, if the search needs them.
#[pyfunction]
#[pyo3(signature = (photograph, pictures, candidates))]
pub fn find_lattices(
    py: Python<'_>,
    photograph: PyReadonlyArray2<'_, u8>,
    pictures: Vec<(PyReadonlyArray2<'_, u8>, Candidates<'_>)>,
    candidates: Py<PyAny>,
) -> PyResult<Vec<Lattice>> {
    let bytes: Vec<Vec<u8>> = pictures
        .iter()
        .map(|(picture, _)| bytes_of(picture))
        .collect();
    let reduced = pictures
        .iter()
        .zip(&bytes)
        .map(|((picture, candidates), bytes)| {
            Ok(ReducedPicture {
                picture: grey(picture, bytes)?,
                candidates: candidates_of(candidates)?,
            })
        });
    let reduced = reduced.collect::<PyResult<Vec<_>>>()?;
    let whole = bytes_of(&photograph);
    let whole = grey(&photograph, &whole)?;
    let found = detached(py, || {
        trisquare::internals::find_lattices(&whole, &reduced, || {
            Python::attach(|py| candidates_of(&candidates.call0(py)?.extract(py)?))
        })
    })??;
    Ok(found.into_iter().map(Lattice).collect())
}

fn candidates_of((pixels, strengths): &Candidates<'_>) -> PyResult<Vec<Candidate>> {
    if pixels.shape() != [strengths.len(), 2] {
        return Err(PyValueError::new_err(
            "a pixel has two coordinates and a strength",
        ));
    }
    let (pixels, strengths) = (pixels.as_array(), strengths.as_array());
    let candidate = |(pixel, strength): (_, &f64)| {
        let pixel: numpy::ndarray::ArrayView1<'_, i64> = pixel;
        Ok(Candidate {
            pixel: [usize::try_from(pixel[0])?, usize::try_from(pixel[1])?],
            strength: *strength,
        })
    };
    pixels
        .rows()
        .into_iter()
        .zip(strengths)
        .map(candidate)
        .collect()
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
    let cubics: Vec<_> = detached(py, || match trimmed {
        true => trimmed_cubics(&all),
        false => all.iter().map(SidePoints::cubic).collect(),
    })?;
    Ok(arrays::from_points(py, &cubics))
}

/// Arcs of circles among the edges of a grey picture, each of shape (N, 2), in pixels.
///
/// An edge's gradient is at least `weak`, and `strong` somewhere; the means of a few points are
/// within `tolerance` of the arc, which has `shortest` points and `smallest_radius` at least.
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
