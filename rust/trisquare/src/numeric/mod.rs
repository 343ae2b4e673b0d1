//! Numerical tools that know nothing of cameras: normal equations in the shape of an arrow, damped
//! least squares, robust losses, the normal distribution.

mod arrowhead;
mod levenberg;
mod normal;
mod rank_one;
mod robust;

pub(crate) use arrowhead::{ArrowStep, ArrowSystem, Block};
pub(crate) use levenberg::{Limits, Minimum, Problem, Termination, minimise};
pub use normal::cdf;
pub(crate) use normal::{BivariateNormal, cdf_and_pdf, pdf};
pub(crate) use rank_one::{add_outer, symmetric};
pub(crate) use robust::{Loss, Spread, median, median_scale};
