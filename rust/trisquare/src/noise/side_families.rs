//! Sides with correlated smooth displacements, and the information of their samples on these.

use nalgebra::{Const, DMatrix, DMatrixView, Dyn, OMatrix, SMatrix, SVector, Vector2, Vector3};

use super::picture_fields::{FIELDS, PictureFields};
use super::side_basis::{Basis, ORDERS, basis};
use super::side_moments::{Gram, SideMoments};
use crate::lens::{Lens, MAX_LENS_COLUMNS};
use crate::numeric::{Block, BlockEquations};
use crate::observations::{
    Deformation, Figure, FreeParameters, PlaneState, Side, TERMS, directions,
};

/// Distance, as a fraction of a figure's extent, over which the displacements of parallel sides
/// lose their correlation.
const CORRELATION_LENGTH: f64 = 0.33;

/// Number of samples of a side at which its Jacobian is computed: it is as smooth as its
/// displacement.
const NODES: usize = 10;

/// Number of orders of a displacement that leave a line straight.
const LINE_ORDERS: usize = 2;

/// Regularisation of orders that too few samples determine: keeps them at zero.
const UNSEEN: f64 = 1e-9;

/// Maximum number of columns shared by the planes.
const MAX_SHARED: usize = MAX_LENS_COLUMNS + FIELDS;

/// Shared columns of all planes: the free parameters of a lens, and further fields of its picture.
pub(crate) struct SharedColumns<'a, L> {
    pub lens: &'a L,
    pub free: &'a FreeParameters,
    pub fields: Option<PictureFields>,
}

impl<L: Lens> SharedColumns<'_, L> {
    pub fn len(&self) -> usize {
        self.free.len() + self.fields.map_or(0, |_| FIELDS)
    }

    /// The derivatives of a sample's distance, given those by the lens.
    fn gather(
        &self,
        wrt_lens: &[f64; MAX_LENS_COLUMNS],
        at: (&Vector2<f64>, &L::PixelRay, &Vector3<f64>),
    ) -> SVector<f64, MAX_SHARED> {
        let mut columns = [0.0; MAX_SHARED];
        let first = self.free.len();
        self.free.gather(wrt_lens, &mut columns[..first]);
        if let Some(fields) = &self.fields {
            let (pixel, pixel_ray, line) = at;
            let normal = self.lens.line_distance_and_normal(pixel_ray, line).1;
            // A sample displaced along the normal is farther from the line.
            columns[first..first + FIELDS].copy_from_slice(&fields.along(pixel, &normal));
        }
        SVector::from(columns)
    }
}

/// Maximum correlation of two sides on one line, such as one that was measured in two pieces: with
/// 1, the correlation matrix would have no inverse.
const MAX_ALIKE: f64 = 1.0 - 1e-9;

/// Information of the samples of sides with correlated displacements.
pub(crate) struct Family {
    pub plane: usize,
    /// Indices of the sides in their figure.
    pub sides: Vec<usize>,
    /// Variance (px^2) of the position of each line, in addition to the error common to all sides.
    pub line_variance: f64,
    /// Direction of the first of them; the others are mirrored to it.
    along: Option<Vector2<f64>>,
    /// Correlation of their displacements, its inverse, and the logarithm of its determinant.
    correlation: DMatrix<f64>,
    inverse_correlation: DMatrix<f64>,
    log_correlation: f64,
    /// `B^T W B` with `B` the basis at the samples, side by side.
    pub gram: DMatrix<f64>,
    /// `J^T W B`, with `J` by the plane's `plane_parameters` parameters, and by the shared ones;
    /// then `r^T W B`.
    cross_products: DMatrix<f64>,
    plane_parameters: usize,
}

/// Families of the sides and arcs of a figure: those of one direction together if there are many,
/// since an error correlated over a third of a side is correlated over a third of the figure, too.
/// `None` if lines are not finite.
pub(crate) fn families_of(
    figure: &Figure,
    plane: usize,
    plane_parameters: usize,
    shared: usize,
) -> Option<Vec<Family>> {
    let line = |side: &Side| {
        side.line()
            .map_or_else(Vector3::zeros, |l| l.coefficients())
    };
    let lines: Vec<Vector3<f64>> = figure.sides.iter().map(line).collect();
    // Opposite sides of a square are too far apart.
    let split = directions(figure)
        .into_iter()
        .flat_map(|family| match family.len() {
            0..=2 => family.into_iter().map(|side| vec![side]).collect(),
            _ => vec![family],
        });
    split
        .map(|sides| {
            let offset =
                |side: usize| lines[side].z * lines[side].xy().dot(&lines[sides[0]].xy()).signum();
            let offsets: Vec<f64> = sides.iter().map(|side| offset(*side)).collect();
            Family::new(plane, sides, &offsets, (plane_parameters, shared))
        })
        .collect()
}

impl Family {
    /// `None` if the offsets are not finite.
    fn new(
        plane: usize,
        sides: Vec<usize>,
        offsets: &[f64],
        (plane_parameters, shared): (usize, usize),
    ) -> Option<Self> {
        let high = offsets.iter().copied().fold(f64::MIN, f64::max);
        let low = offsets.iter().copied().fold(f64::MAX, f64::min);
        let correlation_length = (CORRELATION_LENGTH * (high - low)).max(f64::MIN_POSITIVE);
        let correlation = DMatrix::from_fn(offsets.len(), offsets.len(), |i, j| {
            let alike = if i == j { 1.0 } else { MAX_ALIKE };
            alike * (-(offsets[i] - offsets[j]).abs() / correlation_length).exp()
        });
        let factor = correlation.clone().cholesky()?;
        let rows = ORDERS * sides.len();
        Some(Self {
            plane,
            sides,
            line_variance: 0.0,
            along: None,
            correlation,
            inverse_correlation: factor.inverse(),
            log_correlation: 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum(),
            gram: DMatrix::zeros(rows, rows),
            cross_products: DMatrix::zeros(plane_parameters + shared + 1, rows),
            plane_parameters,
        })
    }

    /// Adds one of the sides, by its index in the figure, and adds the information of its samples
    /// on plane and camera to the normal equations.
    pub fn add<L: Lens>(
        &mut self,
        (state, figure, index, side): (&PlaneState, usize, usize, &Side),
        deformation: Option<&Deformation>,
        moments: &SideMoments,
        camera: &SharedColumns<'_, L>,
        white: f64,
        block: &mut Block,
    ) -> Option<()> {
        let place = self.sides.iter().position(|side| *side == index)?;
        let jacobian = SideJacobian::of((state, figure, side), deformation, moments, camera)?;
        self.add_at(place, &jacobian, moments, white, block);
        Some(())
    }

    fn add_at(
        &mut self,
        place: usize,
        jacobian: &SideJacobian,
        moments: &SideMoments,
        white: f64,
        block: &mut Block,
    ) {
        let mirror = self.mirror(&moments.along);
        let gram = moments
            .robust
            .gram
            .component_mul(&(mirror * mirror.transpose()))
            / white;
        let gradient = moments.robust.gradient.component_mul(&mirror) / white;
        let plane = DMatrix::from_fn(ORDERS, jacobian.plane.ncols(), |k, i| {
            mirror[k] * jacobian.plane[(k, i)]
        });
        let shared = DMatrix::from_fn(ORDERS, jacobian.shared.ncols(), |k, i| {
            mirror[k] * jacobian.shared[(k, i)]
        });
        let (weighted_plane, weighted_shared) = (gram * &plane, gram * &shared);
        block.hessian += plane.tr_mul(&weighted_plane);
        block.cross += plane.tr_mul(&weighted_shared);
        block.shared += shared.tr_mul(&weighted_shared);
        block.gradient += plane.tr_mul(&gradient);
        block.shared_gradient += shared.tr_mul(&gradient);
        let first = ORDERS * place;
        self.gram
            .view_mut((first, first), (ORDERS, ORDERS))
            .copy_from(&gram);
        let mut cross_products = self.cross_products.columns_mut(first, ORDERS);
        let (plane_rows, all) = (plane.ncols(), plane.ncols() + shared.ncols());
        cross_products
            .rows_mut(0, plane_rows)
            .tr_copy_from(&weighted_plane);
        cross_products
            .rows_mut(plane_rows, all - plane_rows)
            .tr_copy_from(&weighted_shared);
        cross_products.row_mut(all).tr_copy_from(&gradient);
    }

    /// Signs of the basis for a side whose direction may be opposite to that of the family's first.
    fn mirror(&mut self, along: &Vector2<f64>) -> Basis {
        let is_opposite = self.along.get_or_insert(*along).dot(along) < 0.0;
        Basis::from_fn(|k, _| if is_opposite && k % 2 == 1 { -1.0 } else { 1.0 })
    }

    /// Covariance of the sides' displacements at unit variance.
    pub fn covariance(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.gram.nrows(), self.gram.ncols(), |i, j| {
            let (k, l) = (i % ORDERS, j % ORDERS);
            match k == l {
                true => spectrum(k) * self.correlation[(i / ORDERS, j / ORDERS)],
                false => 0.0,
            }
        })
    }

    /// `J^T W B` by the plane's own parameters, ...
    pub fn plane_cross(&self) -> DMatrixView<'_, f64> {
        self.cross_products.rows(0, self.plane_parameters)
    }

    /// ... and by the shared ones.
    pub fn shared_cross(&self) -> DMatrixView<'_, f64> {
        self.cross_products.rows(
            self.plane_parameters,
            self.cross_products.nrows() - self.plane_parameters - 1,
        )
    }

    /// Eliminates the sides' displacements, of the given variance, from the equations; returns
    /// their contribution to minus twice the log likelihood.
    pub fn marginalise(&self, variance: f64, equations: &mut BlockEquations) -> Option<f64> {
        let (count, size) = (self.sides.len(), self.gram.nrows());
        let mut displaced = DMatrix::zeros(size + self.cross_products.nrows(), size);
        displaced.rows_mut(0, size).copy_from(&self.gram);
        displaced
            .rows_mut(size, self.cross_products.nrows())
            .copy_from(&self.cross_products);
        let mut log_determinant = ORDERS as f64 * self.log_correlation;
        for k in 0..ORDERS {
            let order_variance = match k {
                k if k < LINE_ORDERS => spectrum(k) * variance + self.line_variance,
                _ => spectrum(k) * variance,
            };
            log_determinant += count as f64 * order_variance.ln();
            for i in 0..count {
                for j in 0..count {
                    displaced[(ORDERS * i + k, ORDERS * j + k)] +=
                        self.inverse_correlation[(i, j)] / order_variance;
                }
            }
        }
        Some(log_determinant + equations.eliminate(displaced)?)
    }
}

/// The Jacobian of a side as a smooth displacement: its coefficients in the basis along the side.
struct SideJacobian {
    plane: DMatrix<f64>,
    shared: OMatrix<f64, Const<ORDERS>, Dyn>,
}

impl SideJacobian {
    /// Fits samples spread over the side by least squares; `None` if the lens sees none.
    fn of<L: Lens>(
        (state, figure, side): (&PlaneState, usize, &Side),
        deformation: Option<&Deformation>,
        moments: &SideMoments,
        camera: &SharedColumns<'_, L>,
    ) -> Option<Self> {
        let lens = camera.lens;
        let (wanted, count) = (camera.free.columns(), camera.len());
        let mut gram = Gram::identity() * UNSEEN;
        let mut line_derivatives = Vec::new();
        let mut shared = SMatrix::<f64, ORDERS, MAX_SHARED>::zeros();
        let mut terms = SMatrix::<f64, ORDERS, TERMS>::zeros();
        let nodes = nodes(&moments.places);
        for found in state.model_lines(lens, figure, side) {
            let (model, range) = found?;
            let line = state.line(figure, &model.line);
            let mut wrt_line = SMatrix::<f64, ORDERS, 3>::zeros();
            for &index in nodes.iter().filter(|index| range.contains(index)) {
                let row = &basis(moments.places[index]);
                let pixel = &side.samples[index].pixel;
                let pixel_ray = lens.unproject_with_jacobian(pixel)?;
                let distance = lens.line_distance_jacobian(&pixel_ray, &line, wanted);
                let columns = camera.gather(&distance.wrt_lens, (pixel, &pixel_ray, &line));
                gram.ger(1.0, row, row, 1.0);
                wrt_line.ger(1.0, row, &distance.wrt_line, 1.0);
                let mut used = shared.columns_mut(0, count);
                used.ger(1.0, row, &columns.rows(0, count), 1.0);
                if let Some(deformation) = deformation {
                    let sample = &side.samples[index];
                    let of = (lens, state);
                    // A positive term displaces the sample: the residual is reduced by that.
                    let displacements =
                        deformation.displacements(of, &line, &distance.wrt_line, sample)?;
                    terms.ger(-1.0, row, &displacements, 1.0);
                }
            }
            line_derivatives.push((model, wrt_line));
        }
        let factor = gram.cholesky()?;
        let plane = line_derivatives
            .iter()
            .map(|(model, wrt_line)| factor.solve(wrt_line) * state.line_jacobian(figure, model));
        let plane = plane.reduce(|a, b| a + b)?;
        let terms = factor.solve(&terms);
        let columns = plane.ncols() + deformation.map_or(0, |_| TERMS);
        Some(Self {
            plane: DMatrix::from_fn(ORDERS, columns, |k, i| match i.checked_sub(plane.ncols()) {
                None => plane[(k, i)],
                Some(term) => terms[(k, term)],
            }),
            shared: factor.solve(&shared.columns(0, count)),
        })
    }
}

/// Indices of the samples nearest to the Chebyshev points of the side, given their places in order
/// along it.
fn nodes(places: &[f64]) -> Vec<usize> {
    let is_ascending = places.first() <= places.last();
    let nearest = |j: usize| {
        let angle = std::f64::consts::PI * (j as f64 + 0.5) / NODES as f64;
        let place = angle.cos();
        let distance = |i: &usize| (places[*i] - place).abs();
        let after = places.partition_point(|sample_place| (*sample_place < place) == is_ascending);
        let candidates = after.saturating_sub(1)..places.len().min(after + 1);
        candidates.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    (0..NODES).filter_map(nearest).collect()
}

/// Variance of the displacement's order `k`, in units of `tau^2`.
pub(crate) fn spectrum(order: usize) -> f64 {
    (1.0 + (0.5 * order as f64).powi(2)).powf(-1.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_the_samples_nearest_to_their_places_whichever_way_these_run() {
        let rising: Vec<f64> = (0..40)
            .map(|i| (f64::from(i) / 19.5 - 1.0).powi(3))
            .collect();
        let falling: Vec<f64> = rising.iter().rev().copied().collect();
        for places in [&rising[..], &falling, &rising[..3], &rising[..1], &[]] {
            let found = nodes(places);
            assert_eq!(found.len(), if places.is_empty() { 0 } else { NODES });
            for (j, index) in found.into_iter().enumerate() {
                let node = (std::f64::consts::PI * (j as f64 + 0.5) / NODES as f64).cos();
                let distances = places.iter().map(|place| (place - node).abs());
                let least = distances.fold(f64::INFINITY, f64::min);
                assert_eq!((places[index] - node).abs(), least);
            }
        }
    }
}
