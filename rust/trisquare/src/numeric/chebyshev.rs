//! Smooth functions on [-1, 1] by their values at a few nodes: interpolation by Chebyshev's
//! polynomials (L. N. Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 3).

use std::f64::consts::PI;
use std::sync::LazyLock;

/// Nodes of a function. Images of straight sides under lenses of up to 160 degrees are polynomials
/// of that many terms to 2e-5 px or better, and to 1e-9 px as a rule.
pub(crate) const NODES: usize = 10;

/// Places at which polynomials are evaluated at a time.
pub(crate) const LANES: usize = 4;

/// Values of some functions at the nodes, or their coefficients.
type AtNodes<const N: usize> = [[f64; N]; NODES];

static PLACES: LazyLock<[f64; NODES]> =
    LazyLock::new(|| std::array::from_fn(|k| ((k as f64 + 0.5) * PI / NODES as f64).cos()));

/// Takes values at the nodes to coefficients.
static TRANSFORM: LazyLock<AtNodes<NODES>> = LazyLock::new(|| {
    std::array::from_fn(|m| {
        let norm = if m == 0 { 1.0 } else { 2.0 } / NODES as f64;
        std::array::from_fn(|k| norm * (m as f64 * (k as f64 + 0.5) * PI / NODES as f64).cos())
    })
});

/// Where the nodes lie.
pub(crate) fn node_places() -> &'static [f64; NODES] {
    &PLACES
}

/// Coefficients of functions that are given by their values at the nodes.
pub(crate) fn coefficients<const N: usize>(values: &AtNodes<N>) -> AtNodes<N> {
    let mut found = [[0.0; N]; NODES];
    for (own, factors) in found.iter_mut().zip(TRANSFORM.iter()) {
        for (factor, values) in factors.iter().zip(values) {
            for (sum, value) in own.iter_mut().zip(values) {
                *sum += factor * value;
            }
        }
    }
    found
}

/// The first `M` polynomials at some places.
#[inline]
pub(crate) fn polynomials<const M: usize>(places: &[f64; LANES]) -> [[f64; LANES]; M] {
    let mut values = [[1.0; LANES]; M];
    values[1] = *places;
    for m in 2..M {
        for i in 0..LANES {
            values[m][i] = 2.0 * places[i] * values[m - 1][i] - values[m - 2][i];
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

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
