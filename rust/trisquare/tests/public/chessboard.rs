//! From pictures of chessboards to a camera, with the functions of the example.

#[path = "../../examples/chessboard.rs"]
#[allow(dead_code)] // its `main`
mod example;

use example::{camera_of, made_up};
use nalgebra::Vector2;
use trisquare::{Chessboard, Error, Lens, Picture, localise_with_unknown_tone};

/// Threshold on errors in standard deviations, which one normal error in fifteen thousand exceeds.
const SURE: f64 = 4.0;

#[test]
fn the_example_finds_the_camera_though_the_edges_appear_shifted() {
    for seed in 1..4 {
        let (scene, pictures) = made_up(seed);
        let found = camera_of(&pictures, scene.size).unwrap();
        for (estimate, truth) in found.estimates().iter().zip(scene.camera.parameters()) {
            let std = estimate.std.unwrap_or(f64::MIN_POSITIVE);
            let error = (estimate.value - truth).abs();
            assert!(error <= SURE * std, "seed {seed}: {estimate:?}, {truth}");
        }
        // Edges that are not shifted back leave 0.024 to 0.027 pixels.
        assert!(found.rms < 0.01, "seed {seed}: {}", found.rms);
    }
}

#[test]
fn corners_may_be_given_from_any_one_on_and_in_either_sense() {
    let (scene, mut pictures) = made_up(1);
    let focal = |pictures: &[_]| {
        let found = camera_of(pictures, scene.size).unwrap();
        for plane in &found.planes {
            assert!(plane.pose.normal().dot(&plane.pose.translation) > 0.0);
        }
        found.camera.focal().x
    };
    let as_given = focal(&pictures);
    for (_, corners) in &mut pictures {
        corners.reverse(); // mirrored, and the first cell has the other shade
    }
    assert!((focal(&pictures) - as_given).abs() < 0.1);
    for (_, corners) in &mut pictures {
        corners.iter_mut().for_each(|row| row.reverse());
    }
    assert!((focal(&pictures) - as_given).abs() < 0.1);
}

#[test]
fn lines_that_are_not_measured_are_left_out() {
    let (_, pictures) = made_up(1);
    let (picture, corners) = &pictures[0];
    let board = Chessboard::new(picture, corners).unwrap();
    let (mut measured, ..) = localise_with_unknown_tone(picture, &board.spans(0));
    let whole = board.edges(&measured).unwrap();
    assert_eq!(whole.lines.len(), corners.len() + corners[0].len());
    let reason = trisquare::NoEdge::Unmeasurable;
    measured[2] = Err(reason);
    let without = board.edges(&measured).unwrap();
    assert_eq!(without.lines[..2], whole.lines[..2]);
    assert_eq!(without.lines[2..], whole.lines[3..]);
    measured[..corners.len() - 1].fill(Err(reason));
    let refused = board.edges(&measured);
    assert!(matches!(
        refused,
        Err(Error::TooFewParallels { found: 1, .. })
    ));
    assert!(matches!(
        board.edges(&measured[1..]),
        Err(Error::InvalidArgument(_))
    ));
}

#[test]
fn what_is_no_grid_of_corners_is_refused() {
    let picture = Picture::from_u8(80, 80, 1, vec![0; 6400]).unwrap();
    let refused = |corners: &[Vec<Vector2<f64>>]| Chessboard::new(&picture, corners).unwrap_err();
    let row = |y: f64, count: u8| -> Vec<_> {
        (0..count)
            .map(|x| Vector2::new(10.0 * f64::from(x), y))
            .collect()
    };
    assert!(matches!(
        refused(&[]),
        Error::TooFewParallels { found: 0, .. }
    ));
    assert!(matches!(
        refused(&[row(0.0, 3)]),
        Error::TooFewParallels { found: 1, .. }
    ));
    let uneven = refused(&[row(0.0, 3), row(10.0, 3), row(20.0, 4)]).to_string();
    assert_eq!(
        uneven,
        "row 2 of the chessboard has 4 corners, but row 0 has 3"
    );
    let unknown = refused(&[row(0.0, 3), row(f64::NAN, 3)]);
    assert!(matches!(
        unknown,
        Error::SampleNotFinite {
            line: 1,
            sample: 0,
            ..
        }
    ));
}
