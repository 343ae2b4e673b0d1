//! The whole calibration.

use std::cmp::Ordering;

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use pyo3::{PyClass, PyClassInitializer};
use trisquare::lens::SKEW;
use trisquare::{
    Brown, BrownModel, Choice, DistortionModel, Error, FamilyChoice, Fisheye, Fixed, ImageSize,
    Lens, Method, ModelChoice, Options, Photographs, PictureTone, Plane, PlaneEdges,
    RejectedFamily, Relation, Setting, Severity, Stage, Warning, relate_planes,
};

use crate::any_lens::{AnyLens, CameraMembers, family_of, in_family, model_of, with_lens};
use crate::arrays;
use crate::errors::{computed_in, exception};
use crate::image::{KeptPixels, picture_tone};
use crate::lens::size;
use crate::observations::plane_edges;

/// Verdict on a candidate plane.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct Verdict {
    /// Index of its first figure.
    figure: usize,
    kept: bool,
    residual: Option<f64>,
}

/// The choice among the figures, and the calibration from it or its error.
#[pyclass(frozen, module = "trisquare._core")]
pub struct Outcome {
    /// Empty if no choice was requested.
    #[pyo3(get)]
    verdicts: Vec<Py<Verdict>>,
    #[pyo3(get)]
    doubt: Option<String>,
    /// An error is kept as a value. A Python exception would hold a traceback that refers to this
    /// object: a reference cycle.
    solution: Result<Py<Solution>, Error>,
}

#[pymethods]
impl Outcome {
    /// The calibration from the figures that are kept; raises its error.
    fn solution(&self, py: Python<'_>) -> PyResult<Py<Solution>> {
        match &self.solution {
            Ok(solution) => Ok(solution.clone_ref(py)),
            Err(error) => Err(exception(error.clone())),
        }
    }
}

/// A calibrated camera with its uncertainty, and the poses of the planes.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct Solution {
    camera_matrix: Py<PyArray2<f64>>,
    distortion: Py<PyArray1<f64>>,
    valid_radius: f64,
    model: String,
    parameters: Vec<&'static str>,
    covariance: Py<PyArray2<f64>>,
    std: Py<PyDict>,
    planes: Vec<Py<SolvedPlane>>,
    /// Index among the figures, root mean square distance, and whether it is used, for each line of
    /// the scene.
    lines: Vec<(usize, Option<f64>, bool)>,
    residuals: Vec<Py<FigureResiduals>>,
    rms: f64,
    noise_scale: f64,
    warnings: Vec<Py<SolutionWarning>>,
    stage: &'static str,
    /// Model, logarithm of its evidence, and rms of each that was rejected.
    alternatives: Vec<(String, f64, f64)>,
    correlation: Py<ResidualCorrelation>,
    tones: Vec<Py<ToneFit>>,
    tone_growth: Option<f64>,
}

/// A possible cause of a wrong calibration.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct SolutionWarning {
    text: String,
    code: &'static str,
    severity: &'static str,
    /// The plane concerned.
    plane: Option<usize>,
    /// The picture concerned, counted among those that were given.
    picture: Option<usize>,
}

/// Covariance of a pose for a given camera, (6, 6), and its derivative by the camera's parameters,
/// (6, n).
type PoseMembers = (Py<PyArray2<f64>>, Py<PyArray2<f64>>);

/// One plane of a calibration.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct SolvedPlane {
    figure: usize,
    image: usize,
    corners: Py<PyArray2<f64>>,
    rotation: Py<PyArray2<f64>>,
    translation: Py<PyArray1<f64>>,
    rms: f64,
    samples: usize,
    uncertainty: Option<PoseMembers>,
    /// Aspect and its standard deviation, for a rectangle of unknown aspect.
    aspect: Option<(f64, f64)>,
    /// All radii and their standard deviations, for circles with unknown radii.
    radii: Vec<(f64, f64)>,
}

/// Distances of a figure's samples from the images of its lines, line by line.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct FigureResiduals {
    plane: usize,
    distances: Vec<Py<PyArray1<f64>>>,
    normals: Vec<Py<PyArray2<f64>>>,
}

/// Departure of the residuals from independent noise.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct ResidualCorrelation {
    neighbours: f64,
    probability: f64,
    displacements: Vec<f64>,
    contradiction: f64,
}

/// The coding of a picture as estimated by the fit to the pixels.
#[pyclass(frozen, get_all, module = "trisquare._core")]
pub struct ToneFit {
    effective_gamma: f64,
    std: Option<f64>,
    shift: Option<(f64, f64)>,
}

/// Calibrates from figures and, if given, the pictures in which they were measured; if `choosing`,
/// from the largest set of planes that one camera sees as true squares.
///
/// `side_errors` are, for each picture, the standard deviations (px) of an error shared by the
/// samples of a side, and of one shared by those of a board's line; many planes are fitted in
/// `threads` threads; `orthogonal` and `parallel` are pairs of the planes that are used.
#[pyfunction]
#[pyo3(signature = (figures, image_size, *, choosing, method, model, fixed, initial, pictures, tones, threads=1, side_errors=Vec::new(), orthogonal=Vec::new(), parallel=Vec::new(), free=Vec::new()))]
#[allow(clippy::too_many_arguments)] // the keywords of the Python function
pub fn calibrate<'py>(
    py: Python<'py>,
    figures: Vec<Bound<'py, PyAny>>,
    image_size: (u32, u32),
    choosing: bool,
    method: &str,
    model: &str,
    fixed: Vec<String>,
    initial: Option<CameraMembers>,
    pictures: Option<Vec<PyRef<'py, KeptPixels>>>,
    tones: Vec<Bound<'py, PyAny>>,
    threads: usize,
    side_errors: Vec<(f64, f64)>,
    orthogonal: Vec<[usize; 2]>,
    parallel: Vec<[usize; 2]>,
    free: Vec<String>,
) -> PyResult<Outcome> {
    let mut edges: Vec<PlaneEdges> = figures.iter().map(plane_edges).collect::<PyResult<_>>()?;
    for figure in &mut edges {
        let (side, line) = side_errors.get(figure.image).copied().unwrap_or_default();
        // A board's lines have no polarity.
        figure.side_error = figure.polarity.map_or(line, |_| side);
    }
    let size = size(image_size);
    let tones: Vec<PictureTone> = tones.iter().map(picture_tone).collect::<PyResult<_>>()?;
    let pictures: Option<Vec<&trisquare::KeptPixels>> = pictures
        .as_ref()
        .map(|all| all.iter().map(|p| &p.pixels).collect());
    let photographs = pictures.as_deref().map(|pictures| Photographs {
        pictures,
        tones: &tones,
    });
    let initial = initial.map(|camera| camera.lens(py)).transpose()?;
    let related =
        |planes: Vec<[usize; 2]>, relation| planes.into_iter().map(move |pair| (pair, relation));
    let orthogonal = related(orthogonal, Relation::Orthogonal);
    let relations = orthogonal.chain(related(parallel, Relation::Parallel));
    let task = Task {
        edges,
        size,
        choosing,
        relations: relations.collect(),
        photographs,
        threads,
    };
    let (method, fixed) = (
        named(method, "method", &METHODS)?,
        fixed_parameters(&fixed, &free)?,
    );
    if model == AUTO {
        return task.outcome_by_family(py, &options_with(method, fixed, initial.as_ref()));
    }
    with_lens!(family_of(model)?, |lens| {
        let model = model_of(&lens, model)?;
        task.outcome_with(
            py,
            &lens,
            model,
            options_with(method, fixed, initial.as_ref()),
        )
    })
}

/// Name of the choice among "none" to "brown" and the fisheyes.
const AUTO: &str = "auto";

/// Options with the default model of a lens.
fn options_with<L: Lens>(method: Method, fixed: Fixed, initial: Option<&AnyLens>) -> Options<L> {
    Options {
        method,
        fixed,
        initial: initial.map(in_family),
        model: L::Model::default(),
    }
}

/// A calibration task, for any lens.
struct Task<'a> {
    edges: Vec<PlaneEdges>,
    size: ImageSize,
    choosing: bool,
    relations: Vec<([usize; 2], Relation)>,
    photographs: Option<Photographs<'a>>,
    threads: usize,
}

impl Task<'_> {
    /// Calibrates with the given lens and model.
    fn outcome_with<L: Lens>(
        mut self,
        py: Python<'_>,
        _family: &L,
        model: L::Model,
        options: Options<L>,
    ) -> PyResult<Outcome> {
        let options = &Options { model, ..options };
        let (choice, found) = computed_in(py, self.threads, || {
            let choice = self.chosen(options)?;
            // With a lens of the wrong family hardly any plane is a square.
            let choice = match self.choosing && kept(&choice) < 2 {
                true => {
                    let wide = || self.chosen(&options.for_family::<Fisheye>());
                    better_choice(Ok(choice), wide)?
                }
                false => choice,
            };
            self.keep(choice.as_ref())?;
            let (edges, size) = (&self.edges, self.size);
            let photographs = self.photographs.as_ref();
            let found = trisquare::calibrate_photographs(edges, size, options, photographs);
            let found = found.map(|mut calibration| {
                trisquare::warn_of_fisheye(edges, size, options, &mut calibration);
                trisquare::warn_of_opencv_lens(edges, size, options, &mut calibration);
                ModelChoice::without_alternatives(options.model, calibration)
            });
            let found = found.map_err(|error| trisquare::or_fisheye(edges, size, options, error));
            Ok((choice, found))
        })?;
        outcome(py, choice, found, |found| solution(py, &found, None))
    }

    /// Calibrates with the family and model of the largest evidence.
    fn outcome_by_family(mut self, py: Python<'_>, options: &Options<Brown>) -> PyResult<Outcome> {
        let (choice, found) = computed_in(py, self.threads, || {
            let rich = Options {
                model: BrownModel::Brown,
                ..*options
            };
            let choice = self.chosen(options);
            let choice = better_choice(choice, || self.chosen(&rich));
            let choice = better_choice(choice, || self.chosen(&options.for_family::<Fisheye>()))?;
            self.keep(choice.as_ref())?;
            let photographs = self.photographs.as_ref();
            let found =
                trisquare::calibrate_by_family(&self.edges, self.size, options, photographs);
            Ok((choice, found))
        })?;
        outcome(py, choice, found, |(found, rejected)| match found {
            FamilyChoice::Pinhole(found) => solution(py, &found, rejected),
            FamilyChoice::Fisheye(found) => solution(py, &found, rejected),
        })
    }

    fn chosen<L: Lens>(&self, options: &Options<L>) -> Result<Option<Choice>, Error> {
        match self.choosing {
            true => trisquare::choose(&self.edges, self.size, options).map(Some),
            false => Ok(None),
        }
    }

    /// Keeps the chosen planes, and relates those that remain.
    fn keep(&mut self, choice: Option<&Choice>) -> Result<(), Error> {
        if let Some(choice) = choice {
            choice.keep(&mut self.edges);
        }
        let mut relations = std::mem::take(&mut self.relations).into_iter();
        relations
            .try_for_each(|(planes, relation)| relate_planes(&mut self.edges, planes, relation))
    }
}

/// Ratio of the residuals of two choices that keep equally many planes, below which the one with
/// less is better: with a lens of the wrong family other things become squares.
const MUCH_LESS: f64 = 0.5;

/// Ratio below which it is better even if it keeps fewer.
const FAR_LESS: f64 = 0.1;

/// The better of two choices; the other is only made if the first drops a plane.
fn better_choice(
    first: Result<Option<Choice>, Error>,
    alternative: impl FnOnce() -> Result<Option<Choice>, Error>,
) -> Result<Option<Choice>, Error> {
    let Ok(choice) = &first else {
        return alternative().or(first);
    };
    let mut verdicts = choice.iter().flat_map(|choice| &choice.verdicts);
    if verdicts.all(|verdict| verdict.kept) {
        return first;
    }
    match alternative() {
        Ok(other) if is_better(&other, choice) => Ok(other),
        _ => first,
    }
}

/// Whether a choice keeps more planes than another, or its camera explains them much better.
fn is_better(first: &Option<Choice>, second: &Option<Choice>) -> bool {
    let residuals =
        [first, second].map(|choice| choice.as_ref().and_then(|choice| choice.residual));
    let ratio = match residuals {
        [Some(first), Some(second)] => first / second,
        [Some(_), None] => 0.0,
        [None, _] => f64::INFINITY,
    };
    match kept(first).cmp(&kept(second)) {
        // Any two squares agree.
        Ordering::Less => ratio < FAR_LESS && kept(first) > 2,
        Ordering::Equal => ratio < MUCH_LESS,
        Ordering::Greater => ratio < FAR_LESS.recip(),
    }
}

/// Number of planes that a choice keeps.
fn kept(choice: &Option<Choice>) -> usize {
    let verdicts = choice.iter().flat_map(|choice| &choice.verdicts);
    verdicts.filter(|verdict| verdict.kept).count()
}

fn outcome<T>(
    py: Python<'_>,
    choice: Option<Choice>,
    found: Result<T, Error>,
    solved: impl FnOnce(T) -> PyResult<Solution>,
) -> PyResult<Outcome> {
    let (verdicts, doubt) = choice.map_or((Vec::new(), None), |c| (c.verdicts, c.doubt));
    let solution = match found {
        Ok(found) => Ok(Py::new(py, solved(found)?)?),
        Err(error) => Err(error),
    };
    Ok(Outcome {
        verdicts: each(py, &verdicts, verdict)?,
        doubt: doubt.map(|doubt| doubt.to_string()),
        solution,
    })
}

const METHODS: [(&str, Method); 2] = [
    ("ml", Method::MaximumLikelihood),
    ("linear", Method::Linear),
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

/// The fixed parameters: those named, and the skew unless it is freed.
pub(crate) fn fixed_parameters(names: &[String], free: &[String]) -> PyResult<Fixed> {
    if let Some(other) = free.iter().find(|name| *name != SKEW) {
        let text = format!("cannot free {other:?}: choose {SKEW}");
        return Err(PyValueError::new_err(text));
    }
    let mut fixed = Fixed {
        skew: free.is_empty(),
        ..Fixed::default()
    };
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

fn verdict(_: Python<'_>, found: &trisquare::Verdict) -> Verdict {
    Verdict {
        figure: found.figure,
        kept: found.kept,
        residual: found.residual,
    }
}

fn solution<L: Lens>(
    py: Python<'_>,
    choice: &ModelChoice<L>,
    rejected: Option<RejectedFamily>,
) -> PyResult<Solution> {
    let found = &choice.calibration;
    let correlation = &found.residual_correlation;
    let alternatives = choice.alternatives.iter();
    // The derivatives of poses by the skew are only included if there is one: other results are
    // unchanged.
    let is_skewed = found.camera.skew() != 0.0 || found.parameters.contains(&SKEW);
    let columns = L::parameter_names().len() - usize::from(!is_skewed);
    Ok(Solution {
        camera_matrix: arrays::from_matrix(py, &found.camera.camera_matrix()).unbind(),
        distortion: arrays::from_slice(py, &found.camera.distortion()).unbind(),
        valid_radius: found.camera.valid_radius(),
        model: choice.model.name(),
        parameters: found.parameters.clone(),
        covariance: arrays::from_matrix(py, &found.covariance).unbind(),
        std: found.std().into_py_dict(py)?.unbind(),
        planes: each(py, &found.planes, |py, plane| {
            solved_plane(py, plane, columns)
        })?,
        lines: found
            .lines
            .iter()
            .map(|line| (line.figure, line.rms, line.is_used))
            .collect(),
        residuals: each(py, &found.residuals, figure_residuals)?,
        rms: found.rms,
        noise_scale: found.noise_scale,
        warnings: each(py, &found.warnings, |_, warning| solution_warning(warning))?,
        stage: match found.stage {
            Stage::Linear => "linear",
            Stage::Edges => "edges",
            Stage::Pixels => "pixels",
        },
        alternatives: alternatives
            .map(|other| (other.model.name(), other.log_evidence, other.rms))
            .chain(rejected.map(|other| (other.model, other.log_evidence, other.rms)))
            .collect(),
        correlation: Py::new(
            py,
            ResidualCorrelation {
                neighbours: correlation.neighbours,
                probability: correlation.probability,
                displacements: correlation.displacements.to_vec(),
                contradiction: correlation.between_plane_variance_ratio,
            },
        )?,
        tones: each(py, &found.tones, tone_fit)?,
        tone_growth: found.tone_growth,
    })
}

fn solution_warning(warning: &Warning) -> SolutionWarning {
    let severity = match warning.severity() {
        Severity::Low => "low",
        Severity::Medium => "medium",
        Severity::High => "high",
    };
    SolutionWarning {
        text: message(warning),
        code: warning.code(),
        severity,
        plane: warning.plane(),
        picture: warning.picture(),
    }
}

/// The message of a warning, with its advice as keywords of the Python function.
fn message(warning: &Warning) -> String {
    let text = warning.to_string();
    let Some(advised) = warning.alternative() else {
        return text;
    };
    let setting = match advised.setting {
        Setting::Model(name) => format!("With model={name:?}"),
        Setting::AspectHeld => "With fix=\"aspect\"".into(),
        Setting::PrincipalPointHeld => "With fix=\"principal_point\"".into(),
        Setting::DistortionFree(name) => format!("Without fix=\"distortion\" (model={name:?})"),
        _ => return text,
    };
    let phrase = format!("{setting}, fx is {:.1}", advised.focal);
    text.replace(&advised.to_string(), &phrase)
}

/// Converts each of some values to a Python object.
fn each<T, U>(
    py: Python<'_>,
    values: &[T],
    convert: impl Fn(Python<'_>, &T) -> U,
) -> PyResult<Vec<Py<U>>>
where
    U: PyClass + Into<PyClassInitializer<U>>,
{
    let converted = values.iter().map(|value| Py::new(py, convert(py, value)));
    converted.collect()
}

fn solved_plane(py: Python<'_>, plane: &Plane, columns: usize) -> SolvedPlane {
    SolvedPlane {
        figure: plane.figure,
        image: plane.image,
        corners: arrays::from_points(py, &plane.corners).unbind(),
        rotation: arrays::from_matrix(py, &plane.pose.rotation).unbind(),
        translation: arrays::from_slice(py, plane.pose.translation.as_slice()).unbind(),
        rms: plane.rms,
        samples: plane.samples,
        uncertainty: plane.uncertainty.as_ref().map(|uncertainty| {
            (
                arrays::from_matrix(py, &uncertainty.given_camera).unbind(),
                arrays::from_matrix(py, &uncertainty.by_camera.columns(0, columns)).unbind(),
            )
        }),
        aspect: plane.aspect.map(|aspect| (aspect.value, aspect.std)),
        radii: plane
            .radii
            .iter()
            .map(|radius| (radius.value, radius.std))
            .collect(),
    }
}

fn figure_residuals(py: Python<'_>, figure: &trisquare::FigureResiduals) -> FigureResiduals {
    let sides = figure.sides.iter();
    FigureResiduals {
        plane: figure.plane,
        distances: sides
            .clone()
            .map(|side| arrays::from_slice(py, &side.distances).unbind())
            .collect(),
        normals: sides
            .map(|side| arrays::from_points(py, &side.normals).unbind())
            .collect(),
    }
}

fn tone_fit(_: Python<'_>, fit: &trisquare::ToneFit) -> ToneFit {
    ToneFit {
        effective_gamma: fit.curve.effective_gamma(),
        std: fit.effective_gamma_std(),
        shift: fit.shift,
    }
}
