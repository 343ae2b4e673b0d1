//! Least-squares problem of edge samples, with normal equations of arrowhead structure.
//!
//! The residual of a sample is its distance, in pixels of the photograph, to the image of its line,
//! divided by its standard deviation. It depends on line and plane only through the plane `l`
//! spanned by the line and the camera centre, so the samples of a side are summed over `(l, lens)`
//! first, and the pose is applied once per side.

use std::marker::PhantomData;

use nalgebra::Vector3;

use super::line_sums::{LineProducts, LineSums, RESIDUAL, SHARED_OFFSET};
use super::side_curve::{SideCurve, SideCurves};
use crate::lens::{Lens, MAX_LENS_COLUMNS};
use crate::numeric::{ArrowStep, ArrowSystem, Block, Loss, Problem, add_rank_one, each};
use crate::observations::{FreeParameters, ModelLine, ObservedPlane, Sample, View};

/// The samples as a least-squares problem at one scale of the noise.
pub(crate) struct EdgeProblem<'a, L> {
    planes: &'a [ObservedPlane],
    free: &'a FreeParameters,
    pub loss: Loss,
    /// Factor of the given standard deviations.
    scale: f64,
    /// Curves near the views at which the problem is evaluated, if any.
    curves: Option<&'a SideCurves>,
    lens: PhantomData<L>,
}

impl<'a, L: Lens> EdgeProblem<'a, L> {
    pub fn new(planes: &'a [ObservedPlane], free: &'a FreeParameters, scale: f64) -> Self {
        Self {
            planes,
            free,
            loss: Loss::Tukey,
            scale,
            curves: None,
            lens: PhantomData,
        }
    }

    /// The problem with curves near the views at which it will be evaluated, if any.
    pub(super) fn with_curves(self, curves: Option<&'a SideCurves>) -> Self {
        Self { curves, ..self }
    }

    /// The derivatives of a pixel's distance, and the distance, in the order of the sums' columns.
    fn row<const N: usize>(&self, lens: &L, ray: &L::PixelRay, line: &Vector3<f64>) -> [f64; N] {
        let distance = lens.line_distance_jacobian(ray, line, self.free.columns());
        let mut row = [0.0; N];
        row[..RESIDUAL].copy_from_slice(distance.wrt_line.as_slice());
        row[RESIDUAL] = distance.value;
        self.free
            .gather(&distance.wrt_lens, &mut row[SHARED_OFFSET..]);
        row
    }

    fn sum_samples<const N: usize>(
        &self,
        lens: &L,
        line: &Vector3<f64>,
        (samples, weight_factor): (&[Sample], f64),
    ) -> Option<LineSums<N>> {
        let mut sums = LineSums {
            cost: 0.0,
            products: [[0.0; N]; N],
        };
        let to_scale = weight_factor / self.scale;
        for sample in samples {
            let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
            let row = self.row(lens, &pixel_ray, line);
            let to_noise = sample.weight * to_scale;
            let (cost, weight) = self.loss.cost_and_weight(row[RESIDUAL] * to_noise);
            let weight = weight * to_noise * to_noise;
            sums.cost += cost;
            add_rank_one(&mut sums.products, &row, weight);
        }
        Some(sums)
    }

    /// Sums over the samples on a line; those of the lens alone are added to the block.
    fn sums<const N: usize>(
        &self,
        lens: &L,
        line: &Vector3<f64>,
        (samples, weight_factor, curve): (&[Sample], f64, Option<&SideCurve>),
        block: &mut Block,
    ) -> Option<LineProducts> {
        let sums = match curve {
            Some(curve) => {
                let row = |ray: &L::PixelRay| self.row(lens, ray, line);
                curve.sums::<L, N>((lens, line), (self.loss, weight_factor / self.scale), row)
            }
            None => self.sum_samples::<N>(lens, line, (samples, weight_factor)),
        }?;
        Some(sums.split(self.free.len(), block))
    }

    /// Adds the samples of a side on one of its model lines to the plane's block; returns their
    /// cost.
    fn add_samples(
        &self,
        view: &View<L>,
        (plane, figure, model): (usize, usize, &ModelLine),
        samples: (&[Sample], f64, Option<&SideCurve>),
        block: &mut Block,
    ) -> Option<f64> {
        let state = &view.planes[plane];
        let (lens, line) = (&view.lens, state.line(figure, &model.line));
        // One instance per number of shared parameters, so that the innermost loops are unrolled;
        // large numbers, which few lenses have, share an instance with unused columns.
        let sums = match self.free.len() {
            0 => Self::sums::<4>,
            1 => Self::sums::<5>,
            2 => Self::sums::<6>,
            3 => Self::sums::<7>,
            4 => Self::sums::<8>,
            5 => Self::sums::<9>,
            6 => Self::sums::<10>,
            7 => Self::sums::<11>,
            8 => Self::sums::<12>,
            9 => Self::sums::<13>,
            10 => Self::sums::<14>,
            11 => Self::sums::<15>,
            12..=14 => Self::sums::<18>,
            _ => Self::sums::<{ SHARED_OFFSET + MAX_LENS_COLUMNS }>,
        };
        let sums = sums(self, lens, &line, samples, block)?;
        let wrt_plane = state.line_jacobian(figure, model);
        let line_shared = sums.line_shared.columns(0, self.free.len());
        block
            .hessian
            .gemm_tr(1.0, &wrt_plane, &(sums.line_square * &wrt_plane), 1.0);
        block.cross.gemm_tr(1.0, &wrt_plane, &line_shared, 1.0);
        block
            .gradient
            .gemv_tr(1.0, &wrt_plane, &sums.line_residual, 1.0);
        Some(sums.cost)
    }

    /// The cost of a plane's samples, and its block.
    fn plane_sums(&self, view: &View<L>, p: usize) -> Option<(f64, Block)> {
        let state = &view.planes[p];
        let mut block = Block::zeros(state.parameter_count(), (0..self.free.len()).collect());
        let mut cost = 0.0;
        for (s, (f, side)) in self.planes[p].sides_by_figure().enumerate() {
            let curve = self.curves.and_then(|curves| curves.get(p, s));
            for found in state.model_lines(&view.lens, f, side) {
                let (model, range) = found?;
                let samples = (&side.samples[range], side.weight_factor(), curve);
                cost += self.add_samples(view, (p, f, &model), samples, &mut block)?;
            }
        }
        state.hold_turn(&mut block.hessian);
        Some((cost, block))
    }
}

impl<L: Lens> Problem for EdgeProblem<'_, L> {
    type State = View<L>;

    fn evaluate(&self, view: &View<L>) -> Option<(f64, ArrowSystem)> {
        let found = each(self.planes.len(), |p| self.plane_sums(view, p))?;
        let (costs, blocks): (Vec<f64>, Vec<Block>) = found.into_iter().unzip();
        let mut system = ArrowSystem::of(self.free.len(), blocks.into_iter());
        let cost = self.free.add_prior(&view.lens, &mut system)
            + self.free.add_reach(&view.lens, &mut system)
            + costs.iter().sum::<f64>();
        view.tie(&mut system);
        Some((cost, system))
    }

    fn advance(&self, view: &View<L>, step: &ArrowStep) -> View<L> {
        view.advanced(self.free, step)
    }
}

#[cfg(test)]
mod tests {
    use super::super::residuals::{residuals, residuals_near};
    use super::*;
    use crate::lens::DefaultLens;
    use crate::observations::{Placement, PlaneEdges, PlaneState, sort_by_plane};
    use crate::synthetic::{Scene, SceneOptions};
    use nalgebra::{DMatrix, DVector, Vector2};

    const NOISE: f64 = 0.2;

    fn scene(noise: f64) -> (Vec<ObservedPlane>, View<DefaultLens>) {
        let truth = Scene::random(4, SceneOptions::default());
        let planes = sort_by_plane(&truth.edges(1, noise, 15.0)).unwrap();
        let state = |pose: &crate::geometry::Pose| PlaneState {
            pose: *pose,
            figures: vec![Placement::IDENTITY],
        };
        let view = View {
            lens: truth.camera,
            planes: truth.poses.iter().map(state).collect(),
            relations: Vec::new(),
        };
        (planes, view)
    }

    /// The same planes with lines of unknown offsets.
    fn facades(noise: f64) -> (Vec<ObservedPlane>, View<DefaultLens>) {
        let truth = Scene::random(4, SceneOptions::default());
        let places: [&[f64]; 2] = [&[-0.5, 0.1, 0.5], &[0.3, -0.5, -0.1, 0.5]];
        let edges = truth.facades(places, 1, noise, 15.0).unwrap();
        let planes = sort_by_plane(&edges).unwrap();
        let (_, mut view) = scene(noise);
        for (plane, state) in planes.iter().zip(&mut view.planes) {
            state.figures[0].free = Placement::ASPECT;
            let shifts = [(0.0, 0.1), (0.3, 0.0), (-0.1, 0.0)];
            for (figure, (x, y)) in plane.figures[1..].iter().zip(shifts) {
                state.figures.push(Placement {
                    shift: Vector2::new(x, y),
                    free: Placement::offset(&figure.sides[0].line().unwrap()),
                    ..Placement::IDENTITY
                });
            }
        }
        (planes, view)
    }

    /// Circles instead of the squares: one of known and one of unknown radius about the origin, and
    /// another one with its own centre.
    fn circles(noise: f64) -> (Vec<ObservedPlane>, View<DefaultLens>) {
        const BESIDE: (f64, f64) = (0.1, -0.05);
        let mut count = 0.0;
        let mut scattered = || {
            count += 1.0;
            1.4 * f64::sin(78.2 * count * count)
        };
        let truth = Scene::random(4, SceneOptions::default());
        let mut edges = Vec::new();
        for (p, pose) in truth.poses.iter().enumerate() {
            let mut circle = |radius: f64, (x, y): (f64, f64)| -> Vec<Vector2<f64>> {
                let seen = (0..40).map(|i| {
                    let angle = 0.157 * f64::from(i);
                    let point = Vector2::new(x + radius * angle.cos(), y + radius * angle.sin());
                    let pixel = truth.camera.project(&pose.transform(&point)).unwrap();
                    pixel + Vector2::new(scattered(), scattered()) * noise
                });
                seen.collect()
            };
            let both = vec![circle(0.4, (0.0, 0.0)), circle(0.25, (0.0, 0.0))];
            let mut both = PlaneEdges::circles(both, None).unwrap();
            both.radii[0] = Some(0.4);
            let mut beside = PlaneEdges::circles(vec![circle(0.3, BESIDE)], None).unwrap();
            both.plane = Some(p as u64);
            beside.plane = both.plane;
            edges.extend([both, beside]);
        }
        let planes = sort_by_plane(&edges).unwrap();
        let round = Placement {
            is_round: true,
            ..Placement::IDENTITY
        };
        let first = Placement {
            radii: vec![0.25],
            ..round.clone()
        };
        let beside = Placement {
            scale: 0.3,
            shift: Vector2::new(BESIDE.0, BESIDE.1),
            free: Placement::SIZE_AND_CENTRE,
            ..round
        };
        let state = |pose: &crate::geometry::Pose| PlaneState {
            pose: *pose,
            figures: vec![first.clone(), beside.clone()],
        };
        let view = View {
            lens: truth.camera,
            planes: truth.poses.iter().map(state).collect(),
            relations: Vec::new(),
        };
        (planes, view)
    }

    fn free() -> FreeParameters {
        FreeParameters::all::<DefaultLens>()
    }

    fn step(system: &ArrowSystem) -> ArrowStep {
        ArrowStep {
            shared: DVector::zeros(system.prior.nrows()),
            blocks: system
                .blocks
                .iter()
                .map(|block| DVector::zeros(block.gradient.len()))
                .collect(),
            predicted_decrease: 0.0,
        }
    }

    #[test]
    fn residual_and_gradient_vanish_at_the_truth() {
        for (planes, view) in [scene(0.0), facades(0.0), circles(0.0)] {
            vanish(&planes, &view);
        }
    }

    fn vanish(planes: &[ObservedPlane], view: &View<DefaultLens>) {
        let (cost, system) = EdgeProblem::new(planes, &free(), NOISE)
            .evaluate(view)
            .unwrap();
        assert!(cost < 1e-18);
        for block in &system.blocks {
            let spread = block.hessian.diagonal().map(f64::sqrt);
            assert!(block.gradient.component_div(&spread).amax() < 1e-9);
        }
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        // The error of a circle's approximate derivatives grows with the square of the distance.
        for (planes, view) in [scene(NOISE), facades(NOISE), circles(0.1 * NOISE)] {
            agree(&planes, &view);
        }
    }

    fn agree(planes: &[ObservedPlane], view: &View<DefaultLens>) {
        let free = free();
        let problem = EdgeProblem::new(planes, &free, NOISE);
        let (_, system) = problem.evaluate(view).unwrap();
        let cost = |step: &ArrowStep| {
            let moved = problem.advance(view, step);
            problem.evaluate(&moved).unwrap().0
        };
        let check = |set: &dyn Fn(&mut ArrowStep, f64), gradient: f64, hessian: f64| {
            // In units of the parameter's own standard deviation.
            let unit = 1.0 / hessian.sqrt();
            let (mut up, mut down) = (step(&system), step(&system));
            set(&mut up, 1e-3 * unit);
            set(&mut down, -1e-3 * unit);
            let expected = (cost(&up) - cost(&down)) / 2e-3;
            assert!(
                (gradient * unit - expected).abs() < 1e-5 * expected.abs().max(1.0),
                "{gradient} {expected}"
            );
        };
        for i in 0..free.len() {
            let blocks = system.blocks.iter();
            let (gradient, hessian) = blocks.fold((0.0, 0.0), |(g, h), block| {
                (g + block.shared_gradient[i], h + block.shared[(i, i)])
            });
            check(&|s, h| s.shared[i] = h, gradient, hessian);
        }
        for (b, block) in system.blocks.iter().enumerate() {
            for i in 0..block.gradient.len() {
                let set = |s: &mut ArrowStep, h: f64| s.blocks[b][i] = h;
                check(&set, block.gradient[i], block.hessian[(i, i)]);
            }
        }
    }

    #[test]
    fn every_number_of_free_parameters_gives_its_part_of_the_sums() {
        let (planes, view) = scene(NOISE);
        let all = EdgeProblem::new(&planes, &free(), NOISE).evaluate(&view);
        let all = all.unwrap().1;
        for count in 0..=free().len() {
            let some = free().leading(count);
            let found = EdgeProblem::new(&planes, &some, NOISE).evaluate(&view);
            let expected = all.leading(count);
            for (found, expected) in found.unwrap().1.blocks.iter().zip(&expected.blocks) {
                let near = |found: &DMatrix<f64>, expected: &DMatrix<f64>| {
                    assert!(
                        (found - expected).amax() <= 1e-9 * expected.amax(),
                        "{count}"
                    );
                };
                near(&found.hessian, &expected.hessian);
                if count > 0 {
                    near(&found.shared, &expected.shared);
                    near(&found.cross, &expected.cross);
                }
            }
        }
    }

    #[test]
    fn curves_give_what_the_samples_give() {
        let truth = Scene::random(4, SceneOptions::default());
        let planes = sort_by_plane(&truth.edges(1, NOISE, 2.0)).unwrap();
        let (_, view) = scene(NOISE);
        let free = free();
        let curves = SideCurves::of(&planes, &view, NOISE);
        let mut sides = planes.iter().enumerate().flat_map(|(p, plane)| {
            let count = plane.sides().count();
            (0..count).map(move |s| (p, s))
        });
        assert!(sides.all(|(p, s)| curves.get(p, s).is_some()));

        // Near the view as well, where the lines do not coincide with the curves.
        let mut near = view.clone();
        near.planes[1].pose.translation.x *= 1.001;
        for view in [view, near] {
            let [all, by_curves] = [None, Some(&curves)].map(|curves| {
                let problem = EdgeProblem::new(&planes, &free, NOISE);
                problem.with_curves(curves).evaluate(&view).unwrap()
            });
            assert!((by_curves.0 / all.0 - 1.0).abs() < 1e-4);
            for (found, expected) in by_curves.1.blocks.iter().zip(&all.1.blocks) {
                let spread = expected.hessian.diagonal().map(f64::sqrt);
                let scaled = |block: &Block| {
                    let hessian = block.hessian.clone();
                    let hessian = hessian.component_div(&(&spread * spread.transpose()));
                    (hessian, block.gradient.component_div(&spread))
                };
                let (found, expected) = (scaled(found), scaled(expected));
                assert!((found.0 - expected.0).amax() < 1e-3);
                assert!(
                    (found.1 - expected.1).amax() < 0.02,
                    "in standard deviations"
                );
            }
            let direct = residuals(&planes, &view).unwrap();
            let found = residuals_near(&planes, &view, Some(&curves)).unwrap();
            for (found, expected) in found.iter().flatten().zip(direct.iter().flatten()) {
                assert!((found.distance - expected.distance).abs() < 1e-3 * NOISE);
                assert!((found.normal - expected.normal).norm() < 1e-3);
                assert_eq!(found.weight, expected.weight);
            }
        }
    }

    #[test]
    fn what_is_no_smooth_curve_has_none() {
        let (planes, view) = circles(0.0);
        let curves = SideCurves::of(&planes, &view, NOISE);
        assert!(curves.get(0, 0).is_none(), "an arc");
        let (few, view) = scene(NOISE);
        let curves = SideCurves::of(&few, &view, NOISE);
        assert!(curves.get(0, 0).is_none(), "few samples");
        // With next to no noise, the polynomial's truncation error matters.
        let truth = Scene::random(4, SceneOptions::default());
        let exact = sort_by_plane(&truth.edges(1, 0.0, 2.0)).unwrap();
        let curves = SideCurves::of(&exact, &view, 1e-13);
        assert!(curves.get(0, 0).is_none(), "exact samples");
    }

    #[test]
    fn residuals_alone_give_the_same_cost() {
        for (planes, view) in [scene(NOISE), circles(NOISE)] {
            let (cost, _) = EdgeProblem::new(&planes, &free(), NOISE)
                .evaluate(&view)
                .unwrap();
            let alone: f64 = residuals(&planes, &view)
                .unwrap()
                .iter()
                .flatten()
                .map(|r| Loss::Tukey.cost_and_weight(r.distance * r.weight / NOISE).0)
                .sum();
            assert!((cost - alone).abs() < 1e-9 * cost);
        }
    }

    #[test]
    fn a_turn_of_circles_changes_nothing_and_is_held() {
        let (planes, view) = circles(NOISE);
        let free = free();
        let problem = EdgeProblem::new(&planes, &free, NOISE);
        let (cost, system) = problem.evaluate(&view).unwrap();
        assert_eq!(view.unknowns(&free), free.len() + 3 * (5 + 1 + 3));
        let mut turned = view.clone();
        for state in &mut turned.planes {
            let turn = state.pose.normal() * 0.3;
            state.pose = state.pose.moved(&turn, &Vector3::zeros());
            let turn = nalgebra::Rotation2::new(-0.3);
            state.figures[1].shift = turn * state.figures[1].shift;
        }
        let (again, _) = problem.evaluate(&turned).unwrap();
        assert!((again - cost).abs() < 1e-9 * cost);
        let step = system.solve(0.0).unwrap();
        for (state, block) in view.planes.iter().zip(&step.blocks) {
            let turn = state.pose.normal().dot(&block.fixed_rows::<3>(0));
            assert!(turn.abs() < 1e-6 * block.norm(), "{turn}");
        }
    }
}
