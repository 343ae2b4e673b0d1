//! Conversion from the Python class `PlaneEdges` to the crate's.

use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{CellSample, Freedom, GridLineSamples, PlaneEdges, Polarity};

use crate::arrays;
use crate::errors::{computed, detached};

/// The lines of a rectangle whose sides were sampled in order around it, in either direction; side
/// 0 is `aspect` times as long as side 1.
#[pyfunction]
#[pyo3(signature = (sides, aspect))]
pub fn rectangle_lines<'py>(
    py: Python<'py>,
    sides: Vec<PyReadonlyArray2<'py, f64>>,
    aspect: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let sides: Vec<_> = sides.iter().map(arrays::points).collect::<PyResult<_>>()?;
    let rectangle = computed(py, || PlaneEdges::rectangle(sides, aspect))?;
    Ok(arrays::from_lines(py, &rectangle.lines))
}

/// The directions of sampled lines in two orthogonal families of parallels, as lines.
#[pyfunction]
#[pyo3(signature = (along_x, along_y))]
pub fn family_lines<'py>(
    py: Python<'py>,
    along_x: Vec<PyReadonlyArray2<'py, f64>>,
    along_y: Vec<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = |lines: &[PyReadonlyArray2<'py, f64>]| {
        let lines = lines.iter().map(arrays::points);
        lines.collect::<PyResult<Vec<_>>>()
    };
    let (along_x, along_y) = (points(&along_x)?, points(&along_y)?);
    let families = computed(py, || PlaneEdges::families(along_x, along_y))?;
    Ok(arrays::from_lines(py, &families.lines))
}

/// Points (N, 2) of a grid line, their deviations and cells, (N,), and the sign of its even cells.
type GridLine<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, i64>,
    f64,
);

/// Points (N, 2), their deviations and cells, (N,).
type Samples<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
);

/// The samples of a chessboard's grid lines corrected for their shift towards the light, and the
/// shift; samples may be omitted.
#[pyfunction]
#[pyo3(signature = (lines))]
pub fn remove_edge_shift<'py>(
    py: Python<'py>,
    lines: Vec<GridLine<'py>>,
) -> PyResult<(Vec<Samples<'py>>, f64)> {
    let mut lines: Vec<_> = lines.iter().map(grid_line).collect::<PyResult<_>>()?;
    let shift = detached(py, || trisquare::remove_edge_shift(&mut lines))?;
    let samples = lines.iter().map(|line| {
        let points: Vec<_> = line.samples.iter().map(|sample| sample.point).collect();
        let std: Vec<_> = line.samples.iter().map(|sample| sample.std).collect();
        let cells = line.samples.iter().map(|sample| sample.cell as i64);
        (
            arrays::from_points(py, &points),
            arrays::from_slice(py, &std),
            PyArray1::from_iter(py, cells),
        )
    });
    Ok((samples.collect(), shift))
}

fn grid_line((points, std, cells, contrast_sign): &GridLine<'_>) -> PyResult<GridLineSamples> {
    let points = arrays::points(points)?;
    let (std, cells) = (std.as_array(), cells.as_array());
    if points.len() < 2 || std.len() != points.len() || cells.len() != points.len() {
        return Err(PyValueError::new_err(
            "a grid line has two points or more, a deviation and a cell for each",
        ));
    }
    let sample = |((point, std), cell): ((Vector2<f64>, &f64), &i64)| {
        Ok(CellSample {
            point,
            std: *std,
            cell: usize::from(u16::try_from(*cell)?),
        })
    };
    let samples = points.into_iter().zip(std).zip(cells).map(sample);
    Ok(GridLineSamples {
        samples: samples.collect::<PyResult<_>>()?,
        contrast_sign: *contrast_sign,
    })
}

/// Copies a Python `PlaneEdges`, which its constructor has checked.
pub fn plane_edges(object: &Bound<'_, PyAny>) -> PyResult<PlaneEdges> {
    let lines: PyReadonlyArray2<'_, f64> = object.getattr("lines")?.extract()?;
    let points: Vec<PyReadonlyArray2<'_, f64>> = object.getattr("points")?.extract()?;
    let std: Option<Vec<PyReadonlyArray1<'_, f64>>> = object.getattr("std")?.extract()?;
    let drift: Option<Vec<PyReadonlyArray2<'_, f64>>> = object.getattr("drift")?.extract()?;
    let drift = drift.map(|all| all.iter().map(arrays::points).collect::<PyResult<_>>());
    let polarity: Option<i64> = object.getattr("polarity")?.extract()?;
    let freedom: String = object.getattr("freedom")?.extract()?;
    let radii: Option<Vec<Option<f64>>> = object.getattr("radii")?.extract()?;
    Ok(PlaneEdges {
        lines: arrays::lines(&lines)?,
        radii: radii.unwrap_or_default(),
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
        side_error: 0.0,
        relations: Vec::new(),
        freedom: match freedom.as_str() {
            "auto" => Freedom::Auto,
            "fixed" => Freedom::Fixed,
            "size" => Freedom::Size,
            "similarity" => Freedom::Similarity,
            "aspect" => Freedom::Aspect,
            "offsets" => Freedom::Offsets,
            "line" => Freedom::Line,
            other => return Err(PyValueError::new_err(format!("unknown freedom {other:?}"))),
        },
    })
}
