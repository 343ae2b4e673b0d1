//! The search for boards in a picture: saddles, the edges that link them, and lattices; cubics
//! through the sides of squares; and the edges of a picture as arcs.

mod arcs;
#[cfg(test)]
mod bent_board;
mod cell_shades;
mod edge_chains;
mod edge_following;
mod extension;
mod find_lattices;
mod folds;
mod lattice;
mod lattice_growth;
mod lattice_surface;
mod level;
mod link_edges;
mod merging;
mod outline;
mod photograph;
mod pieces;
mod replacing;
mod saddles;
mod sectors;
mod side_cubics;

pub use arcs::{ArcLimits, circular_arcs};
pub use edge_chains::{GreyFloats, edge_chains};
pub use find_lattices::{ReducedPicture, find_lattices};
pub use lattice::Lattice;
pub use sectors::Candidate;
pub use side_cubics::{SidePoints, trimmed_cubics};
