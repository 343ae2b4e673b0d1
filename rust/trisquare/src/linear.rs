//! The paper's three linear steps: straighten, homographies, conic; and from them a first view.

use nalgebra::{Matrix3, Vector2};

use crate::conic::camera_matrix;
use crate::homography::normalised_homography;
use crate::observations::{Figure, ObservedPlane, Placement};
use crate::radial::forward_coefficients;
use crate::view::{PlaneState, View};
use crate::{
    Brown, Error, Freedom, ImageSize, KnownIntrinsics, Lens, Line, Method, Model, Normalisation,
    Options, Pose, Straightening, fit_distortion,
};

/// Focal lengths tried, in image widths, where the conic gives none.
const FOCAL_GUESSES: [f64; 3] = [1.0, 0.6, 2.0];

/// A figure this close to its plane's first one's centre (in that one's units) is concentric.
const CONCENTRIC_SHIFT: f64 = 0.05;

/// A concentric figure is turned by at most this (radians) from a quarter turn.
const CONCENTRIC_ANGLE: f64 = 0.09;

/// The pictures' samples freed from distortion, before any camera matrix is known.
#[derive(Debug, Clone)]
pub(crate) enum Undistortion {
    /// Estimated from straightness.
    Straightened(Straightening),
    /// Held at that of a given camera.
    Known(Brown),
}

impl Undistortion {
    /// Step 1.
    pub fn estimate(
        planes: &[ObservedPlane],
        size: ImageSize,
        options: &Options,
    ) -> Result<Self, Error> {
        if options.fixed.distortion {
            let known = options.initial.map(Self::Known);
            return Ok(known.unwrap_or_else(|| Self::Straightened(Straightening::identity(size))));
        }
        let coefficients = options.model.radial_coefficients().min(2);
        if options.model == Model::None || coefficients == 0 {
            return Ok(Self::Straightened(Straightening::identity(size)));
        }
        let curves: Vec<Vec<Vector2<f64>>> = planes
            .iter()
            .flat_map(ObservedPlane::sides)
            .filter(|side| !side.set_aside)
            .map(|side| side.samples.iter().map(|s| s.pixel).collect())
            .collect();
        // Where the refinement follows, it finds the centre itself.
        let held = options.fixed.principal_point || options.method == Method::MaximumLikelihood;
        let centre = held.then(|| {
            let fixed = options.known_intrinsics(&size).principal_point;
            fixed.unwrap_or_else(|| size.centre())
        });
        fit_distortion(&curves, size, coefficients, centre).map(Self::Straightened)
    }

    pub fn undistort(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Straightened(straightening) => straightening.undistort(pixel),
            Self::Known(camera) => {
                let ideal = camera.sight(pixel)?.ideal();
                Some(ideal.component_mul(&camera.focal()) + camera.principal_point())
            }
        }
    }

    /// The forward coefficients `(k1, k2, k3)` that go with a camera matrix, by least squares
    /// over the radii which the image covers.
    fn forward(&self, lens: &Brown, size: ImageSize, model: Model) -> [f64; 3] {
        let mut k = [0.0; 3];
        let Self::Straightened(straightening) = self else {
            return k;
        };
        let count = model.radial_coefficients();
        if count == 0 || straightening.coefficients.is_empty() {
            return k;
        }
        let focal = (lens.focal().x * lens.focal().y).sqrt();
        let covered = size
            .corners()
            .map(|c| (c - lens.principal_point()).norm() / focal);
        let largest = covered.iter().fold(0.0f64, |a, b| a.max(*b));
        let ideal = |r: f64| straightening.ideal_radius(r * focal) / focal;
        // An estimate that folds over before the corners is believed as far as half the radius.
        let found = forward_coefficients(ideal, largest, count)
            .or_else(|| forward_coefficients(ideal, 0.5 * largest, count));
        for (k, value) in k.iter_mut().zip(found.unwrap_or_default()) {
            *k = value;
        }
        k
    }
}

/// Step 2 for every figure: homographies from the figures' planes to undistorted pixels.
#[derive(Debug, Clone)]
pub(crate) struct Homographies {
    pub figures: Vec<Vec<Matrix3<f64>>>,
    /// A sample of each plane's first figure, in that figure's coordinates.
    witnesses: Vec<Vector2<f64>>,
}

impl Homographies {
    pub fn estimate(planes: &[ObservedPlane], undistortion: &Undistortion) -> Result<Self, Error> {
        let mut figures = Vec::with_capacity(planes.len());
        let mut witnesses = Vec::with_capacity(planes.len());
        for plane in planes {
            let mut own = Vec::with_capacity(plane.figures.len());
            for (number, figure) in plane.figures.iter().enumerate() {
                if number > 0 && figure.freedom == Freedom::Fixed {
                    own.push(own[0]);
                    continue;
                }
                let (homography, seen) = match number {
                    0 => homography_of_figure(&with_fixed(plane), undistortion)?,
                    _ => homography_of_figure(figure, undistortion)?,
                };
                if own.is_empty() {
                    witnesses.push(back_project(&homography, &seen).unwrap_or_default());
                }
                own.push(homography);
            }
            figures.push(own);
        }
        Ok(Self { figures, witnesses })
    }

    /// Those of several sets of planes, one after the other.
    pub fn joined<'a>(sets: impl Iterator<Item = &'a Self>) -> Self {
        let (mut figures, mut witnesses) = (Vec::new(), Vec::new());
        for set in sets {
            figures.extend(set.figures.iter().cloned());
            witnesses.extend(&set.witnesses);
        }
        Self { figures, witnesses }
    }

    /// The first figure's homography of every plane.
    pub fn of_planes(&self) -> Vec<Matrix3<f64>> {
        self.figures.iter().map(|figures| figures[0]).collect()
    }
}

/// A plane's first figure with the sides of those that are given in its coordinates: the first one
/// alone may be a small part of the whole.
fn with_fixed(plane: &ObservedPlane) -> Figure {
    let mut first = plane.figures[0].clone();
    for figure in &plane.figures[1..] {
        if figure.freedom == Freedom::Fixed {
            first.sides.extend(figure.sides.iter().cloned());
        }
    }
    first
}

pub(crate) fn homography_of_figure(
    figure: &Figure,
    undistortion: &Undistortion,
) -> Result<(Matrix3<f64>, Vector2<f64>), Error> {
    let degenerate = |reason| Error::DegenerateHomography {
        figure: figure.index,
        reason,
    };
    let mut plane_lines: Vec<Line> = Vec::with_capacity(figure.sides.len());
    let mut image_lines: Vec<Line> = Vec::with_capacity(figure.sides.len());
    let mut ideal = Vec::new();
    for side in &figure.sides {
        let first = ideal.len();
        for sample in &side.samples {
            let pixel = undistortion
                .undistort(&sample.pixel)
                .ok_or_else(|| degenerate("samples lie where the distortion is not invertible"))?;
            ideal.push((pixel, sample.weight * sample.weight));
        }
        let line = Line::fit(ideal[first..].iter().copied())
            .ok_or_else(|| degenerate("all samples of a line coincide"))?;
        plane_lines.push(side.line);
        image_lines.push(line);
    }
    let normalisation = Normalisation::of_points(ideal.iter().map(|(p, _)| p));
    let homography = normalised_homography(&plane_lines, &image_lines, normalisation)
        .map_err(|error| error.of_figure(figure.index))?;
    Ok((homography, ideal[0].0))
}

fn back_project(homography: &Matrix3<f64>, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
    let point = homography.try_inverse()? * pixel.push(1.0);
    let point = point.xy() / point.z;
    (point.x.is_finite() && point.y.is_finite()).then_some(point)
}

/// Step 3: the camera matrix from the image of the absolute conic.
pub(crate) fn conic_camera_matrix(
    homographies: &Homographies,
    size: ImageSize,
    options: &Options,
) -> Result<Matrix3<f64>, Error> {
    let known = options.known_intrinsics(&size);
    if options.fixed.focal {
        let focal = options
            .initial
            .map_or_else(Vector2::zeros, |camera| camera.focal());
        let centre = known.principal_point.unwrap_or_else(|| size.centre());
        return Ok(matrix_of(focal, centre));
    }
    camera_matrix(&homographies.of_planes(), &known)
}

/// Camera matrices to start from where the conic gives none, or a useless one: the principal
/// point at the image centre, then focal lengths from experience.
pub(crate) fn fallback_camera_matrices(
    homographies: &Homographies,
    size: ImageSize,
    options: &Options,
) -> Vec<Matrix3<f64>> {
    let known = options.known_intrinsics(&size);
    let centre = known.principal_point.unwrap_or_else(|| size.centre());
    let planes = homographies.of_planes();
    let mut starts: Vec<Matrix3<f64>> = Vec::new();
    if let Some(camera) = &options.initial {
        starts.push(camera.camera_matrix());
    }
    if options.fixed.focal {
        return starts;
    }
    for aspect in [known.aspect, Some(known.aspect.unwrap_or(1.0))] {
        let centred = KnownIntrinsics {
            aspect,
            principal_point: Some(centre),
        };
        starts.extend(camera_matrix(&planes, &centred));
    }
    let aspect = known.aspect.unwrap_or(1.0);
    starts.extend(FOCAL_GUESSES.map(|widths| {
        let focal = widths * f64::from(size.width);
        matrix_of(Vector2::new(focal, focal * aspect), centre)
    }));
    starts
}

fn matrix_of(focal: Vector2<f64>, centre: Vector2<f64>) -> Matrix3<f64> {
    Matrix3::new(
        focal.x, 0.0, centre.x, 0.0, focal.y, centre.y, 0.0, 0.0, 1.0,
    )
}

/// The camera with its poses and placements that a camera matrix and the homographies imply.
pub(crate) fn first_view(
    camera_matrix: &Matrix3<f64>,
    homographies: &Homographies,
    planes: &[ObservedPlane],
    undistortion: &Undistortion,
    size: ImageSize,
    options: &Options,
) -> Result<View<Brown>, Error> {
    let (fx, fy) = (camera_matrix.m11, camera_matrix.m22);
    let (cx, cy) = (camera_matrix.m13, camera_matrix.m23);
    let pinhole = Brown::new([fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let distortion = match (options.fixed.distortion, &options.initial) {
        (true, Some(camera)) => camera.distortion(),
        (true, None) => [0.0; 5],
        (false, _) => {
            let [k1, k2, k3] = undistortion.forward(&pinhole, size, options.model);
            [k1, k2, 0.0, 0.0, k3]
        }
    };
    let [k1, k2, p1, p2, k3] = distortion;
    let mut states = Vec::with_capacity(planes.len());
    for (i, plane) in planes.iter().enumerate() {
        let own = &homographies.figures[i];
        let pose = Pose::from_homography(camera_matrix, &own[0], &homographies.witnesses[i])
            .map_err(|error| error.of_figure(plane.figures[0].index))?;
        let mut figures = vec![Placement::IDENTITY];
        for (figure, homography) in plane.figures.iter().zip(own).skip(1) {
            figures.push(placement(figure, &own[0], homography)?);
        }
        states.push(PlaneState { pose, figures });
    }
    Ok(View {
        lens: Brown::new([fx, fy, cx, cy, k1, k2, k3, p1, p2]),
        planes: states,
    })
}

/// Where a further figure lies on the plane that the first one fixes.
fn placement(
    figure: &Figure,
    plane: &Matrix3<f64>,
    own: &Matrix3<f64>,
) -> Result<Placement, Error> {
    if figure.freedom == Freedom::Fixed {
        return Ok(Placement::IDENTITY);
    }
    let degenerate = |reason| Error::DegenerateHomography {
        figure: figure.index,
        reason,
    };
    let inverse = plane
        .try_inverse()
        .ok_or_else(|| degenerate("it is singular"))?;
    let map = inverse * own;
    // The map is a similarity but for noise: its Jacobian at the figure's origin.
    let shift = Vector2::new(map.m13, map.m23) / map.m33;
    let jacobian = (map.fixed_view::<2, 2>(0, 0) - shift * map.fixed_view::<1, 2>(2, 0)) / map.m33;
    let determinant = jacobian.determinant();
    if !(determinant > 0.0) {
        return Err(degenerate(
            "it is mirrored against the first figure on its plane",
        ));
    }
    let scale = determinant.sqrt();
    let angle = (jacobian.m21 - jacobian.m12).atan2(jacobian.m11 + jacobian.m22);
    let quarter = (angle / std::f64::consts::FRAC_PI_2).round() * std::f64::consts::FRAC_PI_2;
    let concentric = shift.norm() < CONCENTRIC_SHIFT && (angle - quarter).abs() < CONCENTRIC_ANGLE;
    let size_only =
        figure.freedom == Freedom::Size || figure.freedom == Freedom::Auto && concentric;
    Ok(if size_only {
        Placement {
            scale,
            angle: quarter,
            shift: Vector2::zeros(),
            free: 1,
        }
    } else {
        Placement {
            scale,
            angle,
            shift,
            free: 4,
        }
    })
}
