//! Contours with four corners, and their sides, at many levels of a picture.
//!
//! A threshold between figure and ground turns a square into one connected region, whatever its
//! sides look like. If a finger, glare or a tear covers part of its rim, the region has a notch,
//! which no polygon of four corners fits; its convex hull still has the right corners.

use nalgebra::Vector2;

use super::contours::{Contour, ContourLimits, contours};
use super::polygon::{Pixel, convex_hull, is_convex, oriented_area, perimeter, polygon};
use crate::image::GreyBytes;

/// Number of points at which a side of an outline is sampled, from corner to corner.
pub const POINTS_PER_SIDE: usize = 32;

/// Minimum area over the squared length of a side: that of a rhombus of 25 degrees.
const MIN_SINE: f64 = 0.4;

/// Minimum area over the squared number of contour points: 1/16 for an upright square, 1/8 for one
/// on its tip, 0.026 for a rhombus of 25 degrees; ragged texture has far less.
const MIN_COMPACTNESS: f64 = 0.02;
/// Same with a notch or, for a frame that is cut through, with the hole's outline included.
const MIN_NOTCHED_COMPACTNESS: f64 = 0.008;
/// Minimum number of points of a contour with a missing piece, which is mended only for sides of 25
/// px or more.
const MIN_NOTCHED_POINTS: usize = 100;

/// Tolerances of the polygon, over the contour's length: a sagitta of 4 % of a side is 1 % of the
/// length, and the last tolerance still distinguishes a rhombus of 25 degrees from a line.
const TOLERANCES: [f64; 3] = [0.02, 0.035, 0.05];
/// Maximum relative difference between the areas of contour and polygon; for sides that all bulge
/// by 10 % it is 27 %.
const AREA_SLACK: f64 = 0.3;

/// Tolerances of the hull's polygon, over its length: a bulge of 4 % of a side is 1 %.
const HULL_TOLERANCES: [f64; 2] = [0.015, 0.03];
/// Minimum area over the hull's: a notch removes a tenth, and a frame that is cut through lacks its
/// hole.
const MIN_HULL_SHARE: f64 = 0.55;

/// Tolerance of a region's polygon from its hull, over the hull's length ...
const REGION_TOLERANCE: f64 = 0.06;
/// ... and minimum fraction of the polygon that the region's outline encloses.
const MIN_POLYGON_SHARE: f64 = 0.8;

/// Points of a closed outline's sides, each from one corner to the next, including both.
pub type Sides = [[Vector2<f64>; POINTS_PER_SIDE]; 4];

/// A contour with four corners.
#[derive(Debug, Clone, PartialEq)]
pub struct FourSided {
    /// The sides, clockwise on the screen (x right, y down), pixels.
    pub sides: Sides,
    /// Level at which it was found.
    pub level: u8,
    /// Whether its inside is not above the level.
    pub is_dark: bool,
}

/// Finds the contours with four corners at some levels of a picture.
///
/// Their sides are at least about `least_side` long, and they are at least `margin` pixels from the
/// border.
#[must_use]
pub fn four_sided(
    picture: &GreyBytes<'_>,
    levels: &[u8],
    least_side: f64,
    margin: i32,
) -> Vec<FourSided> {
    let limits = ContourLimits {
        // An 8-connected contour has at least length / sqrt(2) points.
        points: (4.0 * least_side / 2f64.sqrt()) as usize,
        side: 1,
        area: MIN_SINE * least_side * least_side,
        compactness: MIN_NOTCHED_COMPACTNESS,
        margin,
        holes: true,
    };
    let mut found = Vec::new();
    for (level, contours) in levels.iter().zip(contours(picture, levels, &limits)) {
        for contour in contours {
            let Some(mut sides) = sides_of(&contour) else {
                continue;
            };
            // Contours of holes are clockwise, others anticlockwise.
            let is_dark = contour.area > 0.0;
            if !is_dark {
                sides.reverse();
                sides.iter_mut().for_each(|side| side.reverse());
            }
            found.push(FourSided {
                sides,
                level: *level,
                is_dark,
            });
        }
    }
    found
}

/// Finds the corners of the regions of a mask that have four, clockwise on the screen.
///
/// Both sides of a region's bounding box are at least `least_side` long.
#[must_use]
pub fn four_cornered(mask: &GreyBytes<'_>, least_side: i32) -> Vec<[Pixel; 4]> {
    let limits = ContourLimits {
        points: 1,
        side: least_side,
        area: 0.0,
        compactness: 0.0,
        margin: 0,
        holes: false,
    };
    let corners = |contour: &Contour| {
        let hull = convex_hull(&contour.points);
        let corners = polygon(&hull, REGION_TOLERANCE * perimeter(&hull));
        let mut corners: [Pixel; 4] = corners.try_into().ok()?;
        let area = oriented_area(&corners);
        if area < 0.0 {
            corners.reverse();
        }
        (contour.area.abs() > MIN_POLYGON_SHARE * area.abs()).then_some(corners)
    };
    let found = contours(mask, &[0], &limits);
    found.iter().flatten().filter_map(corners).collect()
}

/// Sides of a contour in its own order, if it or its hull has four corners.
fn sides_of(contour: &Contour) -> Option<Sides> {
    let count = contour.points.len();
    let is_compact = contour.area.abs() >= MIN_COMPACTNESS * (count * count) as f64;
    let whole = is_compact.then(|| whole_sides(contour)).flatten();
    whole.or_else(|| (count >= MIN_NOTCHED_POINTS).then(|| notched_sides(contour))?)
}

/// The first polygon with four or fewer corners, for increasing tolerances; `None` unless it has
/// four.
fn with_four_corners(points: &[Pixel], length: f64, tolerances: &[f64]) -> Option<[Pixel; 4]> {
    let mut polygons = tolerances
        .iter()
        .map(|tolerance| polygon(points, tolerance * length));
    polygons.find(|corners| corners.len() <= 4)?.try_into().ok()
}

/// Points of a contour with four corners, at equal steps from corner to corner.
fn whole_sides(contour: &Contour) -> Option<Sides> {
    let count = contour.points.len();
    let corners = with_four_corners(&contour.points, count as f64, &TOLERANCES)?;
    let area = contour.area.abs();
    let area_error = (oriented_area(&corners).abs() - area).abs();
    if !is_convex(&corners) || area_error > AREA_SLACK * area {
        return None;
    }
    let place = |corner: &Pixel| contour.points.iter().position(|point| point == corner);
    let mut places = [0; 4];
    for (found, corner) in places.iter_mut().zip(&corners) {
        *found = place(corner)?;
    }
    places.sort_unstable();
    let side = |number: usize| {
        let start = places[number] as f64;
        let end = match number {
            3 => (places[0] + count) as f64,
            _ => places[number + 1] as f64,
        };
        std::array::from_fn(|k| {
            let place = start + (end - start) * fraction(k);
            let [x, y] = contour.points[(place + 0.5) as usize % count];
            Vector2::new(f64::from(x), f64::from(y))
        })
    };
    Some(std::array::from_fn(side))
}

/// Sides of a region whose convex hull has four corners: its outermost points, including those in a
/// notch.
fn notched_sides(contour: &Contour) -> Option<Sides> {
    let hull = convex_hull(&contour.points);
    if contour.area.abs() < MIN_HULL_SHARE * oriented_area(&hull).abs() {
        return None;
    }
    let mut corners = with_four_corners(&hull, perimeter(&hull), &HULL_TOLERANCES)?;
    if oriented_area(&corners) * contour.area < 0.0 {
        corners.reverse();
    }
    let corners = corners.map(|[x, y]| Vector2::new(f64::from(x), f64::from(y)));
    let side = |k: usize| {
        outermost(
            &contour.points,
            corners[k],
            corners[(k + 1) % 4],
            contour.area,
        )
    };
    Some(std::array::from_fn(side))
}

/// The points of a contour that are farthest outward along a chord.
fn outermost(
    points: &[Pixel],
    start: Vector2<f64>,
    end: Vector2<f64>,
    area: f64,
) -> [Vector2<f64>; POINTS_PER_SIDE] {
    let chord = end - start;
    let length = chord.x.hypot(chord.y);
    let outward = Vector2::new(chord.y, -chord.x) / (length * area.signum());
    let last = POINTS_PER_SIDE - 1;
    let mut farthest = [f64::NEG_INFINITY; POINTS_PER_SIDE];
    for &[x, y] in points {
        let offset = Vector2::new(f64::from(x), f64::from(y)) - start;
        let place = (offset.dot(&chord) / (length * length) * last as f64).round_ties_even();
        if (0.0..=last as f64).contains(&place) {
            let value = &mut farthest[place as usize];
            *value = value.max(offset.dot(&outward));
        }
    }
    (farthest[0], farthest[last]) = (0.0, 0.0);
    fill_gaps(&mut farthest);
    std::array::from_fn(|k| start + chord * fraction(k) + outward * farthest[k])
}

/// Interpolates values that are not finite between finite ones; both ends are finite.
fn fill_gaps(values: &mut [f64]) {
    let mut known = 0;
    for place in 1..values.len() {
        if !values[place].is_finite() {
            continue;
        }
        let slope = (values[place] - values[known]) / (place - known) as f64;
        for gap in known + 1..place {
            values[gap] = values[known] + slope * (gap - known) as f64;
        }
        known = place;
    }
}

/// Position of a point along its side, 0 to 1.
pub(super) fn fraction(point: usize) -> f64 {
    point as f64 / (POINTS_PER_SIDE - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 80;

    /// A light picture with dark pixels.
    fn drawn(is_dark: impl Fn(i32, i32) -> bool) -> Vec<u8> {
        let at = |index: usize| ((index % SIZE) as i32, (index / SIZE) as i32);
        let level = |index| {
            if is_dark(at(index).0, at(index).1) {
                40
            } else {
                200
            }
        };
        (0..SIZE * SIZE).map(level).collect()
    }

    fn found(values: &[u8]) -> Vec<FourSided> {
        let picture = GreyBytes::new(SIZE, SIZE, values).unwrap();
        four_sided(&picture, &[100], 12.0, 4)
    }

    /// Whether the corners are near (20, 20), (59, 20), (59, 59) and (20, 59), clockwise from any
    /// of them.
    fn is_square(sides: &Sides) -> bool {
        let first = sides[0][0];
        let turns = [(20.0, 20.0), (59.0, 20.0), (59.0, 59.0), (20.0, 59.0)];
        let near = |point: Vector2<f64>, (x, y)| (point - Vector2::new(x, y)).amax() <= 1.5;
        let Some(start) = turns.iter().position(|corner| near(first, *corner)) else {
            return false;
        };
        (0..4).all(|k| {
            near(sides[k][0], turns[(start + k) % 4])
                && near(sides[k][POINTS_PER_SIDE - 1], turns[(start + k + 1) % 4])
        })
    }

    #[test]
    fn a_square_is_found_dark_or_light_and_with_a_bite_out_of_it() {
        let square = |x: i32, y: i32| (20..60).contains(&x) && (20..60).contains(&y);
        let bite = |x: i32, y: i32| (x - 60).pow(2) + (y - 40).pow(2) < 64;
        let bitten = |x, y| square(x, y) && !bite(x, y);
        for dark in [drawn(square), drawn(bitten)] {
            let light: Vec<u8> = dark.iter().map(|level| 240 - level).collect();
            for (values, is_dark) in [(dark, true), (light, false)] {
                let [quad] = &found(&values)[..] else {
                    panic!("one quad")
                };
                assert_eq!((quad.is_dark, quad.level), (is_dark, 100));
                assert!(is_square(&quad.sides), "{:?}", quad.sides);
            }
        }
    }

    #[test]
    fn a_disc_a_triangle_and_what_is_at_the_border_are_no_quads() {
        let disc = |x: i32, y: i32| (x - 40).pow(2) + (y - 40).pow(2) < 400;
        let triangle = |x: i32, y: i32| (20..60).contains(&y) && 2 * (x - 40).abs() < y - 20;
        let at_border = |x: i32, y: i32| (2..40).contains(&x) && (20..60).contains(&y);
        let small = |x: i32, y: i32| (40..47).contains(&x) && (40..47).contains(&y);
        for values in [drawn(disc), drawn(triangle), drawn(at_border), drawn(small)] {
            assert_eq!(found(&values), []);
        }
    }

    #[test]
    fn corners_of_regions_run_clockwise_and_blunt_ones_count() {
        let blunt = |x: i32, y: i32| {
            (20..60).contains(&x) && (20..60).contains(&y) && (41..118).contains(&(x + y))
        };
        let mask: Vec<u8> = drawn(blunt)
            .iter()
            .map(|level| 255 * u8::from(*level < 100))
            .collect();
        let mask = GreyBytes::new(SIZE, SIZE, &mask).unwrap();
        let [corners] = &four_cornered(&mask, 10)[..] else {
            panic!("one region")
        };
        assert!(oriented_area(corners) > 1400.0);
        assert!(four_cornered(&mask, 41).is_empty());
    }
}
