//! The steps of the linear method, one by one, and the lens.

use nalgebra::{Matrix3, Vector3};
use trisquare::internals::monotonic_radius;
use trisquare::{Lens, Line, Pose, camera_matrix_from_homographies, homography_from_lines};

use crate::bytes::Bytes;
use crate::coordinates::{SCENES, SIZE};
use crate::figures::{View, damage};
use crate::{Outcome, check};

/// Tolerance on unit vectors and norms.
const ROUNDING: f64 = 1e-9;

/// Tolerance on a pixel after unprojection and projection, relative to its distance from the
/// origin.
const ROUND_TRIP: f64 = 1e-12;

/// Distance from the origin, in pixels, beyond which no camera has a pixel.
const FAR: f64 = 1e9;

/// `trisquare::fit_distortion`, and straightening with its result.
pub fn fit_distortion(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let coefficients = bytes.pick(&[1, 2, 2, 3, 0, 1, 2, 4]);
    let centre = bytes.once_in(2).then(|| bytes.point(SIZE));
    let curves: Vec<_> = if bytes.once_in(3) {
        (0..bytes.below(6))
            .map(|_| bytes.points(SIZE, 12))
            .collect()
    } else {
        let mut figures = View::sound(bytes, &SCENES).figures(bytes);
        damage(&mut figures, SIZE, bytes);
        figures.into_iter().flat_map(|f| f.points).collect()
    };
    match trisquare::fit_distortion(&curves, SIZE, coefficients, centre) {
        Ok(found) => {
            assert!(found.coefficients.iter().all(|v| v.is_finite()));
            assert!(found.centre.iter().all(|v| v.is_finite()));
            assert!(found.rms.is_finite() && found.radius > 0.0);
            if let Some(ideal) = found.undistort(&bytes.point(SIZE)) {
                assert!(ideal.iter().all(|v| v.is_finite()));
            }
            "Ok"
        }
        Err(error) => check::refusal(&error),
    }
}

/// `homography_from_lines`, `camera_matrix_from_homographies` and `Pose::from_homography`.
pub fn linear_steps(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let count = bytes.below(5);
    let homographies: Vec<Matrix3<f64>> = (0..count).filter_map(|_| homography(bytes)).collect();
    let camera = camera_matrix_from_homographies(&homographies);
    let camera = match camera {
        Ok(found) => {
            assert!(found.iter().all(|v| v.is_finite()), "{found}");
            assert!(found[(0, 0)] > 0.0 && found[(1, 1)] > 0.0, "{found}");
            Some(found).filter(|_| !bytes.once_in(4))
        }
        Err(error) => {
            check::refusal(&error);
            None
        }
    };
    let outcome = ["Ok, any camera matrix", "Ok"][usize::from(camera.is_some())];
    let camera = camera.unwrap_or_else(|| bytes.matrix());
    let first = homographies.first().copied();
    let plane = first.unwrap_or_else(|| bytes.matrix());
    match Pose::from_homography(&camera, &plane, &bytes.point(SIZE)) {
        Ok(found) => {
            check::pose(&found);
            assert!(found.translation.norm() > 0.0);
            outcome
        }
        Err(error) => check::refusal(&error),
    }
}

/// Returns a homography from lines, mostly of a plane that a camera sees; at times any matrix.
fn homography(bytes: &mut Bytes<'_>) -> Option<Matrix3<f64>> {
    if bytes.once_in(8) {
        let mut any = bytes.matrix();
        if bytes.once_in(2) {
            // Rank two at most: that of a plane through the camera's centre, or of no plane.
            let number = bytes.below(3);
            let (a, b) = (any.column((number + 1) % 3), any.column((number + 2) % 3));
            let combined = a * bytes.coefficient() + b * bytes.coefficient();
            any.set_column(number, &combined);
        }
        return Some(any);
    }
    let mut plane = bytes.lines(7);
    let truth = bytes.matrix();
    if bytes.once_in(2) {
        plane.extend(
            [(1.0, 0.0), (0.0, 1.0)].iter().flat_map(|(a, b)| {
                [-0.5, 0.5].map(|c| Line::new(*a, *b, c).expect("a unit normal"))
            }),
        );
    }
    let mut image = bytes.lines(7);
    if !bytes.once_in(4) {
        image.clear();
        let back = truth.try_inverse()?.transpose();
        for line in &plane {
            let seen = back * line.coefficients();
            image.push(Line::new(seen.x, seen.y, seen.z).ok()?);
        }
    }
    match homography_from_lines(&plane, &image) {
        Ok(found) => {
            assert!((found.norm() - 1.0).abs() < ROUNDING, "{found}");
            Some(found)
        }
        Err(error) => {
            check::refusal(&error);
            None
        }
    }
}

/// A lens with arbitrary parameters: projection, unprojection and the valid radius.
pub fn lens(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let sound = bytes.once_in(2);
    let lens = if sound {
        View::sound(bytes, &SCENES).camera
    } else {
        bytes.camera(SIZE)
    };
    let reach = monotonic_radius(std::array::from_fn(|_| bytes.coefficient()));
    assert!(reach >= 0.0, "{reach}"); // false for NaN
    assert!(!lens.valid_radius().is_nan());
    let space = Vector3::from_fn(|_, _| bytes.coefficient());
    if let Some(seen) = lens.project(&space) {
        assert!(seen.iter().all(|v| v.is_finite()), "{seen} of {space}");
    }
    let mut pixel = bytes.point(SIZE);
    if lens.valid_radius().is_finite() && bytes.once_in(2) {
        // Just inside the valid radius, where the distortion is steep or almost flat.
        let (sin, cos) = bytes.between(0.0, 6.3).sin_cos();
        let radius = lens.valid_radius() * (1.0 - bytes.power(-12.0, 0.0));
        pixel = lens
            .project(&Vector3::new(radius * cos, radius * sin, 1.0))
            .unwrap_or(pixel);
    }
    let Some(ray) = lens.unproject(&pixel) else {
        return "beyond the valid radius";
    };
    assert!((ray.norm() - 1.0).abs() < ROUNDING, "{ray}");
    // Farther out, squares of pixel coordinates overflow in the projection.
    if sound && pixel.norm() < FAR {
        let again = lens.project(&ray).expect("what is sighted is seen");
        let tolerance = ROUND_TRIP * (1.0 + pixel.norm());
        assert!((again - pixel).norm() < tolerance, "{again} of {pixel}");
    }
    "Ok"
}
