//! Fit of the deformation of boards, and of the sheets of squares: they are bent or stretched.
//!
//! A bump of height `z(X, Y)` displaces rows and columns of a board alike, towards the vanishing
//! point of its normal, and the more so the more obliquely the board is seen: a displacement shared
//! by whole sheets, which a single line cannot distinguish from distortion. A stretch changes the
//! angles between all vanishing points of a sheet, which determine the camera matrix.
//!
//! The terms of a deformation ([`crate::noise::deformation`]) have a normal prior. Whether sheets
//! are bent or stretched, and `tau`, are estimated from the residuals together with the strength of
//! each side's own errors ([`crate::noise::side_errors`]). If they clearly are, the camera is
//! estimated by generalised least squares, with the terms eliminated like a pose, under the prior.

use nalgebra::Vector2;

use super::local::{Noise, white_variance};
use super::reml::{Assumption, HOPELESS};
use super::side_errors::{SideErrors, rms_displacement};
use crate::lens::Lens;
use crate::numeric::Problem;
use crate::observations::{
    Deformation, DeformationKind, DeformationPrior, Figure, FreeParameters, ObservedPlane,
    PlaneState, TERMS, Terms, has_grid,
};
use crate::refine::{EdgeProblem, Refined, residuals, robust_scale};

/// Smallest `tau^2` tried, the ratio of successive ones, and their number: from heights of a
/// ten-thousandth of half the extent, or such a stretch, which is less than a tenth of a pixel on
/// the largest boards, to a tenth, far beyond any board.
const FIRST_VARIANCE: f64 = 1e-8;
const VARIANCE_RATIO: f64 = 4.0;
const VARIANCES: i32 = 11;

/// Minimum gain of twice the log likelihood by a deformation: by chance it is exceeded once in a
/// hundred times.
const CLEARLY: f64 = 6.6;

/// Maximum number of generalised least-squares steps; two or three are usual, and nine if the fit
/// of exact boards was far off.
const MAX_STEPS: usize = 20;

/// Predicted decrease of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 0.03;

/// Minimum ratio of the sides' errors to the standard deviation of their shift by an error of the
/// tone curve: otherwise both would explain the same errors.
const BEYOND_DRIFT: f64 = 2.0;

/// Step (px) of the numerical gradient of a distance.
const GRADIENT_STEP: f64 = 0.01;

/// Planes whose deformation is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sheets {
    /// Boards only: their many lines distinguish it from all else.
    Boards,
    /// Boards and squares.
    All,
}

/// The samples corrected for the deformation of their targets, and the generalised least-squares
/// optimum of these; `None` if there clearly is none.
pub(crate) fn account_for_deformation<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    refined: &Refined<L>,
    sheets: Sheets,
) -> Option<(Vec<ObservedPlane>, Refined<L>)> {
    let drifts = planes.iter().map(ObservedPlane::largest_tone_drift);
    let drift = drifts.fold(0.0, f64::max);
    let deformation = |(plane, state): (&ObservedPlane, &PlaneState)| {
        let is_fitted = sheets == Sheets::All || plane.figures.iter().any(has_grid);
        let is_straight = !plane.figures.iter().any(Figure::is_round);
        match plane.deformation {
            None if !plane.is_outlier() && is_fitted && is_straight => {
                Deformation::none(plane, &refined.view, state)
            }
            known => known,
        }
    };
    let deformations = planes.iter().zip(&refined.view.planes).map(deformation);
    let deformations: Vec<Option<Deformation>> = deformations.collect();
    if deformations.iter().all(Option::is_none) {
        return None;
    }
    let mut planes = planes.to_vec();
    for (plane, deformation) in planes.iter_mut().zip(deformations) {
        plane.deformation = deformation;
    }
    let mut found = refined.clone();
    let prior = likeliest_prior(&mut errors(&planes, free, &found)?, drift, sheets)?;
    for deformation in planes.iter_mut().filter_map(|p| p.deformation.as_mut()) {
        deformation.prior = prior;
    }
    // Samples are always moved from their given positions: moved step after step, they would be
    // wrong to the second order of the terms.
    let given = planes.clone();
    for _ in 0..MAX_STEPS {
        let errors = errors(&planes, free, &found)?;
        let step = errors.marginal(&errors.strength()?.mean)?.solve(0.0)?;
        let view = found.view.advanced(free, &step);
        for (p, plane) in planes.iter_mut().enumerate() {
            let state = &view.planes[p];
            if let Some(mut deformation) = plane.deformation {
                let change = step.blocks[p].rows(state.parameter_count(), TERMS);
                deformation.terms += Terms::from_fn(|k, _| change[k]);
                let seen = (&view.lens, state);
                *plane = corrected_for_deformation(&given[p], deformation, seen)?;
            }
        }
        let residuals = residuals(&planes, &view)?;
        let unknowns = view.unknowns(free);
        let scale = robust_scale(&residuals, unknowns);
        let (_, system) = EdgeProblem::new(&planes, judged, scale).evaluate(&view)?;
        let iterations = found.iterations + 1;
        found = Refined::with_spread((view, residuals, system), scale, unknowns, iterations);
        if step.predicted_decrease < LAST_DECREASE {
            return Some((planes, found));
        }
    }
    None
}

/// The errors of sides and boards in the residuals of an optimum.
fn errors<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<L>,
) -> Option<SideErrors> {
    let noise = Noise::of_optimum(planes, refined);
    let white = white_variance(&noise, refined);
    SideErrors::gather(planes, (free, None), &refined.view, &noise, white)
}

/// The likeliest kind of deformation, with the mean of its variances weighted by likelihood; `None`
/// if there is not clearly any. `drift` (px) is the standard deviation of a shift by the tone curve.
fn likeliest_prior(
    errors: &mut SideErrors,
    drift: f64,
    sheets: Sheets,
) -> Option<DeformationPrior> {
    let at = |deformation: DeformationPrior| Assumption {
        deformation,
        fields: &[],
    };
    let exact = errors.likeliest_under(&[at(DeformationPrior::EXACT)], None)[0]?;
    if rms_displacement(exact.0) < BEYOND_DRIFT * drift {
        return None;
    }
    let mut best = (exact.1 - CLEARLY, None);
    let kinds = [
        Some(DeformationKind::Bent),
        Some(DeformationKind::Stretched),
        (sheets == Sheets::All).then_some(DeformationKind::Rolled),
    ];
    for kind in kinds.into_iter().flatten() {
        let (mut tried, mut lowest) = (Vec::new(), f64::INFINITY);
        for index in 0..VARIANCES {
            let variance = FIRST_VARIANCE * VARIANCE_RATIO.powi(index);
            let assumption = at(DeformationPrior { kind, variance });
            let criterion = errors.likeliest_under(&[assumption], Some(exact.0))[0]?.1;
            if criterion > lowest + HOPELESS {
                break;
            }
            lowest = lowest.min(criterion);
            tried.push((variance, criterion));
        }
        if lowest < best.0 {
            let weighted = tried.iter().map(|(variance, criterion)| {
                let weight = (0.5 * (lowest - criterion)).exp();
                (weight, weight * variance)
            });
            let (weights, sum) = weighted.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            let variance = sum / weights;
            best = (lowest, Some(DeformationPrior { kind, variance }));
        }
    }
    best.1
}

/// A plane whose samples are corrected for `deformation` instead of its own.
fn corrected_for_deformation<L: Lens>(
    given: &ObservedPlane,
    deformation: Deformation,
    (lens, state): (&L, &PlaneState),
) -> Option<ObservedPlane> {
    let previous = given.deformation?;
    let mut plane = given.clone();
    plane.deformation = Some(deformation);
    for (f, figure) in plane.figures.iter_mut().enumerate() {
        for side in &mut figure.sides {
            let line = state.line(f, &side.line()?);
            for sample in &mut side.samples {
                let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
                let distance =
                    lens.line_distance_jacobian(&pixel_ray, &line, crate::lens::Columns::NONE);
                let displacement = |deformation: &Deformation| {
                    deformation.displacement((lens, state), &line, &distance.wrt_line, sample)
                };
                let change = displacement(&deformation)? - displacement(&previous)?;
                let distance_change = |x: f64, y: f64| {
                    let ray = lens.unproject_with_jacobian(&(sample.pixel + Vector2::new(x, y)))?;
                    Some(lens.line_distance(&ray, &line) - distance.value)
                };
                let gradient = Vector2::new(
                    distance_change(GRADIENT_STEP, 0.0)?,
                    distance_change(0.0, GRADIENT_STEP)?,
                );
                sample.pixel -= gradient.normalize() * change;
            }
        }
    }
    Some(plane)
}
