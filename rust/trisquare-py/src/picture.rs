//! Photographs, copied once, and the edges in them.

use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use trisquare::{EdgeSpan, Tone};

use crate::arrays;

/// The raw pixels of a photograph, `(H, W)` or `(H, W, 3)` in BGR order, in memory of its own.
#[pyclass(frozen, module = "trisquare._core")]
pub struct Picture {
    pub picture: trisquare::Picture,
}

#[pymethods]
impl Picture {
    #[new]
    #[pyo3(signature = (pixels, /))]
    fn new(pixels: &Bound<'_, PyAny>) -> PyResult<Self> {
        let picture = if let Ok(array) = pixels.extract::<PyReadonlyArrayDyn<'_, u8>>() {
            let (width, height, channels, values) = contiguous(array.as_array())?;
            trisquare::Picture::from_u8(width, height, channels, values)
        } else if let Ok(array) = pixels.extract::<PyReadonlyArrayDyn<'_, u16>>() {
            let (width, height, channels, values) = contiguous(array.as_array())?;
            trisquare::Picture::from_u16(width, height, channels, values)
        } else if let Ok(array) = pixels.extract::<PyReadonlyArrayDyn<'_, f32>>() {
            let (width, height, channels, values) = contiguous(array.as_array())?;
            trisquare::Picture::from_f32(width, height, channels, values)
        } else {
            return Err(PyTypeError::new_err(
                "an image is an array of uint8, uint16 or float32",
            ));
        };
        let picture = picture.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { picture })
    }

    /// `(width, height)` in pixels.
    #[getter]
    fn size(&self) -> (usize, usize) {
        (self.picture.width(), self.picture.height())
    }
}

/// Width, height, channels and the values in row order, whatever the strides.
fn contiguous<T: Copy, D: Dimension>(
    view: ArrayView<'_, T, D>,
) -> PyResult<(usize, usize, usize, Vec<T>)> {
    let (height, width, channels) = match *view.shape() {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3)] => (height, width, channels),
        ref other => {
            return Err(PyValueError::new_err(format!(
                "an image has the shape (H, W) or (H, W, 3), not {other:?}"
            )));
        }
    };
    let values = match view.as_slice() {
        Some(values) => values.to_vec(),
        None => view.iter().copied().collect(),
    };
    Ok((width, height, channels, values))
}

/// `"linear"`, `"srgb"` or a gamma.
pub fn tone(value: &Bound<'_, PyAny>) -> PyResult<Tone> {
    let tone = if let Ok(name) = value.extract::<String>() {
        match name.as_str() {
            "linear" => Tone::Linear,
            "srgb" => Tone::Srgb,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "unknown tone curve {name:?}"
                )));
            }
        }
    } else {
        Tone::Gamma(value.extract()?)
    };
    if !tone.is_valid() {
        return Err(PyValueError::new_err("a gamma must be positive and finite"));
    }
    Ok(tone)
}

type Span<'py> = (
    PyReadonlyArray2<'py, f64>,
    f64,
    (Option<usize>, Option<usize>),
);

/// Points with their standard deviations, or why there are none.
#[derive(IntoPyObject)]
pub enum Measured<'py> {
    Samples(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>),
    Reason(String),
}

/// Sub-pixel samples along coarsely known spans; a reason where there is no edge.
#[pyfunction]
#[pyo3(signature = (picture, spans, tone))]
pub fn localise<'py>(
    py: Python<'py>,
    picture: &Picture,
    spans: Vec<Span<'py>>,
    tone: &Bound<'py, PyAny>,
) -> PyResult<Vec<Measured<'py>>> {
    let tone = self::tone(tone)?;
    let count = spans.len();
    let spans: Vec<EdgeSpan> = spans
        .iter()
        .map(|(path, rise, bounds)| {
            Ok(EdgeSpan {
                path: arrays::points(path)?,
                rise: *rise,
                bounds: [bounds.0, bounds.1],
            })
        })
        .collect::<PyResult<_>>()?;
    if spans
        .iter()
        .flat_map(|s| s.bounds)
        .flatten()
        .any(|bound| bound >= count)
    {
        return Err(PyValueError::new_err(
            "a span is bounded by one that is not there",
        ));
    }
    let found = py.detach(|| trisquare::localise(&picture.picture, &spans, tone));
    Ok(found
        .into_iter()
        .map(|span| match span {
            Ok(edges) => Measured::Samples(
                arrays::from_points(py, &edges.points),
                arrays::from_slice(py, &edges.std),
            ),
            Err(reason) => Measured::Reason(reason.to_string()),
        })
        .collect())
}
