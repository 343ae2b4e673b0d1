//! Map from the pixels of an undistorted picture to positions in the photograph.

use nalgebra::Vector2;

use super::picture_view::PictureView;
use super::undistorted_view::BORDER_TOLERANCE;
use super::{DefaultLens, Lens};
use crate::error::Error;
use crate::image_size::ImageSize;

/// Number of parts of a pixel to which a resampled position is rounded: OpenCV's, from its
/// `INTER_BITS`.
const PARTS_PER_PIXEL: i32 = 1 << PART_BITS;
const PART_BITS: u32 = 5;

/// Coordinate outside every picture, far from the ends of `i16`, which neighbours might pass.
const NOWHERE: i16 = -0x4000;

/// Largest coordinate in a map; no picture to be resampled is as large.
const LARGEST: i32 = i16::MAX as i32 - 1;

/// Positions of an undistorted picture's pixels in the photograph, row by row.
///
/// OpenCV's fixed-point map (`CV_16SC2` and `CV_16UC1` of its `remap`): whole pixels, and 1/32 of
/// them in x plus 32 times those in y. Without OpenCV, [`Lens::project`] of the rays of the
/// [`undistorted`](super::UndistortedView::undistorted) view gives the same positions in floating
/// point: see the example `undistort`.
#[derive(Debug)]
pub struct UndistortionMap<'a> {
    /// Whole pixels, x and y alternating: two values for each pixel of the view.
    pub whole: &'a mut [i16],
    /// Parts of pixels, one value for each pixel of the view.
    pub parts: &'a mut [u16],
    /// Whether the pixel lies in the photograph, and within the valid radius.
    pub valid: &'a mut [bool],
}

impl UndistortionMap<'_> {
    /// Fills the map for a pinhole view of a camera's photograph.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if the lengths of the slices are not those of `view_size`.
    pub fn fill(
        &mut self,
        camera: &impl Lens,
        size: ImageSize,
        view: &DefaultLens,
        view_size: ImageSize,
    ) -> Result<(), Error> {
        self.fill_view(camera, size, &PictureView::pinhole(view), view_size)
    }

    /// As [`Self::fill`], for a view on a plane, a cylinder or a sphere.
    ///
    /// # Errors
    /// As [`Self::fill`].
    pub fn fill_view(
        &mut self,
        camera: &impl Lens,
        size: ImageSize,
        view: &PictureView,
        view_size: ImageSize,
    ) -> Result<(), Error> {
        let width = view_size.width as usize;
        let pixels = width * view_size.height as usize;
        let lengths = [self.whole.len() / 2, self.parts.len(), self.valid.len()];
        if lengths != [pixels; 3] || pixels == 0 {
            return Err(Error::InvalidArgument(format!(
                "the map of a view of {pixels} pixels needs twice as many whole pixels, as many \
                     parts and as many flags, and at least one, not {}, {} and {}",
                self.whole.len(),
                self.parts.len(),
                self.valid.len()
            )));
        }
        let rows = self
            .whole
            .chunks_exact_mut(2 * width)
            .zip(self.parts.chunks_exact_mut(width))
            .zip(self.valid.chunks_exact_mut(width));
        for (y, ((whole, parts), valid)) in rows.enumerate() {
            let pixels = whole.chunks_exact_mut(2).zip(parts).zip(valid);
            for (x, ((whole, part), valid)) in pixels.enumerate() {
                let seen = camera.project(&view.direction(&Vector2::new(x as f64, y as f64)));
                let (place, parts) = seen.map_or(([NOWHERE; 2], 0), |seen| rounded(&seen));
                whole.copy_from_slice(&place);
                *part = parts;
                *valid = seen.is_some_and(|seen| size.contains(&seen, BORDER_TOLERANCE));
            }
        }
        Ok(())
    }
}

/// Returns whole pixels and parts of pixels; halves are rounded to the even part, as in OpenCV.
fn rounded(point: &Vector2<f64>) -> ([i16; 2], u16) {
    let parts = [point.x, point.y].map(|coordinate| {
        let limited = coordinate.clamp(f64::from(NOWHERE), f64::from(LARGEST));
        (limited * f64::from(PARTS_PER_PIXEL)).round_ties_even() as i32
    });
    let [x, y] = parts.map(|p| (p & (PARTS_PER_PIXEL - 1)) as u16);
    // Within i16 by the clamp.
    (parts.map(|p| (p >> PART_BITS) as i16), (y << PART_BITS) | x)
}

/// Finds the largest rectangle of a mask in which every pixel is set: `[x, y, width, height]`.
///
/// Each row has a histogram: the number of set pixels in each column that end at the row without a
/// gap. A stack of rising bars gives the largest rectangle under each histogram, in time linear in
/// the number of pixels. The result is all zeros if no pixel is set.
pub fn largest_rectangle(mask: &[bool], width: usize) -> [usize; 4] {
    if width > mask.len() {
        return [0; 4];
    }
    let mut heights = vec![0; width];
    let mut best = [0; 4];
    let mut open_bars: Vec<(usize, usize)> = Vec::new(); // start and height of each bar
    for (y, row) in mask.chunks_exact(width.max(1)).enumerate() {
        for (height, set) in heights.iter_mut().zip(row) {
            *height = if *set { *height + 1 } else { 0 };
        }
        // A bar of zero height after the last one ends all bars.
        for (x, height) in heights.iter().copied().chain([0]).enumerate() {
            let mut begin = x;
            while let Some((start, bar)) = open_bars.pop_if(|(_, bar)| *bar >= height) {
                if bar * (x - start) > best[2] * best[3] {
                    best = [start, y + 1 - bar, x - start, bar];
                }
                begin = start;
            }
            open_bars.push((begin, height));
        }
        open_bars.clear();
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, UndistortedView};
    use super::*;

    const SIZE: ImageSize = ImageSize {
        width: 40,
        height: 30,
    };

    fn filled(camera: &Brown, view: &Brown) -> (Vec<i16>, Vec<u16>, Vec<bool>) {
        let (mut whole, mut parts, mut valid) = (vec![0; 2400], vec![0; 1200], vec![false; 1200]);
        let mut map = UndistortionMap {
            whole: &mut whole,
            parts: &mut parts,
            valid: &mut valid,
        };
        map.fill(camera, SIZE, view, SIZE).unwrap();
        (whole, parts, valid)
    }

    #[test]
    fn a_map_holds_where_a_pixel_is_seen() {
        let camera = Brown::new([30.0, 31.0, 19.0, 15.0, -0.2, 0.02, 0.0, 0.01, 0.0]);
        let view = camera.undistorted(SIZE, 1.0).unwrap();
        let (whole, parts, valid) = filled(&camera, &view);
        let mut count = 0;
        for y in 0..30 {
            for x in 0..40 {
                let i = y * 40 + x;
                let ray = view.unproject(&Vector2::new(x as f64, y as f64)).unwrap();
                let Some(seen) = camera.project(&ray) else {
                    assert!(!valid[i] && whole[2 * i] == NOWHERE);
                    continue;
                };
                let place = Vector2::new(
                    f64::from(whole[2 * i]) + f64::from(parts[i] & 31) / 32.0,
                    f64::from(whole[2 * i + 1]) + f64::from(parts[i] >> 5) / 32.0,
                );
                assert!((place - seen).amax() <= 0.5 / 32.0 + 1e-12);
                let inside = seen.min() >= 0.0 && seen.x <= 39.0 && seen.y <= 29.0;
                assert_eq!(valid[i], inside);
                count += usize::from(inside);
            }
        }
        assert!(count > 300 && count < 1200, "{count}");
    }

    #[test]
    fn beyond_the_valid_radius_there_is_nothing() {
        let camera = Brown::new([30.0, 30.0, 19.5, 14.5, 0.0, 0.0, 0.0, 0.0, 0.0]).within(0.3);
        let (whole, _, valid) = filled(&camera, &camera);
        for (i, valid) in valid.iter().enumerate() {
            let (x, y) = ((i % 40) as f64 - 19.5, (i / 40) as f64 - 14.5);
            assert_eq!(*valid, x.hypot(y) <= 9.0, "{x} {y}");
            assert_eq!(whole[2 * i] == NOWHERE, !valid);
        }
    }

    #[test]
    fn positions_far_outside_stay_outside() {
        let far = Vector2::new(1e12, -1e12);
        assert_eq!(rounded(&far), ([LARGEST as i16, NOWHERE], 0));
        assert_eq!(rounded(&Vector2::new(-0.25, 1.5)), ([-1, 1], 24 + 32 * 16));
    }

    #[test]
    fn the_largest_rectangle_is_the_one_found_by_trying_all() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 16
        };
        for case in 0..200 {
            let (width, height) = (1 + random() as usize % 7, 1 + random() as usize % 7);
            let rare = 2 + case % 6;
            let mask: Vec<bool> = (0..width * height).map(|_| random() % rare != 0).collect();
            let [x, y, w, h] = largest_rectangle(&mask, width);
            let full = |x: usize, y: usize, w: usize, h: usize| {
                (y..y + h).all(|j| (x..x + w).all(|i| mask[j * width + i]))
            };
            assert!(x + w <= width && y + h <= height && full(x, y, w, h));
            for j in 0..height {
                for i in 0..width {
                    for b in 1..=height - j {
                        for a in 1..=width - i {
                            assert!(a * b <= w * h || !full(i, j, a, b));
                        }
                    }
                }
            }
        }
        assert_eq!(largest_rectangle(&[false; 6], 3), [0; 4]);
        assert_eq!(largest_rectangle(&[], 0), [0; 4]);
    }
}
