//! Calibrates a camera from pictures of a chessboard whose inner corners are roughly known: `cargo
//! run --release -p trisquare --example chessboard`.

use nalgebra::Vector3;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{Lens, Line, Pose, Tone};

// [recipe]
use nalgebra::Vector2;
use trisquare::{
    Calibration, Chessboard, Error, ImageSize, Options, Picture, PlaneEdges, calibrate,
    localise_with_unknown_tone,
};

/// Inner corners in pixels, `[row][column]`, from any detector, good to a pixel or two.
type Corners = Vec<Vec<Vector2<f64>>>;

/// Measures the edges of a chessboard's cells along all lines through its corners.
fn measured(picture: &Picture, corners: &Corners) -> Result<PlaneEdges, Error> {
    let board = Chessboard::new(picture, corners)?;
    let (lines, _, faults) = localise_with_unknown_tone(picture, &board.spans(0));
    if let Some(mended) = faults.mended(picture) {
        // Colours magnified differently by the lens, or displaced odd rows, are corrected in
        // `mended`.
        return measured(&mended, corners);
    }
    Ok(PlaneEdges {
        side_error: faults.side_error,
        ..board.edges(&lines)?
    })
}

/// Returns the camera of three or more pictures, each of one board.
pub fn camera_of(pictures: &[(Picture, Corners)], size: ImageSize) -> Result<Calibration, Error> {
    let board = |(image, (picture, corners)): (usize, &(Picture, Corners))| {
        let edges = measured(picture, corners).map_err(|error| error.of_figure(image))?;
        Ok(PlaneEdges { image, ..edges })
    };
    let edges: Result<Vec<_>, Error> = pictures.iter().enumerate().map(board).collect();
    calibrate(&edges?, size, &Options::default())
}
// [end of recipe]

/// Number of the board's inner corners in a row, and in a column.
const ACROSS: usize = 9;
const DOWN: usize = 6;

/// Standard deviation of the blur, in pixels, and light of the cells.
const BLUR: f64 = 0.7;
const INK: f64 = 0.05;
const PAPER: f64 = 0.8;

/// Positions of the lines of a board with `inner` inner lines, its outer sides included. The board
/// is as wide as a scene's squares.
fn places(inner: usize) -> impl Iterator<Item = f64> {
    let cells = inner + 1;
    (0..=cells).map(move |line| (line as f64 - 0.5 * cells as f64) / (ACROSS + 1) as f64)
}

/// A blurred step from -1 to 1: the integral of a normal distribution, to within 1e-3.
fn step(blurs: f64) -> f64 {
    (0.797_885 * (blurs + 0.044_715 * blurs.powi(3))).tanh()
}

/// The S-shaped curve with which many cameras increase the contrast of coded values. None of the
/// crate's tone curves describes it, and all edges appear shifted.
fn deepened(coded: f64) -> f64 {
    0.5 * coded + 0.5 * coded.powi(2) * (3.0 - 2.0 * coded)
}

/// Renders a picture of a board of a scene, in 8-bit grey; also returns its corners, rounded to
/// whole pixels.
fn seen(scene: &Scene, pose: &Pose) -> (Picture, Corners) {
    let line = |a, b, c| pose.line_map() * Line::new(a, b, c).unwrap().coefficients();
    let columns: Vec<Vector3<f64>> = places(ACROSS).map(|x| line(1.0, 0.0, -x)).collect();
    let rows: Vec<Vector3<f64>> = places(DOWN).map(|y| line(0.0, 1.0, -y)).collect();
    let mut values = Vec::new();
    for (y, x) in (0..scene.size.height).flat_map(|y| (0..scene.size.width).map(move |x| (y, x))) {
        let pixel = Vector2::new(f64::from(x), f64::from(y));
        let ray = scene.camera.unproject_with_jacobian(&pixel);
        let ray = ray.expect("the lens sees all of the picture");
        // Values from -1 to 1 across each line.
        let steps = |lines: &[Vector3<f64>]| -> Vec<f64> {
            let distance = |line| scene.camera.line_distance(&ray, line);
            lines
                .iter()
                .map(|line| step(distance(line) / BLUR))
                .collect()
        };
        let (across, down) = (steps(&columns), steps(&rows));
        let inside = |steps: &[f64]| 0.25 * (1.0 + steps[0]) * (1.0 - steps[steps.len() - 1]);
        let alternating = |steps: &[f64]| steps[1..steps.len() - 1].iter().product::<f64>();
        let dark = 0.5 * (1.0 + alternating(&across) * alternating(&down));
        let light = PAPER + (INK - PAPER) * dark * inside(&across) * inside(&down);
        values.push((255.0 * deepened(Tone::Srgb.encode(light))).round() as u8);
    }
    let size = [scene.size.width, scene.size.height].map(|length| length as usize);
    let picture = Picture::from_u8(size[0], size[1], 1, values).expect("of that size");
    let corner = |x, y| scene.camera.project(&pose.transform(&Vector2::new(x, y)));
    let row = |y: f64| {
        let inner = places(ACROSS).skip(1).take(ACROSS);
        inner
            .map(|x| corner(x, y).unwrap().map(f64::round))
            .collect()
    };
    let corners = places(DOWN).skip(1).take(DOWN).map(row).collect();
    (picture, corners)
}

/// Returns a scene of 640 x 480 pixels, and a picture of each of its boards.
pub fn made_up(seed: u64) -> (Scene, Vec<(Picture, Corners)>) {
    let size = ImageSize {
        width: 640,
        height: 480,
    };
    let options = SceneOptions {
        size,
        ..SceneOptions::default()
    };
    let scene = Scene::random(seed, options);
    let poses = scene.poses.iter();
    let pictures = poses.map(|pose| seen(&scene, pose)).collect();
    (scene, pictures)
}

fn main() -> Result<(), Error> {
    let (scene, pictures) = made_up(1);
    let found = camera_of(&pictures, scene.size)?;
    for (estimate, truth) in found.estimates().iter().zip(scene.camera.parameters()) {
        println!("{estimate:?}, truth {truth:.4}");
    }
    Ok(())
}
