//! Checks that every result must pass, whatever the arguments.

use nalgebra::{DMatrix, Matrix3, SymmetricEigen, Vector2};
use trisquare::{Calibration, Error, ErrorKind, Lens, Pose};

use crate::Outcome;

/// Tolerance on the orthonormality of a rotation's columns.
const ROTATION_TOLERANCE: f64 = 1e-9;

/// Tolerance on the eigenvalues of a correlation matrix, of which the largest is at most the size
/// of the matrix. They result from inverting an information matrix whose condition may take most of
/// the digits.
const EIGENVALUE_TOLERANCE: f64 = 1e-6;

/// Maximum number of sweeps of an eigenvalue decomposition; a few per row suffice.
const MAX_SWEEPS: usize = 10_000;

/// Checks every number of a calibration, and the messages of warnings and of a refusal.
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

/// Checks the uncertainty of projections: a refusal, or finite distances.
pub fn projection(found: &Calibration, pixels: &[Vector2<f64>]) {
    match found.projection_std(pixels) {
        Ok(std) => assert!(std.iter().all(|v| v.is_finite() && *v >= 0.0), "{std:?}"),
        Err(error) => spoken(&error.to_string()),
    }
}

/// Checks that a covariance is symmetric, finite and without a negative eigenvalue.
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

/// Returns the kind of a refusal and checks its message.
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

/// Checks that a message is neither empty nor contains a NaN.
pub fn spoken(message: &str) {
    assert!(!message.is_empty() && !message.contains("NaN"), "{message}");
}
