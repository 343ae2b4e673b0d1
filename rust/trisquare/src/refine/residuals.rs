//! Distances of the samples to the images of their lines, and their spread.

use nalgebra::Vector2;

use crate::geometry::line_of_rays;
use crate::lens::Lens;
use crate::numeric::median_scale;
use crate::observations::{ObservedPlane, Sample, Side, View};

/// Noise below this (px) is rounding, not measurement.
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
    /// Whether its side belongs to the scene; an outlier says nothing about the noise.
    pub counts: bool,
}

/// The residuals of all samples, by plane.
pub(crate) type Residuals = Vec<Vec<Residual>>;

/// Root mean square distance, in pixels.
pub(crate) fn root_mean_square<'a>(residuals: impl Iterator<Item = &'a Residual>) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0);
    for residual in residuals {
        squares += residual.distance * residual.distance;
        count += 1.0;
    }
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Distances of all samples; `None` where the lens is not invertible.
pub(crate) fn residuals<L: Lens>(planes: &[ObservedPlane], view: &View<L>) -> Option<Residuals> {
    let mut all = Vec::with_capacity(planes.len());
    for (plane, state) in planes.iter().zip(&view.planes) {
        let mut own = Vec::new();
        for (f, side) in plane.sides_by_figure() {
            for found in state.model_lines(&view.lens, f, side) {
                let (model, range) = found?;
                let line = state.line(f, &model.line);
                for sample in &side.samples[range] {
                    let pixel_ray = view.lens.unproject_with_jacobian(&sample.pixel)?;
                    let (distance, normal) = view.lens.line_distance_and_normal(&pixel_ray, &line);
                    own.push(Residual {
                        distance,
                        normal,
                        weight: sample.weight,
                        counts: !side.is_outlier,
                    });
                }
            }
        }
        all.push(own);
    }
    Some(all)
}

/// Distances of a side's samples to the image of the line that fits these alone best; `None` where
/// the lens is not invertible.
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
            counts: true,
        }
    };
    Some(pixel_rays.iter().zip(&side.samples).map(residual).collect())
}

/// The scale of the bulk of the residuals, in units of their given standard deviations.
pub(crate) fn robust_scale(residuals: &Residuals) -> f64 {
    let counting = residuals.iter().flatten().filter(|r| r.counts);
    let normalised = counting.map(|r| r.distance * r.weight);
    median_scale(normalised).max(MIN_SCALE)
}
