//! For any coordinates: no panic, and no result that is not finite.

use nalgebra::{Matrix3, Vector2, Vector3};
use proptest::array::uniform9;
use proptest::collection::vec;
use proptest::num::f64::ANY;
use proptest::prelude::*;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Brown, BrownModel, Calibration, Fixed, ImageSize, Lens, Line, Method, Options, PlaneEdges,
    Pose, calibrate, camera_matrix_from_homographies, fit_distortion, homography_from_lines,
};

const SIZE: ImageSize = ImageSize {
    width: 1280,
    height: 960,
};
/// Magnitude far outside every picture, but small enough that squares do not overflow.
const LARGE: f64 = 1e6;

/// Mostly pixels, some of them equal; at times far outside, tiny, infinite or NaN.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => 0.0..1280.0,
        3 => (0..4).prop_map(f64::from),
        2 => -LARGE..LARGE,
        1 => ANY,
    ]
}

/// Mostly small numbers; at times any number.
fn coefficient() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -2.0..2.0,
        2 => Just(0.0),
        1 => ANY,
    ]
}

fn point() -> impl Strategy<Value = Vector2<f64>> {
    [coordinate(), coordinate()].prop_map(Vector2::from)
}

fn space_point() -> impl Strategy<Value = Vector3<f64>> {
    [coefficient(), coefficient(), coefficient()].prop_map(Vector3::from)
}

fn lines(count: impl Into<proptest::collection::SizeRange>) -> impl Strategy<Value = Vec<Line>> {
    vec([coefficient(), coefficient(), coefficient()], count).prop_map(|all| {
        let line = |[a, b, c]: &[f64; 3]| Line::new(*a, *b, *c).ok();
        all.iter().filter_map(line).collect()
    })
}

fn matrix() -> impl Strategy<Value = Matrix3<f64>> {
    uniform9(coefficient()).prop_map(|values| Matrix3::from_row_slice(&values))
}

fn lens() -> impl Strategy<Value = Brown> {
    uniform9(coefficient()).prop_map(|values| {
        let scale = [1000.0, 1000.0, 640.0, 480.0, 1.0, 1.0, 1.0, 0.1, 0.1];
        Brown::new(std::array::from_fn(|i| values[i] * scale[i]))
    })
}

fn options() -> impl Strategy<Value = Options> {
    let method = prop_oneof![Just(Method::MaximumLikelihood), Just(Method::Linear)];
    let model = prop_oneof![
        Just(BrownModel::None),
        Just(BrownModel::Radial1),
        Just(BrownModel::Radial2),
        Just(BrownModel::Radial3),
        Just(BrownModel::Brown),
    ];
    let fixed =
        any::<[bool; 5]>().prop_map(|[aspect, principal_point, focal, distortion, skew]| Fixed {
            aspect,
            principal_point,
            focal,
            distortion,
            skew,
        });
    let initial = proptest::option::of(lens());
    (method, model, fixed, initial).prop_map(|(method, model, fixed, initial)| Options {
        method,
        model,
        fixed,
        initial,
    })
}

fn assert_finite(found: &Calibration) {
    assert!(found.camera.parameters().iter().all(|v| v.is_finite()));
    assert!(found.covariance.iter().all(|v| v.is_finite()));
    assert!(found.std().iter().all(|(_, v)| v.is_finite() && *v >= 0.0));
    assert!(found.rms.is_finite() && found.noise_scale.is_finite());
    for plane in &found.planes {
        assert_finite_pose(&plane.pose);
        assert!(
            plane
                .corners
                .iter()
                .all(|c| c.iter().all(|v| v.is_finite()))
        );
    }
}

fn assert_finite_pose(pose: &Pose) {
    assert!(pose.translation.iter().all(|v| v.is_finite()), "{pose:?}");
    let identity = pose.rotation * pose.rotation.transpose();
    assert!((identity - Matrix3::identity()).norm() < 1e-9, "{pose:?}");
    assert!(pose.rotation.determinant() > 0.0, "{pose:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..Default::default() })]

    #[test]
    fn calibrations_of_garbage(
        figures in vec((lines(0..6usize), vec(vec(point(), 0..12), 0..6)), 0..4),
        plane in proptest::option::of(0..2u64),
        options in options(),
    ) {
        let edges: Vec<PlaneEdges> = figures
            .into_iter()
            .map(|(lines, points)| PlaneEdges { plane, ..PlaneEdges::new(lines, points) })
            .collect();
        if let Ok(found) = calibrate(&edges, SIZE, &options) {
            assert_finite(&found);
        }
    }

    #[test]
    fn calibrations_of_ruined_squares(
        seed in 0..1000u64,
        power in -3.0..3.0f64,
        at in 0..12usize,
        wrong in point(),
        options in options(),
    ) {
        let scene = Scene::random(seed % 7, SceneOptions::default());
        let mut edges = scene.edges(seed, 10f64.powf(power), 12.0);
        edges[at / 4].points[at % 4][1] = wrong;
        if let Ok(found) = calibrate(&edges, SIZE, &options) {
            assert_finite(&found);
        }
    }

    #[test]
    fn squares_of_garbage(sides in vec(vec(point(), 0..8), 0..6)) {
        if let Ok(square) = PlaneEdges::square(sides) {
            prop_assert_eq!(square.lines.len(), 4);
            prop_assert!(square.check(0).is_ok());
        }
    }

    #[test]
    fn straightenings_of_garbage(
        curves in vec(vec(point(), 0..20), 0..6),
        coefficients in 0..5usize,
        centre in proptest::option::of(point()),
        pixel in point(),
    ) {
        if let Ok(found) = fit_distortion(&curves, SIZE, coefficients, centre) {
            prop_assert!(found.coefficients.iter().all(|v| v.is_finite()));
            prop_assert!(found.centre.iter().all(|v| v.is_finite()) && found.rms.is_finite());
            if let Some(ideal) = found.undistort(&pixel) {
                prop_assert!(ideal.iter().all(|v| v.is_finite()), "{:?} of {:?}", ideal, pixel);
            }
        }
    }

    #[test]
    fn homographies_of_garbage(plane in lines(0..7usize), image in lines(0..7usize)) {
        if let Ok(found) = homography_from_lines(&plane, &image) {
            prop_assert!((found.norm() - 1.0).abs() < 1e-9, "{found}");
        }
    }

    #[test]
    fn camera_matrices_of_garbage(homographies in vec(matrix(), 0..5)) {
        if let Ok(found) = camera_matrix_from_homographies(&homographies) {
            prop_assert!(found.iter().all(|v| v.is_finite()), "{found}");
            prop_assert!(found[(0, 0)] > 0.0 && found[(1, 1)] > 0.0, "{found}");
        }
    }

    #[test]
    fn poses_of_garbage(camera in matrix(), homography in matrix(), witness in point()) {
        if let Ok(found) = Pose::from_homography(&camera, &homography, &witness) {
            assert_finite_pose(&found);
        }
    }

    #[test]
    fn lenses_of_garbage(lens in lens(), pixel in point(), space in space_point()) {
        if let Some(seen) = lens.project(&space) {
            prop_assert!(seen.iter().all(|v| v.is_finite()), "{seen} of {space}");
        }
        if let Some(ray) = lens.unproject(&pixel) {
            prop_assert!((ray.norm() - 1.0).abs() < 1e-12, "{ray}");
        }
        if let Some(pixel_ray) = lens.unproject_with_jacobian(&pixel) {
            prop_assert!(pixel_ray.ideal().iter().all(|v| v.is_finite()));
        }
        prop_assert!(!lens.valid_radius().is_nan());
    }

    #[test]
    fn a_pixel_that_is_sighted_is_seen_there_again(
        seed in 0..40u64,
        pixel in [-2000.0..3000.0, -2000.0..3000.0].prop_map(Vector2::from),
    ) {
        let lens = Scene::random(seed, SceneOptions::default()).camera;
        if let Some(ray) = lens.unproject(&pixel) {
            let again = lens.project(&ray).expect("what is sighted lies within the valid radius");
            prop_assert!((again - pixel).norm() < 1e-7, "{again} of {pixel}");
        }
    }
}
