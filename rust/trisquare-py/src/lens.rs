//! A camera's maps, for arrays of points.

use nalgebra::Vector2;
use numpy::{
    PyArray2, PyArray3, PyReadonlyArray2, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{Brown, Error, ImageSize, Lens, ProjectionUncertainty, UndistortionMap};

use crate::arrays;
use crate::errors::{detached, exception};

/// The largest ideal radius up to which a distortion is monotonic and invertible.
#[pyfunction]
#[pyo3(signature = (k1, k2, p1, p2, k3))]
pub fn invertible_radius(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> f64 {
    trisquare::internals::invertible_radius([k1, k2, k3], [p1, p2])
}

/// A camera as Python hands it over: its nine parameters, and the radius it is trusted up to.
#[derive(FromPyObject)]
pub struct CameraMembers([f64; 9], f64);

impl CameraMembers {
    fn camera(&self) -> Brown {
        Brown::new(self.0).within(self.1)
    }
}

/// The distance from the principal point within which every pixel can be undistorted.
#[pyfunction]
#[pyo3(signature = (camera))]
pub fn valid_pixel_radius(camera: CameraMembers) -> f64 {
    camera.camera().valid_pixel_radius()
}

/// The pixels at which points of camera coordinates are seen.
#[pyfunction]
#[pyo3(signature = (camera, points))]
pub fn project_points<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (camera, points) = (camera.camera(), arrays::space_points(&points)?);
    let seen = detached(py, || camera.project_points(&points))?.map_err(exception)?;
    Ok(arrays::from_points(py, &seen))
}

/// The unit rays along which pixels look.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn unproject_pixels<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (camera, pixels) = (camera.camera(), arrays::points(&pixels)?);
    let rays = detached(py, || camera.unproject_pixels(&pixels))?.map_err(exception)?;
    Ok(arrays::from_space_points(py, &rays))
}

/// Where the lens moves the pixels of a pinhole.
#[pyfunction]
#[pyo3(signature = (camera, ideal))]
pub fn distort_pixels<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    ideal: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped(py, &camera, &ideal, Brown::distort_pixels)
}

/// Where a pinhole would have seen what pixels show.
#[pyfunction]
#[pyo3(signature = (camera, observed))]
pub fn undistort_pixels<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    observed: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped(py, &camera, &observed, Brown::undistort_pixels)
}

type PixelMap = fn(&Brown, &[Vector2<f64>]) -> Result<Vec<Vector2<f64>>, Error>;

fn mapped<'py>(
    py: Python<'py>,
    camera: &CameraMembers,
    pixels: &PyReadonlyArray2<'py, f64>,
    map: PixelMap,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (camera, pixels) = (camera.camera(), arrays::points(pixels)?);
    let found = detached(py, || map(&camera, &pixels))?.map_err(exception)?;
    Ok(arrays::from_points(py, &found))
}

/// `fx, fy, cx, cy` of the pinhole that sees a camera's pictures undistorted.
#[pyfunction]
#[pyo3(signature = (camera, image_size, balance))]
pub fn undistorted_view(
    py: Python<'_>,
    camera: CameraMembers,
    image_size: (u32, u32),
    balance: f64,
) -> PyResult<(f64, f64, f64, f64)> {
    let camera = camera.camera();
    let view =
        detached(py, || camera.undistorted(size(image_size), balance))?.map_err(exception)?;
    let (focal, centre) = (view.focal(), view.principal_point());
    Ok((focal.x, focal.y, centre.x, centre.y))
}

/// Fills the map of where a pinhole's pixels lie in a camera's picture.
#[pyfunction]
#[pyo3(signature = (camera, image_size, view, whole, parts, valid))]
pub fn fill_undistortion_map(
    py: Python<'_>,
    camera: CameraMembers,
    image_size: (u32, u32),
    view: CameraMembers,
    mut whole: PyReadwriteArray3<'_, i16>,
    mut parts: PyReadwriteArray2<'_, u16>,
    mut valid: PyReadwriteArray2<'_, bool>,
) -> PyResult<()> {
    let (camera, view) = (camera.camera(), view.camera());
    let (height, width) = (valid.shape()[0] as u32, valid.shape()[1] as u32);
    let mut map = UndistortionMap {
        whole: whole.as_slice_mut()?,
        parts: parts.as_slice_mut()?,
        valid: valid.as_slice_mut()?,
    };
    detached(py, || {
        map.fill(&camera, size(image_size), &view, size((width, height)))
    })?
    .map_err(exception)
}

/// `(x, y, width, height)` of the largest rectangle in which a mask is set everywhere.
#[pyfunction]
#[pyo3(signature = (mask))]
pub fn largest_rectangle(
    py: Python<'_>,
    mask: PyReadonlyArray2<'_, bool>,
) -> PyResult<(usize, usize, usize, usize)> {
    let width = mask.shape()[1];
    let mask = mask
        .as_slice()
        .map_err(|_| PyValueError::new_err("the mask must be contiguous"))?;
    let [x, y, width, height] =
        detached(py, || trisquare::internals::largest_rectangle(mask, width))?;
    Ok((x, y, width, height))
}

fn size((width, height): (u32, u32)) -> ImageSize {
    ImageSize { width, height }
}

/// Which of the pixels the lens model can follow back.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn can_unproject(
    py: Python<'_>,
    camera: CameraMembers,
    pixels: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<bool>> {
    let (camera, pixels) = (camera.camera(), arrays::points(&pixels)?);
    detached(py, || {
        pixels
            .iter()
            .map(|p| camera.unproject_with_jacobian(p).is_some())
            .collect()
    })
}

/// Covariance, in pixels, of the projections of the directions seen at pixels.
#[pyfunction]
#[pyo3(signature = (camera, parameters, aspect_fixed, covariance, pixels))]
pub fn projection_covariance<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    parameters: Vec<String>,
    aspect_fixed: bool,
    covariance: PyReadonlyArray2<'py, f64>,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let camera = camera.camera();
    let covariance = arrays::matrix(&covariance);
    let pixels = arrays::points(&pixels)?;
    let names: Vec<&str> = parameters.iter().map(String::as_str).collect();
    let found = detached(py, || {
        let uncertainty = ProjectionUncertainty::new(&camera, &names, aspect_fixed, covariance)?;
        uncertainty.at_pixels(&pixels)
    })?
    .map_err(exception)?;
    Ok(arrays::from_matrices(py, &found))
}

/// Derivatives, by all nine parameters, of the projections of the directions seen at pixels.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn projection_jacobian<'py>(
    py: Python<'py>,
    camera: CameraMembers,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (camera, pixels) = (camera.camera(), arrays::points(&pixels)?);
    let found = detached(py, || camera.projection_jacobians(&pixels))?.map_err(exception)?;
    Ok(arrays::from_matrices(py, &found))
}
