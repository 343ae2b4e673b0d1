//! Squares under lenses of OpenCV's rational and thin prism models.

use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Lens, Options, Rational, RationalModel, ThinPrism, ThinPrismModel, calibrate,
    calibrate_by_evidence,
};

const NOISE: f64 = 0.1;
const SPACING: f64 = 6.0;
const SCENES: u64 = 20;

fn intrinsics() -> [f64; 4] {
    [800.0, 804.0, 652.0, 471.0]
}

fn rational() -> Rational {
    Rational::new(intrinsics(), &[0.2, 0.0, 0.0, 0.4])
}

fn prism() -> ThinPrism {
    let coefficients = [
        -0.1, 0.03, 0.0, 0.0, 0.0, 0.0, 2e-3, -1e-3, 3e-3, 0.0, -2e-3, 1e-3,
    ];
    ThinPrism::new(intrinsics(), &coefficients)
}

/// Returns the root mean square of the errors of `fx, fy, cx, cy` divided by their standard
/// deviations.
fn score<L: Lens>(camera: L, model: L::Model) -> f64 {
    let options = Options {
        model,
        ..Options::<L>::new()
    };
    let scores = (0..SCENES).flat_map(|seed| {
        let scene = Scene::seen_by(camera, seed, SceneOptions::default());
        let edges = scene.edges(3000 + seed, NOISE, SPACING);
        let found = calibrate(&edges, scene.size, &options).unwrap();
        let pairs = found.camera.intrinsics().into_iter();
        let errors = pairs.zip(camera.intrinsics()).map(|(a, b)| a - b);
        let stated = found.std();
        errors
            .zip(stated)
            .map(|(error, (_, std))| (error / std).powi(2))
            .collect::<Vec<_>>()
    });
    let scores: Vec<f64> = scores.collect();
    (scores.iter().sum::<f64>() / scores.len() as f64).sqrt()
}

#[test]
fn standard_deviations_are_those_of_the_errors() {
    let all = [
        score(rational(), RationalModel::Rational),
        score(prism(), ThinPrismModel::BrownPrism),
        score(prism(), ThinPrismModel::ThinPrism),
    ];
    // 80 correlated, normalised errors.
    let is_right = |rms: &f64| (0.7..1.3).contains(rms);
    assert!(all.iter().all(is_right), "{all:?}");
}

#[test]
fn evidence_takes_no_denominator_for_a_lens_without() {
    let scene = Scene::random(4, SceneOptions::default());
    let camera = Rational::new(scene.camera.intrinsics(), &[-0.2, 0.05]);
    let scene = Scene {
        camera,
        size: scene.size,
        poses: scene.poses,
    };
    let edges = scene.edges(3, NOISE, SPACING);
    let options = Options::<Rational>::new();
    let chosen = calibrate_by_evidence(&edges, scene.size, &options, None).unwrap();
    assert_ne!(chosen.model, RationalModel::Rational);
    assert!(
        chosen
            .alternatives
            .iter()
            .all(|other| other.log_evidence <= 0.0)
    );
}
