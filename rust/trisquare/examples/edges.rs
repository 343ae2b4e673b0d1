//! Calibrates cameras from samples along the edges of squares:
//! `cargo run --release -p trisquare --example edges`.

use nalgebra::Vector2;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Calibration, Error, ErrorKind, Fisheye, FisheyeModel, ImageSize, Lens, Options, PlaneEdges,
    Severity, calibrate, calibrate_by_evidence,
};

/// `squares[i][side]` holds the samples along one side, in pixels.
fn camera_of(squares: Vec<Vec<Vec<Vector2<f64>>>>) -> Result<Calibration, Error> {
    let edges: Result<Vec<_>, _> = squares.into_iter().map(PlaneEdges::square).collect();
    let size = ImageSize {
        width: 1280,
        height: 960,
    };
    calibrate(&edges?, size, &Options::default())
}

// [several pictures]
/// Calibrates from several pictures: `pictures[i]` holds the squares in picture `i`.
fn camera_of_several(
    pictures: Vec<Vec<PlaneEdges>>,
    size: ImageSize,
) -> Result<Calibration, Error> {
    let mut edges = Vec::new();
    for (image, squares) in pictures.into_iter().enumerate() {
        edges.extend(squares.into_iter().map(|own| PlaneEdges { image, ..own }));
    }
    calibrate(&edges, size, &Options::default())
}
// [end of several pictures]

// [answer]
/// Prints the result of a calibration.
fn tell<L: Lens>(found: &Result<Calibration<L>, Error>) {
    let calibration = match found {
        Ok(calibration) => calibration,
        Err(Error::NotEnoughPlanes { found, needed, .. }) => {
            return println!("{found} square(s), but {needed} are needed");
        }
        Err(error) if error.kind() == ErrorKind::DegenerateGeometry => {
            return println!("take another photograph: {error}");
        }
        Err(error) => return println!("{error}"),
    };
    for estimate in calibration.estimates() {
        let (name, value) = (estimate.name, estimate.value);
        match estimate.std {
            // The 95 % interval is 1.96 standard deviations to either side.
            Some(std) => println!("{name:4} {value:12.5} +- {:.5}", 1.96 * std),
            None => println!("{name:4} {value:12.5} fixed"),
        }
    }
    println!("rms {:.4} px", calibration.rms);
    for warning in &calibration.warnings {
        if warning.severity() > Severity::Low {
            println!("{}: {warning}", warning.code());
        }
    }
}
// [end of answer]

// [evidence]
/// Calibrates with the lens model that has the largest evidence, and prints the odds of the others.
fn with_best_model(edges: &[PlaneEdges], size: ImageSize) -> Result<Calibration, Error> {
    let photographs = None; // edges alone; with a picture, `Some(&Photographs { .. })`
    let found = calibrate_by_evidence(edges, size, &Options::default(), photographs)?;
    println!("model {:?}", found.model);
    for other in &found.alternatives {
        println!("{:?}: odds {:.1e}", other.model, other.log_evidence.exp());
    }
    Ok(found.calibration)
}
// [end of evidence]

// [fisheye]
/// Calibrates a fisheye; also returns the angle, in degrees, between its axis and the ray of a
/// pixel, or `None` where the lens has no ray for the pixel.
fn fisheye_of(
    edges: &[PlaneEdges],
    size: ImageSize,
    pixel: &Vector2<f64>,
) -> Result<(Calibration<Fisheye>, Option<f64>), Error> {
    let options = Options {
        model: FisheyeModel::Fisheye2,
        ..Options::new()
    };
    let found: Calibration<Fisheye> = calibrate(edges, size, &options)?;
    let ray = found.camera.unproject(pixel); // of length 1; beyond 90 degrees, z is negative
    let degrees = ray.map(|ray| ray.z.acos().to_degrees());
    Ok((found, degrees))
}
// [end of fisheye]

fn main() -> Result<(), Error> {
    let scene = Scene::random(1, SceneOptions::default());
    let squares = scene.edges(2, 0.05, 4.0).into_iter().map(|e| e.points);
    let squares: Vec<_> = squares.collect();
    println!("true camera: {:.5?}", scene.camera.parameters());
    println!("One picture:");
    tell(&camera_of(squares.clone()));
    println!("One square of it:");
    tell(&camera_of(squares[..1].to_vec()));
    println!("Two pictures:");
    let pictures = vec![
        scene.edges(2, 0.05, 4.0),
        scene.another(3).edges(4, 0.05, 4.0),
    ];
    tell(&camera_of_several(pictures, scene.size));

    println!("One picture, with the model of the largest evidence:");
    tell(&with_best_model(&scene.edges(2, 0.05, 4.0), scene.size));

    let truth = Fisheye::new([700.0, 701.0, 642.0, 477.0, 0.03, -0.01, 0.0, 0.0]);
    let wide = Scene::seen_by(truth, 1, SceneOptions::default());
    let corner = Vector2::zeros();
    let (found, degrees) = fisheye_of(&wide.edges(2, 0.05, 4.0), wide.size, &corner)?;
    println!("A fisheye, whose first pixel sees {degrees:.1?} degrees from the axis:");
    tell(&Ok(found));
    Ok(())
}
