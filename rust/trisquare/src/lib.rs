//! Camera calibration with lens distortion from a single photograph of three squares.

mod arrow;
mod brown;
mod calibrate;
mod conic;
mod consistency;
mod covariance;
mod edges;
mod error;
mod homography;
mod image_size;
pub mod lens;
mod levenberg;
mod line;
mod linear;
mod localise;
pub mod normal;
mod normalisation;
mod observations;
mod outer;
mod parameters;
mod photometric;
mod picture;
mod pose;
pub mod radial;
mod refine;
mod result;
mod robust;
mod straighten;
#[cfg(feature = "synthetic")]
pub mod synthetic;
mod tone;

pub use brown::{Brown, BrownSight};
pub use calibrate::{calibrate, calibrate_photographs};
pub use conic::{
    ConicConstraint, KnownIntrinsics, camera_matrix, camera_matrix_from_homographies,
    intrinsics_of, solve_conic,
};
pub use consistency::Disagreement;
pub use edges::{Freedom, PlaneEdges, Polarity};
pub use error::{Error, ErrorKind};
pub use homography::homography_from_lines;
pub use image_size::ImageSize;
pub use lens::Lens;
pub use levenberg::Termination;
pub use line::Line;
pub use localise::{EdgeSpan, NoEdge, SpanEdges, localise};
pub use normalisation::Normalisation;
pub use parameters::{Fixed, Method, Model, Options};
pub use photometric::Photographs;
pub use picture::{GreyReader, Picture, PictureError};
pub use pose::Pose;
pub use result::{Calibration, Plane, Stage, Warning};
pub use straighten::{Straightening, fit_distortion};
pub use tone::{Tone, ToneCurve};

/// Compiles the README's example with the documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
