//! Noise of neighbouring samples, plane by plane: the scale of the residuals without each side's
//! smooth displacement, and their correlation along the side.

use nalgebra::Cholesky;

use super::side_basis::{Basis, ORDERS, basis_by_polynomials};
use super::side_moments::SideMoments;
use crate::numeric::{Loss, ResidualSpread, median_scale, polynomial_at};
use crate::observations::ObservedPlane;
use crate::refine::{MIN_SCALE, Refined, Residual, Residuals};

/// Prior standard deviation of a fitted displacement, in scales of the noise: hardly a constraint.
const LOOSE: f64 = 1e3;

/// Number of samples required per order of the displacement.
const SAMPLES_PER_ORDER: usize = 4;

/// Maximum lag, in samples, of correlated noise; at larger lags it is a side's displacement.
const MAX_LAG: usize = 6;

/// Threshold of a correlation coefficient, in its own standard deviations, above which it is
/// significant.
const SIGNIFICANT: f64 = 2.0;

/// Maximum fraction of the noise's power absorbed by smooth displacements: with more, too little is
/// left to estimate it.
const MAX_ABSORBED: f64 = 0.5;

/// The noise of a plane's samples, in units of their given standard deviations.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalNoise {
    pub scale: f64,
    /// Its degrees of freedom.
    pub freedom: f64,
}

/// Robust local noise of every plane, and the correlation of neighbours.
#[derive(Clone)]
pub(crate) struct Noise {
    /// Moments of the residuals of every side, by plane.
    pub sides: Vec<Vec<SideMoments>>,
    /// The scale of the residuals in these sums.
    pub moment_scale: f64,
    pub planes: Vec<LocalNoise>,
    /// Noise of all planes together.
    pub scale: f64,
    /// Variance of the mean of many neighbours over that of independent ones, at least 1.
    pub correlation: f64,
}

/// Sums of products of neighbours, by lag.
#[derive(Default)]
struct Neighbours {
    products: [f64; MAX_LAG + 1],
    pairs: [f64; MAX_LAG + 1],
}

impl Noise {
    /// Measures the noise from the residuals of an optimum.
    pub fn of_optimum<L>(planes: &[ObservedPlane], refined: &Refined<L>) -> Self {
        Self::of(planes, &refined.residuals, refined.scale)
    }

    /// Measures the noise from `residuals`, given a robust `scale` of all of them.
    pub fn of(planes: &[ObservedPlane], residuals: &Residuals, scale: f64) -> Self {
        let mut neighbours = Neighbours::default();
        let (mut plane_noise, mut all) = (Vec::with_capacity(planes.len()), Vec::new());
        let mut sides = Vec::with_capacity(planes.len());
        let mut absorbed = 0.0;
        for (plane, residuals) in planes.iter().zip(residuals) {
            let (mut rough, mut lost) = (Vec::with_capacity(residuals.len()), 0.0);
            let mut moments = Vec::new();
            let mut rest = &residuals[..];
            for side in plane.sides() {
                let (side_residuals, others) = rest.split_at(side.samples.len());
                rest = others;
                let side_moments = SideMoments::of(side, side_residuals, scale);
                if !side.is_outlier {
                    let side_rough = without_displacement(&side_moments, side_residuals);
                    neighbours.add(&side_rough, scale);
                    lost += absorbed_freedom(side_residuals.len()) as f64;
                    rough.extend(side_rough);
                }
                moments.push(side_moments);
            }
            sides.push(moments);
            plane_noise.push((!rough.is_empty()).then(|| LocalNoise::of(&rough, lost)));
            all.extend(rough);
            absorbed += lost;
        }
        let mut all = LocalNoise::of(&all, absorbed);
        let correlation = neighbours.correlation(all.freedom);
        let scale_factor = neighbours.scale_factor(all.freedom, correlation);
        all.scale *= scale_factor;
        let plane_noise = plane_noise.into_iter().map(|plane_noise| {
            plane_noise.map_or(all, |plane_noise| LocalNoise {
                scale: plane_noise.scale * scale_factor,
                ..plane_noise
            })
        });
        Self {
            planes: plane_noise.collect(),
            correlation,
            scale: all.scale,
            sides,
            moment_scale: scale,
        }
    }

    /// Marks the stray samples among the residuals that this was measured from: they do not count.
    pub fn exclude_strays(&self, planes: &[ObservedPlane], residuals: &mut Residuals) {
        for ((plane, moments), residuals) in planes.iter().zip(&self.sides).zip(residuals) {
            let mut first = 0;
            for (side, moments) in plane.sides().zip(moments) {
                for stray in &moments.strays {
                    residuals[first + stray].is_counted = false;
                }
                first += side.samples.len();
            }
        }
    }
}

/// Variance of the noise in units of the scale of an optimum's residuals in these sums.
pub(crate) fn white_variance<L>(noise: &Noise, refined: &Refined<L>) -> f64 {
    // The mean of the robust weights is below 1, which is equivalent to less noise.
    Loss::Tukey.mean_weight() * noise.correlation * (noise.scale / refined.scale).powi(2)
}

impl LocalNoise {
    /// The scale of residuals from which smooth displacements took some degrees of freedom: an
    /// M-estimate that starts from their median size.
    fn of(rough: &[f64], absorbed: f64) -> Self {
        let first = median_scale(rough.iter().copied()).max(MIN_SCALE);
        let mut spread = ResidualSpread::default();
        for value in rough {
            let x = value / first;
            spread.add(Loss::Tukey, x, Loss::Tukey.cost_and_weight(x).1);
        }
        let factor = spread.covariance_factor(absorbed) / Loss::Tukey.mean_weight();
        Self {
            scale: first * factor.sqrt(),
            freedom: (rough.len() as f64 - absorbed).max(1.0),
        }
    }
}

/// Orders of the displacement that can be fitted to so many samples.
fn orders(samples: usize) -> usize {
    ORDERS.min(samples / SAMPLES_PER_ORDER)
}

/// Degrees of freedom taken by displacement and fit together: at least the two of a line.
fn absorbed_freedom(samples: usize) -> usize {
    orders(samples).max(2).min(samples)
}

/// A side's residuals, in units of their given standard deviations, less their smooth part.
fn without_displacement(moments: &SideMoments, residuals: &[Residual]) -> Vec<f64> {
    let mut gram = moments.robust.gram;
    for k in 0..ORDERS {
        let stiffness = match k < orders(residuals.len()) {
            true => 1.0 / LOOSE,
            false => LOOSE,
        };
        gram[(k, k)] += (moments.largest_weight * stiffness).powi(2);
    }
    let solve = |factor: Cholesky<f64, _>| factor.solve(&moments.robust.gradient);
    let displacement = gram.cholesky().map_or(Basis::zeros(), solve);
    let terms = basis_by_polynomials().tr_mul(&displacement);
    let displacement_at = |place: &f64| polynomial_at(terms.as_slice(), *place);
    let samples = moments.places.iter().zip(residuals);
    samples
        .map(|(place, residual)| (residual.distance - displacement_at(place)) * residual.weight)
        .collect()
}

impl Neighbours {
    /// Adds a side's samples, in their order along it.
    fn add(&mut self, rough: &[f64], scale: f64) {
        let value = |rough: &f64| {
            let x = rough / scale;
            Loss::Tukey.cost_and_weight(x).1 * x
        };
        let values: Vec<f64> = rough.iter().map(value).collect();
        for lag in 0..=MAX_LAG.min(values.len().saturating_sub(1)) {
            let pairs = values.iter().zip(&values[lag..]);
            self.products[lag] += pairs.map(|(a, b)| a * b).sum::<f64>();
            self.pairs[lag] += (values.len() - lag) as f64;
        }
    }

    /// `c = 1 + 2 sum rho`, over the lags from the first one on that are significantly correlated.
    ///
    /// Removing a side's smooth displacement takes a fraction `t` of the degrees of freedom, where
    /// correlated noise has `c` times its mean power: of the variance 1, `1 - t c` is left, and of
    /// the covariance `rho`, `rho - t c`. With `r` their ratio, `rho = r + t c (1 - r)`; `c` is
    /// that of the preceding lags, because solving for it would amplify chance more than
    /// correlation.
    fn correlation(&self, freedom: f64) -> f64 {
        let variance = self.products[0] / self.pairs[0];
        let absorbed = 1.0 - freedom / self.pairs[0];
        let chance = SIGNIFICANT / self.pairs[0].sqrt();
        let ratio = |lag: usize| self.products[lag] / self.pairs[lag].max(1.0) / variance;
        let rho = |lag: usize, so_far: f64| ratio(lag) + absorbed * so_far * (1.0 - ratio(lag));
        let mut correlation = 1.0;
        let mut lags = 0;
        for lag in 1..=MAX_LAG {
            let coefficient = rho(lag, correlation);
            if !(coefficient > chance) {
                break;
            }
            (correlation, lags) = (correlation + 2.0 * coefficient, lag);
        }
        let sum: f64 = (1..=lags).map(|lag| rho(lag, correlation)).sum();
        (1.0 + 2.0 * sum)
            .min(MAX_ABSORBED / absorbed.max(f64::MIN_POSITIVE))
            .max(1.0)
    }

    /// Factor by which the noise exceeds the estimate that assumes equal power in all degrees of
    /// freedom.
    fn scale_factor(&self, freedom: f64, correlation: f64) -> f64 {
        let absorbed = 1.0 - freedom / self.pairs[0];
        ((1.0 - absorbed) / (1.0 - absorbed * correlation)).sqrt()
    }
}
