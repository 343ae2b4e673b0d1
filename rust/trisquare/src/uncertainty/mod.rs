//! Uncertainty of the camera, and the judgement whether the geometry determines it at all.

mod assumed_centre;
mod comparison;
mod conditioning;
mod contradicted_relations;
mod correlated_residuals;
mod covariance;
mod disagreement;
mod expectations;
mod held_skew;
mod lens_beyond;
mod plane_angle;
mod plane_points;
mod plane_spread;
mod pose;
mod projection;
mod remedies;
mod unchecked_targets;

pub(crate) use assumed_centre::assumed_centre;
pub use comparison::{DifferenceTest, ProjectionDifference, compare_projections};
pub(crate) use conditioning::{Conditioning, judged_parameters};
pub(crate) use contradicted_relations::contradicted_relations;
pub(crate) use correlated_residuals::{Correlated, correlated_covariance, weighted_by_noise};
pub(crate) use covariance::{check_plane_count, check_plane_equations, covariance};
pub(crate) use disagreement::disagreement;
pub(crate) use expectations::{camera_known_to, poorly_known, unlikely_camera, widen};
pub(crate) use held_skew::held_skew;
pub(crate) use lens_beyond::{LensVerdict, beyond_lens};
pub use plane_points::points_on_plane;
pub(crate) use pose::pose_uncertainties;
pub use projection::ProjectionUncertainty;
pub(crate) use remedies::{MARGIN, add_remedies};
pub(crate) use unchecked_targets::unchecked_targets;
