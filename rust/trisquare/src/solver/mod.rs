//! From the planes of a scene to the best camera, and the outliers left out of it.

mod advice;
mod assemble;
mod many;
mod nested_models;
mod optimum;
mod outliers;
mod problem;
mod richer_lens;
mod solve;
mod starts;
mod whole_picture;
mod work;

pub(crate) use many::subset_stride;
pub(crate) use nested_models::NestedOptima;
pub(crate) use outliers::{reject_outliers, solution_if_agreed};
pub(crate) use problem::{Failure, JointProblem};
pub(crate) use solve::Solution;
pub(crate) use work::Work;
