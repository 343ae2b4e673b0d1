//! The pixels as a least-squares problem over camera, planes and exposures.

use nalgebra::{DMatrix, DVector, Vector2, Vector3};

use crate::arrow::{ArrowStep, ArrowSystem, Block};
use crate::levenberg::Problem;
use crate::parameters::FreeParameters;
use crate::photometric::band::{BandPixel, PixelFigure};
use crate::photometric::coverage::{Coverage, coverage};
use crate::photometric::exposure::{EXPOSURE_PARAMETERS, Exposure};
use crate::refine::View;
use crate::robust::{Loss, Spread, median_scale};
use crate::tone::ToneCurve;
use crate::{Brown, Lens};

/// Noise (coded, 1 being white) below which pixels agree to rounding.
const MIN_NOISE: f64 = 1e-6;

/// Step (in the figure's units) over which the direction of a side at its corner is taken.
const CORNER_STEP: f64 = 0.01;

/// What the fit moves.
#[derive(Clone)]
pub(crate) struct PixelState {
    pub view: View<Brown>,
    /// One per figure, in the order of the figures.
    pub exposures: Vec<Exposure>,
}

/// The pixels around all figures, at given scales of their noise.
#[derive(Clone)]
pub(crate) struct PixelFit<'a> {
    pub figures: &'a [PixelFigure],
    pub free: &'a FreeParameters,
    pub curve: &'a ToneCurve,
    pub loss: Loss,
    /// Noise of each figure's pixels, coded.
    pub scales: Vec<f64>,
}

/// One figure under one state: what all its pixels share.
struct Scene<'a> {
    fit: &'a PixelFit<'a>,
    figure: &'a PixelFigure,
    lens: &'a Brown,
    exposure: &'a Exposure,
    /// The planes through the camera centre and the sides.
    lines: [Vector3<f64>; 4],
    /// Correlation of the blurred sides `i - 1` and `i`: the cosine between their normals.
    corner_correlations: [f64; 4],
}

/// The model at one pixel.
struct Shade {
    residual: f64,
    /// Derivative of the coded value by light.
    slope: f64,
    contrast: f64,
    coverage: Coverage,
    sight: Option<<Brown as Lens>::Sight>,
    z: [f64; 4],
    place: Vector2<f64>,
}

impl Scene<'_> {
    /// `None` where the lens is not invertible.
    fn shade(&self, pixel: &BandPixel) -> Option<Shade> {
        let mut z = [0.0; 4];
        let mut sight = None;
        if pixel.near != 0 {
            let seen = self.lens.sight(&pixel.place)?;
            for side in 0..4 {
                if pixel.near & (1 << side) != 0 {
                    let distance = self.lens.line_distance(&seen, &self.lines[side]);
                    z[side] = distance / self.exposure.blur;
                }
            }
            sight = Some(seen);
        }
        let coverage = coverage(pixel.near, &z, |corner| self.corner_correlations[corner]);
        let place = self.figure.shading_place(&pixel.place);
        let (ground, contrast) = self.exposure.at(&place);
        let light = ground + contrast * coverage.value;
        let (value, slope) = self.fit.curve.encode_with_slope(light);
        Some(Shade {
            residual: value - pixel.value,
            slope,
            contrast,
            coverage,
            sight,
            z,
            place,
        })
    }

    /// Derivatives by the exposure's parameters.
    fn wrt_exposure(&self, shade: &Shade) -> [f64; EXPOSURE_PARAMETERS] {
        let Shade {
            slope,
            contrast,
            coverage,
            place,
            z,
            ..
        } = shade;
        let covered = slope * coverage.value;
        let cuts = &coverage.cuts[..coverage.cut_count];
        let by_blur: f64 = cuts.iter().map(|(side, density)| density * z[*side]).sum();
        [
            *slope,
            slope * place.x,
            slope * place.y,
            covered,
            covered * place.x,
            covered * place.y,
            -slope * contrast * by_blur / self.exposure.blur,
        ]
    }
}

/// Columns of a side's sums before the shared parameters: the line's three, and the residual.
const SHARED_OFFSET: usize = 4;

/// Sums of outer products over one figure, kept by what its pixels depend on.
struct FigureSums<const N: usize> {
    cost: f64,
    /// Pixels cut by one side: `(l, residual, shared, exposure)`.
    sides: [[[f64; N]; N]; 4],
    /// Pixels on a plateau: `(exposure, residual)`.
    plateau: [[f64; EXPOSURE_PARAMETERS + 1]; EXPOSURE_PARAMETERS + 1],
}

fn add_outer<const N: usize>(sums: &mut [[f64; N]; N], row: &[f64; N], weight: f64) {
    for i in 0..N {
        let weighted = weight * row[i];
        for j in 0..N {
            sums[i][j] += weighted * row[j];
        }
    }
}

impl PixelFit<'_> {
    fn scene<'a>(&'a self, state: &'a PixelState, index: usize) -> Option<Scene<'a>> {
        let figure = &self.figures[index];
        let plane = &state.view.planes[figure.plane];
        let lens = &state.view.lens;
        let project = |point: Vector2<f64>| {
            lens.project(
                &plane
                    .pose
                    .transform(&plane.figures[figure.figure].point(point)),
            )
        };
        let mut corner_correlations = [0.0; 4];
        for (i, correlation) in corner_correlations.iter_mut().enumerate() {
            let [before, corner, after] = [(i + 3) % 4, i, (i + 1) % 4].map(|k| figure.corners[k]);
            let here = project(corner)?;
            let arriving = here - project(corner.lerp(&before, CORNER_STEP))?;
            let leaving = project(corner.lerp(&after, CORNER_STEP))? - here;
            *correlation = arriving.normalize().dot(&leaving.normalize());
        }
        Some(Scene {
            fit: self,
            figure,
            lens,
            exposure: &state.exposures[index],
            lines: [0, 1, 2, 3].map(|i| plane.line(figure.figure, &figure.sides[i])),
            corner_correlations,
        })
    }

    /// Robust noise of each figure, from the pixels that an edge cuts.
    pub fn measure_scales(&self, state: &PixelState) -> Option<Vec<f64>> {
        let mut scales = Vec::with_capacity(self.figures.len());
        for index in 0..self.figures.len() {
            let mut residuals = Vec::new();
            self.for_each_cut(state, index, |residual| residuals.push(residual))?;
            scales.push(median_scale(residuals.into_iter()).max(MIN_NOISE));
        }
        Some(scales)
    }

    /// The spread of the pixels that an edge cuts, in units of the scales.
    pub fn spread(&self, state: &PixelState) -> Option<Spread> {
        let mut spread = Spread::default();
        for (index, scale) in self.scales.iter().enumerate() {
            self.for_each_cut(state, index, |r| spread.add(self.loss, r / scale))?;
        }
        Some(spread)
    }

    fn for_each_cut(
        &self,
        state: &PixelState,
        index: usize,
        mut visit: impl FnMut(f64),
    ) -> Option<()> {
        let scene = self.scene(state, index)?;
        for pixel in &self.figures[index].pixels {
            let shade = scene.shade(pixel)?;
            if shade.coverage.cut_count > 0 {
                visit(shade.residual);
            }
        }
        Some(())
    }

    fn add_figure<const N: usize>(
        &self,
        state: &PixelState,
        index: usize,
        system: &mut ArrowSystem,
    ) -> Option<f64> {
        let scene = self.scene(state, index)?;
        let figure = scene.figure;
        let plane = &state.view.planes[figure.plane];
        let jacobians = [0, 1, 2, 3].map(|i| plane.line_jacobian(figure.figure, &figure.sides[i]));
        let exposure_offset = self.exposure_offset(state, index);
        let block = &mut system.blocks[figure.plane];
        let mut sums = FigureSums::<N> {
            cost: 0.0,
            sides: [[[0.0; N]; N]; 4],
            plateau: [[0.0; EXPOSURE_PARAMETERS + 1]; EXPOSURE_PARAMETERS + 1],
        };
        let to_noise = 1.0 / self.scales[index];
        for pixel in &figure.pixels {
            let shade = scene.shade(pixel)?;
            let (cost, weight) = self.loss.cost_and_weight(shade.residual * to_noise);
            sums.cost += cost;
            let weight = weight * to_noise * to_noise;
            if weight == 0.0 {
                continue;
            }
            let wrt_exposure = scene.wrt_exposure(&shade);
            match (shade.coverage.cut_count, &shade.sight) {
                (1, Some(sight)) => {
                    let (side, density) = shade.coverage.cuts[0];
                    let distance = scene.lens.line_distance_jacobian(sight, &scene.lines[side]);
                    let gain = shade.slope * shade.contrast * density / scene.exposure.blur;
                    let mut row = [0.0; N];
                    for i in 0..3 {
                        row[i] = gain * distance.wrt_line[i];
                    }
                    row[3] = shade.residual;
                    let (shared, exposure) =
                        row[SHARED_OFFSET..].split_at_mut(N - SHARED_OFFSET - EXPOSURE_PARAMETERS);
                    self.free.gather(&distance.wrt_lens, shared);
                    shared.iter_mut().for_each(|value| *value *= gain);
                    exposure.copy_from_slice(&wrt_exposure);
                    add_outer(&mut sums.sides[side], &row, weight);
                }
                (2, Some(sight)) => {
                    let mut own = DVector::zeros(block.hessian.nrows());
                    let mut shared = DVector::zeros(self.free.len());
                    let mut part = DVector::zeros(self.free.len());
                    for (side, density) in shade.coverage.cuts {
                        let distance = scene.lens.line_distance_jacobian(sight, &scene.lines[side]);
                        let gain = shade.slope * shade.contrast * density / scene.exposure.blur;
                        let jacobian = &jacobians[side];
                        let mut geometry = own.rows_mut(0, jacobian.ncols());
                        geometry.gemv_tr(gain, jacobian, &distance.wrt_line, 1.0);
                        self.free.gather(&distance.wrt_lens, part.as_mut_slice());
                        shared.axpy(gain, &part, 1.0);
                    }
                    own.rows_mut(exposure_offset, EXPOSURE_PARAMETERS)
                        .copy_from_slice(&wrt_exposure);
                    add_row(block, &own, &shared, shade.residual, weight);
                }
                _ => {
                    let mut row = [0.0; EXPOSURE_PARAMETERS + 1];
                    row[..EXPOSURE_PARAMETERS].copy_from_slice(&wrt_exposure);
                    row[EXPOSURE_PARAMETERS] = shade.residual;
                    add_outer(&mut sums.plateau, &row, weight);
                }
            }
        }
        for (side, jacobian) in jacobians.iter().enumerate() {
            add_side(block, &sums.sides[side], jacobian, exposure_offset);
        }
        add_plateau(block, &sums.plateau, exposure_offset);
        Some(sums.cost)
    }

    /// Where a figure's exposure begins among its plane's own parameters.
    fn exposure_offset(&self, state: &PixelState, index: usize) -> usize {
        let figure = &self.figures[index];
        state.view.planes[figure.plane].parameter_count() + EXPOSURE_PARAMETERS * figure.figure
    }

    fn assemble<const N: usize>(&self, state: &PixelState) -> Option<(f64, ArrowSystem)> {
        if !state.exposures.iter().all(Exposure::is_valid) {
            return None;
        }
        let own = state
            .view
            .planes
            .iter()
            .map(|plane| plane.parameter_count() + EXPOSURE_PARAMETERS * plane.figures.len());
        let mut system = ArrowSystem::zeros(self.free.len(), own);
        let mut cost = 0.0;
        for index in 0..self.figures.len() {
            cost += self.add_figure::<N>(state, index, &mut system)?;
        }
        Some((cost, system))
    }
}

/// Adds one row of the Jacobian.
fn add_row(
    block: &mut Block,
    own: &DVector<f64>,
    shared: &DVector<f64>,
    residual: f64,
    weight: f64,
) {
    block.hessian.ger(weight, own, own, 1.0);
    block.cross.ger(weight, own, shared, 1.0);
    block.gradient.axpy(weight * residual, own, 1.0);
    block.shared.ger(weight, shared, shared, 1.0);
    block.shared_gradient.axpy(weight * residual, shared, 1.0);
}

/// Brings the plane's own parameters into the sums of one side: with `M` the map from
/// (own geometry, exposure) to (line, exposure), the block is `M^T S M`.
fn add_side<const N: usize>(
    block: &mut Block,
    sums: &[[f64; N]; N],
    jacobian: &DMatrix<f64>,
    exposure_offset: usize,
) {
    let shared = N - SHARED_OFFSET - EXPOSURE_PARAMETERS;
    let exposure = SHARED_OFFSET + shared;
    let rows = 3 + EXPOSURE_PARAMETERS;
    // Row of the sums that belongs to a row of the map.
    let source = |i: usize| if i < 3 { i } else { exposure + i - 3 };
    let mut map = DMatrix::zeros(rows, block.hessian.nrows());
    map.view_mut((0, 0), (3, jacobian.ncols()))
        .copy_from(jacobian);
    for i in 0..EXPOSURE_PARAMETERS {
        map[(3 + i, exposure_offset + i)] = 1.0;
    }
    let square = DMatrix::from_fn(rows, rows, |i, j| sums[source(i)][source(j)]);
    let cross = DMatrix::from_fn(rows, shared, |i, j| sums[source(i)][SHARED_OFFSET + j]);
    let residual = DVector::from_fn(rows, |i, _| sums[source(i)][3]);
    block.hessian.gemm_tr(1.0, &map, &(square * &map), 1.0);
    block.cross.gemm_tr(1.0, &map, &cross, 1.0);
    block.gradient.gemv_tr(1.0, &map, &residual, 1.0);
    for i in 0..shared {
        for j in 0..shared {
            block.shared[(i, j)] += sums[SHARED_OFFSET + i][SHARED_OFFSET + j];
        }
        block.shared_gradient[i] += sums[SHARED_OFFSET + i][3];
    }
}

fn add_plateau(
    block: &mut Block,
    sums: &[[f64; EXPOSURE_PARAMETERS + 1]; EXPOSURE_PARAMETERS + 1],
    exposure_offset: usize,
) {
    for i in 0..EXPOSURE_PARAMETERS {
        for j in 0..EXPOSURE_PARAMETERS {
            block.hessian[(exposure_offset + i, exposure_offset + j)] += sums[i][j];
        }
        block.gradient[exposure_offset + i] += sums[i][EXPOSURE_PARAMETERS];
    }
}

impl Problem for PixelFit<'_> {
    type State = PixelState;

    fn evaluate(&self, state: &PixelState) -> Option<(f64, ArrowSystem)> {
        // One instance per number of shared parameters, so that the innermost loops are unrolled.
        match self.free.len() {
            0 => self.assemble::<11>(state),
            1 => self.assemble::<12>(state),
            2 => self.assemble::<13>(state),
            3 => self.assemble::<14>(state),
            4 => self.assemble::<15>(state),
            5 => self.assemble::<16>(state),
            6 => self.assemble::<17>(state),
            7 => self.assemble::<18>(state),
            8 => self.assemble::<19>(state),
            _ => self.assemble::<20>(state),
        }
    }

    fn advance(&self, state: &PixelState, step: &ArrowStep) -> PixelState {
        let exposures = state.exposures.iter().enumerate().map(|(index, exposure)| {
            let own = &step.blocks[self.figures[index].plane];
            let offset = self.exposure_offset(state, index);
            exposure.moved(&own.as_slice()[offset..offset + EXPOSURE_PARAMETERS])
        });
        PixelState {
            exposures: exposures.collect(),
            view: state.view.advanced(self.free, step),
        }
    }
}
