//! A camera's maps for many points at once, with an error for points that the lens cannot map.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{SVector, Vector2, Vector3};

use super::Lens;
use crate::error::Error;

/// Maps of many points, for every lens; an extension trait that must be brought into scope.
///
/// A coordinate that is NaN or infinite is [`Error::NotFinite`], and no map returns one. For single
/// points there are [`Lens::project`] and [`Lens::unproject`].
///
/// ```
/// use nalgebra::Vector3;
/// use trisquare::{Brown, PointMaps};
///
/// let camera = Brown::new([900.0, 900.0, 639.5, 479.5, -0.1, 0.0, 0.0, 0.0, 0.0]);
/// let pixels = camera.project_points(&[Vector3::new(0.3, -0.2, 2.0)])?;
/// let rays = camera.unproject_pixels(&pixels)?;
/// assert!((rays[0] - Vector3::new(0.3, -0.2, 2.0).normalize()).norm() < 1e-9);
/// # Ok::<(), trisquare::Error>(())
/// ```
pub trait PointMaps: Lens {
    /// Projects points in camera coordinates to pixels.
    ///
    /// # Errors
    /// [`Error::BehindCamera`], or [`Error::BeyondValidRadius`] for points seen farther from the
    /// axis than the lens is trusted.
    fn project_points(&self, points: &[Vector3<f64>]) -> Result<Vec<Vector2<f64>>, Error> {
        check_finite(points)?;
        let sees_behind = self.valid_angle() > FRAC_PI_2;
        let behind = |point: &&Vector3<f64>| !(sees_behind || point.z > 0.0);
        if let Some(first) = points.iter().position(|point| behind(&point)) {
            let count = points.iter().filter(behind).count();
            return Err(Error::BehindCamera { count, first });
        }
        of_all(self, points, |point| self.project(point))
    }

    /// Returns the unit rays along which pixels look.
    ///
    /// # Errors
    /// [`Error::BeyondValidRadius`] where the distortion is not invertible.
    fn unproject_pixels(&self, pixels: &[Vector2<f64>]) -> Result<Vec<Vector3<f64>>, Error> {
        of_all(self, pixels, |pixel| self.unproject(pixel))
    }

    /// Maps the pixels of a pinhole with the same camera matrix to pixels of the lens.
    ///
    /// # Errors
    /// [`Error::BeyondValidRadius`] where the distortion is not monotonic.
    fn distort_pixels(&self, ideal: &[Vector2<f64>]) -> Result<Vec<Vector2<f64>>, Error> {
        of_all(self, ideal, |pixel| {
            self.project(&self.normalised(pixel).push(1.0))
        })
    }

    /// Maps pixels of the lens to the pixels of a pinhole with the same camera matrix.
    ///
    /// # Errors
    /// [`Error::BeyondValidRadius`] where the distortion is not invertible, or a pixel looks beside
    /// or behind the camera, as no pinhole's does.
    fn undistort_pixels(&self, observed: &[Vector2<f64>]) -> Result<Vec<Vector2<f64>>, Error> {
        of_all(self, observed, |pixel| {
            let ideal = self.pixel_of(&self.ideal_point(pixel)?);
            Some(ideal).filter(|p| p.norm().is_finite())
        })
    }

    /// Returns the normalised point `(x, y)` at which a pinhole sees the direction of a pixel;
    /// `None` where the distortion is not invertible, or the pixel looks beside or behind the
    /// camera.
    fn ideal_point(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        let direction = self.direction(&self.unproject_with_jacobian(pixel)?);
        (direction.z > 0.0).then(|| direction.xy() / direction.z)
    }

    /// The normalised point of a pinhole's pixel.
    fn normalised(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        self.inverse_focal_matrix() * (pixel - self.principal_point())
    }

    /// The pixel of a pinhole for a normalised point.
    fn pixel_of(&self, point: &Vector2<f64>) -> Vector2<f64> {
        self.focal_matrix() * point + self.principal_point()
    }
}

impl<L: Lens> PointMaps for L {}

/// # Errors
/// [`Error::NotFinite`] if a coordinate is NaN or infinite.
fn check_finite<const D: usize>(points: &[SVector<f64, D>]) -> Result<(), Error> {
    match points.iter().flatten().all(|v| v.is_finite()) {
        true => Ok(()),
        false => Err(Error::NotFinite {
            what: "the coordinates of the points",
        }),
    }
}

/// Maps many points.
///
/// # Errors
/// [`Error::NotFinite`] for a point, or for the lens if a point has no image; otherwise
/// [`Error::BeyondValidRadius`] with the index of the first point without an image, and their
/// number.
pub(crate) fn of_all<L: Lens, const D: usize, Q>(
    lens: &L,
    points: &[SVector<f64, D>],
    map: impl Fn(&SVector<f64, D>) -> Option<Q>,
) -> Result<Vec<Q>, Error> {
    check_finite(points)?;
    let mut found = Vec::with_capacity(points.len());
    found.extend(points.iter().map_while(&map));
    if found.len() == points.len() {
        return Ok(found);
    }
    if !lens.parameters().iter().all(|value| value.is_finite()) {
        return Err(Error::NotFinite {
            what: "the parameters of the lens",
        });
    }
    let first = found.len();
    let others = &points[first + 1..];
    Err(Error::BeyondValidRadius {
        count: 1 + others.iter().filter(|point| map(point).is_none()).count(),
        first,
        radius: lens.valid_radius(),
        degrees: lens.valid_angle().to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye, Rational, ThinPrism};
    use super::*;

    fn lens() -> Brown {
        Brown::new([900.0, 910.0, 640.0, 470.0, -0.3, 0.08, -0.01, 0.002, -0.001])
    }

    #[test]
    fn maps_are_each_others_inverse() {
        let lens = lens();
        let pixels: Vec<_> = (0..50)
            .map(|i| Vector2::new(f64::from(i) * 25.0, f64::from(i * 37 % 50) * 19.0))
            .collect();
        let rays = lens.unproject_pixels(&pixels).unwrap();
        let ideal = lens.undistort_pixels(&pixels).unwrap();
        let seen = lens.project_points(&rays).unwrap();
        let bent = lens.distort_pixels(&ideal).unwrap();
        for i in 0..pixels.len() {
            assert!((rays[i].norm() - 1.0).abs() < 1e-15);
            assert!((seen[i] - pixels[i]).norm() < 1e-9);
            assert!((bent[i] - pixels[i]).norm() < 1e-9);
        }
    }

    #[test]
    fn points_that_cannot_be_seen_are_counted() {
        let lens = lens();
        let ahead = Vector3::new(0.1, 0.2, 2.0);
        let aside = Vector3::new(3.0, 0.0, 1.0);
        let behind = Vector3::new(0.1, 0.2, -2.0);
        assert_eq!(
            lens.project_points(&[ahead, behind, aside, behind]),
            Err(Error::BehindCamera { count: 2, first: 1 })
        );
        let radius = lens.valid_radius();
        let degrees = lens.valid_angle().to_degrees();
        assert_eq!(
            lens.project_points(&[ahead, ahead, aside]),
            Err(Error::BeyondValidRadius {
                count: 1,
                first: 2,
                radius,
                degrees
            })
        );
    }

    fn refuses_what_is_not_finite<L: Lens>(lens: &L) {
        let is_refused = |found: Result<Vec<Vector2<f64>>, Error>| {
            assert!(matches!(found, Err(Error::NotFinite { .. })), "{found:?}");
        };
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for other in [Vector2::new(value, 300.0), Vector2::new(300.0, value)] {
                let pixels = [Vector2::new(600.0, 400.0), other];
                is_refused(lens.undistort_pixels(&pixels));
                is_refused(lens.distort_pixels(&pixels));
                let rays = lens.unproject_pixels(&pixels);
                assert!(matches!(rays, Err(Error::NotFinite { .. })), "{rays:?}");
            }
            for i in 0..3 {
                let mut other = Vector3::new(0.1, 0.2, 1.0);
                other[i] = value;
                is_refused(lens.project_points(&[Vector3::z(), other]));
            }
        }
    }

    #[test]
    fn a_lens_that_is_not_finite_is_refused() {
        let mut parameters = lens().parameters();
        parameters[1] = f64::NAN;
        let found = lens().with_parameters(&parameters);
        let found = found.project_points(&[Vector3::new(0.1, 0.2, 1.0)]);
        let what = "the parameters of the lens";
        assert_eq!(found, Err(Error::NotFinite { what }));
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        let intrinsics = [900.0, 910.0, 640.0, 470.0];
        refuses_what_is_not_finite(&lens());
        refuses_what_is_not_finite(&Brown::from_camera_matrix(&lens().camera_matrix()));
        refuses_what_is_not_finite(&Fisheye::new([
            900.0, 910.0, 640.0, 470.0, 0.01, 0.0, 0.0, 0.0,
        ]));
        refuses_what_is_not_finite(&Rational::new(intrinsics, &[]));
        refuses_what_is_not_finite(&ThinPrism::new(intrinsics, &[0.1, 0.0, 0.0, 0.2]));
    }

    #[test]
    fn every_pixel_within_the_valid_pixel_radius_comes_back() {
        for lens in [
            lens(),
            Brown::new([900.0, 910.0, 640.0, 470.0, -0.3, 0.0, 0.0, 0.0, 0.0]),
        ] {
            let reach = lens.valid_pixel_radius();
            let around = |part: f64| {
                (0..72).map(move |i| {
                    let (sin, cos) = f64::from(5 * i).to_radians().sin_cos();
                    lens.principal_point() + Vector2::new(cos, sin) * (part * reach)
                })
            };
            let inside: Vec<_> = around(0.999).collect();
            assert!(lens.undistort_pixels(&inside).is_ok());
            let outside: Vec<_> = around(1.05).collect();
            assert!(lens.undistort_pixels(&outside).is_err());
        }
    }
}
