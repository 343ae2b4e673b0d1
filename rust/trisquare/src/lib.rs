#![doc = include_str!("../README.md")]
//!
//! # Functions in the order of their use
//!
//! 1. [`Picture::from_u8`] (or `from_u16`, `from_f32`) takes the decoded pixels.
//! 2. [`EdgeSpan::new`] describes a stretch of edge, from an outline that is good to a few pixels.
//!    Finding the outlines is left to the caller; the Python package does it with OpenCV.
//!    [`Chessboard::spans`] describes all lines of a board, from its corners.
//! 3. [`localise_with_unknown_tone`] measures the edges and estimates the tone curve, [`localise`]
//!    measures them with a known one. Neither can fail as a whole: every span has its own samples,
//!    or a [`NoEdge`].
//! 4. [`PlaneEdges::square`] and similar functions sort the samples by figure,
//!    [`Chessboard::edges`] those of a board. Edges measured by another program enter here.
//! 5. [`choose`] selects the planes that one camera explains, if some may not be true squares.
//! 6. [`calibrate`] fits the camera to the samples, [`calibrate_photographs`] to the pixels, too
//!    (with the pixels that [`pixels_to_keep`] returns, and [`ToneEstimate::picture_tone`]).
//!    [`calibrate_by_evidence`] chooses the lens model, [`calibrate_by_family`] also between a
//!    distorted pinhole and a fisheye. Every refusal is an [`Error`] with its numbers.
//! 7. [`Calibration::estimates`] pairs the camera's parameters with their standard deviations;
//!    `planes`, `covariance` and `warnings` have the rest.
//! 8. The trait [`Lens`] projects a point and unprojects a pixel, [`PointMaps`] many of them: both
//!    traits have to be in scope. [`UndistortedView::undistorted`] is the pinhole of pictures
//!    without distortion, [`UndistortionMap`] their map for OpenCV;
//!    [`Calibration::projection_uncertainty`] gives the uncertainty of a ray.
//!
//! A user's own lens is a type with the trait [`Lens`]: `tests/public/equidistant.rs` of the
//! package is a short one, which runs through the whole pipeline.
//!
//! The example `picture` covers steps 1 to 7 without 5, `chessboard` the same for boards, `edges`
//! starts at 4, `boards` has several figures on each plane, `undistort` covers 8. For straight
//! lines without squares there is only [`fit_distortion`]. [`predict`] predicts how well planes
//! would determine a camera. [`nalgebra`] is re-exported in the version of the crate's vectors.
//!
//! # Conventions
//!
//! - Pixels are `(x, y)`, x right, y down, `(0, 0)` the centre of the top-left pixel; the image
//!   centre is `((W - 1) / 2, (H - 1) / 2)`.
//! - The camera matrix is `[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`, the skew zero unless it is
//!   freed; distortion maps ideal to observed normalised points.
//! - A pose is `cam_from_plane`: `X_cam = R X_plane + t`, the plane at Z = 0 with its Z axis away
//!   from the camera. Every plane has its own unit: the side of its first square, the shorter side
//!   of a rectangle, or the unit in which the lines or radii of its first figure are given.
//! - A line is `(a, b, c)` with `a x + b y + c = 0` and `a^2 + b^2 = 1`; it transforms as
//!   `l_plane ~ H^T l_image` under `H_image_from_plane`.
//! - A standard deviation is one sigma.
//! - A figure is one [`PlaneEdges`]. Figures, planes, lines and samples are indices into the
//!   arguments, starting at 0, also in errors and warnings. If a warning has a plane and a figure,
//!   the figure's index is among the figures of the plane. A figure under construction, as by
//!   [`PlaneEdges::square`], is figure 0.

mod calibrate;
mod error;
mod geometry;
mod ill_conditioning;
mod image;
mod image_size;
pub mod lens;
mod lens_choice;
mod linear;
mod lines;
mod localise;
mod noise;
mod numeric;
mod observations;
mod photometric;
mod planning;
mod refine;
mod result;
mod search;
mod selection;
mod solver;
#[cfg(feature = "serde")]
mod stored;
#[cfg(feature = "synthetic")]
pub mod synthetic;
mod uncertainty;

pub use nalgebra;

pub use calibrate::{calibrate, calibrate_photographs};
pub use error::{Error, ErrorKind};
pub use geometry::{Line, Pose, camera_matrix_from_homographies, homography_from_lines};
pub use ill_conditioning::{Cause, IllConditioning, Remedy};
pub use image::{
    GreyReader, KeptPixels, Picture, PictureError, PictureTone, PowerCurve, Sensitivity, Tone,
    ToneCurve, ToneFit,
};
pub use image_size::ImageSize;
pub use lens::{
    Brown, BrownModel, Distortion, DistortionModel, DistortionTerm, Fisheye, FisheyeModel, Lens,
    LensFamily, NearestLens, OpenCvLens, OpenCvModel, PictureView, PointMaps, Rational,
    RationalModel, SeenAgain, Surface, ThinPrism, ThinPrismModel, TurnedLenses, UndistortedView,
    UndistortionMap,
};
pub use lens_choice::{
    FamilyChoice, ModelAlternative, ModelChoice, RejectedFamily, calibrate_by_evidence,
    calibrate_by_family, or_fisheye, warn_of_fisheye, warn_of_opencv_lens,
};
pub use linear::{Straightening, fit_distortion};
pub use localise::{
    ColourDisplacements, EdgeSpan, Localised, MotionBlur, NoEdge, PartDisplacement, PictureFaults,
    SpanEdges, ToneEstimate, localise, localise_with_unknown_tone,
};
pub use observations::{
    CellSample, Chessboard, Fixed, Freedom, GridLineSamples, Method, Options, PlaneEdges, Polarity,
    Relation, relate_planes, remove_edge_shift,
};
pub use photometric::{Photographs, pixels_to_keep};
pub use planning::{EdgeNoise, PlannedPlane, Prediction, predict};
pub use result::{
    Alternative, Aspect, Calibration, CircleRadius, Disagreement, Estimate, FigureResiduals, Plane,
    PoseUncertainty, ResidualCorrelation, SceneLine, Setting, Severity, SideResiduals, Stage,
    Warning,
};
pub use selection::{Choice, Doubt, Verdict, choose};
pub use uncertainty::{
    DifferenceTest, ProjectionDifference, ProjectionUncertainty, compare_projections,
    points_on_plane,
};

/// Parts used by the detectors of the Python package and by the tests. Not stable: it may change in
/// any release.
#[doc(hidden)]
pub mod internals {
    pub use crate::image::GreyBytes;
    pub use crate::lens::{largest_rectangle, monotonic_radius};
    pub use crate::numeric::{cdf, is_covariance};
    pub use crate::planning::predict_unjudged;
    pub use crate::search::{
        ArcLimits, FittedQuad, FoundLattices, FourSided, GreyFloats, Lattice, POINTS_PER_SIDE,
        SideLimits, Sides, circular_arcs, edge_chains, find_lattices, fit_sides, four_cornered,
        four_sided,
    };
}
