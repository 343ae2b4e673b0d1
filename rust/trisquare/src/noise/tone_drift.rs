//! An error shared by all samples of a picture: one unknown per picture, with a prior of one
//! standard deviation, that shifts each sample by its own tone drift.
//!
//! An estimated tone curve of a picture causes such an error: if the curve is wrong, all edges are
//! shifted a little towards the dark. The geometry of the planes may determine it further, and the
//! remaining uncertainty is added to the covariance.

use std::collections::BTreeMap;

use nalgebra::DVector;

use crate::error::Error;
use crate::lens::{Lens, MAX_LENS_COLUMNS};
use crate::numeric::{ArrowStep, ArrowSystem, Block, Loss, Problem};
use crate::observations::{FreeParameters, ObservedPlane, PlaneState, Side, View};
use crate::refine::{EdgeProblem, Refined, residuals};

/// Maximum number of entries in the equations of the shared parameters: 2 GB, for 15,000 pictures.
const MAX_NUMBERS: usize = 250_000_000;

/// Loss that weights the samples.
const LOSS: Loss = Loss::Tukey;

/// Estimates the tone drift of all pictures by one Newton step from the optimum without them:
/// returns the samples corrected for the tone drift, and the optimum there, whose normal equations
/// have the tone drifts eliminated. `None` if no sample has a tone drift, or if the step fails.
pub(crate) fn account_for_drift<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    refined: &Refined<L>,
) -> Option<(Vec<ObservedPlane>, Refined<L>)> {
    if !planes.iter().any(ObservedPlane::has_tone_drift) {
        return None;
    }
    let pictures = pictures(planes);
    let system = drift_equations(planes, &pictures, judged, refined)?;
    let all: Vec<usize> = (0..free.len()).collect();
    let mut step = partial_step(&system, judged, &all)?;
    let mut view = refined.view.advanced(free, &step);
    // If the samples hardly determine the distortion, it may step to a lens that does not see the
    // picture.
    if !free.is_reach_met(&view.lens) {
        step = partial_step(&system, judged, &free.camera_matrix_positions())?;
        view = refined.view.advanced(free, &step);
    }
    let mut planes = planes.to_vec();
    for plane in &mut planes {
        plane.remove_tone_drift(step.shared[judged.len() + picture_position(&pictures, plane)]);
    }
    let refined = Refined {
        residuals: residuals(&planes, &view)?,
        view,
        system: system.marginal(judged.len())?,
        ..*refined
    };
    Some((planes, refined))
}

/// The step in some of the free parameters and in all drifts; zero for all others.
fn partial_step(
    system: &ArrowSystem,
    judged: &FreeParameters,
    selected: &[usize],
) -> Option<ArrowStep> {
    let count = system.prior.nrows();
    let selected: Vec<usize> = selected
        .iter()
        .copied()
        .chain(judged.len()..count)
        .collect();
    let mut step = system.selected(&selected).solve(0.0)?;
    let values = std::mem::replace(&mut step.shared, DVector::zeros(count));
    for (place, value) in selected.iter().zip(values.iter()) {
        step.shared[*place] = *value;
    }
    Some(step)
}

/// The samples corrected for a view of the planes that was not fitted to them: with the tone drift
/// of each picture that minimises their residuals.
pub(crate) fn corrected_for_drift<L: Lens>(
    planes: &[ObservedPlane],
    view: &View<L>,
) -> Option<Vec<ObservedPlane>> {
    let mut corrected = planes.to_vec();
    if !planes.iter().any(ObservedPlane::has_tone_drift) {
        return Some(corrected);
    }
    corrected
        .iter_mut()
        .for_each(|plane| plane.remove_tone_drift(1.0));
    let (before, after) = (residuals(planes, view)?, residuals(&corrected, view)?);
    let mut sums = BTreeMap::<usize, (f64, f64)>::new();
    for (plane, (before, after)) in planes.iter().zip(before.iter().zip(&after)) {
        let (product, square) = sums.entry(plane.image).or_default();
        let counted = before
            .iter()
            .zip(after)
            .filter(|(residual, _)| residual.is_counted);
        for (before, after) in counted {
            let drift = after.distance - before.distance;
            let weight = before.weight * before.weight;
            *product += weight * drift * before.distance;
            *square += weight * drift * drift;
        }
    }
    for corrected in &mut corrected {
        let (product, square) = sums[&corrected.image];
        let optimum = if square > 0.0 { -product / square } else { 0.0 };
        corrected.remove_tone_drift(optimum - 1.0);
    }
    Some(corrected)
}

/// The numbers of the pictures, ascending. They are arbitrary labels.
fn pictures(planes: &[ObservedPlane]) -> Vec<usize> {
    let mut numbers: Vec<usize> = planes.iter().map(|plane| plane.image).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Checks that the number of pictures with tone drift is not too large for the normal equations,
/// which have a row and a column for each.
///
/// # Errors
/// [`Error::InvalidArgument`].
pub(crate) fn check_drift_count(planes: &[ObservedPlane]) -> Result<(), Error> {
    let count = pictures(planes).len();
    let side = count + MAX_LENS_COLUMNS;
    if side.saturating_mul(side) > MAX_NUMBERS && planes.iter().any(ObservedPlane::has_tone_drift) {
        return Err(Error::InvalidArgument(format!(
            "{count} pictures are too many to estimate a tone drift for each: omit the tone drift, \
             or use fewer pictures"
        )));
    }
    Ok(())
}

/// Position of a plane's picture among `pictures`.
fn picture_position(pictures: &[usize], plane: &ObservedPlane) -> usize {
    pictures.partition_point(|number| *number < plane.image)
}

/// The normal equations with an additional shared parameter for each of the pictures, after all
/// others.
fn drift_equations<L: Lens>(
    planes: &[ObservedPlane],
    pictures: &[usize],
    judged: &FreeParameters,
    refined: &Refined<L>,
) -> Option<ArrowSystem> {
    let scale = refined.noise_scale * (LOSS.mean_weight() / refined.covariance_factor).sqrt();
    let known = judged.len();
    // With the same weights as the added terms; otherwise the sum would not be positive definite.
    let (_, system) = EdgeProblem::new(planes, judged, scale).evaluate(&refined.view)?;
    let count = known + pictures.len();
    let blocks = system.blocks.iter().zip(planes);
    let blocks =
        blocks.map(|(block, plane)| block.extended(&[known + picture_position(pictures, plane)]));
    let mut system = ArrowSystem {
        prior: system.prior.clone().resize(count, count, 0.0),
        prior_gradient: system.prior_gradient.clone().resize_vertically(count, 0.0),
        blocks: blocks.collect(),
        eliminated: None,
    };
    for picture in known..count {
        // The unit is one standard deviation; the factor later turns the information into a
        // covariance.
        system.prior[(picture, picture)] = refined.covariance_factor;
    }
    let View {
        lens,
        planes: states,
        ..
    } = &refined.view;
    for (block, (plane, state)) in system.blocks.iter_mut().zip(planes.iter().zip(states)) {
        for (f, side) in plane.sides_by_figure() {
            add_drift(block, (f, side), (lens, state), judged, scale)?;
        }
    }
    Some(system)
}

/// Adds the information of a side's samples on the picture's drift, the last of the shared
/// parameters, to the equations of their plane.
fn add_drift<L: Lens>(
    block: &mut Block,
    (figure, side): (usize, &Side),
    (lens, state): (&L, &PlaneState),
    judged: &FreeParameters,
    scale: f64,
) -> Option<()> {
    let drift = judged.len();
    for found in state.model_lines(lens, figure, side) {
        let (model, range) = found?;
        let line = state.line(figure, &model.line);
        let line_jacobian = state.line_jacobian(figure, &model);
        for i in range {
            let sample = &side.samples[i];
            let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
            let distance = lens.line_distance_jacobian(&pixel_ray, &line, judged.columns());
            let displacement = match side.tone_drift.get(i) {
                Some(tone_drift) => {
                    let displaced = lens.unproject_with_jacobian(&(sample.pixel + tone_drift))?;
                    lens.line_distance(&displaced, &line) - distance.value
                }
                None => 0.0,
            };
            let to_noise = side.weight_factor() * sample.weight / scale;
            let (_, weight) = LOSS.cost_and_weight(distance.value * to_noise);
            let mut shared = DVector::zeros(judged.len());
            judged.gather(&distance.wrt_lens, shared.as_mut_slice());
            let plane_jacobian = line_jacobian.tr_mul(&distance.wrt_line);
            // Products with the displacement, which belongs to one shared column.
            let weighted = weight * to_noise * to_noise * displacement;
            for (i, shared) in shared.iter().enumerate() {
                block.shared[(i, drift)] += weighted * shared;
                block.shared[(drift, i)] += weighted * shared;
            }
            block.shared[(drift, drift)] += weighted * displacement;
            block.shared_gradient[drift] += weighted * distance.value;
            block
                .cross
                .column_mut(drift)
                .axpy(weighted, &plane_jacobian, 1.0);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use crate::calibrate;
    use crate::image_size::ImageSize;
    use crate::lens::Lens;
    use crate::observations::{Options, PlaneEdges};
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::Vector2;

    const NOISE: f64 = 0.02;
    /// The stated tone drift, and the actual one in units of it.
    const DRIFT: f64 = 0.1;
    const DEVIATIONS: f64 = 1.5;

    /// Edges that are all shifted into their squares.
    fn shifted(scene: &Scene) -> Vec<PlaneEdges> {
        let mut edges = scene.edges(1, NOISE, 4.0);
        for figure in &mut edges {
            figure.std = Some(figure.points.iter().map(|p| vec![NOISE; p.len()]).collect());
            let all: Vec<Vector2<f64>> = figure.points.iter().flatten().copied().collect();
            let middle = all.iter().sum::<Vector2<f64>>() / all.len() as f64;
            let inward = |side: &[Vector2<f64>]| {
                let along = (side[side.len() - 1] - side[0]).normalize();
                let normal = Vector2::new(-along.y, along.x);
                normal * (DRIFT * normal.dot(&(middle - side[0])).signum())
            };
            let drifts: Vec<Vec<_>> = figure
                .points
                .iter()
                .map(|side| vec![inward(side); side.len()])
                .collect();
            for (side, drifts) in figure.points.iter_mut().zip(&drifts) {
                for (point, tone_drift) in side.iter_mut().zip(drifts) {
                    *point += tone_drift * DEVIATIONS;
                }
            }
            figure.tone_drift = Some(drifts);
        }
        edges
    }

    fn without_drift(mut edges: Vec<PlaneEdges>) -> Vec<PlaneEdges> {
        edges.iter_mut().for_each(|figure| figure.tone_drift = None);
        edges
    }

    /// Errors of the focal lengths in standard deviations, root mean square over scenes.
    fn focal_scores(edges_of: impl Fn(&Scene) -> Vec<PlaneEdges>) -> f64 {
        let scores = (0..12).map(|seed| {
            let scene = Scene::random(seed, SceneOptions::default());
            let size: ImageSize = scene.size;
            let found = calibrate(&edges_of(&scene), size, &Options::default()).unwrap();
            let error = found.camera.focal().x - scene.camera.focal().x;
            error * error / found.covariance[(0, 0)]
        });
        (scores.sum::<f64>() / 12.0).sqrt()
    }

    #[test]
    fn a_shared_error_is_found_and_accounted_for() {
        let with = focal_scores(shifted);
        let without = focal_scores(|scene| without_drift(shifted(scene)));
        // The mean of twelve squares of normal errors stays below 2.75 but once in a thousand.
        assert!(with < 2.75_f64.sqrt(), "{with}");
        assert!(without > 3.0, "{without}");
    }

    #[test]
    fn more_drifting_pictures_than_memory_holds_are_refused() {
        let scene = Scene::random(3, SceneOptions::default());
        let figure = shifted(&scene).swap_remove(0);
        let in_picture = |image| PlaneEdges {
            image,
            ..figure.clone()
        };
        let edges: Vec<_> = (0..16_000).map(in_picture).collect();
        let found = calibrate(&edges, scene.size, &Options::default());
        assert!(
            matches!(found, Err(crate::error::Error::InvalidArgument(_))),
            "{found:?}"
        );
    }

    #[test]
    fn freedom_costs_certainty_and_never_gains_it() {
        let scene = Scene::random(3, SceneOptions::default());
        let std = |edges: &[PlaneEdges]| {
            let found = calibrate(edges, scene.size, &Options::default()).unwrap();
            found.covariance[(0, 0)].sqrt() / found.noise_scale
        };
        let edges = shifted(&scene);
        assert!(std(&edges) > std(&without_drift(edges.clone())));
    }
}
