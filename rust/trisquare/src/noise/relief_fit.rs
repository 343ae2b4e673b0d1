//! Fit of the out-of-plane shape of boards, and of the sheets of squares: a smooth relief.
//!
//! A bump of height `z(X, Y)` displaces rows and columns of a board alike, towards the vanishing
//! point of its normal, and the more so the more obliquely the board is seen: a displacement shared
//! by whole sheets, which a single line cannot distinguish from distortion. The heights are
//! `R sum a_ij P_i(X / R) P_j(Y / R)` with `R` half the board's extent and `2 <= i + j <= 4` (lower
//! orders are the pose), `a_ij` normal with variance `tau^2 / (d / 2)^n`, `d = i + j`. `tau` and
//! `n` are estimated from the residuals together with the strength of each side's own errors
//! ([`crate::noise::side_errors`]). If there clearly is a relief, the camera is estimated by
//! generalised least squares, with the heights eliminated like a pose, under a prior.

use nalgebra::Vector2;

use super::board_relief::{FLAT, ROLLED, STIFF};
use super::local::{Noise, white_variance};
use super::reml::{Assumption, HOPELESS};
use super::side_errors::{SideErrors, rms_displacement};
use crate::lens::Lens;
use crate::numeric::Problem;
use crate::observations::{
    BoardRelief, Figure, FreeParameters, Heights, ObservedPlane, PlaneState, TERMS, has_grid,
};
use crate::refine::{EdgeProblem, Refined, residuals, robust_scale};

/// Smallest `tau^2` tried, the ratio of successive ones, and their number: from heights of a
/// ten-thousandth of half the board's extent, which is less than a tenth of a pixel on the largest
/// boards, to a tenth, far beyond any board.
const FIRST_VARIANCE: f64 = 1e-8;
const VARIANCE_RATIO: f64 = 4.0;
const VARIANCES: i32 = 11;

/// Minimum gain of twice the log likelihood by a relief: by chance it is exceeded once in a hundred
/// times.
const CLEARLY: f64 = 6.6;

/// Maximum number of generalised least-squares steps; two or three are usual, and nine if the fit
/// of flat boards was far off.
const MAX_STEPS: usize = 20;

/// Predicted decrease of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 0.03;

/// Minimum ratio of the sides' errors to the standard deviation of their shift by an error of the
/// tone curve: otherwise both would explain the same errors.
const BEYOND_DRIFT: f64 = 2.0;

/// Step (px) of the numerical gradient of a distance.
const GRADIENT_STEP: f64 = 0.01;

/// Planes whose relief is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sheets {
    /// Boards only: their many lines distinguish relief from all else.
    Boards,
    /// Boards and squares.
    All,
}

/// The samples corrected for the boards' out-of-plane shape, and the generalised least-squares
/// optimum of these; `None` if there is no relief.
pub(crate) fn account_for_relief<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    refined: &Refined<L>,
    sheets: Sheets,
) -> Option<(Vec<ObservedPlane>, Refined<L>)> {
    let drifts = planes.iter().map(ObservedPlane::largest_tone_drift);
    let drift = drifts.fold(0.0, f64::max);
    let relief = |(plane, state): (&ObservedPlane, &PlaneState)| {
        let is_fitted = sheets == Sheets::All || plane.figures.iter().any(has_grid);
        let is_straight = !plane.figures.iter().any(Figure::is_round);
        match plane.board_relief {
            None if !plane.is_outlier() && is_fitted && is_straight => {
                BoardRelief::flat(plane, &refined.view, state)
            }
            known => known,
        }
    };
    let reliefs = planes.iter().zip(&refined.view.planes).map(relief);
    let reliefs: Vec<Option<BoardRelief>> = reliefs.collect();
    if reliefs.iter().all(Option::is_none) {
        return None;
    }
    let mut planes = planes.to_vec();
    for (plane, relief) in planes.iter_mut().zip(reliefs) {
        plane.board_relief = relief;
    }
    let mut found = refined.clone();
    let (variance, steepness) = spectrum(&mut errors(&planes, free, &found)?, drift, sheets)?;
    for board_relief in planes.iter_mut().filter_map(|p| p.board_relief.as_mut()) {
        (board_relief.variance, board_relief.steepness) = (variance, steepness);
    }
    // Samples are always moved from their given positions: moved step after step, they would be
    // wrong to the second order of the heights.
    let given = planes.clone();
    for _ in 0..MAX_STEPS {
        let errors = errors(&planes, free, &found)?;
        let step = errors.marginal(&errors.strength()?.mean)?.solve(0.0)?;
        let view = found.view.advanced(free, &step);
        for (p, plane) in planes.iter_mut().enumerate() {
            let state = &view.planes[p];
            if let Some(mut relief) = plane.board_relief {
                let height_step = step.blocks[p].rows(state.parameter_count(), TERMS);
                relief.heights += Heights::from_fn(|k, _| height_step[k]);
                *plane = corrected_for_relief(&given[p], relief, (&view.lens, state))?;
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

/// The mean variance of the relief, weighted by likelihood, and its steepness; `None` if there is
/// not clearly any. `drift` (px) is the standard deviation of a shift by the tone curve.
fn spectrum(errors: &mut SideErrors, drift: f64, sheets: Sheets) -> Option<(f64, i32)> {
    let at = |relief: f64| Assumption {
        relief,
        fields: &[],
    };
    let flat = errors.likeliest_under(&[at(FLAT)], None)[0]?;
    if rms_displacement(flat.0) < BEYOND_DRIFT * drift {
        return None;
    }
    let mut best = (flat.1 - CLEARLY, None);
    let steepnesses: &[i32] = match sheets {
        Sheets::Boards => &[STIFF],
        Sheets::All => &[STIFF, ROLLED],
    };
    for &steepness in steepnesses {
        errors.set_steepness(steepness);
        let (mut tried, mut lowest) = (Vec::new(), f64::INFINITY);
        for index in 0..VARIANCES {
            let variance = FIRST_VARIANCE * VARIANCE_RATIO.powi(index);
            let criterion = errors.likeliest_under(&[at(variance)], Some(flat.0))[0]?.1;
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
            best = (lowest, Some((sum / weights, steepness)));
        }
    }
    best.1
}

/// A plane whose samples are corrected for `relief` instead of its own.
fn corrected_for_relief<L: Lens>(
    given: &ObservedPlane,
    relief: BoardRelief,
    (lens, state): (&L, &PlaneState),
) -> Option<ObservedPlane> {
    let previous = given.board_relief?;
    let mut plane = given.clone();
    plane.board_relief = Some(relief);
    for (f, figure) in plane.figures.iter_mut().enumerate() {
        for side in &mut figure.sides {
            let line = state.line(f, &side.line()?);
            for sample in &mut side.samples {
                let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
                let distance =
                    lens.line_distance_jacobian(&pixel_ray, &line, crate::lens::Columns::NONE);
                let displacement = |relief: &BoardRelief| {
                    relief.displacement((lens, state), &line, &distance.wrt_line, sample)
                };
                let change = displacement(&relief)? - displacement(&previous)?;
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
