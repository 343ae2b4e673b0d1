//! Normal equations of one figure's pixels, summed by what the pixels depend on.
//!
//! Nearly all pixels that an edge cuts are cut by one side. The derivatives of their distances by
//! pose and camera are polynomials along it: they are summed over `(terms, residual, picture,
//! exposure)`, and pose and camera are brought in once per side. The few at corners are added row
//! by row.

use nalgebra::{DMatrix, DVector};

use super::band::BandPixel;
use super::exposure::EXPOSURE_PARAMETERS;
use super::figure_chart::{FigureChart, TERMS};
use super::scene::{Scene, Shade};
use crate::image::PICTURE_PARAMETERS;
use crate::lens::{Lens, MAX_LENS_COLUMNS};
use crate::numeric::{Block, add_rank_one, symmetric};
use crate::observations::FreeParameters;

/// What a pixel that one side cuts depends on: `(terms, residual, picture, exposure)`.
const CUT: usize = EXPOSURE + EXPOSURE_PARAMETERS;
const RESIDUAL: usize = TERMS;
const PICTURE: usize = RESIDUAL + 1;
const EXPOSURE: usize = PICTURE + PICTURE_PARAMETERS;

/// `(exposure, residual)`: what a pixel on a plateau depends on.
pub(super) type ExposureRow = [f64; EXPOSURE_PARAMETERS + 1];

/// Sums of outer products of [`ExposureRow`]s.
pub(super) type ExposureSums = [ExposureRow; EXPOSURE_PARAMETERS + 1];

/// The same where the picture has parameters: `(exposure, picture, residual)`.
type PicturedRow = [f64; PICTURED];
type PicturedSums = [PicturedRow; PICTURED];
const PICTURED: usize = EXPOSURE_PARAMETERS + PICTURE_PARAMETERS + 1;

/// Sums of outer products over one figure.
pub(super) struct FigureSums<'a> {
    free: &'a FreeParameters,
    /// How many shared parameters the figure depends on: the camera's, then its picture's.
    shared: usize,
    /// Derivatives of each side's line by the plane's geometry.
    jacobians: [DMatrix<f64>; 4],
    /// Where the figure's exposure begins among its plane's own parameters.
    exposure_offset: usize,
    sides: [[[f64; CUT]; CUT]; 4],
    plateau: ExposureSums,
    pictured_plateau: PicturedSums,
    /// Derivatives of one pixel at a corner, by the plane's own parameters and the shared ones.
    corner_own: DVector<f64>,
    corner_shared: Vec<f64>,
}

impl<'a> FigureSums<'a> {
    pub fn new(
        free: &'a FreeParameters,
        shared: usize,
        jacobians: [DMatrix<f64>; 4],
        (own_count, exposure_offset): (usize, usize),
    ) -> Self {
        Self {
            corner_own: DVector::zeros(own_count),
            corner_shared: vec![0.0; shared],
            free,
            shared,
            jacobians,
            exposure_offset,
            sides: [[[0.0; CUT]; CUT]; 4],
            plateau: ExposureSums::default(),
            pictured_plateau: PicturedSums::default(),
        }
    }

    /// Adds a pixel that one side cuts.
    #[inline]
    pub fn add_cut<L: Lens>(
        &mut self,
        scene: &Scene<'_, L>,
        (chart, pixel): (&FigureChart, &BandPixel),
        shade: &Shade,
        weight: f64,
    ) {
        let (side, density) = shade.coverage.cuts[0];
        let gain = scene.gain(shade, density);
        let mut row = [shade.residual; CUT];
        row[..TERMS].copy_from_slice(&chart.terms(side, pixel).map(|term| gain * term));
        row[PICTURE..EXPOSURE].copy_from_slice(&scene.wrt_picture(shade));
        row[EXPOSURE..].copy_from_slice(&scene.wrt_exposure(shade));
        add_rank_one(&mut self.sides[side], &row, weight);
    }

    /// Adds a pixel that two sides cut.
    pub fn add_corner<L: Lens>(
        &mut self,
        scene: &Scene<'_, L>,
        pixel: &BandPixel,
        shade: &Shade,
        weight: f64,
        block: &mut Block,
    ) -> Option<()> {
        let pixel_ray = scene.lens.unproject_with_jacobian(&pixel.place())?;
        let picture = self.has_picture().then(|| scene.wrt_picture(shade));
        let (own, shared) = (&mut self.corner_own, &mut self.corner_shared);
        own.fill(0.0);
        shared.fill(0.0);
        let camera = self.free.len();
        let mut part = [0.0; MAX_LENS_COLUMNS];
        for (side, density) in shade.coverage.cuts {
            let line = &scene.lines[side];
            let distance = scene
                .lens
                .line_distance_jacobian(&pixel_ray, line, self.free.columns());
            let gain = scene.gain(shade, density);
            let jacobian = &self.jacobians[side];
            let mut geometry = own.rows_mut(0, jacobian.ncols());
            geometry.gemv_tr(gain, jacobian, &distance.wrt_line, 1.0);
            self.free.gather(&distance.wrt_lens, &mut part[..camera]);
            for (sum, value) in shared.iter_mut().zip(&part[..camera]) {
                *sum += gain * value;
            }
        }
        if let Some(picture) = picture {
            shared[camera..].copy_from_slice(&picture);
        }
        own.rows_mut(self.exposure_offset, EXPOSURE_PARAMETERS)
            .copy_from_slice(&scene.wrt_exposure(shade));
        block.hessian.ger(weight, own, own, 1.0);
        block.gradient.axpy(weight * shade.residual, own, 1.0);
        for (row, by_row) in shared.iter().enumerate() {
            let mut cross = block.cross.column_mut(row);
            cross.axpy(weight * by_row, own, 1.0);
            block.shared_gradient[row] += weight * shade.residual * by_row;
            for (column, by_column) in shared.iter().enumerate() {
                block.shared[(row, column)] += weight * by_row * by_column;
            }
        }
        Some(())
    }

    /// Adds a pixel that shows the ground or the figure alone.
    #[inline]
    pub fn add_plateau<L: Lens>(&mut self, scene: &Scene<'_, L>, shade: &Shade, weight: f64) {
        if self.has_picture() {
            let mut row = [shade.residual; PICTURED];
            row[..EXPOSURE_PARAMETERS].copy_from_slice(&scene.wrt_exposure(shade));
            row[EXPOSURE_PARAMETERS..PICTURED - 1].copy_from_slice(&scene.wrt_picture(shade));
            add_rank_one(&mut self.pictured_plateau, &row, weight);
        } else {
            add_rank_one(&mut self.plateau, &scene.exposure_row(shade), weight);
        }
    }

    fn has_picture(&self) -> bool {
        self.shared > self.free.len()
    }

    /// Adds all sums to the plane's block; `None` where the lens does not see a side.
    pub fn finish<L: Lens>(
        self,
        scene: &Scene<'_, L>,
        chart: &FigureChart,
        block: &mut Block,
    ) -> Option<()> {
        for side in 0..4 {
            self.add_side(side, &chart.jacobian(scene, side, self.free)?, block);
        }
        if self.has_picture() {
            let at = (self.exposure_offset, self.free.len());
            add_pictured(block, &self.pictured_plateau, at);
        } else {
            add_exposure(block, &self.plateau, self.exposure_offset);
        }
        Some(())
    }

    /// Brings pose and camera into the sums of a side, `terms` being the coefficients of the
    /// distance's derivatives along it: with `M` the map from the plane's own and the shared
    /// parameters to what is summed over, the block is `M^T S M`.
    fn add_side(&self, side: usize, terms: &DMatrix<f64>, block: &mut Block) {
        let at = |i: usize, j: usize| symmetric(&self.sides[side], i, j);
        // What is summed over, but for the residual.
        let source = |i: usize| if i < RESIDUAL { i } else { i + 1 };
        let square = DMatrix::from_fn(CUT - 1, CUT - 1, |i, j| at(source(i), source(j)));
        let residual = DVector::from_fn(CUT - 1, |i, _| at(source(i), RESIDUAL));

        let jacobian = &self.jacobians[side];
        let mut own = DMatrix::zeros(CUT - 1, block.hessian.nrows());
        let geometry = terms.columns(0, 3) * jacobian;
        own.view_mut((0, 0), geometry.shape()).copy_from(&geometry);
        for i in 0..EXPOSURE_PARAMETERS {
            own[(EXPOSURE - 1 + i, self.exposure_offset + i)] = 1.0;
        }
        let camera = self.free.len();
        let mut shared = DMatrix::zeros(CUT - 1, self.shared);
        let by_camera = terms.columns(3, camera);
        shared
            .view_mut((0, 0), (TERMS, camera))
            .copy_from(&by_camera);
        for i in camera..self.shared {
            shared[(PICTURE - 1 + i - camera, i)] = 1.0;
        }

        let by_shared = &square * &shared;
        block.hessian.gemm_tr(1.0, &own, &(square * &own), 1.0);
        block.gradient.gemv_tr(1.0, &own, &residual, 1.0);
        block.cross.gemm_tr(1.0, &own, &by_shared, 1.0);
        block.shared.gemm_tr(1.0, &shared, &by_shared, 1.0);
        block.shared_gradient.gemv_tr(1.0, &shared, &residual, 1.0);
    }
}

/// Adds sums over exposure and picture, which begin there among the plane's own parameters and
/// the shared ones.
fn add_pictured(
    block: &mut Block,
    sums: &PicturedSums,
    (exposure_offset, picture): (usize, usize),
) {
    let exposure_only = std::array::from_fn(|i| {
        let source = |k: usize| {
            if k < EXPOSURE_PARAMETERS {
                k
            } else {
                PICTURED - 1
            }
        };
        std::array::from_fn(|j| symmetric(sums, source(i), source(j)))
    });
    add_exposure(block, &exposure_only, exposure_offset);
    for i in 0..PICTURE_PARAMETERS {
        let (row, own) = (picture + i, EXPOSURE_PARAMETERS + i);
        for k in 0..EXPOSURE_PARAMETERS {
            block.cross[(exposure_offset + k, row)] += symmetric(sums, own, k);
        }
        for j in 0..PICTURE_PARAMETERS {
            block.shared[(row, picture + j)] += symmetric(sums, own, EXPOSURE_PARAMETERS + j);
        }
        block.shared_gradient[row] += symmetric(sums, own, PICTURED - 1);
    }
}

/// Adds sums over the exposure alone.
pub(super) fn add_exposure(block: &mut Block, sums: &ExposureSums, exposure_offset: usize) {
    for i in 0..EXPOSURE_PARAMETERS {
        for j in 0..EXPOSURE_PARAMETERS {
            block.hessian[(exposure_offset + i, exposure_offset + j)] += symmetric(sums, i, j);
        }
        block.gradient[exposure_offset + i] += symmetric(sums, i, EXPOSURE_PARAMETERS);
    }
}
