//! Noise of the residuals and their correlation, and its effect on the covariance: planes that are
//! measured less well than others, and neighbours and whole sides with common errors.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::covariance::covariance;
use super::disagreement::disagreement;
use super::plane_spread::spread_of_planes;
use crate::lens::Lens;
use crate::noise::{
    Misfit, Noise, SideErrors, Strength, displacement_variance, rms_displacement, white_variance,
};
use crate::numeric::ArrowSystem;
use crate::observations::{Deformation, FreeParameters, ObservedPlane};
use crate::refine::{Refined, residuals};
use crate::result::{Disagreement, NOTABLE_FACTOR, ResidualCorrelation, Warning};

/// Factor on a variance below which no warning is given: standard deviations would be 1.0 times as
/// large.
const NOTABLE_RATIO: f64 = 1.1;

/// Difference of a plane's noise from that of all planes, in its own standard deviations, above
/// which the plane has noise of its own.
const DIFFERENT: f64 = 4.0;

/// Standard deviation of the logarithm of a plane's noise, for one degree of freedom; for `n` it is
/// `0.71 / sqrt(n)`.
const LOG_SCALE_STD: f64 = 0.71;

/// Step of a tone curve's error, in standard deviations, that leaves the robust weights unchanged.
const SMALL_DRIFT: f64 = 0.01;

/// Covariance and its parts when correlation is allowed for.
#[derive(Clone)]
pub(crate) struct Correlated {
    /// Covariance of the free parameters.
    pub covariance: DMatrix<f64>,
    /// The part of it from errors of sides that were known beforehand, beyond the errors that the
    /// residuals show.
    pub known: DMatrix<f64>,
    /// The plane that disagrees with the rest, if any does, and the change of the free parameters
    /// without it.
    pub disagreement: Option<(Disagreement, DVector<f64>)>,
    pub residual_correlation: ResidualCorrelation,
}

impl ResidualCorrelation {
    /// Returns the factors by which the residuals raise the standard deviations of the parameters
    /// of a covariance, without the part that was known beforehand.
    fn factors(&self, covariance: &DMatrix<f64>, known: &DMatrix<f64>) -> Vec<f64> {
        let independent = (covariance - &self.added).diagonal();
        let shown = (covariance - known).diagonal();
        let pairs = shown.iter().zip(independent.iter());
        pairs
            .map(|(shown, independent)| (shown / independent).sqrt())
            .collect()
    }

    /// Whether sides lie farther from their lines than their own straightness explains.
    pub(crate) fn planes_contradict(&self) -> bool {
        self.between_plane_variance_ratio > NOTABLE_RATIO
    }

    pub(crate) fn warnings(
        &self,
        covariance: &DMatrix<f64>,
        known: &DMatrix<f64>,
        free: &FreeParameters,
        one_picture: bool,
    ) -> Vec<Warning> {
        let factors = self.factors(covariance, known);
        let mut warnings = Vec::new();
        if self.planes_contradict() {
            warnings.push(Warning::PlanesContradict {
                factor: self.between_plane_variance_ratio.sqrt(),
                displacement: self.line_displacement,
                planes: self.displacements.len(),
                known_to: None, // set once the covariance is complete
                held: free.held().into_iter().map(Into::into).collect(),
            });
        }
        let by_factor = |a: &usize, b: &usize| factors[*a].total_cmp(&factors[*b]);
        let Some(worst) = (0..factors.len()).max_by(by_factor) else {
            return warnings;
        };
        // Planes that contradict each other raise all standard deviations at least as much.
        let min_ratio = self.between_plane_variance_ratio.max(NOTABLE_RATIO);
        if self.group_variance_ratio > min_ratio {
            warnings.push(Warning::PlanesVary {
                factor: self.group_variance_ratio.sqrt(),
                one_picture,
                known_to: None,
            });
        }
        let (parameter, factor) = (free.names()[worst], factors[worst]);
        if let Some((plane, stretch)) = largest(&self.stretches).filter(|entry| entry.1 != 0.0) {
            warnings.push(Warning::PlaneStretched {
                plane,
                stretch,
                parameter: parameter.into(),
                factor: factor.max(1.0),
                known_to: None,
            });
            return warnings;
        }
        // NaN where the fit to the pixels is so much better that there is no such part.
        if !(factor > NOTABLE_FACTOR) {
            return warnings;
        }
        let highest = largest(&self.heights).filter(|entry| entry.1 > 0.0);
        let most_displaced = largest(&self.displacements).filter(|_| self.is_likely());
        if let Some((plane, _)) = highest.or(most_displaced) {
            warnings.push(Warning::SidesErrTogether {
                plane,
                displacement: self.displacements[plane],
                height: highest.map(|entry| entry.1),
                parameter: parameter.into(),
                factor,
                known_to: None,
            });
        }
        warnings
    }
}

/// Returns a value of every plane's deformation; 0 for planes that are taken as exact.
fn of_deformations(planes: &[ObservedPlane], value: impl Fn(&Deformation) -> f64) -> Vec<f64> {
    let value = |plane: &ObservedPlane| plane.deformation.as_ref().map_or(0.0, &value);
    planes.iter().map(value).collect()
}

/// Returns the first of the values that are farthest from zero, and its index.
fn largest(values: &[f64]) -> Option<(usize, f64)> {
    let values = values.iter().copied().enumerate().rev();
    values.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

/// Returns the planes with the samples of each weighted by its own noise; `None` if all have the
/// same noise.
pub(crate) fn weighted_by_noise(
    planes: &[ObservedPlane],
    noise: &Noise,
) -> Option<Vec<ObservedPlane>> {
    let is_different = noise.planes.iter().any(|plane_noise| {
        let deviation = (plane_noise.scale / noise.scale).ln().abs();
        deviation > DIFFERENT * LOG_SCALE_STD / plane_noise.freedom.max(1.0).sqrt()
    });
    is_different.then(|| {
        let mut weighted = planes.to_vec();
        for (plane, plane_noise) in weighted.iter_mut().zip(&noise.planes) {
            plane.scale_weights(noise.scale / plane_noise.scale);
        }
        weighted
    })
}

/// The normal equations of an optimum with the weights of its fit, and the covariance from them.
struct FittedEquations {
    system: ArrowSystem,
    /// Factor from the inverse of the information to the covariance by noise.
    noise: f64,
    /// Contribution of displacements of unit variance on every plane to the covariance; empty if the
    /// weights account for the displacements.
    units: Vec<DMatrix<f64>>,
    /// Covariance by noise, and by the displacements that the residuals show.
    covariance: DMatrix<f64>,
}

impl FittedEquations {
    /// Equations with weights for white noise, by which planes without a deformation are fitted.
    fn with_white_weights(
        (system, white): (ArrowSystem, f64),
        independent: &DMatrix<f64>,
        errors: &SideErrors,
        strength: &Strength,
    ) -> Option<Self> {
        let units = errors.unit_covariances()?;
        let mut covariance = independent.clone();
        for (unit, variance) in units.iter().zip(&strength.mean) {
            covariance += unit * *variance;
        }
        Some(Self {
            system,
            noise: white,
            units,
            covariance,
        })
    }

    /// Equations marginalised over the displacements: planes with a deformation are fitted by
    /// generalised least squares. `drift` is the covariance from the errors of the tone curves.
    fn marginalised(system: &ArrowSystem, drift: DMatrix<f64>) -> Option<Self> {
        Some(Self {
            covariance: covariance(system, 1.0)? + drift,
            system: system.clone(),
            noise: 1.0,
            units: Vec::new(),
        })
    }

    /// Part of the covariance from errors of sides that were known beforehand, beyond the variances
    /// that the residuals show.
    fn known_covariance(&self, planes: &[ObservedPlane], variances: &[f64]) -> DMatrix<f64> {
        let mut known = DMatrix::zeros(self.covariance.nrows(), self.covariance.ncols());
        for ((unit, variance), plane) in self.units.iter().zip(variances).zip(planes) {
            known += unit * (displacement_variance(plane.side_error) - variance).max(0.0);
        }
        known
    }

    /// Part of the covariance from every plane: from its noise, and from its sides' displacements.
    fn plane_parts(&self, variances: &[f64]) -> Option<Vec<DMatrix<f64>>> {
        let inverse = self.system.reduced_information()?.cholesky()?.inverse();
        let contributions = self.system.contributions()?.into_iter();
        let mut parts: Vec<DMatrix<f64>> = contributions
            .map(|contribution| &inverse * contribution.information * &inverse * self.noise)
            .collect();
        for (part, (unit, variance)) in parts.iter_mut().zip(self.units.iter().zip(variances)) {
            *part += unit * *variance;
        }
        Some(parts)
    }
}

/// Returns the part of a covariance from the errors of the pictures' tone curves, for planes whose
/// optimum assumes that there are none.
fn tone_drift_covariance<L: Lens>(
    (planes, free): (&[ObservedPlane], &FreeParameters),
    refined: &Refined<L>,
    (noise, white): (&Noise, f64),
    strength: &Strength,
    system: &ArrowSystem,
) -> Option<DMatrix<f64>> {
    let size = free.len();
    let mut total = DMatrix::zeros(size, size);
    if !planes.iter().any(ObservedPlane::has_tone_drift) {
        return Some(total);
    }
    let mut displaced = planes.to_vec();
    for plane in &mut displaced {
        plane.remove_tone_drift(SMALL_DRIFT);
    }
    let errors = residuals(&displaced, &refined.view)?;
    let drifted_noise = Noise::of(&displaced, &errors, noise.moment_scale);
    let errors = SideErrors::gather(
        &displaced,
        (free, None),
        &refined.view,
        &drifted_noise,
        white,
    )?;
    let drifted = errors.marginal(&strength.mean)?.contributions()?;
    let inverse = system.reduced_information()?.cholesky()?.inverse();
    let mut pictures = BTreeMap::<usize, DVector<f64>>::new();
    for ((plane, drifted), contribution) in planes.iter().zip(drifted).zip(system.contributions()?)
    {
        let sum = pictures
            .entry(plane.image)
            .or_insert_with(|| DVector::zeros(size));
        *sum += (drifted.gradient - contribution.gradient) / SMALL_DRIFT;
    }
    for gradient in pictures.values() {
        let influence = &inverse * gradient;
        total += &influence * influence.transpose();
    }
    Some(total)
}

/// Returns the covariance of an optimum under the correlation that its own residuals show; `None`
/// if it is singular.
pub(crate) fn correlated_covariance<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<L>,
    noise: &Noise,
) -> Option<Correlated> {
    let white = white_variance(noise, refined);
    let as_white = refined.system.leading(free.len());
    let independent = covariance(&as_white, white)?;
    let errors = SideErrors::gather(planes, (free, None), &refined.view, noise, white)?;
    let strength = errors.strength()?;
    let misfit = Misfit::of(planes, &refined.view, free, noise);
    let between_plane_variance_ratio = misfit.between_plane_variance_ratio();
    let system = errors.marginal(&strength.mean)?;
    let fitted = match planes.iter().any(|plane| plane.deformation.is_some()) {
        true => {
            let (fit, noise) = ((planes, free), (noise, white));
            let drift = tone_drift_covariance(fit, refined, noise, &strength, &system)?;
            FittedEquations::marginalised(&system, drift)?
        }
        false => {
            let white_equations = (as_white, white);
            FittedEquations::with_white_weights(white_equations, &independent, &errors, &strength)?
        }
    };
    let known = fitted.known_covariance(planes, &strength.mean);
    let stated = &fitted.covariance + &known;
    let plane_parts = fitted.plane_parts(&strength.mean)?;
    let spread = spread_of_planes(planes, &fitted.system, &plane_parts, &stated);
    let group_variance_ratio = spread
        .as_ref()
        .map_or(1.0, |spread| spread.variance_ratio.max(1.0));
    // Displaced sides need not displace the camera that a group determines.
    let variance_factor = match spread {
        Some(spread) if spread.is_enough => group_variance_ratio,
        _ => group_variance_ratio.max(between_plane_variance_ratio),
    };
    let total = stated * variance_factor;
    let displacements = strength.mean_if_any().into_iter();
    let residual_correlation = ResidualCorrelation {
        between_plane_variance_ratio,
        line_displacement: misfit.displacement(),
        group_variance_ratio,
        heights: of_deformations(planes, Deformation::height),
        stretches: of_deformations(planes, Deformation::stretch),
        neighbours: noise.correlation,
        pixels: noise.correlation * noise.scale.powi(2),
        probability: strength.probability,
        displacements: displacements.map(rms_displacement).collect(),
        added: &total - independent,
    };
    let focal = refined.view.lens.focal().x;
    Some(Correlated {
        covariance: total,
        known: known * variance_factor,
        disagreement: disagreement(&system, free, focal, 1.0),
        residual_correlation,
    })
}
