//! Planes that are as many as a camera needs leave nothing to check their figures against.

use std::cmp::Reverse;

use crate::geometry::{Line, Pose};
use crate::lens::{Lens, MATRIX};
use crate::observations::{ObservedPlane, PlaneEdges};
use crate::result::{Calibration, Plane, Warning};

/// What printers stretch one direction by, as a part, and nobody sees; right angles are taken to be
/// off by as much.
const STRETCH: f64 = 0.003;

/// Samples of a line that tell well enough what a stretch changes.
const SAMPLES: usize = 50;

/// Degrees between planes, and between their sides, up to which one tells what the other does: no
/// more of the camera, and a stretch of both alike goes unnoticed.
const ALIKE: f64 = 10.0;

/// A plane of which the shape is known so much better than to [`STRETCH`] would show one.
const CLEARLY: f64 = 4.0;

/// A stretch that changes `fx` by less than this part of its standard deviation is covered by that.
const COVERED: f64 = 0.5;

/// Warns where the planes give no more equations than the camera matrix has unknowns.
///
/// Three squares that are stretched contradict each other. Two do not: the camera takes up all of
/// the stretch, which planes that stand alike are taken to share. Nor do three planes, as at a box's
/// corner, whose right angles alone are known, if these are none: that they are at right angles to one
/// another then says nothing more. Where a plane was rejected, any of those that are left may be the
/// false one instead. Planes too small or too rough to show a stretch, beside some that give equations
/// enough, do not count. `focal` gives `fx` from other edges.
pub(crate) fn unchecked_targets<L: Lens>(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    found: &Calibration<L>,
    focal: impl Fn(&[PlaneEdges]) -> Option<f64>,
) -> Option<Warning> {
    let equations = |plane: &usize| planes[*plane].equations();
    let is_of_matrix = |name: &&&str| MATRIX.contains(*name);
    let unknowns = found.parameters.iter().filter(is_of_matrix).count();
    let is_used = |plane: &usize| !planes[*plane].is_outlier();
    let used: Vec<usize> = (0..planes.len()).filter(is_used).collect();
    let neighbours = found.residual_correlation.neighbours;
    let shows = |plane: &&usize| shape_std(&found.planes[**plane], neighbours) < STRETCH / CLEARLY;
    let clear: Vec<usize> = used.iter().filter(shows).copied().collect();
    let count = used.len();
    let used = match clear.iter().map(equations).sum::<usize>() >= unknowns {
        true => clear,
        false => used,
    };
    let mut telling = used.clone();
    telling.sort_by_key(|plane| Reverse(equations(plane)));
    let alike = alike_within(unknowns, &telling, equations, &found.planes)?;
    let std = found.std_of("fx")?;
    let are_angles = used.iter().all(|plane| equations(plane) == 1);
    if !are_angles && edges.iter().any(|own| !own.relations.is_empty()) {
        return None;
    }
    let thinned = edges.iter().map(|own| own.as_rectangle().thinned(SAMPLES));
    let thinned: Vec<PlaneEdges> = thinned.collect();
    let before = focal(&thinned)?;
    let mut square = 0.0;
    for group in &alike {
        // An extent that is free takes up all of a stretch.
        let is_changed = |plane: &&usize| are_angles || equations(plane) > 1;
        let changed = group.iter().filter(is_changed).map(|plane| &planes[*plane]);
        square += (focal(&untrue(&thinned, changed, are_angles))? - before).powi(2);
    }
    let change = square.sqrt();
    (change > COVERED * std).then_some(Warning::TargetsUnchecked {
        planes: used.len(),
        rough: count - used.len(),
        rejected: planes.len() - count,
        directions: alike.len(),
        stretch: STRETCH,
        are_angles,
        change,
        std,
    })
}

/// Planes in groups that stand alike, those that tell more first; `None` where the first of the groups
/// give more equations than so many.
fn alike_within(
    most: usize,
    telling: &[usize],
    equations: impl Fn(&usize) -> usize,
    found: &[Plane],
) -> Option<Vec<Vec<usize>>> {
    let mut alike: Vec<Vec<usize>> = Vec::new();
    let mut count = 0;
    for &plane in telling {
        let pose = &found[plane].pose;
        let stands = |group: &&mut Vec<usize>| stand_alike(pose, &found[group[0]].pose);
        match alike.iter_mut().find(stands) {
            Some(group) => group.push(plane),
            None => {
                alike.push(vec![plane]);
                count += equations(&plane);
            }
        }
        if count > most {
            return None;
        }
    }
    Some(alike)
}

/// The edges with some planes that are stretched, or sheared where their angles alone are known.
fn untrue<'a>(
    edges: &[PlaneEdges],
    planes: impl Iterator<Item = &'a ObservedPlane>,
    are_angles: bool,
) -> Vec<PlaneEdges> {
    let change = |line: &Line| match are_angles {
        true => line.sheared(STRETCH),
        false => line.stretched(1.0 + STRETCH),
    };
    let mut changed = edges.to_vec();
    for figure in planes.flat_map(|plane| &plane.figures) {
        changed[figure.index] = edges[figure.index].with_lines(change);
    }
    changed
}

/// How well the sides of a plane's first figure tell its aspect, as a part of that.
fn shape_std(plane: &Plane, neighbours: f64) -> f64 {
    let corners = &plane.corners;
    let sides = (0..4).map(|side| (corners[(side + 1) % 4] - corners[side]).norm());
    let side = sides.sum::<f64>() / 4.0;
    let independent = plane.samples as f64 / (4.0 * neighbours.max(1.0));
    plane.rms / (independent.sqrt() * side)
}

/// Whether two planes face the same way with their sides in the same directions.
fn stand_alike(first: &Pose, second: &Pose) -> bool {
    let turn = first.rotation.tr_mul(&second.rotation);
    let sides = turn.m21.atan2(turn.m11).to_degrees().rem_euclid(90.0);
    turn.m33 > ALIKE.to_radians().cos() && sides.min(90.0 - sides) < ALIKE
}
