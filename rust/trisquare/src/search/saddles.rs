//! Newton's method for saddle points of the grey levels.

use nalgebra::{Vector2, Vector4};

use crate::image::GreyBytes;

/// Width of the derivative filters, pixels.
const APERTURE: usize = 5;
/// Number of pixels from a filter's middle to its rim.
const REACH: usize = APERTURE / 2;

/// Maximum number of Newton steps, and their maximum length, pixels: beyond that, the slope only
/// gives a direction.
const MAX_STEPS: usize = 5;
const MAX_STEP: f64 = 1.5;
/// Maximum distance (px) of the saddle from the last pixel: where the grey levels have the
/// curvature of a saddle but also a slope, the saddle is farther away or does not exist.
const MAX_OFFSET: f64 = 1.2;
/// Maximum total displacement of a point (px): it comes from a picture half as fine.
const MAX_MOVE: f64 = 3.0;

/// Binomial smoothing, and first and second differences with the same smoothing.
const SMOOTH: [f64; APERTURE] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
const SLOPE: [f64; APERTURE] = [-0.125, -0.25, 0.0, 0.25, 0.125];
const CURVE: [f64; APERTURE] = [0.25, 0.0, -0.5, 0.0, 0.25];

/// Maximum ratio of a saddle's two curvatures. Where edges cross they are equal, for any angle and
/// blur; the smallest cells have a ratio of 2. Noise along stripes has any ratio.
const MAX_CURVATURE_RATIO: f64 = 3.0;

/// Replacement for a determinant that is not that of a saddle: the step is then far too long.
const NO_SADDLE: f64 = -1e-9;

/// The point where the slope vanishes, relative to a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaddleStep {
    /// Vector to the saddle, pixels.
    pub offset: Vector2<f64>,
    /// Second derivatives xx, xy, yy and their determinant, negative at a saddle.
    pub curvature: Vector4<f64>,
}

impl SaddleStep {
    /// The step from the pixel (column, row), or from the nearest one at which the filters are
    /// inside the picture.
    ///
    /// `None` if the picture is smaller than the filters.
    #[must_use]
    pub fn from(picture: &GreyBytes<'_>, pixel: [usize; 2]) -> Option<Self> {
        let corner = |k: usize| {
            let last = picture.size()[k].checked_sub(APERTURE)?;
            Some(pixel[k].saturating_sub(REACH).min(last))
        };
        let (left, top) = (corner(0)?, corner(1)?);
        let [mut x, mut y, mut xx, mut xy, mut yy] = [0.0; 5];
        for row in 0..APERTURE {
            let start = (top + row) * picture.size()[0] + left;
            let [mut smooth, mut slope, mut curve] = [0.0; 3];
            for (column, &value) in picture.values()[start..start + APERTURE].iter().enumerate() {
                let value = f64::from(value);
                smooth += SMOOTH[column] * value;
                slope += SLOPE[column] * value;
                curve += CURVE[column] * value;
            }
            x += SMOOTH[row] * slope;
            y += SLOPE[row] * smooth;
            xx += SMOOTH[row] * curve;
            xy += SLOPE[row] * slope;
            yy += CURVE[row] * smooth;
        }
        let determinant = xx * yy - xy * xy;
        let divisor = if determinant < 0.0 {
            determinant
        } else {
            NO_SADDLE
        };
        Some(Self {
            offset: Vector2::new(xy * y - yy * x, xy * x - xx * y) / divisor,
            curvature: Vector4::new(xx, xy, yy, determinant),
        })
    }

    /// Whether the second derivatives are those of a saddle that is about equally steep both ways.
    pub(super) fn is_even(&self) -> bool {
        let trace = self.curvature[0] + self.curvature[2];
        let max_ratio =
            (MAX_CURVATURE_RATIO - 1.0) * (MAX_CURVATURE_RATIO - 1.0) / MAX_CURVATURE_RATIO;
        trace * trace <= max_ratio * -self.curvature[3]
    }
}

/// Moves a point to the saddle next to it, if there is one.
#[must_use]
pub fn refine_corner(picture: &GreyBytes<'_>, point: Vector2<f64>) -> Vector2<f64> {
    let (mut refined, mut nearest) = (point, point);
    let mut shortest: Option<SaddleStep> = None;
    for _ in 0..MAX_STEPS {
        let pixel: [usize; 2] = std::array::from_fn(|k| {
            let last = picture.size()[k].saturating_sub(1 + REACH);
            // The cast saturates, and maps NaN to zero.
            (refined[k].round_ties_even() as usize).min(last).max(REACH)
        });
        let Some(step) = SaddleStep::from(picture, pixel) else {
            return point;
        };
        let moved = step.offset.map(|o| o.clamp(-MAX_STEP, MAX_STEP));
        refined = Vector2::new(pixel[0] as f64, pixel[1] as f64) + moved;
        // Near a saddle between four pixels the steps alternate: the shortest is the best.
        if shortest.is_none_or(|best| step.offset.amax() < best.offset.amax()) {
            (shortest, nearest) = (Some(step), refined);
        }
    }
    let is_found =
        shortest.is_some_and(|best| best.offset.amax() < MAX_OFFSET && best.curvature[3] < 0.0);
    if is_found && (nearest - point).amax() < MAX_MOVE {
        nearest
    } else {
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 20;
    const PLACE: [f64; 2] = [9.3, 10.6];

    fn saddle() -> Vec<u8> {
        let value = |index: usize| {
            let (dx, dy) = (
                (index % SIZE) as f64 - PLACE[0],
                (index / SIZE) as f64 - PLACE[1],
            );
            (128.0 + 2.0 * dx * dy).clamp(0.0, 255.0).round() as u8
        };
        (0..SIZE * SIZE).map(value).collect()
    }

    #[test]
    fn a_point_settles_on_the_saddle_next_to_it_only() {
        let values = saddle();
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        let place = Vector2::from(PLACE);
        let near = place + Vector2::new(1.2, -1.6);
        assert!((refine_corner(&picture, near) - place).amax() < 0.05);
        let far = place + Vector2::new(6.0, 5.0);
        assert_eq!(refine_corner(&picture, far), far);
    }

    #[test]
    fn the_derivatives_are_those_of_the_grey_levels() {
        let values = saddle();
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        let step = SaddleStep::from(&picture, [9, 10]).unwrap();
        let [xx, xy, yy, determinant] = step.curvature.into();
        assert!(xx.abs() < 0.1 && yy.abs() < 0.1 && (xy - 2.0).abs() < 0.1);
        assert_eq!(determinant, xx * yy - xy * xy);
        assert!((step.offset - Vector2::new(0.3, 0.6)).amax() < 0.05);
    }

    #[test]
    fn a_picture_smaller_than_the_filters_and_points_outside_are_no_harm() {
        let small = GreyBytes::new(4, 4, &[7; 16]).unwrap();
        assert_eq!(SaddleStep::from(&small, [1, 1]), None);
        let values = saddle();
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        for x in [f64::NAN, -1e300, 1e300, 0.0] {
            let refined = refine_corner(&picture, Vector2::new(x, 3.0));
            assert!(refined.x == x || x.is_nan());
        }
        assert!(SaddleStep::from(&picture, [usize::MAX, 0]).is_some());
    }
}
