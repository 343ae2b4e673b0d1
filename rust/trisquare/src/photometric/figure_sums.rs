//! Normal equations of one figure's pixels, summed by what the pixels depend on.
//!
//! Nearly all pixels that an edge cuts are cut by one side, whose line `l` they share: they are
//! summed over `(l, residual, shared, exposure)`, and the plane's own parameters are brought in
//! once per side. The few at corners are added row by row.

use nalgebra::{DMatrix, DVector};

use super::exposure::EXPOSURE_PARAMETERS;
use super::scene::{Scene, Shade};
use crate::image::PICTURE_PARAMETERS;
use crate::lens::{Columns, Lens, MAX_LENS_COLUMNS};
use crate::numeric::{Block, add_rank_one, symmetric};
use crate::observations::FreeParameters;

/// Columns of a side's sums before the shared parameters: the line's three, and the residual.
const SHARED_OFFSET: usize = 4;

/// `(exposure, residual)`: what a pixel on a plateau depends on.
pub(super) type ExposureRow = [f64; EXPOSURE_PARAMETERS + 1];

/// Sums of outer products of [`ExposureRow`]s.
pub(super) type ExposureSums = [ExposureRow; EXPOSURE_PARAMETERS + 1];

/// The same where the picture has parameters: `(exposure, picture, residual)`.
type PicturedRow = [f64; PICTURED];
type PicturedSums = [PicturedRow; PICTURED];
const PICTURED: usize = EXPOSURE_PARAMETERS + PICTURE_PARAMETERS + 1;

/// Sums of outer products over one figure.
pub(super) struct FigureSums<'a, const N: usize> {
    free: &'a FreeParameters,
    wanted: Columns,
    /// Which of all shared parameters the figure depends on: the camera's and its picture's.
    shared: Vec<usize>,
    /// Derivatives of each side's line by the plane's geometry.
    jacobians: [DMatrix<f64>; 4],
    /// Where the figure's exposure begins among its plane's own parameters.
    exposure_offset: usize,
    sides: [[[f64; N]; N]; 4],
    plateau: ExposureSums,
    pictured_plateau: PicturedSums,
    /// Derivatives of one pixel at a corner, by the plane's own parameters and the shared ones.
    corner_own: DVector<f64>,
    corner_shared: Vec<f64>,
}

impl<'a, const N: usize> FigureSums<'a, N> {
    pub fn new(
        free: &'a FreeParameters,
        shared: Vec<usize>,
        jacobians: [DMatrix<f64>; 4],
        (own_count, exposure_offset): (usize, usize),
    ) -> Self {
        Self {
            corner_own: DVector::zeros(own_count),
            corner_shared: vec![0.0; shared.len()],
            free,
            wanted: free.columns(),
            shared,
            jacobians,
            exposure_offset,
            sides: [[[0.0; N]; N]; 4],
            plateau: ExposureSums::default(),
            pictured_plateau: PicturedSums::default(),
        }
    }

    /// Adds a pixel that one side cuts.
    #[inline]
    pub fn add_cut<L: Lens>(
        &mut self,
        scene: &Scene<'_, L>,
        pixel_ray: &L::PixelRay,
        shade: &Shade,
        weight: f64,
    ) {
        let (side, density) = shade.coverage.cuts[0];
        let line = &scene.lines[side];
        let distance = scene
            .lens
            .line_distance_jacobian(pixel_ray, line, self.wanted);
        let gain = scene.gain(shade, density);
        let mut row = [0.0; N];
        for i in 0..3 {
            row[i] = gain * distance.wrt_line[i];
        }
        row[3] = shade.residual;
        let (shared, exposure) =
            row[SHARED_OFFSET..].split_at_mut(N - SHARED_OFFSET - EXPOSURE_PARAMETERS);
        let (camera, picture) = shared.split_at_mut(self.free.len());
        self.free.gather(&distance.wrt_lens, camera);
        camera.iter_mut().for_each(|value| *value *= gain);
        if self.has_picture() {
            picture[..PICTURE_PARAMETERS].copy_from_slice(&scene.wrt_picture(shade));
        }
        exposure.copy_from_slice(&scene.wrt_exposure(shade));
        add_rank_one(&mut self.sides[side], &row, weight);
    }

    /// Adds a pixel that two sides cut.
    pub fn add_corner<L: Lens>(
        &mut self,
        scene: &Scene<'_, L>,
        pixel_ray: &L::PixelRay,
        shade: &Shade,
        weight: f64,
        block: &mut Block,
    ) {
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
                .line_distance_jacobian(pixel_ray, line, self.wanted);
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
        for (i, (&row, by_row)) in self.shared.iter().zip(shared.iter()).enumerate() {
            let mut cross = block.cross.column_mut(row);
            cross.axpy(weight * by_row, own, 1.0);
            block.shared_gradient[row] += weight * shade.residual * by_row;
            for (&column, by_column) in self.shared.iter().zip(shared.iter()).take(i + 1) {
                let product = weight * by_row * by_column;
                block.shared[(row, column)] += product;
                if row != column {
                    block.shared[(column, row)] += product;
                }
            }
        }
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
        self.shared.len() > self.free.len()
    }

    /// Adds all sums to the plane's block.
    pub fn finish(self, block: &mut Block) {
        for (sums, jacobian) in self.sides.iter().zip(&self.jacobians) {
            add_side(block, sums, jacobian, self.exposure_offset, &self.shared);
        }
        if self.has_picture() {
            let picture = &self.shared[self.free.len()..];
            add_pictured(block, &self.pictured_plateau, self.exposure_offset, picture);
        } else {
            add_exposure(block, &self.plateau, self.exposure_offset);
        }
    }
}

/// Adds sums over exposure and picture.
fn add_pictured(block: &mut Block, sums: &PicturedSums, exposure_offset: usize, picture: &[usize]) {
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
    for (i, &row) in picture.iter().enumerate() {
        let own = EXPOSURE_PARAMETERS + i;
        for k in 0..EXPOSURE_PARAMETERS {
            block.cross[(exposure_offset + k, row)] += symmetric(sums, own, k);
        }
        for (j, &column) in picture.iter().enumerate() {
            block.shared[(row, column)] += symmetric(sums, own, EXPOSURE_PARAMETERS + j);
        }
        block.shared_gradient[row] += symmetric(sums, own, PICTURED - 1);
    }
}

/// Brings the plane's own parameters into the sums of one side: with `M` the map from
/// (own geometry, exposure) to (line, exposure), the block is `M^T S M`.
fn add_side<const N: usize>(
    block: &mut Block,
    sums: &[[f64; N]; N],
    jacobian: &DMatrix<f64>,
    exposure_offset: usize,
    shared_columns: &[usize],
) {
    let shared = N - SHARED_OFFSET - EXPOSURE_PARAMETERS;
    let exposure = SHARED_OFFSET + shared;
    let rows = 3 + EXPOSURE_PARAMETERS;
    // Row of the sums that belongs to a row of the map.
    let source = |i: usize| if i < 3 { i } else { exposure + i - 3 };
    let mut map = DMatrix::zeros(rows, block.hessian.nrows());
    let mut geometry = map.view_mut((0, 0), (3, jacobian.ncols()));
    geometry.copy_from(jacobian);
    for i in 0..EXPOSURE_PARAMETERS {
        map[(3 + i, exposure_offset + i)] = 1.0;
    }
    let at = |i: usize, j: usize| symmetric(sums, i, j);
    let square = DMatrix::from_fn(rows, rows, |i, j| at(source(i), source(j)));
    let cross = DMatrix::from_fn(rows, shared, |i, j| at(source(i), SHARED_OFFSET + j));
    let residual = DVector::from_fn(rows, |i, _| at(source(i), 3));
    block.hessian.gemm_tr(1.0, &map, &(square * &map), 1.0);
    let cross = map.tr_mul(&cross);
    block.gradient.gemv_tr(1.0, &map, &residual, 1.0);
    for (i, &row) in shared_columns.iter().enumerate() {
        let mut own = block.cross.column_mut(row);
        own += cross.column(i);
        for (j, &column) in shared_columns.iter().enumerate() {
            block.shared[(row, column)] += at(SHARED_OFFSET + i, SHARED_OFFSET + j);
        }
        block.shared_gradient[row] += at(SHARED_OFFSET + i, 3);
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
