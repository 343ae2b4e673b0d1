//! The lens that makes the sides of candidates straight, and how straight it makes them.
//!
//! The sides of false squares are straight, too, so that one lens suits all that one camera saw.

use nalgebra::Vector2;

use crate::geometry::Line;
use crate::lens::Lens;
use crate::linear::{Straightening, Undistortion};
use crate::noise::{Misfit, Noise};
use crate::observations::{ObservedPlane, Sample, Side};
use crate::refine::{Residual, Residuals, robust_scale};
use crate::solver::JointProblem;

/// What undistorts the planes, and how straight it leaves their sides: mean square curvature in
/// units of their noise, at least 1.
pub(crate) fn straightened<L: Lens>(
    planes: &[ObservedPlane],
    problem: &JointProblem<'_, L>,
) -> (Undistortion<L>, f64) {
    let undistortion = Undistortion::estimate(planes, problem.size, problem.options)
        .unwrap_or_else(|_| Undistortion::Straightened(Straightening::identity(problem.size)));
    let own = |plane: &ObservedPlane| -> Option<Vec<Residual>> {
        let sides = plane.sides().map(|side| residuals(side, &undistortion));
        Some(sides.collect::<Option<Vec<_>>>()?.concat())
    };
    // Where the lens cannot map them all, nothing is known of their curvature.
    let Some(residuals) = planes.iter().map(own).collect::<Option<Residuals>>() else {
        return (undistortion, 1.0);
    };
    let noise = Noise::of(planes, &residuals, robust_scale(&residuals));
    let (mut curved, mut freedom) = (0.0, 0.0);
    for plane in 0..planes.len() {
        let misfit = Misfit::of_plane(&noise, plane);
        curved += misfit.curved;
        freedom += misfit.curved_freedom;
    }
    (undistortion, f64::max(curved / f64::max(freedom, 1.0), 1.0))
}

/// A side's distances from its line in the undistorted picture.
fn residuals<L: Lens>(side: &Side, undistortion: &Undistortion<L>) -> Option<Vec<Residual>> {
    let pixels = side
        .samples
        .iter()
        .map(|s| undistortion.undistort(&s.pixel));
    let ideal: Vec<_> = pixels.collect::<Option<_>>()?;
    let line = Line::fit(ideal.iter().map(|pixel| (*pixel, 1.0)))?;
    let residual = |(pixel, sample): (&Vector2<f64>, &Sample)| Residual {
        distance: line.distance(pixel),
        normal: line.normal(),
        weight: sample.weight,
        counts: true,
    };
    Some(ideal.iter().zip(&side.samples).map(residual).collect())
}
