//! Python bindings of trisquare: check, copy, detach from the GIL, call, convert.

mod any_lens;
mod arrays;
mod calibration;
mod errors;
mod image;
mod lens;
mod linear;
mod observations;
mod planning;
mod search;

/// The compiled core of trisquare.
#[pyo3::pymodule]
pub mod _core {
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // its name in Python
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::calibration::{
        FigureResiduals, Outcome, ResidualCorrelation, Solution, SolutionWarning, SolvedPlane,
        ToneFit, Verdict, calibrate,
    };
    #[pymodule_export]
    use crate::errors::provoke_panic;
    #[pymodule_export]
    use crate::image::{KeptPixels, Picture, PictureFaults, SideSamples, ToneEstimate, localise};
    #[pymodule_export]
    use crate::lens::{
        angle_between_planes, can_project, can_unproject, compare_projections, distort_pixels,
        fill_undistortion_map, is_covariance, largest_rectangle, nearest_lens, points_on_plane,
        points_on_plane_with_covariance, project_points, projection_covariance, undistort_pixels,
        undistorted_view, unproject_pixels, valid_pixel_radius, valid_radius, view_directions,
        view_pixels,
    };
    #[pymodule_export]
    use crate::linear::{
        camera_matrix_from_homographies, fit_distortion, homography_from_lines,
        pose_from_homography, straighten,
    };
    #[pymodule_export]
    use crate::observations::{family_lines, rectangle_lines, remove_edge_shift};
    #[pymodule_export]
    use crate::planning::{Prediction, predict};
    #[pymodule_export]
    use crate::search::{
        Lattice, find_arcs, find_four_cornered, find_four_sided, find_lattices, fit_sides,
    };
}
