//! The homography of a plane from the images of two circles on it, which are conics.
//!
//! In the plane's frame the first circle is the unit circle about the origin; the rotation about
//! the origin is arbitrary. Image coordinates should be of the order of 1.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};

use super::normalisation::Normalisation;

/// Maximum number of sweeps of the eigendecomposition; a few suffice.
const MAX_SWEEPS: usize = 100;

/// Maximum number of power iterations. For radii that differ by a tenth, each one reduces the error
/// by a fifth.
const MAX_STEPS: usize = 300;

/// Change of a unit vector below which the power iteration has converged: rounding.
const CONVERGED_CHANGE: f64 = 1e-14;

/// The ellipse `x^T C x = 0` that fits points best, with `x^T C x` negative inside; `None` if the
/// best conic is not an ellipse.
///
/// Minimises the algebraic distance in normalised coordinates.
pub(crate) fn fit_ellipse(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let normalising = Normalisation::of_points(points.iter())?.matrix();
    let mut gram = SMatrix::<f64, 6, 6>::zeros();
    for point in points {
        let p = normalising * point.push(1.0);
        let row = SVector::<f64, 6>::from([p.x * p.x, p.x * p.y, p.y * p.y, p.x, p.y, 1.0]);
        gram.ger(1.0, &row, &row, 1.0);
    }
    let eigen = SymmetricEigen::try_new(gram, f64::EPSILON, MAX_SWEEPS)?;
    let [a, b, c, d, e, f] = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned()
        .into();
    let conic = Matrix3::new(
        a,
        0.5 * b,
        0.5 * d,
        0.5 * b,
        c,
        0.5 * e,
        0.5 * d,
        0.5 * e,
        f,
    );
    let is_ellipse = a * c > 0.25 * b * b && conic.determinant() * a < 0.0;
    // The normalising map is a similarity.
    is_ellipse.then(|| normalising.tr_mul(&(conic * a.signum())) * normalising)
}

/// The area of an ellipse.
pub(crate) fn area(ellipse: &Matrix3<f64>) -> f64 {
    let quadratic = ellipse.fixed_view::<2, 2>(0, 0).determinant();
    std::f64::consts::PI * ellipse.determinant().abs() / quadratic.powf(1.5)
}

/// The homography of a plane from two concentric circles, with the outer one as the unit circle.
///
/// The image `o` of the centre is the one point with the same polar line `l` in both conics, and
/// `l` is the plane's vanishing line (J.-S. Kim, P. Gurdjos & I.-S. Kweon, IEEE PAMI 27 (2005)
/// 637-642). `o` is the eigenvector of `inner^-1 outer` with the single eigenvalue, which is the
/// largest.
pub(crate) fn concentric_homography(
    inner: &Matrix3<f64>,
    outer: &Matrix3<f64>,
) -> Option<Matrix3<f64>> {
    let map = inner.try_inverse()? * outer;
    let mut centre = map * Vector3::z();
    for _ in 0..MAX_STEPS {
        let before = centre;
        centre = (map * before).normalize();
        if before.cross(&centre).norm() < CONVERGED_CHANGE {
            break;
        }
    }
    circle_homography(outer, &centre)
}

/// The homography of a plane from two circles beside each other, with the first one as the unit
/// circle; `None` if they intersect or one is inside the other.
///
/// The pencil of the two conics contains three degenerate ones. One of these is a pair of real
/// lines: the radical axis, which runs between the circles, and the vanishing line, which does not.
pub(crate) fn separate_homography(
    first: &Matrix3<f64>,
    second: &Matrix3<f64>,
) -> Option<Matrix3<f64>> {
    let (first_inverse, second_inverse) = (first.try_inverse()?, second.try_inverse()?);
    // The pole of the line at infinity is the centre of an ellipse, hence inside it.
    let centres = [first_inverse, second_inverse].map(|inverse| inverse * Vector3::z());
    let is_between = |line: &Vector3<f64>| {
        let [a, b] = [0, 1].map(|i: usize| line.dot(&centres[i]) / centres[i].z);
        a * b < 0.0
    };
    for ratio in real_eigenvalues(&(second_inverse * first))? {
        let degenerate = first - second * ratio;
        let eigen = SymmetricEigen::try_new(degenerate, f64::EPSILON, MAX_SWEEPS)?;
        let (high, low) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
        let part = |i: usize| eigen.eigenvectors.column(i) * eigen.eigenvalues[i].abs().sqrt();
        let lines = [part(high) + part(low), part(high) - part(low)];
        let is_pair = eigen.eigenvalues[high] > 0.0 && eigen.eigenvalues[low] < 0.0;
        let vanishing = match [is_between(&lines[0]), is_between(&lines[1])] {
            [true, false] if is_pair => lines[1],
            [false, true] if is_pair => lines[0],
            _ => continue,
        };
        let found = circle_homography(first, &(first_inverse * vanishing));
        if found.is_some() {
            return found;
        }
    }
    None
}

/// The eigenvalues of a matrix as roots of its characteristic polynomial; `None` unless all three
/// are real.
fn real_eigenvalues(matrix: &Matrix3<f64>) -> Option<[f64; 3]> {
    let mean = matrix.trace() / 3.0;
    let deviator = matrix - Matrix3::identity() * mean;
    let spread = ((deviator * deviator).trace() / 6.0).sqrt();
    let cosine = 0.5 * deviator.determinant() / spread.powi(3);
    let angle = (cosine.abs() <= 1.0).then(|| cosine.acos() / 3.0)?;
    let third = std::f64::consts::TAU / 3.0;
    Some([0.0, 1.0, 2.0].map(|i| mean + 2.0 * spread * (angle + i * third).cos()))
}

/// The homography of a plane from the ellipse that is the image of the unit circle, and the image
/// of the circle's centre.
///
/// The centre's polar line is the plane's vanishing line. Any two points on it that are conjugate
/// with respect to the ellipse are images of orthogonal directions.
fn circle_homography(ellipse: &Matrix3<f64>, centre: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let centre = centre / centre.z;
    let polar = ellipse * centre;
    let form = |a: &Vector3<f64>| a.dot(&(ellipse * a));
    let first = polar.cross(&Vector3::ith(polar.iamin(), 1.0));
    let second = (ellipse * first).cross(&polar);
    let columns = [
        first / form(&first).sqrt(),
        second / form(&second).sqrt(),
        centre / (-form(&centre)).sqrt(),
    ];
    let mut homography = Matrix3::from_columns(&columns);
    // Choose the orientation in which the plane is seen from the side where X turns to Y as x to y
    // on the screen.
    if homography.determinant() < 0.0 {
        homography.column_mut(1).neg_mut();
    }
    let is_finite = homography.iter().all(|v| v.is_finite());
    is_finite.then_some(homography)
}

/// The centre and radius of the circle that fits points best (I. Kasa, IEEE Transactions on
/// Instrumentation and Measurement 25 (1976) 8-14).
pub(crate) fn fit_circle(points: &[Vector2<f64>]) -> Option<(Vector2<f64>, f64)> {
    let normalisation = Normalisation::of_points(points.iter())?;
    let (mut gram, mut moment) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        let p = (point - normalisation.centre) * normalisation.scale;
        let row = p.push(1.0);
        gram += row * row.transpose();
        moment += row * p.norm_squared();
    }
    let solution = gram.cholesky()?.solve(&moment);
    let centre = 0.5 * solution.xy();
    let radius = (solution.z + centre.norm_squared()).sqrt() / normalisation.scale;
    let centre = centre / normalisation.scale + normalisation.centre;
    (radius.is_finite() && radius > 0.0).then_some((centre, radius))
}

#[cfg(test)]
mod tests {
    use super::super::pose::Pose;
    use super::*;
    use nalgebra::Rotation3;

    const ROUND: f64 = std::f64::consts::TAU;

    /// The homography of a plane, and the ellipses fitted to images of arcs of circles
    /// `(radius, x)` on it; `part` is the angle of the arcs.
    fn seen(circles: &[(f64, f64)], part: f64) -> (Matrix3<f64>, Vec<Matrix3<f64>>) {
        let camera = Matrix3::new(1.8, 0.0, 0.1, 0.0, 1.7, -0.2, 0.0, 0.0, 1.0);
        let pose = Pose {
            rotation: *Rotation3::from_euler_angles(0.7, -0.4, 0.3).matrix(),
            translation: Vector3::new(0.3, -0.2, 5.0),
        };
        let homography = camera * pose.homography();
        let point = |(radius, x): (f64, f64), i: u32| {
            let angle = part * f64::from(i) / 40.0;
            let p = homography * Vector3::new(x + radius * angle.cos(), radius * angle.sin(), 1.0);
            p.xy() / p.z
        };
        let ellipse = |circle: &(f64, f64)| {
            let points: Vec<_> = (0..40).map(|i| point(*circle, i)).collect();
            fit_ellipse(&points).unwrap()
        };
        (homography, circles.iter().map(ellipse).collect())
    }

    /// Whether two homographies differ only by a rotation of the plane about its origin.
    fn agree(found: &Matrix3<f64>, truth: &Matrix3<f64>) -> bool {
        let turn = found.try_inverse().unwrap() * truth;
        let turn = turn / turn.m33;
        let expected = Rotation3::from_axis_angle(&Vector3::z_axis(), turn.m21.atan2(turn.m11));
        (turn - expected.matrix()).norm() < 1e-6
    }

    #[test]
    fn two_concentric_circles_give_their_plane() {
        for (ratio, part) in [(0.5, ROUND), (0.9, ROUND), (0.5, 0.6 * ROUND)] {
            let (truth, ellipses) = seen(&[(ratio, 0.0), (1.0, 0.0)], part);
            assert!(area(&ellipses[0]) < area(&ellipses[1]));
            let found = concentric_homography(&ellipses[0], &ellipses[1]).unwrap();
            assert!(agree(&found, &truth), "{found}");
        }
    }

    #[test]
    fn two_circles_beside_each_other_give_their_plane() {
        for circle in [(0.3, 1.5), (0.8, -1.9), (1.0, 2.1)] {
            let (truth, ellipses) = seen(&[(1.0, 0.0), circle], ROUND);
            let found = separate_homography(&ellipses[0], &ellipses[1]).unwrap();
            assert!(agree(&found, &truth), "{found}");
        }
        for circle in [(1.0, 0.5), (0.3, 0.4)] {
            let (_, ellipses) = seen(&[(1.0, 0.0), circle], ROUND);
            assert!(separate_homography(&ellipses[0], &ellipses[1]).is_none());
        }
    }

    #[test]
    fn what_is_no_ellipse_is_refused() {
        let line: Vec<_> = (0..9).map(|i| Vector2::new(f64::from(i), 5.0)).collect();
        assert!(fit_ellipse(&line).is_none());
        let hyperbola = (1..20).map(|i| Vector2::new(f64::from(i), 100.0 / f64::from(i)));
        assert!(fit_ellipse(&hyperbola.collect::<Vec<_>>()).is_none());
        assert!(fit_ellipse(&[Vector2::repeat(f64::NAN); 9]).is_none());
    }

    #[test]
    fn a_circle_is_fitted() {
        let at = |i: u32| Vector2::new(f64::from(i).cos(), f64::from(i).sin()) * 7.0;
        let points: Vec<_> = (0..9).map(|i| at(i) + Vector2::new(300.0, -20.0)).collect();
        let (centre, radius) = fit_circle(&points).unwrap();
        assert!((centre - Vector2::new(300.0, -20.0)).norm() < 1e-11);
        assert!((radius - 7.0).abs() < 1e-11);
    }
}
