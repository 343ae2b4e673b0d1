//! Photographs, copied once, and the edges in them.

use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trisquare::{EdgeSpan, PictureTone, PowerCurve, Tone, ToneEstimate};

use crate::arrays;
use crate::errors::detached;

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

/// As [`tone`], or the gamma and the toe of a curve to be estimated and, where no curve fits, the
/// standard deviation of the shift that is left.
pub fn picture_tone(value: &Bound<'_, PyAny>) -> PyResult<PictureTone> {
    let found = match value.extract::<(f64, f64, Option<f64>)>() {
        Err(_) => PictureTone::Known(tone(value)?),
        Ok((gamma, toe, None)) => PictureTone::Estimated(PowerCurve { gamma, toe }),
        Ok((gamma, toe, Some(std))) => PictureTone::Shifted(PowerCurve { gamma, toe }, std),
    };
    if !found.is_valid() {
        return Err(PyValueError::new_err("an estimated tone curve is not one"));
    }
    Ok(found)
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

type Bounds = (Option<usize>, Option<usize>);

/// A path, its rise and the spans that bound it; of an edge the room beside it; of a grid line the
/// spans that cross it, with the number of each crossing, and the rims of the markers after them.
#[derive(FromPyObject)]
pub enum Span<'py> {
    MarkedLine(
        PyReadonlyArray2<'py, f64>,
        f64,
        Bounds,
        Vec<(Option<usize>, usize)>,
        Vec<f64>,
    ),
    GridLine(
        PyReadonlyArray2<'py, f64>,
        f64,
        Bounds,
        Vec<(Option<usize>, usize)>,
    ),
    Confined(PyReadonlyArray2<'py, f64>, f64, Bounds, (f64, f64)),
    Edge(PyReadonlyArray2<'py, f64>, f64, Bounds),
}

/// Points with their standard deviations and common displacement, or why there are none.
#[derive(IntoPyObject)]
pub enum Measured<'py> {
    Samples(
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Option<Bound<'py, PyArray2<f64>>>,
    ),
    Reason(String),
}

/// The samples of every span, and what is known of the tone curve if it was estimated.
type Localised<'py> = (Vec<Measured<'py>>, Option<Bound<'py, PyDict>>);

/// Sub-pixel samples along coarsely known spans; a reason where there is no edge.
///
/// Without a tone it is estimated, and the samples come with their displacement by one standard
/// deviation of it.
#[pyfunction]
#[pyo3(signature = (picture, spans, tone))]
pub fn localise<'py>(
    py: Python<'py>,
    picture: &Picture,
    spans: Vec<Span<'py>>,
    tone: Option<&Bound<'py, PyAny>>,
) -> PyResult<Localised<'py>> {
    let tone = tone.map(self::tone).transpose()?;
    let spans = edge_spans(&spans)?;
    let picture = &picture.picture;
    let (found, estimate) = detached(py, || match tone {
        Some(tone) => (trisquare::localise(picture, &spans, tone), None),
        None => {
            let (found, estimate) = trisquare::localise_with_unknown_tone(picture, &spans);
            (found, Some(estimate))
        }
    })?;
    let measured = found.into_iter().map(|span| match span {
        Ok(edges) => Measured::Samples(
            arrays::from_points(py, &edges.points),
            arrays::from_slice(py, &edges.std),
            estimate.map(|_| arrays::from_points(py, &edges.tone_drift)),
        ),
        Err(reason) => Measured::Reason(reason.to_string()),
    });
    let estimate = estimate.map(|estimate| tone_dict(py, &estimate));
    Ok((measured.collect(), estimate.transpose()?))
}

fn tone_dict<'py>(py: Python<'py>, estimate: &ToneEstimate) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("gamma", estimate.curve.gamma)?;
    dict.set_item("toe", estimate.curve.toe)?;
    dict.set_item("effective_gamma", estimate.curve.effective_gamma())?;
    dict.set_item("std", estimate.effective_gamma_std())?;
    dict.set_item("sides", estimate.sides)?;
    dict.set_item("misfit", estimate.misfit)?;
    dict.set_item("shift_std", estimate.shift_std)?;
    Ok(dict)
}

fn edge_spans(spans: &[Span<'_>]) -> PyResult<Vec<EdgeSpan>> {
    let count = spans.len();
    let spans: Vec<EdgeSpan> = spans
        .iter()
        .map(|span| {
            let (Span::MarkedLine(path, polarity, bounds, ..)
            | Span::GridLine(path, polarity, bounds, _)
            | Span::Confined(path, polarity, bounds, _)
            | Span::Edge(path, polarity, bounds)) = span;
            let mut edge = EdgeSpan::new(arrays::points(path)?, *polarity);
            edge.bounds = [bounds.0, bounds.1];
            match span {
                Span::MarkedLine(.., crossings, rims) => {
                    edge.crossings.clone_from(crossings);
                    edge.rims.clone_from(rims);
                }
                Span::GridLine(.., crossings) => edge.crossings.clone_from(crossings),
                Span::Confined(.., room) => edge.margin = [room.0, room.1],
                Span::Edge(..) => {}
            }
            Ok(edge)
        })
        .collect::<PyResult<_>>()?;
    let met = |span: &EdgeSpan| {
        let bounds = span.bounds.into_iter().flatten();
        let crossings = span.crossings.iter().filter_map(|crossing| crossing.0);
        bounds.chain(crossings).max()
    };
    if spans.iter().filter_map(met).any(|other| other >= count) {
        return Err(PyValueError::new_err("a span meets one that is not there"));
    }
    Ok(spans)
}
