//! Lines, poses, homographies and the image of the absolute conic.

mod circles;
mod conic;
mod homography;
mod line;
mod normalisation;
mod pose;

pub(crate) use circles::{
    area, concentric_homography, fit_circle, fit_ellipse, separate_homography,
};
pub use conic::camera_matrix_from_homographies;
pub(crate) use conic::{
    KnownIntrinsics, PlaneHomography, aspect_of_homography, camera_matrix_from_planes,
};
pub use homography::homography_from_lines;
pub(crate) use homography::{MIN_LINES, normalised_homography};
pub use line::Line;
pub(crate) use line::{MIN_LINE_SAMPLES, line_of_rays};
pub(crate) use normalisation::Normalisation;
pub use pose::Pose;
