//! Photographs, copied once, and their edges.

use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use trisquare::{EdgeSpan, PictureTone, PowerCurve, Tone};

use crate::arrays;
use crate::errors::detached;
use crate::observations::plane_edges;

/// The raw pixels of a photograph, `(H, W)` or `(H, W, 3)` in BGR order, in their own memory.
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
                "a picture must be an array of uint8, uint16 or float32",
            ));
        };
        let picture = picture.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { picture })
    }

    /// The pixels read by the fit to the pixels, in a picture in which these figures were measured,
    /// with sides of at most this blur (pixels).
    fn near(
        &self,
        py: Python<'_>,
        figures: Vec<Bound<'_, PyAny>>,
        blur: f64,
    ) -> PyResult<KeptPixels> {
        let figures: Vec<_> = figures.iter().map(plane_edges).collect::<PyResult<_>>()?;
        let pixels = detached(py, || {
            trisquare::pixels_to_keep(&self.picture, &figures, blur)
        })?;
        Ok(KeptPixels { pixels })
    }
}

/// The pixels of a picture near the outlines that were measured in it.
#[pyclass(frozen, module = "trisquare._core")]
pub struct KeptPixels {
    pub pixels: trisquare::KeptPixels,
}

/// Width, height, channels and the values in row order, for any strides.
fn contiguous<T: Copy, D: Dimension>(
    view: ArrayView<'_, T, D>,
) -> PyResult<(usize, usize, usize, Vec<T>)> {
    let (height, width, channels) = match *view.shape() {
        [height, width] => (height, width, 1),
        [height, width, channels @ (1 | 3)] => (height, width, channels),
        ref other => {
            return Err(PyValueError::new_err(format!(
                "a picture must have the shape (H, W) or (H, W, 3), not {other:?}"
            )));
        }
    };
    let values = match view.as_slice() {
        Some(values) => values.to_vec(),
        None => view.iter().copied().collect(),
    };
    Ok((width, height, channels, values))
}

/// As [`tone`]; or gamma, toe, whether these are to be estimated, and the standard deviation of the
/// remaining shift, which may be 0 if they are.
pub fn picture_tone(value: &Bound<'_, PyAny>) -> PyResult<PictureTone> {
    let found = match value.extract::<(f64, f64, bool, f64)>() {
        Err(_) => PictureTone::Known(tone(value)?),
        Ok((gamma, toe, is_free, shift_std)) => {
            let curve = PowerCurve { gamma, toe };
            match is_free {
                true if shift_std == 0.0 => PictureTone::Estimated(curve),
                true => PictureTone::Approximated(curve, shift_std),
                false => PictureTone::Shifted(curve, shift_std),
            }
        }
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

/// A coarsely known stretch of edge: the members of Python's `SideSpan`.
#[derive(FromPyObject)]
pub struct SideSpan<'py> {
    path: PyReadonlyArray2<'py, f64>,
    polarity: f64,
    bounds: Bounds,
    margins: (f64, f64),
    crossings: Vec<(Option<usize>, usize)>,
    rims: Vec<f64>,
    tags: Vec<Vec<Vec<bool>>>,
    tag_border: f64,
    is_beside_others: bool,
    far_edge: Option<usize>,
}

/// The samples of one side.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct SideSamples {
    /// Shape (N, 2), pixels.
    points: Py<PyArray2<f64>>,
    /// Standard deviation of each across the side, pixels.
    std: Py<PyArray1<f64>>,
    /// Standard deviation of the edge's blur, pixels.
    blur: f64,
    /// Displacement of each for one standard deviation of an estimated tone curve, pixels.
    drift: Option<Py<PyArray2<f64>>>,
}

/// The samples of a side, or the reason why there are none.
#[derive(IntoPyObject)]
pub enum Measured {
    Samples(Py<SideSamples>),
    Reason(String),
}

/// An estimated tone curve.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct ToneEstimate {
    gamma: f64,
    toe: f64,
    effective_gamma: f64,
    std: f64,
    /// Whether later stages estimate the curve further.
    is_free: bool,
    /// Standard deviation of the remaining shift of all edges, pixels.
    remaining_std: f64,
    /// That standard deviation if the profiles fit no curve.
    shift_std: Option<f64>,
    /// Difference of a stated curve from this one, in standard deviations.
    contradiction: f64,
}

/// Faults of a picture as a whole.
#[pyclass(frozen, module = "trisquare._core")]
pub struct PictureFaults {
    found: trisquare::PictureFaults,
    /// Outward displacement of blue and red in the corners, pixels, if it matters.
    #[pyo3(get)]
    colour_shift: Option<(f64, f64)>,
    /// Whether `mended` uses green light only.
    #[pyo3(get)]
    is_green: bool,
}

#[pymethods]
impl PictureFaults {
    /// The fraction of the sides whose light is clipped.
    #[getter]
    fn clipped(&self) -> f64 {
        self.found.clipped
    }

    /// Whether all pixels are black or white.
    #[getter]
    fn has_two_levels(&self) -> bool {
        self.found.has_two_levels
    }

    /// Displacement of odd rows relative to the even ones, pixels, if it matters.
    #[getter]
    fn row_shift(&self) -> Option<(f64, f64)> {
        self.found.row_shift().map(|shift| (shift.x, shift.y))
    }

    /// The length of the motion, pixels, and its direction, degrees.
    #[getter]
    fn motion(&self) -> Option<(f64, f64)> {
        let motion = self.found.motion?;
        Some((motion.length, motion.direction))
    }

    /// The median of the sides' blurs, as a standard deviation, pixels.
    #[getter]
    fn blur(&self) -> f64 {
        self.found.blur
    }

    /// The amplitude of a fine pattern over the picture, as a fraction of the sides' contrast.
    #[getter]
    fn pattern(&self) -> Option<f64> {
        self.found.pattern
    }

    /// Standard deviation of each side's position due to the faults, pixels.
    #[getter]
    fn side_error(&self) -> f64 {
        self.found.side_error
    }

    /// Standard deviation of the position of a board's lines due to the faults, pixels.
    #[getter]
    fn line_error(&self) -> f64 {
        self.found.line_error
    }

    /// The picture to measure instead; None for the picture itself.
    fn mended(&self, picture: &Picture) -> Option<Picture> {
        let picture = self.found.mended(&picture.picture)?;
        Some(Picture { picture })
    }
}

/// The samples of every span, and the tone curve and faults estimated from their profiles.
type Localised = (Vec<Measured>, ToneEstimate, PictureFaults);

/// Sub-pixel samples along coarsely known spans; a reason if there is no edge.
///
/// Without a tone it is estimated, and the samples include their displacement for one standard
/// deviation of it.
#[pyfunction]
#[pyo3(signature = (picture, spans, tone))]
pub fn localise<'py>(
    py: Python<'py>,
    picture: &Picture,
    spans: Vec<SideSpan<'py>>,
    tone: Option<&Bound<'py, PyAny>>,
) -> PyResult<Localised> {
    let tone = tone.map(self::tone).transpose()?;
    let spans = edge_spans(spans)?;
    let picture = &picture.picture;
    let (found, estimate, faults) = detached(py, || match tone {
        Some(tone) => trisquare::localise(picture, &spans, tone),
        None => trisquare::localise_with_unknown_tone(picture, &spans),
    })?;
    let measured = found.into_iter().map(|side| match side {
        Ok(edges) => {
            let drift = || arrays::from_points(py, &edges.tone_drift).unbind();
            let samples = SideSamples {
                points: arrays::from_points(py, &edges.points).unbind(),
                std: arrays::from_slice(py, &edges.std).unbind(),
                blur: edges.blur,
                drift: tone.is_none().then(drift),
            };
            Ok(Measured::Samples(Py::new(py, samples)?))
        }
        Err(reason) => Ok(Measured::Reason(reason.to_string())),
    });
    Ok((
        measured.collect::<PyResult<_>>()?,
        tone_estimate(&estimate, tone),
        PictureFaults {
            colour_shift: faults.colour_shift(picture).map(Into::into),
            is_green: faults.is_of_green(picture),
            found: faults,
        },
    ))
}

fn tone_estimate(found: &trisquare::ToneEstimate, stated: Option<Tone>) -> ToneEstimate {
    let held = found.shift_with_held_curve();
    ToneEstimate {
        contradiction: stated.map_or(0.0, |tone| found.deviations_from(tone)),
        gamma: found.curve.gamma,
        toe: found.curve.toe,
        effective_gamma: found.curve.effective_gamma(),
        std: found.effective_gamma_std(),
        is_free: held.is_none(),
        remaining_std: held.unwrap_or(found.misfit_shift),
        shift_std: found.shift_std,
    }
}

fn edge_spans(spans: Vec<SideSpan<'_>>) -> PyResult<Vec<EdgeSpan>> {
    let count = spans.len();
    let spans: Vec<EdgeSpan> = spans
        .into_iter()
        .map(|span| {
            Ok(EdgeSpan {
                path: arrays::points(&span.path)?,
                polarity: span.polarity,
                bounds: [span.bounds.0, span.bounds.1],
                crossings: span.crossings,
                rims: span.rims,
                tags: span.tags,
                tag_border: span.tag_border,
                margin: [span.margins.0, span.margins.1],
                is_beside_others: span.is_beside_others,
                far_edge: span.far_edge,
            })
        })
        .collect::<PyResult<_>>()?;
    let last_neighbour = |span: &EdgeSpan| {
        let bounds = span.bounds.into_iter().flatten().chain(span.far_edge);
        let crossings = span.crossings.iter().filter_map(|crossing| crossing.0);
        bounds.chain(crossings).max()
    };
    if spans
        .iter()
        .filter_map(last_neighbour)
        .any(|other| other >= count)
    {
        return Err(PyValueError::new_err("a span meets one that is not there"));
    }
    Ok(spans)
}
