//! Stretches of an outline that something lies over, told by many pixels together.
//!
//! The rim of a stain or the flank of a glare changes pixels by less than a single one needs to
//! count as an outlier; the mean over a stretch shows it. And rings around an outline that are not
//! plain, told in the same way.

use super::band_pixels::PixelFigure;
use super::coverage::PLATEAU;
use super::figure_chart::all_distances;
use super::scene::Scene;
use crate::lens::Lens;
use crate::numeric::median_scale;

/// Pixels nearer to the outline than this (px) show the edge, the others the light beside it; each
/// of the three zones is judged on its own.
const EDGE_ZONE: f64 = 2.5;
const ZONES: usize = 3;

/// Pixels farther off (px) are not judged: the rim of a sheet may run there, or a frame's other
/// outline, and what hides an edge reaches to the edge.
const JUDGED: f64 = 6.0;

/// No pixel counts for more deviations than this: a speck is not a stretch.
const MAX_DEVIATIONS: f64 = 10.0;

/// A zone's mean is disturbed from so many of its deviations, in a picture that follows the model;
/// where it follows less well, of the typical departure of the figure's zones.
const DISTURBED: f64 = 5.0;

/// If more of a side than this is disturbed, nothing lies over it: the model does not fit it.
const MAX_PART: f64 = 0.5;

/// A part of a side smaller than this is not worth a warning.
const MIN_REPORTED: f64 = 0.05;

/// A side of a figure of which a part is not used.
#[derive(Debug, Clone, Copy)]
pub(super) struct DisturbedSide {
    pub plane: usize,
    pub figure: usize,
    pub side: usize,
    /// Part of the side that is not used.
    pub part: f64,
    /// Whether something lies over it: the light beside the edge is disturbed as well.
    pub is_hidden: bool,
}

/// Which stretches of a figure are not to be used.
pub(super) struct Disturbed {
    pub stretches: Vec<bool>,
    /// Where the light beside the edge is disturbed: the edge alone may be where no square has it.
    beside: Vec<bool>,
}

/// How far the pixels of a figure are from what they should be, in units of their noise; `None`
/// where the lens does not see one.
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

/// Sum and number of some departures.
type Sum = (f64, f64);

/// Their sum, in its standard deviations.
fn deviation((sum, count): &Sum) -> f64 {
    sum / f64::max(*count, 1.0).sqrt()
}

/// How many deviations are too many, where those are typical of a figure.
fn limit(deviations: impl Iterator<Item = f64>) -> f64 {
    DISTURBED * median_scale(deviations).max(1.0)
}

/// How far (px) from the outline the light beside it is plain along every side: a sheet may end
/// farther off, and what is blurred there moves the edge. Stretches that something lies over do not
/// tell. The edge's blur is given (px).
pub(super) fn plain_reach(
    figure: &PixelFigure,
    departures: &[f64],
    disturbed: &Disturbed,
    blur: f64,
) -> f64 {
    // By ring of 1 px, side, and whether it is outside.
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
    let of_edge = (PLATEAU * blur) as usize;
    let first_other = rings.iter().skip(of_edge).position(|ring| !is_plain(ring));
    // What disturbs a ring begins in the one before.
    first_other.map_or(f64::INFINITY, |ring| (of_edge + ring) as f64 - 1.0)
}

/// Which stretches of a figure are not to be used.
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
    let beside = |[outside, _, inside]: &[_; ZONES]| is_disturbed(outside) || is_disturbed(inside);
    let beside = sums.iter().map(beside).collect();
    for side in 0..4 {
        if part_of_side(figure, &marks, side) > MAX_PART {
            let stretches = marks.iter_mut().zip(&figure.stretch_sides);
            stretches
                .filter(|(_, s)| usize::from(**s) == side)
                .for_each(|(mark, _)| *mark = false);
        }
    }
    let count = marks.len();
    // What disturbs a stretch reaches into the next ones, and a corner belongs to two sides.
    let near = |i: usize| marks[(i + count - 1) % count] || marks[i] || marks[(i + 1) % count];
    Disturbed {
        stretches: (0..count).map(near).collect(),
        beside,
    }
}

/// The sides of which a part is not used.
pub(super) fn disturbed_sides(figure: &PixelFigure, disturbed: &Disturbed) -> Vec<DisturbedSide> {
    (0..4)
        .map(|side| DisturbedSide {
            plane: figure.plane,
            figure: figure.figure,
            side,
            part: part_of_side(figure, &disturbed.stretches, side),
            is_hidden: part_of_side(figure, &disturbed.beside, side) > 0.0,
        })
        .filter(|side| side.part >= MIN_REPORTED)
        .collect()
}

fn part_of_side(figure: &PixelFigure, marks: &[bool], side: usize) -> f64 {
    let own = figure.stretch_sides.iter().zip(marks);
    let own = own.filter(|(s, _)| usize::from(**s) == side);
    let (all, marked) = own.fold((0.0, 0.0), |(all, marked), (_, &mark)| {
        (all + 1.0, marked + f64::from(u8::from(mark)))
    });
    marked / f64::max(all, 1.0)
}
