//! The paper's three linear steps: straighten, homographies, conic.

mod circles;
mod first_view;
mod homographies;
mod straighten;

pub(crate) use first_view::{
    conic_camera_matrix, fallback_camera_matrices, first_view, guessed_camera_matrices,
    view_by_lens,
};
pub(crate) use homographies::{Homographies, Undistortion, homography_of_figure};
pub use straighten::{Straightening, fit_distortion};
