//! How well the camera is known, and the refusal of geometry that cannot answer.

use nalgebra::DMatrix;

use crate::arrow::ArrowSystem;
use crate::parameters::{FreeParameters, Options};
use crate::view::View;
use crate::{Error, ImageSize, Lens};

/// Largest standard deviation of a focal length accepted, as a part of it.
const MAX_FOCAL_STD: f64 = 0.03;

/// Largest standard deviation of the principal point accepted, as a part of the width.
const MAX_CENTRE_STD: f64 = 0.02;

/// Planes less apart than this (degrees) are called parallel when the geometry is refused.
const PARALLEL_DEGREES: f64 = 5.0;

/// Noise assumed at least (px) when geometry is judged: no photograph is measured better, and
/// exact points must not make a degenerate geometry look determined.
const JUDGED_NOISE: f64 = 0.02;

/// Standard deviation granted to a freed centre of distortion beforehand, in half image
/// diagonals: it is unobservable where there is no distortion, and then tells nothing anyway.
const CENTRE_PRIOR: f64 = 0.5;

/// The covariance of the free parameters from the normal equations at the optimum; `None` if they
/// are singular. `factor` turns the inverse of the weighted information into a covariance.
pub(crate) fn covariance(system: &ArrowSystem, factor: f64) -> Option<DMatrix<f64>> {
    if system.prior.is_empty() {
        return Some(DMatrix::zeros(0, 0));
    }
    Some(invert(&system.reduced_information()?)? * factor)
}

/// Inverts a positive definite matrix after scaling its diagonal to 1.
fn invert(information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = information.diagonal().map(|d| 1.0 / d.sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scaling = DMatrix::from_diagonal(&scale);
    let inverse = (&scaling * information * &scaling).cholesky()?.inverse();
    let covariance = &scaling * inverse * &scaling;
    covariance
        .iter()
        .all(|v| v.is_finite())
        .then_some(covariance)
}

/// What a judgement of the geometry looks at.
pub(crate) struct Geometry<'a, L> {
    pub view: &'a View<L>,
    pub size: ImageSize,
    pub options: &'a Options,
    /// Noise of a typical sample, in pixels.
    pub noise: f64,
}

impl<L: Lens> Geometry<'_, L> {
    /// Refuses geometry from which the camera matrix does not follow.
    ///
    /// `system` holds the normal equations with the centre of distortion freed from the principal
    /// point (its two columns last), so that the lens polynomial cannot vouch for the planes.
    ///
    /// # Errors
    /// [`Error::ParallelPlanes`] or [`Error::WeakGeometry`].
    pub fn judge(
        &self,
        system: &ArrowSystem,
        free: &FreeParameters,
        factor: f64,
    ) -> Result<(), Error> {
        let floor = (JUDGED_NOISE / self.noise).max(1.0).powi(2);
        let mut system = system.clone();
        let focal = self.view.lens.parameters()[0];
        let prior = CENTRE_PRIOR * self.size.half_diagonal() / focal;
        for i in free.len()..system.prior.nrows() {
            system.prior[(i, i)] += factor * floor / (prior * prior);
        }
        let covariance = covariance(&system, factor * floor);
        let parameters = self.view.lens.parameters();
        for name in ["fx", "fy", "cx", "cy"] {
            let Some(position) = free.position(name) else {
                continue;
            };
            let std = covariance
                .as_ref()
                .map_or(f64::INFINITY, |c| c[(position, position)].sqrt());
            let limit = match name {
                "fx" => MAX_FOCAL_STD * parameters[0],
                "fy" => MAX_FOCAL_STD * parameters[1],
                _ => MAX_CENTRE_STD * f64::from(self.size.width),
            };
            // Written so that NaN is refused, too.
            if !(std <= limit) {
                return Err(self.refusal(name, std, limit));
            }
        }
        Ok(())
    }

    fn refusal(&self, parameter: &'static str, std: f64, limit: f64) -> Error {
        let degrees = self.largest_angle();
        let fixed = &self.options.fixed;
        let planes = self.view.planes.len();
        if !fixed.principal_point && !fixed.focal && planes > 1 && degrees < PARALLEL_DEGREES {
            return Error::ParallelPlanes { planes, degrees };
        }
        let remedy = if !fixed.principal_point {
            "fix the principal point"
        } else if !fixed.aspect {
            "fix the aspect"
        } else {
            "fix the focal length"
        };
        Error::WeakGeometry {
            parameter,
            std: if std.is_nan() { f64::INFINITY } else { std },
            limit,
            degrees,
            remedy,
        }
    }

    /// The largest angle between two planes, in degrees.
    fn largest_angle(&self) -> f64 {
        let normals: Vec<_> = self.view.planes.iter().map(|p| p.pose.normal()).collect();
        let mut largest = 0.0f64;
        for (i, a) in normals.iter().enumerate() {
            for b in &normals[i + 1..] {
                let sine = a.cross(b).norm();
                largest = largest.max(sine.atan2(a.dot(b).abs()).to_degrees());
            }
        }
        largest
    }
}

/// Checks that there are planes enough for the free entries of the camera matrix.
///
/// Each plane direction gives two equations.
///
/// # Errors
/// [`Error::NotEnoughPlanes`].
pub(crate) fn check_plane_count(found: usize, free: &FreeParameters) -> Result<(), Error> {
    let names: Vec<&str> = free
        .names()
        .into_iter()
        .filter(|name| ["fx", "fy", "cx", "cy"].contains(name))
        .collect();
    let needed = names.len().div_ceil(2).max(1);
    if found < needed {
        return Err(Error::NotEnoughPlanes {
            found,
            needed,
            free: if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            },
        });
    }
    Ok(())
}
