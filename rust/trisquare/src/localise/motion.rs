//! Motion of the camera while the shutter was open, from edges whose blur depends on their
//! direction.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::preview::Preview;

/// Minimum number of sides to determine it.
const MIN_SIDES: u32 = 8;
/// Number of standard deviations, and length (px), above which it is significant.
const MIN_DEVIATIONS: f64 = 6.0;
const MIN_LENGTH: f64 = 1.5;
/// Variance of a box of length 1.
const BOX_VARIANCE: f64 = 1.0 / 12.0;

/// A straight motion at constant speed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MotionBlur {
    /// Length in pixels.
    pub length: f64,
    /// Direction in degrees from the x axis towards the y axis (down), 0 to 180.
    pub direction: f64,
}

/// The motion that the sides' blurs show; `None` if the blur is the same in all directions.
///
/// A side with the normal `n` has the squared blur `n^T M n`; the eigenvalues of `M` differ by a
/// twelfth of the motion's squared length.
pub(super) fn blur<'a>(previews: impl Iterator<Item = &'a Preview>) -> Option<MotionBlur> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let (mut squares, mut count) = (0.0, 0_u32);
    for preview in previews {
        let side = &preview.side;
        let across: Vector2<f64> = side.curve.across;
        let double_angle = 2.0 * across.y.atan2(across.x);
        let row = Vector3::new(1.0, double_angle.cos(), double_angle.sin());
        let square = side.mean_blur().powi(2);
        normal += row * row.transpose();
        right += row * square;
        squares += square * square;
        count += 1;
    }
    if count < MIN_SIDES {
        return None;
    }
    let factor = normal.cholesky()?;
    let solution = factor.solve(&right);
    let variance = (squares - solution.dot(&right)).max(0.0) / f64::from(count - 3);
    // Half the difference of the eigenvalues, as a vector at twice the angle of the motion.
    let half = Vector2::new(solution[1], solution[2]);
    let half_covariance = factor.inverse().fixed_view::<2, 2>(1, 1).into_owned();
    let deviations = (half.dot(&half_covariance.cholesky()?.solve(&half)) / variance).sqrt();
    let length = (2.0 * half.norm() / BOX_VARIANCE).sqrt();
    (deviations > MIN_DEVIATIONS && length > MIN_LENGTH).then(|| MotionBlur {
        length,
        direction: (0.5 * half.y.atan2(half.x)).to_degrees().rem_euclid(180.0),
    })
}

#[cfg(test)]
mod tests {
    use super::super::blur::BlurShape;
    use super::super::curve::ChordCurve;
    use super::super::side::SideModel;
    use super::*;

    /// Twelve sides in all directions, each with the blur of a motion and a small error of its own.
    fn previews(motion: MotionBlur) -> Vec<Preview> {
        let direction = motion.direction.to_radians();
        let sides = (0..12).map(|index| {
            let angle = 0.4 + 0.53 * f64::from(index);
            let along = Vector2::new(angle.cos(), angle.sin()) * 100.0;
            let curve = ChordCurve::chord(Vector2::repeat(300.0), Vector2::repeat(300.0) + along);
            let curve = curve.unwrap();
            let across = motion.length * (direction.cos() * curve.across.x)
                + motion.length * (direction.sin() * curve.across.y);
            let square = 0.7 + BOX_VARIANCE * across * across;
            Preview {
                side: SideModel {
                    blur: [
                        square.sqrt() * (1.0 + 0.01 * f64::from(index % 3 - 1)),
                        0.0,
                        0.0,
                    ],
                    curve,
                    base: [0.0; 3],
                    contrast: [1.0, 0.0, 0.0],
                    blur_degree: 0,
                    shape: BlurShape::NORMAL,
                    spread: None,
                    has_far_edge: false,
                },
                noise: 0.01,
                reach: [3.0; 2],
                hidden: Vec::new(),
                pixels: Vec::new(),
                predictions: Vec::new(),
            }
        });
        sides.collect()
    }

    #[test]
    fn a_motion_is_told_by_the_sides_across_it() {
        for direction in [10.0, 75.0, 160.0] {
            let truth = MotionBlur {
                length: 4.0,
                direction,
            };
            let found = blur(previews(truth).iter()).unwrap();
            assert!((found.length - truth.length).abs() < 0.1, "{found:?}");
            assert!((found.direction - direction).abs() < 2.0, "{found:?}");
        }
    }

    #[test]
    fn blurs_alike_all_round_and_too_few_sides_are_no_motion() {
        let still = MotionBlur {
            length: 0.0,
            direction: 0.0,
        };
        assert_eq!(blur(previews(still).iter()), None);
        let moving = MotionBlur {
            length: 4.0,
            direction: 0.0,
        };
        assert_eq!(blur(previews(moving).iter().take(7)), None);
    }
}
