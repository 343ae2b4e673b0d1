//! Predicted accuracy of a planned photograph.

use nalgebra::{Vector2, Vector3};
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use trisquare::{EdgeNoise, Method, Options, PlannedPlane, Pose};

use crate::any_lens::{CameraMembers, model_of, with_lens};
use crate::arrays;
use crate::calibration::fixed_parameters;
use crate::errors::computed;
use crate::lens::size;

/// Rotation, translation, and the corners of each outline, `(4, 2)`.
type Planned<'py> = (
    PyReadonlyArray2<'py, f64>,
    [f64; 3],
    Vec<PyReadonlyArray2<'py, f64>>,
);

/// Predicted uncertainty of a camera.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct Prediction {
    parameters: Vec<&'static str>,
    covariance: Py<PyArray2<f64>>,
    std: Py<PyDict>,
}

/// Predicts the covariance of a calibration from planned planes.
#[pyfunction]
#[pyo3(signature = (camera, image_size, planes, *, sigma, spacing, model, fixed, judged, free=Vec::new()))]
#[allow(clippy::too_many_arguments)] // the keywords of the Python function
pub fn predict<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    image_size: (u32, u32),
    planes: Vec<Planned<'py>>,
    sigma: f64,
    spacing: f64,
    model: &str,
    fixed: Vec<String>,
    judged: bool,
    free: Vec<String>,
) -> PyResult<Prediction> {
    let size = size(image_size);
    let planes: Vec<PlannedPlane> = planes.iter().map(planned).collect::<PyResult<_>>()?;
    let noise = EdgeNoise { sigma, spacing };
    let fixed = fixed_parameters(&fixed, &free)?;
    let found = with_lens!(camera.lens(py)?, |camera| {
        let options = Options {
            method: Method::MaximumLikelihood,
            model: model_of(&camera, model)?,
            fixed,
            initial: None,
        };
        computed(py, || match judged {
            true => trisquare::predict(&camera, size, &planes, noise, &options),
            false => {
                trisquare::internals::predict_unjudged(&camera, size, &planes, noise, &options)
            }
        })
    })?;
    Ok(Prediction {
        covariance: arrays::from_matrix(py, &found.covariance).unbind(),
        std: found.std().into_py_dict(py)?.unbind(),
        parameters: found.parameters,
    })
}

fn planned((rotation, translation, outlines): &Planned<'_>) -> PyResult<PlannedPlane> {
    let corners = |outline| -> PyResult<[Vector2<f64>; 4]> {
        let corners = arrays::points(outline)?;
        corners
            .try_into()
            .map_err(|_| PyValueError::new_err("an outline has four corners"))
    };
    Ok(PlannedPlane {
        pose: Pose {
            rotation: arrays::sized_matrix(rotation)?,
            translation: Vector3::from(*translation),
        },
        outlines: outlines.iter().map(corners).collect::<PyResult<_>>()?,
    })
}
