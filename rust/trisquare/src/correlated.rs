//! What the residuals say of their own noise, and what that makes of the answer: planes that are
//! measured less well than others, neighbours and whole sides that err together.

use nalgebra::DMatrix;

use crate::Lens;
use crate::consistency::{Disagreement, disagreement};
use crate::covariance::covariance;
use crate::local_noise::Noise;
use crate::misfit::Misfit;
use crate::observations::ObservedPlane;
use crate::parameters::FreeParameters;
use crate::refine::Refined;
use crate::result::Warning;
use crate::robust::Loss;
use crate::side_errors::{SideErrors, rms_displacement, variance_of};

/// A plane's noise differs from that of all if it does so by so many of its own standard
/// deviations...
const DIFFERENT: f64 = 4.0;

/// ... of which its logarithm has `0.71 / sqrt(n)`.
const LOG_SCALE_STD: f64 = 0.71;

/// Sides are said to err together where that is likelier than not.
const LIKELIER: f64 = 0.5;

/// How far (px) samples measured with an estimated tone curve may be displaced together: a few
/// thousandths on rendered pictures.
const CURVE_ERROR: f64 = 0.01;

/// How the residuals differ from independent noise of the stated standard deviations.
#[derive(Debug, Clone, PartialEq)]
pub struct Coherence {
    /// Variance of the mean of many neighbouring samples over what independent ones would have.
    pub neighbours: f64,
    /// Probability that the samples of a side share an error beyond their noise.
    pub probability: f64,
    /// Root mean square of that error where there is one, for every plane, px.
    pub displacements: Vec<f64>,
    /// Variance with which the planes contradict each other over what their sides' curvature lets
    /// expect; 1 where they do not.
    pub contradiction: f64,
    /// What all that adds to the covariance of the free parameters.
    pub added: DMatrix<f64>,
    /// Variance of the samples over what pixels of independent noise would give them, if their
    /// stated standard deviations are those.
    pub(crate) pixels: f64,
    /// Displacements up to this (px) are what an estimated tone curve does to samples...
    pub(crate) floor: f64,
    /// ... which the fit to the pixels takes out: what the rest adds to its covariance.
    pub(crate) added_to_pixels: DMatrix<f64>,
}

/// What is known once correlation is allowed for.
#[derive(Clone)]
pub(crate) struct Correlated {
    /// Of the free parameters.
    pub covariance: DMatrix<f64>,
    /// The plane that disagrees with the rest, if any does.
    pub disagreement: Option<Disagreement>,
    pub coherence: Coherence,
}

impl Coherence {
    /// Independent noise.
    pub(crate) fn none(planes: usize, parameters: usize) -> Self {
        Self {
            neighbours: 1.0,
            probability: 0.0,
            displacements: vec![0.0; planes],
            contradiction: 1.0,
            added: DMatrix::zeros(parameters, parameters),
            pixels: 1.0,
            floor: 0.0,
            added_to_pixels: DMatrix::zeros(parameters, parameters),
        }
    }

    /// Whether sides err together, likelier than not.
    pub fn is_likely(&self) -> bool {
        let largest = self.displacements.iter().copied().fold(0.0, f64::max);
        self.probability > LIKELIER && largest > self.floor
    }

    /// By how much the standard deviation of each parameter of a covariance was raised.
    fn factors(&self, covariance: &DMatrix<f64>) -> Vec<f64> {
        let (all, added) = (covariance.diagonal(), self.added.diagonal());
        let pairs = all.iter().zip(added.iter());
        pairs
            .map(|(all, added)| (all / (all - added)).sqrt())
            .collect()
    }

    pub(crate) fn warnings(
        &self,
        covariance: &DMatrix<f64>,
        free: &FreeParameters,
    ) -> Vec<Warning> {
        let factors = self.factors(covariance);
        let most = |a: &usize, b: &usize| factors[*a].total_cmp(&factors[*b]);
        let Some(worst) = (0..factors.len()).max_by(most) else {
            return Vec::new();
        };
        let mut warnings = Vec::new();
        if self.contradiction > 1.0 {
            warnings.push(Warning::PlanesContradict {
                factor: self.contradiction.sqrt(),
            });
        }
        let most = |a: &usize, b: &usize| self.displacements[*a].total_cmp(&self.displacements[*b]);
        let plane = (0..self.displacements.len()).rev().max_by(most);
        if let Some(plane) = plane.filter(|_| self.is_likely()) {
            warnings.push(Warning::SidesErrTogether {
                plane,
                displacement: self.displacements[plane],
                parameter: free.names()[worst],
                factor: factors[worst],
            });
        }
        warnings
    }
}

/// The planes with their samples weighed by the noise of each; `None` if all have the same.
pub(crate) fn weighed_by_noise(
    planes: &[ObservedPlane],
    noise: &Noise,
) -> Option<Vec<ObservedPlane>> {
    let differs = noise.planes.iter().any(|own| {
        let deviation = (own.scale / noise.scale).ln().abs();
        deviation > DIFFERENT * LOG_SCALE_STD / own.freedom.max(1.0).sqrt()
    });
    differs.then(|| {
        let mut weighed = planes.to_vec();
        for (plane, own) in weighed.iter_mut().zip(&noise.planes) {
            plane.weigh(noise.scale / own.scale);
        }
        weighed
    })
}

/// Variance of the noise in units of the scale at which the residuals of an optimum are summed.
pub(crate) fn white_variance<L>(noise: &Noise, refined: &Refined<L>) -> f64 {
    // The mean of the robust weights is below 1, as if the noise were that much smaller.
    Loss::Tukey.mean_weight() * noise.correlation * (noise.scale / refined.scale).powi(2)
}

/// The covariance of an optimum under the correlation that its own residuals show; `None` if it
/// is singular.
pub(crate) fn correlated_covariance<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<L>,
    noise: &Noise,
) -> Option<Correlated> {
    let white = white_variance(noise, refined);
    let independent = covariance(&refined.system.leading(free.len()), white)?;
    let errors = SideErrors::gather(planes, free, &refined.view, noise, white)?;
    let strength = errors.strength()?;
    let contradiction = Misfit::of(planes, &refined.view, free, noise).contradiction();
    let system = errors.marginal(&strength.mean)?;
    // Boards with a relief have been fitted by generalised least squares, all others at weights
    // that take the noise for white.
    let generalised = match planes.iter().any(|plane| plane.relief.is_some()) {
        true => Some(covariance(&system, 1.0)?),
        false => None,
    };
    let units = match generalised {
        Some(_) => Vec::new(),
        None => errors.unit_covariances()?,
    };
    let total_beyond = |floor: f64| {
        let mut total = generalised.clone().unwrap_or_else(|| independent.clone());
        for (unit, variance) in units.iter().zip(&strength.mean) {
            total += unit * (*variance - variance_of(floor)).max(0.0);
        }
        total * contradiction
    };
    let drifting = planes.iter().any(ObservedPlane::drifts);
    let floor = if drifting { CURVE_ERROR } else { 0.0 };
    let total = total_beyond(0.0);
    let displacements = strength.if_any().into_iter();
    let coherence = Coherence {
        floor,
        added_to_pixels: total_beyond(floor) - &independent,
        contradiction,
        neighbours: noise.correlation,
        pixels: noise.correlation * noise.scale.powi(2),
        probability: strength.probability,
        displacements: displacements.map(rms_displacement).collect(),
        added: &total - independent,
    };
    let focal = refined.view.lens.parameters()[0];
    Some(Correlated {
        covariance: total,
        disagreement: disagreement(&system, free, focal, 1.0),
        coherence,
    })
}
