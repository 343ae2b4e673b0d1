//! Calibrates cameras from planes with several figures each: frames, sheets of squares, and boards
//! whose corners come from a detector: `cargo run --release -p trisquare --example boards`.

use nalgebra::Vector2;
use trisquare::synthetic::{Scene, SceneOptions};
use trisquare::{
    Brown, Calibration, Error, Freedom, Lens, Line, Options, PlaneEdges, Pose, calibrate,
};

/// Samples along the four sides of a square, in pixels.
type Sides = Vec<Vec<Vector2<f64>>>;

// [frame]
/// Returns a frame from the sides of its two outlines; `plane` is a different number for each
/// frame.
fn frame(plane: u64, outer: Sides, inner: Sides) -> Result<[PlaneEdges; 2], Error> {
    let outer = PlaneEdges {
        plane: Some(plane),
        ..PlaneEdges::square(outer)?
    };
    let inner = PlaneEdges {
        plane: Some(plane),
        freedom: Freedom::Size, // concentric, equal orientation; the size of the hole is estimated
        ..PlaneEdges::square(inner)?
    };
    Ok([outer, inner])
}
// [end of frame]

// [sheet]
/// Returns one square of a sheet, at a known `centre` and with a known `side`. The sheet's X runs
/// along side 0, its Y along side 1, and the sides are in clockwise order on the screen.
fn on_sheet(
    plane: u64,
    sides: Sides,
    centre: Vector2<f64>,
    side: f64,
) -> Result<PlaneEdges, Error> {
    let square = PlaneEdges::square(sides)?; // side 1, centred on the origin
    let placed = |line: &Line| {
        let [a, b, c] = line.coefficients().into();
        Line::new(a, b, side * c - a * centre.x - b * centre.y)
    };
    let lines = square.lines.iter().map(placed).collect::<Result<_, _>>()?;
    Ok(PlaneEdges {
        lines,
        plane: Some(plane),
        freedom: Freedom::Fixed,
        ..square
    })
}
// [end of sheet]

// [board]
/// Returns a chessboard from its inner corners, `corners[row][column]` in pixels, with standard
/// deviation `std`. The figure's lines are the grid lines; each corner is a sample of the two lines
/// through it. On the screen, the direction from row to row is clockwise from that from column to
/// column.
fn board(corners: &[Vec<Vector2<f64>>], std: f64) -> Result<PlaneEdges, Error> {
    let (rows, columns) = (corners.len(), corners[0].len());
    let mut lines = Vec::new();
    let mut points = Vec::new();
    for (row, own) in corners.iter().enumerate() {
        lines.push(Line::new(0.0, 1.0, -(row as f64))?); // y = row; the unit is a cell
        points.push(own.clone());
    }
    for column in 0..columns {
        lines.push(Line::new(1.0, 0.0, -(column as f64))?);
        points.push((0..rows).map(|row| corners[row][column]).collect());
    }
    Ok(PlaneEdges {
        std: Some(points.iter().map(|own| vec![std; own.len()]).collect()),
        ..PlaneEdges::new(lines, points)
    })
}
// [end of board]

/// Returns the pixel of a point of a plane.
fn seen(camera: &Brown, pose: &Pose, x: f64, y: f64) -> Vector2<f64> {
    let point = pose.transform(&Vector2::new(x, y));
    camera.project(&point).expect("the scene is in sight")
}

/// Returns samples along the sides of a square of a plane, clockwise.
fn sides_of(camera: &Brown, pose: &Pose, centre: Vector2<f64>, side: f64) -> Sides {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    let corner = |i: usize| centre + side * Vector2::from(corners[i % 4]);
    let sample = |i: usize, part: f64| corner(i) + part * (corner(i + 1) - corner(i));
    let side_of = |i: usize| {
        let points = (1..20).map(|k| sample(i, f64::from(k) / 20.0));
        points.map(|p| seen(camera, pose, p.x, p.y)).collect()
    };
    (0..4).map(side_of).collect()
}

/// Returns the cameras calibrated from frames, from sheets and from boards, from samples without
/// noise.
pub fn cameras(scene: &Scene) -> Result<[Calibration; 3], Error> {
    let camera = &scene.camera;
    let planes = || (0..).zip(&scene.poses);
    let calibrated = |edges: &[PlaneEdges]| calibrate(edges, scene.size, &Options::default());
    let square = |pose: &Pose, x, side| sides_of(camera, pose, Vector2::new(x, 0.0), side);

    let mut frames = Vec::new();
    for (plane, pose) in planes() {
        frames.extend(frame(
            plane,
            square(pose, 0.0, 1.0),
            square(pose, 0.0, 0.6),
        )?);
    }
    let mut sheets = Vec::new();
    for (plane, pose) in planes() {
        for (x, side) in [(-0.25, 0.3), (0.2, 0.5)] {
            let centre = Vector2::new(x, 0.0);
            sheets.push(on_sheet(plane, square(pose, x, side), centre, side)?);
        }
    }
    let mut boards = Vec::new();
    for (_, pose) in planes() {
        let row = |y: usize| {
            let place = |k: usize| 0.15 * k as f64 - 0.45;
            (0..7)
                .map(|x| seen(camera, pose, place(x), place(y)))
                .collect()
        };
        boards.push(board(&(0..6).map(row).collect::<Vec<_>>(), 0.1)?);
    }
    Ok([
        calibrated(&frames)?,
        calibrated(&sheets)?,
        calibrated(&boards)?,
    ])
}

fn main() -> Result<(), Error> {
    let scene = Scene::random(1, SceneOptions::default());
    println!("true camera: {:.5?}", scene.camera.parameters());
    for (name, found) in ["frames", "sheets", "boards"].iter().zip(cameras(&scene)?) {
        println!("{name}: {:.5?}", found.camera.parameters());
    }
    Ok(())
}
