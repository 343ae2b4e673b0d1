//! Normal equations of one figure's pixels, summed by the parameters the pixels depend on.
//!
//! Nearly all pixels cut by an edge are cut by one side. The derivatives of their distances by pose
//! and camera are polynomials along it: the sums are over
//! `(terms, residual, picture, light, blur)`, and pose and camera are applied once per side. The
//! few pixels at corners are added row by row. Beside the edges all derivatives are smooth
//! functions of the position: over the pixels beside one stretch of an outline they are linear.

use nalgebra::{DMatrix, DVector, Vector2};

use super::band_pixels::BandPixel;
use super::exposure::{EXPOSURE_PARAMETERS, Exposure, LIGHT_PARAMETERS, VARIATION_PARAMETERS};
use super::figure_chart::{FigureChart, TERMS};
use super::scene::{Scene, Shade};
use crate::image::PICTURE_PARAMETERS;
use crate::lens::{Lens, MAX_LENS_COLUMNS};
use crate::numeric::{Block, LANES, LaneSums, add_rank_one, polynomials, symmetric_entry};
use crate::observations::FreeParameters;

/// Row length of a pixel cut by one side: `(terms, residual, picture, light, blur)`, with the
/// side's own blur at the pixel's position.
const CUT: usize = BLUR + 1 + VARIATION_PARAMETERS;
const RESIDUAL: usize = TERMS;
const PICTURE: usize = RESIDUAL + 1;
const LIGHT: usize = PICTURE + PICTURE_PARAMETERS;
const BLUR: usize = LIGHT + LIGHT_PARAMETERS;

/// Sums over the pixels cut by one side, added in batches of `LANES`.
struct CutSums {
    sums: LaneSums<CUT>,
    /// Rows of the waiting pixels except the terms, which follow ...
    columns: [[f64; LANES]; CUT],
    /// ... from the positions along the side and the factors that multiply the terms there.
    places: [f64; LANES],
    gains: [f64; LANES],
    weights: [f64; LANES],
    waiting: usize,
}

impl CutSums {
    fn new() -> Self {
        Self {
            sums: LaneSums::new(),
            columns: [[0.0; LANES]; CUT],
            places: [0.0; LANES],
            gains: [0.0; LANES],
            weights: [0.0; LANES],
            waiting: 0,
        }
    }

    #[inline]
    fn add(&mut self, (place, gain): (f64, f64), row_rest: &[f64; CUT - TERMS], weight: f64) {
        let lane = self.waiting;
        self.places[lane] = place;
        self.gains[lane] = gain;
        self.weights[lane] = weight;
        for (column, value) in self.columns[TERMS..].iter_mut().zip(row_rest) {
            column[lane] = *value;
        }
        self.waiting += 1;
        if self.waiting == LANES {
            self.add_waiting();
        }
    }

    fn add_waiting(&mut self) {
        let terms = polynomials::<TERMS>(&self.places);
        for (column, term) in self.columns.iter_mut().zip(&terms) {
            for lane in 0..LANES {
                column[lane] = self.gains[lane] * term[lane];
            }
        }
        self.sums.add(&self.columns, &self.weights);
        self.weights = [0.0; LANES];
        self.waiting = 0;
    }

    /// The lower triangle of all sums.
    fn finish(&mut self) -> [[f64; CUT]; CUT] {
        self.add_waiting();
        self.sums.sums()
    }
}

/// Row of a pixel on a plateau: `(light, picture, residual)`.
type PlateauRow = [f64; PLATEAU_ROW];
type PlateauSums = [PlateauRow; PLATEAU_ROW];
const PLATEAU_ROW: usize = LIGHT_PARAMETERS + PICTURE_PARAMETERS + 1;

/// Sums over the uncut pixels beside a stretch, on one side of it.
#[derive(Debug, Clone, Copy, Default)]
struct FlatPixels {
    /// Weighted sums of the products of `(1, x, y)` (lower triangle), with `x` and `y` relative to
    /// the first pixel, ...
    squares: [f64; 6],
    /// ... and of its products with the residual.
    residuals: [f64; 3],
    first: Vector2<f64>,
}

impl FlatPixels {
    #[inline]
    fn add(&mut self, place: &Vector2<f64>, residual: f64, weight: f64) {
        if self.squares[0] == 0.0 {
            self.first = *place;
        }
        let offset = place - self.first;
        let (weighted_x, weighted_y) = (weight * offset.x, weight * offset.y);
        let products = [
            weight,
            weighted_x,
            weighted_x * offset.x,
            weighted_y,
            weighted_y * offset.x,
            weighted_y * offset.y,
        ];
        for (sum, product) in self.squares.iter_mut().zip(products) {
            *sum += product;
        }
        for (sum, product) in self
            .residuals
            .iter_mut()
            .zip([weight, weighted_x, weighted_y])
        {
            *sum += product * residual;
        }
    }

    /// Three weighted rows that are equivalent to the pixels for functions linear over them: a
    /// position with weight and residual, and two steps from it whose residuals are changes.
    fn places_and_steps(&self) -> [(Vector2<f64>, f64, f64); 3] {
        let [all, x, xx, y, xy, yy] = self.squares;
        let [residual_all, residual_x, residual_y] = self.residuals;
        let middle = Vector2::new(x / all, y / all);
        // Centred on the mean, and y made orthogonal to x.
        let (xx, xy, yy) = (xx - x * middle.x, xy - x * middle.y, yy - y * middle.y);
        let (residual_x, residual_y) = (
            residual_x - residual_all * middle.x,
            residual_y - residual_all * middle.y,
        );
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        let (rest, residual_rest) = (yy - slope * xy, residual_y - slope * residual_x);
        let mean = |residual: f64, weight: f64| if weight > 0.0 { residual / weight } else { 0.0 };
        [
            (self.first + middle, all, mean(residual_all, all)),
            (Vector2::new(1.0, slope), xx.max(0.0), mean(residual_x, xx)),
            (
                Vector2::new(0.0, 1.0),
                rest.max(0.0),
                mean(residual_rest, rest),
            ),
        ]
    }
}

/// Sums of outer products over one figure.
pub(super) struct FigureSums<'a> {
    free: &'a FreeParameters,
    /// Number of shared parameters the figure depends on: the camera's, then its picture's.
    shared: usize,
    /// Derivatives of each side's line by the plane's geometry.
    jacobians: [DMatrix<f64>; 4],
    /// Index of the figure's first exposure parameter among its plane's own parameters.
    exposure_offset: usize,
    sides: [CutSums; 4],
    plateau: PlateauSums,
    /// Outside and inside of each stretch.
    flats: Vec<[FlatPixels; 2]>,
    /// Derivatives of one pixel at a corner, by the plane's own parameters and the shared ones.
    corner_plane: DVector<f64>,
    corner_shared: Vec<f64>,
}

impl<'a> FigureSums<'a> {
    pub fn new(
        free: &'a FreeParameters,
        shared: usize,
        jacobians: [DMatrix<f64>; 4],
        (plane_parameters, exposure_offset): (usize, usize),
        stretches: usize,
    ) -> Self {
        Self {
            corner_plane: DVector::zeros(plane_parameters),
            corner_shared: vec![0.0; shared],
            free,
            shared,
            jacobians,
            exposure_offset,
            sides: std::array::from_fn(|_| CutSums::new()),
            plateau: PlateauSums::default(),
            flats: vec![Default::default(); stretches],
        }
    }

    /// Adds a pixel cut by one side.
    #[inline]
    pub fn add_cut<L: Lens>(
        &mut self,
        scene: &Scene<'_, L>,
        (chart, pixel): (&FigureChart, &BandPixel),
        shade: &Shade,
        weight: f64,
    ) {
        let cut = shade.coverage.cuts[0];
        let (side, _) = cut;
        let gain = scene.gain(shade, cut);
        let mut row_rest = [shade.residual; CUT - TERMS];
        row_rest[PICTURE - TERMS..LIGHT - TERMS].copy_from_slice(&scene.wrt_picture(shade));
        row_rest[LIGHT - TERMS..BLUR - TERMS].copy_from_slice(&scene.wrt_light(shade));
        row_rest[BLUR - TERMS..].copy_from_slice(&scene.blur_row(shade, cut));
        self.sides[side].add((chart.place(side, pixel), gain), &row_rest, weight);
    }

    /// Adds a pixel cut by two sides.
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
        let (wrt_plane, wrt_shared) = (&mut self.corner_plane, &mut self.corner_shared);
        wrt_plane.fill(0.0);
        wrt_shared.fill(0.0);
        let camera = self.free.len();
        let mut part = [0.0; MAX_LENS_COLUMNS];
        for cut in shade.coverage.cuts {
            let (side, _) = cut;
            let line = &scene.lines[side];
            let distance = scene
                .lens
                .line_distance_jacobian(&pixel_ray, line, self.free.columns());
            let gain = scene.gain(shade, cut);
            let jacobian = &self.jacobians[side];
            let mut geometry = wrt_plane.rows_mut(0, jacobian.ncols());
            geometry.gemv_tr(gain, jacobian, &distance.wrt_line, 1.0);
            self.free.gather(&distance.wrt_lens, &mut part[..camera]);
            for (sum, value) in wrt_shared.iter_mut().zip(&part[..camera]) {
                *sum += gain * value;
            }
        }
        if let Some(picture) = picture {
            wrt_shared[camera..].copy_from_slice(&picture);
        }
        wrt_plane
            .rows_mut(self.exposure_offset, EXPOSURE_PARAMETERS)
            .copy_from_slice(&scene.wrt_exposure(shade));
        block.hessian.ger(weight, wrt_plane, wrt_plane, 1.0);
        block.gradient.axpy(weight * shade.residual, wrt_plane, 1.0);
        for (row, row_value) in wrt_shared.iter().enumerate() {
            let mut cross = block.cross.column_mut(row);
            cross.axpy(weight * row_value, wrt_plane, 1.0);
            block.shared_gradient[row] += weight * shade.residual * row_value;
            for (column, column_value) in wrt_shared.iter().enumerate() {
                block.shared[(row, column)] += weight * row_value * column_value;
            }
        }
        Some(())
    }

    /// Adds a pixel that shows only the ground or only the figure.
    #[inline]
    pub fn add_flat(&mut self, pixel: &BandPixel, inside: bool, residual: f64, weight: f64) {
        let sums = &mut self.flats[usize::from(pixel.stretch)][usize::from(inside)];
        sums.add(&pixel.place(), residual, weight);
    }

    fn add_flats<L: Lens>(&mut self, scene: &Scene<'_, L>) {
        for stretch in &self.flats {
            for (sums, inside) in stretch.iter().zip([false, true]) {
                if sums.squares[0] == 0.0 {
                    continue;
                }
                let [(middle, weight, residual), steps @ ..] = sums.places_and_steps();
                let mut row = plateau_row(scene, &middle, inside);
                row[PLATEAU_ROW - 1] = residual;
                add_rank_one(&mut self.plateau, &row, weight);
                for (step, weight, residual) in steps {
                    let mut change = plateau_row(scene, &(middle + step), inside);
                    for (value, start) in change.iter_mut().zip(&row) {
                        *value -= start;
                    }
                    change[PLATEAU_ROW - 1] = residual;
                    add_rank_one(&mut self.plateau, &change, weight);
                }
            }
        }
    }

    fn has_picture(&self) -> bool {
        self.shared > self.free.len()
    }

    /// Adds all sums to the plane's block; `None` if the lens does not see a side.
    pub fn finish<L: Lens>(
        mut self,
        scene: &Scene<'_, L>,
        chart: &FigureChart,
        block: &mut Block,
    ) -> Option<()> {
        self.add_flats(scene);
        for side in 0..4 {
            let sums = self.sides[side].finish();
            let terms = chart.jacobian(scene, side, self.free)?;
            self.add_side((side, &sums), &terms, scene.exposure(), block);
        }
        let picture = self.has_picture().then_some(self.free.len());
        add_plateau(block, &self.plateau, (self.exposure_offset, picture));
        Some(())
    }

    /// Applies pose and camera to the sums of a side. `terms` are the coefficients of the
    /// distance's derivatives along it. With `M` the map from the plane's own and the shared
    /// parameters to the summed rows, the block is `M^T S M`.
    fn add_side(
        &self,
        (side, sums): (usize, &[[f64; CUT]; CUT]),
        terms: &DMatrix<f64>,
        exposure: &Exposure,
        block: &mut Block,
    ) {
        let at = |i: usize, j: usize| symmetric_entry(sums, i, j);
        // Index into the summed rows, skipping the residual.
        let source = |i: usize| if i < RESIDUAL { i } else { i + 1 };
        let square = DMatrix::from_fn(CUT - 1, CUT - 1, |i, j| at(source(i), source(j)));
        let residual = DVector::from_fn(CUT - 1, |i, _| at(source(i), RESIDUAL));

        let jacobian = &self.jacobians[side];
        let mut plane_map = DMatrix::zeros(CUT - 1, block.hessian.nrows());
        let geometry = terms.columns(0, 3) * jacobian;
        plane_map
            .view_mut((0, 0), geometry.shape())
            .copy_from(&geometry);
        for i in 0..LIGHT_PARAMETERS {
            plane_map[(LIGHT - 1 + i, self.exposure_offset + i)] = 1.0;
        }
        for (j, row) in exposure.blur_jacobian(side).iter().enumerate() {
            for (k, derivative) in row.iter().enumerate() {
                plane_map[(BLUR - 1 + k, self.exposure_offset + LIGHT_PARAMETERS + j)] =
                    *derivative;
            }
        }
        let camera = self.free.len();
        let mut shared_map = DMatrix::zeros(CUT - 1, self.shared);
        let camera_terms = terms.columns(3, camera);
        shared_map
            .view_mut((0, 0), (TERMS, camera))
            .copy_from(&camera_terms);
        for i in camera..self.shared {
            shared_map[(PICTURE - 1 + i - camera, i)] = 1.0;
        }

        let weighted_shared = &square * &shared_map;
        block
            .hessian
            .gemm_tr(1.0, &plane_map, &(square * &plane_map), 1.0);
        block.gradient.gemv_tr(1.0, &plane_map, &residual, 1.0);
        block.cross.gemm_tr(1.0, &plane_map, &weighted_shared, 1.0);
        block
            .shared
            .gemm_tr(1.0, &shared_map, &weighted_shared, 1.0);
        block
            .shared_gradient
            .gemv_tr(1.0, &shared_map, &residual, 1.0);
    }
}

/// Derivatives of a plateau by light and picture at a position in the picture; the residual is
/// zero.
fn plateau_row<L: Lens>(scene: &Scene<'_, L>, place: &Vector2<f64>, inside: bool) -> PlateauRow {
    let shade = scene.plateau(place, inside);
    let mut row = [0.0; PLATEAU_ROW];
    row[..LIGHT_PARAMETERS].copy_from_slice(&scene.wrt_light(&shade));
    row[LIGHT_PARAMETERS..PLATEAU_ROW - 1].copy_from_slice(&scene.wrt_picture(&shade));
    row
}

/// Adds sums over plateaus to a figure's light, which begins at `light_offset` among the plane's
/// own parameters, and to its picture's shared parameters, if any.
fn add_plateau(
    block: &mut Block,
    sums: &PlateauSums,
    (light_offset, picture): (usize, Option<usize>),
) {
    let residual = PLATEAU_ROW - 1;
    for i in 0..LIGHT_PARAMETERS {
        for j in 0..LIGHT_PARAMETERS {
            block.hessian[(light_offset + i, light_offset + j)] += symmetric_entry(sums, i, j);
        }
        block.gradient[light_offset + i] += symmetric_entry(sums, i, residual);
    }
    let Some(picture) = picture else {
        return;
    };
    for i in 0..PICTURE_PARAMETERS {
        let (row, source) = (picture + i, LIGHT_PARAMETERS + i);
        for k in 0..LIGHT_PARAMETERS {
            block.cross[(light_offset + k, row)] += symmetric_entry(sums, source, k);
        }
        for j in 0..PICTURE_PARAMETERS {
            block.shared[(row, picture + j)] += symmetric_entry(sums, source, LIGHT_PARAMETERS + j);
        }
        block.shared_gradient[row] += symmetric_entry(sums, source, residual);
    }
}
