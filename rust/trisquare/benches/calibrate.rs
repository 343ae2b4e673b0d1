//! Speed of the crate alone: `cargo bench -p trisquare`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{Method, Options, calibrate};

/// Samples about a pixel apart: some 4,000 on the twelve sides.
const SPACING: f64 = 1.0;
const NOISE: f64 = 0.1;

fn edges_to_camera(criterion: &mut Criterion) {
    let scene = Scene::random(3, SceneOptions::default());
    let edges = scene.edges(1, NOISE, SPACING);
    for (name, method) in [
        ("maximum likelihood", Method::MaximumLikelihood),
        ("linear", Method::Linear),
    ] {
        let options = Options {
            method,
            ..Options::default()
        };
        criterion.bench_function(name, |bencher| {
            bencher.iter(|| calibrate(black_box(&edges), scene.size, &options));
        });
    }
}

criterion_group!(benches, edges_to_camera);
criterion_main!(benches);
