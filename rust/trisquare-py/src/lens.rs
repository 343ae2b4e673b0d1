//! A camera's maps of arrays of points.

use nalgebra::{Matrix6xX, Vector2, Vector3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyReadonlyArray2, PyReadwriteArray2, PyReadwriteArray3,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use trisquare::{
    Distortion, DistortionTerm, ImageSize, Lens, LensFamily, PictureView, PointMaps, Pose,
    PoseUncertainty, ProjectionUncertainty, Surface, UndistortedView, UndistortionMap,
};

use crate::any_lens::{CameraMembers, with_lens};
use crate::arrays;
use crate::calibration::named;
use crate::errors::{computed, detached};

/// Copies points, and maps them with a lens of any family, without the GIL.
macro_rules! mapped {
    ($camera:expr, $points:expr, |$lens:ident, $copied:ident| $map:expr) => {{
        let py = $points.py();
        let (lens, $copied) = ($camera.lens(py)?, arrays::points(&$points)?);
        let found = with_lens!(lens, |$lens| computed(py, || $map)?);
        Ok(arrays::from_points(py, &found))
    }};
}

pub(crate) fn size((width, height): (u32, u32)) -> ImageSize {
    ImageSize { width, height }
}

/// The valid radius of a camera: that of its lens, or the given one if that is smaller.
#[pyfunction]
#[pyo3(signature = (camera))]
pub fn valid_radius(py: Python<'_>, camera: CameraMembers) -> PyResult<f64> {
    with_lens!(camera.lens(py)?, |lens| Ok(lens.valid_radius()))
}

/// The distance from the principal point within which every pixel can be undistorted.
#[pyfunction]
#[pyo3(signature = (camera))]
pub fn valid_pixel_radius(py: Python<'_>, camera: CameraMembers) -> PyResult<f64> {
    with_lens!(camera.lens(py)?, |lens| {
        detached(py, || lens.valid_pixel_radius())
    })
}

/// The pixels of points in camera coordinates.
#[pyfunction]
#[pyo3(signature = (camera, points))]
pub fn project_points<'py>(
    camera: CameraMembers,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped!(camera, points, |lens, points| lens.project_points(&points))
}

/// The unit rays of pixels.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn unproject_pixels<'py>(
    camera: CameraMembers,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped!(camera, pixels, |lens, pixels| lens
        .unproject_pixels(&pixels))
}

/// The distorted pixels of a pinhole's pixels.
#[pyfunction]
#[pyo3(signature = (camera, ideal))]
pub fn distort_pixels<'py>(
    camera: CameraMembers,
    ideal: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped!(camera, ideal, |lens, ideal| lens.distort_pixels(&ideal))
}

/// A pinhole's pixels of observed ones.
#[pyfunction]
#[pyo3(signature = (camera, observed))]
pub fn undistort_pixels<'py>(
    camera: CameraMembers,
    observed: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    mapped!(camera, observed, |lens, observed| lens
        .undistort_pixels(&observed))
}

/// `fx, fy, cx, cy` of the pinhole of a camera's undistorted pictures.
#[pyfunction]
#[pyo3(signature = (camera, image_size, balance))]
pub fn undistorted_view(
    py: Python<'_>,
    camera: CameraMembers,
    image_size: (u32, u32),
    balance: f64,
) -> PyResult<(f64, f64, f64, f64)> {
    let view = with_lens!(camera.lens(py)?, |lens| computed(py, || lens
        .undistorted(size(image_size), balance)))?;
    Ok(view.intrinsics().into())
}

/// A view of an undistorted picture: its surface, focal lengths and centre.
type ViewMembers<'a> = (&'a str, f64, f64, f64, f64);

const SURFACES: [(&str, Surface); 3] = [
    ("pinhole", Surface::Plane),
    ("cylinder", Surface::Cylinder),
    ("equirectangular", Surface::Sphere),
];

fn picture_view((surface, fx, fy, cx, cy): ViewMembers<'_>) -> PyResult<PictureView> {
    Ok(PictureView {
        surface: named(surface, "projection", &SURFACES)?,
        focal: Vector2::new(fx, fy),
        centre: Vector2::new(cx, cy),
    })
}

/// The directions (N, 3) of a view's pixels, not normalised.
#[pyfunction]
#[pyo3(signature = (view, pixels))]
pub fn view_directions<'py>(
    py: Python<'py>,
    view: ViewMembers<'_>,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (view, pixels) = (picture_view(view)?, arrays::points::<2>(&pixels)?);
    let found: Vec<_> = pixels.iter().map(|pixel| view.direction(pixel)).collect();
    Ok(arrays::from_points(py, &found))
}

/// The pixels (N, 2) of directions in a view; NaN if a direction has none.
#[pyfunction]
#[pyo3(signature = (view, directions))]
pub fn view_pixels<'py>(
    py: Python<'py>,
    view: ViewMembers<'_>,
    directions: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (view, directions) = (picture_view(view)?, arrays::points::<3>(&directions)?);
    let nowhere = Vector2::repeat(f64::NAN);
    let found = directions
        .iter()
        .map(|direction| view.pixel(direction).unwrap_or(nowhere));
    Ok(arrays::from_points(py, &found.collect::<Vec<_>>()))
}

/// Fills the map from a view's pixels to those of a camera's picture.
#[pyfunction]
#[pyo3(signature = (camera, image_size, view, whole, parts, valid))]
pub fn fill_undistortion_map(
    py: Python<'_>,
    camera: CameraMembers,
    image_size: (u32, u32),
    view: ViewMembers<'_>,
    mut whole: PyReadwriteArray3<'_, i16>,
    mut parts: PyReadwriteArray2<'_, u16>,
    mut valid: PyReadwriteArray2<'_, bool>,
) -> PyResult<()> {
    let view = picture_view(view)?;
    let camera = camera.lens(py)?;
    let view_size = size((valid.shape()[1] as u32, valid.shape()[0] as u32));
    let mut map = UndistortionMap {
        whole: whole.as_slice_mut()?,
        parts: parts.as_slice_mut()?,
        valid: valid.as_slice_mut()?,
    };
    with_lens!(camera, |lens| computed(py, || map.fill_view(
        &lens,
        size(image_size),
        &view,
        view_size
    )))
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
    let found = detached(py, || trisquare::internals::largest_rectangle(mask, width))?;
    Ok(found.into())
}

/// Whether points in camera coordinates are seen by a camera, inside or outside the picture.
#[pyfunction]
#[pyo3(signature = (camera, points))]
pub fn can_project(
    py: Python<'_>,
    camera: CameraMembers,
    points: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<bool>> {
    let (camera, points) = (camera.lens(py)?, arrays::points(&points)?);
    with_lens!(camera, |lens| detached(py, || {
        points.iter().map(|p| lens.project(p).is_some()).collect()
    }))
}

/// Whether pixels can be unprojected by the lens model.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn can_unproject(
    py: Python<'_>,
    camera: CameraMembers,
    pixels: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<bool>> {
    let (camera, pixels) = (camera.lens(py)?, arrays::points(&pixels)?);
    with_lens!(camera, |lens| detached(py, || {
        let can = |p| lens.unproject_with_jacobian(p).is_some();
        pixels.iter().map(can).collect()
    }))
}

/// A camera, its free parameters, whether `fy` follows `fx`, and the parameters' covariance.
type UncertainMembers<'py> = (CameraMembers, Vec<String>, bool, PyReadonlyArray2<'py, f64>);

fn parameter_count<L: Lens>(_: &L) -> usize {
    L::parameter_names().len()
}

fn uncertain<'a, L: Lens>(
    py: Python<'_>,
    lens: &'a L,
    (_, parameters, aspect_fixed, covariance): &UncertainMembers<'_>,
) -> PyResult<ProjectionUncertainty<'a, L>> {
    let names: Vec<&str> = parameters.iter().map(String::as_str).collect();
    let covariance = arrays::matrix(covariance);
    computed(py, || {
        ProjectionUncertainty::new(lens, &names, *aspect_fixed, covariance)
    })
}

/// Whether a matrix is symmetric and positive semidefinite, to rounding.
#[pyfunction]
pub fn is_covariance(matrix: PyReadonlyArray2<'_, f64>) -> bool {
    trisquare::internals::is_covariance(&arrays::matrix(&matrix))
}

/// Covariance, in pixels, of the projections of the directions seen at pixels.
#[pyfunction]
#[pyo3(signature = (camera, pixels))]
pub fn projection_covariance<'py>(
    py: Python<'py>,
    camera: UncertainMembers<'py>,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let pixels = arrays::points(&pixels)?;
    let found = with_lens!(camera.0.lens(py)?, |lens| {
        let camera = uncertain(py, &lens, &camera)?;
        computed(py, || camera.at_pixels(&pixels))?
    });
    Ok(arrays::from_matrices(py, &found))
}

/// Standard deviations, p-value, degrees of freedom, unexplained rms.
type TestMembers<'py> = (Bound<'py, PyArray1<f64>>, f64, usize, f64);
/// Rotation, differences (infinite where undefined), test.
type DifferenceMembers<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Option<TestMembers<'py>>,
);

/// Differences between the projections of two cameras over pixels, after the best rotation.
#[pyfunction]
#[pyo3(signature = (first, second, pixels))]
pub fn compare_projections<'py>(
    py: Python<'py>,
    first: UncertainMembers<'py>,
    second: UncertainMembers<'py>,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<DifferenceMembers<'py>> {
    let pixels = arrays::points(&pixels)?;
    let found = with_lens!(first.0.lens(py)?, |first_lens| {
        with_lens!(second.0.lens(py)?, |second_lens| {
            let first = uncertain(py, &first_lens, &first)?;
            let second = uncertain(py, &second_lens, &second)?;
            computed(py, || {
                trisquare::compare_projections(&first, &second, &pixels)
            })?
        })
    });
    let nowhere = Vector2::repeat(f64::INFINITY);
    let differences = found.differences.iter().map(|d| d.unwrap_or(nowhere));
    let test = found.test.map(|test| {
        let std = test.std.iter().map(|std| std.unwrap_or(f64::INFINITY));
        let std: Vec<_> = std.collect();
        (
            arrays::from_slice(py, &std),
            test.p_value,
            test.degrees_of_freedom,
            test.unexplained,
        )
    });
    Ok((
        arrays::from_matrix(py, &found.rotation),
        arrays::from_points(py, &differences.collect::<Vec<_>>()),
        test,
    ))
}

/// Rotation, translation.
type PoseMembers<'py> = (PyReadonlyArray2<'py, f64>, [f64; 3]);

fn pose((rotation, translation): &PoseMembers<'_>) -> PyResult<Pose> {
    Ok(Pose {
        rotation: arrays::sized_matrix(rotation)?,
        translation: Vector3::from(*translation),
    })
}

/// The points of a plane seen at pixels.
#[pyfunction]
#[pyo3(signature = (camera, pose, pixels))]
pub fn points_on_plane<'py>(
    camera: CameraMembers,
    pose: PoseMembers<'py>,
    pixels: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let pose = self::pose(&pose)?;
    mapped!(camera, pixels, |lens, pixels| {
        trisquare::points_on_plane(&lens, &pose, &pixels)
    })
}

/// Points, shape (N, 2), and their covariance, (2 N, 2 N).
type CertainPoints<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// The covariance of a pose given the camera, and its derivative by the camera.
type PoseUncertaintyMembers<'py> = (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>);

/// Uncertainty of a pose seen by a lens of so many parameters. The last one is the skew; results
/// without a skew omit the derivatives by it.
fn pose_uncertainty(
    (given_camera, by_camera): &PoseUncertaintyMembers<'_>,
    parameters: usize,
) -> PyResult<PoseUncertainty> {
    let mut by_camera: Matrix6xX<f64> = arrays::columns(by_camera)?;
    let columns = by_camera.ncols();
    if columns + 1 == parameters {
        by_camera = by_camera.insert_column(columns, 0.0);
    }
    Ok(PoseUncertainty {
        given_camera: arrays::sized_matrix(given_camera)?,
        by_camera,
    })
}

/// The angle between two planes of one picture, and its standard deviation, radians.
#[pyfunction]
#[pyo3(signature = (camera, rotations, uncertainties))]
pub fn angle_between_planes<'py>(
    py: Python<'py>,
    camera: UncertainMembers<'py>,
    rotations: [PyReadonlyArray2<'py, f64>; 2],
    uncertainties: [PoseUncertaintyMembers<'py>; 2],
) -> PyResult<(f64, f64)> {
    let pose = |rotation| -> PyResult<Pose> {
        Ok(Pose {
            rotation: arrays::sized_matrix(rotation)?,
            translation: Vector3::zeros(),
        })
    };
    let [first_pose, second_pose] = [pose(&rotations[0])?, pose(&rotations[1])?];
    with_lens!(camera.0.lens(py)?, |lens| {
        let count = parameter_count(&lens);
        let [first, second] = &uncertainties;
        let uncertainties = [
            pose_uncertainty(first, count)?,
            pose_uncertainty(second, count)?,
        ];
        let camera = uncertain(py, &lens, &camera)?;
        let planes = [
            (&first_pose, &uncertainties[0]),
            (&second_pose, &uncertainties[1]),
        ];
        computed(py, || camera.angle_between(planes))
    })
}

/// The points of a plane seen at pixels, and their covariance.
#[pyfunction]
#[pyo3(signature = (camera, pose, uncertainty, pixels, pixel_std))]
pub fn points_on_plane_with_covariance<'py>(
    py: Python<'py>,
    camera: UncertainMembers<'py>,
    pose: PoseMembers<'py>,
    uncertainty: PoseUncertaintyMembers<'py>,
    pixels: PyReadonlyArray2<'py, f64>,
    pixel_std: f64,
) -> PyResult<CertainPoints<'py>> {
    let pose = self::pose(&pose)?;
    let pixels = arrays::points(&pixels)?;
    let (points, covariance) = with_lens!(camera.0.lens(py)?, |lens| {
        let uncertainty = pose_uncertainty(&uncertainty, parameter_count(&lens))?;
        let camera = uncertain(py, &lens, &camera)?;
        computed(py, || {
            camera.points_on_plane(&pose, &uncertainty, &pixels, pixel_std)
        })?
    });
    Ok((
        arrays::from_points(py, &points),
        arrays::from_matrix(py, &covariance),
    ))
}

/// A camera, or a lens of another program.
#[derive(FromPyObject)]
pub enum LensMembers {
    Camera(CameraMembers),
    Other(OtherMembers),
}

/// `fx, fy, cx, cy`, the name of a distortion's model, and its coefficients.
#[derive(FromPyObject)]
pub struct OtherMembers([f64; 4], String, Vec<f64>);

/// `fx, fy, cx, cy`, coefficients, rms and maximum distance, fraction of the picture covered.
type NearestMembers = ((f64, f64, f64, f64), Vec<f64>, f64, f64, f64);

/// The lens with given terms that is nearest to another one over its picture.
#[pyfunction]
#[pyo3(signature = (lens, image_size, name, square_pixels, terms))]
pub fn nearest_lens(
    py: Python<'_>,
    lens: LensMembers,
    image_size: (u32, u32),
    name: String,
    square_pixels: bool,
    terms: &str,
) -> PyResult<NearestMembers> {
    let size = size(image_size);
    let terms = computed(py, || DistortionTerm::of_names(terms))?;
    let family = LensFamily {
        name,
        square_pixels,
        terms,
    };
    let found = match lens {
        LensMembers::Camera(camera) => {
            with_lens!(camera.lens(py)?, |lens| {
                let (focal, centre) = (lens.focal(), lens.principal_point());
                computed(py, || {
                    family.nearest(size, focal, centre, |pixel| lens.ideal_point(pixel))
                })?
            })
        }
        LensMembers::Other(OtherMembers([fx, fy, cx, cy], model, coefficients)) => {
            let (focal, centre) = (Vector2::new(fx, fy), Vector2::new(cx, cy));
            computed(py, || {
                let distortion = Distortion::of_model(&model, &coefficients)?;
                family.nearest(size, focal, centre, |pixel| {
                    distortion.undistort(&(pixel - centre).component_div(&focal))
                })
            })?
        }
    };
    let (focal, centre) = (found.focal, found.centre);
    Ok((
        (focal.x, focal.y, centre.x, centre.y),
        found.coefficients,
        found.rms,
        found.worst,
        found.covered,
    ))
}
