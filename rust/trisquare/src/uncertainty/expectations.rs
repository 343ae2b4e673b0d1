//! Checks of a result against expectations: a camera like nearly every other, with square pixels
//! and its principal point near the centre, that is known well enough to be used, in all of the
//! picture.
//!
//! Targets that are not square, and a stretched or a cropped picture, give a result that fits as
//! well as a true one. Only prior knowledge of cameras reveals it.

use nalgebra::{DMatrix, Vector2};

use super::comparison::compare_projections;
use super::conditioning::max_std;
use super::projection::ProjectionUncertainty;
use crate::image_size::ImageSize;
use crate::lens::{Lens, MATRIX};
use crate::observations::Fixed;
use crate::result::{Calibration, Warning};

/// Tolerance of `fy / fx` about 1.
const ASPECT_TOLERANCE: f64 = 0.005;
/// Tolerance of the principal point about the centre, as a fraction of the width.
const CENTRE_TOLERANCE: f64 = 0.05;
/// Standard deviations beyond a tolerance above which a departure is evident.
const EVIDENT: f64 = 4.0;

/// Warns of a camera that is unlike nearly all others.
///
/// `held` returns `fx` with a further parameter held at the value that is usual of cameras.
pub(crate) fn unlikely_camera<L: Lens>(
    found: &Calibration<L>,
    fixed: Fixed,
    held: impl Fn(Fixed) -> Option<f64>,
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if let Some((ratio, std)) = aspect(found)
        && (ratio - 1.0).abs() > ASPECT_TOLERANCE + EVIDENT * std
    {
        let held = held(Fixed {
            aspect: true,
            ..fixed
        });
        warnings.push(Warning::PixelsNotSquare { ratio, std, held });
    }
    if let Some((distance, std)) = centre_offset(found)
        && distance > CENTRE_TOLERANCE * found.image_size.width as f64 + EVIDENT * std
    {
        let held = held(Fixed {
            principal_point: true,
            ..fixed
        });
        warnings.push(Warning::PrincipalPointOffCentre {
            distance,
            std,
            held,
        });
    }
    warnings
}

/// Number of places along either side of a picture at which its lens is checked.
const PLACES: u32 = 21;

/// Fraction of a picture, at its corners, in which a lens may have no inverse.
const MIN_MISSING: f64 = 0.01;

/// Number of places along either side at which the uncertainty of the projections is checked.
const COARSE_PLACES: u32 = 11;

/// Standard deviation of a projection, as a fraction of the picture's width, up to which it is
/// known.
const KNOWN: f64 = 0.01;
/// Fraction of a picture above which unknown projections matter.
const MIN_UNKNOWN: f64 = 0.1;

/// Returns the parameter of the camera matrix that is known worst, its standard deviation, and that
/// as a fraction of the focal length or of the width, which is named last; `None` if none is free.
fn worst_known_parameter<L: Lens>(
    found: &Calibration<L>,
) -> Option<(&'static str, f64, f64, &'static str)> {
    let focal = found.camera.focal();
    let width = f64::from(found.image_size.width);
    let parts = [
        ("fx", focal.x, "the focal length"),
        ("fy", focal.y, "the focal length"),
        ("cx", width, "the width"),
        ("cy", width, "the width"),
    ];
    let parts = parts.into_iter().filter_map(|(parameter, whole, of)| {
        let std = found.std_of(parameter)?;
        Some((parameter, std, std / whole, of))
    });
    parts.max_by(|a, b| a.2.total_cmp(&b.2))
}

/// Returns the largest standard deviation of a focal length, as a fraction of it, or of the
/// principal point, as a fraction of the width; `None` if none of them is free.
pub(crate) fn camera_known_to<L: Lens>(found: &Calibration<L>) -> Option<f64> {
    worst_known_parameter(found).map(|(_, _, part, _)| part)
}

/// Warns of a camera that is known worse than the limit at which a geometry is refused, and of a
/// lens that ends within the picture, or is extrapolated in a part of it.
pub(crate) fn poorly_known<L: Lens>(found: &Calibration<L>, fixed: Fixed) -> Vec<Warning> {
    let limit = max_std(fixed);
    let undetermined = worst_known_parameter(found).filter(|(_, _, part, _)| *part > limit);
    let undetermined = undetermined.map(|(parameter, std, part, of)| Warning::BarelyDetermined {
        parameter: parameter.into(),
        std,
        part,
        of: of.into(),
        by_tone: found
            .tone_growth
            .is_some_and(|growth| part < growth * limit),
    });
    let missing = missing(found);
    let ends = (missing > MIN_MISSING).then_some(Warning::LensEndsInPicture { missing });
    let guess = extrapolated_lens(found);
    undetermined.into_iter().chain(ends).chain(guess).collect()
}

/// Returns the fraction of the picture in which the lens has no inverse.
fn missing<L: Lens>(found: &Calibration<L>) -> f64 {
    if found.camera.sees_all_of(found.image_size) {
        return 0.0;
    }
    let places = places(found.image_size, PLACES);
    let unseen = places.filter(|pixel| found.camera.unproject(pixel).is_none());
    unseen.count() as f64 / f64::from(PLACES * PLACES)
}

/// Returns the centres of the cells of a grid over a picture, with `cells_per_side` cells along
/// either side.
fn places(size: ImageSize, cells_per_side: u32) -> impl Iterator<Item = Vector2<f64>> {
    let place = move |i: u32, size: u32| {
        f64::from(size) * (f64::from(i) + 0.5) / f64::from(cells_per_side) - 0.5
    };
    (0..cells_per_side * cells_per_side).map(move |i| {
        let (column, row) = (i % cells_per_side, i / cells_per_side);
        Vector2::new(place(column, size.width), place(row, size.height))
    })
}

/// Warns of a lens that is estimated from so small a part of the picture that it is extrapolated in
/// the rest.
///
/// If the lens ends in the picture, the part beyond does not count: it has its own warning.
fn extrapolated_lens<L: Lens>(found: &Calibration<L>) -> Option<Warning> {
    let is_lens_parameter = |name: &&str| !MATRIX.contains(name);
    if !found.parameters.iter().any(is_lens_parameter) {
        return None;
    }
    let limit = KNOWN * f64::from(found.image_size.width);
    let places = places(found.image_size, COARSE_PLACES);
    let is_seen = |pixel: &Vector2<f64>| found.camera.unproject(pixel).is_some();
    let pixels: Vec<_> = places.filter(is_seen).collect();
    let uncertainty = found.projection_uncertainty().ok()?;
    // Removing a rotation reduces the sum of all variances: for nearly all lenses this bound
    // suffices.
    let variances = pixels.iter().map(|p| Some(uncertainty.at(p)?.trace()));
    let sum: Option<f64> = variances.sum();
    if sum.is_some_and(|sum| sum < MIN_UNKNOWN * pixels.len() as f64 * limit * limit) {
        return None;
    }
    let exact = ProjectionUncertainty::new(&found.camera, &[], false, DMatrix::zeros(0, 0)).ok()?;
    // A rotation of the whole camera is removed, as in the projection map.
    let compared = compare_projections(&uncertainty, &exact, &pixels).ok()?;
    let stds: Vec<f64> = compared.test?.std.into_iter().flatten().collect();
    let part = |count: usize| count as f64 / f64::from(COARSE_PLACES * COARSE_PLACES);
    let known = part(stds.iter().filter(|std| **std <= limit).count());
    let worst = stds.iter().copied().fold(0.0, f64::max);
    (part(pixels.len()) - known > MIN_UNKNOWN).then_some(Warning::LensExtrapolated {
        unknown: 1.0 - known,
        limit,
        worst,
    })
}

/// Adds a missing part to the covariance of a camera, and renews the warnings of how well it is
/// known.
pub(crate) fn widen<L: Lens>(
    found: &mut Calibration<L>,
    missing_covariance: DMatrix<f64>,
    fixed: Fixed,
) {
    found.covariance += missing_covariance;
    found.warnings.retain(|warning| {
        !matches!(
            warning,
            Warning::BarelyDetermined { .. }
                | Warning::LensEndsInPicture { .. }
                | Warning::LensExtrapolated { .. }
        )
    });
    let known = poorly_known(found, fixed);
    found.warnings.extend(known);
    found.sort_warnings();
}

/// Returns the ratio `fy / fx` and its standard deviation, if it is free.
fn aspect<L: Lens>(found: &Calibration<L>) -> Option<(f64, f64)> {
    let [x, y] = [found.position("fx")?, found.position("fy")?];
    let focal = found.camera.focal();
    let derivative = Vector2::new(-focal.y / focal.x, 1.0) / focal.x;
    Some((focal.y / focal.x, found.deviation([x, y], derivative)))
}

/// Returns the distance of the principal point from the centre and its standard deviation, if it is
/// free.
fn centre_offset<L: Lens>(found: &Calibration<L>) -> Option<(f64, f64)> {
    let [x, y] = [found.position("cx")?, found.position("cy")?];
    let offset = found.camera.principal_point() - found.image_size.centre();
    let derivative = offset.try_normalize(f64::MIN_POSITIVE)?;
    Some((offset.norm(), found.deviation([x, y], derivative)))
}

impl<L: Lens> Calibration<L> {
    /// Returns the standard deviation of a function of two parameters with these derivatives.
    fn deviation(&self, [i, j]: [usize; 2], derivative: Vector2<f64>) -> f64 {
        let c = &self.covariance;
        let variance = derivative.x * derivative.x * c[(i, i)]
            + 2.0 * derivative.x * derivative.y * c[(i, j)]
            + derivative.y * derivative.y * c[(j, j)];
        variance.max(0.0).sqrt()
    }
}
