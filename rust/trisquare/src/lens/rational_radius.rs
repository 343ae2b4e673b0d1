//! Radius up to which OpenCV's rational distortion with tangential and prism terms is invertible.

use super::radial::{LARGEST_SQUARED_RADIUS, sign_changes};

/// Trusted fraction of the radius at which the denominator vanishes, where pixels are infinitely
/// far: it spans some billion pixels.
const BEFORE_POLE: f64 = 1.0 - 1e-9;

/// Coefficients of a polynomial, the lowest power first.
type Polynomial = Vec<f64>;

/// The largest radius up to which the distortion is monotonic in the plane; may be infinite.
///
/// The coefficients are in OpenCV's order, `k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4`. As in
/// [`invertible_radius`](super::invertible_radius), no two points of a disc have the same observed
/// point if the symmetric part of the Jacobian is positive definite all over it. With `A / B` the
/// radial factor, that part has across and along the radius the eigenvalues `A / B` and
/// `A / B + 2 s (A' B - A B') / B^2`, which the tangential and the prism terms lower by at most
/// `6 |p| r` and `2 r |(s1, s3)| + 4 r^3 |(s2, s4)|`. The result is the radius at which the smaller
/// eigenvalue falls to that bound, or one just before `B` vanishes.
pub(super) fn rational_radius(coefficients: &[f64; 12]) -> f64 {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = *coefficients;
    let (numerator, denominator) = (vec![1.0, k1, k2, k3], vec![1.0, k4, k5, k6]);
    let twist = sum(
        &product(&derivative(&numerator), &denominator),
        &product(&scaled(&derivative(&denominator), -1.0), &numerator),
    );
    let across = numerator.clone();
    let along = sum(
        &product(&numerator, &denominator),
        &scaled(&product(&[0.0, 1.0], &twist), 2.0),
    );
    let square = product(&denominator, &denominator);
    let eigenvalue_bound = [
        0.0,
        -6.0 * p1.hypot(p2) - 2.0 * s1.hypot(s3),
        0.0,
        -4.0 * s2.hypot(s4),
    ];
    let first_root = |polynomial: &Polynomial, limit: f64| {
        sign_changes(trimmed(polynomial), limit).first().copied()
    };
    let pole =
        first_root(&denominator, LARGEST_SQUARED_RADIUS).map(|square| square.sqrt() * BEFORE_POLE);
    let pole = pole.unwrap_or(f64::INFINITY);
    if eigenvalue_bound.iter().all(|c| *c == 0.0) {
        // Polynomials of the squared radius.
        let limit = LARGEST_SQUARED_RADIUS.min(pole * pole);
        let roots = [&across, &along].map(|polynomial| first_root(polynomial, limit));
        return smallest(roots).sqrt().min(pole);
    }
    let with_bound = |eigenvalue: &Polynomial, weight: &Polynomial| {
        sum(
            &spread(eigenvalue),
            &product(&eigenvalue_bound, &spread(weight)),
        )
    };
    let limit = LARGEST_SQUARED_RADIUS.sqrt().min(pole);
    let (across, along) = (
        with_bound(&across, &denominator),
        with_bound(&along, &square),
    );
    let end = first_root(&across, limit).unwrap_or(limit);
    let end = smallest([first_root(&across, limit), first_root(&along, end)]);
    end.min(pole)
}

fn smallest(roots: [Option<f64>; 2]) -> f64 {
    roots.into_iter().flatten().fold(f64::INFINITY, f64::min)
}

/// Returns a polynomial without its highest powers where their coefficients are zero.
fn trimmed(polynomial: &[f64]) -> &[f64] {
    let last = polynomial.iter().rposition(|c| *c != 0.0);
    &polynomial[..last.map_or(0, |last| last + 1)]
}

fn sum(a: &[f64], b: &[f64]) -> Polynomial {
    let at = |p: &[f64], i: usize| p.get(i).copied().unwrap_or_default();
    let count = a.len().max(b.len());
    (0..count).map(|i| at(a, i) + at(b, i)).collect()
}

fn scaled(a: &[f64], factor: f64) -> Polynomial {
    a.iter().map(|c| c * factor).collect()
}

fn product(a: &[f64], b: &[f64]) -> Polynomial {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            product[i + j] += x * y;
        }
    }
    product
}

fn derivative(a: &[f64]) -> Polynomial {
    let powers = a.iter().enumerate().skip(1);
    powers.map(|(power, c)| power as f64 * c).collect()
}

/// Returns a polynomial of `r^2` as one of `r`.
fn spread(a: &[f64]) -> Polynomial {
    let spread = a.iter().flat_map(|c| [*c, 0.0]);
    spread.take(2 * a.len() - 1).collect()
}

#[cfg(test)]
mod tests {
    use super::super::distortion::opencv;
    use super::super::invertible_radius;
    use super::*;
    use nalgebra::Vector2;

    /// The smaller eigenvalue of the Jacobian's symmetric part.
    fn smallest_eigenvalue(coefficients: &[f64; 12], point: &Vector2<f64>) -> f64 {
        let mut all = [0.0; 14];
        all[..12].copy_from_slice(coefficients);
        let jacobian = opencv(&all, point).1;
        let symmetric = (jacobian + jacobian.transpose()) * 0.5;
        symmetric.symmetric_eigenvalues().min()
    }

    fn least(coefficients: &[f64; 12], radius: f64) -> f64 {
        let around = (0..720).map(|i| f64::from(i).to_radians() / 2.0);
        let points = around.map(|t| Vector2::new(t.cos(), t.sin()) * radius);
        let values = points.map(|point| smallest_eigenvalue(coefficients, &point));
        values.fold(f64::INFINITY, f64::min)
    }

    fn check(coefficients: &[f64; 12], is_exact: bool) {
        let radius = rational_radius(coefficients);
        assert!(radius > 0.1 && radius.is_finite(), "{radius}");
        for i in 0..200 {
            let inside = least(coefficients, radius * f64::from(i) / 200.0);
            assert!(inside > 0.0, "{coefficients:?}");
        }
        if is_exact {
            assert!(least(coefficients, radius * 1.01) < 0.0, "{radius}");
        }
    }

    #[test]
    fn it_is_where_the_jacobian_first_turns_singular() {
        let radial = [-0.3, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let tangential = [
            -0.3, 0.02, 2e-3, -1e-3, 0.01, 0.3, 0.02, 0.01, 0.0, 0.0, 0.0, 0.0,
        ];
        let bent = [
            0.5, -2.6, 5e-4, -2e-4, 1.5, 0.38, -2.4, 1.4, 0.0, 0.0, 0.0, 0.0,
        ];
        check(&radial, true);
        check(&tangential, true);
        check(&bent, false);
        let mut prism = tangential;
        prism[8..].copy_from_slice(&[4e-3, -2e-3, 3e-3, 5e-3]);
        check(&prism, false);
        let alone = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4e-2, 0.0, 3e-2, 0.0];
        check(&alone, false);
    }

    #[test]
    fn it_ends_before_the_denominator_vanishes() {
        let pole = [0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let radius = rational_radius(&pole);
        assert!(radius < 2.0 && radius > 2.0 * (1.0 - 1e-8));
        let mut tangential = pole;
        tangential[2] = 1e-3;
        assert!(rational_radius(&tangential) <= 2.0);
        let growing = [0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(rational_radius(&growing), f64::INFINITY);
    }

    #[test]
    fn without_quotient_and_prism_it_is_brown_s() {
        for (k, p) in [
            ([-0.3, 0.0, 0.0], [0.0, 0.0]),
            ([-0.3, 0.1, -0.02], [0.003, -0.002]),
            ([0.3, 0.1, 0.0], [-0.3, 0.2]),
            ([0.3, 0.1, 0.0], [0.0, 0.0]),
        ] {
            let mut coefficients = [0.0; 12];
            let [k1, k2, k3] = k;
            let [p1, p2] = p;
            coefficients[..5].copy_from_slice(&[k1, k2, p1, p2, k3]);
            let (own, brown) = (rational_radius(&coefficients), invertible_radius(k, p));
            let is_same = own == brown || (own - brown).abs() < 1e-9 * brown;
            assert!(is_same, "{own} {brown}");
        }
    }
}
