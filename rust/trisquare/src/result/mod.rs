//! What a calibration returns: data alone.

mod calibration;
mod residual_correlation;
mod warning;

pub use calibration::{
    Aspect, Calibration, CircleRadius, FigureResiduals, Plane, PoseUncertainty, SceneLine,
    SideResiduals,
};
pub use residual_correlation::ResidualCorrelation;
pub use warning::{Disagreement, Severity, Stage, Warning};
