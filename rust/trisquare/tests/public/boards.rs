//! Cameras calibrated with the functions of the example.

#[path = "../../examples/boards.rs"]
#[allow(dead_code)] // its `main`
mod example;

use example::cameras;
use trisquare::Lens;
use trisquare::synthetic::{Scene, SceneOptions};

#[test]
fn the_recipes_find_the_camera() {
    for seed in 1..4 {
        let scene = Scene::random(seed, SceneOptions::default());
        for found in cameras(&scene).unwrap() {
            let pairs = found.camera.parameters().into_iter();
            for (own, truth) in pairs.zip(scene.camera.parameters()) {
                assert!(
                    (own - truth).abs() < 1e-6 * truth.abs().max(1.0),
                    "{own} {truth}"
                );
            }
            assert_eq!(found.planes.len(), 3);
        }
    }
}
