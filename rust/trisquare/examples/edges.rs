//! Calibrates a camera from samples along the edges of three squares:
//! `cargo run -p trisquare --example edges`.

use nalgebra::Vector2;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{Calibration, Error, ImageSize, Lens, Options, PlaneEdges, calibrate};

/// `squares[i][side]` holds the samples along one side, in pixels.
fn camera_of(squares: Vec<Vec<Vec<Vector2<f64>>>>) -> Result<Calibration, Error> {
    let edges: Result<Vec<_>, _> = squares.into_iter().map(PlaneEdges::square).collect();
    let size = ImageSize {
        width: 1280,
        height: 960,
    };
    calibrate(&edges?, size, &Options::default())
}

fn main() -> Result<(), Error> {
    let scene = Scene::random(1, SceneOptions::default());
    let squares = scene.edges(2, 0.05, 4.0).into_iter().map(|e| e.points);
    let found = camera_of(squares.collect())?;
    for (estimate, truth) in found.estimates().iter().zip(scene.camera.parameters()) {
        let (name, value) = (estimate.name, estimate.value);
        match estimate.std {
            Some(std) => println!("{name:4} {value:12.5} +- {std:.5}   truth {truth:12.5}"),
            None => println!("{name:4} {value:12.5} held         truth {truth:12.5}"),
        }
    }
    println!("rms {:.4} px", found.rms);
    Ok(())
}
