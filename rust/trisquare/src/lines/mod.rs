//! Lines of the scene: the planes' information on the lens, combined with the straightness of
//! lines.
//!
//! A line's image under a lens is that of a plane `l` through the camera's centre, which has two
//! parameters. Lines therefore give no information on the camera matrix, and do not replace planes
//! that fail to determine it. They are combined with the planes by generalised least squares; the
//! poses follow.

mod follow;
mod join;
mod mixture;
mod observed_line;
mod planes;

pub(crate) use join::add_lines;
