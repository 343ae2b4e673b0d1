//! Smooth curved sides from rough quads, measured in the grey picture.
//!
//! Contour pixels are up to a pixel beside the edge and affected by noise. A cubic through the edge
//! positions along a side corrects both. It also rejects shapes that have four corners only at one
//! threshold: their edge does not exist, has the wrong sign, or is not a smooth curve.

use nalgebra::{Vector2, Vector4};

use super::four_corners::{POINTS_PER_SIDE, Sides, fraction};
use super::side_cubics::{SidePoints, trimmed_cubics};
use crate::image::GreyBytes;
use crate::numeric::median;

/// Minimum contrast, grey levels: a contrast of 60 in the weak half of strongly uneven light, and
/// blurred.
const MIN_CONTRAST: f64 = 14.0;

/// Length (px) that is left out at each end of a side, where two edges blend, and its bounds as
/// fractions of the side.
const END_MARGIN_PIXELS: f64 = 3.0;
const END_MARGIN_FRACTIONS: [f64; 2] = [0.06, 0.25];

/// Number of pixels on either side of an edge, along the outward normal, that are used to locate
/// it, and number of the outermost ones that give the grey levels beside it.
const REACH: i32 = 3;
const PROFILE: usize = 2 * REACH as usize + 1;
const PLATEAU_PIXELS: usize = 2;
/// Smallest contrast used as a divisor, and the amount by which a fraction of the contrast may
/// exceed 0 and 1.
const MIN_DIVISOR: f64 = 1.0;
const MAX_OVERSHOOT: f64 = 0.25;

/// Maximum number of rounds, and change of a curve (px) that ends them. Near a corner a contour may
/// miss the edge by more than the reach of the profile; each round follows the edge further there.
const ROUNDS: usize = 3;
const LAST_CHANGE: f64 = 0.1;

/// Minimum contrast of an edge point, as a fraction of the side's median.
const MIN_RELATIVE_CONTRAST: f64 = 0.4;

/// Maximum distance (px) of an edge point from the curve.
const MAX_RESIDUAL: f64 = 0.75;

/// Maximum sagitta over the chord: a fisheye bends a long side by 15 %, a quarter circle has 0.21.
const MAX_SAGITTA: f64 = 0.16;

/// Maximum distance, over the chord, from the rough corner to the intersection of the sides.
const MAX_CORNER_SHIFT: f64 = 0.25;

/// Smallest cross product of tangents used as a divisor, in squared pixels: sides so nearly
/// parallel do not meet, and are rejected by their angle.
const MIN_CROSS: f64 = 1e-3;

/// Number of Newton steps to the intersection of two curves; two suffice if they are almost
/// straight.
const NEWTON_STEPS: usize = 3;

/// Requirements on the sides of a quad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SideLimits {
    /// Minimum fraction of a side's points that lie on its curve, with the side's own contrast.
    pub least_inliers: f64,
    /// Same for the one side that another object may hide in part.
    pub least_inliers_hidden: f64,
    /// Maximum cosine of the angle between two sides at their corner.
    pub most_cosine: f64,
}

/// A quad whose four sides follow smooth edges to within a few tenths of a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedQuad {
    /// The sides, in the order of the rough ones.
    pub sides: Sides,
    /// Steps in grey levels across the sides, positive.
    pub contrasts: [f64; 4],
    /// Whether a side's edge is visible at each point; where it is not, another object covers it.
    pub seen: [[bool; POINTS_PER_SIDE]; 4],
}

/// Measures the sides of a quad, which must be clockwise on the screen and accurate to about a
/// pixel and a half; `None` unless all of them are smooth edges of its sign.
#[must_use]
pub fn fit_sides(
    picture: &GreyBytes<'_>,
    rough: &Sides,
    is_dark: bool,
    limits: &SideLimits,
) -> Option<FittedQuad> {
    let frames: [ChordFrame; 4] =
        std::array::from_fn(|k| ChordFrame::between(rough[k][0], rough[(k + 1) % 4][0]));
    let places = frames.map(|frame| frame.inner_places());
    let cubics = rough_cubics(rough, &frames, &places);
    let mut sides: Vec<Edge> = (0..4)
        .map(|k| Edge::at(frames[k], places[k], cubics[k]))
        .collect();
    measure_repeatedly(picture, is_dark, &mut sides);
    let intersections: [Intersection; 4] =
        std::array::from_fn(|k| Intersection::of(&sides[(k + 3) % 4], &sides[k]));
    let inliers: Vec<f64> = sides.iter().map(Edge::inliers).collect();
    let weakest = (1..4).fold(0, |least, k| {
        if inliers[k] < inliers[least] {
            k
        } else {
            least
        }
    });
    let mut quad = FittedQuad {
        sides: *rough,
        contrasts: std::array::from_fn(|k| sides[k].contrast),
        seen: std::array::from_fn(|k| match k == weakest {
            true => sides[k].is_on_curve,
            false => [true; POINTS_PER_SIDE],
        }),
    };
    for (k, side) in sides.iter().enumerate() {
        let ends = [&intersections[k], &intersections[(k + 1) % 4]];
        let least_inliers = match k == weakest {
            true => limits.least_inliers_hidden,
            false => limits.least_inliers,
        };
        let is_good =
            inliers[k] >= least_inliers && intersections[k].cosine.abs() <= limits.most_cosine;
        if !is_good {
            return None;
        }
        quad.sides[k] = side.points_between(ends)?;
    }
    Some(quad)
}

/// Measures the sides repeatedly until they no longer move.
fn measure_repeatedly(picture: &GreyBytes<'_>, is_dark: bool, sides: &mut [Edge]) {
    for _ in 0..ROUNDS {
        let before: Vec<_> = sides.iter().map(|side| side.curve).collect();
        measure(picture, is_dark, sides);
        let moved = sides.iter().zip(&before).flat_map(|(side, before)| {
            side.curve
                .iter()
                .zip(before)
                .map(|(now, then)| (now - then).abs())
        });
        if moved.fold(0.0, f64::max) < LAST_CHANGE {
            break;
        }
    }
}

/// Cubics through the rough points of the sides, without those near corners.
fn rough_cubics(
    rough: &Sides,
    frames: &[ChordFrame; 4],
    places: &[[f64; POINTS_PER_SIDE]; 4],
) -> Vec<Vector4<f64>> {
    let points = |k: usize| {
        let coordinates = rough[k].map(|point| frames[k].coordinates(point));
        let inner = places[k][0]..places[k][POINTS_PER_SIDE - 1];
        SidePoints {
            basis: coordinates.iter().map(|point| powers(point.x)).collect(),
            offsets: coordinates.iter().map(|point| point.y).collect(),
            used: coordinates
                .iter()
                .map(|point| point.x > inner.start && point.x < inner.end)
                .collect(),
            length: frames[k].length,
        }
    };
    trimmed_cubics(&(0..4).map(points).collect::<Vec<_>>())
}

/// Fits the curves of a quad's sides to the edges found beside them.
fn measure(picture: &GreyBytes<'_>, is_dark: bool, sides: &mut [Edge]) {
    let sign = if is_dark { 1.0 } else { -1.0 };
    let mut measured: Vec<SidePoints> = Vec::new();
    for side in sides.iter_mut() {
        let edges: [_; POINTS_PER_SIDE] = std::array::from_fn(|k| {
            let (step, contrast) = side.frame.edge(picture, side.places[k], side.curve[k]);
            (side.curve[k] + step, sign * contrast)
        });
        side.contrast = median(edges.iter().map(|edge| edge.1).collect()).unwrap_or(f64::NAN);
        let min_contrast = MIN_RELATIVE_CONTRAST * side.contrast.max(MIN_CONTRAST);
        measured.push(SidePoints {
            basis: side.places.iter().map(|place| powers(*place)).collect(),
            offsets: edges.iter().map(|edge| edge.0).collect(),
            used: edges.iter().map(|edge| edge.1 > min_contrast).collect(),
            length: side.frame.length,
        });
    }
    let trimmed = trimmed_cubics(&measured);
    for ((side, mut points), cubic) in sides.iter_mut().zip(measured).zip(trimmed) {
        side.is_on_curve = std::array::from_fn(|k| {
            let residual = points.offsets[k] - points.basis[k].dot(&cubic);
            points.used[k] && residual.abs() < MAX_RESIDUAL
        });
        points.used = side.is_on_curve.to_vec();
        side.set_cubic(points.cubic());
    }
}

/// The frame of a side's chord: position 0 to 1 along it, outward offset in pixels.
#[derive(Debug, Clone, Copy)]
struct ChordFrame {
    start: Vector2<f64>,
    direction: Vector2<f64>,
    outward: Vector2<f64>,
    length: f64,
}

impl ChordFrame {
    /// The frame of a chord of a quad with clockwise corners on the screen.
    fn between(start: Vector2<f64>, end: Vector2<f64>) -> Self {
        let length = (end - start).norm();
        let direction = (end - start) / length;
        Self {
            start,
            direction,
            outward: Vector2::new(direction.y, -direction.x),
            length,
        }
    }

    fn point(&self, place: f64, offset: f64) -> Vector2<f64> {
        self.start + self.direction * (place * self.length) + self.outward * offset
    }

    /// Position and offset of a point.
    fn coordinates(&self, point: Vector2<f64>) -> Vector2<f64> {
        let relative = point - self.start;
        Vector2::new(
            relative.dot(&self.direction) / self.length,
            relative.dot(&self.outward),
        )
    }

    /// Positions spread over the chord, without its ends.
    fn inner_places(&self) -> [f64; POINTS_PER_SIDE] {
        let [min, max] = END_MARGIN_FRACTIONS;
        let margin = (END_MARGIN_PIXELS / self.length).clamp(min, max);
        std::array::from_fn(|point| margin + (1.0 - 2.0 * margin) * fraction(point))
    }

    /// Outward distance (px) of the edge from a place, and its step from inside to outside.
    ///
    /// The sum of the normalised profile is the number of its pixels on the outer side. Unlike the
    /// steepest gradient it is not biased by noise and needs no interpolation.
    fn edge(&self, picture: &GreyBytes<'_>, place: f64, offset: f64) -> (f64, f64) {
        let profile: [f64; PROFILE] = std::array::from_fn(|k| {
            picture.bilinear(self.point(place, offset + f64::from(k as i32 - REACH)))
        });
        let mean = |levels: &[f64]| levels.iter().sum::<f64>() / PLATEAU_PIXELS as f64;
        let (inside, outside) = (
            mean(&profile[..PLATEAU_PIXELS]),
            mean(&profile[PROFILE - PLATEAU_PIXELS..]),
        );
        let contrast = outside - inside;
        let divisor = if contrast.abs() < MIN_DIVISOR {
            MIN_DIVISOR
        } else {
            contrast
        };
        let share =
            |level: &f64| ((level - inside) / divisor).clamp(-MAX_OVERSHOOT, 1.0 + MAX_OVERSHOOT);
        let outer: f64 = profile.iter().map(share).sum();
        (0.5 * PROFILE as f64 - outer, contrast)
    }
}

/// A side's curve, and the edge measured along it.
#[derive(Debug, Clone)]
struct Edge {
    frame: ChordFrame,
    /// Positions of its points along the chord.
    places: [f64; POINTS_PER_SIDE],
    cubic: Vector4<f64>,
    /// Offsets of the cubic at the positions.
    curve: [f64; POINTS_PER_SIDE],
    is_on_curve: [bool; POINTS_PER_SIDE],
    /// Step in grey levels, positive if it has the quad's sign.
    contrast: f64,
}

impl Edge {
    fn at(frame: ChordFrame, places: [f64; POINTS_PER_SIDE], cubic: Vector4<f64>) -> Self {
        let mut edge = Self {
            frame,
            places,
            cubic,
            curve: [0.0; POINTS_PER_SIDE],
            is_on_curve: [false; POINTS_PER_SIDE],
            contrast: 0.0,
        };
        edge.set_cubic(cubic);
        edge
    }

    fn set_cubic(&mut self, cubic: Vector4<f64>) {
        self.cubic = cubic;
        self.curve = self.places.map(|place| self.offset(place));
    }

    /// Fraction of its points that lie on its curve.
    fn inliers(&self) -> f64 {
        self.is_on_curve.iter().filter(|is_on| **is_on).count() as f64 / POINTS_PER_SIDE as f64
    }

    /// Points of its curve from corner to corner; `None` unless it has a small sagitta and the
    /// quad's sign, and ends near its rough corners.
    fn points_between(
        &self,
        [first, last]: [&Intersection; 2],
    ) -> Option<[Vector2<f64>; POINTS_PER_SIDE]> {
        let (first, last) = (first.on_second, last.on_first);
        let place = |point: usize| first + (last - first) * fraction(point);
        let offsets: [f64; POINTS_PER_SIDE] =
            std::array::from_fn(|point| self.offset(place(point)));
        let middle = 0.5 * (offsets[0] + offsets[POINTS_PER_SIDE - 1]);
        let sagitta = offsets
            .iter()
            .map(|offset| (offset - middle).abs())
            .fold(0.0, f64::max);
        let is_good = self.contrast >= MIN_CONTRAST
            && sagitta <= MAX_SAGITTA * self.frame.length
            && first.abs() < MAX_CORNER_SHIFT
            && (last - 1.0).abs() < MAX_CORNER_SHIFT;
        let point = |point: usize| self.frame.point(place(point), offsets[point]);
        is_good.then(|| std::array::from_fn(point))
    }

    fn offset(&self, place: f64) -> f64 {
        powers(place).dot(&self.cubic)
    }

    fn point(&self, place: f64) -> Vector2<f64> {
        self.frame.point(place, self.offset(place))
    }

    /// Derivative of the curve's points with respect to position.
    fn tangent(&self, place: f64) -> Vector2<f64> {
        let centred = 2.0 * place - 1.0;
        let slope =
            self.cubic[1] + 2.0 * self.cubic[2] * centred + 3.0 * self.cubic[3] * centred * centred;
        self.frame.direction * self.frame.length + self.frame.outward * (2.0 * slope)
    }
}

/// Intersection of two consecutive sides: the positions on both, and the cosine of the angle
/// between them.
struct Intersection {
    on_first: f64,
    on_second: f64,
    cosine: f64,
}

impl Intersection {
    /// The intersection by Newton's method, starting from the ends of the chords.
    fn of(first: &Edge, second: &Edge) -> Self {
        let (mut on_first, mut on_second, mut cosine) = (1.0, 0.0, 0.0);
        for _ in 0..NEWTON_STEPS {
            let gap = first.point(on_first) - second.point(on_second);
            let (first_tangent, second_tangent) =
                (first.tangent(on_first), second.tangent(on_second));
            let cross = first_tangent.perp(&second_tangent);
            let divisor = if cross.abs() < MIN_CROSS {
                MIN_CROSS
            } else {
                cross
            };
            // on_first * there - on_second * here = -gap, by Cramer's rule.
            on_first -= gap.perp(&second_tangent) / divisor;
            on_second -= gap.perp(&first_tangent) / divisor;
            on_second = on_second.clamp(-0.5, 0.5);
            on_first = on_first.clamp(0.5, 1.5);
            cosine =
                second_tangent.dot(&first_tangent) / (second_tangent.norm() * first_tangent.norm());
        }
        Self {
            on_first,
            on_second,
            cosine,
        }
    }
}

/// Cubic basis centred on the middle of the chord.
fn powers(place: f64) -> Vector4<f64> {
    let centred = 2.0 * place - 1.0;
    Vector4::new(1.0, centred, centred * centred, centred.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 80;
    const LIMITS: SideLimits = SideLimits {
        least_inliers: 0.85,
        least_inliers_hidden: 0.65,
        most_cosine: 0.9,
    };
    const CORNERS: [[f64; 2]; 4] = [[18.3, 20.6], [61.7, 17.4], [58.9, 60.2], [21.2, 57.8]];

    /// A dark quad, blurred by a pixel or so, with some pixels covered.
    fn picture(covers: impl Fn(usize, usize) -> bool) -> Vec<u8> {
        let frames = frames();
        let level = |index: usize| {
            let (x, y) = (index % SIZE, index / SIZE);
            if covers(x, y) {
                return 180;
            }
            let point = Vector2::new(x as f64, y as f64);
            let outside = frames.map(|frame| frame.coordinates(point).y);
            let nearest = outside.into_iter().fold(f64::NEG_INFINITY, f64::max);
            (60.0 + 120.0 * (0.5 + 0.5 * nearest).clamp(0.0, 1.0)).round() as u8
        };
        (0..SIZE * SIZE).map(level).collect()
    }

    fn frames() -> [ChordFrame; 4] {
        let corner = |k: usize| Vector2::from(CORNERS[k % 4]);
        std::array::from_fn(|k| ChordFrame::between(corner(k), corner(k + 1)))
    }

    /// Sides displaced alternately by up to a pixel, as contours are.
    fn rough() -> Sides {
        frames().map(|frame| std::array::from_fn(|k| frame.point(fraction(k), [1.0, -0.6][k % 2])))
    }

    #[test]
    fn sides_are_put_on_their_edges() {
        let values = picture(|_, _| false);
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        let quad = fit_sides(&picture, &rough(), true, &LIMITS).unwrap();
        for (side, corner) in quad.sides.iter().zip(CORNERS) {
            assert!(
                (side[0] - Vector2::from(corner)).amax() < 0.1,
                "{:?}",
                side[0]
            );
        }
        for (frame, side) in frames().iter().zip(&quad.sides) {
            assert!(
                side.iter()
                    .all(|point| frame.coordinates(*point).y.abs() < 0.1)
            );
        }
        assert!(
            quad.contrasts
                .iter()
                .all(|step| (step - 120.0).abs() < 10.0)
        );
        assert!(quad.seen.iter().flatten().all(|seen| *seen));
        // There are no such edges of the wrong sign, or on a plain ground.
        assert_eq!(fit_sides(&picture, &rough(), false, &LIMITS), None);
        let plain = vec![100; SIZE * SIZE];
        let plain = GreyBytes::new(SIZE, SIZE, &plain).unwrap();
        assert_eq!(fit_sides(&plain, &rough(), true, &LIMITS), None);
    }

    #[test]
    fn a_quarter_of_one_side_may_be_hidden_and_no_more() {
        for (width, is_good) in [(9, true), (25, false)] {
            let values = picture(|x, y| (30..30 + width).contains(&x) && y < 30);
            let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
            let quad = fit_sides(&picture, &rough(), true, &LIMITS);
            assert_eq!(quad.is_some(), is_good, "{width}");
            if let Some(quad) = quad {
                let hidden = |side: usize| quad.seen[side].iter().filter(|seen| !**seen).count();
                assert!((4..12).contains(&hidden(0)), "{}", hidden(0));
                assert_eq!(hidden(1) + hidden(2) + hidden(3), 0);
                assert!((quad.sides[0][0] - Vector2::from(CORNERS[0])).amax() < 0.3);
            }
        }
    }
}
