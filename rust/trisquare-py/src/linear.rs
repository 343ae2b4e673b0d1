//! The paper's steps, separately.

use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Pose, Straightening};

use crate::arrays;
use crate::errors::{computed, detached};
use crate::lens::size;

/// Coefficients, centre, radius unit, rms.
type StraighteningMembers<'py> = (Bound<'py, PyArray1<f64>>, (f64, f64), f64, f64);
/// Rotation, translation.
type PoseMembers<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Coefficients, centre, radius unit and rms of the straightening that makes all curves straight.
#[pyfunction]
#[pyo3(signature = (curves, image_size, coefficients, centre))]
pub fn fit_distortion<'py>(
    py: Python<'py>,
    curves: Vec<PyReadonlyArray2<'py, f64>>,
    image_size: (u32, u32),
    coefficients: usize,
    centre: Option<(f64, f64)>,
) -> PyResult<StraighteningMembers<'py>> {
    let curves: Vec<_> = curves.iter().map(arrays::points).collect::<PyResult<_>>()?;
    let centre = centre.map(|(x, y)| Vector2::new(x, y));
    let found = computed(py, || {
        trisquare::fit_distortion(&curves, size(image_size), coefficients, centre)
    })?;
    Ok((
        arrays::from_slice(py, &found.coefficients),
        (found.centre.x, found.centre.y),
        found.radius,
        found.rms,
    ))
}

/// Maps observed pixels to their ideal positions.
#[pyfunction]
#[pyo3(signature = (points, coefficients, centre, radius))]
pub fn straighten<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    coefficients: Vec<f64>,
    centre: (f64, f64),
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let straightening = Straightening {
        coefficients,
        centre: Vector2::new(centre.0, centre.1),
        radius,
        rms: 0.0,
    };
    let points = arrays::points(&points)?;
    let ideal: Option<Vec<_>> = detached(py, || {
        points.iter().map(|p| straightening.undistort(p)).collect()
    })?;
    let ideal = ideal.ok_or_else(|| {
        PyValueError::new_err("a point lies beyond the radius up to which the map is invertible")
    })?;
    Ok(arrays::from_points(py, &ideal))
}

/// The homography `H_image_from_plane` of line correspondences.
#[pyfunction]
#[pyo3(signature = (plane_lines, image_lines))]
pub fn homography_from_lines<'py>(
    py: Python<'py>,
    plane_lines: PyReadonlyArray2<'py, f64>,
    image_lines: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (plane, image) = (arrays::lines(&plane_lines)?, arrays::lines(&image_lines)?);
    let found = computed(py, || trisquare::homography_from_lines(&plane, &image))?;
    Ok(arrays::from_matrix(py, &found))
}

/// The camera matrix from homographies, by the image of the absolute conic.
#[pyfunction]
#[pyo3(signature = (homographies))]
pub fn camera_matrix_from_homographies<'py>(
    py: Python<'py>,
    homographies: Vec<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let homographies: Vec<_> = homographies
        .iter()
        .map(arrays::sized_matrix)
        .collect::<PyResult<_>>()?;
    let found = computed(py, || {
        trisquare::camera_matrix_from_homographies(&homographies)
    })?;
    Ok(arrays::from_matrix(py, &found))
}

/// Rotation and translation of a plane from its homography.
#[pyfunction]
#[pyo3(signature = (camera_matrix, homography))]
pub fn pose_from_homography<'py>(
    py: Python<'py>,
    camera_matrix: PyReadonlyArray2<'py, f64>,
    homography: PyReadonlyArray2<'py, f64>,
) -> PyResult<PoseMembers<'py>> {
    let camera_matrix = arrays::sized_matrix(&camera_matrix)?;
    let homography = arrays::sized_matrix(&homography)?;
    let pose = computed(py, || {
        Pose::from_homography(&camera_matrix, &homography, &Vector2::zeros())
    })?;
    Ok((
        arrays::from_matrix(py, &pose.rotation),
        arrays::from_slice(py, pose.translation.as_slice()),
    ))
}
