//! What a calibration returns: data alone.

mod calibration;
mod disagreement;
mod pose_uncertainty;
mod residual_correlation;
mod residuals;
mod warning;

pub use calibration::{Calibration, Plane};
pub use disagreement::Disagreement;
pub use pose_uncertainty::PoseUncertainty;
pub use residual_correlation::ResidualCorrelation;
pub use residuals::{FigureResiduals, SideResiduals};
pub use warning::{Stage, Warning};
