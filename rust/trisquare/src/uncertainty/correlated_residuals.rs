//! What the residuals say of their own noise, and what that makes of the answer: planes that are
//! measured less well than others, neighbours and whole sides that err together.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::covariance::covariance;
use super::disagreement::disagreement;
use super::plane_spread::spread_of_planes;
use crate::lens::Lens;
use crate::noise::{
    Misfit, Noise, SideErrors, Strength, rms_displacement, variance_of, white_variance,
};
use crate::numeric::ArrowSystem;
use crate::observations::{FreeParameters, ObservedPlane};
use crate::refine::{Refined, residuals};
use crate::result::{Disagreement, NOTABLE_FACTOR, ResidualCorrelation, Warning};

/// Variances that were raised by less are not told of: deviations would be 1.0 times as large.
const WORTH_TELLING: f64 = 1.1;

/// A plane's noise differs from that of all if it does so by so many of its own standard
/// deviations...
const DIFFERENT: f64 = 4.0;

/// ... of which its logarithm has `0.71 / sqrt(n)`.
const LOG_SCALE_STD: f64 = 0.71;

/// Standard deviations of a tone curve's error that leave the robust weights as they are.
const SMALL_DRIFT: f64 = 0.01;

/// What is known once correlation is allowed for.
#[derive(Clone)]
pub(crate) struct Correlated {
    /// Of the free parameters.
    pub covariance: DMatrix<f64>,
    /// What of it errors of sides make that were known beforehand, beyond those that these show.
    pub known: DMatrix<f64>,
    /// The plane that disagrees with the rest, if any does, and by how much the free parameters
    /// change without it.
    pub disagreement: Option<(Disagreement, DVector<f64>)>,
    pub residual_correlation: ResidualCorrelation,
}

impl ResidualCorrelation {
    /// By how much the standard deviation of each parameter of a covariance was raised by what the
    /// residuals show, and not by the part that was known beforehand.
    fn factors(&self, covariance: &DMatrix<f64>, known: &DMatrix<f64>) -> Vec<f64> {
        let independent = (covariance - &self.added).diagonal();
        let shown = (covariance - known).diagonal();
        let pairs = shown.iter().zip(independent.iter());
        pairs.map(|(shown, own)| (shown / own).sqrt()).collect()
    }

    /// Whether sides lie farther from their lines than their own straightness lets expect.
    pub(crate) fn planes_contradict(&self) -> bool {
        self.between_plane_variance_ratio > WORTH_TELLING
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
                known_to: None, // until all is counted
                held: free.held().into_iter().map(Into::into).collect(),
            });
        }
        let most = |a: &usize, b: &usize| factors[*a].total_cmp(&factors[*b]);
        let Some(worst) = (0..factors.len()).max_by(most) else {
            return warnings;
        };
        // Planes that contradict each other raise all deviations at least as much.
        let least = self.between_plane_variance_ratio.max(WORTH_TELLING);
        if self.group_variance_ratio > least {
            warnings.push(Warning::PlanesVary {
                factor: self.group_variance_ratio.sqrt(),
                one_picture,
                known_to: None,
            });
        }
        let (parameter, factor) = (free.names()[worst], factors[worst]);
        // Not a number where the fit to the pixels is so much better that it has no such part.
        if !(factor > NOTABLE_FACTOR) {
            return warnings;
        }
        let risen = largest(&self.heights).filter(|it| it.1 > 0.0);
        let displaced = largest(&self.displacements).filter(|_| self.is_likely());
        if let Some((plane, _)) = risen.or(displaced) {
            warnings.push(Warning::SidesErrTogether {
                plane,
                displacement: self.displacements[plane],
                height: risen.map(|it| it.1),
                parameter: parameter.into(),
                factor,
                known_to: None,
            });
        }
        warnings
    }
}

/// The first of the largest values.
fn largest(values: &[f64]) -> Option<(usize, f64)> {
    let values = values.iter().copied().enumerate().rev();
    values.max_by(|a, b| a.1.total_cmp(&b.1))
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

/// The covariance that every plane makes of the whole: that of its noise, at weights that take it
/// for white, and of its sides' displacements.
fn parts(
    (system, noise): (&ArrowSystem, f64),
    units: &[DMatrix<f64>],
    variances: &[f64],
) -> Option<Vec<DMatrix<f64>>> {
    let inverse = system.reduced_information()?.cholesky()?.inverse();
    let own = system.contributions()?.into_iter();
    let mut parts: Vec<DMatrix<f64>> = own
        .map(|own| &inverse * own.information * &inverse * noise)
        .collect();
    for (part, (unit, variance)) in parts.iter_mut().zip(units.iter().zip(variances)) {
        *part += unit * *variance;
    }
    Some(parts)
}

/// What the errors of the pictures' tone curves add to a covariance, of planes whose optimum takes
/// them for none.
fn drifted<L: Lens>(
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
    let moved = Noise::of(&displaced, &errors, noise.summed_at);
    let errors = SideErrors::gather(&displaced, (free, None), &refined.view, &moved, white)?;
    let moved = errors.marginal(&strength.mean)?.contributions()?;
    let inverse = system.reduced_information()?.cholesky()?.inverse();
    let mut pictures = BTreeMap::<usize, DVector<f64>>::new();
    for ((plane, moved), own) in planes.iter().zip(moved).zip(system.contributions()?) {
        let sum = pictures
            .entry(plane.image)
            .or_insert_with(|| DVector::zeros(size));
        *sum += (moved.gradient - own.gradient) / SMALL_DRIFT;
    }
    for gradient in pictures.values() {
        let influence = &inverse * gradient;
        total += &influence * influence.transpose();
    }
    Some(total)
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
    let errors = SideErrors::gather(planes, (free, None), &refined.view, noise, white)?;
    let strength = errors.strength()?;
    let misfit = Misfit::of(planes, &refined.view, free, noise);
    let between_plane_variance_ratio = misfit.between_plane_variance_ratio();
    let system = errors.marginal(&strength.mean)?;
    // Boards with an out-of-plane shape have been fitted by generalised least squares, all others
    // at weights that take the noise for white.
    let generalised = match planes.iter().any(|plane| plane.board_relief.is_some()) {
        true => Some(covariance(&system, 1.0)?),
        false => None,
    };
    let generalised = match generalised {
        Some(own) => {
            Some(own + drifted((planes, free), refined, (noise, white), &strength, &system)?)
        }
        None => None,
    };
    let units = match generalised {
        Some(_) => Vec::new(),
        None => errors.unit_covariances()?,
    };
    let mut as_stated = generalised.as_ref().unwrap_or(&independent).clone();
    let mut known = DMatrix::zeros(free.len(), free.len());
    for ((unit, variance), plane) in units.iter().zip(&strength.mean).zip(planes) {
        as_stated += unit * *variance;
        known += unit * (variance_of(plane.side_error) - variance).max(0.0);
    }
    as_stated += &known;
    let fitted = match generalised {
        Some(_) => (&system, 1.0),
        None => (&refined.system.leading(free.len()), white),
    };
    let parts = parts(fitted, &units, &strength.mean)?;
    let spread = spread_of_planes(planes, fitted.0, &parts, &as_stated);
    let group_variance_ratio = spread.as_ref().map_or(1.0, |it| it.variance_ratio.max(1.0));
    // Sides in the wrong place may be none of a group's errors in the camera.
    let raised = match spread {
        Some(spread) if spread.is_enough => group_variance_ratio,
        _ => group_variance_ratio.max(between_plane_variance_ratio),
    };
    let total = as_stated * raised;
    let displacements = strength.if_any().into_iter();
    let residual_correlation = ResidualCorrelation {
        between_plane_variance_ratio,
        line_displacement: misfit.displacement(),
        group_variance_ratio,
        heights: planes
            .iter()
            .map(|plane| plane.board_relief.map_or(0.0, |relief| relief.height()))
            .collect(),
        neighbours: noise.correlation,
        pixels: noise.correlation * noise.scale.powi(2),
        probability: strength.probability,
        displacements: displacements.map(rms_displacement).collect(),
        added: &total - independent,
    };
    let focal = refined.view.lens.focal().x;
    Some(Correlated {
        covariance: total,
        known: known * raised,
        disagreement: disagreement(&system, free, focal, 1.0),
        residual_correlation,
    })
}
