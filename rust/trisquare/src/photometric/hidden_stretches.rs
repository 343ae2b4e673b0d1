//! Detection of covered stretches of an outline from many pixels together.
//!
//! The rim of a stain or the flank of a glare changes each pixel by less than makes it an outlier,
//! but it shows in the mean over a stretch. Rings around an outline that are not plain are detected
//! in the same way.

use super::band_pixels::PixelFigure;
use super::coverage::PLATEAU;
use super::figure_chart::all_distances;
use super::scene::Scene;
use crate::lens::Lens;
use crate::numeric::median_scale;

/// Distance (px) from the outline below which pixels show the edge; the others show the light
/// beside it. Each of the three zones is tested separately.
const EDGE_ZONE: f64 = 2.5;
const ZONES: usize = 3;

/// Distance (px) from the outline up to which pixels are tested: farther away there may be the rim
/// of a sheet or a frame's other outline, and what hides an edge extends to the edge.
const JUDGED: f64 = 6.0;

/// Limit of a pixel's residual, in standard deviations: a speck is not a stretch.
const MAX_DEVIATIONS: f64 = 10.0;

/// Threshold above which a zone's mean is disturbed, in its standard deviations, or, if the figure
/// fits less well, in typical deviations of the figure's zones.
const DISTURBED: f64 = 5.0;

/// Maximum fraction of a side that may be disturbed: with more, the side does not fit the model and
/// is not taken for covered.
const MAX_PART: f64 = 0.5;

/// Fraction of a side below which a disturbance is not reported.
const MIN_REPORTED: f64 = 0.05;

/// A side of a figure that is used only in part.
#[derive(Debug, Clone, Copy)]
pub(super) struct DisturbedSide {
    pub plane: usize,
    pub figure: usize,
    pub side: usize,
    /// Fraction of the side that is not used.
    pub part: f64,
    /// Whether something covers it: the light beside the edge is disturbed as well.
    pub is_hidden: bool,
}

/// The stretches of a figure that are not to be used.
pub(super) struct Disturbed {
    pub stretches: Vec<bool>,
    /// Stretches with disturbed light beside the edge. A disturbed edge alone may be due to a
    /// displaced edge.
    beside_edge: Vec<bool>,
}

/// Residuals of the pixels of a figure, in units of their noise and clamped; `None` if the lens
/// does not see the figure.
pub(super) fn departures<L: Lens>(scene: &Scene<'_, L>, noise: f64) -> Option<Vec<f64>> {
    let figure = scene.figure;
    let distances = all_distances(scene, figure, |pixel| scene.may_cut(pixel))?;
    let pixels = figure.pixels.iter().zip(&distances);
    let departures = pixels.map(|(pixel, distances)| {
        let distances = scene.may_cut(pixel).then_some(distances);
        let residual = scene.shade(pixel, distances).residual / noise;
        residual.clamp(-MAX_DEVIATIONS, MAX_DEVIATIONS)
    });
    Some(departures.collect())
}

/// Sum and number of some residuals.
type Sum = (f64, f64);

/// The sum over its standard deviation.
fn deviation((sum, count): &Sum) -> f64 {
    sum / f64::max(*count, 1.0).sqrt()
}

/// Threshold of disturbed deviations, given all deviations of a figure.
fn limit(deviations: impl Iterator<Item = f64>) -> f64 {
    DISTURBED * median_scale(deviations).max(1.0)
}

/// Distance (px) from the outline up to which the light beside it is plain along every side: a
/// sheet may end farther away, and its blurred end would shift the edge. Disturbed stretches are
/// ignored. `blur` is that of the edge (px).
pub(super) fn plain_reach(
    figure: &PixelFigure,
    departures: &[f64],
    disturbed: &Disturbed,
    blur: f64,
) -> f64 {
    // Indexed by ring of 1 px, side, and whether it is outside.
    let mut rings: Vec<[[Sum; 2]; 4]> = Vec::new();
    for (pixel, departure) in figure.pixels.iter().zip(departures) {
        if disturbed.stretches[usize::from(pixel.stretch)] {
            continue;
        }
        let ring = pixel.depth().abs() as usize;
        rings.resize(rings.len().max(ring + 1), Default::default());
        let side = usize::from(figure.stretch_sides[usize::from(pixel.stretch)]);
        let (sum, count) = &mut rings[ring][side][usize::from(pixel.depth() < 0.0)];
        *sum += departure;
        *count += 1.0;
    }
    let all = rings.iter().flat_map(|ring| ring.as_flattened());
    let limit = limit(all.map(deviation));
    let is_plain = |ring: &[[Sum; 2]; 4]| {
        let mut sums = ring.as_flattened().iter();
        sums.all(|sum| deviation(sum).abs() < limit)
    };
    let edge_rings = (PLATEAU * blur) as usize;
    let first_disturbed = rings
        .iter()
        .skip(edge_rings)
        .position(|ring| !is_plain(ring));
    // What disturbs a ring already affects the ring before it.
    first_disturbed.map_or(f64::INFINITY, |ring| (edge_rings + ring) as f64 - 1.0)
}

/// Finds the stretches of a figure that are not to be used.
pub(super) fn disturbed(figure: &PixelFigure, departures: &[f64]) -> Disturbed {
    let mut sums = vec![[Sum::default(); ZONES]; figure.stretch_sides.len()];
    let pixels = figure.pixels.iter().zip(departures);
    for (pixel, departure) in pixels.filter(|(pixel, _)| pixel.depth().abs() < JUDGED) {
        let zone =
            1 + usize::from(pixel.depth() > EDGE_ZONE) - usize::from(pixel.depth() < -EDGE_ZONE);
        let (sum, count) = &mut sums[usize::from(pixel.stretch)][zone];
        *sum += departure;
        *count += 1.0;
    }
    let limit = limit(sums.iter().flatten().map(deviation));
    let is_disturbed = |zone: &Sum| deviation(zone).abs() > limit;
    let mut marks: Vec<bool> = sums.iter().map(|s| s.iter().any(is_disturbed)).collect();
    let beside_edge =
        |[outside, _, inside]: &[_; ZONES]| is_disturbed(outside) || is_disturbed(inside);
    let beside_edge = sums.iter().map(beside_edge).collect();
    for side in 0..4 {
        if part_of_side(figure, &marks, side) > MAX_PART {
            let stretches = marks.iter_mut().zip(&figure.stretch_sides);
            stretches
                .filter(|(_, s)| usize::from(**s) == side)
                .for_each(|(mark, _)| *mark = false);
        }
    }
    let count = marks.len();
    // A disturbance extends into the adjacent stretches, and a corner belongs to two sides.
    let is_near = |i: usize| marks[(i + count - 1) % count] || marks[i] || marks[(i + 1) % count];
    Disturbed {
        stretches: (0..count).map(is_near).collect(),
        beside_edge,
    }
}

/// The sides that are used only in part.
pub(super) fn disturbed_sides(figure: &PixelFigure, disturbed: &Disturbed) -> Vec<DisturbedSide> {
    (0..4)
        .map(|side| DisturbedSide {
            plane: figure.plane,
            figure: figure.figure,
            side,
            part: part_of_side(figure, &disturbed.stretches, side),
            is_hidden: part_of_side(figure, &disturbed.beside_edge, side) > 0.0,
        })
        .filter(|side| side.part >= MIN_REPORTED)
        .collect()
}

fn part_of_side(figure: &PixelFigure, marks: &[bool], side: usize) -> f64 {
    let stretches = figure.stretch_sides.iter().zip(marks);
    let stretches = stretches.filter(|(s, _)| usize::from(**s) == side);
    let (all, marked) = stretches.fold((0.0, 0.0), |(all, marked), (_, &mark)| {
        (all + 1.0, marked + f64::from(u8::from(mark)))
    });
    marked / f64::max(all, 1.0)
}
