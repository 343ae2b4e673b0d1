//! A straight line in a plane, and the straight line that fits points best.

use nalgebra::{Matrix3, SymmetricEigen, Vector2, Vector3};

use crate::error::Error;

/// Maximum number of sweeps of an eigendecomposition; it needs a few.
const MAX_SWEEPS: usize = 100;

/// Minimum number of distinct points for a line.
pub const MIN_LINE_SAMPLES: usize = 2;

/// A line `a x + b y + c = 0` with `a^2 + b^2 = 1`, so that the left side is a signed distance.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Line {
    coefficients: Vector3<f64>,
}

#[cfg(feature = "serde")]
crate::stored::read_checked!(Line {
    coefficients: Vector3<f64>,
});

impl Line {
    /// Checks that the normal is a unit vector.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for coefficients that [`Self::new`] cannot produce.
    #[cfg(feature = "serde")]
    fn check(&self) -> Result<(), Error> {
        let [a, b, c] = self.coefficients.into();
        // Written so that NaN is refused, too.
        if !((a.hypot(b) - 1.0).abs() < crate::stored::CUT_DIGITS && c.is_finite()) {
            return Err(Error::InvalidArgument(format!(
                "the coefficients of a line, [{a}, {b}, {c}], must be finite and have a unit normal, \
                 a^2 + b^2 = 1"
            )));
        }
        Ok(())
    }

    /// Normalises `(a, b, c)` to a unit normal.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for NaN or infinity, [`Error::InvalidArgument`] for the line at
    /// infinity (`a = b = 0`, or nearly so).
    pub fn new(a: f64, b: f64, c: f64) -> Result<Self, Error> {
        let norm = a.hypot(b);
        if !(norm.is_finite() && c.is_finite()) {
            return Err(Error::NotFinite { what: "a line" });
        }
        let coefficients = Vector3::new(a, b, c) / norm;
        if !coefficients.iter().all(|value| value.is_finite()) {
            return Err(Error::InvalidArgument(
                "a line needs a normal: a and b are both zero, or nearly so".into(),
            ));
        }
        Ok(Self { coefficients })
    }

    /// The line through `point` with the given unit normal.
    pub(crate) fn with_unit_normal(normal: Vector2<f64>, point: Vector2<f64>) -> Self {
        Self {
            coefficients: Vector3::new(normal.x, normal.y, -normal.dot(&point)),
        }
    }

    /// The coefficients `(a, b, c)`.
    pub fn coefficients(&self) -> Vector3<f64> {
        self.coefficients
    }

    /// The unit normal `(a, b)`.
    pub fn normal(&self) -> Vector2<f64> {
        self.coefficients.xy()
    }

    /// The same line with the opposite normal.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self {
            coefficients: -self.coefficients,
        }
    }

    /// The image of the line under the map that multiplies all X coordinates by `factor`.
    pub(crate) fn stretched(&self, factor: f64) -> Self {
        let [x, y, z] = self.coefficients.into();
        let coefficients = Vector3::new(x / factor, y, z);
        Self {
            coefficients: coefficients / coefficients.xy().norm(),
        }
    }

    /// The image of the line under the shear that adds `shear` times Y to all X coordinates.
    pub(crate) fn sheared(&self, shear: f64) -> Self {
        let [x, y, z] = self.coefficients.into();
        let coefficients = Vector3::new(x, y - shear * x, z);
        Self {
            coefficients: coefficients / coefficients.xy().norm(),
        }
    }

    /// Signed distance of a point, positive on the side the normal points to.
    pub fn distance(&self, point: &Vector2<f64>) -> f64 {
        self.normal().dot(point) + self.coefficients.z
    }

    /// The intersection with another line; `None` if they are parallel.
    pub fn intersection(&self, other: &Line) -> Option<Vector2<f64>> {
        let point = self.coefficients.cross(&other.coefficients);
        let intersection = point.xy() / point.z;
        (intersection.x.is_finite() && intersection.y.is_finite()).then_some(intersection)
    }

    /// The line that minimises the weighted sum of squared distances (total least squares).
    ///
    /// The normal is the eigenvector of the smaller eigenvalue of the 2 x 2 scatter matrix, in
    /// closed form. `None` for fewer than two distinct points.
    pub fn fit(samples: impl Iterator<Item = (Vector2<f64>, f64)> + Clone) -> Option<Self> {
        let (mut total, mut mean) = (0.0, Vector2::zeros());
        for (point, weight) in samples.clone() {
            total += weight;
            mean += point * weight;
        }
        mean /= total;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (point, weight) in samples {
            let offset = point - mean;
            xx += weight * offset.x * offset.x;
            xy += weight * offset.x * offset.y;
            yy += weight * offset.y * offset.y;
        }
        if !(xx + yy > 0.0 && mean.x.is_finite() && mean.y.is_finite()) {
            return None;
        }
        // The direction of the larger eigenvalue makes the angle atan2(2 xy, xx - yy) / 2.
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let normal = Vector2::new(-angle.sin(), angle.cos());
        Some(Self::with_unit_normal(normal, mean))
    }
}

/// The normal of the plane through the camera's centre that fits weighted unit rays best. That
/// plane is the line of their image, for rays at any angle from the axis.
///
/// `None` if the iteration does not converge.
pub(crate) fn line_of_rays(
    rays: impl Iterator<Item = (Vector3<f64>, f64)>,
) -> Option<Vector3<f64>> {
    let scatter: Matrix3<f64> = rays
        .map(|(ray, weight)| ray * ray.transpose() * weight)
        .sum();
    let axes = SymmetricEigen::try_new(scatter, f64::EPSILON, MAX_SWEEPS)?;
    Some(axes.eigenvectors.column(axes.eigenvalues.imin()).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_are_a_distance() {
        let line = Line::new(3.0, 4.0, -5.0).unwrap();
        assert!((line.distance(&Vector2::new(3.0, 4.0)) - 4.0).abs() < 1e-15);
        assert!(Line::new(0.0, 0.0, 1.0).is_err());
        assert!(Line::new(f64::NAN, 1.0, 1.0).is_err());
        assert!(Line::new(1e-320, 0.0, 1.0).is_err());
    }

    #[test]
    fn fit_recovers_lines_of_any_direction() {
        for degrees in (0..180).step_by(7) {
            let angle = f64::from(degrees).to_radians();
            let (direction, normal) = (
                Vector2::new(angle.cos(), angle.sin()),
                Vector2::new(-angle.sin(), angle.cos()),
            );
            let points = (0..9).map(|i| (direction * f64::from(i) + normal * 3.0, 1.0));
            let line = Line::fit(points.clone()).unwrap();
            for (point, _) in points {
                assert!(line.distance(&point).abs() < 1e-14);
            }
        }
        let same = std::iter::repeat_n((Vector2::new(1.0, 2.0), 1.0), 5);
        assert!(Line::fit(same).is_none());
    }
}
