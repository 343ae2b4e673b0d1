//! The odds of a fisheye against a distorted pinhole.
//!
//! The two are not nested in each other. The models of each are weighed one by one against those of
//! the other, by the criterion of G. Schwarz (Ann. Statist. 6 (1978) 461-464) on the edge samples,
//! which count as so many independent ones as their correlation leaves.

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

/// Logarithm of the odds by which a fisheye must explain the samples better: one camera in twenty,
/// or fewer, has such a lens.
const PREFERENCE: f64 = 3.0;

/// The angle from the axis, in radians, from which on a fisheye is told from a distorted pinhole.
const WIDE: f64 = 0.7;

/// Whether the lens is a distorted pinhole, for which another may be looked for under these options.
pub(super) fn may_be_another<L: Lens>(options: &Options<L>) -> bool {
    let is_fisheye = L::centre_columns().is_empty();
    !is_fisheye && check_comparable(options).is_ok()
}

/// Samples of a line that tell one family from another. A fisheye is asked sample by sample.
const SAMPLES_PER_LINE: usize = 100;

/// Edges that tell one family from another: of many planes some, unless they stand in relations.
pub(super) fn subsampled(edges: &[PlaneEdges]) -> Vec<PlaneEdges> {
    let mut planes = HashMap::new();
    let number = |(index, own): (usize, &PlaneEdges)| {
        let next = planes.len();
        // A figure that shares no plane has one of its own.
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

/// Where sides err together under a fisheye as well, it leaves at most this part of the residuals of
/// every distorted pinhole: of the many lines of boards, ...
const MAX_LEFT_OF_BOARDS: f64 = 0.5;

/// ... and of squares, whose few sides its coefficients follow more easily.
pub(super) const MAX_LEFT_OF_SQUARES: f64 = 0.25;

/// A model of a lens, and its fit to the edge samples.
pub(super) type FittedModel<'a, L> = (<L as Lens>::Model, &'a Calibration<L>);

/// How the fisheye's models stand against those of a distorted pinhole: the best against the best.
pub(super) struct Standing<'a, A: Lens, B: Lens> {
    pub wide: FittedModel<'a, A>,
    pub plain: FittedModel<'a, B>,
    /// Logarithm of the odds for the fisheye.
    pub odds: f64,
}

/// The fisheye that stands best; of equals the one with the largest evidence within its family. That
/// does not count what is unlikely of a fit, and need not be the best.
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

/// One fisheye against every distorted pinhole: the odds are less the preference and what is unlikely
/// of it beforehand. Where sides err together under it as well (targets that are not flat), its
/// coefficients follow these, and it has to leave much less than every one.
///
/// Targets that are no squares are followed by coefficients that no lens has, or by a camera as
/// hardly any is: then they are the likelier cause, unless there are boards, whose many lines hold
/// their shape.
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

/// Minus the logarithm of the prior density of a lens's coefficients, over that of none: normal, as
/// wide as where a calibration is held by it.
fn improbability<L: Lens>(fit: &Calibration<L>) -> f64 {
    let usual = fit.camera.coefficient_priors(fit.image_size);
    let values = fit.camera.parameters();
    let squares = values[INTRINSICS..].iter().zip(&usual);
    squares
        .map(|(value, std)| 0.5 * (value / (PRIOR_SLACK * std)).powi(2))
        .sum()
}

/// Whether the residuals of the samples show no sides that err together.
pub(super) fn is_clean<L: Lens>(fit: &Calibration<L>) -> bool {
    fit.residual_correlation.probability < 0.5
}

/// Whether the picture's corners are imaged as far out as a fisheye would, rather than a pinhole, and
/// see so far from the axis that both are told apart by more than noise.
///
/// The radius is the angle for one and its tangent for the other.
pub(super) fn bends_as_a_fisheye<L: Lens>(fit: &Calibration<L>) -> bool {
    let lens = &fit.camera;
    let bends = |corner: &Vector2<f64>| {
        lens.unproject(corner).is_none_or(|ray| {
            let radius = (lens.inverse_focal_matrix() * (corner - lens.principal_point())).norm();
            let angle = ray.xy().norm().atan2(ray.z);
            // What lies beside the camera or behind it no pinhole sees.
            angle > WIDE && radius < 0.5 * (angle + angle.min(FRAC_PI_2).tan())
        })
    };
    fit.image_size.corners().iter().any(bends)
}

/// Logarithm of the odds of one model's fit against another's. Where sides err together under the
/// better one, they count by their smooth displacements, however many samples show them.
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
