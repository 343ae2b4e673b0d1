//! A lens that the crate does not define, through the whole pipeline.

use crate::equidistant::Equidistant;
use nalgebra::{Vector2, Vector3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use trisquare::lens::Columns;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Calibration, EdgeNoise, ErrorKind, Fixed, ImageSize, Lens, Method, Options, Photographs,
    Picture, PictureTone, PlaneEdges, PlannedPlane, Polarity, Stage, Tone, calibrate,
    calibrate_by_evidence, calibrate_photographs, choose, pixels_to_keep, predict,
};

const SPACING: f64 = 4.0;
const NOISE: f64 = 0.1;

/// Threshold on errors in standard deviations, which one normal error in sixteen thousand exceeds.
const SURE: f64 = 4.0;

/// A field of view of 84 by 68 degrees, 104 on the diagonal.
fn lens() -> Equidistant {
    Equidistant {
        intrinsics: [870.0, 874.0, 652.0, 471.0],
    }
}

fn scene(seed: u64) -> Scene<Equidistant> {
    Scene::seen_by(lens(), seed, SceneOptions::default())
}

fn options() -> Options<Equidistant> {
    Options::new()
}

fn largest_error(found: &Calibration<Equidistant>, truth: &Equidistant) -> f64 {
    let errors = found.camera.parameters().into_iter().zip(truth.intrinsics);
    errors.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Returns the largest error in standard deviations.
fn largest_score(found: &Calibration<Equidistant>, truth: &Equidistant) -> f64 {
    let errors = found.camera.parameters().into_iter().zip(truth.intrinsics);
    let stated = found.std();
    errors
        .zip(stated)
        .map(|((a, b), (_, std))| ((a - b) / std).abs())
        .fold(0.0, f64::max)
}

/// Pixels up to 100 degrees off the axis.
fn pixels() -> impl Iterator<Item = Vector2<f64>> {
    [
        (0.0, 0.0),
        (3.0, -2.0),
        (300.0, 200.0),
        (-900.0, 500.0),
        (1400.0, 600.0),
    ]
    .into_iter()
    .map(|(x, y)| lens().principal_point() + Vector2::new(x, y))
}

#[test]
fn a_pixel_comes_back_and_the_distance_vanishes_on_its_line() {
    let lens = lens();
    for pixel in pixels() {
        let ray = lens.unproject(&pixel).unwrap();
        assert!((ray.norm() - 1.0).abs() < 1e-14);
        assert!((lens.project(&ray).unwrap() - pixel).norm() < 1e-9);
        let line = ray.cross(&Vector3::new(0.3, -0.5, 0.4));
        let pixel_ray = lens.unproject_with_jacobian(&pixel).unwrap();
        let (distance, normal) = lens.line_distance_and_normal(&pixel_ray, &line);
        assert!(distance.abs() < 1e-9);
        // The distance of a pixel from its line is the length by which it was moved along the
        // normal.
        let beside = lens.unproject_with_jacobian(&(pixel + normal * 1e-3));
        let distance = lens.line_distance(&beside.unwrap(), &line);
        assert!((distance - 1e-3).abs() < 1e-7, "{pixel} {distance}");
    }
}

#[test]
fn jacobians_agree_with_central_differences() {
    let lens = lens();
    let line = Vector3::new(0.4, -0.8, 0.1);
    for pixel in pixels() {
        let distance = |lens: &Equidistant, line: &Vector3<f64>| {
            lens.line_distance(&lens.unproject_with_jacobian(&pixel).unwrap(), line)
        };
        let pixel_ray = lens.unproject_with_jacobian(&pixel).unwrap();
        let found = lens.line_distance_jacobian(&pixel_ray, &line, Columns::ALL);
        let projection = lens.projection_jacobian(&pixel_ray);
        let alone = distance(&lens, &line);
        assert!((found.value - alone).abs() < 1e-13 * alone.abs().max(1.0));
        for i in 0..3 {
            let step = Vector3::ith(i, 1e-6);
            let expected =
                (distance(&lens, &(line + step)) - distance(&lens, &(line - step))) / 2e-6;
            let error = (found.wrt_line[i] - expected).abs();
            assert!(error < 1e-7 * found.wrt_line.norm(), "{pixel} line {i}");
        }
        for i in 0..Equidistant::parameter_names().len() {
            let moved = |by: f64| {
                let mut parameters = lens.parameters();
                parameters[i] += by;
                lens.with_parameters(&parameters)
            };
            let difference = distance(&moved(1e-3), &line) - distance(&moved(-1e-3), &line);
            let error = (found.wrt_lens[i] - difference / 2e-3).abs();
            assert!(error < 1e-6, "{pixel} parameter {i}: {error}");
            let ray = lens.unproject(&pixel).unwrap();
            let seen = |by: f64| moved(by).project(&ray).unwrap();
            let difference = (seen(1e-3) - seen(-1e-3)) / 2e-3;
            assert!((projection.column(i) - difference).norm() < 1e-8);
        }
    }
}

#[test]
fn it_is_found_exactly_without_noise() {
    for seed in 0..10 {
        let scene = scene(seed);
        let edges = scene.edges(0, 0.0, SPACING);
        let found = calibrate(&edges, scene.size, &options()).unwrap();
        assert!(largest_error(&found, &scene.camera) < 1e-5, "seed {seed}");
        for (a, b) in found.planes.iter().zip(&scene.poses) {
            assert!((a.pose.rotation - b.rotation).norm() < 1e-7);
            assert!((a.pose.translation - b.translation).norm() < 1e-6);
        }
        let linear = Options {
            method: Method::Linear,
            ..options()
        };
        // The linear steps approximate its distortion by a polynomial of two terms.
        let found = calibrate(&edges, scene.size, &linear).unwrap();
        let error = largest_error(&found, &scene.camera);
        assert!(
            error < 0.05 * scene.camera.focal().x,
            "seed {seed}: {error}"
        );
    }
}

#[test]
fn its_standard_deviations_are_those_of_its_errors_and_of_the_plan() {
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..30 {
        let scene = scene(seed);
        let edges = scene.edges(1000 + seed, NOISE, SPACING);
        let found = calibrate(&edges, scene.size, &options()).unwrap();
        let errors = found
            .camera
            .parameters()
            .into_iter()
            .zip(scene.camera.intrinsics);
        for ((a, b), (_, std)) in errors.zip(found.std()) {
            squares += ((a - b) / std).powi(2);
            count += 1.0;
        }
        assert!(
            largest_score(&found, &scene.camera) < SURE + 0.5,
            "seed {seed}"
        );
        let corner = Vector2::new(40.0, 60.0);
        let ray = found.camera.unproject(&corner).unwrap();
        let error = (scene.camera.project(&ray).unwrap() - corner).norm();
        let std = found.projection_std(&[corner]).unwrap()[0];
        assert!(
            error < SURE * std && std < 3.0,
            "seed {seed}: {error}, {std}"
        );

        let planes: Vec<_> = scene
            .poses
            .iter()
            .map(|p| PlannedPlane::square(*p))
            .collect();
        let noise = EdgeNoise {
            sigma: NOISE,
            spacing: SPACING,
        };
        let plan = predict(&scene.camera, scene.size, &planes, noise, &options()).unwrap();
        for ((name, planned), (_, stated)) in plan.std().iter().zip(found.std()) {
            let ratio = planned / stated;
            assert!((0.8..1.15).contains(&ratio), "seed {seed}, {name}: {ratio}");
        }
    }
    // 120 correlated, normalised errors: the rms is 1 to within a sixth.
    let rms = f64::sqrt(squares / count);
    assert!((0.83..1.17).contains(&rms), "{rms}");
}

#[test]
fn what_is_held_stays() {
    let scene = scene(2);
    let edges = scene.edges(0, NOISE, SPACING);
    let held = Options {
        fixed: Fixed {
            aspect: true,
            principal_point: true,
            ..Fixed::default()
        },
        initial: Some(scene.camera),
        ..options()
    };
    let found = calibrate(&edges, scene.size, &held).unwrap();
    assert_eq!(found.parameters, ["fx"]);
    assert_eq!(
        found.camera.principal_point(),
        scene.camera.principal_point()
    );
    let [focal, truth] = [found.camera, scene.camera].map(|camera| camera.focal());
    assert!((focal.y / focal.x - truth.y / truth.x).abs() < 1e-12);
    assert!((focal.x - truth.x).abs() < SURE * found.std()[0].1);
    let chosen = calibrate_by_evidence(&edges, scene.size, &options(), None);
    let chosen = chosen.unwrap();
    assert!(chosen.alternatives.is_empty());
    assert!(largest_score(&chosen.calibration, &scene.camera) < SURE);
}

#[test]
fn a_wrong_lens_shows_in_its_residuals() {
    let scene = scene(3);
    let edges = scene.edges(0, 0.005, SPACING);
    let own = calibrate(&edges, scene.size, &options()).unwrap();
    let other = calibrate(&edges, scene.size, &Options::default()).unwrap();
    assert!(own.warnings.is_empty(), "{:?}", own.warnings);
    assert!(other.rms > 2.0 * own.rms, "{} {}", other.rms, own.rms);
}

#[test]
fn parallel_planes_determine_what_bends_directions_and_nothing_else() {
    let parallel = SceneOptions {
        parallel: true,
        ..SceneOptions::default()
    };
    for seed in 0..10 {
        let wide = Scene::seen_by(lens(), seed, parallel);
        let edges = wide.edges(seed, NOISE, SPACING);
        let found = calibrate(&edges, wide.size, &options()).unwrap();
        assert!(largest_score(&found, &wide.camera) < SURE, "seed {seed}");

        // Over a field of a few degrees, every lens is a pinhole.
        let narrow = Equidistant {
            intrinsics: [12_000.0, 12_000.0, 640.0, 480.0],
        };
        let narrow = Scene::seen_by(narrow, seed, parallel);
        let edges = narrow.edges(seed, NOISE, SPACING);
        let error = calibrate(&edges, narrow.size, &options()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::DegenerateGeometry, "{error}");
    }
}

#[test]
fn false_squares_are_dropped() {
    for seed in 0..3 {
        let first = scene(seed);
        let mut edges = first.edges(seed, NOISE, 8.0);
        for image in 1..3 {
            let another = first.another(100 * image + seed).edges(image, NOISE, 8.0);
            edges.extend(another.into_iter().map(|figure| PlaneEdges {
                image: image as usize,
                ..figure
            }));
        }
        let is_false = [true, false, false, false, true, false, false, false, true];
        for (figure, _) in edges.iter_mut().zip(is_false).filter(|(_, wrong)| *wrong) {
            let all: Vec<_> = figure.points.iter().flatten().copied().collect();
            let middle = all.iter().sum::<Vector2<f64>>() / all.len() as f64;
            for point in figure.points.iter_mut().flatten() {
                point.x = middle.x + (point.x - middle.x) * 0.7;
            }
        }
        let found = choose(&edges, first.size, &options()).unwrap();
        for (verdict, wrong) in found.verdicts.iter().zip(is_false) {
            assert_eq!(
                verdict.kept, !wrong,
                "seed {seed}, figure {}",
                verdict.figure
            );
        }
    }
}

/// Number of parts along a pixel's side over which light is summed; blur (px) and noise of the
/// picture.
const PARTS: usize = 8;
const BLUR: f64 = 0.8;
const PIXEL_NOISE: f64 = 0.02;

/// Renders dark squares on light ground, blurred. The ray of each part of a pixel passes through a
/// random point of the part: at fixed points, edges along the rows would be rounded to these.
fn photograph(scene: &Scene<Equidistant>) -> Picture {
    let (width, height) = (scene.size.width as usize, scene.size.height as usize);
    let (columns, rows) = (width * PARTS, height * PARTS);
    let mut rng = StdRng::seed_from_u64(1);
    let mut place = |part: usize| (part as f64 + rng.random_range(0.0..1.0)) / PARTS as f64 - 0.5;
    let to_planes: Vec<_> = scene
        .poses
        .iter()
        .map(|pose| pose.homography().try_inverse().unwrap())
        .collect();
    let mut light = |index: usize| {
        let pixel = Vector2::new(place(index % columns), place(index / columns));
        let ray = scene.camera.unproject(&pixel).unwrap();
        let is_dark = to_planes.iter().any(|map| {
            let point = map * ray;
            point.z > 0.0 && point.xy().amax() < 0.5 * point.z
        });
        if is_dark { 0.1 } else { 0.8 }
    };
    let sharp: Vec<f64> = (0..rows * columns).map(&mut light).collect();
    let sigma = BLUR * PARTS as f64;
    let reach = (4.0 * sigma) as usize;
    let kernel: Vec<f64> = (0..=reach)
        .map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp())
        .collect();
    let total = 2.0 * kernel.iter().sum::<f64>() - kernel[0];
    let blurred = |at: &dyn Fn(isize) -> f64| {
        let both = |i: usize| at(i as isize) + at(-(i as isize));
        let sides: f64 = (1..=reach).map(|i| kernel[i] * both(i)).sum();
        (kernel[0] * at(0) + sides) / total
    };
    let clamped = |i: usize, by: isize, count: usize| i.saturating_add_signed(by).min(count - 1);
    // Blurred along the rows, at all parts of all pixels, which are summed below.
    let along = |index: usize| {
        let (x, y) = (index % columns, index / columns);
        blurred(&|by| sharp[y * columns + clamped(x, by, columns)])
    };
    let along: Vec<f64> = (0..rows * columns).map(along).collect();
    let summed = |index: usize| {
        let (x, y) = (index % width, index / width);
        let row = |y: usize| {
            (0..PARTS)
                .map(|i| along[y * columns + x * PARTS + i])
                .sum::<f64>()
        };
        let part = |i: usize| blurred(&|by| row(clamped(y * PARTS + i, by, rows)));
        (0..PARTS).map(part).sum::<f64>() as f32 / (PARTS * PARTS) as f32
    };
    let mut noise = || (PIXEL_NOISE * rng.sample::<f64, _>(StandardNormal)) as f32;
    let values = (0..width * height).map(|index| summed(index) + noise());
    let values = values.collect();
    Picture::from_f32(width, height, 1, values).unwrap()
}

#[test]
fn its_pixels_are_fitted() {
    let camera = Equidistant {
        intrinsics: [200.0, 201.0, 152.0, 108.0],
    };
    let small = SceneOptions {
        size: ImageSize {
            width: 300,
            height: 220,
        },
        ..SceneOptions::default()
    };
    let scene = Scene::seen_by(camera, 1, small);
    let mut edges = scene.edges(1, 0.05, 3.0);
    for figure in &mut edges {
        figure.polarity = Some(Polarity::DarkInside);
    }
    let picture = photograph(&scene);
    let photographs = Photographs {
        pictures: &[&pixels_to_keep(&picture, &edges, 1.0)],
        tones: &[PictureTone::Known(Tone::Linear)],
    };
    let edges_alone = calibrate(&edges, scene.size, &options()).unwrap();
    let found = calibrate_photographs(&edges, scene.size, &options(), Some(&photographs)).unwrap();
    assert_eq!(found.stage, Stage::Pixels, "{:?}", found.warnings);
    let score = largest_score(&found, &camera);
    assert!(score < SURE, "{score}: {:?}", found.std());
    for ((name, before), (_, after)) in edges_alone.std().iter().zip(found.std()) {
        assert!(after < 0.7 * before, "{name}: {after} {before}");
    }
}
