//! The chi-squared distribution's upper tail, and the equally improbable normal deviate.

/// Maximum number of terms or fractions of the incomplete gamma function; it takes about
/// `sqrt(freedom)`.
const MAX_TERMS: usize = 10_000;

/// Replaces a zero denominator of the continued fraction.
const TINY: f64 = 1e-300;

/// Probability that a chi-squared variable exceeds a value.
///
/// `Q(freedom / 2, statistic / 2)`, the regularised incomplete gamma function: by its series below
/// the mean (NIST DLMF 8.11.4), by Legendre's continued fraction above (DLMF 8.9.2), to 13 digits.
/// 1 for zero degrees of freedom, and for a statistic that is not positive.
pub fn chi_square_tail(statistic: f64, freedom: f64) -> f64 {
    let (a, x) = (0.5 * freedom, 0.5 * statistic);
    // The negated condition is true for NaN as well.
    if !(a > 0.0 && x > 0.0) {
        return 1.0;
    }
    if x == f64::INFINITY {
        return 0.0;
    }
    let density = (a * x.ln() - x - libm::lgamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..MAX_TERMS {
            term *= x / (a + n as f64);
            sum += term;
            if term < f64::EPSILON * sum {
                break;
            }
        }
        return (1.0 - density * sum).clamp(0.0, 1.0);
    }
    // Lentz's method (W. J. Lentz, Applied Optics 15 (1976) 668-671).
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / TINY;
    let mut d = 1.0 / b;
    let mut fraction = d;
    for n in 1..MAX_TERMS {
        let n = n as f64;
        let numerator = -n * (n - a);
        b += 2.0;
        d = 1.0 / nonzero(numerator * d + b);
        c = nonzero(b + numerator / c);
        fraction *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    (density * fraction).clamp(0.0, 1.0)
}

fn nonzero(value: f64) -> f64 {
    if value.abs() < TINY { TINY } else { value }
}

/// The normal deviate about as improbable as a chi-squared value of `freedom` degrees.
///
/// An approximation that remains finite where the tail underflows (E. B. Wilson & M. M. Hilferty,
/// PNAS 17 (1931) 684-688).
pub(crate) fn normal_deviate(chi_square: f64, freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    ((chi_square / freedom).cbrt() - (1.0 - spread)) / spread.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_is_that_of_the_finite_sums() {
        // Abramowitz & Stegun, 26.4.4 and 26.4.5: exact for whole degrees of freedom.
        for freedom in [1, 2, 3, 4, 7, 18, 101, 400] {
            for statistic in [1e-6, 0.1, 1.0, 5.0, 20.0, 100.0, 400.0, 900.0] {
                let half = 0.5 * statistic;
                let (mut sum, mut power) = if freedom % 2 == 1 {
                    (libm::erfc(f64::sqrt(half)), 0.5)
                } else {
                    (f64::exp(-half), 1.0)
                };
                while power < 0.5 * f64::from(freedom) {
                    sum += (power * half.ln() - half - libm::lgamma(power + 1.0)).exp();
                    power += 1.0;
                }
                let tail = chi_square_tail(statistic, f64::from(freedom));
                assert!(
                    (tail - sum).abs() < 1e-12 * sum.max(1e-290),
                    "{freedom} {statistic}"
                );
            }
        }
        assert_eq!(chi_square_tail(3.0, 0.0), 1.0);
        assert_eq!(chi_square_tail(0.0, 3.0), 1.0);
        assert_eq!(chi_square_tail(f64::INFINITY, 3.0), 0.0);
    }

    #[test]
    fn the_deviate_is_as_improbable_to_a_fifth() {
        for freedom in [2.0, 4.0, 8.0] {
            for deviate in [2.0, 3.0, 4.0] {
                let tail = 0.5 * libm::erfc(deviate * std::f64::consts::FRAC_1_SQRT_2);
                let (mut low, mut high) = (0.0, 200.0);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if chi_square_tail(middle, freedom) > tail {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                assert!((normal_deviate(low, freedom) - deviate).abs() < 0.2);
            }
        }
    }
}
