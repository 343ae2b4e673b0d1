//! Robust scale and weights of residuals.

/// Number of standard deviations up to which residuals have full weight; for larger ones it
/// decreases. For clean data the loss is 0.3 %.
const ROBUST_LIMIT: f64 = 3.0;
const ROBUST_SQUARE: f64 = ROBUST_LIMIT * ROBUST_LIMIT;
/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_082;
/// Rms of normal residuals, in standard deviations, without the 0.27 % beyond three of them.
const TRUNCATED_RMS: f64 = 0.986_6;

/// Weight of a residual with this square, in variances: the derivative of the robust cost.
#[inline]
pub(super) fn robust_weight(square: f64) -> f64 {
    if square <= ROBUST_SQUARE {
        1.0
    } else {
        ROBUST_SQUARE / square
    }
}

/// Robust cost of a residual with this square, in variances.
#[inline]
pub(super) fn robust_cost(square: f64) -> f64 {
    if square <= ROBUST_SQUARE {
        square
    } else {
        ROBUST_SQUARE * (1.0 + (square / ROBUST_SQUARE).ln())
    }
}

/// Standard deviation of residuals, at least `floor`, corrected for a fit with `parameters`
/// parameters. Reorders the residuals and drops their signs.
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
