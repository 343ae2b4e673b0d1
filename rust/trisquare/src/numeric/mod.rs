//! Numerical tools independent of cameras: normal equations with arrowhead structure, damped least
//! squares, interpolation, robust losses, covariances, the normal and the chi-squared distribution.

mod arrowhead;
mod block_equations;
mod chebyshev;
mod chi_square;
mod covariance;
mod each;
mod levenberg;
mod normal;
mod rank_one;
mod robust;
mod ties;
mod variance_component;

pub(crate) use arrowhead::{ArrowStep, ArrowSystem, Block, Reduced};
pub(crate) use block_equations::BlockEquations;
pub(crate) use chebyshev::{
    LANES, NODES, PolynomialSums, coefficients, node_places, polynomial_at, polynomials,
};
pub use chi_square::chi_square_tail;
pub(crate) use chi_square::normal_deviate;
pub use covariance::is_covariance;
pub(crate) use each::each;
pub(crate) use levenberg::{Limits, Minimum, Problem, Termination, minimise};
pub use normal::cdf;
pub(crate) use normal::{BivariateNormal, cdf_and_pdf, pdf};
pub(crate) use rank_one::{LaneSums, add_rank_one, symmetric_entry};
pub(crate) use robust::{Loss, ResidualSpread, median, median_scale, upper_median};
pub(crate) use ties::{Ties, pseudo_inverse};
pub(crate) use variance_component::variance_about_zero;
