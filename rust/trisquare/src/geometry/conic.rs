//! Step 3: the camera matrix from the image of the absolute conic.

use nalgebra::{DMatrix, Matrix3, SVector, Vector2, Vector3};

use crate::error::Error;

/// Maximum number of sweeps of the singular value decomposition; a few per column suffice.
const MAX_SVD_SWEEPS: usize = 1000;

/// Ratio of the second smallest to the largest singular value below which the constraints leave
/// more than the scale undetermined.
const RANK_TOLERANCE: f64 = 1e-9;

/// Entries of a conic for zero skew: `w11, w13, w22, w23, w33`.
type ConicVector = SVector<f64, 5>;

/// Coefficients of one homogeneous linear equation in these entries.
type ConicConstraint = ConicVector;

/// Coefficients of `h^T omega g` in these entries.
fn bilinear(h: &Vector3<f64>, g: &Vector3<f64>) -> ConicConstraint {
    ConicConstraint::new(
        h.x * g.x,
        h.x * g.z + h.z * g.x,
        h.y * g.y,
        h.y * g.z + h.z * g.y,
        h.z * g.z,
    )
}

/// Known parts of a camera matrix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnownIntrinsics {
    /// The ratio `fy / fx`.
    pub aspect: Option<f64>,
    /// The principal point, in pixels.
    pub principal_point: Option<Vector2<f64>>,
}

impl KnownIntrinsics {
    /// Number of parameters of the camera matrix that remain unknown.
    pub fn unknowns(&self) -> usize {
        let focal = if self.aspect.is_some() { 1 } else { 2 };
        focal + if self.principal_point.is_some() { 0 } else { 2 }
    }
}

/// The camera matrix `K`, in pixels, with `omega ~ K^-T K^-1`, from the homographies of planes.
///
/// With zero skew there are four unknowns, and every plane gives two equations: two well-tilted
/// planes may suffice, three over-determine them (Hartley & Zisserman, 2nd ed., section 8.5; Zhou
/// et al. 2013, step 3).
///
/// ```
/// use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
/// use trisquare::{Pose, camera_matrix_from_homographies};
///
/// let k = Matrix3::new(900.0, 0.0, 640.0, 0.0, 905.0, 480.0, 0.0, 0.0, 1.0);
/// let homographies = [[0.6, 0.0, 0.1], [-0.3, 0.5, 0.0], [-0.3, -0.5, 0.2]].map(|tilt| {
///     let pose = Pose {
///         rotation: *Rotation3::new(Vector3::from(tilt)).matrix(),
///         translation: Vector3::new(0.1, -0.2, 3.0),
///     };
///     k * pose.homography()
/// });
/// let found = camera_matrix_from_homographies(&homographies)?;
/// assert!((found - k).norm() < 1e-6);
///
/// let pose = Pose::from_homography(&found, &homographies[0], &Vector2::zeros())?;
/// assert!((pose.translation.z - 3.0).abs() < 1e-9);
/// # Ok::<(), trisquare::Error>(())
/// ```
///
/// # Errors
/// [`Error::NotEnoughPlanes`], [`Error::UndeterminedConic`] (parallel planes) or
/// [`Error::IndefiniteConic`] (planes that disagree).
pub fn camera_matrix_from_homographies(
    homographies: &[Matrix3<f64>],
) -> Result<Matrix3<f64>, Error> {
    let planes = homographies.iter().map(PlaneHomography::from_square);
    camera_matrix_from_planes(&planes.collect::<Vec<_>>(), &KnownIntrinsics::default())
}

/// A plane's homography, and whether its figure is a rectangle of unknown aspect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlaneHomography {
    pub homography: Matrix3<f64>,
    pub has_any_aspect: bool,
}

impl PlaneHomography {
    fn from_square(homography: &Matrix3<f64>) -> Self {
        Self {
            homography: *homography,
            has_any_aspect: false,
        }
    }

    /// The equations `h1^T omega h2 = 0` and, for a known aspect, `h1^T omega h1 = h2^T omega h2`
    /// (Hartley & Zisserman, 2nd ed., section 8.5).
    fn constraints(
        &self,
        normalising: &Matrix3<f64>,
    ) -> impl Iterator<Item = ConicConstraint> + use<> {
        let homography = normalising * self.homography;
        let [h1, h2] = [0, 1].map(|i| homography.column(i).into_owned());
        let lengths = (!self.has_any_aspect).then(|| bilinear(&(h1 + h2), &(h1 - h2)));
        std::iter::once(bilinear(&h1, &h2)).chain(lengths)
    }
}

/// Ratio of the lengths along X and Y, on the plane, of the unit square that a homography maps,
/// given the camera matrix; `None` if it is not a positive number.
pub(crate) fn aspect_of_homography(
    camera_matrix: &Matrix3<f64>,
    homography: &Matrix3<f64>,
) -> Option<f64> {
    let rays = camera_matrix.try_inverse()? * homography;
    let aspect = rays.column(0).norm() / rays.column(1).norm();
    (aspect.is_finite() && aspect > 0.0).then_some(aspect)
}

/// Same as [`camera_matrix_from_homographies`] for planes that may show a rectangle of unknown
/// aspect, with part of the camera matrix known.
pub(crate) fn camera_matrix_from_planes(
    planes: &[PlaneHomography],
    known: &KnownIntrinsics,
) -> Result<Matrix3<f64>, Error> {
    let unknowns = known.unknowns();
    let needed = unknowns.div_ceil(2);
    if planes.len() < needed {
        return Err(Error::NotEnoughPlanes {
            found: planes.len(),
            needed,
            free: format!("{unknowns} of fx, fy, cx, cy"),
        });
    }
    let homographies: Vec<Matrix3<f64>> = planes.iter().map(|plane| plane.homography).collect();
    if homographies
        .iter()
        .any(|h| h.iter().any(|v| !v.is_finite()))
    {
        return Err(Error::NotFinite {
            what: "a homography",
        });
    }
    let frame = ConicFrame::around(&homographies, known);
    let constraints: Vec<ConicConstraint> = planes
        .iter()
        .flat_map(|plane| plane.constraints(&frame.normalising))
        .collect();
    let conic = solve_conic(&constraints, known)?;
    Ok(frame.denormalise(&conic_intrinsics(&conic)?))
}

/// Coordinates in which the conic is well-conditioned: their origin is the mean of the imaged
/// points (or the known principal point), their unit the points' rms distance from it, and pixels
/// are square if the aspect is known.
struct ConicFrame {
    normalising: Matrix3<f64>,
    centre: Vector2<f64>,
    scale: Vector2<f64>,
}

impl ConicFrame {
    fn around(homographies: &[Matrix3<f64>], known: &KnownIntrinsics) -> Self {
        // The images of each plane's origin and of two points beside it represent the extent of the
        // picture.
        let mut points = Vec::with_capacity(3 * homographies.len());
        for h in homographies {
            for point in [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)] {
                let image = h * Vector3::new(point.0, point.1, 1.0);
                points.push(image.xy() / image.z);
            }
        }
        points.retain(|p| p.x.is_finite() && p.y.is_finite());
        let count = points.len().max(1) as f64;
        let mean = points.iter().sum::<Vector2<f64>>() / count;
        let centre = known.principal_point.unwrap_or(mean);
        let square: f64 = points
            .iter()
            .map(|p| (p - centre).norm_squared())
            .sum::<f64>()
            / count;
        let size = if square > 0.0 { square.sqrt() } else { 1.0 };
        let scale = Vector2::new(size, size * known.aspect.unwrap_or(1.0));
        let normalising = Matrix3::new(
            1.0 / scale.x,
            0.0,
            -centre.x / scale.x,
            0.0,
            1.0 / scale.y,
            -centre.y / scale.y,
            0.0,
            0.0,
            1.0,
        );
        Self {
            normalising,
            centre,
            scale,
        }
    }

    fn denormalise(&self, [fx, fy, cx, cy]: &[f64; 4]) -> Matrix3<f64> {
        Matrix3::new(
            fx * self.scale.x,
            0.0,
            cx * self.scale.x + self.centre.x,
            0.0,
            fy * self.scale.y,
            cy * self.scale.y + self.centre.y,
            0.0,
            0.0,
            1.0,
        )
    }
}

/// The conic that fits homogeneous constraints best, in coordinates where the known principal point
/// is the origin and a known aspect is 1.
///
/// # Errors
/// [`Error::UndeterminedConic`] if the constraints leave more than the scale undetermined.
fn solve_conic(
    constraints: &[ConicConstraint],
    known: &KnownIntrinsics,
) -> Result<[f64; 5], Error> {
    // Directions in the space of conics that the remaining unknowns span.
    let mut basis: Vec<ConicVector> = Vec::with_capacity(5);
    let unit = |i: usize| ConicVector::ith(i, 1.0);
    if known.aspect.is_some() {
        basis.push(unit(0) + unit(2));
    } else {
        basis.extend([unit(0), unit(2)]);
    }
    if known.principal_point.is_none() {
        basis.extend([unit(1), unit(3)]);
    }
    basis.push(unit(4));

    // Padded with zero rows, as the decomposition's right-hand factor must be square.
    let rows = constraints.len().max(basis.len());
    let mut design = DMatrix::zeros(rows, basis.len());
    for (i, constraint) in constraints.iter().enumerate() {
        let norm = constraint.norm();
        if norm > 0.0 {
            for (j, direction) in basis.iter().enumerate() {
                design[(i, j)] = constraint.dot(direction) / norm;
            }
        }
    }
    let undetermined = |ratio| Error::UndeterminedConic { ratio };
    // The decomposition panics on NaN, which overflow in the constraints produces.
    if !design.iter().all(|v| v.is_finite()) {
        return Err(undetermined(0.0));
    }
    let svd = design
        .try_svd(false, true, f64::EPSILON, MAX_SVD_SWEEPS)
        .ok_or_else(|| undetermined(0.0))?;
    let values = &svd.singular_values;
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let ratio = values[order[1]] / values[order[order.len() - 1]];
    if !(ratio > RANK_TOLERANCE) {
        return Err(undetermined(if ratio.is_nan() { 0.0 } else { ratio }));
    }
    let v_t = svd.v_t.ok_or_else(|| undetermined(0.0))?;
    let mut conic = ConicVector::zeros();
    for (j, direction) in basis.iter().enumerate() {
        conic += direction * v_t[(order[0], j)];
    }
    Ok(conic.into())
}

/// `fx, fy, cx, cy` of `omega ~ K^-T K^-1`, in the conic's own coordinates.
///
/// Uses the closed form of the Cholesky factor of a conic for zero skew.
///
/// # Errors
/// [`Error::IndefiniteConic`] if `omega` is not definite.
fn conic_intrinsics(conic: &[f64; 5]) -> Result<[f64; 4], Error> {
    let [w11, w13, w22, w23, w33] = *conic;
    let (cx, cy) = (-w13 / w11, -w23 / w22);
    let lambda = w33 - w13 * w13 / w11 - w23 * w23 / w22;
    let (fx2, fy2) = (lambda / w11, lambda / w22);
    // Written so that NaN is refused, too.
    if !(fx2 > 0.0 && fy2 > 0.0 && fx2.is_finite() && fy2.is_finite()) {
        return Err(Error::IndefiniteConic);
    }
    Ok([fx2.sqrt(), fy2.sqrt(), cx, cy])
}

#[cfg(test)]
mod tests {
    use super::super::pose::Pose;
    use super::*;
    use nalgebra::Rotation3;

    fn homographies(camera: &Matrix3<f64>, angles: &[(f64, f64)]) -> Vec<Matrix3<f64>> {
        angles
            .iter()
            .map(|(a, b)| {
                let pose = Pose {
                    rotation: *Rotation3::from_euler_angles(*a, *b, 0.3).matrix(),
                    translation: Vector3::new(*b, -*a, 3.0),
                };
                camera * pose.homography() * (1.0 + a)
            })
            .collect()
    }

    fn camera() -> Matrix3<f64> {
        Matrix3::new(1200.0, 0.0, 650.0, 0.0, 1190.0, 470.0, 0.0, 0.0, 1.0)
    }

    #[test]
    fn three_planes_give_the_camera_matrix() {
        let planes = homographies(&camera(), &[(0.5, 0.1), (-0.3, 0.6), (-0.4, -0.5)]);
        let found = camera_matrix_from_homographies(&planes).unwrap();
        assert!((found - camera()).norm() < 1e-9 * camera().norm());
    }

    #[test]
    fn known_intrinsics_need_fewer_planes() {
        let planes = homographies(&camera(), &[(0.5, 0.3)]);
        assert!(matches!(
            camera_matrix_from_homographies(&planes),
            Err(Error::NotEnoughPlanes { needed: 2, .. })
        ));
        let planes: Vec<_> = planes.iter().map(PlaneHomography::from_square).collect();
        let known = KnownIntrinsics {
            aspect: None,
            principal_point: Some(Vector2::new(650.0, 470.0)),
        };
        let found = camera_matrix_from_planes(&planes, &known).unwrap();
        assert!((found - camera()).norm() < 1e-9 * camera().norm());
        let known = KnownIntrinsics {
            aspect: Some(1190.0 / 1200.0),
            ..known
        };
        let found = camera_matrix_from_planes(&planes, &known).unwrap();
        assert!((found - camera()).norm() < 1e-9 * camera().norm());
    }

    #[test]
    fn parallel_planes_and_indefinite_conics_are_refused() {
        let planes = homographies(&camera(), &[(0.5, 0.1); 3]);
        assert!(matches!(
            camera_matrix_from_homographies(&planes),
            Err(Error::UndeterminedConic { .. })
        ));
        assert_eq!(
            conic_intrinsics(&[1.0, 0.0, -1.0, 0.0, 1.0]),
            Err(Error::IndefiniteConic)
        );
    }
}
