//! The search for boards in a picture: saddles, the edges that link them, and lattices.

mod edge_following;
mod lattice_growth;
mod lattice_surface;
mod saddles;
mod side_cubics;

pub use edge_following::{Crossing, Follower, link_crossings};
pub use lattice_growth::{Lattice, Site};
pub use lattice_surface::LatticeSurface;
pub use saddles::{SaddleStep, refine_corner};
pub use side_cubics::{SidePoints, trimmed_cubics};
