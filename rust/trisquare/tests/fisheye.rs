//! Squares under a fisheye lens.

use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{Fisheye, Lens, Options, calibrate, calibrate_by_evidence};

const NOISE: f64 = 0.1;
const SPACING: f64 = 6.0;
const SCENES: u64 = 20;

/// Normal errors beyond so many standard deviations occur once in sixteen thousand draws.
const SURE: f64 = 4.0;

/// A lens whose picture, 1280 pixels wide, spans a full angle in degrees.
fn lens(field: f64, distortion: [f64; 4]) -> Fisheye {
    let half = 0.5 * field.to_radians();
    let powers = distortion.iter().zip(1..);
    let bends = powers.map(|(k, order)| k * half.powi(2 * order));
    let focal = 640.0 / (half * (1.0 + bends.sum::<f64>()));
    let [k1, k2, k3, k4] = distortion;
    Fisheye::new([focal, 1.002 * focal, 652.0, 471.0, k1, k2, k3, k4])
}

fn wide(field: f64) -> Fisheye {
    lens(field, [0.02, -0.01, 0.003, -0.0004])
}

fn scene(camera: Fisheye, seed: u64) -> Scene<Fisheye> {
    Scene::seen_by(camera, seed, SceneOptions::default())
}

#[test]
fn it_is_found_exactly_without_noise() {
    for field in [100.0, 130.0, 160.0, 190.0] {
        let scene = scene(wide(field), 1);
        let edges = scene.edges(0, 0.0, SPACING);
        let found = calibrate(&edges, scene.size, &Options::<Fisheye>::new()).unwrap();
        let pairs = found.camera.parameters().into_iter();
        for (value, truth) in pairs.zip(scene.camera.parameters()) {
            let error = (value - truth).abs();
            assert!(error < 1e-5, "{field} degrees: {value} for {truth}");
        }
    }
}

#[test]
fn its_standard_deviations_are_those_of_its_errors() {
    for field in [100.0, 130.0, 160.0, 190.0] {
        let (mut squares, mut count) = (0.0, 0.0);
        for seed in 0..SCENES {
            let scene = scene(wide(field), seed);
            let edges = scene.edges(1000 + seed, NOISE, SPACING);
            let found = calibrate(&edges, scene.size, &Options::<Fisheye>::new()).unwrap();
            let errors = found.camera.parameters().into_iter();
            let errors = errors.zip(scene.camera.parameters()).map(|(a, b)| a - b);
            for (error, (name, std)) in errors.zip(found.std()) {
                let score = error / std;
                assert!(
                    score.abs() < SURE + 0.5,
                    "{field}, seed {seed}: {name} {score}"
                );
                squares += score * score;
                count += 1.0;
            }
        }
        // 160 correlated, normalised errors.
        let rms = f64::sqrt(squares / count);
        assert!((0.8..1.25).contains(&rms), "{field} degrees: {rms}");
    }
}

#[test]
fn evidence_takes_no_coefficients_for_an_equidistant_lens() {
    let chosen = |camera: Fisheye| {
        let scene = scene(camera, 3);
        let edges = scene.edges(3, NOISE, SPACING);
        calibrate_by_evidence(&edges, scene.size, &Options::new(), None)
    };
    let plain = chosen(lens(130.0, [0.0; 4])).unwrap();
    let bent = chosen(wide(130.0)).unwrap();
    let is_plain = |camera: &Fisheye| camera.distortion() == [0.0; 4];
    assert!(is_plain(&plain.calibration.camera) && !is_plain(&bent.calibration.camera));
}
