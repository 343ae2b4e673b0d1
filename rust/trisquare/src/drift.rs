//! An error that all samples of a picture share: one unknown per picture, known beforehand to its
//! standard deviation, that displaces each sample by its own drift.
//!
//! The tone curve of a picture that had to be estimated is such an error: where it is wrong, all
//! edges lie a little to the dark. The geometry of the planes may tell more of it, and what
//! it leaves open belongs into the covariance.

use nalgebra::{DMatrix, DVector};

use crate::arrow::{ArrowSystem, Block};
use crate::edge_problem::EdgeProblem;
use crate::lens::MAX_LENS_COLUMNS;
use crate::levenberg::Problem;
use crate::observations::ObservedPlane;
use crate::parameters::FreeParameters;
use crate::refine::Refined;
use crate::robust::Loss;
use crate::{Brown, Error, Lens};

/// Entries of the normal equations, at most: 2 GB. Three planes in each of 430 pictures have as many.
const MOST_NUMBERS: usize = 250_000_000;

/// Frees the drifts of all pictures, one Newton step from the optimum without them: the samples
/// where they are without the drift, and the optimum there, whose normal equations have the drifts
/// eliminated. `None` where no sample drifts, or where the step fails.
pub(crate) fn accounted(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    refined: &Refined<Brown>,
) -> Option<(Vec<ObservedPlane>, Refined<Brown>)> {
    if !planes.iter().any(ObservedPlane::drifts) {
        return None;
    }
    let system = freed(planes, judged, refined)?;
    let drifts: Vec<usize> = (judged.len()..system.prior.nrows()).collect();
    let moved: Vec<usize> = (0..free.len()).chain(drifts).collect();
    let pictures = pictures(planes);
    let step = system.selected(&moved).solve(0.0)?;
    let view = refined.view.advanced(free, &step);
    let mut planes = planes.to_vec();
    for plane in &mut planes {
        plane.take_out_drift(step.shared[free.len() + place(&pictures, plane)]);
    }
    let refined = Refined {
        residuals: crate::refine::residuals(&planes, &view)?,
        view,
        system: system.marginal(judged.len())?,
        ..*refined
    };
    Some((planes, refined))
}

/// The numbers of the pictures, ascending: they are names, and of any size.
fn pictures(planes: &[ObservedPlane]) -> Vec<usize> {
    let mut numbers: Vec<usize> = planes.iter().map(|plane| plane.image).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Refuses more drifting pictures than the normal equations can hold: every plane's has a row and a
/// column for each of them.
///
/// # Errors
/// [`Error::InvalidArgument`].
pub(crate) fn check_count(planes: &[ObservedPlane]) -> Result<(), Error> {
    let side = pictures(planes).len() + MAX_LENS_COLUMNS;
    let numbers = side.saturating_mul(side).saturating_mul(planes.len());
    if numbers > MOST_NUMBERS && planes.iter().any(ObservedPlane::drifts) {
        return Err(Error::InvalidArgument(format!(
            "{} planes in {} pictures are too many to free a drift for each picture: leave out the \
             drift, or pictures",
            planes.len(),
            pictures(planes).len()
        )));
    }
    Ok(())
}

/// The place of a plane's picture among all.
fn place(pictures: &[usize], plane: &ObservedPlane) -> usize {
    pictures.partition_point(|number| *number < plane.image)
}

/// The normal equations with one more shared parameter per picture, after all others.
fn freed(
    planes: &[ObservedPlane],
    judged: &FreeParameters,
    refined: &Refined<Brown>,
) -> Option<ArrowSystem> {
    let loss = Loss::Tukey;
    let scale = refined.noise_scale * (loss.mean_weight() / refined.covariance_factor).sqrt();
    let pictures = pictures(planes);
    let known = judged.len();
    // Of the same weights as what is added, or the whole would not be positive definite.
    let (_, system) = EdgeProblem::new(planes, judged, scale).evaluate(&refined.view)?;
    let mut system = system.extended(pictures.len());
    for picture in known..known + pictures.len() {
        // A unit is one standard deviation; the factor makes the covariance of the information.
        system.prior[(picture, picture)] = refined.covariance_factor;
    }
    for (p, plane) in planes.iter().enumerate() {
        let state = &refined.view.planes[p];
        let lens = &refined.view.lens;
        for (f, figure) in plane.figures.iter().enumerate() {
            for side in &figure.sides {
                let line = state.line(f, side);
                let line_jacobian = state.line_jacobian(f, side);
                for (i, sample) in side.samples.iter().enumerate() {
                    let sight = lens.sight(&sample.pixel)?;
                    let distance = lens.line_distance_jacobian(&sight, &line, judged.columns());
                    let displacement = match side.drift.get(i) {
                        Some(drift) => {
                            let displaced = lens.sight(&(sample.pixel + drift))?;
                            lens.line_distance(&displaced, &line) - distance.value
                        }
                        None => 0.0,
                    };
                    let to_noise = side.trust() * sample.weight / scale;
                    let (_, weight) = loss.cost_and_weight(distance.value * to_noise);
                    let row = DriftRow {
                        weight: weight * to_noise * to_noise,
                        displacement,
                        residual: distance.value,
                        own: line_jacobian.tr_mul(&distance.wrt_line),
                        shared: gathered(judged, &distance.wrt_lens),
                    };
                    row.add(&mut system.blocks[p], known + place(&pictures, plane));
                }
            }
        }
    }
    Some(system)
}

fn gathered(judged: &FreeParameters, wrt_lens: &[f64; MAX_LENS_COLUMNS]) -> DVector<f64> {
    let mut shared = DVector::zeros(judged.len());
    judged.gather(wrt_lens, shared.as_mut_slice());
    shared
}

/// One sample's derivatives.
struct DriftRow {
    weight: f64,
    displacement: f64,
    residual: f64,
    own: DVector<f64>,
    shared: DVector<f64>,
}

impl DriftRow {
    /// Adds the products with the displacement, which belongs to one shared column.
    fn add(&self, block: &mut Block, column: usize) {
        let weighted = self.weight * self.displacement;
        for (i, shared) in self.shared.iter().enumerate() {
            block.shared[(i, column)] += weighted * shared;
            block.shared[(column, i)] += weighted * shared;
        }
        block.shared[(column, column)] += weighted * self.displacement;
        block.shared_gradient[column] += weighted * self.residual;
        block
            .cross
            .column_mut(column)
            .axpy(weighted, &self.own, 1.0);
    }
}

impl ArrowSystem {
    /// The equations with further shared parameters, of which nothing is known yet.
    fn extended(&self, further: usize) -> Self {
        let grown = |matrix: &DMatrix<f64>, rows: usize| {
            let (height, width) = matrix.shape();
            matrix.clone().resize(height + rows, width + further, 0.0)
        };
        Self {
            prior: grown(&self.prior, further),
            blocks: self
                .blocks
                .iter()
                .map(|block| Block {
                    shared: grown(&block.shared, further),
                    shared_gradient: block
                        .shared_gradient
                        .clone()
                        .resize_vertically(block.shared_gradient.len() + further, 0.0),
                    hessian: block.hessian.clone(),
                    cross: grown(&block.cross, 0),
                    gradient: block.gradient.clone(),
                })
                .collect(),
        }
    }

    /// The equations of some of the shared parameters: the others are held.
    fn selected(&self, shared: &[usize]) -> Self {
        Self {
            prior: self.prior.select_rows(shared).select_columns(shared),
            blocks: self
                .blocks
                .iter()
                .map(|block| Block {
                    shared: block.shared.select_rows(shared).select_columns(shared),
                    shared_gradient: block.shared_gradient.select_rows(shared),
                    hessian: block.hessian.clone(),
                    cross: block.cross.select_columns(shared),
                    gradient: block.gradient.clone(),
                })
                .collect(),
        }
    }

    /// The equations with the shared parameters after the first `kept` eliminated: what these cost
    /// is taken off the prior, so that the reduced information is the marginal one.
    pub fn marginal(&self, kept: usize) -> Option<Self> {
        let full = self.reduced_information()?;
        let further = full.nrows() - kept;
        let cross = full.view((kept, 0), (further, kept)).into_owned();
        let square = full.view((kept, kept), (further, further)).into_owned();
        let lost = cross.tr_mul(&square.cholesky()?.solve(&cross));
        let mut system = self.leading(kept);
        system.prior -= lost;
        Some(system)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Scene, SceneOptions};
    use crate::{ImageSize, Options, PlaneEdges, calibrate};
    use nalgebra::Vector2;

    const NOISE: f64 = 0.02;
    /// What the drift is said to be, and how much of it there is.
    const DRIFT: f64 = 0.1;
    const DEVIATIONS: f64 = 1.5;

    /// Edges that all lie too far inside their squares.
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
                for (point, drift) in side.iter_mut().zip(drifts) {
                    *point += drift * DEVIATIONS;
                }
            }
            figure.drift = Some(drifts);
        }
        edges
    }

    fn without_drift(mut edges: Vec<PlaneEdges>) -> Vec<PlaneEdges> {
        edges.iter_mut().for_each(|figure| figure.drift = None);
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
        let edges: Vec<_> = (0..1000).map(in_picture).collect();
        let found = calibrate(&edges, scene.size, &Options::default());
        assert!(matches!(found, Err(Error::InvalidArgument(_))), "{found:?}");
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

    #[test]
    fn the_marginal_information_is_that_of_the_whole_covariance() {
        let mut system = ArrowSystem::zeros(4, [3, 2].into_iter());
        for (k, block) in system.blocks.iter_mut().enumerate() {
            let own = block.hessian.nrows();
            let rows = DMatrix::from_fn(20, 4 + own, |i, j| {
                ((i * 13 + 7 * k + 3) as f64 * (j as f64 + 1.3)).sin()
            });
            let square = rows.tr_mul(&rows);
            block.shared = square.view((0, 0), (4, 4)).into_owned();
            block.hessian = square.view((4, 4), (own, own)).into_owned();
            block.cross = square.view((4, 0), (own, 4)).into_owned();
        }
        let whole = system.reduced_information().unwrap().try_inverse().unwrap();
        let marginal = system.marginal(3).unwrap().reduced_information().unwrap();
        let covariance = marginal.try_inverse().unwrap();
        assert!((covariance - whole.view((0, 0), (3, 3))).norm() < 1e-12);
    }
}
