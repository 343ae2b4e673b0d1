//! The pinhole through which a photograph is seen without its distortion.
//!
//! A pinhole with the photograph's own camera matrix would show a part of the scene that leaves
//! black corners, or cuts off what the lens has bent outward. The view chosen here keeps the size
//! of the picture and the shape of its pixels (`fy / fx`); what is chosen is its zoom and its
//! principal point.

use nalgebra::Vector2;

use super::Lens;
use super::brown::Brown;
use crate::error::Error;
use crate::image_size::ImageSize;

/// How far, in pixels, a point may lie outside the photograph and still count as seen in it:
/// rounding, and far below the 1/32 px to which a picture is resampled.
pub(crate) const ON_THE_BORDER: f64 = 1e-6;

/// Pixels that are looked at along a side: all of them in any picture that can be resampled.
const MAX_PIXELS_PER_SIDE: u32 = 1 << 15;

/// Doublings or halvings that bracket the zoom: no lens bends a picture a million times.
const MAX_DOUBLINGS: usize = 20;

/// The zoom is known to this part of itself: a thousandth of a pixel over the largest picture.
const ZOOM_TOLERANCE: f64 = 1e-8;

/// Shifts of a rectangle toward the margin that it has: Newton's, at rounding after a few.
const MAX_SHIFTS: usize = 12;

/// A shift below this, in pixels, gains nothing.
const SMALLEST_SHIFT: f64 = 0.1 * ON_THE_BORDER;

impl Brown {
    /// The pinhole that sees this camera's pictures undistorted.
    ///
    /// With `balance` 0 every pixel of the new picture lies in the photograph, and no larger part
    /// of the scene would do (about the best place for it); with 1 every pixel of the photograph
    /// lies in the new picture. In between the camera matrix changes linearly. Where the
    /// distortion cannot be inverted, there is nothing to see.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if `balance` is not from 0 to 1, the picture is empty, or
    /// (nearly) none of it can be undistorted.
    pub fn undistorted(&self, size: ImageSize, balance: f64) -> Result<Self, Error> {
        size.check()?;
        if !(0.0..=1.0).contains(&balance) {
            return Err(Error::InvalidArgument(format!(
                "balance must be from 0 to 1, not {balance}"
            )));
        }
        let bends = self.distortion().iter().any(|c| *c != 0.0);
        let is_one_pixel = size.width == 1 && size.height == 1;
        if is_one_pixel || (!bends && self.valid_radius().is_infinite()) {
            return Ok(self.without_distortion());
        }
        let inner = self.largest_filled(size)?.pinhole(self, size);
        let outer = self.smallest_holding(size)?.pinhole(self, size);
        let parts = inner.into_iter().zip(outer);
        let mut parameters = [0.0; 9];
        for (parameter, (inner, outer)) in parameters.iter_mut().zip(parts) {
            *parameter = inner + balance * (outer - inner);
        }
        Ok(Self::new(parameters))
    }

    /// The largest rectangle that shows nothing but the photograph.
    fn largest_filled(&self, size: ImageSize) -> Result<Rectangle, Error> {
        let mut best = Rectangle {
            centre: self.inner_point(size)?,
            zoom: 1.0,
        };
        let fits = |from: &Rectangle, zoom: f64| self.shifted_to_fit(size, from, zoom);
        let (mut low, mut high) = (1.0, 2.0);
        if let Some(found) = fits(&best, 1.0) {
            best = found;
            for _ in 0..MAX_DOUBLINGS {
                let Some(found) = fits(&best, high) else {
                    break;
                };
                (best, low, high) = (found, high, 2.0 * high);
            }
        } else {
            let found = (1..=MAX_DOUBLINGS as i32)
                .map(|halvings| 0.5_f64.powi(halvings))
                .find_map(|zoom| fits(&best, zoom));
            best = found.ok_or_else(|| {
                Error::InvalidArgument(
                    "no undistorted view is filled by the picture: too little of it lies within \
                     the valid radius, or it is a single line of pixels"
                        .into(),
                )
            })?;
            (low, high) = (best.zoom, 2.0 * best.zoom);
        }
        while high - low > ZOOM_TOLERANCE * low {
            let zoom = 0.5 * (low + high);
            match fits(&best, zoom) {
                Some(found) => (best, low) = (found, zoom),
                None => high = zoom,
            }
        }
        Ok(best)
    }

    /// An ideal point that the photograph shows: its centre, or what it has nearest to the axis.
    fn inner_point(&self, size: ImageSize) -> Result<Vector2<f64>, Error> {
        let nearest = self
            .principal_point()
            .inf(&(size.centre() * 2.0))
            .sup(&Vector2::zeros());
        [size.centre(), nearest]
            .iter()
            .find_map(|pixel| self.undistort(&self.normalised(pixel)))
            .map(|ideal| self.ideal_pixel(&ideal))
            .ok_or_else(nothing_to_see)
    }

    /// A rectangle of this zoom that lies in the photograph, near one that does already.
    ///
    /// Its border decides: the distortion maps it to a closed curve, and what it encloses to the
    /// inside of that curve.
    fn shifted_to_fit(&self, size: ImageSize, from: &Rectangle, zoom: f64) -> Option<Rectangle> {
        let mut rectangle = Rectangle { zoom, ..*from };
        for _ in 0..MAX_SHIFTS {
            let room = self.room(size, &rectangle);
            if room.least() >= -0.5 * ON_THE_BORDER {
                return Some(rectangle);
            }
            let shift = self.balancing_shift(&room);
            // Written so that NaN ends here, too.
            if !(shift.norm() > SMALLEST_SHIFT) {
                return None;
            }
            rectangle.centre += shift;
        }
        None
    }

    /// How far a rectangle is from the four sides of the photograph and from the rim of the lens.
    fn room(&self, size: ImageSize, rectangle: &Rectangle) -> Room {
        let far = size.centre() * 2.0;
        let mut room = Room::UNBOUNDED;
        for pixel in rectangle.border(size) {
            let ideal = self.normalised(&pixel);
            let to_rim = (self.valid_radius() - ideal.norm()) * self.focal().min() - ON_THE_BORDER;
            let seen = self.pixel_of(&ideal);
            for axis in 0..2 {
                // Beyond the rim the distortion folds back: what it says there is nothing.
                let (low, high) = if to_rim < 0.0 {
                    (f64::INFINITY, f64::INFINITY)
                } else {
                    (seen[axis], far[axis] - seen[axis])
                };
                room.low[axis].narrow(low, ideal, false);
                room.high[axis].narrow(high, ideal, false);
                // The rim is out of the way when the rectangle moves toward the axis.
                let outward = if ideal[axis] < 0.0 {
                    &mut room.low
                } else {
                    &mut room.high
                };
                outward[axis].narrow(to_rim, ideal, true);
            }
        }
        room
    }

    /// Newton's step to where there is as much margin on either side, along both axes.
    fn balancing_shift(&self, room: &Room) -> Vector2<f64> {
        let slope = |side: &Side, axis: usize| {
            if side.is_rim {
                (side.ideal[axis] / side.ideal.norm()).abs()
            } else {
                let square = side.ideal.norm_squared();
                self.distortion_jacobian(&side.ideal, square)[(axis, axis)]
            }
        };
        let along = |axis: usize| {
            let (low, high) = (&room.low[axis], &room.high[axis]);
            (high.room - low.room) / (slope(low, axis) + slope(high, axis))
        };
        Vector2::new(along(0), along(1))
    }

    /// The ideal normalised point of an ideal pixel.
    fn normalised(&self, ideal_pixel: &Vector2<f64>) -> Vector2<f64> {
        (ideal_pixel - self.principal_point()).component_div(&self.focal())
    }

    /// The ideal pixel of an ideal normalised point.
    fn ideal_pixel(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        ideal.component_mul(&self.focal()) + self.principal_point()
    }

    /// Where an ideal normalised point is seen.
    fn pixel_of(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        self.ideal_pixel(&self.distort(ideal))
    }

    /// The smallest rectangle that holds all of the photograph that can be undistorted.
    fn smallest_holding(&self, size: ImageSize) -> Result<Rectangle, Error> {
        let far = size.centre() * 2.0;
        let whole = Rectangle {
            centre: size.centre(),
            zoom: 1.0,
        };
        let pixels: Vec<_> = whole.border(size).collect();
        let border = pixels
            .iter()
            .filter_map(|pixel| self.undistort(&self.normalised(pixel)));
        // Where the rim of the lens is in the picture, it is the border of what can be seen; as
        // many points of it as the picture's border has are about a pixel apart.
        let rim = (0..pixels.len())
            .filter(|_| self.valid_radius().is_finite())
            .map(|i| std::f64::consts::TAU * i as f64 / pixels.len() as f64)
            .map(|angle| Vector2::new(angle.cos(), angle.sin()) * self.valid_radius())
            .filter(|ideal| {
                let seen = self.pixel_of(ideal);
                (0..2).all(|axis| (0.0..=far[axis]).contains(&seen[axis]))
            });
        let (low, high) = border
            .chain(rim)
            .map(|ideal| self.ideal_pixel(&ideal))
            .map(|pixel| (pixel, pixel))
            .reduce(|(low, high), (pixel, _)| (low.inf(&pixel), high.sup(&pixel)))
            .ok_or_else(nothing_to_see)?;
        let zoom = (high - low)
            .zip_map(
                &far,
                |needed, had| if had > 0.0 { needed / had } else { 0.0 },
            )
            .max();
        let found = Rectangle {
            centre: (low + high) * 0.5,
            zoom,
        };
        Some(found)
            .filter(|r| r.zoom > 0.0 && r.zoom.is_finite() && r.centre.norm().is_finite())
            .ok_or_else(nothing_to_see)
    }
}

fn nothing_to_see() -> Error {
    Error::InvalidArgument(
        "no part of the picture lies within the valid radius, where the distortion can be undone"
            .into(),
    )
}

/// What a pinhole sees, in ideal pixels: those of a pinhole with the photograph's camera matrix.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    centre: Vector2<f64>,
    /// Ideal pixels per pixel of the new picture.
    zoom: f64,
}

impl Rectangle {
    /// The pixels along the border of a new picture, in ideal pixels.
    fn border(self, size: ImageSize) -> impl Iterator<Item = Vector2<f64>> {
        let far = size.centre() * 2.0;
        let along = |length: u32| {
            let count = length.min(MAX_PIXELS_PER_SIDE);
            let step = f64::from(length - 1) / f64::from((count - 1).max(1));
            (0..count).map(move |i| f64::from(i) * step)
        };
        let rows = along(size.width).flat_map(move |x| [(x, 0.0), (x, far.y)]);
        let columns = along(size.height).flat_map(move |y| [(0.0, y), (far.x, y)]);
        rows.chain(columns)
            .map(move |(x, y)| self.centre + (Vector2::new(x, y) - 0.5 * far) * self.zoom)
    }

    /// The parameters of the pinhole.
    fn pinhole(self, camera: &Brown, size: ImageSize) -> [f64; 9] {
        let focal = camera.focal() / self.zoom;
        let centre = (camera.principal_point() - self.centre) / self.zoom + size.centre();
        [
            focal.x, focal.y, centre.x, centre.y, 0.0, 0.0, 0.0, 0.0, 0.0,
        ]
    }
}

/// Room toward the low and the high end of both axes, the least of all points' each.
#[derive(Debug, Clone, Copy)]
struct Room {
    low: [Side; 2],
    high: [Side; 2],
}

/// The margin on one side, in pixels and negative where it is exceeded, and whose it is.
#[derive(Debug, Clone, Copy)]
struct Side {
    room: f64,
    ideal: Vector2<f64>,
    is_rim: bool,
}

impl Side {
    const UNBOUNDED: Self = Self {
        room: f64::INFINITY,
        ideal: Vector2::new(0.0, 0.0),
        is_rim: false,
    };

    /// Takes over what a point leaves, if that is less; what has overflowed leaves nothing.
    fn narrow(&mut self, room: f64, ideal: Vector2<f64>, is_rim: bool) {
        let room = if room.is_nan() {
            f64::NEG_INFINITY
        } else {
            room
        };
        if room < self.room {
            *self = Self {
                room,
                ideal,
                is_rim,
            };
        }
    }
}

impl Room {
    const UNBOUNDED: Self = Self {
        low: [Side::UNBOUNDED; 2],
        high: [Side::UNBOUNDED; 2],
    };

    fn least(&self) -> f64 {
        let sides = self.low.iter().chain(&self.high);
        sides.map(|side| side.room).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
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
                    .all(|p| seen(&lens, view, p).is_some_and(|p| is_in(p, ON_THE_BORDER)))
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
                assert_eq!(view.distortion(), [0.0; 5]);
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
        // A line of pixels: its image is a curve, unless it goes through the axis.
        let line = ImageSize {
            width: 1,
            height: 240,
        };
        assert!(lenses()[0].undistorted(line, 0.0).is_err());
        let through_axis = Brown::new([200.0, 200.0, 0.0, 110.0, -0.3, 0.09, 0.0, 0.0, 0.0]);
        let view = through_axis.undistorted(line, 0.0).unwrap();
        let ends = [0.0, 239.0].map(|y| seen(&through_axis, &view, Vector2::new(0.0, y)));
        assert!(
            ends.iter()
                .flatten()
                .all(|p| (-1e-6..=239.000001).contains(&p.y))
        );
    }
}
