//! Checks for figures that are given twice, or that are stated to coincide with another figure of
//! their plane but are seen beside it.

use std::collections::HashMap;

use nalgebra::Vector2;

use super::plane_edges::{Freedom, PlaneEdges};
use crate::error::Error;
use crate::geometry::Line;

/// Distance from a line, as a fraction of half its length, above which samples belong to another
/// line; the bends of both lines are added.
const COINCIDENCE_TOLERANCE: f64 = 0.01;

/// # Errors
/// [`Error::InvalidArgument`] if a figure is given twice: its noise would count as that of two
/// measurements.
pub(super) fn check_duplicates(edges: &[PlaneEdges]) -> Result<(), Error> {
    let mut known: HashMap<[u64; 2], usize> = HashMap::new();
    for (index, figure) in edges.iter().enumerate() {
        let Some(first) = figure.points.iter().flatten().next() else {
            continue;
        };
        let bits = [first.x, first.y].map(f64::to_bits);
        let earlier = *known.entry(bits).or_insert(index);
        if earlier != index && edges[earlier].points == figure.points {
            return Err(Error::InvalidArgument(format!(
                "figure {index} has the samples of figure {earlier}: give each measurement once"
            )));
        }
    }
    Ok(())
}

/// # Errors
/// [`Error::InvalidArgument`] if a figure is fixed on the lines of an earlier one of its plane, but
/// its samples lie beside them, such as a frame's inner outline of which only the samples were
/// given.
pub(super) fn check_place(index: usize, edges: &[PlaneEdges]) -> Result<(), Error> {
    let figure = &edges[index];
    if figure.plane.is_none() || figure.freedom != Freedom::Fixed {
        return Ok(());
    }
    let earlier = (0..index).filter(|other| edges[*other].plane == figure.plane);
    let is_fixed =
        |(place, other): &(usize, usize)| *place == 0 || edges[*other].freedom == Freedom::Fixed;
    let mut fixed = earlier.enumerate().filter(is_fixed);
    match fixed.find(|(_, other)| is_displaced(figure, &edges[*other])) {
        None => Ok(()),
        Some((_, other)) => Err(Error::InvalidArgument(format!(
            "the lines of figure {index}, which is fixed on its plane, coincide with those of figure \
             {other}, but its samples lie beside them: an inner outline of a frame has the freedom \
             \"size\"; a figure at a known place on the plane has lines that lie there"
        ))),
    }
}

/// Whether a figure has the lines of another one, but samples beside the other's samples.
fn is_displaced(figure: &PlaneEdges, other: &PlaneEdges) -> bool {
    let mut is_displaced = false;
    for (line, points) in figure.lines.iter().zip(&figure.points) {
        let Some(twin) = other.lines.iter().position(|twin| twin == line) else {
            return false;
        };
        let twin = other.points.get(twin).and_then(|points| chord(points));
        if let (Some((middle, _, slack)), Some((_, line, twin_slack))) = (chord(points), twin) {
            is_displaced |= line.distance(&middle).abs() > slack + twin_slack;
        }
    }
    is_displaced
}

/// Returns the middle of samples, the line fitted to them, and the largest distance from it at
/// which a sample may lie.
fn chord(points: &[Vector2<f64>]) -> Option<(Vector2<f64>, Line, f64)> {
    let line = Line::fit(points.iter().map(|point| (*point, 1.0)))?;
    let middle = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
    let distances = points.iter().map(|point| line.distance(point).abs());
    let lengths = points.iter().map(|point| (point - middle).norm());
    let slack = distances.fold(0.0, f64::max) + COINCIDENCE_TOLERANCE * lengths.fold(0.0, f64::max);
    Some((middle, line, slack))
}
