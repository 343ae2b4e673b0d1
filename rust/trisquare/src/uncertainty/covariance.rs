//! Covariance of the camera's parameters.

use nalgebra::DMatrix;

use crate::error::Error;
use crate::lens::MATRIX;
use crate::numeric::ArrowSystem;
use crate::observations::{FreeParameters, ObservedPlane};

/// Returns the covariance of the free parameters from the normal equations at the optimum; `None`
/// if they are singular. `factor` turns the inverse of the weighted information into a covariance.
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

/// Checks that the planes give enough equations for the free entries of the camera matrix;
/// relations between planes give further ones.
///
/// # Errors
/// [`Error::NotEnoughPlanes`].
pub(crate) fn check_plane_equations(
    planes: &[ObservedPlane],
    free: &FreeParameters,
) -> Result<(), Error> {
    check_plane_count(planes.len(), free)?;
    let names = free_matrix_names(free);
    let equations: usize = planes.iter().map(ObservedPlane::equation_count).sum();
    let related = planes.iter().any(|plane| !plane.relations.is_empty());
    if equations >= names.len() || related {
        return Ok(());
    }
    Err(Error::NotEnoughPlanes {
        found: planes.len(),
        needed: planes.len() + names.len() - equations,
        free: format!(
            "{}; a plane of which only a right angle is known determines one of them",
            names.join(", ")
        ),
    })
}

fn free_matrix_names(free: &FreeParameters) -> Vec<&'static str> {
    let names = free.names().into_iter();
    names.filter(|name| MATRIX.contains(name)).collect()
}

/// Checks the number of planes, if each gives two equations.
///
/// # Errors
/// [`Error::NotEnoughPlanes`].
pub(crate) fn check_plane_count(found: usize, free: &FreeParameters) -> Result<(), Error> {
    let names = free_matrix_names(free);
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
