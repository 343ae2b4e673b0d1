//! Polygons that approximate contours, and convex hulls of contours; in whole pixels.

/// A column and a row.
pub(super) type Pixel = [i32; 2];

/// Number of initial searches for the point farthest from the last one found.
const FAR_SEARCHES: usize = 3;

/// Distance of a corner from the line between its neighbours, over the tolerance, below which it is
/// dropped (both squared).
const MAX_STRAIGHT_RATIO: f64 = 0.5;

/// The corners of a polygon from which no point of a closed contour is farther than a tolerance.
///
/// D. H. Douglas, T. K. Peucker, Cartographica 10 (1973) 112-122, starting from two points that are
/// far from each other; remaining corners that are nearly straight are dropped.
pub(super) fn polygon(contour: &[Pixel], tolerance: f64) -> Vec<Pixel> {
    let count = contour.len();
    let squared_tolerance = tolerance * tolerance;
    let (mut first, mut offset, mut longest) = (0, 0, 0);
    for _ in 0..FAR_SEARCHES {
        first = (first + offset) % count.max(1);
        longest = 0;
        for ahead in 1..count {
            let length = squared(difference(contour[first], contour[(first + ahead) % count]));
            if length > longest {
                (longest, offset) = (length, ahead);
            }
        }
    }
    if longest as f64 <= squared_tolerance {
        return contour.get(first).copied().into_iter().collect();
    }
    let mut corners = Vec::new();
    // Runs of points whose corners are still to be found; the first one is at the end.
    let far_point = first + offset;
    let mut open = vec![(far_point, first + count), (first, far_point)];
    while let Some((start, end)) = open.pop() {
        match farthest(contour, start, end, squared_tolerance) {
            Some(place) => open.extend([(place, end), (start, place)]),
            None => corners.push(contour[start % count]),
        }
    }
    drop_straight(&mut corners, MAX_STRAIGHT_RATIO * squared_tolerance);
    corners
}

/// The point of a run that is farthest from its chord, if that is farther than the tolerance.
fn farthest(contour: &[Pixel], start: usize, end: usize, squared_tolerance: f64) -> Option<usize> {
    let at = |place: usize| contour[place % contour.len()];
    let (from, to) = (at(start), at(end));
    let chord = difference(from, to);
    let squared_chord = squared(chord);
    // Squared distances are multiplied by the chord's squared length, which keeps them whole
    // numbers.
    let mut greatest = 0;
    let mut found = start;
    for place in start + 1..end {
        let offset = difference(from, at(place));
        let along = offset[0] * chord[0] + offset[1] * chord[1];
        let distance = if along < 0 {
            squared(offset) * squared_chord
        } else if along > squared_chord {
            squared(difference(to, at(place))) * squared_chord
        } else {
            let across = offset[1] * chord[0] - offset[0] * chord[1];
            across * across
        };
        if distance > greatest {
            (greatest, found) = (distance, place);
        }
    }
    (greatest as f64 > squared_tolerance * squared_chord as f64).then_some(found)
}

/// Drops nearly straight corners of a polygon, but never two in succession.
fn drop_straight(corners: &mut Vec<Pixel>, squared_tolerance: f64) {
    let count = corners.len();
    let Some(&last) = corners.last() else { return };
    let (mut before, mut corner) = (last, corners[0]);
    let (mut read, mut written, mut remaining) = (1, 0, count);
    let mut examined = 0;
    while examined < count && remaining > 2 {
        let next = corners[read % count];
        read += 1;
        let chord = difference(before, next);
        let (arriving, leaving) = (difference(before, corner), difference(corner, next));
        let off = arriving[0] * chord[1] - arriving[1] * chord[0];
        let is_straight = (off * off) as f64 <= squared_tolerance * squared(chord) as f64
            && chord[0] != 0
            && chord[1] != 0
            && arriving[0] * leaving[0] + arriving[1] * leaving[1] >= 0;
        if is_straight {
            remaining -= 1;
            examined += 1;
            (before, corner) = (next, corners[read % count]);
            read += 1;
        } else {
            (before, corner) = (corner, next);
        }
        corners[written] = before;
        written += 1;
        examined += 1;
    }
    corners.truncate(remaining);
}

/// The corners of the convex hull of a closed contour, clockwise on the screen (x right, y down).
///
/// They start where the contour starts, or ends if it is anticlockwise.
pub(super) fn convex_hull(contour: &[Pixel]) -> Vec<Pixel> {
    let mut order: Vec<usize> = (0..contour.len()).collect();
    order.sort_unstable_by_key(|place| (contour[*place], *place));
    order.dedup_by_key(|place| contour[*place]);
    if order.len() < 3 {
        return order.iter().map(|place| contour[*place]).collect();
    }
    // From right to left below, and from left to right above.
    let below = half_hull(contour, order.iter().rev());
    let above = half_hull(contour, order.iter());
    let mut hull = [&below[..below.len() - 1], &above[..above.len() - 1]].concat();
    let runs_alike = {
        let rises = |k: &usize| hull[*k] < hull[(k + 1) % hull.len()];
        2 * (0..hull.len()).filter(rises).count() > hull.len()
    };
    let first = match runs_alike {
        true => hull.iter().enumerate().min_by_key(|(_, place)| **place),
        false => hull.iter().enumerate().max_by_key(|(_, place)| **place),
    };
    let first = first.map_or(0, |(number, _)| number);
    hull.rotate_left(first);
    hull.iter().map(|place| contour[*place]).collect()
}

/// A chain of points that only turns to the right on the screen.
fn half_hull<'a>(contour: &[Pixel], order: impl Iterator<Item = &'a usize>) -> Vec<usize> {
    let mut chain: Vec<usize> = Vec::new();
    for &place in order {
        while let [.., before, last] = chain[..] {
            let (first, second) = (
                difference(contour[before], contour[last]),
                difference(contour[last], contour[place]),
            );
            if first[0] * second[1] - first[1] * second[0] > 0 {
                break;
            }
            chain.pop();
        }
        chain.push(place);
    }
    chain
}

/// Length of a closed polygon.
pub(super) fn perimeter(corners: &[Pixel]) -> f64 {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    sides
        .map(|(a, b)| (squared(difference(*a, *b)) as f64).sqrt())
        .sum()
}

/// Area of a closed polygon, positive if it is clockwise on the screen.
pub(super) fn oriented_area(corners: &[Pixel]) -> f64 {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let doubled: i64 = sides
        .map(|(a, b)| i64::from(a[0]) * i64::from(b[1]) - i64::from(a[1]) * i64::from(b[0]))
        .sum();
    0.5 * doubled as f64
}

/// Whether a closed polygon turns in the same direction at all corners.
pub(super) fn is_convex(corners: &[Pixel]) -> bool {
    let count = corners.len();
    let turn = |k: usize| {
        let first = difference(corners[k], corners[(k + 1) % count]);
        let second = difference(corners[(k + 1) % count], corners[(k + 2) % count]);
        (first[0] * second[1] - first[1] * second[0]).signum()
    };
    count > 2 && turn(0) != 0 && (1..count).all(|k| turn(k) == turn(0))
}

fn difference(from: Pixel, to: Pixel) -> [i64; 2] {
    std::array::from_fn(|axis| i64::from(to[axis]) - i64::from(from[axis]))
}

fn squared(vector: [i64; 2]) -> i64 {
    vector[0] * vector[0] + vector[1] * vector[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pixels along a closed polygon, from one corner to the next.
    fn along(corners: &[Pixel]) -> Vec<Pixel> {
        let sides = corners.iter().zip(corners.iter().cycle().skip(1));
        sides
            .flat_map(|(a, b)| {
                let way = difference(*a, *b);
                let count = way[0].abs().max(way[1].abs());
                (0..count).map(move |k| {
                    let at = |axis: usize| a[axis] + (way[axis] * k / count) as i32;
                    [at(0), at(1)]
                })
            })
            .collect()
    }

    fn sorted(mut corners: Vec<Pixel>) -> Vec<Pixel> {
        corners.sort_unstable();
        corners
    }

    #[test]
    fn the_corners_of_a_quad_are_found_wherever_its_contour_begins() {
        let quad = [[10, 12], [60, 20], [52, 71], [5, 55]];
        let mut contour = along(&quad);
        for _ in 0..6 {
            contour.rotate_left(17);
            let found = sorted(polygon(&contour, 3.0));
            assert_eq!(found.len(), 4);
            for (corner, own) in sorted(quad.to_vec()).iter().zip(&found) {
                assert!(squared(difference(*corner, *own)) <= 4, "{found:?}");
            }
        }
        assert_eq!(polygon(&contour, 100.0).len(), 1);
        assert!(polygon(&[], 1.0).is_empty());
        assert_eq!(polygon(&[[3, 4]], 0.0), [[3, 4]]);
    }

    #[test]
    fn the_hull_leaves_out_a_notch_and_runs_clockwise() {
        let notched = [[0, 0], [40, 0], [40, 40], [20, 15], [0, 40]];
        for contour in [along(&notched), along(&notched).into_iter().rev().collect()] {
            let hull = convex_hull(&contour);
            assert_eq!(sorted(hull.clone()), [[0, 0], [0, 40], [40, 0], [40, 40]]);
            assert_eq!((oriented_area(&hull), perimeter(&hull)), (1600.0, 160.0));
            assert!(is_convex(&hull) && !is_convex(&notched));
        }
        assert_eq!(convex_hull(&[[1, 1], [2, 2], [1, 1]]).len(), 2);
        assert_eq!(
            sorted(convex_hull(&[[0, 0], [1, 1], [2, 2]])),
            [[0, 0], [2, 2]]
        );
    }
}
