//! Robust losses, which limit the effect of outliers such as a hand, a glare or torn paper.

/// Median absolute deviation of the normal distribution, inverted.
const MAD_TO_STD: f64 = 1.482_602_218_505_602;

/// Loss as a function of a residual in units of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Loss {
    /// Huber's at 2.01: 99 % efficient on normal noise, convex, for the approach to the optimum (P.
    /// J. Huber, Ann. Math. Statist. 35 (1964) 73-101).
    Huber,
    /// Tukey's biweight at 7.04: 99 % efficient, with zero weight for gross outliers (A. E. Beaton
    /// & J. W. Tukey, Technometrics 16 (1974) 147-185).
    Tukey,
    /// Tukey's biweight at 10: 99.75 % efficient, for pixels, so many of which are inliers that the
    /// last per cent of efficiency matters more than outliers between 7 and 10.
    WideTukey,
}

const HUBER_LIMIT: f64 = 2.01;
const TUKEY_LIMIT: f64 = 7.041;
const WIDE_TUKEY_LIMIT: f64 = 10.0;

impl Loss {
    /// Residual at which the loss ceases to be quadratic, or to grow.
    fn limit(self) -> f64 {
        match self {
            Loss::Huber => HUBER_LIMIT,
            Loss::Tukey => TUKEY_LIMIT,
            Loss::WideTukey => WIDE_TUKEY_LIMIT,
        }
    }

    /// Inverse square of the limit, needed for every residual.
    #[inline]
    fn inverse_square_limit(self) -> f64 {
        match self {
            Loss::Huber => const { 1.0 / (HUBER_LIMIT * HUBER_LIMIT) },
            Loss::Tukey => const { 1.0 / (TUKEY_LIMIT * TUKEY_LIMIT) },
            Loss::WideTukey => const { 1.0 / (WIDE_TUKEY_LIMIT * WIDE_TUKEY_LIMIT) },
        }
    }

    /// `(rho, psi(x) / x)` with `rho ~ x^2 / 2` near zero.
    #[inline]
    pub fn cost_and_weight(self, x: f64) -> (f64, f64) {
        let (size, limit) = (x.abs(), self.limit());
        match self {
            Loss::Huber if size <= limit => (0.5 * x * x, 1.0),
            Loss::Huber => (limit * (size - 0.5 * limit), limit / size),
            // Branchless, so that several residuals are weighted at a time.
            Loss::Tukey | Loss::WideTukey => {
                let inside = f64::max(1.0 - x * x * self.inverse_square_limit(), 0.0);
                let full = limit * limit / 6.0;
                (full * (1.0 - inside * inside * inside), inside * inside)
            }
        }
    }

    /// `psi'(x)`.
    pub fn slope(self, x: f64) -> f64 {
        if self == Loss::Huber {
            return f64::from(x.abs() <= HUBER_LIMIT);
        }
        let square = x * x * self.inverse_square_limit();
        if square < 1.0 {
            (1.0 - square) * (1.0 - 5.0 * square)
        } else {
            0.0
        }
    }

    /// Ratio of Newton's step to a reweighted Gauss-Newton step on normal noise: the mean of
    /// `psi(x) / x` over that of `psi'(x)`.
    pub fn newton_factor(self) -> f64 {
        let mean_slope = match self {
            Loss::Huber => 0.955_6, // P(|x| < 2.01)
            _ => {
                let square = self.limit() * self.limit();
                1.0 - 6.0 / square + 15.0 / (square * square)
            }
        };
        self.mean_weight() / mean_slope
    }

    /// The mean of `psi(x) / x` over standard normal residuals.
    pub fn mean_weight(self) -> f64 {
        match self {
            // 1 - P(|x| > k) + k E[1/|x|; |x| > k], integrated numerically.
            Loss::Huber => 0.993_7,
            // 1 - 2/c^2 + 3/c^4, the tail beyond c being below 1e-11.
            _ => {
                let square = self.limit() * self.limit();
                1.0 - 2.0 / square + 3.0 / (square * square)
            }
        }
    }
}

/// The median; of an even number of values, the mean of the two in the middle.
pub(crate) fn median(mut values: Vec<f64>) -> Option<f64> {
    let upper = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let is_odd = values.len() % 2 == 1;
    let (below, median, _) = values.select_nth_unstable_by(upper, f64::total_cmp);
    if is_odd {
        return Some(*median);
    }
    let lower = below.iter().copied().max_by(f64::total_cmp)?;
    Some(0.5 * (lower + *median))
}

/// The median; of an even number of values, the larger of the two in the middle: always one of the
/// values.
pub(crate) fn upper_median(mut values: Vec<f64>) -> Option<f64> {
    let upper = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(upper, f64::total_cmp).1)
}

/// Standard deviation of the bulk of zero-mean residuals, from the median of their absolute values.
pub(crate) fn median_scale(residuals: impl Iterator<Item = f64>) -> f64 {
    MAD_TO_STD * upper_median(residuals.map(f64::abs).collect()).unwrap_or(0.0)
}

/// Sums over residuals that determine the spread of an M-estimator.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ResidualSpread {
    count: f64,
    squares: f64,
    slopes: f64,
    weights: f64,
}

impl ResidualSpread {
    /// Adds a residual, with its weight by the loss.
    #[inline]
    pub fn add(&mut self, loss: Loss, x: f64, weight: f64) {
        self.count += 1.0;
        self.squares += (weight * x).powi(2);
        self.slopes += loss.slope(x);
        self.weights += weight;
    }

    /// Adds the sums of another spread.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.squares += other.squares;
        self.slopes += other.slopes;
        self.weights += other.weights;
    }

    /// The factor from the inverse of the weighted information `sum w J^T J` to a covariance:
    /// `(sum psi^2 / sum psi') (sum w / sum psi')`, for `unknowns` fitted parameters (Huber &
    /// Ronchetti, Robust Statistics, 2nd ed., section 7.6).
    pub fn covariance_factor(&self, unknowns: f64) -> f64 {
        let freedom = (self.count - unknowns).max(1.0);
        self.squares / self.slopes * self.weights / self.slopes * self.count / freedom
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_slopes_of_the_loss() {
        for loss in [Loss::Huber, Loss::Tukey, Loss::WideTukey] {
            for i in -120..=120 {
                let x = f64::from(i) * 0.1 + 0.003;
                let rho = |x: f64| loss.cost_and_weight(x).0;
                let psi = |x: f64| loss.cost_and_weight(x).1 * x;
                let h = 1e-6;
                assert!(((rho(x + h) - rho(x - h)) / (2.0 * h) - psi(x)).abs() < 1e-7);
                assert!(((psi(x + h) - psi(x - h)) / (2.0 * h) - loss.slope(x)).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn losses_are_as_efficient_as_said_and_their_mean_weights_right() {
        for (loss, said) in [
            (Loss::Huber, 0.99),
            (Loss::Tukey, 0.99),
            (Loss::WideTukey, 0.9975),
        ] {
            let mut spread = ResidualSpread::default();
            let (mut square, mut slope, mut mean, mut total) = (0.0, 0.0, 0.0, 0.0);
            for i in -80_000..=80_000 {
                let x = f64::from(i) * 1e-4;
                let density = (-0.5 * x * x).exp();
                let (_, weight) = loss.cost_and_weight(x);
                square += density * (weight * x).powi(2);
                slope += density * loss.slope(x);
                mean += density * weight;
                total += density;
                if i % 80_000 == 0 {
                    spread.add(loss, x, loss.cost_and_weight(x).1);
                }
            }
            let efficiency = slope * slope / (square * total);
            assert!((efficiency - said).abs() < 1e-3, "{loss:?} {efficiency}");
            assert!(
                (mean / total - loss.mean_weight()).abs() < 1e-3,
                "{}",
                mean / total
            );
            let newton = mean / slope;
            assert!((newton - loss.newton_factor()).abs() < 1e-3, "{newton}");
            assert!(spread.covariance_factor(0.0).is_finite());
        }
    }

    #[test]
    fn the_median_is_in_the_middle() {
        assert_eq!(median(vec![3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![3.0, -1.0, 2.0, 7.0]), Some(2.5));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn median_scale_ignores_a_minority() {
        let residuals = (0..101).map(|i| {
            if i < 60 {
                f64::from(i - 30) / 30.0
            } else {
                1e6
            }
        });
        assert!(median_scale(residuals) < 2.0);
        assert_eq!(median_scale(std::iter::empty()), 0.0);
    }
}
