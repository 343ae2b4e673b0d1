//! Planes that are as many as a camera needs leave nothing to check their figures against.

use crate::lens::{Lens, SKEW};
use crate::observations::{Freedom, ObservedPlane, PlaneEdges};
use crate::result::{Calibration, Warning};

/// What printers stretch one direction by, as a part, and nobody sees.
const STRETCH: f64 = 0.003;

/// Samples of a line that tell well enough what a stretch changes.
const SAMPLES: usize = 50;

/// Warns where the planes give no more equations than the camera matrix has unknowns.
///
/// Three squares that are stretched contradict each other. Two do not: the camera takes up all of
/// the stretch. `focal` gives `fx` from other edges.
pub(crate) fn unchecked_targets<L: Lens>(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    found: &Calibration<L>,
    focal: impl Fn(&[PlaneEdges]) -> Option<f64>,
) -> Option<Warning> {
    let figures = |plane: usize| planes[plane].figures.iter().map(|figure| figure.index);
    let is_used = |plane: &usize| found.planes[*plane].samples > 0;
    let used: Vec<usize> = (0..planes.len()).filter(is_used).collect();
    let equations = |plane: &usize| match figures(*plane).any(|i| has_any_aspect(&edges[i])) {
        true => 1,
        false => 2,
    };
    let is_of_matrix = |name: &&&str| ["fx", "fy", "cx", "cy", SKEW].contains(*name);
    let unknowns = found.parameters.iter().filter(is_of_matrix).count();
    let is_checked = used.iter().map(equations).sum::<usize>() > unknowns
        || edges.iter().any(|own| !own.relations.is_empty());
    let of_focal = found.position("fx")?;
    if is_checked {
        return None;
    }
    let thinned: Vec<PlaneEdges> = edges.iter().map(|own| own.thinned(SAMPLES)).collect();
    let before = focal(&thinned)?;
    let mut square = 0.0;
    for plane in &used {
        let mut stretched = thinned.clone();
        for i in figures(*plane).filter(|i| !has_any_aspect(&edges[*i])) {
            stretched[i] = thinned[i].stretched(1.0 + STRETCH);
        }
        square += (focal(&stretched)? - before).powi(2);
    }
    Some(Warning::TargetsUnchecked {
        planes: used.len(),
        stretch: STRETCH,
        change: square.sqrt(),
        std: found.covariance[(of_focal, of_focal)].max(0.0).sqrt(),
    })
    .filter(|_| square > 0.0)
}

/// Whether an extent that is free takes up all of a stretch.
fn has_any_aspect(edges: &PlaneEdges) -> bool {
    matches!(edges.freedom, Freedom::Aspect | Freedom::Offsets)
}
