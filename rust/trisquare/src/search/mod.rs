//! The search for boards in a picture: saddles, the edges that link them, and lattices; cubics
//! through the sides of squares; contours with four corners; and the edges of a picture as arcs.

mod arcs;
#[cfg(test)]
mod bent_board;
mod candidates;
mod cell_shades;
mod contours;
mod edge_chains;
mod edge_following;
mod extension;
mod find_lattices;
mod fitted_sides;
mod folds;
mod four_corners;
mod lattice;
mod lattice_growth;
mod lattice_surface;
mod level;
mod link_edges;
mod merging;
mod outline;
mod photograph;
mod pieces;
mod polygon;
mod replacing;
mod saddles;
mod sectors;
mod side_cubics;

pub use arcs::{ArcLimits, circular_arcs};
pub use edge_chains::{GreyFloats, edge_chains};
pub use find_lattices::{FoundLattices, find_lattices};
pub use fitted_sides::{FittedQuad, SideLimits, fit_sides};
pub use four_corners::{FourSided, POINTS_PER_SIDE, Sides, four_cornered, four_sided};
pub use lattice::Lattice;
