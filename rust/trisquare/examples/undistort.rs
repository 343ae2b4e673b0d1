//! Undistorts a grey picture, with a camera or with straight lines: `cargo run --release -p
//! trisquare --example undistort`.

use trisquare::synthetic::{Scene, SceneOptions};

use nalgebra::Matrix3;
use trisquare::{Brown, BrownModel, PointMaps, fit_distortion};

// [recipe]
use nalgebra::Vector2;
use trisquare::{ImageSize, Lens, UndistortedView};

/// Returns an 8-bit grey picture without distortion, and its pinhole camera; pixels outside the
/// photograph are black.
pub fn undistort<L: Lens>(
    values: &[u8],
    size: ImageSize,
    camera: &L,
) -> Result<(Vec<u8>, impl Lens), trisquare::Error> {
    let view = camera.undistorted(size, 0.0)?; // no black border; with 1.0, the whole photograph
    let mut straight = Vec::with_capacity(values.len());
    for y in 0..size.height {
        for x in 0..size.width {
            let ray = view.unproject(&Vector2::new(f64::from(x), f64::from(y)));
            let seen = ray.and_then(|ray| camera.project(&ray));
            straight.push(seen.map_or(0, |pixel| value_at(values, size, &pixel)));
        }
    }
    Ok((straight, view))
}

/// Interpolates bilinearly between four pixels; returns black outside the picture.
fn value_at(values: &[u8], size: ImageSize, pixel: &Vector2<f64>) -> u8 {
    let (width, height) = (size.width as usize, size.height as usize);
    let (far_x, far_y) = ((width - 1) as f64, (height - 1) as f64);
    // Tolerance of half a pixel: pixels of the border lie on it only up to rounding.
    if !(pixel.x > -0.5 && pixel.x < far_x + 0.5 && pixel.y > -0.5 && pixel.y < far_y + 0.5) {
        return 0;
    }
    let (x, y) = (pixel.x.clamp(0.0, far_x), pixel.y.clamp(0.0, far_y));
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let at = |x: usize, y: usize| f64::from(values[y * width + x]);
    let (across, down) = (x - left as f64, y - top as f64);
    let upper = at(left, top) * (1.0 - across) + at(right, top) * across;
    let lower = at(left, bottom) * (1.0 - across) + at(right, bottom) * across;
    (upper * (1.0 - down) + lower * down).round() as u8
}
// [end of recipe]

// [lines]
/// Fits a lens to samples of curves that are straight lines in the scene. Its focal length is made
/// up: the lens undistorts pictures but measures no angles.
pub fn lens_of(curves: &[Vec<Vector2<f64>>], size: ImageSize) -> Result<Brown, trisquare::Error> {
    let found = fit_distortion(curves, size, 2, None)?;
    let (focal, centre) = (f64::from(size.width), found.centre);
    let pinhole = Matrix3::new(focal, 0.0, centre.x, 0.0, focal, centre.y, 0.0, 0.0, 1.0);
    let ideal_radius = |observed| found.ideal_radius(observed);
    let model = BrownModel::Radial3;
    Ok(Brown::from_straightening(
        &pinhole,
        ideal_radius,
        size,
        model,
    ))
}
// [end of lines]

/// Returns the images of some straight lines under a camera.
pub fn curves(camera: &impl Lens, size: ImageSize) -> Vec<Vec<Vector2<f64>>> {
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let places = |line: i32, i: i32| {
        let (along, across) = (f64::from(i) / 79.0, f64::from(line) / 7.0);
        let slope = 0.05 * height * (along - across);
        Vector2::new(0.1 + 0.8 * along, 0.1 + 0.8 * across)
            .component_mul(&Vector2::new(width, height))
            + Vector2::new(0.0, slope)
    };
    let line = |line| (0..80).map(move |i| places(line, i)).collect::<Vec<_>>();
    let seen = (0..8).map(|i| camera.distort_pixels(&line(i)));
    seen.flatten().collect()
}

/// Renders a camera's picture of a striped wall, 2 units away.
pub fn stripes(camera: &impl Lens, size: ImageSize) -> Vec<u8> {
    let mut values = Vec::new();
    for y in 0..size.height {
        for x in 0..size.width {
            let ray = camera.unproject(&Vector2::new(f64::from(x), f64::from(y)));
            let wave = ray.map_or(0.0, |ray| (40.0 * ray.x / ray.z).sin());
            values.push((128.0 + 100.0 * wave).round() as u8);
        }
    }
    values
}

fn main() -> Result<(), trisquare::Error> {
    let scene = Scene::random(1, SceneOptions::default());
    let photograph = stripes(&scene.camera, scene.size);
    let (straight, view) = undistort(&photograph, scene.size, &scene.camera)?;
    let expected = stripes(&view, scene.size);
    let errors = straight.iter().zip(&expected);
    let worst = errors.map(|(a, b)| a.abs_diff(*b)).max();
    println!(
        "camera matrix of the new picture: {:.2}",
        view.camera_matrix()
    );
    println!("worst error, of 255: {}", worst.unwrap_or(0));

    let lens = lens_of(&curves(&scene.camera, scene.size), scene.size)?;
    let (_, view) = undistort(&photograph, scene.size, &lens)?;
    println!("by straight lines alone: {:.2}", view.camera_matrix());
    Ok(())
}
