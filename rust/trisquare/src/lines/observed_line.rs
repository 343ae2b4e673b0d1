//! A line of the scene under a lens: the information of its samples on the lens, and on its own
//! bend.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3x2, Vector2, Vector3};

use crate::geometry::line_of_rays;
use crate::lens::Lens;
use crate::noise::{ORDERS, basis, direction, places, spectrum};
use crate::numeric::{Loss, median_scale};
use crate::observations::{FreeParameters, Sample};
use crate::refine::{MIN_SCALE, Residual};

/// Number of steps from the line that fits the rays best to that which fits best in pixels.
const LINE_STEPS: usize = 2;

/// Number of rounds of robust weights about the smooth displacement.
const ROUNDS: usize = 3;

/// Lower bound of the noise (px): less is rounding, as in the planes' computed samples.
const MIN_NOISE: f64 = 1e-5;

/// Number of samples required per order of the smooth displacement, and orders of any line: those
/// of a straight one, and a bend.
const SAMPLES_PER_ORDER: usize = 4;
const STRAIGHT_ORDERS: usize = 2;
const BENT_ORDERS: usize = 3;

/// The samples of a line under a lens.
pub(super) struct ObservedLine {
    /// Distances from the line that fits them best, px.
    distances: DVector<f64>,
    /// Derivatives of the distances by the line, by the free parameters, and the basis of smooth
    /// displacements.
    line: DMatrix<f64>,
    shared: DMatrix<f64>,
    basis: DMatrix<f64>,
    /// One over the standard deviations given.
    weights: DVector<f64>,
    /// The distances less their smooth part.
    pub rough: Vec<Residual>,
}

impl ObservedLine {
    /// `None` if the lens does not see all samples, or if these coincide.
    pub fn of<L: Lens>(lens: &L, free: &FreeParameters, samples: &[Sample]) -> Option<Self> {
        let rays = samples
            .iter()
            .map(|sample| lens.unproject_with_jacobian(&sample.pixel));
        let rays = rays.collect::<Option<Vec<L::PixelRay>>>()?;
        let unit = rays
            .iter()
            .map(|ray| (lens.direction(ray).normalize(), 1.0));
        let mut line = line_of_rays(unit)?;
        for _ in 0..LINE_STEPS {
            line = refined_line(lens, &rays, samples, &line)?;
        }
        let (count, turns) = (samples.len(), tangents(&line));
        let places = places(samples, &direction(samples)?);
        let mut found = Self {
            distances: DVector::zeros(count),
            line: DMatrix::zeros(count, 2),
            shared: DMatrix::zeros(count, free.len()),
            basis: DMatrix::zeros(count, ORDERS),
            weights: DVector::from_iterator(count, samples.iter().map(|sample| sample.weight)),
            rough: Vec::new(),
        };
        let mut wrt_free = vec![0.0; free.len()];
        for (i, (ray, place)) in rays.iter().zip(&places).enumerate() {
            let distance = lens.line_distance_jacobian(ray, &line, free.columns());
            free.gather(&distance.wrt_lens, &mut wrt_free);
            found.distances[i] = distance.value;
            found
                .line
                .row_mut(i)
                .copy_from(&distance.wrt_line.tr_mul(&turns));
            found.shared.row_mut(i).copy_from_slice(&wrt_free);
            found.basis.row_mut(i).copy_from(&basis(*place).transpose());
        }
        found.rough = found.without_smooth_part()?;
        Some(found)
    }

    /// Root mean square distance, px.
    pub fn rms(&self) -> f64 {
        (self.distances.norm_squared() / self.distances.len() as f64).sqrt()
    }

    /// Number of orders of a smooth displacement that the samples distinguish from noise.
    fn orders(&self) -> usize {
        (self.distances.len() / SAMPLES_PER_ORDER).clamp(STRAIGHT_ORDERS, ORDERS)
    }

    fn without_smooth_part(&self) -> Option<Vec<Residual>> {
        let basis = self.basis.columns(0, self.orders());
        let mut weights = self.weights.component_mul(&self.weights);
        let mut rough = self.distances.clone();
        for _ in 0..ROUNDS {
            let weighted = scaled_rows(&basis.into_owned(), &weights);
            let smooth = basis.tr_mul(&weighted).cholesky()?;
            let smooth = smooth.solve(&weighted.tr_mul(&self.distances));
            rough = &self.distances - basis * smooth;
            let scale = rough.component_mul(&self.weights);
            let scale = median_scale(scale.iter().copied()).max(MIN_SCALE);
            weights = self.robust_weights(&rough, scale);
        }
        let residual = |(distance, weight): (&f64, &f64)| Residual {
            distance: *distance,
            normal: Vector2::zeros(),
            weight: *weight,
            is_counted: true,
        };
        Some(
            rough
                .iter()
                .zip(self.weights.iter())
                .map(residual)
                .collect(),
        )
    }

    fn robust_weights(&self, rough: &DVector<f64>, scale: f64) -> DVector<f64> {
        let weight = |i: usize| {
            let to_noise = (self.weights[i] / scale).min(1.0 / MIN_NOISE);
            Loss::Tukey.cost_and_weight(rough[i] * to_noise).1 * to_noise * to_noise
        };
        DVector::from_fn(rough.len(), |i, _| weight(i))
    }

    /// The smooth displacement, given the scale of the noise and the variance of the mean of many
    /// neighbours over that of independent ones; `None` if samples are in too few places.
    pub fn smooth(&self, scale: f64, correlation: f64) -> Option<SmoothLine> {
        let rough = DVector::from_iterator(
            self.rough.len(),
            self.rough.iter().map(|residual| residual.distance),
        );
        let weights =
            self.robust_weights(&rough, scale) / (Loss::Tukey.mean_weight() * correlation);
        let basis = self
            .basis
            .columns(0, self.orders().max(BENT_ORDERS))
            .into_owned();
        let weighted = scaled_rows(&basis, &weights);
        let factor = basis.tr_mul(&weighted).cholesky()?;
        let smooth = |matrix: &DMatrix<f64>| factor.solve(&weighted.tr_mul(matrix));
        Some(SmoothLine {
            noise: factor.inverse(),
            values: factor.solve(&weighted.tr_mul(&self.distances)),
            line: smooth(&self.line),
            shared: smooth(&self.shared),
        })
    }
}

/// Measurement of a line, as coefficients of a smooth displacement.
pub(super) struct SmoothLine {
    /// Covariance under the samples' noise alone.
    noise: DMatrix<f64>,
    values: DVector<f64>,
    /// Derivatives by the line and by the free parameters.
    line: DMatrix<f64>,
    shared: DMatrix<f64>,
}

/// Information of a line on the free parameters for bends of some variance, with its own two
/// eliminated.
pub(super) struct LinePart {
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
    /// Weighted square of its displacement, and logarithm of the determinants in a restricted
    /// likelihood.
    pub square: f64,
    pub log_determinant: f64,
}

impl SmoothLine {
    /// Number of coefficients of a bend.
    pub fn freedom(&self) -> f64 {
        (self.values.len() - STRAIGHT_ORDERS) as f64
    }

    /// The measurement with free parameters in the given units.
    pub fn in_units(&self, units: &DVector<f64>) -> Self {
        Self {
            noise: self.noise.clone(),
            values: self.values.clone(),
            line: self.line.clone(),
            shared: &self.shared * DMatrix::from_diagonal(units),
        }
    }

    /// The information for bends of variance `tau^2` (px^2).
    pub fn part(&self, bend: f64) -> Option<LinePart> {
        let mut spread = self.noise.clone();
        for order in 0..self.values.len() {
            spread[(order, order)] += bend * spectrum(order);
        }
        let factor = spread.cholesky()?;
        let line_solution = factor.solve(&self.line);
        let line_factor = self.line.tr_mul(&line_solution).cholesky()?;
        let shared = factor.solve(&self.shared);
        let shared = &shared - &line_solution * line_factor.solve(&self.line.tr_mul(&shared));
        let values = factor.solve(&self.values);
        let values = &values - &line_solution * line_factor.solve(&self.line.tr_mul(&values));
        let log = |l: &DMatrix<f64>| 2.0 * l.diagonal().map(f64::ln).sum();
        Some(LinePart {
            information: self.shared.tr_mul(&shared),
            gradient: self.shared.tr_mul(&values),
            square: self.values.dot(&values),
            log_determinant: log(factor.l_dirty()) + log(line_factor.l_dirty()),
        })
    }
}

fn scaled_rows(matrix: &DMatrix<f64>, weights: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| {
        matrix[(i, j)] * weights[i]
    })
}

/// Two directions in which a unit line may rotate.
fn tangents(line: &Vector3<f64>) -> Matrix3x2<f64> {
    let first = line.cross(&Vector3::ith(line.iamin(), 1.0)).normalize();
    Matrix3x2::from_columns(&[first, line.cross(&first)])
}

/// The line after a step towards the one with the smallest distances in pixels.
fn refined_line<L: Lens>(
    lens: &L,
    rays: &[L::PixelRay],
    samples: &[Sample],
    line: &Vector3<f64>,
) -> Option<Vector3<f64>> {
    let turns = tangents(line);
    let (mut square, mut gradient) = (Matrix2::zeros(), Vector2::zeros());
    for (ray, sample) in rays.iter().zip(samples) {
        let distance = lens.line_distance_jacobian(ray, line, crate::lens::Columns::NONE);
        let wrt_rotation = turns.tr_mul(&distance.wrt_line);
        let weight = sample.weight * sample.weight;
        square += wrt_rotation * wrt_rotation.transpose() * weight;
        gradient += wrt_rotation * (distance.value * weight);
    }
    let step = square.cholesky()?.solve(&gradient);
    Some((line - turns * step).normalize())
}
