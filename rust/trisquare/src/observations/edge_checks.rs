//! Checks that a figure's edges have the shapes and values that a calibration needs.

use nalgebra::Vector2;

use super::families::outermost_lines;
use super::plane_edges::{Freedom, PlaneEdges};
use super::sample_checks::check_samples;
use crate::error::Error;
use crate::geometry::{MIN_LINE_SAMPLES, MIN_LINES};
use crate::image_size::ImageSize;

/// Largest distance (px) of a sample beyond the outermost pixels' centres: half a pixel to the
/// border of the picture, and the measurement error.
const BORDER_SLACK: f64 = 2.0;

/// Largest displacement (px) of a sample by one standard deviation of the tone curve: blurs are
/// some pixels at most, and no tone curve displaces an edge by more than its blur.
const LARGEST_DRIFT: f64 = 10.0;

/// Largest displacement (px) of a whole side by a fault of the picture; with a larger one the side
/// is not measured.
const LARGEST_SIDE_ERROR: f64 = 100.0;

/// Range of standard deviations of samples (px) whose squares, and the sums of these, are finite
/// and not zero.
const SMALLEST_STD: f64 = 1e-12;
const LARGEST_STD: f64 = 1e12;

/// Minimum number of samples of a circle, whose image has five parameters.
const MIN_CIRCLE_SAMPLES: usize = 5;

/// Minimum number of samples of a line of the scene: two do not show whether it is bent.
const MIN_SCENE_LINE_SAMPLES: usize = 3;

impl PlaneEdges {
    /// Checks shapes and values; `figure` is the number of this figure in messages.
    ///
    /// # Errors
    /// The first fault found.
    pub fn check(&self, figure: usize) -> Result<(), Error> {
        if self.freedom == Freedom::Line {
            self.check_scene_line(figure)?;
        } else if !self.radii.is_empty() {
            self.check_circles(figure)?;
        } else if self.lines.len() < MIN_LINES && self.freedom != Freedom::Offsets {
            return Err(Error::TooFewLines {
                figure,
                found: self.lines.len(),
                needed: MIN_LINES,
            });
        }
        let curves = self.lines.len() + self.radii.len();
        if self.points.len() != curves {
            return Err(Error::InvalidArgument(format!(
                "figure {figure} has {curves} lines or circles but samples for {}",
                self.points.len()
            )));
        }
        let needed = match self.freedom {
            Freedom::Line => MIN_SCENE_LINE_SAMPLES,
            _ if !self.radii.is_empty() => MIN_CIRCLE_SAMPLES,
            _ => MIN_LINE_SAMPLES,
        };
        for (line, points) in self.points.iter().enumerate() {
            check_samples(figure, line, points, needed)?;
        }
        if self.freedom == Freedom::Offsets {
            outermost_lines(figure, &self.lines, &self.points)?;
        }
        self.check_drift(figure)?;
        if !(0.0..=LARGEST_SIDE_ERROR).contains(&self.side_error) {
            return Err(Error::InvalidArgument(format!(
                "the side error of figure {figure} must be from 0 to {LARGEST_SIDE_ERROR} pixels"
            )));
        }
        if let Some(border) = self.border
            && !(border > 0.0 && border.is_finite())
        {
            return Err(Error::InvalidArgument(format!(
                "the border of figure {figure} must be positive and finite, not {border}"
            )));
        }
        let Some(std) = &self.std else { return Ok(()) };
        let fits = std.len() == self.points.len()
            && std
                .iter()
                .zip(&self.points)
                .all(|(s, p)| s.len() == p.len());
        if !fits {
            return Err(Error::InvalidArgument(format!(
                "figure {figure} needs one standard deviation for every sample"
            )));
        }
        match first_invalid(std, |s| (SMALLEST_STD..=LARGEST_STD).contains(s)) {
            Some((line, sample)) => Err(Error::InvalidArgument(format!(
                "the standard deviation of sample {sample} of line {line} of figure {figure} must be \
                 positive and finite (pixels, {SMALLEST_STD:e} to {LARGEST_STD:e}), not {:e}",
                std[line][sample]
            ))),
            None => Ok(()),
        }
    }

    fn check_scene_line(&self, figure: usize) -> Result<(), Error> {
        if self.lines.len() != 1 || !self.radii.is_empty() || self.plane.is_some() {
            return Err(Error::InvalidArgument(format!(
                "figure {figure} is a line of the scene: it has one line, no circles, and no plane \
                 that it shares"
            )));
        }
        Ok(())
    }

    fn check_circles(&self, figure: usize) -> Result<(), Error> {
        let invalid = |what| Err(Error::InvalidArgument(format!("figure {figure} {what}")));
        if !self.lines.is_empty() || self.freedom == Freedom::Aspect {
            return invalid("has circles: it can have neither lines nor an unknown aspect");
        }
        let known: Vec<f64> = self.radii.iter().flatten().copied().collect();
        let differ = |i: usize| known[..i].iter().all(|radius| *radius != known[i]);
        let valid = known.iter().all(|r| *r > 0.0 && r.is_finite());
        if self.radii[0].is_none() || !valid || !(0..known.len()).all(differ) {
            return invalid(
                "has circles: their radii must be positive, finite and different, and the first \
                 one known",
            );
        }
        Ok(())
    }

    fn check_drift(&self, figure: usize) -> Result<(), Error> {
        let Some(tone_drift) = &self.tone_drift else {
            return Ok(());
        };
        let counts = |all: &[Vec<Vector2<f64>>]| all.iter().map(Vec::len).collect::<Vec<_>>();
        if counts(tone_drift) != counts(&self.points) {
            return Err(Error::InvalidArgument(format!(
                "figure {figure} needs one drift for every sample"
            )));
        }
        let is_drift = |drift: &Vector2<f64>| drift.iter().all(|v| v.abs() <= LARGEST_DRIFT);
        match first_invalid(tone_drift, is_drift) {
            Some((line, sample)) => Err(Error::InvalidArgument(format!(
                "the drift of sample {sample} of line {line} of figure {figure} must be finite, and \
                 not beyond {LARGEST_DRIFT} pixels: no tone curve displaces an edge further"
            ))),
            None => Ok(()),
        }
    }
}

/// Returns the line and the sample of the first invalid value.
fn first_invalid<T>(lines: &[Vec<T>], is_valid: impl Fn(&T) -> bool) -> Option<(usize, usize)> {
    let invalid_sample = |(line, values): (usize, &Vec<T>)| {
        let sample = values.iter().position(|value| !is_valid(value))?;
        Some((line, sample))
    };
    lines.iter().enumerate().find_map(invalid_sample)
}

/// Returns the first figure with samples outside a picture of this size, their number, and the
/// first of them. Mostly the size is that of another picture, or width and height are exchanged.
pub(crate) fn samples_outside(
    edges: &[PlaneEdges],
    size: ImageSize,
) -> Option<(usize, usize, Vector2<f64>)> {
    edges.iter().enumerate().find_map(|(figure, edges)| {
        let is_outside = |point: &&Vector2<f64>| !size.contains(point, BORDER_SLACK);
        let mut outside = edges.points.iter().flatten().filter(is_outside);
        let first = outside.next()?;
        Some((figure, 1 + outside.count(), *first))
    })
}
