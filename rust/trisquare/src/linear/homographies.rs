//! The first two of the paper's linear steps: straightening, and homographies.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::circles::{homography_of_circles, homography_of_further_circles};
use super::straighten::{Straightening, fit_distortion};
use crate::error::Error;
use crate::geometry::{Line, Normalisation, PlaneHomography, line_of_rays, normalised_homography};
use crate::image_size::ImageSize;
use crate::lens::{DistortionModel, Lens};
use crate::observations::{Figure, Freedom, Method, ObservedPlane, Options, Sample, Side};

/// Cosine of the angle from the axis up to which a ray is imaged by a pinhole at a moderate
/// distance.
const MIN_RAY_DEPTH: f64 = 0.1;

/// Removal of the distortion from the pictures' samples, before any camera matrix is known.
///
/// Homographies and conic need the image of a pinhole. With a known lens, lines can also be
/// computed from samples beside or behind the camera, since a line defines a plane through the
/// camera's centre.
#[derive(Debug, Clone)]
pub(crate) enum Undistortion<L> {
    /// Estimated from straightness.
    Straightened(Straightening),
    /// Fixed at that of a given camera.
    Known(L),
}

impl<L: Lens> Undistortion<L> {
    /// Step 1.
    pub fn estimate(
        planes: &[ObservedPlane],
        size: ImageSize,
        options: &Options<L>,
    ) -> Result<Self, Error> {
        if options.fixed.distortion {
            let known = options.initial.map(Self::Known);
            return Ok(known.unwrap_or_else(|| Self::Straightened(Straightening::identity(size))));
        }
        let coefficients = options.model.straightening_coefficients();
        if coefficients == 0 {
            return Ok(Self::Straightened(Straightening::identity(size)));
        }
        let curves: Vec<Vec<Vector2<f64>>> = planes
            .iter()
            .flat_map(ObservedPlane::sides)
            .filter(|side| !side.is_outlier && side.line().is_some())
            .map(|side| side.samples.iter().map(|s| s.pixel).collect())
            .collect();
        if curves.is_empty() {
            // Only circles: the refinement finds the distortion.
            return Ok(Self::Straightened(Straightening::identity(size)));
        }
        // If the refinement follows, it estimates the centre itself.
        let is_centre_held =
            options.fixed.principal_point || options.method == Method::MaximumLikelihood;
        let centre = is_centre_held.then(|| {
            let fixed = options.known_intrinsics(&size).principal_point;
            fixed.unwrap_or_else(|| size.centre())
        });
        fit_distortion(&curves, size, coefficients, centre).map(Self::Straightened)
    }

    pub fn undistort(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Straightened(straightening) => straightening.undistort(pixel),
            Self::Known(camera) => pinhole_pixel(camera, &camera.unproject(pixel)?),
        }
    }

    /// The pinhole's image line of samples, and the pinhole's pixels of those ahead of it.
    fn line(&self, samples: &[Sample]) -> Result<(Line, Vec<Vector2<f64>>), &'static str> {
        const NO_RAY: &str = "samples lie where the distortion is not invertible";
        const ONE_PLACE: &str = "all samples of a line coincide";
        let weights = samples.iter().map(|sample| sample.weight * sample.weight);
        match self {
            Self::Straightened(found) => {
                let ideal = samples.iter().map(|sample| found.undistort(&sample.pixel));
                let ideal: Vec<_> = ideal.collect::<Option<_>>().ok_or(NO_RAY)?;
                let line = Line::fit(ideal.iter().copied().zip(weights));
                Ok((line.ok_or(ONE_PLACE)?, ideal))
            }
            Self::Known(camera) => {
                let rays = samples.iter().map(|sample| camera.unproject(&sample.pixel));
                let rays: Vec<_> = rays.collect::<Option<_>>().ok_or(NO_RAY)?;
                let line = line_of_rays(rays.iter().copied().zip(weights)).ok_or(ONE_PLACE)?;
                let inverse = camera.camera_matrix().try_inverse().ok_or(NO_RAY)?;
                let line = inverse.tr_mul(&line);
                let ideal = rays.iter().filter_map(|ray| pinhole_pixel(camera, ray));
                let ideal = ideal.collect();
                let line = Line::new(line.x, line.y, line.z).map_err(|_| ONE_PLACE)?;
                Ok((line, ideal))
            }
        }
    }

    /// The lens with a camera matrix.
    pub fn lens(&self, camera_matrix: &Matrix3<f64>, size: ImageSize, model: L::Model) -> L {
        match self {
            Self::Straightened(found) if !found.coefficients.is_empty() => {
                let ideal_radius = |observed| found.ideal_radius(observed);
                L::from_straightening(camera_matrix, ideal_radius, size, model)
            }
            _ => L::from_camera_matrix(camera_matrix),
        }
    }
}

/// Step 2 for every figure: homographies from the figures' planes to undistorted pixels.
#[derive(Debug, Clone)]
pub(crate) struct Homographies {
    pub figures: Vec<Vec<Matrix3<f64>>>,
    /// A sample of each plane's first figure, in that figure's coordinates.
    pub witnesses: Vec<Vector2<f64>>,
    /// Whether each plane shows a rectangle of unknown aspect.
    pub has_any_aspect: Vec<bool>,
}

impl Homographies {
    pub fn estimate<L: Lens>(
        planes: &[ObservedPlane],
        undistortion: &Undistortion<L>,
    ) -> Result<Self, Error> {
        let mut figures = Vec::with_capacity(planes.len());
        let mut witnesses = Vec::with_capacity(planes.len());
        for plane in planes {
            let mut plane_homographies = Vec::with_capacity(plane.figures.len());
            for (number, figure) in plane.figures.iter().enumerate() {
                if number > 0 && figure.freedom == Freedom::Fixed {
                    plane_homographies.push(plane_homographies[0]);
                    continue;
                }
                let line = figure.sides[0].line();
                if number > 0
                    && figure.freedom == Freedom::Offsets
                    && let Some(line) = line
                {
                    let normal = line.normal();
                    plane_homographies.push(homography_of_offset(
                        (figure, normal),
                        &plane_homographies[0],
                        undistortion,
                    )?);
                    continue;
                }
                if number > 0 && figure.is_round() {
                    let undistort = |pixel: &_| undistortion.undistort(pixel);
                    plane_homographies.push(homography_of_further_circles(
                        figure,
                        &plane_homographies[0],
                        &undistort,
                    )?);
                    continue;
                }
                let (homography, seen) = match number {
                    0 => {
                        let other_circles =
                            plane.figures[1..].iter().find(|other| other.is_round());
                        homography_of_figure(&with_fixed(plane), other_circles, undistortion)?
                    }
                    _ => homography_of_figure(figure, None, undistortion)?,
                };
                if plane_homographies.is_empty() {
                    witnesses.push(back_project(&homography, &seen).unwrap_or_default());
                }
                plane_homographies.push(homography);
            }
            figures.push(plane_homographies);
        }
        Ok(Self {
            figures,
            witnesses,
            has_any_aspect: planes.iter().map(ObservedPlane::has_any_aspect).collect(),
        })
    }

    /// Concatenates the homographies of several sets of planes.
    pub fn joined<'a>(sets: impl Iterator<Item = &'a Self>) -> Self {
        let mut all = Self {
            figures: Vec::new(),
            witnesses: Vec::new(),
            has_any_aspect: Vec::new(),
        };
        for set in sets {
            all.figures.extend(set.figures.iter().cloned());
            all.witnesses.extend(&set.witnesses);
            all.has_any_aspect.extend(&set.has_any_aspect);
        }
        all
    }

    /// The homography of the first figure of every plane, and whether its aspect is unknown.
    pub fn of_planes(&self) -> Vec<PlaneHomography> {
        let first = self.figures.iter().map(|figures| figures[0]);
        let planes = first.zip(&self.has_any_aspect);
        let planes = planes.map(|(homography, has_any_aspect)| PlaneHomography {
            homography,
            has_any_aspect: *has_any_aspect,
        });
        planes.collect()
    }
}

/// A plane's first figure, extended by the sides of the figures given in its coordinates: the first
/// one alone may be a small part of the whole.
fn with_fixed(plane: &ObservedPlane) -> Figure {
    let mut first = plane.figures[0].clone();
    for figure in &plane.figures[1..] {
        if figure.freedom == Freedom::Fixed {
            let offset = first.sides[first.sides.len() - 1].number + 1;
            first.sides.extend(figure.sides.iter().map(|side| Side {
                number: offset + side.number,
                ..side.clone()
            }));
        }
    }
    first
}

/// The homography of a figure, and a pixel on it. A single circle needs another figure on its
/// plane.
pub(crate) fn homography_of_figure<L: Lens>(
    figure: &Figure,
    other_circles: Option<&Figure>,
    undistortion: &Undistortion<L>,
) -> Result<(Matrix3<f64>, Vector2<f64>), Error> {
    let degenerate = |reason| Error::DegenerateHomography {
        figure: figure.index,
        reason,
    };
    let mut plane_lines: Vec<Line> = Vec::with_capacity(figure.sides.len());
    let mut image_lines: Vec<Line> = Vec::with_capacity(figure.sides.len());
    let mut ideal = Vec::new();
    for side in &figure.sides {
        let Some(plane_line) = side.line() else {
            continue;
        };
        let (line, seen) = undistortion.line(&side.samples).map_err(degenerate)?;
        plane_lines.push(plane_line);
        image_lines.push(line);
        ideal.extend(seen);
    }
    if plane_lines.is_empty() {
        let undistort = |pixel: &_| undistortion.undistort(pixel);
        return homography_of_circles(figure, other_circles, &undistort);
    }
    let witness = *ideal
        .first()
        .ok_or_else(|| degenerate("none of it is ahead of the camera"))?;
    let normalisation = Normalisation::of_points(ideal.iter());
    let homography = normalised_homography(&plane_lines, &image_lines, normalisation)
        .map_err(|error| error.of_figure(figure.index))?;
    Ok((homography, witness))
}

/// A plane's homography translated to the line of a figure, which passes through the origin with a
/// known normal.
fn homography_of_offset<L: Lens>(
    (figure, normal): (&Figure, Vector2<f64>),
    plane: &Matrix3<f64>,
    undistortion: &Undistortion<L>,
) -> Result<Matrix3<f64>, Error> {
    let (image_line, _) = undistortion
        .line(&figure.sides[0].samples)
        .map_err(|reason| Error::DegenerateHomography {
            figure: figure.index,
            reason,
        })?;
    let line = plane.tr_mul(&image_line.coefficients());
    let offset = -line.z / normal.dot(&line.xy());
    Ok(plane * Matrix3::new_translation(&(normal * offset)))
}

/// A pinhole's pixel of a unit ray, with the same camera matrix; `None` beyond a moderate distance.
fn pinhole_pixel<L: Lens>(camera: &L, ray: &Vector3<f64>) -> Option<Vector2<f64>> {
    (ray.z > MIN_RAY_DEPTH).then(|| (camera.camera_matrix() * ray).xy() / ray.z)
}

fn back_project(homography: &Matrix3<f64>, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
    let point = homography.try_inverse()? * pixel.push(1.0);
    let point = point.xy() / point.z;
    (point.x.is_finite() && point.y.is_finite()).then_some(point)
}
