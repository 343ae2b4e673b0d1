//! Calibrates a camera from a picture of three dark squares whose outlines are roughly known:
//! `cargo run --release -p trisquare --example picture`.

use trisquare::Lens;
use trisquare::synthetic::{Scene, SceneOptions};

// [recipe]
use nalgebra::Vector2;
use trisquare::{
    Calibration, EdgeSpan, ImageSize, Options, Photographs, Picture, PlaneEdges, Polarity,
    calibrate_photographs, localise_with_unknown_tone, pixels_to_keep,
};

/// Returns the four sides of a dark square from its corners (pixels, clockwise on the screen, to
/// within a pixel or two); `first` is the index of the first side among all spans.
fn sides_between(corners: &[Vector2<f64>; 4], first: usize) -> [EdgeSpan; 4] {
    [0, 1, 2, 3].map(|side| {
        let path = vec![corners[side], corners[(side + 1) % 4]];
        // Darker to the right of the path, which is the inside.
        let mut span = EdgeSpan::new(path, -1.0);
        span.bounds = [Some(first + (side + 3) % 4), Some(first + (side + 1) % 4)];
        span
    })
}

/// Returns the camera of a picture from the corners of three or more dark squares.
fn camera_of(
    picture: &Picture,
    squares: &[[Vector2<f64>; 4]],
) -> Result<Calibration, Box<dyn std::error::Error>> {
    // 1. Measure the edges along all sides, to some hundredths of a pixel, and estimate the tone
    // curve.
    let spans = squares.iter().enumerate();
    let spans: Vec<_> = spans.flat_map(|(i, c)| sides_between(c, 4 * i)).collect();
    let (sides, tone, faults) = localise_with_unknown_tone(picture, &spans);
    if let Some(mended) = faults.mended(picture) {
        // Colours magnified differently by the lens, or displaced odd rows, are corrected in
        // `mended`.
        return camera_of(&mended, squares);
    }

    // 2. Group the sides by square; leave out squares with a side that could not be measured.
    let mut edges = Vec::new();
    for (i, sides) in sides.chunks(4).enumerate() {
        let sides: Vec<_> = match sides.iter().map(Result::as_ref).collect() {
            Ok(sides) => sides,
            Err(reason) => {
                eprintln!("square {i} is left out: {reason}");
                continue;
            }
        };
        let points = sides.iter().map(|side| side.points.clone()).collect();
        let mut square = PlaneEdges::square(points)?;
        square.std = Some(sides.iter().map(|side| side.std.clone()).collect());
        // Remaining errors of the tone curve and of the picture's faults displace many samples
        // together.
        square.tone_drift = Some(sides.iter().map(|side| side.tone_drift.clone()).collect());
        square.side_error = faults.side_error;
        square.polarity = Some(Polarity::DarkInside);
        edges.push(square);
    }

    // 3. Calibrate: linear steps, maximum likelihood over the samples, then over the pixels.
    let size = ImageSize {
        width: u32::try_from(picture.width())?,
        height: u32::try_from(picture.height())?,
    };
    let blur = sides
        .iter()
        .flatten()
        .map(|side| side.blur)
        .fold(0.0, f64::max);
    let photographs = Photographs {
        pictures: &[&pixels_to_keep(picture, &edges, blur)],
        tones: &[tone.picture_tone()],
    };
    let found = calibrate_photographs(&edges, size, &Options::default(), Some(&photographs))?;
    Ok(found)
}
// [end of recipe]

/// A synthetic picture of 8-bit grey values, as `Picture::from_u8` takes them from any decoder.
fn scene() -> Scene {
    let size = ImageSize {
        width: 640,
        height: 480,
    };
    Scene::random(
        1,
        SceneOptions {
            size,
            ..SceneOptions::default()
        },
    )
}

/// Calibrates from the picture of a scene, given corners with errors of up to half a pixel.
pub fn calibration_of(scene: &Scene) -> Result<Calibration, Box<dyn std::error::Error>> {
    let picture = scene.picture(2, 0.6, 2.0);
    let corners = scene.corners().into_iter();
    let rough: Vec<_> = corners
        .map(|square| square.map(|corner| corner.map(f64::round)))
        .collect();
    camera_of(&picture, &rough)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = scene();
    let found = calibration_of(&scene)?;
    for (estimate, truth) in found.estimates().iter().zip(scene.camera.parameters()) {
        let (name, value) = (estimate.name, estimate.value);
        match estimate.std {
            Some(std) => println!("{name:4} {value:10.4} +- {std:.4}   truth {truth:10.4}"),
            None => println!("{name:4} {value:10.4} fixed       truth {truth:10.4}"),
        }
    }
    println!("{:?}, rms {:.4} px", found.stage, found.rms);
    for warning in &found.warnings {
        println!("{}: {warning}", warning.code());
    }
    Ok(())
}
