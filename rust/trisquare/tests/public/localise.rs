//! Localisation in pictures whose edges are known exactly.

use crate::edge_scene::{
    BLACK, CAMERA, Camera, Noise, SIZE, Shape, Statistics, WHITE, measured, offsets, patch_bound,
    spans, square, statistics,
};
use nalgebra::Vector2;
use trisquare::{EdgeSpan, NoEdge, Picture, Tone, localise, localise_with_unknown_tone};

#[track_caller]
fn assert_sound(statistics: &Statistics) {
    assert!(statistics.count > 2500, "{statistics:?}");
    assert!(statistics.bias.abs() < 0.002, "{statistics:?}");
    assert!(
        (0.9..1.1).contains(&statistics.normalised),
        "{statistics:?}"
    );
    assert!(statistics.neighbours.abs() < 0.1, "{statistics:?}");
}

#[test]
fn samples_are_unbiased_independent_and_at_the_bound() {
    for blur in [0.5, 0.7, 1.0, 1.5] {
        let camera = Camera { blur, ..CAMERA };
        let statistics = statistics(camera, Tone::Linear, [2.0, -1.0]);
        assert_sound(&statistics);
        let efficiency = statistics.rms / patch_bound(&camera);
        assert!(
            (0.95..1.08).contains(&efficiency),
            "blur {blur}: {efficiency} {statistics:?}"
        );
    }
}

#[test]
fn the_usual_picture_gives_a_hundredth_of_a_pixel() {
    let statistics = statistics(CAMERA, Tone::Linear, [0.0; 2]);
    assert!((0.009..0.0105).contains(&statistics.rms), "{statistics:?}");
}

#[test]
fn the_tone_curve_is_modelled() {
    for tone in [Tone::Srgb, Tone::Gamma(2.2)] {
        let camera = Camera { tone, ..CAMERA };
        assert_sound(&statistics(camera, tone, [1.0, 0.0]));
    }
}

#[test]
fn ignoring_the_tone_curve_moves_edges_towards_the_dark() {
    let camera = Camera {
        tone: Tone::Srgb,
        ..CAMERA
    };
    let statistics = statistics(camera, Tone::Linear, [1.0, 0.0]);
    // Positive values are inside the dark square.
    assert!(statistics.bias > 0.1, "{statistics:?}");
}

#[test]
fn a_light_square_on_dark_ground_does_as_well() {
    let camera = Camera {
        inside: WHITE,
        outside: BLACK,
        ..CAMERA
    };
    assert_sound(&statistics(camera, Tone::Linear, [0.0; 2]));
}

#[test]
fn shading_along_the_side_is_modelled() {
    let camera = Camera {
        shading: 0.04,
        tone: Tone::Srgb,
        ..CAMERA
    };
    assert_sound(&statistics(camera, Tone::Srgb, [0.0; 2]));
}

#[test]
fn a_coarse_path_three_pixels_off_gives_the_same_samples() {
    for error in [[3.0, 3.0], [-3.0, -3.0], [3.0, -3.0]] {
        assert_sound(&statistics(CAMERA, Tone::Linear, error));
    }
}

#[test]
fn noise_blur_and_plateaus_are_reported() {
    let shape = square(17.0);
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 5);
    for edges in measured(&picture, &spans(&shape, -1.0, |_| [0.0; 2]), Tone::Linear) {
        assert!(
            (edges.blur - (0.49_f64 + 1.0 / 12.0).sqrt()).abs() < 0.02,
            "{}",
            edges.blur
        );
        assert!((edges.dark - BLACK).abs() < 0.5 / 255.0, "{}", edges.dark);
        assert!((edges.light - WHITE).abs() < 0.5 / 255.0, "{}", edges.light);
        // Rounding to levels adds a variance of 1/12; some 700 pixels determine the noise to 3 %.
        let noise = (4.0_f64 + 1.0 / 12.0).sqrt() / 255.0;
        assert!(
            (edges.noise / noise - 1.0).abs() < 0.12,
            "{}",
            edges.noise * 255.0
        );
    }
}

#[test]
fn samples_reach_the_blur_of_the_corners() {
    let shape = square(31.0);
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 6);
    let corners = shape.corners();
    // The paths end 3 pixels too early or too late.
    for late in [-3.0, 3.0] {
        let mut spans = spans(&shape, -1.0, |_| [1.0, 1.0]);
        for span in &mut spans {
            let along = (span.path[1] - span.path[0]).normalize();
            span.path[0] -= late * along;
            span.path[1] += late * along;
        }
        for (side, edges) in measured(&picture, &spans, Tone::Linear).iter().enumerate() {
            let ends = [
                edges.points[0] - corners[side],
                edges.points[edges.points.len() - 1] - corners[(side + 1) % 4],
            ];
            for end in ends {
                // 2.5 blurs of 0.76 px, plus half a patch.
                assert!((3.0..5.0).contains(&end.norm()), "{}", end.norm());
            }
        }
    }
}

#[test]
fn every_pixel_type_gives_the_same_edges() {
    let shape = square(17.0);
    let exposure = CAMERA.exposure(&shape);
    let words = exposure
        .iter()
        .map(|value| (value * 65535.0).round() as u16)
        .collect();
    let pictures = [
        Camera {
            noise: 0.0,
            ..CAMERA
        }
        .bytes(&exposure, 0),
        Picture::from_u16(SIZE, SIZE, 1, words).unwrap(),
        Camera {
            noise: 0.0,
            ..CAMERA
        }
        .floats(&exposure, 0),
    ];
    // Without noise, the remaining error is rounding and, for the finer types, the difference
    // between a pixel's square box and the model's Gaussian.
    for (picture, tolerance) in pictures.iter().zip([0.004, 0.0015, 0.0015]) {
        let edges = measured(picture, &spans(&shape, -1.0, |_| [1.0, 2.0]), Tone::Linear);
        let all = offsets(&shape, &edges);
        assert!(all.iter().map(Vec::len).sum::<usize>() > 250);
        for (offset, _) in all.iter().flatten() {
            assert!(offset.abs() < tolerance, "{offset}");
        }
    }
}

#[test]
fn tinted_paper_is_mixed_in_light() {
    let shape = square(17.0);
    let tone = Tone::Srgb;
    let paper = [120.0 / 255.0, 200.0 / 255.0, 240.0 / 255.0];
    let channels = paper.map(|outside| {
        Camera {
            tone,
            outside,
            ..CAMERA
        }
        .exposure(&shape)
    });
    let mut noise = Noise(8);
    let mut values = Vec::new();
    for index in 0..SIZE * SIZE {
        for channel in &channels {
            values.push(((channel[index] + CAMERA.noise * noise.normal()) * 255.0).round() as u8);
        }
    }
    let picture = Picture::from_u8(SIZE, SIZE, 3, values).unwrap();
    let edges = measured(&picture, &spans(&shape, -1.0, |_| [1.0, 2.0]), tone);
    let statistics = Statistics::of(&offsets(&shape, &edges));
    assert!(statistics.bias.abs() < 0.002, "{statistics:?}");
    assert!(
        (0.8..1.2).contains(&statistics.normalised),
        "{statistics:?}"
    );
}

#[test]
fn curved_edges_are_followed() {
    // An arc of 300 pixels with a height of 16, as a strong distortion produces.
    let (centre, radius) = ([200.0, 900.0], 700.0);
    let shape = Shape::Disc { centre, radius };
    let exposure = CAMERA.exposure(&shape);
    let at = |degrees: f64, out: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Vector2::new(
            centre[0] + (radius + out) * sin,
            centre[1] - (radius + out) * cos,
        )
    };
    let path = vec![at(-12.0, 2.0), at(-4.0, 3.0), at(4.0, 0.0), at(12.0, -2.0)];
    let spans = [EdgeSpan::new(path, -1.0)];
    let mut sides = Vec::new();
    for seed in 0..24 {
        let edges = measured(&CAMERA.bytes(&exposure, seed), &spans, Tone::Linear).remove(0);
        let centre = Vector2::new(centre[0], centre[1]);
        let offsets = edges
            .points
            .iter()
            .map(|point| radius - (point - centre).norm());
        sides.push(offsets.zip(edges.std.iter().copied()).collect::<Vec<_>>());
    }
    let statistics = Statistics::of(&sides);
    assert!(statistics.count > 24 * 65, "{statistics:?}");
    assert!(statistics.bias.abs() < 0.002, "{statistics:?}");
    assert!(
        (0.9..1.1).contains(&statistics.normalised),
        "{statistics:?}"
    );
}

#[test]
fn small_chessboard_cells_are_measured_between_their_crossings() {
    let (origin, cell) = ([100.3, 120.6], 26.0);
    let exposure = CAMERA.exposure(&Shape::Board { origin, cell });
    let corner = |column: usize, row: usize| {
        Vector2::new(
            origin[0] + column as f64 * cell,
            origin[1] + row as f64 * cell,
        )
    };
    // The four sides of the light cell in the middle of the upper row, clockwise.
    let square = [corner(1, 0), corner(2, 0), corner(2, 1), corner(1, 1)];
    let inner: Vec<EdgeSpan> = (1_usize..4)
        .map(|side| EdgeSpan {
            bounds: [side.checked_sub(2), Some(side).filter(|&next| next < 3)],
            ..EdgeSpan::new(vec![square[side], square[(side + 1) % 4]], 1.0)
        })
        .collect();
    let mut lower = Vec::new();
    for seed in 0..40 {
        let edges = measured(&CAMERA.bytes(&exposure, seed), &inner, Tone::Linear);
        let edge = &edges[1];
        assert!(edge.points.len() >= 5, "{}", edge.points.len());
        let offsets = edge.points.iter().map(|point| square[2].y - point.y);
        lower.push(offsets.zip(edge.std.iter().copied()).collect::<Vec<_>>());
    }
    let statistics = Statistics::of(&lower);
    assert!(statistics.bias.abs() < 0.003, "{statistics:?}");
    assert!(
        (0.85..1.2).contains(&statistics.normalised),
        "{statistics:?}"
    );
}

#[test]
fn the_other_edge_of_a_thin_frame_does_no_harm() {
    for thickness in [5.0, 6.0, 8.0, 11.0] {
        let (centre, half, degrees) = ([209.3, 210.8], 135.2, 31.0);
        let shape = Shape::Frame {
            centre,
            half,
            degrees,
            thickness,
        };
        let exposure = CAMERA.exposure(&shape);
        let mut sides = Vec::new();
        for seed in 0..6 {
            let picture = CAMERA.bytes(&exposure, seed);
            let edges = measured(
                &picture,
                &spans(&shape, -1.0, |_| [1.0, -1.0]),
                Tone::Linear,
            );
            sides.extend(offsets(&shape, &edges));
        }
        let statistics = Statistics::of(&sides);
        assert!(statistics.bias.abs() < 0.002, "{thickness}: {statistics:?}");
        assert!(
            (0.9..1.1).contains(&statistics.normalised),
            "{thickness}: {statistics:?}"
        );
    }
}

#[test]
fn a_span_that_bounds_itself_is_measured_all_the_same() {
    let shape = square(17.0);
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 1);
    let mut spans = spans(&shape, -1.0, |_| [0.0; 2]);
    spans[0].bounds = [Some(0), Some(0)];
    assert!(measured(&picture, &spans, Tone::Linear)[0].points.len() > 60);
}

#[test]
fn a_side_cut_by_the_border_has_samples_inside_only() {
    let shape = Shape::Square {
        centre: [340.0, 210.0],
        half: 120.0,
        degrees: 12.0,
    };
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 3);
    let (found, ..) = localise(
        &picture,
        &spans(&shape, -1.0, |_| [1.0, -1.0]),
        Tone::Linear,
    );
    // The upper side leaves the picture on the right; the right side is wholly outside.
    assert_eq!(found[1].as_ref().unwrap_err(), &NoEdge::OutsidePicture);
    for side in [0, 2, 3] {
        let edges = found[side].as_ref().unwrap();
        assert!(edges.points.len() > 25, "{}", edges.points.len());
        let inside = edges
            .points
            .iter()
            .all(|point| point.x < SIZE as f64 && point.x > 0.0);
        assert!(inside, "{:?}", edges.points.last());
    }
    let cut: Vec<_> = [0, 2]
        .iter()
        .map(|&side| found[side].clone().unwrap())
        .collect();
    let distances = offsets(&shape, &[cut[0].clone(), cut[0].clone(), cut[1].clone()]);
    for side in [0, 2] {
        let statistics = Statistics::of(&distances[side..=side]);
        assert!(
            statistics.rms < 0.014 && statistics.bias.abs() < 0.006,
            "{statistics:?}"
        );
    }
}

#[test]
fn dirt_on_the_edge_costs_samples_not_accuracy() {
    let shape = square(3.0);
    let mut exposure = CAMERA.exposure(&shape);
    let corners = shape.corners();
    let dirt = corners[0].lerp(&corners[1], 0.4);
    for (index, value) in exposure.iter_mut().enumerate() {
        let pixel = Vector2::new((index % SIZE) as f64, (index / SIZE) as f64);
        if (pixel - dirt).norm() < 12.0 {
            *value = 0.5;
        }
    }
    let edges = measured(
        &CAMERA.bytes(&exposure, 4),
        &spans(&shape, -1.0, |_| [0.0; 2]),
        Tone::Linear,
    );
    let top = &offsets(&shape, &edges)[0];
    assert!((50..64).contains(&top.len()), "{}", top.len());
    let near_dirt = |point: &Vector2<f64>| (point - dirt).norm() < 16.0;
    for ((offset, std), point) in top.iter().zip(&edges[0].points) {
        assert!(
            near_dirt(point) || offset.abs() < 4.5 * std,
            "{offset} at {point}"
        );
    }
}

#[test]
fn specks_hardly_cost_anything() {
    let shape = square(17.0);
    let exposure = CAMERA.exposure(&shape);
    let mut noise = Noise(11);
    let mut sides = Vec::new();
    for seed in 0..8 {
        let mut speckled = exposure.clone();
        for value in &mut speckled {
            if noise.uniform() < 0.01 {
                *value = noise.uniform();
            }
        }
        let picture = CAMERA.bytes(&speckled, seed);
        let edges = measured(&picture, &spans(&shape, -1.0, |_| [1.0, 1.0]), Tone::Linear);
        sides.extend(offsets(&shape, &edges));
    }
    let statistics = Statistics::of(&sides);
    // Out of 2150. If specks counted in full, one in a hundred pixels would cost 150 samples and 16
    // %.
    assert!(statistics.count > 2100, "{statistics:?}");
    assert!(
        (0.9..1.1).contains(&statistics.normalised),
        "{statistics:?}"
    );
}

fn path(points: &[[f64; 2]]) -> EdgeSpan {
    let path = points.iter().map(|&[x, y]| Vector2::new(x, y)).collect();
    EdgeSpan::new(path, 1.0)
}

#[test]
fn where_there_is_no_edge_the_reason_is_told() {
    let mut noise = Noise(9);
    let grain = (0..SIZE * SIZE)
        .map(|_| (128.0 + 3.0 * noise.normal()) as u8)
        .collect();
    let pictures = [
        Picture::from_u8(SIZE, SIZE, 1, vec![0; SIZE * SIZE]).unwrap(),
        Picture::from_f32(SIZE, SIZE, 1, vec![0.7; SIZE * SIZE]).unwrap(),
        Picture::from_u8(SIZE, SIZE, 1, grain).unwrap(),
        Picture::from_f32(SIZE, SIZE, 1, vec![f32::NAN; SIZE * SIZE]).unwrap(),
        Picture::from_u8(1, 1, 3, vec![9; 3]).unwrap(),
    ];
    let spans = [
        path(&[[50.0, 60.0], [300.0, 90.0]]),
        path(&[[50.0, 60.0], [66.0, 60.0]]),
        path(&[[900.0, 60.0], [1200.0, 60.0]]),
        path(&[[-1e300, 0.0], [1e300, 1e300]]),
        path(&[[5.0, 5.0], [5.0, 5.0]]),
        path(&[[5.0, f64::NAN], [50.0, 5.0]]),
        path(&[[5.0, 5.0]]),
        path(&[]),
    ];
    for picture in &pictures {
        for tone in [Tone::Linear, Tone::Srgb, Tone::Gamma(2.2)] {
            let (found, ..) = localise(picture, &spans, tone);
            assert!(found.iter().all(Result::is_err), "{found:?}");
            assert_eq!(found[2].as_ref().unwrap_err(), &NoEdge::OutsidePicture);
            assert_eq!(found[7].as_ref().unwrap_err(), &NoEdge::NoPath);
        }
    }
}

#[test]
fn what_no_picture_could_make_right_is_told_as_that() {
    let shape = square(17.0);
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 1);
    let good = spans(&shape, -1.0, |_| [0.0; 2]);
    let (found, ..) = localise(&picture, &good, Tone::Linear);
    assert!(found.iter().all(Result::is_ok), "{found:?}");
    type Change = fn(&mut EdgeSpan);
    let changes: [(Change, &str); 7] = [
        (|span| span.polarity = 0.0, "polarity"),
        (|span| span.polarity = f64::NAN, "polarity"),
        (|span| span.bounds[1] = Some(4), "bounds"),
        (|span| span.far_edge = Some(4), "far edge"),
        (|span| span.crossings = vec![(None, 0); 5], "crossings"),
        (|span| span.margin[0] = f64::NAN, "margins"),
        (|span| span.margin[1] = -1.0, "margins"),
    ];
    for (change, expected) in changes {
        let mut bad = good.clone();
        change(&mut bad[2]);
        for (found, ..) in [
            localise(&picture, &bad, Tone::Linear),
            localise_with_unknown_tone(&picture, &bad),
        ] {
            let refused = matches!(
                found[2],
                Err(NoEdge::InvalidArgument(reason)) if reason.contains(expected)
            );
            assert!(refused, "{expected}: {:?}", found[2]);
            assert!(found[0].is_ok(), "{:?}", found[0]);
        }
    }
    for gamma in [0.0, -1.0, f64::NAN] {
        let (found, ..) = localise(&picture, &good, Tone::Gamma(gamma));
        assert_eq!(found.len(), good.len());
        for found in found {
            assert!(matches!(
                found,
                Err(NoEdge::InvalidArgument(reason)) if reason.contains("gamma")
            ));
        }
    }
}

#[test]
fn the_wrong_polarity_is_no_edge() {
    let shape = square(17.0);
    let picture = CAMERA.bytes(&CAMERA.exposure(&shape), 1);
    let (found, ..) = localise(&picture, &spans(&shape, 1.0, |_| [0.0; 2]), Tone::Linear);
    for found in found {
        assert_eq!(found.unwrap_err(), NoEdge::Inconsistent);
    }
}

proptest::proptest! {
    #[test]
    fn nothing_panics_and_nothing_is_nan(
        seed in 0_u64..1000,
        points in proptest::collection::vec((-60.0..120.0_f64, -60.0..120.0_f64), 2..6),
        polarity in -1.0..1.0_f64,
    ) {
        let mut noise = Noise(seed);
        let values = (0..60 * 60).map(|index| {
            let stripe = f64::from(u8::from(index % 60 / 13 % 2 == 0));
            (40.0 + 150.0 * stripe + 9.0 * noise.normal()) as u8
        }).collect();
        let picture = Picture::from_u8(60, 60, 1, values).unwrap();
        let path = points.iter().map(|&(x, y)| Vector2::new(x, y)).collect();
        let span = EdgeSpan { bounds: [Some(1), Some(0)], ..EdgeSpan::new(path, polarity) };
        let other = EdgeSpan { bounds: [Some(0), None], ..EdgeSpan::new(vec![Vector2::new(26.0, 5.0), Vector2::new(26.0, 50.0)], -1.0) };
        for edges in localise(&picture, &[span, other], Tone::Srgb).0.into_iter().flatten() {
            let sound = edges.std.iter().all(|std| *std > 0.0 && std.is_finite());
            proptest::prop_assert!(sound && edges.points.len() == edges.std.len());
            proptest::prop_assert!(edges.points.iter().all(|point| point.iter().all(|v| v.is_finite())));
        }
    }
}

/// Run with `cargo test --release -p trisquare --test public time_of_three_squares -- --ignored
/// --nocapture`.
#[test]
#[ignore = "prints a time, and tells nothing on a busy machine"]
fn time_of_three_squares() {
    for tone in [Tone::Linear, Tone::Srgb] {
        let shape = Shape::Square {
            centre: [209.3, 210.8],
            half: 175.0,
            degrees: 8.0,
        };
        let camera = Camera { tone, ..CAMERA };
        let picture = camera.bytes(&camera.exposure(&shape), 1);
        let square = spans(&shape, -1.0, |_| [2.0, -1.0]);
        let mut all = Vec::new();
        for first in [0, 4, 8] {
            all.extend(square.iter().cloned().map(|mut span| {
                span.bounds = span.bounds.map(|bound| bound.map(|bound| bound + first));
                span
            }));
        }
        let mut times: Vec<_> = (0..100)
            .map(|_| {
                let start = std::time::Instant::now();
                assert!(localise(&picture, &all, tone).0.iter().all(Result::is_ok));
                start.elapsed()
            })
            .collect();
        times.sort();
        println!(
            "{tone:?}: 12 spans of 350 pixels in {:?} (median of 100)",
            times[50]
        );
    }
}

/// Returns a light square of 270 pixels on a ground whose light changes along the sides.
fn on_changing_ground(noise: f64) -> (Picture, Shape) {
    let tone = Tone::Srgb;
    let shape = square(3.0);
    let of_ground = |outside: f64| {
        let camera = Camera {
            blur: 1.0,
            inside: WHITE,
            outside,
            tone,
            ..CAMERA
        };
        camera.exposure(&shape)
    };
    let (dark, light) = (of_ground(BLACK), of_ground(0.5));
    let mixed = |(index, (dark, light)): (usize, (&f64, &f64))| {
        let (x, y) = ((index % SIZE) as f64, (index / SIZE) as f64);
        let share = 0.5 + 0.5 * ((x + y) / 80.0).sin();
        let decoded = [*dark, *light].map(|value| tone.decode(value));
        tone.encode(decoded[0] + share * (decoded[1] - decoded[0]))
    };
    let exposure: Vec<f64> = dark.iter().zip(&light).enumerate().map(mixed).collect();
    let camera = Camera { noise, ..CAMERA };
    (camera.bytes(&exposure, 1), shape)
}

#[test]
fn light_that_changes_beside_a_side_moves_no_edge() {
    let (picture, shape) = on_changing_ground(2.0 / 255.0);
    let of_sides = |is_beside_others: bool| {
        let mut sides = spans(&shape, 1.0, |_| [0.0; 2]);
        for side in &mut sides {
            side.is_beside_others = is_beside_others;
        }
        let edges = measured(&picture, &sides, Tone::Srgb);
        Statistics::of(&offsets(&shape, &edges))
    };
    let (in_pieces, whole) = (of_sides(true), of_sides(false));
    assert!(in_pieces.count > 220, "{in_pieces:?}");
    assert!(in_pieces.bias.abs() < 0.01, "{in_pieces:?}");
    assert!(in_pieces.normalised < 1.2, "{in_pieces:?}");
    assert!(in_pieces.rms < 0.5 * whole.rms, "{in_pieces:?}, {whole:?}");
}
