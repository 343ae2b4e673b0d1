//! Data of a calibration's result.

mod alternative;
mod calibration;
mod residual_correlation;
#[cfg(feature = "serde")]
mod stored;
mod warning;
mod warning_words;

pub use alternative::{Alternative, Setting};
pub(crate) use calibration::deviations;
pub use calibration::{
    Aspect, Calibration, CircleRadius, Estimate, FigureResiduals, Plane, PoseUncertainty,
    SceneLine, SideResiduals,
};
pub use residual_correlation::ResidualCorrelation;
pub(crate) use warning::NOTABLE_FACTOR;
pub use warning::{Disagreement, Severity, Stage, Warning};
