//! What a calibration returns is stored by serde and read back as it was.

#[path = "any_lens/equidistant.rs"]
mod equidistant;

use equidistant::Equidistant;
use nalgebra::Vector2;
use serde::Serialize;
use serde::de::DeserializeOwned;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Brown, Calibration, Fisheye, FisheyeModel, Lens, ModelChoice, Options, Warning, calibrate,
    calibrate_by_evidence,
};

fn stored_and_read<T: Serialize + DeserializeOwned>(value: &T) -> T {
    serde_json::from_str(&serde_json::to_string(value).unwrap()).unwrap()
}

fn calibration_of<L: Lens>(scene: &Scene<L>) -> Calibration<L> {
    let edges = scene.edges(2, 0.1, 8.0);
    calibrate(&edges, scene.size, &Options::new()).unwrap()
}

#[test]
fn a_calibration_is_read_back_as_it_was() {
    let scene = Scene::random(1, SceneOptions::default());
    let mut edges = scene.edges(2, 0.1, 8.0);
    let bent = &mut edges[1].points[2];
    let count = bent.len() as f64;
    for (i, point) in bent.iter_mut().enumerate() {
        let place = i as f64 / count;
        *point += Vector2::new(8.0, 8.0) * place * (1.0 - place);
    }
    let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
    assert!(!found.warnings.is_empty());
    let read = stored_and_read(&found);
    assert_eq!(read, found);
    assert_eq!(read.std(), found.std());
}

#[test]
fn a_calibration_of_any_lens_is() {
    let camera = Equidistant {
        intrinsics: [870.0, 874.0, 652.0, 471.0],
    };
    let scene = Scene::seen_by(camera, 3, SceneOptions::default());
    let found = calibration_of(&scene);
    assert_eq!(stored_and_read(&found), found);
}

#[test]
fn options_of_any_lens_are() {
    let held = Options {
        model: FisheyeModel::Fisheye2,
        initial: Some(Fisheye::new([
            400.0, 401.0, 640.0, 480.0, 0.1, 0.0, 0.0, 0.0,
        ])),
        ..Options::new()
    };
    assert_eq!(stored_and_read(&held), held);
    let plain = Options::<Brown>::default();
    assert_eq!(stored_and_read(&plain), plain);
}

#[test]
fn a_choice_of_models_is() {
    let scene = Scene::random(4, SceneOptions::default());
    let edges = scene.edges(2, 0.1, 12.0);
    let found = calibrate_by_evidence(&edges, scene.size, &Options::default(), None).unwrap();
    assert!(!found.alternatives.is_empty());
    let read: ModelChoice = stored_and_read(&found);
    assert_eq!(read, found);
}

#[test]
fn every_warning_with_a_text_is() {
    for warning in [
        Warning::NoSquares {
            displacement: 1.5,
            parameter: "fx".into(),
            factor: 3.0,
            held: vec!["aspect".into()],
        },
        Warning::SidesErrTogether {
            plane: 0,
            displacement: 0.1,
            height: None,
            parameter: "k1".into(),
            factor: 1.5,
        },
        Warning::LensBeyondModel {
            certain: true,
            parameter: "cx".into(),
            factor: 2.0,
            cure: Some(("radial3".into(), 901.5)),
            held: false,
        },
        Warning::PixelsNotUsed {
            reason: "they are less certain than the edge samples".into(),
        },
        Warning::BarelyDetermined {
            parameter: "cy".into(),
            std: 40.0,
            part: 0.05,
            of: "the width".into(),
        },
        Warning::RelationContradicted {
            planes: [0, 2],
            stand: "right angles".into(),
            degrees: 1.5,
            std: 0.1,
        },
    ] {
        let read = stored_and_read(&warning);
        assert_eq!(read, warning);
        assert_eq!(read.to_string(), warning.to_string());
    }
}

#[test]
fn what_the_lens_does_not_have_is_refused() {
    let scene = Scene::random(1, SceneOptions::default());
    let text = serde_json::to_string(&calibration_of(&scene)).unwrap();
    let unknown = text.replacen("[\"fx\",", "[\"fz\",", 1);
    assert_ne!(unknown, text);
    let refused = serde_json::from_str::<Calibration>(&unknown).unwrap_err();
    assert!(refused.to_string().contains("fz"), "{refused}");
    assert!(serde_json::from_str::<Calibration<Equidistant>>(&text).is_err());
}
