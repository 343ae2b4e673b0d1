//! Input and state of a fit: edge samples by plane, options, free parameters, the view.

mod chessboard;
mod coinciding;
mod curve;
mod deformation;
mod edge_checks;
mod edge_shift;
mod families;
mod free_parameters;
mod observed;
mod options;
mod placement;
mod plane_edges;
mod relation;
mod relations;
mod sample_checks;
mod side_order;
mod view;

pub use chessboard::Chessboard;
pub(crate) use curve::{Curve, ModelLine, Radius};
pub(crate) use deformation::{
    Deformation, DeformationKind, DeformationPrior, SHEAR, STRETCH, TERMS, Terms,
};
pub(crate) use edge_checks::samples_outside;
pub use edge_shift::{CellSample, GridLineSamples, remove_edge_shift};
pub(crate) use free_parameters::{FreeParameters, PRIOR_SLACK};
pub(crate) use observed::{
    Figure, ObservedPlane, Sample, Side, directions, has_grid, lines_of_scene, sort_by_plane,
};
pub use options::{Fixed, Method, Options};
pub(crate) use placement::Placement;
#[cfg(feature = "synthetic")]
pub(crate) use plane_edges::rectangle_lines;
pub use plane_edges::{Freedom, PlaneEdges, Polarity};
pub(crate) use relation::Related;
pub use relation::Relation;
pub use relations::relate_planes;
pub(crate) use relations::{check_relations, relations_of};
pub(crate) use sample_checks::check_samples;
pub(crate) use view::{POSE_PARAMETERS, PlaneState, View};
