//! Order of the sides of a square, from samples of sides that may bulge.

use nalgebra::Vector2;

use super::sample_checks::check_samples;
use crate::error::Error;
use crate::geometry::{Line, MIN_LINE_SAMPLES};
use crate::numeric::upper_median;

/// Distance beyond a corner, in units of the side, at which samples are still accepted: sides that
/// bulge under distortion meet elsewhere than their lines.
const CORNER_SLACK: f64 = 0.25;

/// Order of the sides of a square on the screen (x right, y down).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SideOrder {
    Clockwise,
    CounterClockwise,
}

impl SideOrder {
    pub fn of(sides: &[Vec<Vector2<f64>>]) -> Result<Self, Error> {
        if sides.len() > 4 {
            return Err(Error::InvalidArgument(format!(
                "a square or a rectangle has 4 sides, not {}",
                sides.len()
            )));
        }
        if sides.len() < 4 {
            return Err(Error::TooFewLines {
                figure: 0,
                found: sides.len(),
                needed: 4,
            });
        }
        for (side, points) in sides.iter().enumerate() {
            check_samples(0, side, points, MIN_LINE_SAMPLES)?;
        }
        let line = |side: usize, neighbour: usize| {
            let near = nearer_half(&sides[side], &sides[neighbour]);
            Line::fit(near.iter().map(|p| (*p, 1.0))).ok_or(Error::TooFewSamples {
                figure: 0,
                line: side,
                found: 1,
                needed: MIN_LINE_SAMPLES,
            })
        };
        let crossed = |side| Error::CrossedSides { figure: 0, side };
        let mut corners = [Vector2::zeros(); 4];
        for side in 0..4 {
            let before = (side + 3) % 4;
            let (line_before, line_after) = (line(before, side)?, line(side, before)?);
            let corner = line_before.intersection(&line_after);
            corners[side] = corner.ok_or(crossed(side))?;
        }
        let mut turns = [0.0; 4];
        for side in 0..4 {
            let (start, end) = (corners[side], corners[(side + 1) % 4]);
            let along = end - start;
            let is_between_corners = sides[side].iter().all(|p| {
                let fraction = (p - start).dot(&along) / along.norm_squared();
                (-CORNER_SLACK..=1.0 + CORNER_SLACK).contains(&fraction)
            });
            if !is_between_corners {
                return Err(crossed(side));
            }
            turns[side] = along.perp(&(corners[(side + 2) % 4] - end));
        }
        if turns.iter().all(|t| *t > 0.0) {
            Ok(Self::Clockwise)
        } else if turns.iter().all(|t| *t < 0.0) {
            Ok(Self::CounterClockwise)
        } else {
            let side = turns.iter().position(|t| *t <= 0.0).unwrap_or(0);
            Err(crossed(side))
        }
    }
}

/// Returns the sample without which the sides are in order, if it is the one farthest from the
/// middle of its side.
pub(super) fn stray_sample(sides: &[Vec<Vector2<f64>>]) -> Option<Error> {
    (0..sides.len()).find_map(|line| {
        let sample = farthest(&sides[line])?;
        let mut remaining = sides.to_vec();
        remaining[line].remove(sample);
        SideOrder::of(&remaining).ok()?;
        Some(Error::StraySample {
            figure: 0,
            line,
            sample,
        })
    })
}

/// Returns the index of the sample that is farthest from the median of all; `None` if there is
/// none.
fn farthest(side: &[Vector2<f64>]) -> Option<usize> {
    let median = |axis: usize| upper_median(side.iter().map(|point| point[axis]).collect());
    let middle = Vector2::new(median(0)?, median(1)?);
    let distance = |i: &usize| (side[*i] - middle).norm();
    (0..side.len()).max_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Returns the half of a side's samples that is nearer to its neighbour, because a side may bulge.
fn nearer_half(side: &[Vector2<f64>], neighbour: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let centre = neighbour.iter().sum::<Vector2<f64>>() / neighbour.len() as f64;
    let mut samples = side.to_vec();
    samples.sort_by(|a, b| (a - centre).norm().total_cmp(&(b - centre).norm()));
    samples.truncate(samples.len().div_ceil(2).max(2));
    samples
}
