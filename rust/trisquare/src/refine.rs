//! Joint maximum likelihood over the camera, its distortion and all planes, from edge samples.
//!
//! The residual of a sample is its distance, in pixels of the photograph, to the image of its
//! line, divided by its standard deviation. Lines and planes meet the lens only through the plane
//! `l` that a line spans with the camera centre, so the samples of a side are summed over
//! `(l, lens)` first and the pose is brought in once per side.

use std::marker::PhantomData;

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};

use crate::arrow::{ArrowStep, ArrowSystem};
use crate::lens::MAX_LENS_COLUMNS;
use crate::levenberg::{Limits, Problem, Termination, minimise};
use crate::observations::{ObservedPlane, Placement, Side};
use crate::outer::{add_outer, symmetric};
use crate::parameters::FreeParameters;
use crate::robust::{Loss, Spread, median_scale};
use crate::{Lens, Pose};

/// Noise below this (px) is rounding, not measurement.
pub(crate) const MIN_SCALE: f64 = 1e-9;

/// Evaluations allowed to each round of one scale; from the linear start about six are used.
const MAX_ITERATIONS: usize = 100;

/// Rounds of re-estimated scale and loss; the second usually changes next to nothing.
const MAX_ROUNDS: usize = 12;

/// Fall of the cost, in units of the noise variance, below which a step is the last of the search:
/// it is still taken, and what it leaves is second order.
const LAST_DECREASE: f64 = 0.5;

/// Newton steps on all samples, from the optimum of some.
const MAX_FINAL_STEPS: usize = 20;

/// Predicted fall of the cost, in units of the noise variance, below which a Newton step is the
/// last: what it leaves is its square.
const LAST_FINAL_DECREASE: f64 = 0.03;

/// A scale that changes by less than this part no longer changes the answer: by a thousandth of a
/// standard deviation.
const FINAL_SCALE_TOLERANCE: f64 = 0.01;

/// Changes of the scale allowed: one that still wanders then is two modes of one optimum.
const MAX_RESCALINGS: usize = 4;

/// A relative rise of the cost that is rounding.
const FINAL_ROUNDING: f64 = 1e-9;

/// A scale that changes by less than this part no longer changes the weights.
const SCALE_TOLERANCE: f64 = 0.1;

/// Parameters of a pose: rotation vector, translation.
pub(crate) const POSE_PARAMETERS: usize = 6;

/// A camera and the planes it sees.
#[derive(Debug, Clone)]
pub(crate) struct View<L> {
    pub lens: L,
    pub planes: Vec<PlaneState>,
}

/// Where a plane stands, and where its figures lie on it.
#[derive(Debug, Clone)]
pub(crate) struct PlaneState {
    pub pose: Pose,
    pub figures: Vec<Placement>,
}

impl PlaneState {
    pub fn parameter_count(&self) -> usize {
        POSE_PARAMETERS + self.figures.iter().map(|f| f.free).sum::<usize>()
    }

    /// Where the parameters of a figure begin among the plane's own.
    pub fn figure_offset(&self, figure: usize) -> usize {
        POSE_PARAMETERS + self.figures[..figure].iter().map(|f| f.free).sum::<usize>()
    }

    /// The plane through the camera centre and a line of a figure.
    pub fn line(&self, figure: usize, side: &Side) -> Vector3<f64> {
        self.pose.line_map() * self.figures[figure].line(&side.line)
    }

    /// Its derivative by the plane's own parameters.
    ///
    /// With `l = L (a, b, c)`, `d` the line's direction and `m = R d`:
    /// `l = c r3 + m x t`, so a rotation `w` gives `(-c [r3]x + [t]x [m]x) w`, a translation
    /// `m x dt`.
    pub fn line_jacobian(&self, figure: usize, side: &Side) -> DMatrix<f64> {
        let placement = &self.figures[figure];
        let map = self.pose.line_map();
        let line = placement.line(&side.line);
        let direction = self.pose.rotation * Vector3::new(-line.y, line.x, 0.0);
        let turn = direction.cross_matrix();
        let wrt_rotation = self.pose.translation.cross_matrix() * turn
            - self.pose.normal().cross_matrix() * line.z;
        let mut jacobian = DMatrix::zeros(3, self.parameter_count());
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&wrt_rotation);
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&turn);
        let offset = self.figure_offset(figure);
        let derivatives = placement.line_derivatives(&side.line);
        for (i, derivative) in derivatives.iter().take(placement.free).enumerate() {
            jacobian.set_column(offset + i, &(map * derivative));
        }
        jacobian
    }

    /// The plane after a step of its own parameters (any that follow are not its geometry).
    pub fn moved(&self, step: &[f64]) -> Self {
        let pose = self.pose.moved(
            &Vector3::new(step[0], step[1], step[2]),
            &Vector3::new(step[3], step[4], step[5]),
        );
        let mut offset = POSE_PARAMETERS;
        let figures = self.figures.iter().map(|figure| {
            let own = &step[offset..offset + figure.free];
            offset += figure.free;
            figure.moved(own)
        });
        Self {
            figures: figures.collect(),
            pose,
        }
    }
}

/// The samples as a least-squares problem at one scale of the noise.
pub(crate) struct EdgeProblem<'a, L> {
    planes: &'a [ObservedPlane],
    free: &'a FreeParameters,
    loss: Loss,
    /// What the given standard deviations are to be multiplied by.
    scale: f64,
    lens: PhantomData<L>,
}

/// Summed outer products of `(l, residual, shared parameters)` of one side's samples.
struct SideSums<const N: usize> {
    cost: f64,
    products: [[f64; N]; N],
}

/// Columns before the shared parameters: the line's three, and the residual.
const SHARED_OFFSET: usize = 4;

impl<'a, L: Lens> EdgeProblem<'a, L> {
    pub fn new(planes: &'a [ObservedPlane], free: &'a FreeParameters, scale: f64) -> Self {
        Self {
            planes,
            free,
            loss: Loss::Tukey,
            scale,
            lens: PhantomData,
        }
    }

    fn sum_side<const N: usize>(
        &self,
        lens: &L,
        line: &Vector3<f64>,
        side: &Side,
    ) -> Option<SideSums<N>> {
        let mut sums = SideSums {
            cost: 0.0,
            products: [[0.0; N]; N],
        };
        let wanted = self.free.columns();
        let mut row = [0.0; N];
        for sample in &side.samples {
            let sight = lens.sight(&sample.pixel)?;
            let distance = lens.line_distance_jacobian(&sight, line, wanted);
            let to_noise = sample.weight / self.scale;
            let (cost, weight) = self.loss.cost_and_weight(distance.value * to_noise);
            let weight = weight * to_noise * to_noise;
            sums.cost += cost;
            row[..3].copy_from_slice(distance.wrt_line.as_slice());
            row[3] = distance.value;
            self.free
                .gather(&distance.wrt_lens, &mut row[SHARED_OFFSET..]);
            add_outer(&mut sums.products, &row, weight);
        }
        Some(sums)
    }

    /// Adds one side's samples to the system; returns their cost.
    fn add_side<const N: usize>(
        &self,
        view: &View<L>,
        (plane, figure): (usize, usize),
        side: &Side,
        system: &mut ArrowSystem,
    ) -> Option<f64> {
        let state = &view.planes[plane];
        let line = state.line(figure, side);
        let sums = self.sum_side::<N>(&view.lens, &line, side)?;
        let wrt_own = state.line_jacobian(figure, side);
        let at = |i: usize, j: usize| symmetric(&sums.products, i, j);

        let shared = N - SHARED_OFFSET;
        let line_square = Matrix3::from_fn(at);
        let line_residual = Vector3::from_fn(|i, _| at(i, 3));
        let line_shared = SMatrix::<f64, 3, MAX_LENS_COLUMNS>::from_fn(|i, j| match j < shared {
            true => at(i, SHARED_OFFSET + j),
            false => 0.0,
        });
        let block = &mut system.blocks[plane];
        for i in 0..shared {
            for j in 0..shared {
                block.shared[(i, j)] += at(SHARED_OFFSET + i, SHARED_OFFSET + j);
            }
            block.shared_gradient[i] += at(SHARED_OFFSET + i, 3);
        }
        block
            .hessian
            .gemm_tr(1.0, &wrt_own, &(line_square * &wrt_own), 1.0);
        block
            .cross
            .gemm_tr(1.0, &wrt_own, &line_shared.columns(0, shared), 1.0);
        block.gradient.gemv_tr(1.0, &wrt_own, &line_residual, 1.0);
        Some(sums.cost)
    }

    fn assemble<const N: usize>(&self, view: &View<L>) -> Option<(f64, ArrowSystem)> {
        let own = view.planes.iter().map(PlaneState::parameter_count);
        let mut system = ArrowSystem::zeros(N - SHARED_OFFSET, own);
        let mut cost = 0.0;
        for (p, plane) in self.planes.iter().enumerate() {
            for (f, figure) in plane.figures.iter().enumerate() {
                for side in &figure.sides {
                    cost += self.add_side::<N>(view, (p, f), side, &mut system)?;
                }
            }
        }
        Some((cost, system))
    }
}

impl<L: Lens> Problem for EdgeProblem<'_, L> {
    type State = View<L>;

    fn evaluate(&self, view: &View<L>) -> Option<(f64, ArrowSystem)> {
        // One instance per number of shared parameters, so that the innermost loops are unrolled.
        match self.free.len() {
            0 => self.assemble::<4>(view),
            1 => self.assemble::<5>(view),
            2 => self.assemble::<6>(view),
            3 => self.assemble::<7>(view),
            4 => self.assemble::<8>(view),
            5 => self.assemble::<9>(view),
            6 => self.assemble::<10>(view),
            7 => self.assemble::<11>(view),
            8 => self.assemble::<12>(view),
            9 => self.assemble::<13>(view),
            10 => self.assemble::<14>(view),
            _ => self.assemble::<15>(view),
        }
    }

    fn advance(&self, view: &View<L>, step: &ArrowStep) -> View<L> {
        view.advanced(self.free, step)
    }
}

impl<L: Lens> View<L> {
    /// Parameters of the camera that are free, and of all planes.
    pub fn unknowns(&self, free: &FreeParameters) -> usize {
        free.len()
            + self
                .planes
                .iter()
                .map(PlaneState::parameter_count)
                .sum::<usize>()
    }

    /// The view after a step of the free parameters.
    pub fn advanced(&self, free: &FreeParameters, step: &ArrowStep) -> Self {
        let planes = self.planes.iter().zip(&step.blocks);
        Self {
            lens: free.advance(&self.lens, &step.shared),
            planes: planes
                .map(|(plane, own)| plane.moved(own.as_slice()))
                .collect(),
        }
    }
}

/// Distance of a sample to the image of its line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    /// Signed, in pixels.
    pub distance: f64,
    /// One over the standard deviation given for the sample.
    pub weight: f64,
}

/// The residuals of all samples, by plane.
pub(crate) type Residuals = Vec<Vec<Residual>>;

/// Distances of all samples; `None` where the lens is not invertible.
pub(crate) fn residuals<L: Lens>(planes: &[ObservedPlane], view: &View<L>) -> Option<Residuals> {
    let mut all = Vec::with_capacity(planes.len());
    for (plane, state) in planes.iter().zip(&view.planes) {
        let mut own = Vec::new();
        for (f, figure) in plane.figures.iter().enumerate() {
            for side in &figure.sides {
                let line = state.line(f, side);
                for sample in &side.samples {
                    let sight = view.lens.sight(&sample.pixel)?;
                    own.push(Residual {
                        distance: view.lens.line_distance(&sight, &line),
                        weight: sample.weight,
                    });
                }
            }
        }
        all.push(own);
    }
    Some(all)
}

/// The optimum, with what the covariance needs.
#[derive(Clone)]
pub(crate) struct Refined<L> {
    pub view: View<L>,
    /// Normal equations at the optimum, in units of the noise, over the parameters that were
    /// asked for.
    pub system: ArrowSystem,
    /// Turns the inverse of the weighted information into a covariance.
    pub covariance_factor: f64,
    /// What the given standard deviations must be multiplied by.
    pub noise_scale: f64,
    pub residuals: Residuals,
    pub iterations: usize,
}

impl<L: Lens> Refined<L> {
    /// Measures the spread of the residuals around a view.
    fn around(
        (view, residuals, system): (View<L>, Residuals, ArrowSystem),
        scale: f64,
        unknowns: usize,
        iterations: usize,
    ) -> Self {
        let mut spread = Spread::default();
        for residual in residuals.iter().flatten() {
            spread.add(Loss::Tukey, residual.distance * residual.weight / scale);
        }
        let covariance_factor = spread.covariance_factor(unknowns);
        Self {
            view,
            system,
            covariance_factor,
            noise_scale: scale * (covariance_factor / Loss::Tukey.mean_weight()).sqrt(),
            residuals,
            iterations,
        }
    }

    /// The linear steps' answer, with the spread of its residuals.
    pub fn of_linear(
        planes: &[ObservedPlane],
        free: &FreeParameters,
        judged: &FreeParameters,
        view: View<L>,
    ) -> Option<Self> {
        let residuals = residuals(planes, &view)?;
        let scale = robust_scale(&residuals);
        let unknowns = view.unknowns(free);
        let (_, system) = EdgeProblem::new(planes, judged, scale).evaluate(&view)?;
        Some(Self::around((view, residuals, system), scale, unknowns, 0))
    }
}

/// Where a search for the optimum ended.
#[derive(Clone)]
pub(crate) struct Search<L> {
    pub view: View<L>,
    /// Scale of the noise there.
    pub scale: f64,
    pub iterations: usize,
    pub termination: Termination,
}

/// Searches the optimum from a start; `None` if the lens is not invertible at a sample there.
///
/// Rounds of fixed scale: Huber's loss first, which cannot lose the way, then Tukey's biweight
/// until the scale settles.
pub(crate) fn search<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    start: View<L>,
) -> Option<Search<L>> {
    let limits = Limits {
        iterations: MAX_ITERATIONS,
        decrease: LAST_DECREASE,
    };
    let mut found = Search {
        scale: scale_of(planes, &start)?,
        view: start,
        iterations: 0,
        termination: Termination::IterationLimit,
    };
    for round in 0..MAX_ROUNDS {
        let mut problem = EdgeProblem::new(planes, free, found.scale);
        problem.loss = if round == 0 { Loss::Huber } else { Loss::Tukey };
        let minimum = minimise(&problem, found.view, limits)?;
        found.iterations += minimum.iterations;
        found.termination = minimum.termination;
        found.view = minimum.state;
        let last = std::mem::replace(&mut found.scale, scale_of(planes, &found.view)?);
        let settled = round > 0 && (found.scale / last - 1.0).abs() < SCALE_TOLERANCE;
        if settled || found.termination != Termination::Converged {
            break;
        }
        // A scale that still wanders after all rounds is two modes of the same optimum.
    }
    Some(found)
}

/// Finishes a search on all samples, from the optimum of some of them.
///
/// A few Newton steps, until the scale of all residuals has settled; the normal equations are left over the
/// parameters to be judged, which begin with the free ones. `None` if the steps do not settle: the
/// start was no optimum.
pub(crate) fn finish<L: Lens>(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    judged: &FreeParameters,
    start: Search<L>,
) -> Option<Refined<L>> {
    let mut view = start.view;
    let mut iterations = start.iterations;
    let unknowns = view.unknowns(free);
    let mut scale = start.scale;
    let mut rescalings = 0;
    let mut last_cost = f64::INFINITY;
    for _ in 0..MAX_FINAL_STEPS {
        let problem = EdgeProblem::new(planes, judged, scale);
        let (cost, system) = problem.evaluate(&view)?;
        iterations += 1;
        if cost > last_cost * (1.0 + FINAL_ROUNDING) {
            return None;
        }
        last_cost = cost;
        let step = system
            .leading(free.len())
            .solve(0.0)?
            .lengthened(problem.loss.newton_factor());
        view = view.advanced(free, &step);
        let arrived = step.predicted_decrease < LAST_FINAL_DECREASE;
        if !arrived && rescalings > 0 {
            continue;
        }
        // The weights must not depend on where the search came from.
        let residuals = residuals(planes, &view)?;
        let next = robust_scale(&residuals);
        let settled = (next / scale - 1.0).abs() < FINAL_SCALE_TOLERANCE;
        if arrived && (settled || rescalings == MAX_RESCALINGS) {
            let found = (view, residuals, system);
            return Some(Refined::around(found, scale, unknowns, iterations));
        }
        (scale, last_cost) = (next, f64::INFINITY);
        rescalings += 1;
    }
    None
}

/// The scale of the bulk of the residuals, in units of their given standard deviations.
fn scale_of<L: Lens>(planes: &[ObservedPlane], view: &View<L>) -> Option<f64> {
    Some(robust_scale(&residuals(planes, view)?))
}

fn robust_scale(residuals: &Residuals) -> f64 {
    let normalised = residuals.iter().flatten().map(|r| r.distance * r.weight);
    median_scale(normalised).max(MIN_SCALE)
}
