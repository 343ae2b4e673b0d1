//! Inversion of distortions: from observed to ideal points.

use nalgebra::Vector2;

use super::plane_distortion::{PlaneDistortion, adjugate, is_finite};

/// Maximum number of Newton steps to unproject a pixel. From the observed radius they converge
/// monotonically, and seldom more than 6 are needed.
const MAX_NEWTON_STEPS: usize = 30;

/// Newton step below which the iteration ends, relative and multiplied by the slope, because
/// convergence slows down near the rim. The error left is the square of the step: rounding.
const NEWTON_STEP_TOLERANCE: f64 = 1e-8;

/// Error of an inverse, relative to the observed point, above which another Newton step is made.
const ROUNDING: f64 = 1e-14;

/// Maximum number of doublings to find an upper bound of the ratio of ideal to observed radius.
const MAX_DOUBLINGS: usize = 64;

/// Maximum number of Newton steps or bisections within a bracket; bisection alone would need 60.
const MAX_BRACKETED_STEPS: usize = 100;

/// Relative step within a bracket below which the rest is rounding.
const BRACKETED_TOLERANCE: f64 = 1e-15;

/// Largest radius at which the search in the plane starts, in valid radii: on the rim itself the
/// Jacobian is singular.
const RIM: f64 = 0.99;

/// Maximum number of halvings of a Newton step that leaves the disc or increases the error.
const MAX_HALVINGS: usize = 10;

/// Largest accepted error of an inverse, relative to the observed point. Larger errors remain
/// beyond the rim, where the shortened steps stop short of the point, and where the distortion
/// grows steeply, so that even a small step leaves a large error.
const CONVERGED: f64 = 1e-13;

/// The inverse of a `PlaneDistortion`.
pub(super) trait Inverse: PlaneDistortion {
    /// Inverts the distortion; `None` beyond the trusted radius.
    fn undistort(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let ideal = if self.is_radial() {
            self.undistort_radially(distorted)
        } else {
            self.undistort_in_plane(distorted)
        };
        ideal.filter(is_finite)
    }

    /// Applies Newton's method to the ratio of ideal to observed radius.
    ///
    /// The start is the power series of the inverse. Where the iteration fails, the ratio is
    /// bracketed.
    fn undistort_radially(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let (first, second) = self.radial_slopes(0.0);
        let square = distorted.norm_squared();
        let series = 1.0 - square * (first - square * (3.0 * first * first - 0.5 * second));
        let ratio = self
            .ideal_ratio(square, series)
            .or_else(|| self.bracketed_ratio(square))?;
        Some(distorted * ratio)
    }

    fn ideal_ratio(&self, observed_square: f64, start: f64) -> Option<f64> {
        let limit = self.trusted_radius() * self.trusted_radius();
        let mut ratio = start;
        for _ in 0..MAX_NEWTON_STEPS {
            let square = ratio * ratio * observed_square;
            // Negated, so that NaN is rejected too.
            if !(square <= limit && ratio > 0.0) {
                return None;
            }
            let (step, slope, _) = self.ratio_step(ratio, square)?;
            ratio += step;
            if step.abs() < NEWTON_STEP_TOLERANCE * ratio.min(1.0) * slope.min(1.0) {
                let square = ratio * ratio * observed_square;
                if self.is_converged(ratio, square) {
                    return (square <= limit).then_some(ratio);
                }
            }
        }
        None
    }

    /// Whether a ratio reproduces the observed radius to within the effect of the ratio's own
    /// rounding, which grows towards a pole.
    fn is_converged(&self, ratio: f64, square: f64) -> bool {
        let factor = self.radial_factor(square);
        let remainder = (1.0 - ratio * factor).abs();
        let slope = || factor + 2.0 * square * self.radial_slopes(square).0;
        remainder <= CONVERGED || remainder <= CONVERGED * ratio * slope()
    }

    /// Returns the Newton step of the ratio, the slope, and the relative difference to the observed
    /// radius; `None` where the slope is not positive.
    fn ratio_step(&self, ratio: f64, square: f64) -> Option<(f64, f64, f64)> {
        let factor = self.radial_factor(square);
        let slope = factor + 2.0 * square * self.radial_slopes(square).0;
        let remainder = 1.0 - ratio * factor;
        (slope > 0.0).then_some((remainder / slope, slope, remainder))
    }

    /// Applies Newton's method within a bracket: up to the trusted radius the observed radius
    /// increases.
    fn bracketed_ratio(&self, observed_square: f64) -> Option<f64> {
        let observed = observed_square.sqrt();
        let mut low = 0.0;
        let mut high = self.trusted_radius() / observed;
        if high.is_infinite() {
            high = 1.0;
            for _ in 0..MAX_DOUBLINGS {
                let square = high * high * observed_square;
                if high * self.radial_factor(square) >= 1.0 {
                    break;
                }
                high *= 2.0;
            }
        }
        // Negated, so that NaN is rejected too.
        if !(high * self.radial_factor(high * high * observed_square) >= 1.0) {
            return None;
        }
        let mut ratio = 0.5 * high;
        for _ in 0..MAX_BRACKETED_STEPS {
            let newton = self.ratio_step(ratio, ratio * ratio * observed_square);
            match newton {
                Some((.., remainder)) if remainder > 0.0 => low = ratio,
                _ => high = ratio,
            }
            let next = newton
                .map(|(step, ..)| ratio + step)
                .filter(|next| (low..=high).contains(next))
                .unwrap_or(0.5 * (low + high));
            let is_converged = (next - ratio).abs() < BRACKETED_TOLERANCE * next;
            ratio = next;
            if is_converged {
                break;
            }
        }
        self.is_converged(ratio, ratio * ratio * observed_square)
            .then_some(ratio)
    }

    /// Applies Newton's method to both coordinates, starting from the inverse of the radial part.
    ///
    /// Within the disc the symmetric part of the Jacobian is positive definite: the solution is
    /// unique, and each step, once shortened, reduces the error.
    fn undistort_in_plane(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let mut ideal = self.undistort_radially(distorted).unwrap_or(*distorted);
        // Starts just inside the rim where the radial part alone leads out of the disc.
        let rim = RIM * self.trusted_radius();
        // Negated, so that NaN is rejected too.
        if !(ideal.norm() <= rim) {
            ideal = distorted.try_normalize(0.0)? * rim;
        }
        let mut error = distorted - self.distort(&ideal);
        for _ in 0..MAX_NEWTON_STEPS {
            let jacobian = self.distortion_jacobian(&ideal);
            let determinant = jacobian.determinant();
            if !(determinant > 0.0) {
                return None;
            }
            let mut step = adjugate(&jacobian) * error / determinant;
            let mut next = ideal + step;
            let mut next_error = distorted - self.distort(&next);
            for _ in 0..MAX_HALVINGS {
                if next.norm() <= self.trusted_radius() && next_error.norm() <= error.norm() {
                    break;
                }
                step *= 0.5;
                next = ideal + step;
                next_error = distorted - self.distort(&next);
            }
            (ideal, error) = (next, next_error);
            if step.norm() < NEWTON_STEP_TOLERANCE * determinant.min(1.0) {
                if error.norm() > ROUNDING * distorted.norm() {
                    (ideal, error) = self.polished(distorted, ideal, error);
                }
                if error.norm() <= CONVERGED * distorted.norm() {
                    return (ideal.norm() <= self.trusted_radius()).then_some(ideal);
                }
            }
        }
        None
    }

    /// Returns the better of a point and the result of one more Newton step, with its error.
    ///
    /// Where the distortion grows steeply, a small step can leave an error that is not small.
    fn polished(
        &self,
        distorted: &Vector2<f64>,
        ideal: Vector2<f64>,
        error: Vector2<f64>,
    ) -> (Vector2<f64>, Vector2<f64>) {
        let jacobian = self.distortion_jacobian(&ideal);
        let next = ideal + adjugate(&jacobian) * error / jacobian.determinant();
        let next_error = distorted - self.distort(&next);
        if next_error.norm() < error.norm() {
            (next, next_error)
        } else {
            (ideal, error)
        }
    }
}

impl<D: PlaneDistortion> Inverse for D {}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Lens, ThinPrism};
    use super::*;

    /// Lenses of every kind, with stronger distortion than any real lens.
    const LENSES: [[f64; 5]; 9] = [
        [-0.3, 0.0, 0.0, 0.0, 0.0],
        [0.5, -0.2, 0.0, 0.0, 0.0],
        [-0.3, 0.12, 0.0, 0.0, 0.0],
        [0.4, 0.3, 0.2, 0.0, 0.0],
        [-0.28, 0.1, -0.02, 0.003, -0.002],
        [0.5, -0.2, 0.0, 0.01, 0.02],
        [0.05, 0.0, 0.0, -0.05, 0.02],
        [-1.5, -2.6, 45.0, 0.1, 0.02],
        [0.0, 0.0, 0.17, 0.0, 0.0],
    ];

    /// Coefficients `k1` to `k6`, `p1, p2`, `s1` to `s4`.
    const QUOTIENTS: [[f64; 12]; 5] = [
        [-0.1, 0.0, 0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [
            0.5, -2.6, 1.5, 0.38, -2.4, 1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ],
        [0.0, 0.0, 0.0, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [
            0.1, 0.1, 0.0, 0.5, 0.2, 0.1, 0.01, -0.02, 0.0, 0.0, 0.0, 0.0,
        ],
        [
            -0.3, 0.1, 0.0, 0.1, 0.0, 0.0, 0.003, 0.002, 0.02, -0.03, 0.01, 0.04,
        ],
    ];

    fn lens([k1, k2, k3, p1, p2]: [f64; 5]) -> Brown {
        Brown::new([1000.0, 1000.0, 0.0, 0.0, k1, k2, k3, p1, p2])
    }

    fn quotient(coefficients: [f64; 12]) -> ThinPrism {
        ThinPrism::new([1000.0, 1000.0, 0.0, 0.0], &coefficients)
    }

    fn check_inside<L: Lens + PlaneDistortion>(lens: &L) {
        // A lens without a rim is checked as far as any picture reaches.
        let radius = lens.valid_radius().min(5.0);
        for part in [0.0, 1e-9, 0.2, 0.5, 0.8, 0.95, 0.99, 0.999] {
            for degrees in (0..360).step_by(10) {
                let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                let ideal = Vector2::new(cos, sin) * (part * radius);
                let found = lens.undistort(&lens.distort(&ideal));
                let error = found.map(|found| (found - ideal).norm());
                // A billionth of a pixel.
                assert!(
                    error.is_some_and(|e| e < 1e-12),
                    "{lens:?} {ideal}: {error:?}"
                );
            }
        }
    }

    fn check_outside<L: Lens + PlaneDistortion>(lens: &L) {
        let rim = |t: f64| lens.distort(&(Vector2::new(t.cos(), t.sin()) * lens.valid_radius()));
        for degrees in (0..360).step_by(10) {
            let seen = rim(f64::from(degrees).to_radians());
            assert!(lens.undistort(&(seen * 1.001)).is_none(), "{lens:?}");
            assert!(lens.undistort(&(seen * 3.0)).is_none(), "{lens:?}");
        }
    }

    #[test]
    fn everything_within_the_valid_radius_comes_back() {
        LENSES.map(lens).iter().for_each(check_inside);
        QUOTIENTS.map(quotient).iter().for_each(check_inside);
    }

    #[test]
    fn nothing_comes_back_from_beyond_the_image_of_the_rim() {
        let has_rim = |radius: f64| radius < 5.0;
        let brown = LENSES.map(lens);
        let brown = brown.iter().filter(|lens| has_rim(lens.valid_radius()));
        brown.for_each(check_outside);
        let others = QUOTIENTS.map(quotient);
        let others = others.iter().filter(|lens| has_rim(lens.valid_radius()));
        others.for_each(check_outside);
    }
}
