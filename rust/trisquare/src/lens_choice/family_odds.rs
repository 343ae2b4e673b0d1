//! The odds of a fisheye against a distorted pinhole.
//!
//! The two are not nested. Each model of one is compared with each model of the other, by the
//! criterion of G. Schwarz (Ann. Statist. 6 (1978) 461-464) on the edge samples, whose effective
//! number allows for their correlation.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector2;

use super::models::{WeighedModels, check_comparable};
use crate::lens::{DistortionModel, INTRINSICS, Lens};
use crate::noise::ORDERS;
use crate::observations::{Fixed, Options, PRIOR_SLACK, PlaneEdges, has_grid, sort_by_plane};
use crate::result::Calibration;
use crate::solver::step_of_some;
use crate::uncertainty::unlikely_camera;

/// Minimum log odds by which a fisheye must explain the samples better: at most one camera in
/// twenty has such a lens.
const PREFERENCE: f64 = 3.0;

/// Angle from the axis, in radians, from which on a fisheye differs noticeably from a distorted
/// pinhole.
const WIDE: f64 = 0.7;

/// Whether the lens is a distorted pinhole, and the options allow a comparison with others.
pub(super) fn may_be_another<L: Lens>(options: &Options<L>) -> bool {
    let is_fisheye = L::centre_columns().is_empty();
    !is_fisheye && check_comparable(options).is_ok()
}

/// Maximum number of samples per line in a comparison of families, as a fisheye's cost is per
/// sample.
const SAMPLES_PER_LINE: usize = 100;

/// The edges used in a comparison of families: of many planes only some, unless they have
/// relations.
pub(super) fn subsampled(edges: &[PlaneEdges]) -> Vec<PlaneEdges> {
    let mut planes = HashMap::new();
    let number = |(index, own): (usize, &PlaneEdges)| {
        let next = planes.len();
        // A figure without a shared plane is on a plane of its own.
        *planes.entry(own.plane.ok_or(index)).or_insert(next)
    };
    let numbers: Vec<usize> = edges.iter().enumerate().map(number).collect();
    let is_related = edges.iter().any(|own| !own.relations.is_empty());
    let step = step_of_some(planes.len())
        .filter(|_| !is_related)
        .unwrap_or(1);
    let some = edges
        .iter()
        .zip(numbers)
        .filter(|(_, plane)| plane % step == 0);
    some.map(|(own, _)| own.thinned(SAMPLES_PER_LINE)).collect()
}

/// Maximum ratio of a fisheye's residuals to those of every distorted pinhole, if errors are shared
/// by whole sides under the fisheye as well: with boards, which have many lines, ...
const MAX_LEFT_OF_BOARDS: f64 = 0.5;

/// ... and with squares, to whose few sides its coefficients adapt more easily.
pub(super) const MAX_LEFT_OF_SQUARES: f64 = 0.25;

/// A model of a lens, and its fit to the edge samples.
pub(super) type FittedModel<'a, L> = (<L as Lens>::Model, &'a Calibration<L>);

/// Comparison of the fisheye's models with those of a distorted pinhole: the best of each.
pub(super) struct Standing<'a, A: Lens, B: Lens> {
    pub wide: FittedModel<'a, A>,
    pub plain: FittedModel<'a, B>,
    /// Log odds for the fisheye.
    pub odds: f64,
}

/// The fisheye with the best odds; of equals the one with the largest evidence within its family.
/// The evidence does not include the improbability of a fit, so that it may choose another one.
pub(super) fn best_standing<'a, A: Lens, B: Lens>(
    edges: &[PlaneEdges],
    wide: &'a WeighedModels<A>,
    plain: &'a WeighedModels<B>,
) -> Standing<'a, A, B> {
    let has_boards = have_boards(edges);
    let start = standing(has_boards, wide.chosen(), plain);
    let of_all = wide.fits().map(|own| standing(has_boards, own, plain));
    of_all.fold(start, |best, next| match next.odds > best.odds {
        true => next,
        false => best,
    })
}

/// Compares one fisheye with every distorted pinhole: the odds are reduced by the preference and by
/// the fisheye's improbability under the prior. If errors are shared by whole sides under it as
/// well (targets that are not flat), its coefficients adapt to these, and its residuals have to be
/// much smaller than those of every pinhole.
///
/// Targets that are not squares lead to coefficients that no lens has, or to an unusual camera:
/// then they are the likelier cause, unless there are boards, whose many lines determine their
/// shape.
fn standing<'a, A: Lens, B: Lens>(
    has_boards: bool,
    wide: FittedModel<'a, A>,
    plain: &'a WeighedModels<B>,
) -> Standing<'a, A, B> {
    let fit = wide.1;
    let odds = |other| log_odds(wide, other);
    let against = plain.fits();
    let against = against.min_by(|one, other| odds(*one).total_cmp(&odds(*other)));
    let against = against.unwrap_or(plain.chosen());
    let odds = odds(against) - PREFERENCE - improbability(fit);
    let least = plain.fits().map(|(_, other)| other.rms);
    let most_left = match has_boards {
        true => MAX_LEFT_OF_BOARDS,
        false => MAX_LEFT_OF_SQUARES,
    };
    let explains = is_clean(fit) || fit.rms < most_left * least.fold(f64::INFINITY, f64::min);
    let follows_targets =
        || !unlikely_camera(fit, Fixed::default(), |_| None).is_empty() && !has_boards;
    let odds = match explains && !follows_targets() {
        true => odds,
        false => odds.min(0.0),
    };
    Standing {
        wide,
        plain: against,
        odds,
    }
}

fn have_boards(edges: &[PlaneEdges]) -> bool {
    let planes = sort_by_plane(edges).unwrap_or_default();
    planes.iter().flat_map(|plane| &plane.figures).any(has_grid)
}

/// Minus the logarithm of the prior density of a lens's coefficients, over that of zero: normal,
/// with the widths of the prior used in a calibration.
fn improbability<L: Lens>(fit: &Calibration<L>) -> f64 {
    let usual = fit.camera.coefficient_priors(fit.image_size);
    let values = fit.camera.parameters();
    let squares = values[INTRINSICS..].iter().zip(&usual);
    squares
        .map(|(value, std)| 0.5 * (value / (PRIOR_SLACK * std)).powi(2))
        .sum()
}

/// Whether the residuals of the samples show no errors shared by whole sides.
pub(super) fn is_clean<L: Lens>(fit: &Calibration<L>) -> bool {
    fit.residual_correlation.probability < 0.5
}

/// Whether the radius of the picture's corners is closer to that of a fisheye than to that of a
/// pinhole, at angles from the axis at which the two differ by more than noise.
///
/// The radius is the angle for a fisheye and its tangent for a pinhole.
pub(super) fn bends_as_a_fisheye<L: Lens>(fit: &Calibration<L>) -> bool {
    let lens = &fit.camera;
    let bends = |corner: &Vector2<f64>| {
        lens.unproject(corner).is_none_or(|ray| {
            let radius = (lens.inverse_focal_matrix() * (corner - lens.principal_point())).norm();
            let angle = ray.xy().norm().atan2(ray.z);
            // No pinhole sees points beside or behind the camera.
            angle > WIDE && radius < 0.5 * (angle + angle.min(FRAC_PI_2).tan())
        })
    };
    fit.image_size.corners().iter().any(bends)
}

/// Log odds of one model's fit against another's. If errors are shared by whole sides under the
/// better one, the number of samples is limited to that of the sides' smooth displacements.
fn log_odds<A: Lens, B: Lens>(
    (model, one): FittedModel<'_, A>,
    (other_model, other): FittedModel<'_, B>,
) -> f64 {
    let samples: usize = one.planes.iter().map(|plane| plane.samples).sum();
    let sides: usize = one.residuals.iter().map(|figure| figure.sides.len()).sum();
    let count_of = |neighbours: f64, is_clean: bool| {
        let independent = samples as f64 / neighbours.max(1.0);
        match is_clean {
            true => independent,
            false => independent.min((ORDERS * sides) as f64),
        }
    };
    let independent = match one.rms < other.rms {
        true => count_of(one.residual_correlation.neighbours, is_clean(one)),
        false => count_of(other.residual_correlation.neighbours, is_clean(other)),
    };
    let independent = independent.max(1.0);
    let [count, others] = [model.columns(), other_model.columns()].map(|own| own.iter().count());
    let further = count as f64 - others as f64;
    independent * (other.rms / one.rms).ln() - 0.5 * further * independent.ln()
}
