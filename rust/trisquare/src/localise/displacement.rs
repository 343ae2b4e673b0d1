//! Samples, moved to where a better tone curve sees them.

use nalgebra::Vector2;

use super::measured::Measured;
use super::span::{NoEdge, SpanEdges};
use super::tone_fit::{
    KURTOSIS_OF_SHARED, Pooled, Shared, SharedMatrix, ToneEstimate, ToneShare, Trust, pool,
};
use crate::image::PowerCurve;

/// Moves the samples to where the estimate from all pixels sees them, and tells how far one
/// standard deviation of it displaces them.
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
    let common = common_shift(found(), step[KURTOSIS_OF_SHARED]);
    // The common shift has what the kurtosis does.
    step[KURTOSIS_OF_SHARED] = 0.0;
    // One standard deviation in each of some independent directions.
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
    // All move the samples much alike: the direction that moves them most stands for all.
    let direction = deviations * first_axis(gram);
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

/// The samples where they are, with one common distance that all edges may lie off towards the
/// dark: of this standard deviation, px.
pub(super) fn shifted(
    measured: Vec<Result<Measured, NoEdge>>,
    shift_std: f64,
) -> Vec<Result<SpanEdges, NoEdge>> {
    let spans = measured.into_iter();
    spans
        .map(|measured| Ok(measured?.displaced(&Shared::zeros(), 0.0, |_| shift_std)))
        .collect()
}

/// The unit eigenvector of the largest eigenvalue.
fn first_axis(matrix: SharedMatrix) -> Shared {
    let eigen = matrix.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into()
}

/// How far towards the dark the kurtosis of the pixels' box and of the lens moves the edges, the tone
/// curve held, in the mean over the sides.
///
/// The lens and the pixels' box are the same for all; what a side asks for beyond the mean is its
/// noise, and would be an error that all of its samples share.
fn common_shift<'a>(found: impl Iterator<Item = &'a Measured>, of_lens: f64) -> f64 {
    let held_curve = Shared::new(0.0, 0.0, of_lens);
    let (mut sum, mut count) = (0.0, 0.0);
    for measured in found {
        // Where light and dark are exchanged again and again, no line moves as a whole.
        if let Some(share) = measured.share.as_ref().filter(|_| !measured.is_crossed) {
            sum += share.own_step(&held_curve)[0] * measured.to_dark();
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// How a sample is displaced along the unit normal of its side.
struct Drift {
    normal: Vector2<f64>,
    /// By what the sides share.
    by_shared: Shared,
}

impl Measured {
    /// The normal points to the light where the contrast is positive; a tone curve, too, moves the
    /// edges to the dark or to the light, all of them alike.
    fn to_dark(&self) -> f64 {
        if self.is_crossed {
            0.0
        } else {
            -self.side.contrast[0].signum()
        }
    }

    /// Of a side that does not tell the tone, only the normals.
    fn drifts(&self) -> Vec<Drift> {
        let by_shared = self
            .share
            .as_ref()
            .map(ToneShare::drift)
            .unwrap_or_default();
        let tone_drift = |point: &Vector2<f64>| {
            let (by_coefficients, normal) = self.side.curve.distances_at(*point);
            Drift {
                normal,
                by_shared: by_shared.tr_mul(&by_coefficients),
            }
        };
        self.edges.points.iter().map(tone_drift).collect()
    }

    /// The samples, moved by a step of what the sides share and a common shift towards the dark, and how
    /// far what is left unknown displaces each.
    fn displaced(
        mut self,
        step: &Shared,
        common: f64,
        unknown: impl Fn(&Drift) -> f64,
    ) -> SpanEdges {
        let to_dark = self.to_dark();
        let drifts = self.drifts();
        for (point, tone_drift) in self.edges.points.iter_mut().zip(&drifts) {
            *point += tone_drift.normal * (tone_drift.by_shared.dot(step) + common * to_dark);
        }
        let displacements = drifts.iter().map(|d| d.normal * unknown(d) * to_dark);
        self.edges.tone_drift = displacements.collect();
        self.edges
    }
}
