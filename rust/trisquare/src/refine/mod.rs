//! Joint maximum likelihood over edge samples.

mod edge_problem;
mod line_sums;
mod residuals;
mod search;
mod side_curve;

pub(crate) use edge_problem::EdgeProblem;
pub(crate) use residuals::{
    MIN_SCALE, Residual, Residuals, residuals, robust_scale, root_mean_square,
    straightness_residuals,
};
pub(crate) use search::{Refined, Search, finish, information, search};
