//! From a picture to a camera, with the functions of the example; and photographs that do not fit
//! the figures.

#[path = "../../examples/picture.rs"]
#[allow(dead_code)] // its `main`
mod example;

use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Error, ImageSize, Lens, Options, Photographs, PictureTone, PlaneEdges, Polarity, PowerCurve,
    Stage, Tone, calibrate_photographs, pixels_to_keep,
};

const SIZE: ImageSize = ImageSize {
    width: 640,
    height: 480,
};

/// Threshold on errors in standard deviations, which one normal error in fifteen thousand exceeds.
const SURE: f64 = 4.0;

fn scene(seed: u64) -> Scene {
    let options = SceneOptions {
        size: SIZE,
        ..SceneOptions::default()
    };
    Scene::random(seed, options)
}

#[test]
fn the_example_finds_the_camera_of_its_picture() {
    for seed in 1..4 {
        let scene = scene(seed);
        let found = example::calibration_of(&scene).unwrap();
        assert_eq!(found.stage, Stage::Pixels, "seed {seed}: {found:?}");
        let truth = scene.camera.parameters();
        let estimates = found.estimates();
        assert_eq!(estimates.len(), truth.len());
        for (estimate, truth) in estimates.iter().zip(truth) {
            let error = estimate.value - truth;
            match estimate.std {
                Some(std) => assert!(error.abs() < SURE * std, "seed {seed}: {estimate:?}"),
                None => assert_eq!(error, 0.0),
            }
        }
        assert!(estimates[0].std.unwrap() < 0.002 * estimates[0].value);
    }
}

fn refused(edges: &[PlaneEdges], size: ImageSize, photographs: &Photographs<'_>) -> String {
    match calibrate_photographs(edges, size, &Options::default(), Some(photographs)) {
        Err(Error::InvalidArgument(message)) => message,
        other => panic!("{other:?}"),
    }
}

#[test]
fn photographs_that_do_not_fit_the_figures_are_refused() {
    let scene = scene(1);
    let mut edges = scene.edges(1, 0.05, 4.0);
    for figure in &mut edges {
        figure.polarity = Some(Polarity::DarkInside);
    }
    let kept = pixels_to_keep(&scene.picture(2, 0.6, 2.0), &edges, 0.6);
    let tones = [PictureTone::Known(Tone::Srgb)];
    let own = Photographs {
        pictures: &[&kept],
        tones: &tones,
    };
    let found = calibrate_photographs(&edges, SIZE, &Options::default(), Some(&own)).unwrap();
    assert_eq!(found.stage, Stage::Pixels);

    let none = Photographs {
        pictures: &[],
        tones: &[],
    };
    let untold = Photographs { tones: &[], ..own };
    let invalid = Photographs {
        tones: &[PictureTone::Known(Tone::Gamma(-1.0))],
        ..own
    };
    assert!(refused(&edges, SIZE, &none).contains("figure 0 is in the picture of index 0"));
    assert!(refused(&edges, SIZE, &untold).contains("1 pictures are given with 0 tone curves"));
    assert!(refused(&edges, SIZE, &invalid).contains("gamma"));
    let larger = ImageSize { width: 641, ..SIZE };
    assert!(refused(&edges, larger, &own).contains("640 x 480 pixels, not 641 x 480"));
    edges[2].image = 1;
    assert!(refused(&edges, SIZE, &own).contains("figure 2 is in the picture of index 1"));
}

#[test]
fn the_tone_of_one_picture_may_be_known_and_that_of_another_not() {
    let first = scene(1);
    let scenes = [first.another(5), first];
    let (mut edges, mut kept) = (Vec::new(), Vec::new());
    for (image, scene) in scenes.iter().enumerate() {
        let mut own = scene.edges(1, 0.05, 4.0);
        for figure in &mut own {
            figure.polarity = Some(Polarity::DarkInside);
        }
        kept.push(pixels_to_keep(&scene.picture(2, 0.6, 2.0), &own, 0.6));
        edges.extend(own.into_iter().map(|own| PlaneEdges { image, ..own }));
    }
    let photographs = Photographs {
        pictures: &[&kept[0], &kept[1]],
        tones: &[
            PictureTone::Known(Tone::Srgb),
            PictureTone::Estimated(PowerCurve {
                gamma: 2.2,
                toe: 0.0,
            }),
        ],
    };
    let options = Options::default();
    let found = calibrate_photographs(&edges, SIZE, &options, Some(&photographs)).unwrap();
    assert_eq!(found.stage, Stage::Pixels, "{:?}", found.warnings);
    let [known, estimated] = &found.tones[..] else {
        panic!("{:?}", found.tones);
    };
    assert_eq!((&known.covariance, known.shift), (&None, None));
    assert!(estimated.covariance.is_some());
}
