//! Displacement of the samples by an improved tone curve, and by its uncertainty.

use nalgebra::Vector2;

use super::measured::Measured;
use super::span::{NoEdge, SpanEdges};
use super::tone_fit::{
    Pooled, SHARED_KURTOSIS, Shared, SharedMatrix, ToneEstimate, ToneShare, Trust, pool,
};
use crate::image::PowerCurve;

/// Moves the samples to their positions under the estimate from all pixels, and computes their
/// displacement by one standard deviation of the estimate.
pub(super) fn corrected(
    first: PowerCurve,
    measured: Vec<Result<Measured, NoEdge>>,
) -> (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate) {
    let found = || measured.iter().flatten();
    let shares = found().filter_map(|m| m.share.as_ref());
    let Pooled {
        mut step,
        covariance,
        estimate,
    } = pool(first, shares, Trust::ByMisfit);
    let common = common_shift(found(), step[SHARED_KURTOSIS]);
    // The common shift includes the effect of the kurtosis.
    step[SHARED_KURTOSIS] = 0.0;
    // Columns: one standard deviation along each of several independent directions.
    let deviations = covariance
        .cholesky()
        .map_or_else(SharedMatrix::zeros, |f| f.l());
    let mut gram = SharedMatrix::zeros();
    for measured in found() {
        for (tone_drift, std) in measured.drifts().iter().zip(&measured.edges.std) {
            let deviation = deviations.tr_mul(&tone_drift.by_shared) / *std;
            gram += deviation * deviation.transpose();
        }
    }
    // All directions move the samples in much the same way, so that only the one with the largest
    // effect is used.
    let direction = deviations * principal_axis(gram);
    let spans = measured.into_iter();
    let displaced = spans
        .map(|measured| {
            let drift = |drift: &Drift| {
                let by_shared = drift.by_shared.dot(&direction);
                by_shared.hypot(estimate.hidden_shift)
            };
            Ok(measured?.displaced(&step, common, drift))
        })
        .collect();
    (displaced, estimate)
}

/// Leaves the samples where they are, with a common displacement of all edges towards the dark of
/// this standard deviation, px.
pub(super) fn with_shift_std(
    measured: Vec<Result<Measured, NoEdge>>,
    shift_std: f64,
) -> Vec<Result<SpanEdges, NoEdge>> {
    let spans = measured.into_iter();
    spans
        .map(|measured| Ok(measured?.displaced(&Shared::zeros(), 0.0, |_| shift_std)))
        .collect()
}

/// The unit eigenvector of the largest eigenvalue.
fn principal_axis(matrix: SharedMatrix) -> Shared {
    let eigen = matrix.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
}

/// Mean over the sides of the displacement of their edges towards the dark by the kurtosis of the
/// pixels' box and of the lens, with the tone curve held.
///
/// The lens and the pixels' box are the same for all sides; a side's deviation from the mean is
/// noise, and would be an error that all of its samples share.
fn common_shift<'a>(found: impl Iterator<Item = &'a Measured>, lens_kurtosis: f64) -> f64 {
    let held_curve = Shared::new(0.0, 0.0, lens_kurtosis);
    let (mut sum, mut count) = (0.0, 0.0);
    for measured in found {
        // A line along which light and dark alternate does not move as a whole.
        if let Some(share) = measured.share.as_ref().filter(|_| !measured.is_crossed) {
            sum += share.side_step(&held_curve)[0] * measured.dark_sign();
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// Displacement of a sample along the unit normal of its side.
struct Drift {
    normal: Vector2<f64>,
    /// Derivatives of the displacement with respect to the parameters that the sides share.
    by_shared: Shared,
}

impl Measured {
    /// Sign of a displacement towards the dark along the normal, which points to the light where
    /// the contrast is positive; 0 for a crossed line. A tone curve moves all edges alike, too, to
    /// the dark or to the light.
    fn dark_sign(&self) -> f64 {
        if self.is_crossed {
            0.0
        } else {
            -self.side.contrast[0].signum()
        }
    }

    /// The displacement of each sample, with zero derivatives if the side does not determine the
    /// tone.
    fn drifts(&self) -> Vec<Drift> {
        let by_shared = self
            .share
            .as_ref()
            .map(ToneShare::drift)
            .unwrap_or_default();
        let tone_drift = |point: &Vector2<f64>| {
            let (by_coefficients, normal) = self.side.curve.displacement_derivatives(*point);
            Drift {
                normal,
                by_shared: by_shared.tr_mul(&by_coefficients),
            }
        };
        self.edges.points.iter().map(tone_drift).collect()
    }

    /// The samples, moved by a step of the shared parameters and by a common shift towards the
    /// dark, with the displacement of each by what remains unknown.
    fn displaced(
        mut self,
        step: &Shared,
        common: f64,
        unknown: impl Fn(&Drift) -> f64,
    ) -> SpanEdges {
        let dark_sign = self.dark_sign();
        let drifts = self.drifts();
        for (point, tone_drift) in self.edges.points.iter_mut().zip(&drifts) {
            *point += tone_drift.normal * (tone_drift.by_shared.dot(step) + common * dark_sign);
        }
        let displacements = drifts.iter().map(|d| d.normal * unknown(d) * dark_sign);
        self.edges.tone_drift = displacements.collect();
        self.edges
    }
}
