//! Smooth displacements of the whole picture by a lens beyond its model.
//!
//! With `q` the position of a pixel relative to the principal point, in units of the distance `R`
//! of the picture's corners, the fields are `R q |q|^(2k)`, `k` from 1 to 4, the two of a lens out
//! of centre, `R (2 x y, |q|^2 + 2 y^2)` and `R (|q|^2 + 2 x^2, 2 x y)` (A. E. Conrady, Mon. Not.
//! R. Astron. Soc. 79 (1919) 384-390), and the four of a thin prism, `R |q|^2` and `R |q|^4` along
//! either axis (J. Weng, P. Cohen & M. Herniou, IEEE PAMI 14 (1992) 965-980). Fields that the model
//! includes are excluded.

use nalgebra::Vector2;

use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::FreeParameters;

/// Number of fields.
pub(crate) const FIELDS: usize = 10;

/// The lens coefficient that corresponds to each field.
const COEFFICIENTS: [&str; FIELDS] = ["k1", "k2", "k3", "k4", "p1", "p2", "s1", "s2", "s3", "s4"];

/// Prior standard deviation of each, as a fraction of the radius at the picture's corner: three
/// times the usual size, over lenses, of a coefficient beyond the usual ones.
const DEVIATIONS: [f64; FIELDS] = [
    0.15, 0.15, 0.15, 0.15, 0.006, 0.006, 0.003, 0.0015, 0.003, 0.0015,
];

/// Prior standard deviation of an excluded field.
const EXCLUDED_DEVIATION: f64 = 1e-7;

/// The fields of a picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PictureFields {
    centre: Vector2<f64>,
    radius: f64,
}

impl PictureFields {
    /// Fields about the principal point of a lens.
    pub fn of<L: Lens>(lens: &L, size: ImageSize) -> Self {
        Self {
            centre: lens.principal_point(),
            radius: size.half_diagonal(),
        }
    }

    /// Displacement (px) of a pixel by each field along a direction.
    pub fn along(&self, pixel: &Vector2<f64>, direction: &Vector2<f64>) -> [f64; FIELDS] {
        let place = (pixel - self.centre) / self.radius;
        let (x, y, square) = (place.x, place.y, place.norm_squared());
        let along = |x, y| self.radius * direction.dot(&Vector2::new(x, y));
        let (outward, right, down) = (along(x, y), along(1.0, 0.0), along(0.0, 1.0));
        let fourth = square * square;
        [
            outward * square,
            outward * fourth,
            outward * square * fourth,
            outward * fourth * fourth,
            along(2.0 * x * y, square + 2.0 * y * y),
            along(square + 2.0 * x * x, 2.0 * x * y),
            right * square,
            right * fourth,
            down * square,
            down * fourth,
        ]
    }

    /// Prior standard deviations; nearly zero if `any` is false, and for fields whose coefficients
    /// are free: two equal columns would leave only rounding errors.
    pub fn deviations(free: &FreeParameters, any: bool) -> [f64; FIELDS] {
        std::array::from_fn(|field| match any && !is_modelled(free, field) {
            true => DEVIATIONS[field],
            false => EXCLUDED_DEVIATION,
        })
    }

    /// Number of fields that are not part of the model.
    pub fn count(free: &FreeParameters) -> f64 {
        (0..FIELDS)
            .filter(|field| !is_modelled(free, *field))
            .count() as f64
    }
}

/// Whether the coefficient of a field is free in the model.
fn is_modelled(free: &FreeParameters, field: usize) -> bool {
    free.position(COEFFICIENTS[field]).is_some()
}
