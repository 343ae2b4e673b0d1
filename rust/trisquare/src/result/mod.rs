//! What a calibration returns: data alone.

mod calibration;
mod residual_correlation;
#[cfg(feature = "serde")]
mod stored;
mod warning;

pub(crate) use calibration::deviations;
pub use calibration::{
    Aspect, Calibration, CircleRadius, Estimate, FigureResiduals, Plane, PoseUncertainty,
    SceneLine, SideResiduals,
};
pub use residual_correlation::ResidualCorrelation;
pub use warning::{Alternative, Disagreement, Setting, Severity, Stage, Warning};
