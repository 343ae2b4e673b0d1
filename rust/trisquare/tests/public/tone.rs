//! The tone curve of a picture, estimated from its edges.

use crate::edge_scene::{ANGLES, CAMERA, Camera, SIZE, Statistics, offsets, spans, square};
use trisquare::{Picture, PictureTone, SpanEdges, Tone, ToneEstimate, localise_with_unknown_tone};

fn measured(picture: &Picture, degrees: f64) -> (Vec<SpanEdges>, ToneEstimate) {
    let shape = square(degrees);
    let (found, estimate, _) =
        localise_with_unknown_tone(picture, &spans(&shape, -1.0, |_| [1.0; 2]));
    (
        found.into_iter().collect::<Result<_, _>>().unwrap(),
        estimate,
    )
}

fn picture(camera: &Camera, degrees: f64, seed: u64) -> Picture {
    camera.bytes(&camera.exposure(&square(degrees)), seed)
}

/// The error of gamma agrees with its standard deviation, and the remaining shift of the edges with
/// the drift.
#[test]
fn gamma_and_edges_are_found_within_their_deviations() {
    let curves = [
        (Tone::Linear, 1.0),
        (Tone::Gamma(1.8), 1.8),
        (Tone::Gamma(2.6), 2.6),
        // The pure gamma that codes 18 % grey to the same value.
        (Tone::Srgb, 0.18_f64.ln() / Tone::Srgb.encode(0.18).ln()),
    ];
    for (tone, gamma) in curves {
        let camera = Camera { tone, ..CAMERA };
        let (mut gammas, mut shifts) = (0.0, 0.0);
        for (seed, degrees) in (0..).zip(ANGLES) {
            let (edges, estimate) = measured(&picture(&camera, degrees, seed), degrees);
            assert_eq!((estimate.sides, estimate.shift_std), (4, None), "{tone:?}");
            let error = estimate.curve.effective_gamma() - gamma;
            gammas += (error / estimate.effective_gamma_std()).powi(2);

            let bias = Statistics::of(&offsets(&square(degrees), &edges)).bias;
            let drifts = edges.iter().flat_map(|side| &side.tone_drift);
            let count = edges.iter().map(|side| side.points.len()).sum::<usize>() as f64;
            let tone_drift = drifts.map(|tone_drift| tone_drift.norm()).sum::<f64>() / count;
            // One square determines gamma less well than three, but twice as well as the prior.
            assert!(estimate.effective_gamma_std() < 0.25 * gamma, "{tone:?}");
            assert!(tone_drift > 0.002, "{tone:?}: {tone_drift}");
            shifts += (bias / tone_drift).powi(2);
        }
        // The sum over four squares of normal errors exceeds 18.5 once in a thousand times.
        assert!(
            gammas < 18.5 && shifts < 18.5,
            "{tone:?}: {gammas} {shifts}"
        );
    }
}

#[test]
fn drift_points_to_the_dark_everywhere() {
    let camera = Camera {
        tone: Tone::Srgb,
        ..CAMERA
    };
    let (edges, _) = measured(&picture(&camera, 17.0, 3), 17.0);
    let corners = square(17.0).corners();
    for (side, edges) in edges.iter().enumerate() {
        let along = (corners[(side + 1) % 4] - corners[side]).normalize();
        for tone_drift in &edges.tone_drift {
            // The inside is dark, and to the right of a clockwise path.
            assert!(along.perp(tone_drift) > 0.0);
            assert!(along.dot(tone_drift).abs() < 0.1 * tone_drift.norm());
        }
    }
}

#[test]
fn clipped_sides_tell_nothing() {
    let camera = Camera {
        outside: 1.02,
        tone: Tone::Srgb,
        ..CAMERA
    };
    let (edges, estimate) = measured(&picture(&camera, 31.0, 5), 31.0);
    assert_eq!(estimate.sides, 0);
    let shift = estimate.shift_std.unwrap();
    for tone_drift in edges.iter().flat_map(|side| &side.tone_drift) {
        assert!((tone_drift.norm() - shift).abs() < 1e-12);
    }
}

/// A picture of a square turned by 17 degrees, sharpened after it was coded.
fn overshot(tone: Tone) -> Picture {
    let camera = Camera {
        tone,
        noise: 1.0 / 255.0,
        ..CAMERA
    };
    let shape = square(17.0);
    let sharp = camera.exposure(&shape);
    let soft = Camera {
        blur: 1.5,
        ..camera
    }
    .exposure(&shape);
    let overshot: Vec<f64> = sharp
        .iter()
        .zip(&soft)
        .map(|(a, b)| a + 0.5 * (a - b))
        .collect();
    camera.bytes(&overshot, 2)
}

/// The effect of sharpening on a coded edge is not attributed to a tone curve.
#[test]
fn overshoot_is_not_taken_for_a_tone_curve() {
    let (_, estimate) = measured(&overshot(Tone::Srgb), 17.0);
    assert!(estimate.shift_std.is_some(), "{estimate:?}");
}

/// Sharpened linear light is as symmetric as blurred light.
#[test]
fn overshoot_of_linear_light_is_linear() {
    let (edges, estimate) = measured(&overshot(Tone::Linear), 17.0);
    check_held(&estimate, 1.0, 17.0, &edges);
}

/// Checks gamma and the position of the edges against the standard deviations of a curve that is
/// held.
fn check_held(estimate: &ToneEstimate, gamma: f64, degrees: f64, edges: &[SpanEdges]) {
    let shift = estimate.held_shift.unwrap();
    let error = estimate.curve.effective_gamma() - gamma;
    let allowed = 4.0 * estimate.effective_gamma_std();
    assert!(error.abs() < allowed, "{estimate:?}");
    let bias = Statistics::of(&offsets(&square(degrees), edges)).bias;
    assert!(bias.abs() < 4.0 * shift, "{bias}, {estimate:?}");
    assert!(matches!(estimate.picture_tone(), PictureTone::Shifted(_, std) if std == shift));
}

/// Light after a filter of three pixels along rows and columns; values at the border are kept.
fn filtered(light: &[f64]) -> Vec<f64> {
    let along = |values: &[f64], step: usize| -> Vec<f64> {
        let mean = |i: usize| 0.25 * values[i - step] + 0.5 * values[i] + 0.25 * values[i + step];
        let inside = step..values.len() - step;
        let indices = 0..values.len();
        indices
            .map(|i| {
                if inside.contains(&i) {
                    mean(i)
                } else {
                    values[i]
                }
            })
            .collect()
    };
    along(&along(light, 1), SIZE)
}

/// A filter on the grid of pixels is symmetric, but its shape depends on the direction of an edge.
/// The even part of the profiles determines the curve of half of the pictures of one square.
#[test]
fn a_filter_on_the_grid_of_pixels_keeps_the_curve() {
    let camera = Camera {
        blur: 0.3,
        noise: 1.0 / 255.0,
        ..CAMERA
    };
    let mut found = 0;
    for (tone, gamma) in [(Tone::Linear, 1.0), (Tone::Gamma(2.2), 2.2)] {
        for (seed, degrees) in (0..).zip(ANGLES) {
            let light = filtered(&camera.exposure(&square(degrees)));
            let coded: Vec<f64> = light.iter().map(|light| tone.encode(*light)).collect();
            let (edges, estimate) = measured(&camera.bytes(&coded, seed), degrees);
            if estimate.held_shift.is_some() {
                found += 1;
                check_held(&estimate, gamma, degrees, &edges);
            }
        }
    }
    assert!(found >= 4, "{found} of 8");
}
