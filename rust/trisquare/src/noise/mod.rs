//! Noise of an optimum's residuals: local noise, errors shared along sides, boards that are not
//! flat, and errors of tone curves.

mod deformation;
mod deformation_fit;
mod local;
mod misfit;
mod picture_fields;
mod reml;
mod side_basis;
mod side_errors;
mod side_families;
mod side_moments;
mod tone_drift;

pub(crate) use deformation_fit::{Sheets, account_for_deformation};
pub(crate) use local::{LocalNoise, Noise, white_variance};
pub(crate) use misfit::Misfit;
pub(crate) use picture_fields::{FIELDS, PictureFields};
pub(crate) use reml::{Assumption, Strength};
pub(crate) use side_basis::{ORDERS, basis, direction, places};
pub(crate) use side_errors::{SideErrors, displacement_variance, rms_displacement};
pub(crate) use side_families::spectrum;
pub(crate) use side_moments::{Moments, SideMoments};
pub(crate) use tone_drift::{account_for_drift, check_drift_count, corrected_for_drift};
