//! Projections of undistorted pictures: through a pinhole, on a cylinder, or on a sphere.

use nalgebra::{Vector2, Vector3};

use super::Lens;

/// The surface about the camera's centre onto which a picture is projected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// A plane: straight lines stay straight, and less than 180 degrees are seen.
    Plane,
    /// A cylinder about the camera's Y axis: `(longitude, tan(latitude))`. Lines along Y stay
    /// straight.
    Cylinder,
    /// A sphere: `(longitude, latitude)`, as on a plate carree map.
    Sphere,
}

/// The view of an undistorted picture: a surface, and its mapping to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureView {
    /// The surface onto which the picture is projected.
    pub surface: Surface,
    /// Pixels per unit of the surface's coordinates; for angles, per radian.
    pub focal: Vector2<f64>,
    /// The pixel of the camera's axis.
    pub centre: Vector2<f64>,
}

impl PictureView {
    /// Returns the view of a pinhole with a lens's focal lengths and principal point, without skew.
    pub fn pinhole(lens: &impl Lens) -> Self {
        Self {
            surface: Surface::Plane,
            focal: lens.focal(),
            centre: lens.principal_point(),
        }
    }

    /// The surface's coordinates of a pixel.
    pub(super) fn normalised(&self, pixel: &Vector2<f64>) -> Vector2<f64> {
        (pixel - self.centre).component_div(&self.focal)
    }

    /// The pixel of a place on the surface.
    pub(super) fn pixel_of(&self, place: &Vector2<f64>) -> Vector2<f64> {
        place.component_mul(&self.focal) + self.centre
    }

    /// The direction that a pixel shows, of any length.
    pub fn direction(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let place = self.normalised(pixel);
        match self.surface {
            Surface::Plane => place.push(1.0),
            Surface::Cylinder => Vector3::new(place.x.sin(), place.y, place.x.cos()),
            Surface::Sphere => {
                let across = place.y.cos();
                Vector3::new(
                    across * place.x.sin(),
                    place.y.sin(),
                    across * place.x.cos(),
                )
            }
        }
    }

    /// The pixel that shows a direction; `None` where there is none.
    pub fn pixel(&self, direction: &Vector3<f64>) -> Option<Vector2<f64>> {
        let across = direction.x.hypot(direction.z);
        let longitude = direction.x.atan2(direction.z);
        let place = match self.surface {
            Surface::Plane if direction.z > 0.0 => direction.xy() / direction.z,
            Surface::Plane => return None,
            Surface::Cylinder => Vector2::new(longitude, direction.y / across),
            Surface::Sphere => Vector2::new(longitude, direction.y.atan2(across)),
        };
        let pixel = self.pixel_of(&place);
        (pixel.x.is_finite() && pixel.y.is_finite()).then_some(pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_and_directions_are_each_other_s_inverse() {
        for surface in [Surface::Plane, Surface::Cylinder, Surface::Sphere] {
            let view = PictureView {
                surface,
                focal: Vector2::new(100.0, 90.0),
                centre: Vector2::new(160.0, 120.0),
            };
            for pixel in [(0.0, 0.0), (310.0, 20.0), (160.0, 239.0), (299.5, 120.0)] {
                let pixel = Vector2::new(pixel.0, pixel.1);
                let direction = view.direction(&pixel) * 7.0;
                assert!((view.pixel(&direction).unwrap() - pixel).norm() < 1e-10);
            }
            let ahead = view.direction(&view.centre);
            assert!((ahead.normalize() - Vector3::z()).norm() < 1e-15);
        }
    }

    #[test]
    fn what_no_pixel_shows_has_none() {
        let view = |surface| PictureView {
            surface,
            focal: Vector2::repeat(100.0),
            centre: Vector2::zeros(),
        };
        assert_eq!(
            view(Surface::Plane).pixel(&Vector3::new(1.0, 0.0, -0.1)),
            None
        );
        assert_eq!(view(Surface::Cylinder).pixel(&Vector3::y()), None);
        assert!(
            view(Surface::Sphere)
                .pixel(&Vector3::new(1.0, 0.5, -1.0))
                .is_some()
        );
    }
}
