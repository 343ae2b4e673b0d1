//! Test of whether a matrix is a covariance.

use nalgebra::{DMatrix, SymmetricEigen};

/// Tolerance of the correlations: covariances come from inverting information that may be
/// ill-conditioned.
const ROUNDING: f64 = 1e-6;

/// Maximum number of iterations for the eigenvalues: a valid matrix takes a few per row.
const MAX_SWEEPS: usize = 1000;

/// Whether a matrix is symmetric and positive semidefinite, to rounding.
///
/// Tested as a correlation matrix, since the parameters' units differ by many powers of ten. A
/// parameter of zero variance must have zero covariances.
#[must_use]
pub fn is_covariance(matrix: &DMatrix<f64>) -> bool {
    if !matrix.is_square() || !matrix.iter().all(|v| v.is_finite()) {
        return false;
    }
    let variances = matrix.diagonal();
    if variances.iter().any(|variance| *variance < 0.0) {
        return false;
    }
    if matrix.is_empty() {
        return true;
    }
    let std = variances.map(f64::sqrt);
    let unit = std.map(|std| if std > 0.0 { std } else { 1.0 });
    let correlation = DMatrix::from_fn(unit.len(), unit.len(), |i, j| {
        matrix[(i, j)] / unit[i] / unit[j]
    });
    let is_valid_entry = |i: usize, j: usize| {
        let (entry, transposed) = (correlation[(i, j)], correlation[(j, i)]);
        let is_known = std[i] == 0.0 || std[j] == 0.0;
        entry.abs() <= 1.0 + ROUNDING
            && (entry - transposed).abs() <= ROUNDING
            && !(is_known && entry != 0.0)
    };
    let all = 0..unit.len();
    if !all
        .clone()
        .all(|i| all.clone().all(|j| is_valid_entry(i, j)))
    {
        return false;
    }
    let symmetric = 0.5 * (&correlation + correlation.transpose());
    let eigen = SymmetricEigen::try_new(symmetric, f64::EPSILON, MAX_SWEEPS);
    eigen.is_some_and(|eigen| eigen.eigenvalues.min() >= -ROUNDING)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: [[f64; 2]; 2]) -> bool {
        is_covariance(&DMatrix::from_fn(2, 2, |i, j| rows[i][j]))
    }

    #[test]
    fn covariances_are_told_from_other_matrices() {
        assert!(of([[1e-12, 1e-6], [1e-6, 4.0]]));
        assert!(of([[1.0, 2.0], [2.0, 4.0]]));
        assert!(of([[0.0, 0.0], [0.0, 4.0]]));
        assert!(is_covariance(&DMatrix::zeros(0, 0)));
        for wrong in [
            [[1.0, 2.1], [2.1, 4.0]],
            [[1.0, 0.5], [0.4, 4.0]],
            [[-1.0, 0.0], [0.0, 4.0]],
            [[0.0, 1e-9], [1e-9, 4.0]],
            [[1.0, f64::NAN], [f64::NAN, 4.0]],
            [[1e-320, 1e300], [1e300, 1.0]],
        ] {
            assert!(!of(wrong), "{wrong:?}");
        }
        // Each pair is possible, all three together are not.
        let three = [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]];
        assert!(!is_covariance(&DMatrix::from_fn(3, 3, |i, j| three[i][j])));
    }
}
