//! Positions along a side, and smooth displacements of its image.

use std::sync::LazyLock;

use nalgebra::{SMatrix, SVector, Vector2};

use crate::geometry::Line;
use crate::numeric::{coefficients, node_places};
use crate::observations::Sample;

/// Number of orders of a smooth displacement: variations slower than a fifth of a side.
pub(crate) const ORDERS: usize = 6;

/// Coefficients of a displacement, or the values of its basis at a place.
pub(crate) type Basis = SVector<f64, ORDERS>;

/// Legendre's polynomials at `s` in [-1, 1], scaled to a mean square of 1.
pub(crate) fn basis(s: f64) -> Basis {
    let mut values = Basis::zeros();
    let (mut last, mut value) = (0.0, 1.0);
    for k in 0..ORDERS {
        values[k] = value * (2.0 * k as f64 + 1.0).sqrt();
        let (order, next) = (k as f64, k as f64 + 1.0);
        (last, value) = (
            value,
            ((2.0 * order + 1.0) * s * value - order * last) / next,
        );
    }
    values
}

/// The basis in terms of Chebyshev polynomials, a row for each order.
pub(crate) fn basis_by_polynomials() -> &'static SMatrix<f64, ORDERS, ORDERS> {
    static ROWS: LazyLock<SMatrix<f64, ORDERS, ORDERS>> = LazyLock::new(|| {
        let at_nodes = node_places().map(|place| <[f64; ORDERS]>::from(basis(place)));
        let found = coefficients(&at_nodes);
        SMatrix::from_fn(|order, term| found[term][order])
    });
    &ROWS
}

/// The direction in which a side's samples extend; `None` if they coincide.
pub(crate) fn direction(samples: &[Sample]) -> Option<Vector2<f64>> {
    let line = Line::fit(samples.iter().map(|sample| (sample.pixel, 1.0)))?;
    Some(Vector2::new(-line.normal().y, line.normal().x))
}

/// Position of each sample along a direction, from -1 for the first to 1 for the last.
pub(crate) fn places(samples: &[Sample], along: &Vector2<f64>) -> Vec<f64> {
    let mut places: Vec<f64> = samples.iter().map(|s| along.dot(&s.pixel)).collect();
    let (low, high) = places
        .iter()
        .fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
    let half = (0.5 * (high - low)).max(f64::MIN_POSITIVE);
    for place in &mut places {
        *place = ((*place - low) / half - 1.0).clamp(-1.0, 1.0);
    }
    places
}

/// Position of each sample of an arc along it, from -1 to 1, in their order.
pub(crate) fn places_on_arc(samples: &[Sample]) -> Vec<f64> {
    let mut length = 0.0;
    let mut places = vec![0.0];
    for pair in samples.windows(2) {
        length += (pair[1].pixel - pair[0].pixel).norm();
        places.push(length);
    }
    let half = (0.5 * length).max(f64::MIN_POSITIVE);
    places.iter().map(|place| place / half - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::{LANES, polynomials};

    #[test]
    fn basis_is_orthonormal_in_the_mean() {
        let mut gram = SMatrix::<f64, ORDERS, ORDERS>::zeros();
        let steps = 20_000;
        for i in 0..steps {
            let values = basis((2.0 * f64::from(i) + 1.0) / f64::from(steps) - 1.0);
            gram += values * values.transpose() / f64::from(steps);
        }
        assert!((gram - SMatrix::identity()).norm() < 1e-6, "{gram}");
    }

    #[test]
    fn basis_is_its_polynomials() {
        let places = [-1.0, -0.3, 0.2, 0.9];
        let terms = polynomials::<ORDERS>(&places);
        for i in 0..LANES {
            let terms = Basis::from_fn(|m, _| terms[m][i]);
            let found = basis_by_polynomials() * terms;
            assert!((found - basis(places[i])).norm() < 1e-13, "{found}");
        }
    }

    #[test]
    fn places_run_from_end_to_end_in_whatever_order() {
        let sample = |x: f64| Sample {
            pixel: Vector2::new(3.0 + x, 5.0 - 2.0 * x),
            weight: 1.0,
            index: 0,
        };
        let samples = [sample(2.0), sample(0.0), sample(1.0), sample(8.0)];
        let found = places(&samples, &direction(&samples).unwrap());
        let sign = found[3].signum();
        for (place, expected) in found.iter().zip([-0.5, -1.0, -0.75, 1.0]) {
            assert!((place * sign - expected).abs() < 1e-12);
        }
    }
}
