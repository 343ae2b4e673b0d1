//! The coordinate entry points: a whole calibration, and a square from its sides.

use std::sync::LazyLock;
use std::time::{Duration, Instant};

use nalgebra::Vector2;
use trisquare::synthetic::Scene;
use trisquare::{EdgeNoise, ImageSize, Method, PlaneEdges, PlannedPlane};

use crate::bytes::Bytes;
use crate::figures::{View, damage, scenes};
use crate::{Outcome, check};

pub const SIZE: ImageSize = ImageSize {
    width: 1280,
    height: 960,
};

/// Maximum time of a calibration from a few figures, on a slow machine.
const LONGEST: Duration = Duration::from_secs(8);

pub static SCENES: LazyLock<Vec<Scene>> = LazyLock::new(|| scenes(SIZE));

/// `trisquare::calibrate`.
pub fn calibrate(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let options = bytes.options(SIZE);
    let mut figures = match bytes.below(8) {
        0 => garbage(bytes),
        1 => View::wild(bytes, SIZE).figures(bytes),
        _ => View::sound(bytes, &SCENES).figures(bytes),
    };
    if bytes.once_in(2) {
        damage(&mut figures, SIZE, bytes);
    }
    let size = match bytes.below(32) {
        0 => ImageSize {
            width: bytes.seed() as u32,
            height: bytes.below(3) as u32,
        },
        _ => SIZE,
    };
    let begun = Instant::now();
    let found = trisquare::calibrate(&figures, size, &options);
    assert!(begun.elapsed() < LONGEST, "{:?}", begun.elapsed());
    if bytes.once_in(32) {
        // The Debug output shows every bit of numbers other than NaN.
        let again = trisquare::calibrate(&figures, size, &options);
        assert_eq!(format!("{found:?}"), format!("{again:?}"));
    }
    check::calibration(&found)
}

/// `trisquare::calibrate_by_evidence`, and the uncertainty of its camera's projections.
pub fn calibrate_by_evidence(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let mut options = bytes.options(SIZE);
    if !bytes.once_in(16) {
        (options.method, options.fixed.distortion) = (Method::MaximumLikelihood, false);
    }
    let mut figures = View::sound(bytes, &SCENES).figures(bytes);
    if bytes.once_in(2) {
        damage(&mut figures, SIZE, bytes);
    }
    let choice = match trisquare::calibrate_by_evidence(&figures, SIZE, &options, None) {
        Ok(choice) => choice,
        Err(error) => return check::refusal(&error),
    };
    for other in &choice.alternatives {
        assert!(other.model != choice.model && other.log_evidence <= 0.0 && other.rms.is_finite());
    }
    check::projection(&choice.calibration, &bytes.points(SIZE, 4));
    check::calibration(&Ok(choice.calibration))
}

/// `trisquare::choose` among the squares of up to three scenes, and figures that are not squares.
pub fn choose(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let options = bytes.options(SIZE);
    let mut view = View::sound(bytes, &SCENES);
    for _ in 0..bytes.below(3) {
        view.poses.extend(View::sound(bytes, &SCENES).poses);
    }
    let mut figures = view.figures(bytes);
    for _ in 0..bytes.below(5) {
        let number = bytes.below(figures.len().max(1));
        if let Some(figure) = figures.get_mut(number) {
            // Stretched to a rectangle, such as a window, which is no square to any camera.
            let wider = bytes.between(0.3, 3.0);
            for point in figure.points.iter_mut().flatten() {
                point.x *= wider;
            }
        }
    }
    if bytes.once_in(2) {
        damage(&mut figures, SIZE, bytes);
    }
    match trisquare::choose(&figures, SIZE, &options) {
        Ok(choice) => {
            assert!(choice.verdicts.len() <= figures.len());
            for verdict in &choice.verdicts {
                assert!(verdict.figure < figures.len());
                assert!(verdict.residual.is_none_or(|r| r.is_finite() && r >= 0.0));
                assert!(!verdict.kept || verdict.residual.is_none());
            }
            let kept = choice.verdicts.iter().filter(|v| v.kept).count();
            match choice.doubt {
                Some(doubt) => {
                    check::spoken(&doubt.to_string());
                    "Ok, doubtful"
                }
                None if kept < choice.verdicts.len() => "Ok, some dropped",
                None => "Ok, all kept",
            }
        }
        Err(error) => check::refusal(&error),
    }
}

/// `trisquare::predict`, for planes inside or outside the picture.
pub fn predict(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let options = bytes.options(SIZE);
    let view = if bytes.once_in(4) {
        View::wild(bytes, SIZE)
    } else {
        View::sound(bytes, &SCENES)
    };
    let mut planned: Vec<PlannedPlane> = view
        .poses
        .iter()
        .map(|pose| match bytes.below(4) {
            0 => PlannedPlane::frame(*pose, bytes.between(0.0, 1.0)),
            _ => PlannedPlane::square(*pose),
        })
        .collect();
    if let Some(plane) = planned.first_mut().filter(|_| bytes.once_in(4)) {
        let outlines = (0..bytes.below(3)).map(|_| {
            std::array::from_fn(|_| Vector2::new(bytes.coefficient(), bytes.coefficient()))
        });
        plane.outlines = outlines.collect();
    }
    let any = bytes.once_in(8);
    let mut positive = |low, high| match any {
        true => bytes.coefficient(),
        false => bytes.power(low, high),
    };
    let noise = EdgeNoise {
        sigma: positive(-3.0, 1.0),
        spacing: positive(-1.0, 2.0),
    };
    match trisquare::predict(&view.camera, SIZE, &planned, noise, &options) {
        Ok(found) => {
            check::covariance(&found.covariance);
            assert!(found.std().iter().all(|(_, v)| v.is_finite() && *v > 0.0));
            "Ok"
        }
        Err(error) => check::refusal(&error),
    }
}

fn garbage(bytes: &mut Bytes<'_>) -> Vec<PlaneEdges> {
    (0..bytes.below(5))
        .map(|_| {
            let lines = bytes.lines(6);
            let points = (0..lines.len()).map(|_| bytes.points(SIZE, 8)).collect();
            PlaneEdges::new(lines, points)
        })
        .collect()
}

/// `trisquare::PlaneEdges::square`.
pub fn square(data: &[u8]) -> Outcome {
    let bytes = &mut Bytes::new(data);
    let mut sides: Vec<_> = match bytes.below(3) {
        0 => (0..bytes.below(6)).map(|_| bytes.points(SIZE, 8)).collect(),
        1 => quadrangle(bytes),
        _ => {
            let mut figures = View::sound(bytes, &SCENES).figures(bytes);
            damage(&mut figures, SIZE, bytes);
            figures.pop().map(|f| f.points).unwrap_or_default()
        }
    };
    if bytes.once_in(2) {
        sides.reverse();
    }
    match PlaneEdges::square(sides) {
        Ok(found) => {
            assert!(found.lines.len() == 4 && found.check(0).is_ok());
            "Ok"
        }
        Err(error) => check::refusal(&error),
    }
}

/// Returns the sides between any four corners.
fn quadrangle(bytes: &mut Bytes<'_>) -> Vec<Vec<Vector2<f64>>> {
    let corners: [_; 4] = std::array::from_fn(|_| bytes.point(SIZE));
    (0..4)
        .map(|i| {
            let count = 2 + bytes.below(3);
            let along = |k: usize| (k as f64 + 0.5) / count as f64;
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            (0..count).map(|k| a.lerp(&b, along(k))).collect()
        })
        .collect()
}
