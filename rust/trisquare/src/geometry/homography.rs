//! Step 2: the homography of a plane from line correspondences (normalised DLT).

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::line::Line;
use super::normalisation::Normalisation;
use crate::error::Error;

/// Minimum number of lines for a homography; no three of them may meet in one point.
pub const MIN_LINES: usize = 4;

/// Maximum number of sweeps of the singular value decomposition; a few per column suffice.
const MAX_SVD_SWEEPS: usize = 1000;

/// Ratio of the second smallest to the largest singular value below which the lines leave more than
/// the scale undetermined.
const RANK_TOLERANCE: f64 = 1e-10;

const TOO_LARGE: &str = "their coordinates are too large";

/// Estimates `H_image_from_plane` from lines of the plane and their images.
///
/// Every correspondence gives `l_plane x (H^T l_image) = 0`, solved in the least-squares sense
/// with unit-normal lines (Hartley & Zisserman, 2nd ed., section 4.1; for lines and their
/// normalisation Zeng, Deng & Hu, Pattern Recognition Letters 29 (2008) 1236-1244). The result
/// has unit Frobenius norm.
///
/// ```
/// use nalgebra::Vector3;
/// use trisquare::{Line, homography_from_lines};
///
/// // The sides of a unit square, and their images: 200 px apart about (320, 240).
/// let square = [(0.0, 1.0, 0.5), (-1.0, 0.0, 0.5), (0.0, -1.0, 0.5), (1.0, 0.0, 0.5)];
/// let seen = [(0.0, 1.0, -140.0), (1.0, 0.0, -420.0), (0.0, 1.0, -340.0), (1.0, 0.0, -220.0)];
/// let lines = |all: [(f64, f64, f64); 4]| all.map(|(a, b, c)| Line::new(a, b, c).unwrap());
/// let homography = homography_from_lines(&lines(square), &lines(seen))?;
/// let corner = homography * Vector3::new(0.5, 0.5, 1.0);
/// assert!((corner.xy() / corner.z - nalgebra::Vector2::new(420.0, 340.0)).norm() < 1e-9);
/// # Ok::<(), trisquare::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidArgument`] for unequal numbers of lines, [`Error::TooFewLines`] for fewer than
/// four, [`Error::DegenerateHomography`] if three of four lines meet in a point or are parallel.
pub fn homography_from_lines(
    plane_lines: &[Line],
    image_lines: &[Line],
) -> Result<Matrix3<f64>, Error> {
    let image = Normalisation::of_lines(image_lines);
    normalised_homography(plane_lines, image_lines, image)
}

/// Same as [`homography_from_lines`], with the image's normalisation given: callers measure it on
/// the edge samples.
pub(crate) fn normalised_homography(
    plane_lines: &[Line],
    image_lines: &[Line],
    image: Option<Normalisation>,
) -> Result<Matrix3<f64>, Error> {
    if plane_lines.len() != image_lines.len() {
        return Err(Error::InvalidArgument(format!(
            "{} plane lines cannot correspond to {} image lines",
            plane_lines.len(),
            image_lines.len()
        )));
    }
    if plane_lines.len() < MIN_LINES {
        return Err(Error::TooFewLines {
            figure: 0,
            found: plane_lines.len(),
            needed: MIN_LINES,
        });
    }
    let degenerate = |reason| Error::DegenerateHomography { figure: 0, reason };
    let plane = Normalisation::of_lines(plane_lines)
        .ok_or_else(|| degenerate("the plane's lines meet in one point or are parallel"))?;
    let image =
        image.ok_or_else(|| degenerate("the image lines meet in one point or are parallel"))?;

    let design = design_matrix(plane_lines.iter().zip(image_lines), &plane, &image);
    let normalised = null_direction(design).map_err(degenerate)?;
    let homography = image.inverse() * normalised * plane.matrix();
    let norm = homography.norm();
    // An overflow here would look like a map of everything to zero.
    if !(norm > 0.0 && norm.is_finite()) {
        return Err(degenerate(TOO_LARGE));
    }
    Ok(homography / norm)
}

/// Coefficients of the three equations per pair of lines in the entries, row by row, of a map
/// between normalised coordinates.
fn design_matrix<'a>(
    pairs: impl ExactSizeIterator<Item = (&'a Line, &'a Line)>,
    plane: &Normalisation,
    image: &Normalisation,
) -> DMatrix<f64> {
    let mut design = DMatrix::zeros(3 * pairs.len(), 9);
    for (i, (plane_line, image_line)) in pairs.enumerate() {
        let from = unit_normal(plane.inverse().transpose() * plane_line.coefficients());
        let to = unit_normal(image.inverse().transpose() * image_line.coefficients());
        let cross = from.cross_matrix();
        for row in 0..3 {
            for column in 0..3 {
                for k in 0..3 {
                    // (H^T to)_column = sum_k H_(k, column) to_k
                    design[(3 * i + row, 3 * k + column)] = cross[(row, column)] * to[k];
                }
            }
        }
    }
    design
}

/// The map that solves the equations best, up to scale, or the reason why there is none.
fn null_direction(design: DMatrix<f64>) -> Result<Matrix3<f64>, &'static str> {
    const CONCURRENT: &str = "three of them meet in one point or are parallel";
    // The decomposition panics on NaN, which overflow in the coordinates produces.
    if !design.iter().all(|v| v.is_finite()) {
        return Err(TOO_LARGE);
    }
    let svd = design
        .try_svd(false, true, f64::EPSILON, MAX_SVD_SWEEPS)
        .ok_or("its singular values did not settle")?;
    let values = &svd.singular_values;
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    // Written so that NaN is not taken for full rank.
    if !(values[order[1]] > RANK_TOLERANCE * values[order[8]]) {
        return Err(CONCURRENT);
    }
    let v_t = svd.v_t.ok_or("its singular vectors were not found")?;
    let map = Matrix3::from_row_iterator(v_t.row(order[0]).iter().copied());
    // If three concurrent lines have images that are not concurrent, the solution is a singular
    // map.
    if map.determinant().abs() < RANK_TOLERANCE {
        return Err(CONCURRENT);
    }
    Ok(map)
}

fn unit_normal(line: Vector3<f64>) -> Vector3<f64> {
    line / line.xy().norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    fn square() -> Vec<Line> {
        [(0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0)]
            .iter()
            .map(|(a, b)| Line::new(*a, *b, 0.5).unwrap())
            .collect()
    }

    fn images(homography: &Matrix3<f64>, lines: &[Line]) -> Vec<Line> {
        let back = homography.try_inverse().unwrap().transpose();
        lines
            .iter()
            .map(|line| {
                let image = back * line.coefficients();
                Line::new(image.x, image.y, image.z).unwrap()
            })
            .collect()
    }

    #[test]
    fn recovers_a_homography_even_with_a_line_through_the_origin() {
        for (x, y) in [(400.0, 300.0), (100.0, 0.0), (0.0, 0.0), (-3000.0, 2500.0)] {
            let truth = Matrix3::new(200.0, -40.0, x, 30.0, 180.0, y, 1e-4, -2e-4, 1.0);
            let mut plane = square();
            plane.push(Line::new(1.0, 1.0, 0.1).unwrap());
            for lines in [&plane[..4], &plane[..]] {
                let found = homography_from_lines(lines, &images(&truth, lines)).unwrap();
                let found = found / found[(2, 2)];
                for corner in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)] {
                    let corner = Vector2::new(corner.0, corner.1).push(1.0);
                    let (a, b) = (found * corner, truth * corner);
                    assert!((a.xy() / a.z - b.xy() / b.z).norm() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn refuses_lines_that_leave_it_open() {
        let plane = square();
        assert!(matches!(
            homography_from_lines(&plane[..3], &plane[..3]),
            Err(Error::TooFewLines { found: 3, .. })
        ));
        assert!(homography_from_lines(&plane, &plane[..3]).is_err());
        let concurrent: Vec<Line> = [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)]
            .iter()
            .map(|(a, b)| Line::new(*a, *b, 0.0).unwrap())
            .collect();
        assert!(matches!(
            homography_from_lines(&concurrent, &plane),
            Err(Error::DegenerateHomography { .. })
        ));
        // Both sets of lines are in range, but the map between them is not.
        let [tiny, huge] = [1e-100, 1e100].map(|size| {
            let sides = plane.iter().map(|line| line.coefficients());
            sides
                .map(|l| Line::new(l.x, l.y, l.z * size).unwrap())
                .collect::<Vec<_>>()
        });
        assert!(homography_from_lines(&tiny, &huge).is_err());
        let mut three = plane.clone();
        three[2] = Line::new(1.0, 1.0, 1.0).unwrap(); // through the corner of sides 0 and 3
        assert!(homography_from_lines(&three, &plane).is_err());
    }
}
