//! Python bindings of trisquare: check, copy, detach from the GIL, call, convert.

mod arrays;
mod calibration;
mod camera;
mod crossings;
mod errors;
mod figures;
mod picture;
mod predict;
mod saddles;
mod sides;
mod steps;
mod surface;

/// The compiled core of trisquare.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    #[allow(non_upper_case_globals)] // Python's name for it
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::calibration::{calibrate, choose};
    #[pymodule_export]
    use crate::camera::{
        can_unproject, distort_pixels, fill_undistortion_map, invertible_radius, largest_rectangle,
        project_points, projection_covariance, projection_jacobian, undistort_pixels,
        undistorted_view, unproject_pixels, valid_pixel_radius,
    };
    #[pymodule_export]
    use crate::crossings::{grow_lattice, link_crossings};
    #[pymodule_export]
    use crate::errors::provoke_panic;
    #[pymodule_export]
    use crate::figures::square_lines;
    #[pymodule_export]
    use crate::picture::{Picture, localise};
    #[pymodule_export]
    use crate::predict::predict;
    #[pymodule_export]
    use crate::saddles::{saddle_steps, settle_on_saddles};
    #[pymodule_export]
    use crate::sides::fit_side_cubics;
    #[pymodule_export]
    use crate::steps::{
        camera_matrix_from_homographies, fit_distortion, homography_from_lines,
        pose_from_homography, straighten,
    };
    #[pymodule_export]
    use crate::surface::{fit_lattice_surface, lattice_surface_points, lattice_surface_sites};
}
