//! Warning for planes that just suffice to determine the camera, so that their figures cannot be
//! checked.

use std::cmp::Reverse;

use crate::geometry::{Line, Pose};
use crate::lens::{Lens, MATRIX};
use crate::observations::{ObservedPlane, PlaneEdges};
use crate::result::{Calibration, Plane, Warning};

/// Relative stretch of one direction by printers, which is not noticed; right angles are assumed to
/// be off by as much (radians).
const STRETCH: f64 = 0.003;

/// Number of samples of a line that suffice to compute the effect of a stretch.
const SAMPLES: usize = 50;

/// Angle between planes, and between their sides, in degrees, up to which one gives the same
/// information as the other: no more about the camera, and a stretch of both alike goes unnoticed.
const ALIKE: f64 = 10.0;

/// Ratio of [`STRETCH`] to the standard deviation of a plane's shape above which the plane would
/// show a stretch.
const CLEARLY: f64 = 4.0;

/// Change of `fx` by a stretch, as a fraction of the standard deviation of `fx`, up to which the
/// latter covers it.
const COVERED: f64 = 0.5;

/// Warns where the planes give no more equations than the camera matrix has unknowns.
///
/// Three squares that are stretched contradict each other. Two do not: the camera absorbs all of
/// the stretch, which planes that stand alike are assumed to share. Nor do three planes, as at a
/// box's corner, of which only the right angles are known, if these are wrong: that the planes are
/// at right angles to one another then adds no information. Where a plane was rejected, any of the
/// remaining ones may be the false one instead. Planes too small or too rough to show a stretch do
/// not count if the others give enough equations. `focal` returns `fx` from other edges.
pub(crate) fn unchecked_targets<L: Lens>(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    found: &Calibration<L>,
    focal: impl Fn(&[PlaneEdges]) -> Option<f64>,
) -> Option<Warning> {
    let equation_count = |plane: &usize| planes[*plane].equation_count();
    let is_camera_matrix = |name: &&&str| MATRIX.contains(*name);
    let unknowns = found.parameters.iter().filter(is_camera_matrix).count();
    let is_used = |plane: &usize| !planes[*plane].is_outlier();
    let used: Vec<usize> = (0..planes.len()).filter(is_used).collect();
    let neighbours = found.residual_correlation.neighbours;
    let is_checkable =
        |plane: &&usize| shape_std(&found.planes[**plane], neighbours) < STRETCH / CLEARLY;
    let checkable: Vec<usize> = used.iter().filter(is_checkable).copied().collect();
    let count = used.len();
    let used = match checkable.iter().map(equation_count).sum::<usize>() >= unknowns {
        true => checkable,
        false => used,
    };
    let mut sorted_planes = used.clone();
    sorted_planes.sort_by_key(|plane| Reverse(equation_count(plane)));
    let alike = alike_groups(unknowns, &sorted_planes, equation_count, &found.planes)?;
    let std = found.std_of("fx")?;
    let are_angles = used.iter().all(|plane| equation_count(plane) == 1);
    if !are_angles && edges.iter().any(|figure| !figure.relations.is_empty()) {
        return None;
    }
    let thinned = edges
        .iter()
        .map(|figure| figure.as_rectangle().thinned(SAMPLES));
    let thinned: Vec<PlaneEdges> = thinned.collect();
    let before = focal(&thinned)?;
    let mut square = 0.0;
    for group in &alike {
        // A free extent absorbs all of a stretch.
        let is_changed = |plane: &&usize| are_angles || equation_count(plane) > 1;
        let changed = group.iter().filter(is_changed).map(|plane| &planes[*plane]);
        square += (focal(&deformed_edges(&thinned, changed, are_angles))? - before).powi(2);
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

/// Groups planes that stand alike, those with more equations first; `None` where the first planes
/// of the groups give more than `max_equations` equations.
fn alike_groups(
    max_equations: usize,
    sorted_planes: &[usize],
    equation_count: impl Fn(&usize) -> usize,
    found: &[Plane],
) -> Option<Vec<Vec<usize>>> {
    let mut alike: Vec<Vec<usize>> = Vec::new();
    let mut count = 0;
    for &plane in sorted_planes {
        let pose = &found[plane].pose;
        let is_alike = |group: &&mut Vec<usize>| are_alike(pose, &found[group[0]].pose);
        match alike.iter_mut().find(is_alike) {
            Some(group) => group.push(plane),
            None => {
                alike.push(vec![plane]);
                count += equation_count(&plane);
            }
        }
        if count > max_equations {
            return None;
        }
    }
    Some(alike)
}

/// Returns the edges with some planes stretched, or sheared where only their angles are known.
fn deformed_edges<'a>(
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

/// Standard deviation of the aspect of a plane's first figure, from its sides, as a fraction of the
/// aspect.
fn shape_std(plane: &Plane, neighbours: f64) -> f64 {
    let corners = &plane.corners;
    let sides = (0..4).map(|side| (corners[(side + 1) % 4] - corners[side]).norm());
    let side = sides.sum::<f64>() / 4.0;
    let independent = plane.samples as f64 / (4.0 * neighbours.max(1.0));
    plane.rms / (independent.sqrt() * side)
}

/// Whether two planes face the same way with their sides in the same directions.
fn are_alike(first: &Pose, second: &Pose) -> bool {
    let turn = first.rotation.tr_mul(&second.rotation);
    let sides = turn.m21.atan2(turn.m11).to_degrees().rem_euclid(90.0);
    turn.m33 > ALIKE.to_radians().cos() && sides.min(90.0 - sides) < ALIKE
}
