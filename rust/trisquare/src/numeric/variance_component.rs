//! Variance of values beyond their errors.

/// Number of rounds; each weights the values by the variance from the previous one.
const ROUNDS: usize = 12;

/// The most likely variance of zero-mean normal values, each with an error of known variance;
/// values are `(value, variance of its error)`. Zero if errors explain them.
///
/// Fisher's scoring (H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545-554). Used as the
/// variance of a prior, it shrinks values towards zero, the uncertain ones most (B. Efron and C.
/// Morris, J. Amer. Statist. Assoc. 68 (1973) 117-130).
pub(crate) fn variance_about_zero(values: &[(f64, f64)]) -> f64 {
    // Starting from below, a precise value that happens to be small would dominate all others.
    let squares = values.iter().map(|(value, _)| value * value);
    let mut estimate = squares.sum::<f64>() / values.len().max(1) as f64;
    for _ in 0..ROUNDS {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (value, variance) in values {
            let weight = (estimate + variance).powi(-2);
            sum += weight * (value * value - variance);
            weights += weight;
        }
        estimate = if sum > 0.0 { sum / weights } else { 0.0 };
    }
    estimate
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal quantiles, times a standard deviation.
    fn spread(std: f64, variance: f64) -> Vec<(f64, f64)> {
        let quantiles = [-1.53, -0.89, -0.49, -0.16, 0.16, 0.49, 0.89, 1.53];
        quantiles.map(|z| (std * z, variance)).into()
    }

    #[test]
    fn what_errors_explain_is_no_difference() {
        assert_eq!(variance_about_zero(&spread(1.0, 1.0)), 0.0);
        assert_eq!(variance_about_zero(&[]), 0.0);
    }

    #[test]
    fn precise_values_count_for_more() {
        let mut values = spread(2.0, 0.01);
        let alone = variance_about_zero(&values);
        assert!((alone - 3.3).abs() < 0.3, "{alone}");
        values.extend(spread(0.1, 1e4));
        assert!((variance_about_zero(&values) / alone - 1.0).abs() < 0.01);
        values.push((1e-9, 1e-6));
        assert!((variance_about_zero(&values) / alone - 1.0).abs() < 0.2);
    }
}
