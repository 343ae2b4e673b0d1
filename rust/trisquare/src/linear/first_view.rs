//! The third of the paper's linear steps, the conic, and the first view from all three.

use nalgebra::{Matrix3, Vector2};

use super::circles::free_radii;
use super::homographies::{Homographies, Undistortion};
use crate::error::Error;
use crate::geometry::{KnownIntrinsics, Pose, aspect_of_homography, camera_matrix_from_planes};
use crate::image_size::ImageSize;
use crate::lens::Lens;
use crate::observations::{
    Figure, Freedom, ObservedPlane, Options, Placement, PlaneState, View, relations_of,
};

/// Focal lengths tried, in image widths, if the conic gives none.
const FOCAL_GUESSES: [f64; 3] = [1.0, 0.6, 2.0];

/// Maximum distance of a concentric figure's centre from that of its plane's first figure, in units
/// of the latter.
const CONCENTRIC_SHIFT: f64 = 0.05;

/// Maximum rotation (radians) of a concentric figure from a multiple of a quarter turn.
const CONCENTRIC_ANGLE: f64 = 0.09;

/// The view of some planes implied by a lens. The homographies are computed from `samples`: the
/// same planes, or fewer samples of them.
pub(crate) fn view_by_lens<L: Lens>(
    lens: &L,
    samples: &[ObservedPlane],
    planes: &[ObservedPlane],
    size: ImageSize,
    options: &Options<L>,
) -> Result<View<L>, Error> {
    let known = Undistortion::Known(*lens);
    let homographies = Homographies::estimate(samples, &known)?;
    let matrix = lens.camera_matrix();
    first_view(&matrix, &homographies, planes, &known, size, options)
}

/// Step 3: the camera matrix from the image of the absolute conic, under the assumption of zero
/// skew.
pub(crate) fn conic_camera_matrix<L: Lens>(
    homographies: &Homographies,
    size: ImageSize,
    options: &Options<L>,
) -> Result<Matrix3<f64>, Error> {
    let known = options.known_intrinsics(&size);
    if options.fixed.focal {
        let focal = options
            .initial
            .map_or_else(Vector2::zeros, |camera| camera.focal());
        let centre = known.principal_point.unwrap_or_else(|| size.centre());
        return Ok(options.with_known_skew(matrix_of(focal, centre)));
    }
    let found = camera_matrix_from_planes(&homographies.of_planes(), &known)?;
    Ok(options.with_known_skew(found))
}

/// Starting camera matrices in case the conic gives none, or a useless one: the principal point at
/// the image centre, then typical focal lengths.
pub(crate) fn fallback_camera_matrices<L: Lens>(
    homographies: &Homographies,
    size: ImageSize,
    options: &Options<L>,
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
        let found = camera_matrix_from_planes(&planes, &centred);
        starts.extend(found.map(|found| options.with_known_skew(found)));
    }
    starts.extend(guessed_camera_matrices(FOCAL_GUESSES, size, options));
    starts
}

/// Camera matrices with focal lengths in image widths, and all else as known; none if the focal
/// length is fixed.
pub(crate) fn guessed_camera_matrices<L: Lens>(
    focals: [f64; 3],
    size: ImageSize,
    options: &Options<L>,
) -> impl Iterator<Item = Matrix3<f64>> + use<L> {
    let known = options.known_intrinsics(&size);
    let centre = known.principal_point.unwrap_or_else(|| size.centre());
    let (is_free, aspect) = (!options.fixed.focal, known.aspect.unwrap_or(1.0));
    let focals = focals.into_iter().filter(move |_| is_free);
    let options = *options;
    focals.map(move |widths| {
        let focal = widths * f64::from(size.width);
        options.with_known_skew(matrix_of(Vector2::new(focal, focal * aspect), centre))
    })
}

fn matrix_of(focal: Vector2<f64>, centre: Vector2<f64>) -> Matrix3<f64> {
    Matrix3::new(
        focal.x, 0.0, centre.x, 0.0, focal.y, centre.y, 0.0, 0.0, 1.0,
    )
}

/// The camera with its poses and placements implied by a camera matrix and the homographies.
pub(crate) fn first_view<L: Lens>(
    camera_matrix: &Matrix3<f64>,
    homographies: &Homographies,
    planes: &[ObservedPlane],
    undistortion: &Undistortion<L>,
    size: ImageSize,
    options: &Options<L>,
) -> Result<View<L>, Error> {
    let lens = match (options.fixed.distortion, &options.initial) {
        (true, Some(camera)) => camera.with_camera_matrix(camera_matrix),
        (true, None) => L::from_camera_matrix(camera_matrix),
        (false, _) => undistortion.lens(camera_matrix, size, options.model),
    };
    let mut states = Vec::with_capacity(planes.len());
    for (i, plane) in planes.iter().enumerate() {
        let plane_homographies = &homographies.figures[i];
        let mut first = Placement::IDENTITY;
        let mut homography = plane_homographies[0];
        let mut witness = homographies.witnesses[i];
        if plane.has_any_aspect() {
            first.free = Placement::ASPECT;
            first.stretch = aspect_of_homography(camera_matrix, &homography).ok_or(
                Error::DegenerateHomography {
                    figure: plane.figures[0].index,
                    reason: "its aspect is not determined",
                },
            )?;
            homography.column_mut(0).unscale_mut(first.stretch);
            witness.x *= first.stretch;
        }
        let pose = Pose::from_homography(camera_matrix, &homography, &witness)
            .map_err(|error| error.of_figure(plane.figures[0].index))?;
        let mut figures = vec![first];
        for (figure, figure_homography) in plane.figures.iter().zip(plane_homographies).skip(1) {
            figures.push(placement(figure, &homography, figure_homography)?);
        }
        let round = plane
            .figures
            .iter()
            .zip(plane_homographies)
            .zip(&mut figures);
        for ((figure, homography), placement) in round.filter(|((f, _), _)| f.is_round()) {
            placement.is_round = true;
            placement.radii = free_radii(figure, homography, &|pixel: &_| {
                undistortion.undistort(pixel)
            })?;
        }
        states.push(PlaneState { pose, figures });
    }
    let mut view = View {
        lens,
        planes: states,
        relations: relations_of(planes),
    };
    view.hold_relations();
    Ok(view)
}

/// Placement of a further figure on the plane defined by the first one.
fn placement(
    figure: &Figure,
    plane: &Matrix3<f64>,
    figure_homography: &Matrix3<f64>,
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
    let map = inverse * figure_homography;
    // Up to noise the map is a similarity: its Jacobian at the figure's origin.
    let shift = Vector2::new(map.m13, map.m23) / map.m33;
    if let (Freedom::Offsets, Some(line)) = (figure.freedom, figure.sides[0].line()) {
        return Ok(Placement {
            shift,
            free: Placement::offset(&line),
            ..Placement::IDENTITY
        });
    }
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
    let is_concentric =
        shift.norm() < CONCENTRIC_SHIFT && (angle - quarter).abs() < CONCENTRIC_ANGLE;
    let is_size_only =
        figure.freedom == Freedom::Size || figure.freedom == Freedom::Auto && is_concentric;
    Ok(if is_size_only {
        Placement {
            scale,
            angle: quarter,
            shift: Vector2::zeros(),
            free: Placement::SIZE,
            ..Placement::IDENTITY
        }
    } else {
        Placement {
            scale,
            angle,
            shift,
            free: match figure.is_round() {
                true => Placement::SIZE_AND_CENTRE,
                false => Placement::SIMILARITY,
            },
            ..Placement::IDENTITY
        }
    })
}
