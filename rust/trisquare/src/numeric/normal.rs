//! The normal distribution: density, distribution function, and bivariate distribution function.
//!
//! A sharp edge seen through a Gaussian blur is the distribution function of the distance to it,
//! and a blurred corner is the bivariate one; both are evaluated for every pixel near an outline.

use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// `1 / sqrt(2 pi)`, the density at zero.
const PEAK: f64 = 0.398_942_280_401_432_7;
/// Number of standard deviations beyond which the tail, below 2e-11, is taken as zero.
const RANGE: i32 = 7;
const CELLS_PER_UNIT: i32 = 32;
const WIDTH: f64 = 1.0 / CELLS_PER_UNIT as f64;

/// The density's cubic Hermite interpolant over one cell, in the fraction of the cell, and the
/// distribution function at its start; integrating the cubic makes the two consistent.
struct Cell {
    cdf: f64,
    pdf: [f64; 4],
    /// A third of the cubic's third coefficient, stored to avoid a division per pixel.
    third: f64,
}

static CELLS: LazyLock<Vec<Cell>> = LazyLock::new(|| {
    let exact_pdf = |x: f64| PEAK * (-0.5 * x * x).exp();
    (-RANGE * CELLS_PER_UNIT..RANGE * CELLS_PER_UNIT)
        .map(|index| {
            let (x, end) = (f64::from(index) * WIDTH, f64::from(index + 1) * WIDTH);
            let (value, end_value) = (exact_pdf(x), exact_pdf(end));
            let (slope, end_slope) = (-x * value * WIDTH, -end * end_value * WIDTH);
            let change = end_value - value;
            let square = 3.0 * change - 2.0 * slope - end_slope;
            Cell {
                cdf: 0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2),
                pdf: [value, slope, square, slope + end_slope - 2.0 * change],
                third: square / 3.0,
            }
        })
        .collect()
});

/// The standard normal distribution function and density at `x`, to an absolute 5e-9.
#[inline]
#[must_use]
pub fn cdf_and_pdf(x: f64) -> (f64, f64) {
    let position = (x + f64::from(RANGE)) * f64::from(CELLS_PER_UNIT);
    // The cast rounds towards zero and saturates; below the range the fraction is negative.
    let index = position as i32;
    let fraction = position - f64::from(index);
    match CELLS.get(index as usize) {
        Some(Cell { cdf, pdf, third }) if fraction >= 0.0 => {
            let [c0, c1, c2, c3] = *pdf;
            let density = c0 + fraction * (c1 + fraction * (c2 + fraction * c3));
            let area = c0 + fraction * (c1 / 2.0 + fraction * (third + fraction * c3 / 4.0));
            (cdf + WIDTH * fraction * area, density)
        }
        _ => (if x > 0.0 { 1.0 } else { 0.0 }, 0.0),
    }
}

/// The standard normal distribution function, to an absolute 1e-9.
#[inline]
#[must_use]
pub fn cdf(x: f64) -> f64 {
    cdf_and_pdf(x).0
}

/// The standard normal density, to an absolute 5e-9.
#[inline]
#[must_use]
pub fn pdf(x: f64) -> f64 {
    cdf_and_pdf(x).1
}

/// The largest correlation for which [`BivariateNormal`] is accurate.
const MAX_CORRELATION: f64 = 0.95;
/// Gauss-Legendre points on half an interval: enough for 1e-7 at the largest correlation.
const HALF_POINTS: usize = 10;

/// Positive Gauss-Legendre nodes of order `2 HALF_POINTS`, and their weights.
static GAUSS_LEGENDRE: LazyLock<[(f64, f64); HALF_POINTS]> = LazyLock::new(|| {
    let order = 2 * HALF_POINTS;
    std::array::from_fn(|index| {
        // The usual cosine start is within Newton's quadratic range: five steps are exact.
        let mut node = (PI * (index as f64 + 0.75) / (order as f64 + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..5 {
            let (mut value, mut previous) = (node, 1.0);
            for k in 2..=order {
                let k = k as f64;
                let next = ((2.0 * k - 1.0) * node * value - (k - 1.0) * previous) / k;
                (value, previous) = (next, value);
            }
            slope = order as f64 * (node * value - previous) / (node * node - 1.0);
            node -= value / slope;
        }
        (node, 2.0 / ((1.0 - node * node) * slope * slope))
    })
});

/// Two standard normal variables of a given correlation, prepared for many evaluations.
///
/// Their joint distribution function is `Phi(h) Phi(k)` plus the integral of the joint density over
/// the correlation, with `r = sin(theta)`, by Gauss-Legendre quadrature: Drezner & Wesolowsky, *On
/// the computation of the bivariate normal integral*, J. Statist. Comput. Simul. 35 (1990) 101-107,
/// as refined by Genz, *Numerical computation of rectangular bivariate and trivariate normal and t
/// probabilities*, Statistics and Computing 14 (2004) 251-260. Absolute error below 1e-7 for
/// correlations up to 0.95; larger ones are treated as that one.
#[derive(Debug, Clone)]
pub struct BivariateNormal {
    half_angle: f64,
    /// The two nodes that share a weight, and the weight.
    nodes: [([Node; 2], f64); HALF_POINTS],
}

/// A correlation at which the joint density is evaluated.
#[derive(Debug, Clone, Copy)]
struct Node {
    sine: f64,
    inverse_square_cosine: f64,
}

impl BivariateNormal {
    /// The distribution with correlation `rho`.
    #[must_use]
    pub fn new(rho: f64) -> Self {
        let half_angle = 0.5 * rho.clamp(-MAX_CORRELATION, MAX_CORRELATION).asin();
        let node_at = |angle: f64| {
            let sine = angle.sin();
            Node {
                sine,
                inverse_square_cosine: 1.0 / (1.0 - sine * sine),
            }
        };
        let nodes = GAUSS_LEGENDRE.map(|(node, weight)| {
            let offset = half_angle * node;
            (
                [node_at(half_angle - offset), node_at(half_angle + offset)],
                weight,
            )
        });
        Self { half_angle, nodes }
    }

    /// The probability that they are below `h` and `k`.
    #[must_use]
    pub fn cdf(&self, h: f64, k: f64) -> f64 {
        let (squares, product) = (0.5 * (h * h + k * k), h * k);
        let density =
            |node: &Node| ((node.sine * product - squares) * node.inverse_square_cosine).exp();
        let pairs = self.nodes.iter();
        let integral: f64 = pairs
            .map(|([low, high], weight)| weight * (density(low) + density(high)))
            .sum();
        (cdf(h) * cdf(k) + self.half_angle * integral / TAU).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distribution_and_density_match_the_error_function() {
        for step in -90_000..=90_000 {
            let x = f64::from(step) * 1e-4;
            let (distribution, density) = cdf_and_pdf(x);
            let exact = 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
            assert!((distribution - exact).abs() < 1e-9, "cdf({x})");
            let exact = (-0.5 * x * x).exp() / TAU.sqrt();
            assert!((density - exact).abs() < 5e-9, "pdf({x})");
        }
    }

    #[test]
    fn far_and_undefined_arguments_are_answered() {
        assert_eq!(cdf_and_pdf(f64::INFINITY), (1.0, 0.0));
        assert_eq!(cdf_and_pdf(f64::NEG_INFINITY), (0.0, 0.0));
        assert_eq!(cdf_and_pdf(1e300), (1.0, 0.0));
        assert_eq!(pdf(f64::NAN), 0.0);
    }

    /// `integral of phi(x) Phi((k - rho x) / sqrt(1 - rho^2))` up to `h`, by a fine Simpson rule.
    fn bivariate_by_brute_force(h: f64, k: f64, rho: f64) -> f64 {
        let (start, steps) = (-9.0, 4000);
        if h <= start {
            return 0.0;
        }
        let width = (h - start) / f64::from(steps);
        let spread = (1.0 - rho * rho).sqrt() * std::f64::consts::SQRT_2;
        let integrand = |x: f64| {
            let inner = 0.5 * libm::erfc((rho * x - k) / spread);
            (-0.5 * x * x).exp() / TAU.sqrt() * inner
        };
        let sum: f64 = (0..=steps)
            .map(|step| {
                let weight = match step {
                    0 => 1.0,
                    _ if step == steps => 1.0,
                    _ if step % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                weight * integrand(start + f64::from(step) * width)
            })
            .sum();
        sum * width / 3.0
    }

    #[test]
    fn bivariate_distribution_matches_brute_force() {
        for rho in [-0.95, -0.8, -0.5, -0.1, 0.0, 0.2, 0.6, 0.9, 0.95] {
            let prepared = BivariateNormal::new(rho);
            for h in [-3.0, -1.2, -0.3, 0.0, 0.7, 1.9, 4.0] {
                for k in [-2.5, -0.9, 0.0, 0.4, 1.1, 3.0] {
                    let exact = bivariate_by_brute_force(h, k, rho);
                    let error = prepared.cdf(h, k) - exact;
                    assert!(error.abs() < 1e-7, "({h}, {k}, {rho}): {error:e}");
                }
            }
        }
    }

    #[test]
    fn bivariate_orthant_has_its_closed_form() {
        for rho in [-0.9_f64, -0.3, 0.0, 0.5, 0.95] {
            let orthant = 0.25 + rho.asin() / TAU;
            assert!((BivariateNormal::new(rho).cdf(0.0, 0.0) - orthant).abs() < 1e-9);
        }
    }
}
