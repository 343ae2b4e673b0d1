//! Distances of the samples to the images of their lines, and their spread.

use nalgebra::Vector2;

use super::side_curve::SideCurves;
use crate::geometry::line_of_rays;
use crate::lens::Lens;
use crate::numeric::median_scale;
use crate::observations::{ObservedPlane, Sample, Side, View};

/// Lower bound of the noise (px): below it residuals are rounding errors.
pub(crate) const MIN_SCALE: f64 = 1e-9;

/// Distance of a sample to the image of its line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Residual {
    /// Signed, in pixels.
    pub distance: f64,
    /// Unit normal of the line's image, towards which the distance is positive.
    pub normal: Vector2<f64>,
    /// One over the standard deviation given for the sample.
    pub weight: f64,
    /// Whether the sample and its side belong to the scene: outliers do not count for the noise.
    pub is_counted: bool,
}

/// The residuals of all samples, by plane.
pub(crate) type Residuals = Vec<Vec<Residual>>;

/// Root mean square distance, in pixels, of the residuals that count, or of all if none does.
pub(crate) fn root_mean_square<'a>(residuals: impl Iterator<Item = &'a Residual> + Clone) -> f64 {
    let has_counted = residuals.clone().any(|residual| residual.is_counted);
    let (mut squares, mut count) = (0.0, 0.0);
    for residual in residuals.filter(|residual| residual.is_counted || !has_counted) {
        squares += residual.distance * residual.distance;
        count += 1.0;
    }
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Distances of all samples; `None` if the lens is not invertible at one.
pub(crate) fn residuals<L: Lens>(planes: &[ObservedPlane], view: &View<L>) -> Option<Residuals> {
    residuals_near(planes, view, None)
}

/// `residuals` computed with curves near the view, if any.
pub(super) fn residuals_near<L: Lens>(
    planes: &[ObservedPlane],
    view: &View<L>,
    curves: Option<&SideCurves>,
) -> Option<Residuals> {
    let empty = |plane: &ObservedPlane| Vec::with_capacity(plane.samples().count());
    let mut all: Residuals = planes.iter().map(empty).collect();
    for_each_residual(planes, view, curves, |plane, residual| {
        all[plane].push(residual)
    })?;
    Some(all)
}

/// [`robust_scale`] of the residuals of a view.
pub(super) fn scale_near<L: Lens>(
    planes: &[ObservedPlane],
    (view, unknowns): (&View<L>, usize),
    curves: Option<&SideCurves>,
) -> Option<f64> {
    let mut normalised = Vec::with_capacity(planes.iter().map(|p| p.samples().count()).sum());
    for_each_residual(planes, view, curves, |_, residual| {
        if residual.is_counted {
            normalised.push(residual.distance * residual.weight);
        }
    })?;
    Some(bulk_scale(normalised, unknowns))
}

/// Calls `visit` with every residual, in order, and the index of its plane; `None` if the lens is
/// not invertible at a sample.
#[inline]
fn for_each_residual<L: Lens>(
    planes: &[ObservedPlane],
    view: &View<L>,
    curves: Option<&SideCurves>,
    mut visit: impl FnMut(usize, Residual),
) -> Option<()> {
    for (p, (plane, state)) in planes.iter().zip(&view.planes).enumerate() {
        for (s, (f, side)) in plane.sides_by_figure().enumerate() {
            let curve = curves.and_then(|curves| curves.get(p, s));
            let mut add = |sample: &Sample, (distance, normal)| {
                let residual = Residual {
                    distance,
                    normal,
                    weight: sample.weight,
                    is_counted: !side.is_outlier,
                };
                visit(p, residual);
            };
            for found in state.model_lines(&view.lens, f, side) {
                let (model, range) = found?;
                let line = state.line(f, &model.line);
                if let Some(curve) = curve {
                    let mut samples = side.samples.iter();
                    curve.for_each_distance(&view.lens, &line, |distance, normal| {
                        if let Some(sample) = samples.next() {
                            add(sample, (distance, normal));
                        }
                    })?;
                    continue;
                }
                for sample in &side.samples[range] {
                    let pixel_ray = view.lens.unproject_with_jacobian(&sample.pixel)?;
                    add(
                        sample,
                        view.lens.line_distance_and_normal(&pixel_ray, &line),
                    );
                }
            }
        }
    }
    Some(())
}

/// Distances of a side's samples to the image of the line fitted to these alone; `None` if the lens
/// is not invertible at one.
pub(crate) fn straightness_residuals<L: Lens>(lens: &L, side: &Side) -> Option<Vec<Residual>> {
    let pixel_rays = side
        .samples
        .iter()
        .map(|sample| lens.unproject_with_jacobian(&sample.pixel))
        .collect::<Option<Vec<_>>>()?;
    let rays = pixel_rays.iter().map(|ray| lens.direction(ray).normalize());
    let line = line_of_rays(rays.map(|ray| (ray, 1.0)))?;
    let residual = |(ray, sample): (&L::PixelRay, &Sample)| {
        let (distance, normal) = lens.line_distance_and_normal(ray, &line);
        Residual {
            distance,
            normal,
            weight: sample.weight,
            is_counted: true,
        }
    };
    Some(pixel_rays.iter().zip(&side.samples).map(residual).collect())
}

/// Relative standard error of a scale from the median of absolute values, times the square root of
/// their number: the median has 37 % of the efficiency of the root mean square.
const MEDIAN_ERROR: f64 = 1.16;

/// The scale of the bulk of the residuals, in units of their given standard deviations, after the
/// fit of `unknowns` parameters.
pub(crate) fn robust_scale(residuals: &Residuals, unknowns: usize) -> f64 {
    let counted = residuals.iter().flatten().filter(|r| r.is_counted);
    let normalised = counted.map(|r| r.distance * r.weight);
    bulk_scale(normalised.collect(), unknowns)
}

/// Robust scale, corrected for the fitted parameters: residuals are smaller than the noise, with
/// few samples by so much that inliers would be taken for outliers. With many samples the
/// correction is below the scale's own error, and omitted.
fn bulk_scale(normalised: Vec<f64>, unknowns: usize) -> f64 {
    let count = normalised.len().max(1) as f64;
    let freedom = (count - unknowns as f64).max(1.0);
    let reduction = (freedom / count).sqrt();
    let scale = median_scale(normalised.into_iter()).max(MIN_SCALE);
    match 1.0 - reduction < MEDIAN_ERROR / count.sqrt() {
        true => scale,
        false => scale / reduction,
    }
}
