//! Calibrations of scenes with known truth, through the public interface.

use nalgebra::Vector2;
use trisquare::lens::SKEW;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Brown, BrownModel, Calibration, Error, ErrorKind, Fixed, Freedom, ImageSize, Lens, Method,
    Options, PlaneEdges, Remedy, Stage, Warning, calibrate,
};

const NO_NOISE: f64 = 0.0;
const SPACING: f64 = 4.0;

/// Returns the largest error of `fx, fy, cx, cy` relative to `fx`.
fn relative_error(found: &Calibration, scene: &Scene) -> f64 {
    let (a, b) = (found.camera.parameters(), scene.camera.parameters());
    (0..4)
        .map(|i| (a[i] - b[i]).abs() / b[0])
        .fold(0.0, f64::max)
}

fn pinhole() -> SceneOptions {
    SceneOptions {
        distortion: false,
        ..SceneOptions::default()
    }
}

#[test]
fn linear_is_exact_without_noise_and_distortion() {
    for seed in 0..40 {
        let scene = Scene::random(seed, pinhole());
        let edges = scene.edges(0, NO_NOISE, SPACING);
        for model in [BrownModel::None, BrownModel::Radial2] {
            let options = Options {
                method: Method::Linear,
                model,
                ..Options::default()
            };
            let found = calibrate(&edges, scene.size, &options).unwrap();
            let error = relative_error(&found, &scene);
            assert!(error < 1e-8, "seed {seed}, {model:?}: {error:e}");
            assert_eq!(found.stage, Stage::Linear);
        }
    }
}

#[test]
fn maximum_likelihood_is_exact_without_noise() {
    for seed in 0..60 {
        let scene = Scene::random(seed, SceneOptions::default());
        let edges = scene.edges(0, NO_NOISE, SPACING);
        for model in [BrownModel::Radial2, BrownModel::Radial3, BrownModel::Brown] {
            let options = Options {
                model,
                ..Options::default()
            };
            let found = calibrate(&edges, scene.size, &options).unwrap();
            let error = relative_error(&found, &scene);
            assert!(error < 1e-8, "seed {seed}, {model:?}: {error:e}");
            for (a, b) in found.planes.iter().zip(&scene.poses) {
                assert!((a.pose.rotation - b.rotation).norm() < 1e-7);
                assert!((a.pose.translation - b.translation).norm() < 1e-7);
            }
        }
    }
}

fn skew_freed() -> Options {
    Options {
        fixed: Fixed {
            skew: false,
            ..Fixed::default()
        },
        ..Options::default()
    }
}

#[test]
fn a_freed_skew_is_exact_without_noise() {
    for seed in 0..20 {
        let mut scene = Scene::random(seed, SceneOptions::default());
        scene.camera = scene.camera.with_skew(10.0 - seed as f64);
        let edges = scene.edges(0, NO_NOISE, SPACING);
        let freed = calibrate(&edges, scene.size, &skew_freed()).unwrap();
        let known = Options {
            initial: Some(scene.camera),
            ..Options::default()
        };
        let held = calibrate(&edges, scene.size, &known).unwrap();
        assert_eq!(held.camera.skew(), scene.camera.skew());
        assert_eq!(freed.parameters.last(), Some(&SKEW));
        for found in [freed, held] {
            let error = found.camera.camera_matrix() - scene.camera.camera_matrix();
            assert!(error.amax() < 1e-8 * scene.camera.focal().x, "seed {seed}");
        }
    }
    let scene = Scene::random(0, SceneOptions::default());
    let linear = Options {
        method: Method::Linear,
        ..skew_freed()
    };
    let found = calibrate(&scene.edges(0, NO_NOISE, SPACING), scene.size, &linear);
    assert!(matches!(found, Err(Error::InvalidArgument(_))));
}

/// A pinhole, because the shape of a radial distortion would determine the skew as well.
#[test]
fn two_directions_are_too_few_for_a_freed_skew() {
    let mut refused = 0;
    for seed in 0..10 {
        let mut scene = Scene::random(seed, pinhole());
        scene.poses[1].rotation = scene.poses[0].rotation;
        let edges = scene.edges(seed, 0.1, SPACING);
        let with = |options| Options {
            model: BrownModel::None,
            ..options
        };
        if calibrate(&edges, scene.size, &with(Options::default())).is_err() {
            continue;
        }
        match calibrate(&edges, scene.size, &with(skew_freed())) {
            Err(Error::IllConditioned(why)) => {
                assert!(
                    why.remedies.contains(&Remedy::HoldSkew),
                    "seed {seed}: {why}"
                );
                refused += 1;
            }
            other => panic!("seed {seed}: {:?}", other.map(|found| found.std())),
        }
    }
    assert!(refused >= 5, "{refused}");
}

#[test]
fn a_held_value_that_the_planes_contradict_is_named() {
    let scene = Scene::random(3, SceneOptions::default());
    let edges = scene.edges(3, 0.05, SPACING);
    let refused = |wrong: usize, value: f64, fixed: Fixed| {
        let mut held: [f64; 9] = scene.camera.parameters()[..9].try_into().unwrap();
        held[wrong] = value;
        let options = Options {
            fixed,
            initial: Some(Brown::new(held)),
            ..Options::default()
        };
        match calibrate(&edges, scene.size, &options) {
            Err(Error::IllConditioned(why)) => why.to_string(),
            other => panic!("{other:?}"),
        }
    };
    let focal = Fixed {
        focal: true,
        ..Fixed::default()
    };
    let told = refused(0, 1e6, focal);
    assert!(
        told.contains("; free the focal lengths: the planes contradict the fixed fx = 1000000, fy"),
        "{told}"
    );
    let principal_point = Fixed {
        principal_point: true,
        ..Fixed::default()
    };
    let told = refused(2, -1e6, principal_point);
    assert!(
        told.contains(
            "; free the principal point: the planes contradict the fixed cx = -1000000, cy"
        ),
        "{told}"
    );
}

/// With few samples per side, the noise per pixel of edge is as large as the residuals that a wrong
/// held value leaves.
#[test]
fn sparse_samples_do_not_contradict_a_held_principal_point() {
    const SPARSE: f64 = 40.0;
    let scene = Scene::random(3, SceneOptions::default());
    let options = Options {
        fixed: Fixed {
            principal_point: true,
            ..Fixed::default()
        },
        initial: Some(scene.camera),
        ..Options::default()
    };
    let found = calibrate(&scene.edges(3, 2.0, SPARSE), scene.size, &options).unwrap();
    assert!(found.noise_scale > 1.0, "{}", found.noise_scale);
}

/// The picture numbers of figures are labels unless photographs are given.
#[test]
fn numbers_of_pictures_are_names() {
    let scene = Scene::random(3, SceneOptions::default());
    let camera_of = |images: [usize; 3]| {
        let mut edges = scene.edges(3, 0.05, SPACING);
        for (figure, image) in edges.iter_mut().zip(images) {
            let drift = |points: &Vec<Vector2<f64>>| vec![Vector2::new(0.01, 0.02); points.len()];
            figure.tone_drift = Some(figure.points.iter().map(drift).collect());
            figure.image = image;
        }
        let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
        assert_eq!([0, 1, 2].map(|i| found.planes[i].image), images);
        (found.camera, found.covariance)
    };
    assert_eq!(camera_of([0, 1, 1]), camera_of([7, usize::MAX, usize::MAX]));
}

#[test]
fn errors_lie_within_the_stated_standard_deviations() {
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..60 {
        let scene = Scene::random(seed, SceneOptions::default());
        let edges = scene.edges(1000 + seed, 0.2, SPACING);
        let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
        let truth = scene.camera.parameters();
        let value = found.camera.parameters();
        for (name, std) in found.std() {
            let i = ["fx", "fy", "cx", "cy", "k1", "k2"]
                .iter()
                .position(|n| *n == name)
                .unwrap();
            let error = (value[i] - truth[i]) / std;
            assert!(error.abs() < 5.0, "seed {seed}: {name} off by {error} std");
            squares += error * error;
            count += 1.0;
        }
    }
    // 360 correlated, normalised errors: the rms is 1 to within a tenth.
    let rms = f64::sqrt(squares / count);
    assert!((0.88..1.12).contains(&rms), "{rms}");
}

#[test]
fn outliers_do_not_pull_the_answer() {
    for seed in 0..10 {
        let scene = Scene::random(seed, SceneOptions::default());
        let mut edges = scene.edges(1, 0.1, SPACING);
        let side = &mut edges[1].points[2];
        let hidden = side.len() / 4;
        for point in &mut side[..hidden] {
            *point += Vector2::new(6.0, 4.0);
        }
        let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
        let (value, truth) = (found.camera.parameters(), scene.camera.parameters());
        for (i, (name, std)) in found.std().iter().enumerate().take(4) {
            let error = (value[i] - truth[i]) / std;
            assert!(error.abs() < 4.5, "seed {seed}: {name} off by {error} std");
        }
    }
}

#[test]
fn fixed_parameters_need_fewer_planes() {
    let scene = Scene::random(3, SceneOptions::default());
    let edges = scene.edges(0, NO_NOISE, SPACING);
    let fixed = |aspect, principal_point, focal, distortion| Options {
        initial: Some(scene.camera),
        fixed: Fixed {
            aspect,
            principal_point,
            focal,
            distortion,
            ..Fixed::default()
        },
        ..Options::default()
    };
    for (planes, options) in [
        (2, fixed(false, false, false, true)),
        (1, fixed(false, true, false, false)),
        (1, fixed(true, true, false, true)),
        (1, fixed(false, true, true, true)),
        (1, fixed(false, true, true, false)),
        (3, fixed(true, false, false, false)),
    ] {
        let found = calibrate(&edges[..planes], scene.size, &options).unwrap();
        assert!(relative_error(&found, &scene) < 1e-7, "{options:?}");
    }
    let error = calibrate(&edges[..1], scene.size, &Options::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotEnoughPlanes);
    let error = calibrate(&[], scene.size, &Options::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotEnoughPlanes);
}

#[test]
fn parallel_planes_are_refused_unless_the_principal_point_is_fixed() {
    let options = SceneOptions {
        parallel: true,
        ..SceneOptions::default()
    };
    for seed in 0..40 {
        let scene = Scene::random(seed, options);
        for noise in [NO_NOISE, 0.05, 0.3] {
            let edges = scene.edges(seed, noise, SPACING);
            for method in [Method::MaximumLikelihood, Method::Linear] {
                let options = Options {
                    method,
                    ..Options::default()
                };
                let found = calibrate(&edges, scene.size, &options);
                // The linear steps may also end at a camera that cannot be evaluated at all.
                let refused = match found.as_ref().map_err(Error::kind) {
                    Err(ErrorKind::DegenerateGeometry) => true,
                    Err(ErrorKind::Convergence) => method == Method::Linear,
                    _ => false,
                };
                assert!(refused, "seed {seed}, noise {noise}, {method:?}: {found:?}");
            }
        }
        let held = Options {
            initial: Some(scene.camera),
            fixed: Fixed {
                principal_point: true,
                ..Fixed::default()
            },
            ..Options::default()
        };
        let edges = scene.edges(seed, 0.05, SPACING);
        let found = calibrate(&edges, scene.size, &held).unwrap();
        for (i, (name, std)) in found.std().iter().enumerate().take(2) {
            let error = found.camera.parameters()[i] - scene.camera.parameters()[i];
            assert!((error / std).abs() < 5.0, "seed {seed}: {name}");
        }
    }
}

#[test]
fn the_plane_that_is_no_square_is_named() {
    let mut named = 0;
    for seed in 0..10 {
        let scene = Scene::random(seed, SceneOptions::default());
        let mut edges = scene.edges(1, 0.1, SPACING);
        // With a second picture by the same camera, the true squares are the majority.
        edges.extend(scene.another(100 + seed).edges(2, 0.1, SPACING));
        for (line, offset) in edges[1].lines.iter_mut().zip([0.51, 0.5, 0.51, 0.5]) {
            let [a, b] = [line.normal().x, line.normal().y];
            *line = trisquare::Line::new(a, b, offset).unwrap();
        }
        let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
        let warning = found.warnings.first().map(ToString::to_string);
        named += usize::from(warning.is_some_and(|w| w.starts_with("plane 1 ")));
    }
    // Where the robust loss rejects the false sides entirely, no plane disagrees.
    assert!(named >= 8, "named in {named} of 10");
}

/// Calibrates from the planes of two scenes, ten times; all figures share one unknown aspect.
/// `edges` returns the edges of a scene for a seed of their noise.
fn check_aspects(aspect: f64, edges: impl Fn(&Scene, u64) -> Vec<PlaneEdges>) {
    let mut answered = 0;
    for seed in 0..10 {
        let scene = Scene::random(seed, SceneOptions::default());
        let mut both = edges(&scene, 1);
        both.extend(edges(&scene.another(100 + seed), 2));
        let Ok(found) = calibrate(&both, scene.size, &Options::default()) else {
            continue; // refused where six equations do not determine the camera well enough
        };
        answered += 1;
        let error = found.camera.focal().x - scene.camera.focal().x;
        assert!(error.abs() < 5.0 * found.std()[0].1, "seed {seed}");
        for plane in &found.planes {
            let estimated = plane.aspect.unwrap();
            let error = estimated.value - aspect;
            assert!(error.abs() < 5.0 * estimated.std, "seed {seed}");
        }
    }
    assert!(answered >= 8, "answered {answered} of 10");
}

#[test]
fn an_unknown_aspect_is_estimated_with_the_camera() {
    // The lines are 1.4 times too far apart along X, so the aspect is 1 / 1.4.
    check_aspects(1.0 / 1.4, |scene, noise_seed| {
        let mut edges = scene.edges(noise_seed, 0.1, SPACING);
        for figure in &mut edges {
            figure.freedom = Freedom::Aspect;
            for line in &mut figure.lines {
                let [a, b, c] = [line.normal().x, line.normal().y, line.coefficients().z];
                *line = trisquare::Line::new(a, b, if a.abs() > b.abs() { 1.4 * c } else { c })
                    .unwrap();
            }
        }
        edges
    });
    let shared = |plane| {
        let mut edges = Scene::random(1, SceneOptions::default()).edges(1, 0.1, SPACING);
        for figure in &mut edges {
            (figure.freedom, figure.plane) = (Freedom::Aspect, plane);
        }
        edges
    };
    let size = Scene::random(1, SceneOptions::default()).size;
    let refused = calibrate(&shared(Some(3)), size, &Options::default());
    assert_eq!(refused.unwrap_err().kind(), ErrorKind::InvalidArgument);
}

#[test]
fn lines_of_a_facade_may_be_anywhere() {
    let places: [&[f64]; 2] = [&[0.1, -0.5, 0.3], &[-0.4, 0.5, 0.2, 0.15]];
    check_aspects(0.9 / 0.8, |scene, noise_seed| {
        scene.facades(places, noise_seed, 0.1, SPACING).unwrap()
    });
}

#[test]
fn too_little_data_is_refused() {
    let scene = Scene::random(5, SceneOptions::default());
    let thin = |count: usize| -> Vec<PlaneEdges> {
        let mut edges = scene.edges(0, 0.1, SPACING);
        for side in edges.iter_mut().flat_map(|e| &mut e.points) {
            let last = side[side.len() - 1];
            side.truncate(count - 1);
            side.push(last);
        }
        edges
    };
    let error = calibrate(&thin(2), scene.size, &Options::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotEnoughData, "{error}");
    let mut edges = thin(9);
    edges[1].lines.pop();
    edges[1].points.pop();
    let error = calibrate(&edges, scene.size, &Options::default()).unwrap_err();
    assert!(matches!(
        error,
        Error::TooFewLines {
            figure: 1,
            found: 3,
            ..
        }
    ));
}

#[test]
fn estimates_pair_every_parameter_with_its_own_deviation() {
    let scene = Scene::random(5, SceneOptions::default());
    let edges = scene.edges(1, 0.1, SPACING);
    let options = Options {
        model: BrownModel::Brown,
        fixed: Fixed {
            aspect: true,
            principal_point: true,
            ..Fixed::default()
        },
        initial: Some(scene.camera),
        ..Options::default()
    };
    let found = calibrate(&edges, scene.size, &options).unwrap();
    let estimates = found.estimates();
    let names: Vec<_> = estimates.iter().map(|own| own.name).collect();
    assert_eq!(
        names,
        ["fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2", SKEW]
    );
    let values: Vec<_> = estimates.iter().map(|own| own.value).collect();
    assert_eq!(values, found.camera.parameters());
    let held: Vec<_> = estimates.iter().filter(|own| own.std.is_none()).collect();
    let held: Vec<_> = held.iter().map(|own| own.name).collect();
    assert_eq!(held, ["cx", "cy", SKEW]);
    let ratio = estimates[1].std.unwrap() / estimates[0].std.unwrap();
    assert!((ratio - values[1] / values[0]).abs() < 1e-12);
    let std: Vec<_> = estimates.iter().filter_map(|own| own.std).collect();
    let stated: Vec<_> = found.std().into_iter().map(|(_, std)| std).collect();
    assert_eq!(std, stated);
}

#[test]
fn samples_outside_the_picture_are_warned_of() {
    let scene = Scene::random(5, SceneOptions::default());
    let edges = scene.edges(1, 0.1, SPACING);
    let exchanged = ImageSize {
        width: scene.size.height,
        height: scene.size.width,
    };
    let beyond = |edges: &PlaneEdges| {
        let points = edges.points.iter().flatten();
        points.filter(|point| point.x > 961.0).count()
    };
    let figure = edges.iter().position(|own| beyond(own) > 0).unwrap();
    let outside = |edges: &[PlaneEdges], size: ImageSize| {
        let found = calibrate(edges, size, &Options::default()).unwrap();
        found
            .warnings
            .into_iter()
            .find_map(|warning| match warning {
                Warning::OutsidePicture {
                    figure,
                    samples,
                    first,
                    size,
                } => Some((figure, samples, first, size)),
                _ => None,
            })
    };
    let (found, samples, first, size) = outside(&edges, exchanged).unwrap();
    assert_eq!((found, samples), (figure, beyond(&edges[figure])));
    assert!(first[0] > 961.0);
    assert_eq!(size, [960, 1280]);
    // An impossible size is reported before the geometry, which it makes degenerate.
    let none = ImageSize {
        width: 1,
        height: 1,
    };
    match calibrate(&edges, none, &Options::default()) {
        Err(Error::InvalidArgument(message)) => assert!(message.contains("1 x 1"), "{message}"),
        other => panic!("{other:?}"),
    }
    // Samples beyond the border by no more than the measuring error do not count as outside.
    let mut at_the_border = edges.clone();
    let mut line = PlaneEdges::line(
        (0..40)
            .map(|i| Vector2::new(10.0 + 20.0 * f64::from(i), -1.9))
            .collect(),
    )
    .unwrap();
    at_the_border.push(line.clone());
    assert_eq!(outside(&at_the_border, scene.size), None);
    line.points[0][7].y = -2.1;
    at_the_border[3] = line;
    let (figure, samples, ..) = outside(&at_the_border, scene.size).unwrap();
    assert_eq!((figure, samples), (3, 1));
}

#[test]
fn an_inner_outline_that_is_fixed_on_the_outer_one_is_named() {
    let scene = Scene::random(1, SceneOptions::default());
    let on = |plane, freedom, figure| PlaneEdges {
        plane: Some(plane),
        freedom,
        ..figure
    };
    let outlines = |part: f64, freedom| -> Vec<PlaneEdges> {
        let figures = (0..).zip(scene.edges(1, 0.1, 8.0));
        let frames = figures.flat_map(|(plane, outer)| {
            let mut inner = outer.clone();
            let sides = outer.points.iter().flatten();
            let middle = sides.sum::<Vector2<f64>>() / outer.sample_count() as f64;
            for point in inner.points.iter_mut().flatten() {
                *point = middle.lerp(point, part);
            }
            [on(plane, Freedom::Auto, outer), on(plane, freedom, inner)]
        });
        frames.collect()
    };
    let solve = |edges: &[PlaneEdges]| calibrate(edges, scene.size, &Options::default());
    for part in [0.6, 0.95] {
        let Err(Error::InvalidArgument(message)) = solve(&outlines(part, Freedom::Fixed)) else {
            panic!("{part}");
        };
        assert!(
            message.starts_with("the lines of figure 1, which"),
            "{message}"
        );
        assert!(message.contains("those of figure 0"), "{message}");
    }
    // An outline may be measured twice, but the same samples may not be given twice.
    assert!(solve(&outlines(0.999_999, Freedom::Fixed)).is_ok());
    let Err(Error::InvalidArgument(message)) = solve(&outlines(1.0, Freedom::Fixed)) else {
        panic!("its noise counts twice");
    };
    assert_eq!(
        message,
        "figure 1 has the samples of figure 0: give each measurement once"
    );
}
