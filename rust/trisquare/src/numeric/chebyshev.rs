//! Smooth functions on [-1, 1] given by their values at a few nodes: interpolation by Chebyshev
//! polynomials (L. N. Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 3).

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Number of nodes of a function. Images of straight sides under lenses of up to 160 degrees are
/// polynomials of as many terms to 2e-5 px or better, and mostly to 1e-9 px.
pub(crate) const NODES: usize = 10;

/// Number of places at which polynomials are evaluated at a time.
pub(crate) const LANES: usize = 4;

/// Values of some functions at the nodes, or their coefficients.
type AtNodes<const N: usize> = [[f64; N]; NODES];

static PLACES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| std::array::from_fn(|k| ((k as f64 + 0.5) * PI / NODES as f64).cos()));

/// Matrix from values at the nodes to coefficients.
static TRANSFORM: LazyLock<AtNodes<NODES>> = LazyLock::new(|| {
    std::array::from_fn(|m| {
        let norm = if m == 0 { 1.0 } else { 2.0 } / NODES as f64;
        std::array::from_fn(|k| norm * (m as f64 * (k as f64 + 0.5) * PI / NODES as f64).cos())
    })
});

/// Positions of the nodes.
pub(crate) fn node_places() -> &'static [f64; NODES] {
    &PLACES
}

/// Coefficients of functions that are given by their values at the nodes.
pub(crate) fn coefficients<const N: usize>(values: &AtNodes<N>) -> AtNodes<N> {
    let mut found = [[0.0; N]; NODES];
    for (sums, factors) in found.iter_mut().zip(TRANSFORM.iter()) {
        for (factor, values) in factors.iter().zip(values) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += factor * value;
            }
        }
    }
    found
}

/// The first `M` polynomials at `LANES` places.
#[inline]
pub(crate) fn polynomials<const M: usize>(places: &[f64; LANES]) -> [[f64; LANES]; M] {
    let mut values = [[1.0; LANES]; M];
    values[1] = *places;
    let doubled = places.map(|place| 2.0 * place);
    for m in 2..M {
        let (last, before) = (values[m - 1], values[m - 2]);
        values[m] = std::array::from_fn(|i| doubled[i] * last[i] - before[i]);
    }
    values
}

/// A polynomial, by its coefficients, at a place (C. W. Clenshaw's recurrence).
#[inline]
pub(crate) fn polynomial_at(coefficients: &[f64], place: f64) -> f64 {
    let (mut value, mut last) = (0.0, 0.0);
    for coefficient in coefficients[1..].iter().rev() {
        (value, last) = (coefficient + 2.0 * place * value - last, value);
    }
    coefficients[0] + place * value - last
}

/// Sums over weighted samples for the fit of a polynomial of `N` terms, from `M = 2 N - 1`
/// polynomials at each.
pub(crate) struct PolynomialSums<const N: usize, const M: usize> {
    weights: [[f64; LANES]; M],
    values: [[f64; LANES]; N],
}

impl<const N: usize, const M: usize> PolynomialSums<N, M> {
    pub fn new() -> Self {
        Self {
            weights: [[0.0; LANES]; M],
            values: [[0.0; LANES]; N],
        }
    }

    /// Adds samples, given by the polynomials, their weights, and their values times their weights.
    #[inline]
    pub fn add(
        &mut self,
        terms: &[[f64; LANES]; M],
        weights: &[f64; LANES],
        values: &[f64; LANES],
    ) {
        for (sum, term) in self.weights.iter_mut().zip(terms) {
            for i in 0..LANES {
                sum[i] += weights[i] * term[i];
            }
        }
        for (sum, term) in self.values.iter_mut().zip(terms) {
            for i in 0..LANES {
                sum[i] += values[i] * term[i];
            }
        }
    }

    /// Weighted sums of the products of two polynomials, and of a polynomial and the value.
    pub fn finish(&self) -> ([[f64; N]; N], [f64; N]) {
        let sum = |lanes: &[f64; LANES]| lanes.iter().sum::<f64>();
        let weights: [f64; M] = std::array::from_fn(|m| sum(&self.weights[m]));
        // T_i T_j = (T_(i+j) + T_|i-j|) / 2
        let product = |i: usize, j: usize| 0.5 * (weights[i + j] + weights[i.abs_diff(j)]);
        let products = std::array::from_fn(|i| std::array::from_fn(|j| product(i, j)));
        (products, std::array::from_fn(|m| sum(&self.values[m])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_is_the_sum_of_its_terms() {
        let (coefficients, places) = ([0.3, -1.0, 2.0, 0.7], [-1.0, -0.2, 0.4, 1.0]);
        let terms = polynomials::<4>(&places);
        for (i, place) in places.into_iter().enumerate() {
            let expected: f64 = (0..4).map(|m| coefficients[m] * terms[m][i]).sum();
            assert!((polynomial_at(&coefficients, place) - expected).abs() < 1e-14);
        }
        assert_eq!(polynomial_at(&coefficients[..1], 0.5), 0.3);
    }

    #[test]
    fn sums_fit_polynomials() {
        let samples: [([f64; LANES], [f64; LANES]); 2] = [
            ([-1.0, -0.4, 0.1, 0.3], [1.0, 0.5, 2.0, 0.0]),
            ([0.9, 1.0, 0.2, -0.8], [0.1, 3.0, 1.0, 0.7]),
        ];
        let (mut sums, mut products, mut values) =
            (PolynomialSums::<3, 5>::new(), [[0.0; 3]; 3], [0.0; 3]);
        for (places, weights) in &samples {
            let terms = polynomials::<5>(places);
            sums.add(
                &terms,
                weights,
                &std::array::from_fn(|i| weights[i] * places[i].exp()),
            );
            for i in 0..LANES {
                for m in 0..3 {
                    values[m] += weights[i] * places[i].exp() * terms[m][i];
                    for k in 0..3 {
                        products[m][k] += weights[i] * terms[m][i] * terms[k][i];
                    }
                }
            }
        }
        let (found, found_values) = sums.finish();
        for m in 0..3 {
            assert!((found_values[m] - values[m]).abs() < 1e-12);
            for k in 0..3 {
                assert!((found[m][k] - products[m][k]).abs() < 1e-12, "{m} {k}");
            }
        }
    }

    #[test]
    fn smooth_functions_are_interpolated() {
        let functions = |x: f64| [x.exp(), 1.0 / (5.0 + x), x.powi(9) - 0.5];
        let values = node_places().map(functions);
        let coefficients = coefficients(&values);
        for places in [[-1.0, -0.7, 0.01, 0.3], [0.55, 0.9, 0.99, 1.0]] {
            let terms = polynomials::<NODES>(&places);
            for (i, place) in places.iter().enumerate() {
                for (f, expected) in functions(*place).into_iter().enumerate() {
                    let found: f64 = (0..NODES).map(|m| coefficients[m][f] * terms[m][i]).sum();
                    assert!((found - expected).abs() < 1e-8, "{f} {place}");
                }
            }
        }
    }
}
