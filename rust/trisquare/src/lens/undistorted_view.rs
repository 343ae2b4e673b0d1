//! The pinhole view that shows a photograph without its distortion.
//!
//! A pinhole with the photograph's own camera matrix would leave black corners, or cut off what the
//! lens has displaced outward. The view chosen here keeps the size of the picture and the shape of
//! its pixels (`fy / fx`) and has no skew; its zoom and its principal point are chosen. In ideal
//! pixels (those of a pinhole with the photograph's focal lengths and principal point) the two
//! extremes are rectangles of the picture's shape: the smallest around the outline of what the
//! photograph shows, and the largest inside it.

use nalgebra::{Matrix3, Vector2};

use super::{DefaultLens, Lens, PictureView, PointMaps};
use crate::error::Error;
use crate::image_size::ImageSize;

/// Distance, in pixels, by which a point may lie outside the photograph and still count as inside:
/// it allows for rounding, and is far below the 1/32 px to which a picture is resampled.
pub(crate) const BORDER_TOLERANCE: f64 = 1e-6;

/// Minimum number of points along a side of the picture.
const MIN_POINTS_PER_SIDE: u32 = 256;

/// Maximum number of pixels that are checked along a side: all of them in any picture that can be
/// resampled.
const MAX_POINTS_PER_SIDE: u32 = 1 << 15;

/// Maximum number of points of the outline in the search for the largest rectangle.
const SEARCHED_POINTS: usize = 4096;

/// Relative tolerance of the size of the largest rectangle: a pixel of most pictures.
const TOLERANCE: f64 = 1.0 / 1024.0;

/// Maximum number of places tried for the largest rectangle; some thousand suffice.
const MAX_PLACES: usize = 50_000;

/// Number of bisections of the way back to the centre of the photograph: to a pixel of most
/// pictures.
const SLIDE_BISECTIONS: usize = 12;

/// Number of bisections of the zoom at the place found: to a millionth of a pixel.
const MAX_BISECTIONS: usize = 36;

/// Largest field angle of a view, degrees: beyond it, a pinhole shows the scene over thirty times
/// as large as ahead, and hardly anything else.
const WIDEST_DEGREES: f64 = 80.0;

/// Relative error of a rim's radius that is computed from its angle.
const ROUNDING: f64 = 1e-12;

/// Views of a camera's pictures without distortion.
pub trait UndistortedView: Lens {
    /// Returns the pinhole that shows this camera's pictures undistorted.
    ///
    /// With `balance` 0 every pixel of the new picture lies in the photograph, and the view is the
    /// largest such one to within a pixel (for a fisheye, the largest about its axis); with 1 every
    /// pixel of the photograph lies in the new picture. In between the camera matrix changes
    /// linearly. Parts where the distortion is not invertible, or farther than 80 degrees from the
    /// axis, are not shown.
    ///
    /// ```
    /// use nalgebra::Vector2;
    /// use trisquare::{Brown, ImageSize, Lens, UndistortedView};
    ///
    /// let camera = Brown::new([900.0, 900.0, 639.5, 479.5, -0.1, 0.0, 0.0, 0.0, 0.0]);
    /// let view = camera.undistorted(ImageSize { width: 1280, height: 960 }, 0.0)?;
    /// // Where a pixel of the new picture lies in the photograph.
    /// let ray = view.unproject(&Vector2::new(0.0, 0.0)).unwrap();
    /// let seen = camera.project(&ray).unwrap();
    /// assert!(seen.min() > -1.0);
    /// # Ok::<(), trisquare::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if `balance` is not from 0 to 1, the picture is empty or a single
    /// line of two or more pixels, or (nearly) none of it can be undistorted.
    fn undistorted(&self, size: ImageSize, balance: f64) -> Result<DefaultLens, Error> {
        size.check()?;
        if !(0.0..=1.0).contains(&balance) {
            return Err(Error::InvalidArgument(format!(
                "balance must be from 0 to 1, not {balance}"
            )));
        }
        let pinhole = DefaultLens::from_camera_matrix(&self.camera_matrix()).with_skew(0.0);
        let is_one_pixel = size.width == 1 && size.height == 1;
        if is_one_pixel || self.valid_pixel_radius().is_infinite() && !has_distortion(self) {
            return Ok(pinhole);
        }
        let outline = outline(self, size);
        let outer = bounding_rectangle(&outline, size)?;
        let inner = inscribed_rectangle(self, &outline, &outer, size)?;
        let (inner, outer) = (inner.pinhole(self, size), outer.pinhole(self, size));
        Ok(pinhole.with_camera_matrix(&(inner + (outer - inner) * balance)))
    }
}

impl<L: Lens> UndistortedView for L {}

/// Whether a lens differs from a pinhole without skew.
fn has_distortion(lens: &impl Lens) -> bool {
    lens.skew() != 0.0 || lens.distortion().iter().any(|c| *c != 0.0)
}

/// Returns the ideal radius up to which a view shows anything.
fn rim_radius<L: Lens>(lens: &L) -> f64 {
    let angle = lens.valid_angle().min(WIDEST_DEGREES.to_radians());
    angle.tan() * (1.0 - ROUNDING)
}

/// Returns the border of what the photograph shows, in ideal pixels: its own border, and the rim of
/// the view where that is in the picture.
fn outline<L: Lens>(lens: &L, size: ImageSize) -> Vec<Vector2<f64>> {
    let whole = Rectangle {
        centre: size.centre(),
        zoom: 1.0,
    };
    let pixels: Vec<_> = whole.border(size, MIN_POINTS_PER_SIDE).collect();
    let rim_radius = rim_radius(lens);
    let border = pixels.iter().filter_map(|p| lens.ideal_point(p));
    let border = border.filter(|ideal| ideal.norm() <= rim_radius);
    let rim = (0..pixels.len())
        .map(|i| std::f64::consts::TAU * i as f64 / pixels.len() as f64)
        .map(|angle| Vector2::new(angle.cos(), angle.sin()) * rim_radius)
        .filter(|ideal| {
            let seen = lens.project(&ideal.push(1.0));
            seen.is_some_and(|pixel| size.contains(&pixel, 0.0))
        });
    let ideal = border.chain(rim);
    let view = PictureView::pinhole(lens);
    ideal.map(|ideal| view.pixel_of(&ideal)).collect()
}

/// Finds the largest rectangle inside an outline, to a relative [`TOLERANCE`]; of several the one
/// nearest to the centre of the photograph; for a fisheye the one about its axis.
///
/// Its half size is the largest distance of a place to the outline, in the norm whose unit ball is
/// a rectangle of the picture's shape. The search halves cells of places and keeps those that may
/// contain a better one (V. Agafonkin's `polylabel`). The zoom is then determined at the pixels
/// themselves, on the border only: the distortion maps the border of the rectangle to a closed
/// curve, and its inside to the inside of that curve.
fn inscribed_rectangle<L: Lens>(
    lens: &L,
    outline: &[Vector2<f64>],
    outer: &Rectangle,
    size: ImageSize,
) -> Result<Rectangle, Error> {
    let inside = Inside::of(lens, outline, outer, size);
    // The ideal plane of a fisheye is stretched towards its rim, where the largest rectangle would
    // lie.
    let is_ahead = L::centre_columns().is_empty();
    let target = inside.place_of(match is_ahead {
        true => lens.principal_point(),
        false => size.centre(),
    });
    let best = match is_ahead {
        true => (target, inside.clearance(&target)),
        false => inside.innermost_place(target),
    };
    let (best, best_clearance) = (inside.recentred(target, best), best.1);
    let centre = inside.pixel_at(&best);
    let is_filled = |zoom: f64| {
        let mut border = Rectangle { centre, zoom }.border(size, 1);
        border.all(|pixel| is_shown(lens, &pixel, size))
    };
    let max_zoom = 2.0 * best_clearance * (1.0 + TOLERANCE) * outer.zoom;
    let zoom = largest_value(max_zoom, MAX_BISECTIONS, is_filled);
    let found = Rectangle { centre, zoom };
    Some(found).filter(|r| r.zoom > 0.0).ok_or_else(|| {
        Error::InvalidArgument(
            "the picture does not fill any undistorted view: too little of it lies within the \
             valid radius, or it is a single line of pixels"
                .into(),
        )
    })
}

/// The inside of an outline, in units in which the picture's shape is a square.
struct Inside<'a, L> {
    lens: &'a L,
    size: ImageSize,
    outline: Vec<Vector2<f64>>,
    centre: Vector2<f64>,
    unit: Vector2<f64>,
}

impl<'a, L: Lens> Inside<'a, L> {
    /// Creates it from a subset of the outline's points.
    fn of(lens: &'a L, outline: &[Vector2<f64>], outer: &Rectangle, size: ImageSize) -> Self {
        let mut inside = Self {
            lens,
            size,
            outline: Vec::new(),
            centre: outer.centre,
            unit: size.centre() * (2.0 * outer.zoom),
        };
        let stride = outline.len().div_ceil(SEARCHED_POINTS);
        let searched = outline.iter().step_by(stride);
        inside.outline = searched.map(|pixel| inside.place_of(*pixel)).collect();
        inside
    }

    fn place_of(&self, pixel: Vector2<f64>) -> Vector2<f64> {
        (pixel - self.centre).component_div(&self.unit)
    }

    fn pixel_at(&self, place: &Vector2<f64>) -> Vector2<f64> {
        self.centre + place.component_mul(&self.unit)
    }

    /// Returns the distance of a place from the outline, negative outside.
    fn clearance(&self, place: &Vector2<f64>) -> f64 {
        let distances = self.outline.iter().map(|p| (p - place).amax());
        let nearest = distances.fold(f64::INFINITY, f64::min);
        match is_shown(self.lens, &self.pixel_at(place), self.size) {
            true => nearest,
            false => -nearest,
        }
    }

    /// Returns the place with the largest distance from the outline, and that distance; `first`
    /// unless another place is better by more than the tolerance.
    fn innermost_place(&self, first: Vector2<f64>) -> (Vector2<f64>, f64) {
        let mut best = first;
        let mut best_clearance = self.clearance(&best);
        let (mut half, mut tried) = (0.5, 0);
        let mut cells = vec![Vector2::zeros()];
        while !cells.is_empty() && tried < MAX_PLACES {
            tried += cells.len();
            let clearances: Vec<f64> = cells.iter().map(|place| self.clearance(place)).collect();
            let better = |best_clearance: f64| best_clearance + TOLERANCE * best_clearance.max(0.0);
            for (place, clearance) in cells.iter().zip(&clearances) {
                if *clearance > better(best_clearance) {
                    (best, best_clearance) = (*place, *clearance);
                }
            }
            half *= 0.5;
            let promising = cells.iter().zip(&clearances);
            let promising = promising
                .filter(|(_, clearance)| **clearance + 2.0 * half > better(best_clearance));
            let quarters = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
            cells = promising
                .flat_map(|(place, _)| quarters.map(|(x, y)| place + Vector2::new(x, y) * half))
                .collect();
        }
        (best, best_clearance)
    }

    /// Moves a place as near to `target` as its distance from the outline allows, one axis after
    /// the other: between two opposite sides of the outline it is free to slide along them.
    fn recentred(
        &self,
        target: Vector2<f64>,
        (mut best, best_clearance): (Vector2<f64>, f64),
    ) -> Vector2<f64> {
        for axis in 0..2 {
            let at = |part: f64| {
                let mut place = best;
                place[axis] += part * (target[axis] - best[axis]);
                place
            };
            let is_clear =
                |part: f64| self.clearance(&at(part)) >= best_clearance * (1.0 - TOLERANCE);
            best = at(largest_value(1.0, SLIDE_BISECTIONS, is_clear));
        }
        best
    }
}

/// Returns the largest value from zero to `end` at which a condition holds that holds up to a
/// limit.
fn largest_value(end: f64, bisections: usize, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(end) {
        return end;
    }
    let (mut low, mut high) = (0.0, end);
    for _ in 0..bisections {
        let between = 0.5 * (low + high);
        *(if holds(between) { &mut low } else { &mut high }) = between;
    }
    low
}

/// Whether an ideal pixel is within the rim, and seen in the photograph.
fn is_shown<L: Lens>(lens: &L, ideal_pixel: &Vector2<f64>, size: ImageSize) -> bool {
    let ideal = PictureView::pinhole(lens).normalised(ideal_pixel);
    let rim_distance = (rim_radius(lens) - ideal.norm()) * lens.focal().min();
    let seen = lens.project(&ideal.push(1.0));
    rim_distance >= BORDER_TOLERANCE
        && seen.is_some_and(|pixel| size.contains(&pixel, 0.5 * BORDER_TOLERANCE))
}

/// Returns the smallest rectangle of the picture's shape that contains an outline.
fn bounding_rectangle(outline: &[Vector2<f64>], size: ImageSize) -> Result<Rectangle, Error> {
    let ends = outline.iter().map(|pixel| (*pixel, *pixel));
    let ends = ends.reduce(|(low, high), (pixel, _)| (low.inf(&pixel), high.sup(&pixel)));
    let found = ends.map(|(low, high)| {
        let ratio = |needed: f64, had: f64| if had > 0.0 { needed / had } else { 0.0 };
        Rectangle {
            centre: (low + high) * 0.5,
            zoom: (high - low).zip_map(&(size.centre() * 2.0), ratio).max(),
        }
    });
    found
        .filter(|r| r.zoom > 0.0 && r.zoom.is_finite() && r.centre.norm().is_finite())
        .ok_or_else(|| {
            Error::InvalidArgument(
                "no part of the picture lies within the valid radius, where the distortion can be \
                 undone"
                    .into(),
            )
        })
}

/// The rectangle that a pinhole shows, in ideal pixels.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    centre: Vector2<f64>,
    /// Ideal pixels per pixel of the new picture.
    zoom: f64,
}

impl Rectangle {
    /// Returns the pixels along the border of a new picture in ideal pixels and, for `min_points`
    /// points a side, points between them.
    fn border(self, size: ImageSize, min_points: u32) -> impl Iterator<Item = Vector2<f64>> {
        let extent = size.centre() * 2.0;
        let along = move |length: u32| {
            let pixels = length.min(MAX_POINTS_PER_SIDE) - 1;
            let count = pixels * min_points.div_ceil(pixels.max(1));
            (0..=count).map(move |i| f64::from(i) / f64::from(count.max(1)))
        };
        // One side after the other: a regular subset of the points still covers all sides.
        let ends = || [0.0, 1.0].into_iter();
        let rows = ends().flat_map(move |y| along(size.width).map(move |x| (x, y)));
        let columns = ends().flat_map(move |x| along(size.height).map(move |y| (x, y)));
        rows.chain(columns).map(move |(x, y)| {
            self.centre + Vector2::new(x - 0.5, y - 0.5).component_mul(&extent) * self.zoom
        })
    }

    /// The camera matrix of the pinhole.
    fn pinhole<L: Lens>(self, camera: &L, size: ImageSize) -> Matrix3<f64> {
        let focal = camera.focal() / self.zoom;
        let centre = (camera.principal_point() - self.centre) / self.zoom + size.centre();
        Matrix3::new(
            focal.x, 0.0, centre.x, 0.0, focal.y, centre.y, 0.0, 0.0, 1.0,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye};
    use super::*;

    const SIZE: ImageSize = ImageSize {
        width: 320,
        height: 240,
    };

    /// Barrel, pincushion, moustache, decentred; one whose rim lies within the picture.
    fn lenses() -> [Brown; 6] {
        [
            [-0.3, 0.09, 0.0, 0.0, 0.0],
            [0.3, 0.1, 0.0, 0.0, 0.0],
            [-0.3, 0.5, -0.1, 0.0, 0.0],
            [-0.2, 0.05, 0.0, 0.02, -0.01],
            [-0.9, 0.0, 0.0, 0.0, 0.0],
            [-0.4, 0.0, 0.0, 0.0, 0.03],
        ]
        .map(|[k1, k2, k3, p1, p2]| Brown::new([200.0, 210.0, 170.0, 110.0, k1, k2, k3, p1, p2]))
    }

    /// Where the pixels of a view lie in the photograph; `None` beyond the valid radius.
    fn seen(lens: &Brown, view: &Brown, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        lens.project(&view.unproject(&pixel)?)
    }

    fn pixels() -> impl Iterator<Item = Vector2<f64>> {
        (0..SIZE.width)
            .flat_map(|x| (0..SIZE.height).map(move |y| Vector2::new(f64::from(x), f64::from(y))))
    }

    fn is_in(point: Vector2<f64>, margin: f64) -> bool {
        let far = SIZE.centre() * 2.0;
        (0..2).all(|axis| (-margin..=far[axis] + margin).contains(&point[axis]))
    }

    #[test]
    fn a_filled_view_has_every_pixel_and_no_larger_one_near_it_has() {
        for lens in lenses() {
            let view = lens.undistorted(SIZE, 0.0).unwrap();
            let filled = |view: &Brown| {
                pixels()
                    .filter(|p| {
                        [p.x, p.y].contains(&0.0) || p.x == 319.0 || p.y == 239.0 || p.x == p.y
                    })
                    .all(|p| seen(&lens, view, p).is_some_and(|p| is_in(p, BORDER_TOLERANCE)))
            };
            assert!(filled(&view), "{lens:?} {view:?}");
            let [fx, fy, cx, cy, ..] = view.parameters()[..] else {
                panic!()
            };
            for shift in 0..9 {
                let shift = Vector2::new(f64::from(shift % 3 - 1), f64::from(shift / 3 - 1));
                let centre = SIZE.centre() + (Vector2::new(cx, cy) - SIZE.centre()) / 1.03 + shift;
                let wider = [fx, fy].map(|f| f / 1.03);
                let wider = [wider[0], wider[1], centre.x, centre.y];
                let mut parameters = [0.0; 9];
                parameters[..4].copy_from_slice(&wider);
                assert!(!filled(&Brown::new(parameters)), "{lens:?} {view:?}");
            }
        }
    }

    #[test]
    fn a_wide_lens_has_views_of_what_lies_ahead() {
        // It sees 110 degrees from its axis at the corners.
        let lens = Fisheye::new([105.0, 105.0, 158.0, 122.0, 0.01, -0.002, 0.0, 0.0]);
        let inner = lens.undistorted(SIZE, 0.0).unwrap();
        for pixel in pixels() {
            let ray = inner.unproject(&pixel).unwrap();
            let seen = lens.project(&ray).unwrap();
            assert!(is_in(seen, BORDER_TOLERANCE), "{pixel}");
        }
        assert!((inner.principal_point() - SIZE.centre()).norm() < 1e-9);
        let outer = lens.undistorted(SIZE, 1.0).unwrap();
        let reach = 319.0 / (2.0 * outer.focal().x);
        let innermost_place = WIDEST_DEGREES.to_radians().tan();
        assert!(
            reach > 0.9 * innermost_place && reach < 1.5 * innermost_place,
            "{reach}"
        );
    }

    #[test]
    fn a_filled_view_stays_about_the_centre_where_it_is_free_to() {
        // With barrel distortion, top and bottom limit the view.
        for (cx, cy) in [(170.0, 110.0), (165.0, 119.5), (150.0, 126.0)] {
            let lens = Brown::new([225.0, 225.0, cx, cy, -0.286, 0.078, 0.0, 0.0, 0.0]);
            let view = lens.undistorted(SIZE, 0.0).unwrap();
            assert!((view.principal_point().x - cx).abs() < 3.0, "{cx} {view:?}");
        }
    }

    #[test]
    fn views_are_alike_at_all_sizes() {
        let zoom = |scale: f64| {
            let size = ImageSize {
                width: (320.0 * scale) as u32,
                height: (240.0 * scale) as u32,
            };
            let [fx, fy, cx, cy] = [200.0, 210.0, 160.0, 120.0].map(|v| v * scale);
            let lens = Brown::new([fx, fy, cx, cy, -0.2, 0.05, 0.0, 0.0, 0.0]);
            lens.undistorted(size, 0.0).unwrap().focal().x / fx
        };
        for scale in [2.0, 4.0, 9.0, 12.5] {
            assert!((zoom(scale) / zoom(1.0) - 1.0).abs() < 0.02, "{scale}");
        }
    }

    #[test]
    fn a_whole_view_has_all_of_the_photograph_and_not_much_more() {
        for lens in lenses() {
            let view = lens.undistorted(SIZE, 1.0).unwrap();
            let places: Vec<_> = pixels()
                .filter_map(|pixel| lens.unproject(&pixel))
                .map(|ray| view.project(&ray).unwrap())
                .collect();
            assert!(!places.is_empty());
            // To a pixel where the rim of the lens is the border.
            assert!(places.iter().all(|p| is_in(*p, 1e-6)), "{lens:?}");
            let reach = |axis: usize| {
                let along = places.iter().map(|p| p[axis]);
                let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), v| {
                    (low.min(v), high.max(v))
                });
                (high - low) / (2.0 * SIZE.centre()[axis])
            };
            assert!(reach(0).max(reach(1)) > 0.97, "{lens:?}");
        }
    }

    #[test]
    fn a_view_keeps_the_shape_of_the_pixels_and_changes_evenly() {
        for lens in lenses() {
            let views = [0.0, 0.25, 1.0].map(|b| lens.undistorted(SIZE, b).unwrap());
            for i in 0..4 {
                let [inner, between, outer] = views.map(|view| view.parameters()[i]);
                assert!((between - (0.75 * inner + 0.25 * outer)).abs() < 1e-9);
            }
            for view in views {
                assert!((view.focal().y / view.focal().x - 1.05).abs() < 1e-12);
                assert_eq!(view.distortion(), vec![0.0; 5]);
            }
            assert!(views[0].focal().x > views[2].focal().x);
        }
    }

    #[test]
    fn a_pinhole_is_its_own_view_and_nothing_has_none() {
        let pinhole = lenses()[0].without_distortion();
        assert_eq!(pinhole.undistorted(SIZE, 0.3).unwrap(), pinhole);
        let lens = lenses()[4];
        let one = ImageSize {
            width: 1,
            height: 1,
        };
        assert_eq!(lens.undistorted(one, 0.5).unwrap().focal(), lens.focal());
        for balance in [-0.1, 1.1, f64::NAN] {
            assert!(lens.undistorted(SIZE, balance).is_err());
        }
        let aside = Brown::new([200.0, 200.0, 9000.0, 100.0, -0.9, 0.0, 0.0, 0.0, 0.0]);
        assert!(aside.undistorted(SIZE, 0.0).is_err());
        // A line of pixels: its image is a curve.
        let line = ImageSize {
            width: 1,
            height: 240,
        };
        assert!(lenses()[0].undistorted(line, 0.0).is_err());
    }
}
