//! The example's undistorted picture is that of its pinhole, and the undistorted lines are
//! straight.

#[path = "../../examples/undistort.rs"]
#[allow(dead_code)] // its `main`
mod example;

use nalgebra::Vector2;
use trisquare::{Brown, ImageSize, Lens, PointMaps};

#[test]
fn the_example_shows_what_a_pinhole_sees() {
    let size = ImageSize {
        width: 160,
        height: 120,
    };
    let camera = Brown::new([200.0, 202.0, 81.0, 58.0, -0.25, 0.06, 0.0, 1e-3, -1e-3]);
    let photograph = example::stripes(&camera, size);
    let (straight, view) = example::undistort(&photograph, size, &camera).unwrap();
    let expected = example::stripes(&view, size);
    assert_eq!(straight.len(), expected.len());
    // A wave of amplitude a and w radians per pixel deviates from its chord by at most a w^2 / 8;
    // two values are rounded, and the lens compresses a little at the border.
    let (amplitude, per_pixel) = (100.0, 1.3 * 40.0 / 200.0);
    let most = amplitude * per_pixel * per_pixel / 8.0 + 1.0;
    for (own, other) in straight.iter().zip(&expected) {
        assert!(f64::from(own.abs_diff(*other)) <= most, "{own} {other}");
    }
    let same = photograph.iter().zip(&expected);
    assert!(same.map(|(a, b)| a.abs_diff(*b)).max().unwrap() > 50);
}

#[test]
fn the_lens_of_the_examples_lines_makes_them_straight() {
    let size = ImageSize {
        width: 1280,
        height: 960,
    };
    let camera = Brown::new([900.0, 905.0, 645.0, 470.0, -0.2, 0.05, 0.0, 0.0, 0.0]);
    let curves = example::curves(&camera, size);
    let lens = example::lens_of(&curves, size).unwrap();
    assert_eq!(curves.len(), 8);
    // Returns the largest distance of a sample from the chord.
    let bow = |line: &[Vector2<f64>]| {
        let along = (line[line.len() - 1] - line[0]).normalize();
        let bows = line.iter().map(|p| along.perp(&(p - line[0])).abs());
        bows.fold(0.0, f64::max)
    };
    for curve in &curves {
        let straight = bow(&lens.undistort_pixels(curve).unwrap());
        // A polynomial of two coefficients from observed to ideal only approximates this lens.
        assert!(straight < 0.25, "{straight} of {}", bow(curve));
    }
    let bent = bow(&curves[0]);
    assert!(bent > 10.0, "{bent}");
    assert!(lens.focal() != camera.focal());
}
