//! Results of a calibration are stored by serde and read back unchanged.

use crate::equidistant::Equidistant;
use nalgebra::Vector2;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Brown, Calibration, Fisheye, FisheyeModel, Fixed, Lens, Line, ModelChoice, Options,
    PictureTone, PowerCurve, Straightening, Tone, Warning, calibrate, calibrate_by_evidence,
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
fn members_that_stored_options_do_not_have_are_the_defaults() {
    let read = |text| serde_json::from_str::<Options<Fisheye>>(text).unwrap();
    assert_eq!(read("{}"), Options::new());
    let fixed = Fixed {
        aspect: true,
        ..Fixed::default()
    };
    let expected = Options {
        fixed,
        ..Options::new()
    };
    assert_eq!(read(r#"{"fixed": {"aspect": true}}"#), expected);
}

#[test]
fn members_that_options_do_not_know_are_refused() {
    for (text, expected) in [
        (r#"{"fixd": {"aspect": true}}"#, "unknown field `fixd`"),
        (r#"{"fixed": {"aspct": true}}"#, "unknown field `aspct`"),
        (r#"{"model": "Fisheye9"}"#, "unknown variant `Fisheye9`"),
    ] {
        let refused = serde_json::from_str::<Options<Fisheye>>(text).unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
    }
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
            known_to: Some(0.002),
        },
        Warning::PlaneStretched {
            plane: 1,
            stretch: -0.003,
            parameter: "cx".into(),
            factor: 12.0,
            known_to: None,
        },
        Warning::LensBeyondModel {
            certain: true,
            parameter: "cx".into(),
            factor: 2.0,
            cure: Some(("radial3".into(), 901.5)),
            held: vec!["aspect".into()],
        },
        Warning::PixelsNotUsed {
            reason: "they are less certain than the edge samples".into(),
        },
        Warning::BarelyDetermined {
            by_tone: false,
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

/// Returns the error message on reading a stored value of which one member was changed.
fn refusal<T: Serialize + DeserializeOwned + std::fmt::Debug>(
    value: &T,
    member: &str,
    other: serde_json::Value,
) -> String {
    let mut text = serde_json::to_value(value).unwrap();
    let changed = text.pointer_mut(member).unwrap();
    assert_ne!(*changed, other);
    *changed = other;
    serde_json::from_value::<T>(text).unwrap_err().to_string()
}

#[test]
fn a_calibration_whose_fields_contradict_each_other_is_refused() {
    let found = calibration_of(&Scene::random(1, SceneOptions::default()));
    let smaller = json!([[1.0, 0.0, 0.0, 1.0], 2, 2]);
    let count = found.parameters.len();
    for (member, other, expected) in [
        ("/covariance", smaller.clone(), "covariance is 2 x 2"),
        ("/covariance/0/0", json!(-1.0), "covariance must be finite"),
        (
            "/covariance/0/1",
            json!(1e3),
            "covariance must be finite, symmetric",
        ),
        ("/parameters", json!(["fx"]), "parameters has 1 names"),
        ("/parameters/1", json!("fx"), "parameters has fx twice"),
        ("/rms", json!(-0.1), "rms must not be negative, but is -0.1"),
        (
            "/noise_scale",
            json!(-1.0),
            "noise_scale must not be negative",
        ),
        (
            "/planes/1/rms",
            json!(-0.1),
            "planes[1].rms must not be negative",
        ),
        (
            "/residual_correlation/added",
            smaller,
            "residual_correlation.added is 2 x 2",
        ),
        (
            "/planes/1/uncertainty/by_camera",
            json!([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], null, 1]),
            "planes[1].uncertainty.by_camera has 1 columns",
        ),
        ("/residuals/2/plane", json!(3), "residuals[2].plane is 3"),
        (
            "/residuals/0/sides/1/normals",
            json!([]),
            "residuals[0].sides[1]",
        ),
        ("/image_size/width", json!(0), "width 0"),
        (
            "/planes/0/pose/rotation/4",
            json!(9.0),
            "rotation of a pose",
        ),
    ] {
        let refused = refusal(&found, member, other);
        assert!(refused.contains(expected), "{member}: {refused}");
    }
    assert_eq!(found.covariance.shape(), (count, count));
}

#[test]
fn what_no_constructor_makes_is_refused() {
    let line = Line::new(3.0, 4.0, 5.0).unwrap();
    assert_eq!(stored_and_read(&line), line);
    assert!(refusal(&line, "/coefficients", json!([3.0, 4.0, 5.0])).contains("unit normal"));
    let scene = Scene::random(1, SceneOptions::default());
    let pose = calibration_of(&scene).planes[0].pose;
    let mirrored = pose.rotation.map(|v| -v);
    let refused = refusal(&pose, "/rotation", serde_json::to_value(mirrored).unwrap());
    assert!(refused.contains("rotation"), "{refused}");
    let curve = PowerCurve {
        gamma: 2.4,
        toe: 0.039,
    };
    assert_eq!(stored_and_read(&curve), curve);
    assert!(refusal(&curve, "/gamma", json!(0.0)).contains("gamma"));
    assert!(refusal(&curve, "/toe", json!(-1.0)).contains("toe"));
    assert_eq!(stored_and_read(&Tone::Gamma(2.2)), Tone::Gamma(2.2));
    assert!(refusal(&Tone::Gamma(2.2), "/Gamma", json!(0.0)).contains("gamma"));
    let shifted = PictureTone::Shifted(curve, 0.1);
    assert_eq!(stored_and_read(&shifted), shifted);
    assert!(refusal(&shifted, "/Shifted/1", json!(-0.1)).contains("deviation"));
    let straight = Straightening::identity(scene.size);
    assert_eq!(stored_and_read(&straight), straight);
    assert!(refusal(&straight, "/radius", json!(0.0)).contains("radius"));
}
