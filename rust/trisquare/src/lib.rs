#![doc = include_str!("../README.md")]
//!
//! # Conventions
//!
//! - Pixels are `(x, y)`, x right, y down, `(0, 0)` the centre of the top-left pixel; the image
//!   centre is `((W - 1) / 2, (H - 1) / 2)`.
//! - The camera matrix is `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`; distortion maps ideal to observed
//!   normalised points.
//! - A pose is `cam_from_plane`: `X_cam = R X_plane + t`, the plane at Z = 0 with its Z axis away
//!   from the camera. The unit is the first square's side.
//! - A line is `(a, b, c)` with `a x + b y + c = 0` and `a^2 + b^2 = 1`; it transforms as
//!   `l_plane ~ H^T l_image` under `H_image_from_plane`.
//! - A standard deviation is one sigma.

mod agreement;
mod arrow;
mod brown;
mod calibrate;
mod camera_maps;
mod candidate_pool;
mod choice;
mod conic;
mod consensus;
mod consistency;
mod correlated;
mod covariance;
mod crossings;
mod doubts;
mod drift;
mod edge_problem;
mod edges;
mod error;
mod explanation;
mod geometry;
mod homography;
mod hypotheses;
mod image_size;
mod joint_fit;
mod lattice_growth;
mod lattice_surface;
pub mod lens;
mod levenberg;
mod line;
mod linear;
mod local_noise;
mod localise;
mod misfit;
mod model_evidence;
pub mod normal;
mod normalisation;
mod observations;
mod outer;
mod paper;
mod parameters;
mod photometric;
mod picture;
mod pose;
mod pose_uncertainty;
mod power_curve;
mod predict;
mod projection_uncertainty;
pub mod radial;
mod refine;
mod remedies;
mod result;
mod robust;
mod saddles;
mod set_aside;
mod side_basis;
mod side_cubics;
mod side_errors;
mod side_families;
mod side_moments;
mod squareness;
mod stages;
mod straighten;
mod straightness;
#[cfg(feature = "synthetic")]
pub mod synthetic;
mod task;
mod tone;
mod undistorted_view;
mod undistortion_map;
mod view;
mod weakness;
mod work;

pub use brown::{Brown, BrownSight};
pub use calibrate::{calibrate, calibrate_photographs};
pub use choice::{Choice, Doubt, Verdict};
pub use conic::{
    ConicConstraint, KnownIntrinsics, camera_matrix, camera_matrix_from_homographies,
    intrinsics_of, solve_conic,
};
pub use consensus::choose;
pub use consistency::Disagreement;
pub use correlated::Coherence;
pub use crossings::{Crossing, Follower, GreyBytes, link_crossings};
pub use edges::{Freedom, PlaneEdges, Polarity};
pub use error::{Error, ErrorKind};
pub use homography::homography_from_lines;
pub use image_size::ImageSize;
pub use lattice_growth::{Lattice, Site};
pub use lattice_surface::LatticeSurface;
pub use lens::Lens;
pub use line::Line;
pub use localise::{
    EdgeSpan, NoEdge, SpanEdges, ToneEstimate, localise, localise_with_unknown_tone,
};
pub use model_evidence::{ModelAlternative, ModelChoice, calibrate_by_evidence};
pub use normalisation::Normalisation;
pub use parameters::{Fixed, Method, Model, Options};
pub use photometric::{Photographs, PictureTone, ToneFit};
pub use picture::{GreyReader, Picture, PictureError};
pub use pose::Pose;
pub use pose_uncertainty::PoseUncertainty;
pub use power_curve::{PowerCurve, Sensitivity};
pub use predict::{EdgeNoise, PlannedPlane, Prediction, predict, predict_unjudged};
pub use projection_uncertainty::ProjectionUncertainty;
pub use result::{Calibration, Plane, Stage, Warning};
pub use saddles::{SaddleStep, settled_on_saddle};
pub use side_cubics::{SidePoints, trimmed_cubics};
pub use straighten::{Straightening, fit_distortion};
pub use tone::{Tone, ToneCurve};
pub use undistortion_map::{UndistortionMap, largest_rectangle};
pub use weakness::{Cause, Remedy, Weakness};
