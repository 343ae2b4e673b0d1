//! Comparison of two lenses up to a rotation: the pixels of one lens in the other.
//!
//! A calibration does not determine the direction in which its camera points: a shift of the
//! principal point is nearly equivalent to a rotation of the camera. Two lenses are therefore
//! compared after the rotation that brings their projections closest (mrcal's "projection
//! difference", <https://mrcal.secretsauce.net>).

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix3x2, Rotation3, Vector2, Vector3};

use super::{Lens, ProjectionJacobian};
use crate::error::Error;

/// Maximum number of Gauss-Newton steps for the rotation; from the start that is used, 3 or 4
/// suffice.
const MAX_STEPS: usize = 20;

/// Rotation step below which the iteration ends, radians: no picture shows a smaller rotation.
const CONVERGED: f64 = 1e-12;

/// Minimum fraction of the pixels that both lenses must be able to map for a meaningful comparison.
const MIN_IN_COMMON: f64 = 0.1;

/// Solid angle of a pixel, in units of that at a pinhole's axis, above which the pixel is too near
/// the rim of a lens to be used: some thousandth of a pixel away.
const NEAR_RIM: f64 = 1e3;

/// Relative increase of the diagonal of the normal equations: it suppresses rotations that the
/// pixels do not determine.
const RIDGE: f64 = 1e-12;

/// A lens, and another one that is rotated against it.
#[derive(Debug, Clone)]
pub struct TurnedLenses<'a, A: Lens, B: Lens> {
    /// The lens whose pixels are mapped.
    pub first: &'a A,
    /// The lens that projects their directions.
    pub second: &'a B,
    /// `second_from_first`: rotates the first lens's directions into the second's.
    pub rotation: Matrix3<f64>,
}

/// The second lens's pixel for the direction of a pixel of the first lens, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenAgain {
    /// The second lens's pixel.
    pub pixel: Vector2<f64>,
    /// Derivative of the first lens's pixel of the direction with respect to the first lens's
    /// parameters.
    pub by_first: ProjectionJacobian,
    /// Derivative of the second lens's pixel of the direction with respect to the second lens's
    /// parameters.
    pub by_second: ProjectionJacobian,
    /// Derivative of the pixel with respect to the first lens's pixel.
    pub by_pixel: Matrix2<f64>,
    /// Derivative of the pixel with respect to a further rotation, a rotation vector in radians
    /// applied after the rotation.
    pub by_turn: Matrix2x3<f64>,
}

impl<'a, A: Lens, B: Lens> TurnedLenses<'a, A, B> {
    /// Finds the rotation that brings the second lens's projections of the directions seen at
    /// pixels closest to these pixels, by least squares of pixels.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if both lenses together can map less than a tenth of the pixels.
    pub fn closest(first: &'a A, second: &'a B, pixels: &[Vector2<f64>]) -> Result<Self, Error> {
        Ok(Self {
            first,
            second,
            rotation: closest_rotation((first, second), pixels)?,
        })
    }

    /// Returns the second lens's pixel for the direction of a pixel of the first; `None` where a
    /// lens cannot map it.
    pub fn see_again(&self, pixel: &Vector2<f64>) -> Option<SeenAgain> {
        match_pixel((self.first, self.second), &self.rotation, pixel)
    }
}

/// A lens of any family. Code that uses this trait object is compiled once, not for each pair of
/// families.
trait ErasedLens {
    fn project(&self, direction: &Vector3<f64>) -> Option<Vector2<f64>>;
    /// `None` where the lens is not invertible, or nearly so.
    fn unproject_with_derivatives(&self, pixel: &Vector2<f64>) -> Option<Unprojected>;
}

/// The direction that a lens sees at a pixel, with derivatives.
struct Unprojected {
    direction: Vector3<f64>,
    by_pixel: Matrix3x2<f64>,
    /// Derivative of the pixel with respect to the lens's parameters.
    pixel_by_lens: ProjectionJacobian,
    /// Derivative of the pixel with respect to the direction.
    pixel_by_direction: Matrix2x3<f64>,
}

impl<L: Lens> ErasedLens for L {
    fn project(&self, direction: &Vector3<f64>) -> Option<Vector2<f64>> {
        Lens::project(self, direction)
    }

    fn unproject_with_derivatives(&self, pixel: &Vector2<f64>) -> Option<Unprojected> {
        let pixel_ray = self.unproject_with_jacobian(pixel)?;
        let direction = self.direction(&pixel_ray);
        let by_pixel = self.direction_jacobian(&pixel_ray);
        let area = by_pixel.column(0).cross(&by_pixel.column(1));
        let [fx, fy, ..] = self.intrinsics();
        // NaN counts as near the rim.
        let is_clear_of_rim = area.dot(&direction).abs() * fx * fy < NEAR_RIM;
        is_clear_of_rim.then_some(Unprojected {
            direction,
            by_pixel,
            pixel_by_lens: self.projection_jacobian(&pixel_ray),
            pixel_by_direction: self.projection_by_direction(&pixel_ray)?,
        })
    }
}

/// See [`TurnedLenses::closest`].
fn closest_rotation(
    lenses: (&dyn ErasedLens, &dyn ErasedLens),
    pixels: &[Vector2<f64>],
) -> Result<Matrix3<f64>, Error> {
    if pixels.is_empty() {
        return Err(Error::InvalidArgument(
            "the cameras cannot be compared: no pixel is given".into(),
        ));
    }
    let mut rotation = Matrix3::identity();
    for _ in 0..MAX_STEPS {
        let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for pixel in pixels {
            if let Some(matched) = match_pixel(lenses, &rotation, pixel) {
                normal += matched.by_turn.tr_mul(&matched.by_turn);
                gradient += matched.by_turn.tr_mul(&(matched.pixel - pixel));
            }
        }
        let floor = f64::EPSILON * normal.trace() * RIDGE;
        for axis in 0..3 {
            normal[(axis, axis)] += RIDGE * normal[(axis, axis)] + floor;
        }
        let Some(factor) = normal.cholesky() else {
            break;
        };
        let step = -factor.solve(&gradient);
        rotation = Rotation3::new(step) * rotation;
        if step.norm() < CONVERGED {
            break;
        }
    }
    let is_seen = |pixel: &&Vector2<f64>| match_pixel(lenses, &rotation, pixel).is_some();
    let part = pixels.iter().filter(is_seen).count() as f64 / pixels.len() as f64;
    if part < MIN_IN_COMMON {
        return Err(Error::InvalidArgument(format!(
            "the cameras cannot be compared: both distortions can be inverted in only {:.0} % of \
             the picture",
            100.0 * part
        )));
    }
    Ok(rotation)
}

/// See [`TurnedLenses::see_again`].
///
/// The derivatives are those of the second projection with respect to the direction `d`. A change
/// of the pixel changes `d` by `R` times the change of the first lens's direction; a rotation
/// changes it by `turn x d`.
fn match_pixel(
    (first, second): (&dyn ErasedLens, &dyn ErasedLens),
    rotation: &Matrix3<f64>,
    pixel: &Vector2<f64>,
) -> Option<SeenAgain> {
    let first_ray = first.unproject_with_derivatives(pixel)?;
    let direction = rotation * first_ray.direction;
    let seen = second.project(&direction)?;
    let second_ray = second.unproject_with_derivatives(&seen)?;
    // The derivative is inversely proportional to the length of the direction.
    let length = second_ray.direction.norm() / direction.norm();
    let by_direction = second_ray.pixel_by_direction * length;
    Some(SeenAgain {
        pixel: seen,
        by_first: first_ray.pixel_by_lens,
        by_second: second_ray.pixel_by_lens,
        by_pixel: by_direction * rotation * first_ray.by_pixel,
        by_turn: -by_direction * direction.cross_matrix(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye};
    use super::*;

    fn lenses() -> [Brown; 2] {
        [
            [500.0, 505.0, 320.0, 240.0, -0.25, 0.08, -0.01, 2e-3, -1e-3],
            [510.0, 508.0, 325.0, 236.0, -0.2, 0.05, 0.0, 0.0, 1e-3],
        ]
        .map(Brown::new)
    }

    fn pixels() -> Vec<Vector2<f64>> {
        (0..300)
            .map(|i| Vector2::new(f64::from(i % 20) * 33.0, f64::from(i / 20) * 33.0))
            .collect()
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        let [first, second] = lenses();
        let wide = Fisheye::new([400.0, 404.0, 318.0, 242.0, 0.03, -0.01, 2e-3, 1e-4]);
        check_derivatives(&first, &second);
        check_derivatives(&first, &wide);
        check_derivatives(&wide, &second);
        check_derivatives(&wide, &wide);
        check_derivatives(&first.with_skew(10.0), &wide.with_skew(-8.0));
    }

    fn check_derivatives<A: Lens, B: Lens>(first: &A, second: &B) {
        let rotation = *Rotation3::new(Vector3::new(0.01, -0.02, 0.03)).matrix();
        let turned = TurnedLenses {
            first,
            second,
            rotation,
        };
        let pixel = Vector2::new(100.0, 400.0);
        let matched = turned.see_again(&pixel).unwrap();
        let seen = |pixel: Vector2<f64>| turned.see_again(&pixel).unwrap().pixel;
        for axis in 0..2 {
            let step = Vector2::ith(axis, 1e-3);
            let numeric = (seen(pixel + step) - seen(pixel - step)) / 2e-3;
            assert!((numeric - matched.by_pixel.column(axis)).norm() < 1e-8);
        }
        for axis in 0..3 {
            let by = |turn: f64| {
                let turn = Rotation3::new(Vector3::ith(axis, turn));
                let turned = TurnedLenses {
                    rotation: turn * rotation,
                    ..turned.clone()
                };
                turned.see_again(&pixel).unwrap().pixel
            };
            let numeric = (by(1e-6) - by(-1e-6)) / 2e-6;
            assert!((numeric - matched.by_turn.column(axis)).norm() < 1e-4);
        }
    }

    #[test]
    fn a_turn_is_found_again_and_the_gradient_vanishes_at_the_closest() {
        let [first, second] = lenses();
        let same = TurnedLenses::closest(&first, &first, &pixels()).unwrap();
        assert!((same.rotation - Matrix3::identity()).norm() < 1e-12);
        let turned = TurnedLenses::closest(&first, &second, &pixels()).unwrap();
        let pull: Vector3<f64> = pixels()
            .iter()
            .map(|pixel| (pixel, turned.see_again(pixel).unwrap()))
            .map(|(pixel, matched)| matched.by_turn.tr_mul(&(matched.pixel - pixel)))
            .sum();
        assert!(pull.norm() < 1e-4, "{pull}"); // in pixels times focal lengths
        assert!((turned.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn lenses_with_little_in_common_are_refused() {
        let [first, second] = lenses();
        let narrow = second.within(0.05);
        assert!(TurnedLenses::closest(&first, &narrow, &pixels()).is_err());
        assert!(TurnedLenses::closest(&first, &second, &[]).is_err());
    }
}
