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
pub(super) fn with_fixed_weights<L: Lens>(
    planes: &[ObservedPlane],
    optimum: &Refined<L>,
) -> Vec<ObservedPlane> {
    let mut weighted = planes.to_vec();
    for (plane, residuals) in weighted.iter_mut().zip(&optimum.residuals) {
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
    weighted
}

/// The least-squares problem of samples with fixed weights.
pub(super) fn least_squares<'a, L: Lens>(
    weighted: &'a [ObservedPlane],
    free: &'a FreeParameters,
    optimum: &Refined<L>,
) -> EdgeProblem<'a, L> {
    EdgeProblem::new(weighted, free, QUADRATIC * optimum.scale)
}

/// The planes of an optimum under another lens, each fitted to its samples; `None` if the lens does
/// not see all of them.
pub(super) fn planes_under<L: Lens>(
    lens: L,
    weighted: &[ObservedPlane],
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
    let problem = least_squares(weighted, &none, optimum);
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
    for (figure, (before, after)) in figures.zip(before.figures.iter().zip(&after.figures)) {
        *figure = placed_like(figure, before, after);
    }
    moved
}

fn placed_like(placement: &Placement, before: &Placement, after: &Placement) -> Placement {
    let radii = after.radii.iter().zip(&before.radii);
    let radii = placement.radii.iter().zip(radii);
    Placement {
        stretch: placement.stretch + after.stretch - before.stretch,
        scale: placement.scale + after.scale - before.scale,
        angle: placement.angle + after.angle - before.angle,
        shift: placement.shift + after.shift - before.shift,
        radii: radii
            .map(|(radius, (after, before))| radius + after - before)
            .collect(),
        ..placement.clone()
    }
}
