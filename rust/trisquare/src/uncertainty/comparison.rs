//! Difference between the projections of two cameras, and a test whether their uncertainties
//! explain it.

use nalgebra::{DMatrix, DVector, Matrix3, Vector2};

use super::projection::{FreeColumns, ProjectionUncertainty};
use crate::error::Error;
use crate::lens::{Lens, SeenAgain, TurnedLenses};
use crate::numeric::chi_square_tail;

/// Standard deviation of a direction of difference, relative to the largest, below which it is
/// rounding.
const ROUNDING: f64 = 1e-6;

/// Maximum number of sweeps of the singular value decomposition of a few columns.
const MAX_SWEEPS: usize = 1000;

/// Difference between the projections of two cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectionDifference {
    /// `second_from_first`: the rotation that fits best; it is removed from the differences.
    pub rotation: Matrix3<f64>,
    /// For each pixel, the second camera's projection of the direction that the first sees there,
    /// minus that pixel; `None` where one of the two cannot map it.
    pub differences: Vec<Option<Vector2<f64>>>,
    /// Test against the stated uncertainties, if either camera states one.
    pub test: Option<DifferenceTest>,
}

/// Test whether uncertainties explain a difference.
#[derive(Debug, Clone, PartialEq)]
pub struct DifferenceTest {
    /// For each pixel, the root mean square distance expected between two calibrations of one
    /// camera, pixels; `None` as in the differences.
    pub std: Vec<Option<f64>>,
    /// Probability that two calibrations of one camera, each from its own photographs, differ at
    /// least as much (chi-squared).
    pub p_value: f64,
    /// Number of independent differences that the uncertainties allow.
    pub degrees_of_freedom: usize,
    /// Root mean square, pixels, of the part of the difference that no change of the uncertain
    /// parameters produces.
    pub unexplained: f64,
}

/// Compares two cameras over pixels of the first one, after the rotation that fits best.
///
/// Errors of a camera's parameters move the directions seen at its pixels. The rotation absorbs a
/// part of that, too, so that its three columns are projected out of the differences' covariance. A
/// `ProjectionUncertainty` of no parameters is a camera taken as exact.
///
/// # Errors
/// [`Error::InvalidArgument`] if both cameras together can map less than a tenth of the pixels, or
/// a covariance has no eigenvalues.
pub fn compare_projections<A: Lens, B: Lens>(
    first: &ProjectionUncertainty<'_, A>,
    second: &ProjectionUncertainty<'_, B>,
    pixels: &[Vector2<f64>],
) -> Result<ProjectionDifference, Error> {
    let turned = TurnedLenses::closest(first.camera(), second.camera(), pixels)?;
    let matches: Vec<_> = pixels.iter().map(|p| turned.see_again(p)).collect();
    let pairs = pixels.iter().zip(&matches);
    let differences: Vec<_> = pairs
        .map(|(p, matched)| Some(matched.as_ref()?.pixel - p))
        .collect();
    let is_of_one_family = A::parameter_names() == B::parameter_names();
    let focal = first.camera().focal().min();
    let free = (first.free(), second.free());
    let test = difference_test(free, (is_of_one_family, focal), &differences, &matches)?;
    Ok(ProjectionDifference {
        rotation: turned.rotation,
        differences,
        test,
    })
}

/// Tests whether the free parameters of two cameras explain the difference between their
/// projections.
fn difference_test(
    (first, second): (&FreeColumns, &FreeColumns),
    (is_of_one_family, focal): (bool, f64),
    differences: &[Option<Vector2<f64>>],
    matches: &[Option<SeenAgain>],
) -> Result<Option<DifferenceTest>, Error> {
    let count = first.len() + second.len();
    if count == 0 {
        return Ok(None);
    }
    let seen: Vec<&SeenAgain> = matches.iter().flatten().collect();
    let (first_root, second_root) = (first.root()?, second.root()?);
    let mut spread = DMatrix::zeros(2 * seen.len(), count);
    let mut turns = DMatrix::zeros(2 * seen.len(), 3);
    for (i, matched) in seen.iter().enumerate() {
        // A parameter that moves the first camera's projection moves the direction seen at a pixel
        // the opposite way. Between two lenses of one family, the mean of their derivatives gives
        // the difference, up to the third order.
        let (by_first, by_second) = if is_of_one_family {
            let mean = (matched.by_first + matched.by_second) / 2.0;
            (mean, mean)
        } else {
            (matched.by_pixel * matched.by_first, matched.by_second)
        };
        let displacement = first.of(&by_first) * &first_root;
        let mut rows = spread.rows_mut(2 * i, 2);
        rows.columns_mut(0, first.len()).copy_from(&-displacement);
        let displacement = second.of(&by_second) * &second_root;
        rows.columns_mut(first.len(), second.len())
            .copy_from(&displacement);
        turns.rows_mut(2 * i, 2).copy_from(&matched.by_turn);
    }
    let basis = turns.qr().q();
    let before = spread.norm();
    spread -= &basis * basis.tr_mul(&spread);
    if spread.norm() < ROUNDING * before {
        spread.fill(0.0); // all is a rotation, up to rounding
    }
    let seen = differences.iter().flatten();
    let difference = DVector::from_iterator(spread.nrows(), seen.flat_map(|d| [d.x, d.y]));
    // Number of parameters, those of two cameras of one family counted once: they cause the same
    // changes.
    let is_new = |column: &&usize| !is_of_one_family || !first.columns().contains(column);
    let parameter_count = first.len() + second.columns().iter().filter(is_new).count();
    chi_square_test(&difference, &spread, focal, parameter_count, matches).map(Some)
}

/// Chi-squared test of a difference against a square root of its covariance.
///
/// In two cameras of one family a parameter has the same effect, but for the aspects at which `fy`
/// may follow `fx`: there are `parameter_count` kinds of change, and further directions are of the
/// second order.
///
/// The second-order effect of the least known direction, the square of its size over the focal
/// length, would look significant in directions with a smaller standard deviation: they are not
/// tested.
fn chi_square_test(
    difference: &DVector<f64>,
    spread: &DMatrix<f64>,
    focal: f64,
    parameter_count: usize,
    matches: &[Option<SeenAgain>],
) -> Result<DifferenceTest, Error> {
    if !spread.iter().all(|v| v.is_finite()) {
        return Err(Error::InvalidArgument(
            "the covariance is so large that the covariance of the projections overflows".into(),
        ));
    }
    let qr = spread.clone().qr();
    let svd = qr.r().try_svd(true, false, f64::EPSILON, MAX_SWEEPS);
    let (directions, sizes) = svd
        .and_then(|svd| Some((qr.q() * svd.u?, svd.singular_values)))
        .ok_or_else(|| Error::InvalidArgument("the covariances have no singular values".into()))?;
    let largest = sizes.max();
    let second_order = largest * (2.0 / difference.len() as f64).sqrt() / focal;
    let limit = second_order.max(ROUNDING) * largest;
    let (mut statistic, mut freedom, mut unexplained) = (0.0, 0, difference.clone());
    // The singular values are in descending order.
    for (direction, size) in directions
        .column_iter()
        .zip(sizes.iter())
        .take(parameter_count)
    {
        if *size > limit {
            let component = direction.dot(difference);
            statistic += (component / size).powi(2);
            unexplained.axpy(-component, &direction, 1.0);
            freedom += 1;
        }
    }
    let mut blocks = (0..spread.nrows() / 2).map(|i| spread.rows(2 * i, 2).norm());
    Ok(DifferenceTest {
        std: matches
            .iter()
            .map(|a| a.as_ref().and_then(|_| blocks.next()))
            .collect(),
        p_value: chi_square_tail(statistic, f64::from(freedom)),
        degrees_of_freedom: freedom as usize,
        unexplained: (2.0 * unexplained.norm_squared() / unexplained.len() as f64).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Brown;

    fn lens(fx: f64) -> Brown {
        Brown::new([fx, 510.0, 320.0, 240.0, -0.2, 0.05, 0.0, 0.0, 0.0])
    }

    fn pixels() -> Vec<Vector2<f64>> {
        (0..300)
            .map(|i| Vector2::new(f64::from(i % 20) * 33.0, f64::from(i / 20) * 33.0))
            .collect()
    }

    fn known<'a>(camera: &'a Brown, names: &[&str], std: f64) -> ProjectionUncertainty<'a> {
        let size = names.len();
        let covariance = DMatrix::identity(size, size) * (std * std);
        ProjectionUncertainty::new(camera, names, false, covariance).unwrap()
    }

    #[test]
    fn what_a_rotation_explains_is_no_difference() {
        let (one, other) = (lens(500.0), lens(505.0));
        let (first, second) = (known(&one, &["fx"], 1.0), known(&other, &["fx"], 1.0));
        for count in [1, 2] {
            let pixels = vec![Vector2::new(400.0, 300.0); count];
            let found = compare_projections(&first, &second, &pixels).unwrap();
            let test = found.test.unwrap();
            assert_eq!((test.degrees_of_freedom, test.p_value), (0, 1.0));
        }
    }

    #[test]
    fn a_difference_along_the_one_uncertain_parameter_is_told_in_its_standard_deviations() {
        let (first, second) = (lens(500.0), lens(500.3));
        let exact = known(&first, &[], 0.0);
        let vague = known(&second, &["fx"], 0.1);
        let found = compare_projections(&exact, &vague, &pixels()).unwrap();
        let test = found.test.unwrap();
        assert_eq!(test.degrees_of_freedom, 1);
        // Three standard deviations of the only parameter.
        assert!(
            (test.p_value - chi_square_tail(9.0, 1.0)).abs() < 1e-4,
            "{test:?}"
        );
        for (difference, std) in found.differences.iter().zip(&test.std) {
            let (difference, std) = (difference.unwrap().norm(), std.unwrap());
            assert!((difference - 3.0 * std).abs() < 1e-3);
        }
        assert!(test.unexplained < 1e-3);
        let other_way = compare_projections(&vague, &exact, &pixels())
            .unwrap()
            .test
            .unwrap();
        assert!((other_way.p_value - test.p_value).abs() < 1e-4);
        assert!(
            compare_projections(&exact, &exact, &pixels())
                .unwrap()
                .test
                .is_none()
        );
    }

    #[test]
    fn what_is_uncertain_in_both_cameras_counts_once() {
        let names = ["fx", "cx", "k1", "k2"];
        let values = |by: f64| {
            [
                500.0 + by,
                510.0,
                320.0 - by,
                240.0,
                -0.2,
                0.05,
                0.0,
                0.0,
                0.0,
            ]
        };
        let (first, second) = (Brown::new(values(0.0)), Brown::new(values(3.0)));
        let mut covariance = DMatrix::identity(4, 4);
        covariance[(2, 2)] = 1e-6;
        covariance[(3, 3)] = 1e-6;
        let of =
            |camera| ProjectionUncertainty::new(camera, &names, false, covariance.clone()).unwrap();
        let test = |a, b| {
            compare_projections(&of(a), &of(b), &pixels())
                .unwrap()
                .test
                .unwrap()
        };
        let (forth, back) = (test(&first, &second), test(&second, &first));
        assert!(forth.degrees_of_freedom <= 4, "{forth:?}");
        assert!(
            (forth.p_value - back.p_value).abs() < 0.01,
            "{forth:?} {back:?}"
        );
    }

    #[test]
    fn a_change_that_is_large_is_told_in_standard_deviations_too() {
        let first = lens(500.0);
        let values = [508.0, 518.0, 320.0, 240.0, -0.16, 0.03, 0.0, 0.0, 0.0];
        let second = Brown::new(values);
        // Two standard deviations of each.
        let std = DVector::from_column_slice(&[4.0, 4.0, 0.02, 0.01]);
        let covariance = DMatrix::from_diagonal(&std.component_mul(&std));
        let names = ["fx", "fy", "k1", "k2"];
        let vague = ProjectionUncertainty::new(&second, &names, false, covariance).unwrap();
        let found = compare_projections(&known(&first, &[], 0.0), &vague, &pixels()).unwrap();
        let test = found.test.unwrap();
        assert_eq!(test.degrees_of_freedom, 4);
        let ratio = test.p_value / chi_square_tail(16.0, 4.0);
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn what_no_parameter_makes_is_unexplained() {
        let (first, second) = (lens(500.0), lens(500.3));
        let vague = known(&first, &["k2"], 1e-3);
        let found = compare_projections(&vague, &known(&second, &[], 0.0), &pixels()).unwrap();
        let known = found.differences.iter().flatten();
        let rms = (known.map(|d| d.norm_squared()).sum::<f64>() / 300.0).sqrt();
        assert!(found.test.unwrap().unexplained > 0.5 * rms);
    }
}
