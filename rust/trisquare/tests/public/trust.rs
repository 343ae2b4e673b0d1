//! Violations of the assumptions that the residuals show are found, named and taken into account.

use std::cmp::Reverse;

use nalgebra::Vector2;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Calibration, Error, Lens, Line, Options, PlaneEdges, Severity, Warning, calibrate,
};

const NO_NOISE: f64 = 0.0;
const NOISE: f64 = 0.2;
const SPACING: f64 = 4.0;

/// Threshold on errors in standard deviations, which one normal error in fifteen thousand exceeds.
const SURE: f64 = 4.0;

fn scene(seed: u64) -> Scene {
    Scene::random(seed, SceneOptions::default())
}

fn solve(edges: &[PlaneEdges], scene: &Scene) -> Calibration {
    calibrate(edges, scene.size, &Options::default()).unwrap()
}

/// Displaces each sample of a side across its chord, by a function of its position (-1 to 1).
fn displace(side: &mut [Vector2<f64>], mut by: impl FnMut(f64) -> f64) {
    let (first, last) = (side[0], side[side.len() - 1]);
    let along = (last - first).normalize();
    let across = Vector2::new(-along.y, along.x);
    let length = (last - first).norm();
    for point in side {
        let place = 2.0 * (*point - first).dot(&along) / length - 1.0;
        *point += across * by(place);
    }
}

/// Returns the largest error of `fx, fy, cx, cy, k1, k2` in standard deviations.
fn worst(found: &Calibration, scene: &Scene) -> f64 {
    let (value, truth) = (found.camera.parameters(), scene.camera.parameters());
    let std = found.std();
    assert!(std[5].0 == "k2");
    (0..6)
        .map(|i| ((value[i] - truth[i]) / std[i].1).abs())
        .fold(0.0, f64::max)
}

/// Turns a square into a rectangle of 1.1 to 1.
fn falsify(edges: &mut PlaneEdges) {
    for (line, offset) in edges.lines.iter_mut().zip([0.55, 0.5, 0.55, 0.5]) {
        let normal = line.normal();
        *line = Line::new(normal.x, normal.y, offset).unwrap();
    }
}

#[test]
fn independent_noise_is_taken_for_what_it_is() {
    for seed in 0..10 {
        let scene = scene(seed);
        let found = solve(&scene.edges(seed, NOISE, SPACING), &scene);
        assert!(found.warnings.is_empty(), "seed {seed}: {found:?}");
        let residual_correlation = &found.residual_correlation;
        assert!(
            !residual_correlation.is_likely(),
            "seed {seed}: {residual_correlation:?}"
        );
        assert_eq!(residual_correlation.between_plane_variance_ratio, 1.0);
        assert_eq!(residual_correlation.displacements.len(), 3);
        // Six lags taken as significant would make it 1.8; one makes it 1.15.
        assert!(
            (1.0..1.3).contains(&residual_correlation.neighbours),
            "{residual_correlation:?}"
        );
        for (i, (name, std)) in found.std().iter().enumerate() {
            let part = residual_correlation.added[(i, i)] / (std * std);
            assert!((0.0..0.5).contains(&part), "seed {seed}: {name} {part}");
        }
    }
}

#[test]
fn exact_samples_have_no_coherence() {
    let scene = scene(1);
    let found = solve(&scene.edges(0, NO_NOISE, SPACING), &scene);
    assert_eq!(found.residual_correlation.probability, 0.0);
    assert_eq!(found.residual_correlation.added.norm(), 0.0);
    assert!(found.warnings.is_empty());
}

#[test]
fn a_bent_side_is_rejected() {
    let mut named = 0;
    let seeds = 8;
    for seed in 0..seeds {
        let (plane, side) = (seed as usize % 3, seed as usize % 4);
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NOISE, SPACING);
        let bow = 20.0 * NOISE;
        displace(&mut edges[plane].points[side], |s| bow * (1.0 - s * s));
        let found = match calibrate(&edges, scene.size, &Options::default()) {
            // A bent side may make the geometry look ill-conditioned before it is detected.
            Err(Error::IllConditioned(_)) => continue,
            found => found.unwrap(),
        };
        let error = worst(&found, &scene);
        assert!(error < SURE, "seed {seed}: off by {error} std");
        // The rms of the parabola is 0.73 of its height.
        named += usize::from(found.warnings.iter().any(|warning| {
            matches!(warning, Warning::SideRejected { plane: p, figure: 0, side: s, distance }
                if (*p, *s) == (plane, side) && *distance > 0.25 * bow)
        }));
    }
    // Where either of two sides explains the bend, none is named and the uncertainty grows instead.
    assert!(named >= seeds as usize - 2, "named in {named} of {seeds}");
}

/// Number of scenes, each with a square with bent sides.
const BENT_SCENES: usize = 8;

/// Returns the number of scenes with a warning for which `named` is true, given the plane and the
/// first bent side. `bows` maps that side to the bent sides and the heights of their arcs, in
/// pixels. Every answer must be within `SURE` standard deviations.
fn named_where_bent(
    bows: impl Fn(usize) -> [(usize, f64); 2],
    named: impl Fn(&Warning, usize, usize) -> bool,
) -> usize {
    let noise = 0.01;
    let count = |seed: usize| {
        let (plane, side) = (seed % 3, seed % 4);
        let scene = scene(seed as u64);
        let mut edges = scene.edges(seed as u64, noise, SPACING);
        for (side, bow) in bows(side) {
            displace(&mut edges[plane].points[side], |s| bow * (1.0 - s * s));
        }
        let found = solve(&edges, &scene);
        let error = worst(&found, &scene);
        assert!(error < SURE, "seed {seed}: off by {error} std");
        let is_named = |warning: &Warning| named(warning, plane, side);
        usize::from(found.warnings.iter().any(is_named))
    };
    (0..BENT_SCENES).map(count).sum()
}

#[test]
fn the_far_more_bent_of_two_bent_sides_is_rejected() {
    // A sheet bent about an axis that is nearly parallel to two of its sides.
    let bows = |side: usize| [(side, 0.8), ((side + 2) % 4, 0.06)];
    let named = named_where_bent(bows, |warning, plane, side| {
        matches!(warning, Warning::SideRejected { plane: p, side: s, .. }
            if (*p, *s) == (plane, side))
    });
    assert!(
        named >= BENT_SCENES - 1,
        "named in {named} of {BENT_SCENES}"
    );
}

#[test]
fn a_square_of_which_two_sides_are_bent_is_rejected() {
    let bows = |_| [(0, 0.8), (2, 0.8)];
    let named = named_where_bent(
        bows,
        |warning, plane, _| matches!(warning, Warning::PlaneRejected { plane: p, .. } if *p == plane),
    );
    // Where a wrong lens bends the sides of the others as well, the square stays, with large
    // standard deviations.
    assert!(
        named >= BENT_SCENES / 2,
        "named in {named} of {BENT_SCENES}"
    );
}

#[test]
fn a_false_plane_among_five_is_rejected() {
    for seed in 0..6 {
        let plane = seed as usize % 3;
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NOISE, SPACING);
        // With a second picture by the same camera, the true squares are the majority.
        edges.extend(scene.another(100 + seed).edges(seed + 1, NOISE, SPACING));
        falsify(&mut edges[plane]);
        let found = solve(&edges, &scene);
        let error = worst(&found, &scene);
        assert!(error < SURE, "seed {seed}: off by {error} std");
        assert!(
            matches!(found.warnings[..], [Warning::PlaneRejected { plane: p, .. }] if p == plane),
            "seed {seed}: {:?}",
            found.warnings
        );
    }
}

#[test]
fn a_rough_plane_does_not_poison_the_rest() {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..6 {
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NOISE, SPACING);
        edges[0] = scene.edges(seed, 5.0 * NOISE, SPACING).swap_remove(0);
        let found = solve(&edges, &scene);
        let error = worst(&found, &scene);
        assert!(error < SURE, "seed {seed}: off by {error} std");
        assert!(found.warnings.is_empty(), "seed {seed}: {found:?}");
        let ratio = found.planes[0].rms / found.planes[1].rms;
        assert!((4.0..6.0).contains(&ratio), "seed {seed}: {ratio}");
        let calm = solve(&scene.edges(seed, NOISE, SPACING), &scene);
        for ((_, rough), (_, calm)) in found.std().iter().zip(calm.std()) {
            sum += rough / calm;
            count += 1.0;
        }
    }
    // With equal weights, it would be the root of the mean of all variances, 3.
    assert!(sum / count < 2.4, "{}", sum / count);
}

#[test]
fn sides_that_err_together_are_told() {
    for seed in 0..6 {
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NOISE, SPACING);
        let mut rng = StdRng::seed_from_u64(seed);
        for side in edges.iter_mut().flat_map(|e| &mut e.points) {
            let [shift, turn, bend] = [0; 3].map(|_| NOISE * rng.sample::<f64, _>(StandardNormal));
            displace(side, |s| shift + turn * s + bend * (1.5 * s * s - 0.5));
        }
        let found = solve(&edges, &scene);
        let residual_correlation = &found.residual_correlation;
        assert!(
            residual_correlation.is_likely(),
            "seed {seed}: {residual_correlation:?}"
        );
        // One, a third and a fifth of the variance of the noise.
        let expected = NOISE * f64::sqrt(1.0 + 1.0 / 3.0 + 1.0 / 5.0);
        for displacement in &residual_correlation.displacements {
            let ratio = displacement / expected;
            assert!(
                (0.3..3.0).contains(&ratio),
                "seed {seed}: {residual_correlation:?}"
            );
        }
        let told = |found: &Calibration| {
            let told = found.warnings.iter().find_map(|warning| match warning {
                Warning::SidesErrTogether { plane, factor, .. } => Some((*plane, *factor)),
                _ => None,
            });
            told.expect("a warning")
        };
        let (plane, factor) = told(&found);
        assert!(plane < 3 && factor > 2.0, "seed {seed}: {factor}");
        // A side error stated beforehand enters the standard deviations and is not reported as
        // found.
        for figure in &mut edges {
            figure.side_error = 10.0 * expected;
        }
        let stated = solve(&edges, &scene);
        assert!(stated.std()[0].1 > 3.0 * found.std()[0].1, "seed {seed}");
        let shown = told(&stated).1;
        assert!(shown < 1.1 * factor, "seed {seed}: {shown}, not {factor}");
    }
}

#[test]
fn correlated_neighbours_are_told() {
    let correlation: f64 = 0.5;
    let seeds = 6;
    let mut mean = 0.0;
    for seed in 0..seeds {
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NO_NOISE, SPACING);
        let mut rng = StdRng::seed_from_u64(seed);
        for side in edges.iter_mut().flat_map(|e| &mut e.points) {
            let mut error: f64 = rng.sample(StandardNormal);
            displace(side, |_| {
                let fresh: f64 = rng.sample(StandardNormal);
                error = correlation * error + (1.0 - correlation.powi(2)).sqrt() * fresh;
                NOISE * error
            });
        }
        mean += solve(&edges, &scene).residual_correlation.neighbours / seeds as f64;
    }
    // (1 + c) / (1 - c) is 3; the first lag alone gives 2.
    assert!((2.0..3.6).contains(&mean), "{mean}");
}

#[test]
fn what_a_stretch_makes_of_two_planes_is_told() {
    let scene = scene(2);
    let edges = scene.edges(2, NOISE, SPACING);
    let told = |edges: &[PlaneEdges]| {
        let warnings = solve(edges, &scene).warnings;
        warnings.iter().find_map(|own| match own {
            Warning::TargetsUnchecked { planes, change, .. } => Some((*planes, *change)),
            _ => None,
        })
    };
    let (planes, change) = told(&edges[..2]).unwrap();
    assert_eq!(planes, 2);
    assert!(change > 0.0);
    assert_eq!(told(&edges), None);
}

#[test]
fn the_most_severe_warnings_come_first() {
    for seed in 1..4 {
        let scene = scene(seed);
        let mut edges = scene.edges(seed, NOISE, SPACING);
        edges.iter_mut().for_each(falsify);
        let warnings = solve(&edges, &scene).warnings;
        assert!(warnings.is_sorted_by_key(|own| Reverse(own.severity())));
        // Found after less severe warnings, as a consequence of them.
        let late = |own: &Warning| matches!(own, Warning::BarelyDetermined { .. });
        assert!(warnings.iter().any(late), "seed {seed}: {warnings:?}");
        let last = warnings[warnings.len() - 1].severity();
        assert!(last < Severity::High, "seed {seed}: {warnings:?}");
    }
}
