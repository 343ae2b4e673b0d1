//! Deserialisation of a calibration by serde.

use nalgebra::DMatrix;
use serde::de::Error;
use serde::{Deserialize, Deserializer};

use super::calibration::{Calibration, FigureResiduals, Plane, SceneLine};
use super::residual_correlation::ResidualCorrelation;
use super::warning::{Stage, Warning};
use crate::image::ToneFit;
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::numeric::is_covariance;

/// The fields of a [`Calibration`] before they are checked against each other.
#[derive(Deserialize)]
#[serde(remote = "Calibration", bound = "")]
struct Unchecked<L: Lens> {
    #[serde(with = "crate::lens::stored")]
    camera: L,
    image_size: ImageSize,
    #[serde(deserialize_with = "parameter_names::<L, _>")]
    parameters: Vec<&'static str>,
    covariance: DMatrix<f64>,
    aspect_fixed: bool,
    planes: Vec<Plane>,
    lines: Vec<SceneLine>,
    residuals: Vec<FigureResiduals>,
    rms: f64,
    noise_scale: f64,
    residual_correlation: ResidualCorrelation,
    iterations: usize,
    warnings: Vec<Warning>,
    stage: Stage,
    tones: Vec<ToneFit>,
    #[serde(default)]
    tone_growth: Option<f64>,
}

impl<'de, L: Lens> Deserialize<'de> for Calibration<L> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let read = Unchecked::deserialize(deserializer)?;
        match fault(&read) {
            Some(fault) => Err(D::Error::custom(fault)),
            None => Ok(read),
        }
    }
}

/// Returns the first inconsistency between the fields of a calibration, if there is one.
fn fault<L: Lens>(read: &Calibration<L>) -> Option<String> {
    let (count, planes) = (read.parameters.len(), read.planes.len());
    let added = &read.residual_correlation.added;
    for (name, matrix) in [
        ("covariance", &read.covariance),
        ("residual_correlation.added", added),
    ] {
        let (rows, columns) = matrix.shape();
        if (rows, columns) != (count, count) {
            return Some(format!(
                "{name} is {rows} x {columns}, but parameters has {count} names"
            ));
        }
    }
    let is_repeated = |i: &usize| read.parameters[..*i].contains(&read.parameters[*i]);
    if let Some(i) = (0..count).find(is_repeated) {
        return Some(format!("parameters has {} twice", read.parameters[i]));
    }
    if !is_covariance(&read.covariance) {
        return Some("covariance must be finite, symmetric and positive semidefinite".into());
    }
    if let Some((name, value)) = negative(read) {
        return Some(format!("{name} must not be negative, but is {value}"));
    }
    let names = L::parameter_names().len();
    for (i, plane) in read.planes.iter().enumerate() {
        let columns = plane
            .uncertainty
            .as_ref()
            .map(|uncertainty| uncertainty.by_camera.ncols());
        if let Some(columns) = columns.filter(|columns| *columns != names) {
            return Some(format!(
                "planes[{i}].uncertainty.by_camera has {columns} columns, but the lens {names} \
                 parameters"
            ));
        }
    }
    for (i, figure) in read.residuals.iter().enumerate() {
        if figure.plane >= planes {
            return Some(format!(
                "residuals[{i}].plane is {}, but there are {planes} planes",
                figure.plane
            ));
        }
        let mut sides = figure.sides.iter();
        let differs = sides.position(|side| side.distances.len() != side.normals.len());
        if let Some(side) = differs {
            return Some(format!(
                "residuals[{i}].sides[{side}] has other numbers of distances and normals"
            ));
        }
    }
    None
}

/// Returns the name and the value of the first number that is negative or NaN although it must be
/// zero or more.
fn negative<L: Lens>(read: &Calibration<L>) -> Option<(String, f64)> {
    let totals = [("rms", read.rms), ("noise_scale", read.noise_scale)];
    let totals = totals.map(|(name, value)| (name.to_owned(), value));
    let planes = read.planes.iter().enumerate();
    let planes = planes.map(|(i, plane)| (format!("planes[{i}].rms"), plane.rms));
    let lines = read.lines.iter().enumerate();
    let lines = lines.filter_map(|(i, line)| Some((format!("lines[{i}].rms"), line.rms?)));
    let mut all = totals.into_iter().chain(planes).chain(lines);
    all.find(|(_, value)| !(*value >= 0.0))
}

/// Reads the names of some of a lens's parameters.
///
/// # Errors
/// Those of the deserializer, and an error for a parameter that the lens does not have.
pub(super) fn parameter_names<'de, L: Lens, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<&'static str>, D::Error> {
    let known = |name: &String| {
        let names = L::parameter_names().iter();
        let mut found = names.copied().filter(|known_name| known_name == name);
        let found = found.next();
        found.ok_or_else(|| D::Error::custom(format!("the lens has no parameter {name:?}")))
    };
    let names = Vec::<String>::deserialize(deserializer)?;
    names.iter().map(known).collect()
}
