//! What no answer may be, whatever was asked.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector2};
use trisquare::{Calibration, Error, ErrorKind, Lens, Pose};

use crate::Outcome;

/// A rotation's columns are orthonormal to rounding.
const ROTATION_TOLERANCE: f64 = 1e-9;

/// Rounding of the eigenvalues of a correlation matrix, whose largest is at most its size: they
/// come from inverting an information matrix whose own condition may take most of the digits.
const EIGENVALUE_TOLERANCE: f64 = 1e-6;

/// Sweeps of an eigenvalue decomposition; a few per row suffice.
const MAX_SWEEPS: usize = 10_000;

/// Checks every number of a calibration, and the words of a refusal.
pub fn calibration(found: &Result<Calibration, Error>) -> Outcome {
    let found = match found {
        Ok(found) => found,
        Err(error) => return refusal(error),
    };
    assert!(found.camera.parameters().iter().all(|v| v.is_finite()));
    assert!(found.camera.valid_radius() > 0.0);
    assert!(found.rms.is_finite() && found.rms >= 0.0);
    assert!(found.noise_scale.is_finite() && found.noise_scale >= 0.0);
    assert!(found.std().iter().all(|(_, v)| v.is_finite() && *v > 0.0));
    assert_eq!(found.covariance.nrows(), found.parameters.len());
    covariance(&found.covariance);
    for plane in &found.planes {
        pose(&plane.pose);
        assert!(plane.rms.is_finite() && plane.samples > 0);
        let corners = plane.corners.iter().flat_map(|c| c.iter());
        assert!(corners.clone().all(|v| v.is_finite()), "{plane:?}");
    }
    let residual_correlation = &found.residual_correlation;
    assert!(
        residual_correlation.neighbours.is_finite()
            && residual_correlation
                .between_plane_variance_ratio
                .is_finite()
    );
    assert!((0.0..=1.0).contains(&residual_correlation.probability));
    let displacements = &residual_correlation.displacements;
    assert!(displacements.iter().all(|v| v.is_finite() && *v >= 0.0));
    assert!(residual_correlation.added.iter().all(|v| v.is_finite()));
    for warning in &found.warnings {
        spoken(&warning.to_string());
    }
    "Ok"
}

/// The uncertainty of projections: a refusal, or a finite distance.
pub fn projection(found: &Calibration, pixels: &[Vector2<f64>]) {
    match found.projection_std(pixels) {
        Ok(std) => assert!(std.iter().all(|v| v.is_finite() && *v >= 0.0), "{std:?}"),
        Err(error) => spoken(&error.to_string()),
    }
}

/// Symmetric, finite, and no direction of negative variance.
pub fn covariance(matrix: &DMatrix<f64>) {
    assert!(matrix.iter().all(|v| v.is_finite()), "{matrix}");
    if matrix.is_empty() {
        return;
    }
    let std = matrix.diagonal().map(f64::sqrt);
    let correlation = matrix.map_with_location(|i, j, v| v / std[i] / std[j]);
    assert!((&correlation - correlation.transpose()).amax() < EIGENVALUE_TOLERANCE);
    let eigen = SymmetricEigen::try_new(correlation, f64::EPSILON, MAX_SWEEPS);
    let smallest = eigen.expect("it settles").eigenvalues.min();
    assert!(smallest > -EIGENVALUE_TOLERANCE, "{smallest} of {matrix}");
}

pub fn pose(pose: &Pose) {
    assert!(pose.translation.iter().all(|v| v.is_finite()), "{pose:?}");
    let identity = pose.rotation * pose.rotation.transpose();
    assert!(
        (identity - Matrix3::identity()).norm() < ROTATION_TOLERANCE,
        "{pose:?}"
    );
    assert!(pose.rotation.determinant() > 0.0, "{pose:?}");
}

/// The kind of a refusal, whose message must say something.
pub fn refusal(error: &Error) -> Outcome {
    spoken(&error.to_string());
    match error.kind() {
        ErrorKind::InvalidArgument => "InvalidArgument",
        ErrorKind::NotEnoughPlanes => "NotEnoughPlanes",
        ErrorKind::NotEnoughData => "NotEnoughData",
        ErrorKind::DegenerateGeometry => "DegenerateGeometry",
        ErrorKind::Convergence => "Convergence",
        _ => "of another kind",
    }
}

/// A message with a NaN tells nobody anything.
pub fn spoken(message: &str) {
    assert!(!message.is_empty() && !message.contains("NaN"), "{message}");
}
