//! Lines of the scene: what is known of the lens from the planes, joined with that straight lines
//! are straight.
//!
//! A line's image under a lens is that of a plane `l` through the camera's centre: two numbers, so
//! that lines say nothing of the camera matrix, and never vouch for it where the planes do not
//! determine it. The lines join what the planes say by generalised least squares; the poses follow.

mod follow;
mod join;
mod mixture;
mod observed_line;
mod planes;

pub(crate) use join::add_lines;
