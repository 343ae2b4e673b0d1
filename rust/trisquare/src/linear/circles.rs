//! Homographies of figures that are circles: of two on a plane from these alone, of others from a
//! known homography of the plane.

use nalgebra::{Matrix3, Vector2};

use crate::error::Error;
use crate::geometry::{
    Normalisation, area, concentric_homography, fit_circle, fit_ellipse, separate_homography,
};
use crate::observations::{Curve, Figure, Radius};

/// Map from a pixel to the pixel of a pinhole.
pub(super) type Undistort<'a> = &'a dyn Fn(&Vector2<f64>) -> Option<Vector2<f64>>;

/// A circle of a figure in the image of a pinhole.
struct Circle {
    radius: Radius,
    points: Vec<Vector2<f64>>,
}

/// The circles of a figure.
fn circles(figure: &Figure, undistort: Undistort<'_>) -> Result<Vec<Circle>, Error> {
    let mut circles: Vec<Circle> = Vec::new();
    for side in &figure.sides {
        let Curve::Circle(radius) = side.curve else {
            continue;
        };
        let samples = side.samples.iter();
        let seen = samples.map(|sample| undistort(&sample.pixel));
        let seen = seen.collect::<Option<Vec<_>>>().ok_or_else(|| {
            degenerate(figure, "samples lie where the distortion is not invertible")
        })?;
        match circles.get_mut(side.number) {
            Some(circle) => circle.points.extend(seen),
            None => circles.push(Circle {
                radius,
                points: seen,
            }),
        }
    }
    Ok(circles)
}

/// The homography of circles, with an arbitrary rotation about the first one's centre; that of a
/// single circle uses another circle on the same plane.
pub(super) fn homography_of_circles(
    figure: &Figure,
    other: Option<&Figure>,
    undistort: Undistort<'_>,
) -> Result<(Matrix3<f64>, Vector2<f64>), Error> {
    let own_circles = circles(figure, undistort)?;
    let further = match (own_circles.len(), other) {
        (2.., _) => Vec::new(),
        (_, Some(other)) => circles(other, undistort)?,
        _ => {
            return Err(Error::LoneCircle {
                figure: figure.index,
            });
        }
    };
    let points = own_circles.iter().flat_map(|circle| &circle.points);
    let normalisation = Normalisation::of_points(points)
        .ok_or_else(|| degenerate(figure, "all samples of a circle coincide"))?;
    let inverse = normalisation.inverse();
    let ellipse = |circle: &Circle| {
        let found = fit_ellipse(&circle.points);
        let found = found.ok_or_else(|| degenerate(figure, "the image of a circle is no ellipse"));
        found.map(|ellipse| inverse.tr_mul(&ellipse) * inverse)
    };
    let all = own_circles.iter().chain(&further);
    let mut ellipses = all.map(ellipse).collect::<Result<Vec<_>, Error>>()?;
    check_nesting(figure.index, &own_circles, &ellipses)?;
    let separate = match further.is_empty() {
        true => None,
        false => separate_homography(&ellipses[0], &ellipses[1]),
    };
    let found = separate.or_else(|| {
        ellipses.sort_by(|a, b| area(a).total_cmp(&area(b)));
        concentric_homography(&ellipses[0], &ellipses[ellipses.len() - 1])
    });
    let mut homography =
        inverse * found.ok_or_else(|| degenerate(figure, "its circles are not concentric"))?;
    let (mut known, mut measured) = (0.0, 0.0);
    for circle in &own_circles {
        if let Radius::Known(radius) = circle.radius {
            known += radius;
            measured += mean_radius(circle, &homography)
                .ok_or_else(|| degenerate(figure, "it is singular"))?;
        }
    }
    homography.column_mut(2).scale_mut(known / measured);
    Ok((homography, own_circles[0].points[0]))
}

/// Checks that the images of circles are nested in the order of their radii.
///
/// # Errors
/// [`Error::InvalidArgument`] if a circle appears around one with a larger radius.
fn check_nesting(
    figure: usize,
    circles: &[Circle],
    ellipses: &[Matrix3<f64>],
) -> Result<(), Error> {
    let known = circles.iter().zip(ellipses).enumerate();
    let known = known.filter_map(|(number, (circle, ellipse))| match circle.radius {
        Radius::Known(radius) => Some((number, radius, area(ellipse))),
        Radius::Free(_) => None,
    });
    let mut known: Vec<(usize, f64, f64)> = known.collect();
    known.sort_by(|a, b| a.1.total_cmp(&b.1));
    let is_crossed = |pair: &&[(usize, f64, f64)]| pair[0].2 > pair[1].2;
    let Some([small, large]) = known.windows(2).find(is_crossed) else {
        return Ok(());
    };
    Err(Error::InvalidArgument(format!(
        "figure {figure}: circle {} of radius {} is seen around circle {} of radius {}: are the \
         radii in the order of the samples?",
        small.0, small.1, large.0, large.1
    )))
}

/// The homography of circles on a plane with a known homography.
pub(super) fn homography_of_further_circles(
    figure: &Figure,
    plane: &Matrix3<f64>,
    undistort: Undistort<'_>,
) -> Result<Matrix3<f64>, Error> {
    let circles = circles(figure, undistort)?;
    let first = &circles[0];
    let placed = || {
        let (centre, found) = fit_circle(&plane_points(&first.points, plane)?)?;
        let scale = match first.radius {
            Radius::Known(radius) => found / radius,
            Radius::Free(_) => return None,
        };
        let place = Matrix3::new(scale, 0.0, centre.x, 0.0, scale, centre.y, 0.0, 0.0, 1.0);
        Some(plane * place)
    };
    placed().ok_or_else(|| degenerate(figure, "it is no circle on its plane"))
}

/// The free radii of a figure, by its homography.
pub(super) fn free_radii(
    figure: &Figure,
    homography: &Matrix3<f64>,
    undistort: Undistort<'_>,
) -> Result<Vec<f64>, Error> {
    let circles = circles(figure, undistort)?;
    let free = circles
        .iter()
        .filter(|c| matches!(c.radius, Radius::Free(_)));
    free.map(|circle| mean_radius(circle, homography))
        .collect::<Option<_>>()
        .ok_or_else(|| degenerate(figure, "it is singular"))
}

fn degenerate(figure: &Figure, reason: &'static str) -> Error {
    Error::DegenerateHomography {
        figure: figure.index,
        reason,
    }
}

/// Mean distance of a circle's points from the origin of the plane.
fn mean_radius(circle: &Circle, homography: &Matrix3<f64>) -> Option<f64> {
    let points = plane_points(&circle.points, homography)?;
    let sum: f64 = points.iter().map(|point| point.norm()).sum();
    let mean = sum / points.len() as f64;
    (mean.is_finite() && mean > 0.0).then_some(mean)
}

fn plane_points(points: &[Vector2<f64>], homography: &Matrix3<f64>) -> Option<Vec<Vector2<f64>>> {
    let inverse = homography.try_inverse()?;
    let plane_point = |point: &Vector2<f64>| {
        let p = inverse * point.push(1.0);
        p.xy() / p.z
    };
    Some(points.iter().map(plane_point).collect())
}
