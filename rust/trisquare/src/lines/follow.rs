//! The planes follow the lens that lines have moved.

use crate::lens::Lens;
use crate::numeric::{Limits, minimise};
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Placement, PlaneState, View};
use crate::refine::{EdgeProblem, Refined};

/// Evaluations allowed; about four are used.
const MAX_ITERATIONS: usize = 50;

/// Fall of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 1e-3;

/// The planes of an optimum under another lens, each where its samples are nearest; `None` where it
/// does not see all of them.
pub(super) fn planes_under<L: Lens>(
    lens: L,
    planes: &[ObservedPlane],
    optimum: &Refined<L>,
    model: L::Model,
) -> Option<Vec<PlaneState>> {
    let held = Fixed {
        focal: true,
        aspect: true,
        principal_point: true,
        distortion: true,
    };
    let none = FreeParameters::new::<L>(model, &held, 1.0);
    let start = View {
        lens,
        planes: optimum.view.planes.clone(),
    };
    let limits = Limits {
        iterations: MAX_ITERATIONS,
        decrease: LAST_DECREASE,
    };
    let problem = EdgeProblem::new(planes, &none, optimum.scale);
    Some(minimise(&problem, start, limits)?.state.planes)
}

/// A plane moved by as much as another estimate of it moved.
pub(super) fn moved_like(
    plane: &PlaneState,
    before: &PlaneState,
    after: &PlaneState,
) -> PlaneState {
    let mut moved = plane.clone();
    let turn = after.pose.rotation * before.pose.rotation.transpose();
    moved.pose.rotation = turn * plane.pose.rotation;
    moved.pose.translation += after.pose.translation - before.pose.translation;
    let figures = moved.figures.iter_mut();
    for (own, (before, after)) in figures.zip(before.figures.iter().zip(&after.figures)) {
        *own = placed_like(own, before, after);
    }
    moved
}

fn placed_like(own: &Placement, before: &Placement, after: &Placement) -> Placement {
    let radii = after.radii.iter().zip(&before.radii);
    let radii = own.radii.iter().zip(radii);
    Placement {
        stretch: own.stretch + after.stretch - before.stretch,
        scale: own.scale + after.scale - before.scale,
        angle: own.angle + after.angle - before.angle,
        shift: own.shift + after.shift - before.shift,
        radii: radii
            .map(|(own, (after, before))| own + after - before)
            .collect(),
        ..own.clone()
    }
}
