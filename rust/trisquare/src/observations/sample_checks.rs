//! Checks of the samples of a curve in the image, from any source.

use nalgebra::Vector2;

use crate::error::Error;

/// Largest absolute coordinate (px): no picture is as large, and squares of far larger ones
/// overflow.
const LARGEST_COORDINATE: f64 = 1e9;

/// # Errors
/// [`Error::SampleNotFinite`], and [`Error::TooFewSamples`] for fewer than `needed` different
/// places.
pub(crate) fn check_samples(
    figure: usize,
    line: usize,
    points: &[Vector2<f64>],
    needed: usize,
) -> Result<(), Error> {
    check_places(figure, line, points)?;
    // Samples in the same place count once.
    let mut places: Vec<&Vector2<f64>> = Vec::with_capacity(needed);
    for point in points {
        if places.len() == needed {
            break;
        }
        if !places.contains(&point) {
            places.push(point);
        }
    }
    let found = places.len();
    if found < needed {
        return Err(Error::TooFewSamples {
            figure,
            line,
            found,
            needed,
        });
    }
    Ok(())
}

/// # Errors
/// [`Error::SampleNotFinite`] with the first sample that cannot be in a picture.
pub(crate) fn check_places(
    figure: usize,
    line: usize,
    points: &[Vector2<f64>],
) -> Result<(), Error> {
    // The comparison is false for NaN.
    let is_place = |point: &Vector2<f64>| point.iter().all(|v| v.abs() <= LARGEST_COORDINATE);
    match points.iter().position(|point| !is_place(point)) {
        Some(sample) => Err(Error::SampleNotFinite {
            figure,
            line,
            sample,
        }),
        None => Ok(()),
    }
}
