//! Lines of the scene: what is known of the lens from the planes, joined with that straight lines
//! are straight.
//!
//! A line's image under a lens is that of a plane `l` through the camera's centre: two numbers, so
//! that lines say nothing of the camera matrix, and never vouch for it where the planes do not
//! determine it. The planes' answer and its covariance are all that they say of the lens, to second
//! order; the lines are added to that by generalised least squares. Then the planes' poses follow.

mod follow;
mod join;
mod mixture;
mod observed_line;

pub(crate) use join::add_lines;
