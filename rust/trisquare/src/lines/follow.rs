//! Planes under the lens as changed by lines of the scene.

use crate::lens::Lens;
use crate::numeric::{Limits, Loss, minimise};
use crate::observations::{Fixed, FreeParameters, ObservedPlane, Placement, PlaneState, View};
use crate::refine::{EdgeProblem, Refined};

/// Maximum number of evaluations; about four are used.
const MAX_ITERATIONS: usize = 50;

/// Decrease of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 1e-4;

/// Factor of the scale for which no residual is an outlier.
const QUADRATIC: f64 = 1e4;

/// The samples of an optimum with the weights of the robust loss there: under another lens the
/// residuals of all change together.
pub(super) fn with_weights_held<L: Lens>(
    planes: &[ObservedPlane],
    optimum: &Refined<L>,
) -> Vec<ObservedPlane> {
    let mut held = planes.to_vec();
    for (plane, residuals) in held.iter_mut().zip(&optimum.residuals) {
        let samples = plane.sides_mut().flat_map(|side| {
            let weight_factor = side.weight_factor();
            side.samples
                .iter_mut()
                .map(move |sample| (sample, weight_factor))
        });
        for ((sample, weight_factor), residual) in samples.zip(residuals) {
            let to_noise = sample.weight * weight_factor / optimum.scale;
            let (_, weight) = Loss::Tukey.cost_and_weight(residual.distance * to_noise);
            sample.weight *= weight.sqrt();
        }
    }
    held
}

/// The least-squares problem of samples with fixed weights.
pub(super) fn least_squares<'a, L: Lens>(
    held: &'a [ObservedPlane],
    free: &'a FreeParameters,
    optimum: &Refined<L>,
) -> EdgeProblem<'a, L> {
    EdgeProblem::new(held, free, QUADRATIC * optimum.scale)
}

/// The planes of an optimum under another lens, each fitted to its samples; `None` if the lens does
/// not see all of them.
pub(super) fn planes_under<L: Lens>(
    lens: L,
    held: &[ObservedPlane],
    optimum: &Refined<L>,
    model: L::Model,
) -> Option<Vec<PlaneState>> {
    let all = Fixed {
        focal: true,
        aspect: true,
        principal_point: true,
        distortion: true,
        skew: true,
    };
    let none = FreeParameters::new::<L>(model, &all, 1.0);
    let start = View {
        lens,
        planes: optimum.view.planes.clone(),
        relations: optimum.view.relations.clone(),
    };
    let limits = Limits {
        iterations: MAX_ITERATIONS,
        decrease: LAST_DECREASE / (QUADRATIC * QUADRATIC),
    };
    let problem = least_squares(held, &none, optimum);
    Some(minimise(&problem, start, limits)?.state.planes)
}

/// A plane moved by the difference between two estimates.
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
