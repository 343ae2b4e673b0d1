//! Planes that are as many as a camera needs leave nothing to check their figures against.

use crate::lens::{Lens, MATRIX};
use crate::observations::{ObservedPlane, PlaneEdges};
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
    let is_used = |plane: &usize| found.planes[*plane].samples > 0;
    let used: Vec<usize> = (0..planes.len()).filter(is_used).collect();
    // An extent that is free takes up all of a stretch, and with it an equation.
    let equations = |plane: &usize| 2 - usize::from(planes[*plane].has_any_aspect());
    let is_of_matrix = |name: &&&str| MATRIX.contains(*name);
    let unknowns = found.parameters.iter().filter(is_of_matrix).count();
    let is_checked = used.iter().map(equations).sum::<usize>() > unknowns
        || edges.iter().any(|own| !own.relations.is_empty());
    let std = found.std_of("fx")?;
    if is_checked {
        return None;
    }
    let thinned: Vec<PlaneEdges> = edges.iter().map(|own| own.thinned(SAMPLES)).collect();
    let before = focal(&thinned)?;
    let mut square = 0.0;
    for plane in used.iter().filter(|i| !planes[**i].has_any_aspect()) {
        let mut stretched = thinned.clone();
        for figure in &planes[*plane].figures {
            stretched[figure.index] = thinned[figure.index].stretched(1.0 + STRETCH);
        }
        square += (focal(&stretched)? - before).powi(2);
    }
    (square > 0.0).then(|| Warning::TargetsUnchecked {
        planes: used.len(),
        stretch: STRETCH,
        change: square.sqrt(),
        std,
    })
}
