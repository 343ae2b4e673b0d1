//! What a calibration returns: data alone.

mod calibration;
mod coherence;
mod disagreement;
mod pose_uncertainty;
mod warning;

pub use calibration::{Calibration, Plane};
pub use coherence::Coherence;
pub use disagreement::Disagreement;
pub use pose_uncertainty::PoseUncertainty;
pub use warning::{Stage, Warning};
