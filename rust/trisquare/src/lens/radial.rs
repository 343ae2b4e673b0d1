//! Distortion polynomials: the radius up to which they are monotonic, and their conversion into the
//! inverse.

use nalgebra::{DMatrix, DVector, Vector2};

use crate::image_size::ImageSize;

/// Maximum number of bisections; they narrow a bracket to rounding.
const MAX_BISECTIONS: usize = 200;

/// Number of samples along the radius when one polynomial is converted into another.
const CONVERSION_SAMPLES: usize = 200;

/// Squared radius beyond which no lens sees (a millionth of a radian from 90 degrees); a root
/// beyond it is ignored.
pub(super) const LARGEST_SQUARED_RADIUS: f64 = 1e12;

/// The largest radius up to which `r (1 + k1 r^2 + k2 r^4 + k3 r^6)` increases; may be infinite.
pub fn monotonic_radius([k1, k2, k3]: [f64; 3]) -> f64 {
    // In s = r^2 the slope is 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3; between its extrema it has at most
    // one root.
    let slope = |s: f64| slope([k1, k2, k3], s);
    let mut stretches = positive_roots(3.0 * k1, 10.0 * k2, 21.0 * k3);
    // All roots lie within Cauchy's bound, beyond which the highest power dominates.
    let powers = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3];
    if let Some(highest) = powers.iter().rposition(|c| *c != 0.0) {
        let largest = powers[..highest].iter().fold(0.0f64, |a, c| a.max(c.abs()));
        stretches.push(1.0 + largest / powers[highest].abs());
    }
    for stretch in &mut stretches {
        *stretch = stretch.min(LARGEST_SQUARED_RADIUS);
    }
    let mut left = 0.0;
    for right in stretches {
        if slope(right) <= 0.0 {
            return bisect(slope, left, right).sqrt();
        }
        left = right;
    }
    f64::INFINITY
}

/// The derivative of `r (1 + k1 r^2 + k2 r^4 + k3 r^6)` with respect to `r`, at `s = r^2`.
fn slope([k1, k2, k3]: [f64; 3], s: f64) -> f64 {
    1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3))
}

/// Whether `r (1 + k1 r^2 + k2 r^4 + k3 r^6)` increases up to a squared radius.
pub(crate) fn increases_up_to([k1, k2, k3]: [f64; 3], square: f64) -> bool {
    let slope = |s: f64| slope([k1, k2, k3], s);
    let extrema = positive_roots(3.0 * k1, 10.0 * k2, 21.0 * k3);
    let mut within = extrema.into_iter().filter(|s| *s < square);
    slope(square) > 0.0 && within.all(|s| slope(s) > 0.0)
}

/// The largest radius up to which Brown's distortion is monotonic in the plane; may be infinite.
///
/// The distortion is the gradient of a function of the ideal point, and its Jacobian symmetric.
/// Where the Jacobian is positive definite all over a disc, `(d(u) - d(v)) . (u - v) > 0` for any
/// two points of the disc: no two of them have the same observed point. In the direction of the
/// point and across it the radial part has the eigenvalues `B = 1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3`
/// and `A = 1 + k1 s + k2 s^2 + k3 s^3`; the tangential part, `s q + 2 u (q . u)` with
/// `q = (p2, p1)`, adds eigenvalues between `-6 |q| r` and `6 |q| r`, the lowest along the point
/// opposite to `q`. The result is the radius at which `A` or `B` falls to `6 |q| r`: exact for
/// lenses that compress toward the rim (`B <= A`), conservative for the rest.
pub fn invertible_radius([k1, k2, k3]: [f64; 3], [p1, p2]: [f64; 2]) -> f64 {
    let radial = monotonic_radius([k1, k2, k3]);
    let eigenvalue_bound = -6.0 * p1.hypot(p2);
    if eigenvalue_bound == 0.0 {
        return radial;
    }
    let limit = radial.min(LARGEST_SQUARED_RADIUS.sqrt());
    [
        [
            1.0,
            eigenvalue_bound,
            3.0 * k1,
            0.0,
            5.0 * k2,
            0.0,
            7.0 * k3,
        ],
        [1.0, eigenvalue_bound, k1, 0.0, k2, 0.0, k3],
    ]
    .iter()
    .filter_map(|polynomial| sign_changes(polynomial, limit).first().copied())
    .fold(radial, f64::min)
}

/// Returns the places between 0 and `limit` at which a polynomial (lowest power first) changes
/// sign, ascending.
///
/// Between neighbouring sign changes of its derivative the polynomial is monotonic and changes sign
/// at most once, so that bisection finds the place.
pub(crate) fn sign_changes(polynomial: &[f64], limit: f64) -> Vec<f64> {
    if polynomial.len() < 2 {
        return Vec::new();
    }
    let value = |r: f64| polynomial.iter().rev().fold(0.0, |sum, c| sum * r + c);
    let derivative: Vec<f64> = polynomial[1..]
        .iter()
        .enumerate()
        .map(|(power, c)| (power + 1) as f64 * c)
        .collect();
    let mut ends = sign_changes(&derivative, limit);
    ends.push(limit);
    let mut left = 0.0;
    let mut changes = Vec::new();
    for right in ends {
        if (value(left) > 0.0) != (value(right) > 0.0) {
            let sign = if value(left) > 0.0 { 1.0 } else { -1.0 };
            changes.push(bisect(|r| sign * value(r), left, right));
        }
        left = right;
    }
    changes
}

/// Positive roots of `c0 + c1 s + c2 s^2`, ascending.
fn positive_roots(c0: f64, c1: f64, c2: f64) -> Vec<f64> {
    let discriminant = c1 * c1 - 4.0 * c2 * c0;
    let mut roots = Vec::with_capacity(3);
    if discriminant >= 0.0 {
        let q = -0.5 * (c1 + discriminant.sqrt().copysign(c1));
        roots.extend(
            [q / c2, c0 / q]
                .iter()
                .filter(|r| r.is_finite() && **r > 0.0),
        );
        roots.sort_by(f64::total_cmp);
    }
    roots
}

/// The root of a function that is positive at `left` and not at `right`.
fn bisect(f: impl Fn(f64) -> f64, mut left: f64, mut right: f64) -> f64 {
    for _ in 0..MAX_BISECTIONS {
        let middle = 0.5 * (left + right);
        if middle <= left || middle >= right {
            break;
        }
        if f(middle) > 0.0 {
            left = middle;
        } else {
            right = middle;
        }
    }
    left
}

/// Returns the coefficients of the forward model that corresponds to a map observed -> ideal over
/// all radii which a picture covers, in units of the focal length; empty if the map is not
/// increasing.
///
/// A map that folds back before the corners is used up to half the radius.
pub(crate) fn covering_coefficients(
    ideal: impl Fn(f64) -> f64,
    (size, centre, focal): (ImageSize, Vector2<f64>, f64),
    count: usize,
) -> Vec<f64> {
    let covered = size
        .corners()
        .map(|corner| (corner - centre).norm() / focal);
    let largest = covered.iter().fold(0.0f64, |a, b| a.max(*b));
    forward_coefficients(&ideal, largest, count)
        .or_else(|| forward_coefficients(&ideal, 0.5 * largest, count))
        .unwrap_or_default()
}

/// Returns the coefficients `k` of the forward model that corresponds to a map observed -> ideal.
///
/// Least squares over observed radii up to `largest` (any unit in which the ideal radius is
/// `ideal(r)`): `r_d ~ r_u (1 + k1 r_u^2 + ...)`, with the given number of coefficients. `None` if
/// the map is not increasing up to `largest`.
fn forward_coefficients(
    ideal: impl Fn(f64) -> f64,
    largest: f64,
    coefficients: usize,
) -> Option<Vec<f64>> {
    let mut design = DMatrix::zeros(CONVERSION_SAMPLES, coefficients);
    let mut target = DVector::zeros(CONVERSION_SAMPLES);
    let mut previous = 0.0;
    for i in 0..CONVERSION_SAMPLES {
        let observed = largest * (i + 1) as f64 / CONVERSION_SAMPLES as f64;
        let r = ideal(observed);
        if !(r > previous) {
            return None;
        }
        previous = r;
        for j in 0..coefficients {
            design[(i, j)] = r.powi(2 * j as i32 + 3);
        }
        target[i] = observed - r;
    }
    let normal = design.tr_mul(&design);
    let solution = normal.cholesky()?.solve(&design.tr_mul(&target));
    Some(solution.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monotonic_radius_is_where_the_slope_first_vanishes() {
        assert_eq!(monotonic_radius([0.0; 3]), f64::INFINITY);
        assert_eq!(monotonic_radius([0.2, 0.1, 0.0]), f64::INFINITY);
        for k in [
            [-0.3, 0.0, 0.0],
            [-0.4, 0.05, 0.0],
            [-0.4, 0.1, -0.02],
            [0.5, -0.2, 0.0],
            [0.0, 0.0, -1e-3],
            [-1e-9, 0.0, 0.0],
        ] {
            let r = monotonic_radius(k);
            let slope = |r: f64| {
                let s = r * r;
                1.0 + 3.0 * k[0] * s + 5.0 * k[1] * s * s + 7.0 * k[2] * s * s * s
            };
            assert!(r.is_finite(), "{k:?}");
            let scale = 1.0 + (k[1] * r.powi(4)).abs() + (k[2] * r.powi(6)).abs();
            assert!(slope(r).abs() < 1e-9 * scale, "{k:?} {r} {}", slope(r));
            for i in 0..1000 {
                assert!(slope(r * f64::from(i) / 1000.0) > 0.0, "{k:?}");
            }
        }
        // The slope is positive everywhere although k1 is negative: its minimum is above zero.
        assert_eq!(monotonic_radius([-0.1, 0.2, 0.0]), f64::INFINITY);
    }

    /// The smaller eigenvalue of the Jacobian of Brown's distortion, by the formula of the
    /// potential.
    fn smallest_eigenvalue(k: [f64; 3], p: [f64; 2], x: f64, y: f64) -> f64 {
        let s = x * x + y * y;
        let factor = 1.0 + s * (k[0] + s * (k[1] + s * k[2]));
        let slope = 2.0 * (k[0] + s * (2.0 * k[1] + s * 3.0 * k[2]));
        let xx = factor + slope * x * x + 2.0 * p[0] * y + 6.0 * p[1] * x;
        let yy = factor + slope * y * y + 6.0 * p[0] * y + 2.0 * p[1] * x;
        let xy = slope * x * y + 2.0 * (p[0] * x + p[1] * y);
        0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()
    }

    #[test]
    fn invertible_radius_is_where_the_jacobian_first_turns_singular() {
        assert_eq!(invertible_radius([0.1, 0.0, 0.0], [0.0; 2]), f64::INFINITY);
        for (k, p, exact) in [
            ([-0.3, 0.0, 0.0], [0.002, -0.001], true),
            ([-0.3, 0.1, -0.02], [0.0, 0.05], true),
            ([0.0, 0.0, 0.0], [0.01, 0.0], true),
            ([-0.1, 0.2, 0.0], [0.0, 0.3], false),
            ([0.3, 0.1, 0.0], [-0.3, 0.2], false),
        ] {
            let radius = invertible_radius(k, p);
            assert!(radius < monotonic_radius(k), "{k:?} {p:?} {radius}");
            let least = |r: f64| {
                (0..720)
                    .map(|i| f64::from(i).to_radians() / 2.0)
                    .map(|t| smallest_eigenvalue(k, p, r * t.cos(), r * t.sin()))
                    .fold(f64::INFINITY, f64::min)
            };
            for i in 0..200 {
                assert!(least(radius * f64::from(i) / 200.0) > 0.0, "{k:?} {p:?}");
            }
            if exact {
                assert!(least(radius * 1.01) < 0.0, "{k:?} {p:?} {radius}");
            }
        }
    }

    #[test]
    fn forward_coefficients_invert_a_polynomial() {
        let k = forward_coefficients(|r| r * (1.0 + 0.1 * r * r), 0.7, 3).unwrap();
        for i in 1..=70 {
            let observed = f64::from(i) / 100.0;
            let s = (observed * (1.0 + 0.1 * observed * observed)).powi(2);
            let back = s.sqrt() * (1.0 + s * (k[0] + s * (k[1] + s * k[2])));
            assert!((back - observed).abs() < 1e-5);
        }
        assert!(forward_coefficients(|r| r * (1.0 - r * r), 1.0, 2).is_none());
    }
}
