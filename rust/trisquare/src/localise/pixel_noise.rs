//! Residuals' scale and weights, safe from outliers.

/// Residuals up to this many standard deviations count in full, larger ones less and less. Clean
/// data lose 0.3 % to it.
const ROBUST_LIMIT: f64 = 3.0;
const ROBUST_SQUARE: f64 = ROBUST_LIMIT * ROBUST_LIMIT;
/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_082;
/// Beyond three deviations lie 0.27 % of normal residuals; without them the rms is smaller.
const TRUNCATED_RMS: f64 = 0.986_6;

/// Weight of a residual whose square, in variances, is given: the derivative of the robust cost.
#[inline]
pub(super) fn robust_weight(square: f64) -> f64 {
    if square <= ROBUST_SQUARE {
        1.0
    } else {
        ROBUST_SQUARE / square
    }
}

/// The robust cost of such a residual.
#[inline]
pub(super) fn robust_cost(square: f64) -> f64 {
    if square <= ROBUST_SQUARE {
        square
    } else {
        ROBUST_SQUARE * (1.0 + (square / ROBUST_SQUARE).ln())
    }
}

/// The standard deviation that the residuals (reordered, their signs dropped) show, not below
/// `floor`; a fit of so many `parameters` made them smaller.
pub(super) fn scale(residuals: &mut [f64], parameters: f64, floor: f64) -> f64 {
    if residuals.is_empty() {
        return floor;
    }
    for residual in residuals.iter_mut() {
        *residual = residual.abs();
    }
    let middle = residuals.len() / 2;
    let (_, median, _) = residuals.select_nth_unstable_by(middle, f64::total_cmp);
    let limit = (ROBUST_LIMIT * *median / NORMAL_MEDIAN).max(floor);
    let (mut sum, mut count) = (0.0, 0.0);
    for residual in residuals.iter().filter(|&&residual| residual <= limit) {
        sum += residual * residual;
        count += 1.0;
    }
    let freedom = (count - parameters).max(1.0);
    ((sum / freedom).sqrt() / TRUNCATED_RMS).max(floor)
}
