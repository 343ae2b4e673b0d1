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
use crate::solver::subset_stride;
use crate::uncertainty::unlikely_camera;

/// Minimum log odds by which a fisheye must explain the samples better: at most one camera in
/// twenty has such a lens.
const PREFERENCE: f64 = 3.0;

/// Angle from the axis, in radians, from which on a fisheye differs noticeably from a distorted
/// pinhole.
const WIDE: f64 = 0.7;

/// Whether the lens is a distorted pinhole, and the options allow a comparison with others.
pub(super) fn is_comparable_pinhole<L: Lens>(options: &Options<L>) -> bool {
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
    let number = |(index, figure): (usize, &PlaneEdges)| {
        let next = planes.len();
        // A figure without a shared plane is on a plane of its own.
        *planes.entry(figure.plane.ok_or(index)).or_insert(next)
    };
    let numbers: Vec<usize> = edges.iter().enumerate().map(number).collect();
    let is_related = edges.iter().any(|figure| !figure.relations.is_empty());
    let step = subset_stride(planes.len())
        .filter(|_| !is_related)
        .unwrap_or(1);
    let selected = edges
        .iter()
        .zip(numbers)
        .filter(|(_, plane)| plane % step == 0);
    selected
        .map(|(figure, _)| figure.thinned(SAMPLES_PER_LINE))
        .collect()
}

/// Maximum ratio of a fisheye's residuals to those of every distorted pinhole, if errors are shared
/// by whole sides under the fisheye as well: with boards, which have many lines, ...
const MAX_RATIO_WITH_BOARDS: f64 = 0.5;

/// ... and with squares, to whose few sides its coefficients adapt more easily.
pub(super) const MAX_RATIO_WITH_SQUARES: f64 = 0.25;

/// A model of a lens, and its fit to the edge samples.
pub(super) type FittedModel<'a, L> = (<L as Lens>::Model, &'a Calibration<L>);

/// Comparison of the fisheye's models with those of a distorted pinhole: the best of each.
pub(super) struct FamilyComparison<'a, A: Lens, B: Lens> {
    pub wide: FittedModel<'a, A>,
    pub plain: FittedModel<'a, B>,
    /// Log odds for the fisheye.
    pub odds: f64,
}

/// The fisheye with the best odds; of equals the one with the largest evidence within its family.
/// The evidence does not include the improbability of a fit, so that it may choose another one.
pub(super) fn best_comparison<'a, A: Lens, B: Lens>(
    edges: &[PlaneEdges],
    wide: &'a WeighedModels<A>,
    plain: &'a WeighedModels<B>,
) -> FamilyComparison<'a, A, B> {
    let has_boards = have_boards(edges);
    let start = comparison(has_boards, wide.chosen(), plain);
    let all = wide.fits().map(|fit| comparison(has_boards, fit, plain));
    all.fold(start, |best, next| match next.odds > best.odds {
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
fn comparison<'a, A: Lens, B: Lens>(
    has_boards: bool,
    wide: FittedModel<'a, A>,
    plain: &'a WeighedModels<B>,
) -> FamilyComparison<'a, A, B> {
    let fit = wide.1;
    let odds = |other| log_odds(wide, other);
    let rival = plain.fits();
    let rival = rival.min_by(|a, b| odds(*a).total_cmp(&odds(*b)));
    let rival = rival.unwrap_or(plain.chosen());
    let odds = odds(rival) - PREFERENCE - improbability(fit);
    let pinhole_rms = plain.fits().map(|(_, other)| other.rms);
    let max_ratio = match has_boards {
        true => MAX_RATIO_WITH_BOARDS,
        false => MAX_RATIO_WITH_SQUARES,
    };
    let is_explained =
        is_clean(fit) || fit.rms < max_ratio * pinhole_rms.fold(f64::INFINITY, f64::min);
    let may_follow_targets =
        || !unlikely_camera(fit, Fixed::default(), |_| None).is_empty() && !has_boards;
    let odds = match is_explained && !may_follow_targets() {
        true => odds,
        false => odds.min(0.0),
    };
    FamilyComparison {
        wide,
        plain: rival,
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
    let priors = fit.camera.coefficient_priors(fit.image_size);
    let values = fit.camera.parameters();
    let squares = values[INTRINSICS..].iter().zip(&priors);
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
pub(super) fn is_fisheye_like<L: Lens>(fit: &Calibration<L>) -> bool {
    let lens = &fit.camera;
    let is_wide_corner = |corner: &Vector2<f64>| {
        lens.unproject(corner).is_none_or(|ray| {
            let radius = (lens.inverse_focal_matrix() * (corner - lens.principal_point())).norm();
            let angle = ray.xy().norm().atan2(ray.z);
            // No pinhole sees points beside or behind the camera.
            angle > WIDE && radius < 0.5 * (angle + angle.min(FRAC_PI_2).tan())
        })
    };
    fit.image_size.corners().iter().any(is_wide_corner)
}

/// Log odds of one model's fit against another's. If errors are shared by whole sides under the
/// better one, the number of samples is limited to that of the sides' smooth displacements.
fn log_odds<A: Lens, B: Lens>(
    (model, fit): FittedModel<'_, A>,
    (other_model, other_fit): FittedModel<'_, B>,
) -> f64 {
    let samples: usize = fit.planes.iter().map(|plane| plane.samples).sum();
    let sides: usize = fit.residuals.iter().map(|figure| figure.sides.len()).sum();
    let count_of = |neighbours: f64, is_clean: bool| {
        let independent = samples as f64 / neighbours.max(1.0);
        match is_clean {
            true => independent,
            false => independent.min((ORDERS * sides) as f64),
        }
    };
    let independent = match fit.rms < other_fit.rms {
        true => count_of(fit.residual_correlation.neighbours, is_clean(fit)),
        false => count_of(
            other_fit.residual_correlation.neighbours,
            is_clean(other_fit),
        ),
    };
    let independent = independent.max(1.0);
    let [count, other_count] =
        [model.columns(), other_model.columns()].map(|columns| columns.iter().count());
    let added_count = count as f64 - other_count as f64;
    independent * (other_fit.rms / fit.rms).ln() - 0.5 * added_count * independent.ln()
}
