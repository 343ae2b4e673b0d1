//! The whole calibration.

use nalgebra::DMatrix;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use trisquare::{
    Brown, Calibration, Fixed, ImageSize, Lens, Method, Model, ModelChoice, Options, Photographs,
    PictureTone, PlaneEdges, PoseUncertainty, Stage, ToneFit,
};

use crate::arrays;
use crate::errors::{detached, exception};
use crate::image::{Picture, picture_tone};
use crate::observations::plane_edges;

/// Calibrates from figures and, where given, the pictures they were measured in.
#[pyfunction]
#[pyo3(signature = (figures, image_size, *, method, model, fixed, initial, pictures, tones))]
#[allow(clippy::too_many_arguments)] // the keywords of the Python function
pub fn calibrate<'py>(
    py: Python<'py>,
    figures: Vec<Bound<'py, PyAny>>,
    image_size: (u32, u32),
    method: &str,
    model: &str,
    fixed: Vec<String>,
    initial: Option<[f64; 9]>,
    pictures: Option<Vec<PyRef<'py, Picture>>>,
    tones: Vec<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let edges: Vec<PlaneEdges> = figures.iter().map(plane_edges).collect::<PyResult<_>>()?;
    let size = ImageSize {
        width: image_size.0,
        height: image_size.1,
    };
    let by_evidence = model == AUTO;
    let options = Options {
        method: named(method, "method", &METHODS)?,
        model: model_named(model)?,
        fixed: fixed_parameters(&fixed)?,
        initial: initial.map(Brown::new),
    };
    let tones: Vec<PictureTone> = tones.iter().map(picture_tone).collect::<PyResult<_>>()?;
    let pictures: Option<Vec<&trisquare::Picture>> = pictures
        .as_ref()
        .map(|all| all.iter().map(|p| &p.picture).collect());
    if pictures
        .as_ref()
        .is_some_and(|all| all.len() != tones.len())
    {
        return Err(PyValueError::new_err("every picture needs its tone curve"));
    }
    let found = detached(py, || {
        let photographs = pictures.as_ref().map(|pictures| Photographs {
            pictures,
            tones: &tones,
        });
        let photographs = photographs.as_ref();
        if by_evidence {
            return trisquare::calibrate_by_evidence(&edges, size, &options, photographs);
        }
        Ok(ModelChoice {
            model: options.model,
            calibration: trisquare::calibrate_photographs(&edges, size, &options, photographs)?,
            alternatives: Vec::new(),
        })
    })?
    .map_err(exception)?;
    let dict = to_dict(py, &found.calibration)?;
    dict.set_item("model", model_name(found.model))?;
    let alternatives: Vec<(&str, f64, f64)> = found
        .alternatives
        .iter()
        .map(|other| (model_name(other.model), other.log_evidence, other.rms))
        .collect();
    dict.set_item("alternatives", alternatives)?;
    Ok(dict)
}

/// Chooses the planes that one camera sees as true squares: of each its first figure, whether it is
/// kept, and else its distance from a square; and why the choice may be wrong.
#[pyfunction]
#[pyo3(signature = (figures, image_size, *, model, fixed, initial))]
#[allow(clippy::type_complexity)] // what Python gets
pub fn choose(
    py: Python<'_>,
    figures: Vec<Bound<'_, PyAny>>,
    image_size: (u32, u32),
    model: &str,
    fixed: Vec<String>,
    initial: Option<[f64; 9]>,
) -> PyResult<(Vec<(usize, bool, Option<f64>)>, Option<String>)> {
    let edges: Vec<PlaneEdges> = figures.iter().map(plane_edges).collect::<PyResult<_>>()?;
    let size = ImageSize {
        width: image_size.0,
        height: image_size.1,
    };
    let options = Options {
        method: Method::MaximumLikelihood,
        model: model_named(model)?,
        fixed: fixed_parameters(&fixed)?,
        initial: initial.map(Brown::new),
    };
    let choice = detached(py, || trisquare::choose(&edges, size, &options))?.map_err(exception)?;
    let verdicts = choice.verdicts.iter();
    Ok((
        verdicts.map(|v| (v.figure, v.kept, v.residual)).collect(),
        choice.doubt.map(|doubt| doubt.to_string()),
    ))
}

/// The model that stands for the choice among all of them.
const AUTO: &str = "auto";

/// The model of a name; for the choice among all, the one it begins with.
fn model_named(name: &str) -> PyResult<Model> {
    match name {
        AUTO => Ok(Model::default()),
        _ => named(name, "model", &MODELS),
    }
}

fn model_name(model: Model) -> &'static str {
    let found = MODELS.iter().find(|(_, known)| *known == model);
    found.map_or("", |(name, _)| name)
}

const METHODS: [(&str, Method); 2] = [
    ("ml", Method::MaximumLikelihood),
    ("linear", Method::Linear),
];

pub(crate) const MODELS: [(&str, Model); 5] = [
    ("none", Model::None),
    ("radial1", Model::Radial1),
    ("radial2", Model::Radial2),
    ("radial3", Model::Radial3),
    ("brown", Model::Brown),
];

pub(crate) fn named<T: Copy>(name: &str, what: &str, known: &[(&str, T)]) -> PyResult<T> {
    let found = known.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(known, _)| *known).collect();
        PyValueError::new_err(format!(
            "unknown {what} {name:?}: choose one of {}",
            names.join(", ")
        ))
    })
}

pub(crate) fn fixed_parameters(names: &[String]) -> PyResult<Fixed> {
    let mut fixed = Fixed::default();
    for name in names {
        match name.as_str() {
            "aspect" => fixed.aspect = true,
            "principal_point" => fixed.principal_point = true,
            "focal" => fixed.focal = true,
            "distortion" => fixed.distortion = true,
            other => {
                return Err(PyValueError::new_err(format!(
                    "cannot fix {other:?}: choose among aspect, principal_point, focal, distortion"
                )));
            }
        }
    }
    Ok(fixed)
}

fn tone_fit<'py>(py: Python<'py>, fit: &ToneFit) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("effective_gamma", fit.curve.effective_gamma())?;
    dict.set_item("std", fit.effective_gamma_std())?;
    dict.set_item("shift", fit.shift)?;
    Ok(dict)
}

fn pose_uncertainty<'py>(py: Python<'py>, found: &PoseUncertainty) -> PyResult<Bound<'py, PyDict>> {
    let (given, by) = (&found.given_camera, &found.by_camera);
    let given = DMatrix::from_column_slice(given.nrows(), given.ncols(), given.as_slice());
    let by = DMatrix::from_column_slice(by.nrows(), by.ncols(), by.as_slice());
    let dict = PyDict::new(py);
    dict.set_item("given_camera", arrays::from_matrix(py, &given))?;
    dict.set_item("by_camera", arrays::from_matrix(py, &by))?;
    Ok(dict)
}

fn to_dict<'py>(py: Python<'py>, found: &Calibration) -> PyResult<Bound<'py, PyDict>> {
    let std = PyDict::new(py);
    for (name, value) in found.std() {
        std.set_item(name, value)?;
    }
    let planes = found
        .planes
        .iter()
        .map(|plane| {
            let dict = PyDict::new(py);
            dict.set_item("figure", plane.figure)?;
            dict.set_item("image", plane.image)?;
            dict.set_item("corners", arrays::from_points(py, &plane.corners))?;
            dict.set_item("rotation", arrays::from_matrix3(py, &plane.pose.rotation))?;
            let translation = plane.pose.translation;
            dict.set_item(
                "translation",
                arrays::from_slice(py, translation.as_slice()),
            )?;
            dict.set_item("rms", plane.rms)?;
            dict.set_item("samples", plane.samples)?;
            let uncertainty = plane.uncertainty.as_ref();
            let uncertainty = uncertainty.map(|u| pose_uncertainty(py, u)).transpose()?;
            dict.set_item("uncertainty", uncertainty)?;
            Ok(dict)
        })
        .collect::<PyResult<Vec<_>>>()?;
    let warnings: Vec<String> = found.warnings.iter().map(ToString::to_string).collect();
    let stage = match found.stage {
        Stage::Linear => "linear",
        Stage::Edges => "edges",
        Stage::Pixels => "pixels",
    };

    let dict = PyDict::new(py);
    dict.set_item(
        "camera_matrix",
        arrays::from_matrix3(py, &found.camera.camera_matrix()),
    )?;
    dict.set_item(
        "distortion",
        arrays::from_slice(py, &found.camera.distortion()),
    )?;
    dict.set_item("valid_radius", found.camera.valid_radius())?;
    dict.set_item("parameters", &found.parameters)?;
    dict.set_item("covariance", arrays::from_matrix(py, &found.covariance))?;
    dict.set_item("std", std)?;
    dict.set_item("planes", planes)?;
    dict.set_item("rms", found.rms)?;
    let residual_correlation = PyDict::new(py);
    residual_correlation.set_item("neighbours", found.residual_correlation.neighbours)?;
    residual_correlation.set_item("probability", found.residual_correlation.probability)?;
    let displacements = PyTuple::new(py, &found.residual_correlation.displacements)?;
    residual_correlation.set_item("displacements", displacements)?;
    residual_correlation.set_item(
        "contradiction",
        found.residual_correlation.between_plane_variance_ratio,
    )?;
    dict.set_item("coherence", residual_correlation)?;
    dict.set_item("noise_scale", found.noise_scale)?;
    dict.set_item("iterations", found.iterations)?;
    dict.set_item("warnings", warnings)?;
    dict.set_item("stage", stage)?;
    let tones = found.tones.iter().map(|fit| tone_fit(py, fit));
    dict.set_item("tones", tones.collect::<PyResult<Vec<_>>>()?)?;
    Ok(dict)
}
