//! Crossings among saddle points: two light and two dark sectors alternate around them.

use std::collections::HashSet;
use std::f64::consts::PI;
use std::sync::LazyLock;

use nalgebra::Vector2;

use super::edge_following::Crossing;
use super::saddles::SaddleStep;
use crate::image::GreyBytes;

/// Maximum distance (px) of the saddle point from a candidate. At the corner of a single square the
/// grey levels have the curvature of a saddle, but also a slope: the saddle is farther away or does
/// not exist.
const MAX_OFFSET: f64 = 1.2;

/// Maximum distance (px) of the saddle if print beside it has displaced the candidate, and its
/// maximum one step later, when the nearest pixel is at most half a pixel away.
const FAR_OFFSET: f64 = 2.5;
const MAX_LAST_OFFSET: f64 = 0.6;

/// Maximum number of candidates that are used, the strongest: 30 boards of 10 x 10 cells. It bounds
/// the time in a picture of gravel or grass.
const MAX_CANDIDATES: usize = 4000;

/// Radius (px) of the ring on which the four sectors around a saddle are sampled: inside a cell of
/// five pixels.
const RING: f64 = 2.5;

/// Radius (px) of the ring on which the edges are located again: there the blur, which in the inner
/// ring turns them towards a right angle, has faded.
const FAR_RING: f64 = 5.0;

/// Maximum turn of an edge by blur, radians (34 degrees): beyond that it is another edge.
const MAX_TURNED: f64 = 0.6;

/// Minimum step of an edge at the pixels beside it, as a fraction of the step between light and
/// dark; with a smaller one it is the end of a cell.
const MIN_EDGE: f64 = 0.3;

/// Number of directions sampled around a saddle, per half turn.
const HALF_TURN: usize = 16;

/// Minimum step between a light and a dark sector over the mean step: noise and one-sided shading
/// leave more, the end of a line or a bend less.
const MIN_ALTERNATION: f64 = 0.5;

/// Values in the directions of half a turn; the other half turn has the same ones.
type Ring = [f64; HALF_TURN];

/// Unit vectors in all directions that are sampled.
static DIRECTIONS: LazyLock<[Vector2<f64>; 2 * HALF_TURN]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let angle = k as f64 * (PI / HALF_TURN as f64);
        Vector2::new(angle.cos(), angle.sin())
    })
});

/// Direction in which a ring crosses zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Falls,
    Rises,
}

/// A pixel at which the grey levels have the curvature of a saddle, more so than around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SaddleCandidate {
    /// Column and row.
    pub pixel: [usize; 2],
    /// Strength of the curvature; only the order matters.
    pub strength: f64,
}

/// Finds the crossings of two edges at or near candidates, each only once.
pub(super) fn crossings_at(
    picture: &GreyBytes<'_>,
    candidates: &[SaddleCandidate],
) -> Vec<Crossing> {
    let saddles = saddles_at(picture, candidates).into_iter();
    saddles
        .filter_map(|point| crossing_at(picture, point))
        .collect()
}

fn saddles_at(picture: &GreyBytes<'_>, candidates: &[SaddleCandidate]) -> Vec<Vector2<f64>> {
    let mut saddles = Vec::new();
    let mut displaced = Vec::new();
    let [width, height] = picture.size();
    let is_inside =
        |candidate: &SaddleCandidate| candidate.pixel[0] < width && candidate.pixel[1] < height;
    for candidate in strongest(candidates).into_iter().filter(is_inside) {
        let Some(step) = even_step(picture, candidate.pixel) else {
            continue;
        };
        let point = Vector2::from(candidate.pixel.map(|at| at as f64)) + step;
        match step.amax() {
            gap if gap < MAX_OFFSET => saddles.push(point),
            gap if gap < FAR_OFFSET => displaced.push(point),
            _ => {}
        }
    }
    let mut taken: HashSet<[isize; 2]> =
        saddles.iter().map(nearest_pixel).flat_map(around).collect();
    for point in displaced {
        let pixel = nearest_pixel(&point);
        if !taken.insert(pixel) {
            continue;
        }
        let Some(step) = even_step(picture, pixel.map(|at| at.max(0) as usize)) else {
            continue;
        };
        if step.amax() < MAX_LAST_OFFSET {
            saddles.push(Vector2::from(pixel.map(|at| at as f64)) + step);
        }
    }
    saddles
}

/// The strongest candidates, in their own order unless there are more than the maximum.
fn strongest(candidates: &[SaddleCandidate]) -> Vec<SaddleCandidate> {
    let mut candidates = candidates.to_vec();
    if candidates.len() > MAX_CANDIDATES {
        candidates.sort_by(|a, b| b.strength.total_cmp(&a.strength));
        candidates.truncate(MAX_CANDIDATES);
    }
    candidates
}

/// The vector from a pixel to the saddle, if that is about equally steep both ways.
fn even_step(picture: &GreyBytes<'_>, pixel: [usize; 2]) -> Option<Vector2<f64>> {
    let step = SaddleStep::from(picture, pixel)?;
    step.is_even().then_some(step.offset)
}

fn nearest_pixel(point: &Vector2<f64>) -> [isize; 2] {
    [point.x, point.y].map(|at| at.round_ties_even() as isize)
}

fn around([x, y]: [isize; 2]) -> impl Iterator<Item = [isize; 2]> {
    (y - 1..=y + 1).flat_map(move |y| (x - 1..=x + 1).map(move |x| [x, y]))
}

/// The crossing at a saddle, if two light and two dark sectors alternate around it.
///
/// The sectors of each opposite pair are nearly the same. The second derivatives would give the
/// directions of the sectors, but not their widths: after smoothing, those of every crossing of two
/// edges are as for a right angle.
fn crossing_at(picture: &GreyBytes<'_>, point: Vector2<f64>) -> Option<Crossing> {
    let shades = shades_around(picture, point, RING);
    let mean = opposite_means(&shades);
    let (light, dark) = (first_of(&mean, |a, b| a > b), first_of(&mean, |a, b| a < b));
    let step = mean[light] - mean[dark];
    let lightest = shades[light].min(shades[light + HALF_TURN]);
    let darkest = shades[dark].max(shades[dark + HALF_TURN]);
    if !(step > 0.0 && lightest - darkest > MIN_ALTERNATION * step) {
        return None;
    }
    let centred = mean.map(|shade| shade - 0.5 * (mean[light] + mean[dark]));
    let [falls, rises] = [Turn::Falls, Turn::Rises].map(|turn| sign_changes(&centred, turn));
    let ([fall], [rise]) = (&falls[..], &rises[..]) else {
        return None;
    };
    let inner_edges = [fall.place, rise.place];
    let turned = outer_edges(picture, point, inner_edges, step).unwrap_or(inner_edges);
    let [first, mut second] = turned.map(|turn| (turn * (PI / HALF_TURN as f64)).rem_euclid(PI));
    if second < first {
        second += PI;
    }
    let edges = [first, second].map(|angle| Vector2::new(angle.cos(), angle.sin()));
    Some(Crossing { point, edges })
}

/// Directions of the edges on a wider ring, if it shows both.
///
/// For edges that cross at an oblique angle, blur turns their inner parts towards a right angle.
fn outer_edges(
    picture: &GreyBytes<'_>,
    point: Vector2<f64>,
    inner_edges: [f64; 2],
    step: f64,
) -> Option<[f64; 2]> {
    let mean = opposite_means(&shades_around(picture, point, FAR_RING));
    let (highest, lowest) = mean
        .iter()
        .fold((f64::MIN, f64::MAX), |(highest, lowest), s| {
            (highest.max(*s), lowest.min(*s))
        });
    let centred = mean.map(|shade| shade - 0.5 * (highest + lowest));
    let mut found = inner_edges;
    for (edge, turn) in found.iter_mut().zip([Turn::Falls, Turn::Rises]) {
        let gaps = sign_changes(&centred, turn).into_iter().filter_map(|turn| {
            let beside =
                [turn.after + HALF_TURN - 1, turn.after + 2].map(|k| centred[k % HALF_TURN]);
            let gap = turn.place - *edge;
            let gap = gap - HALF_TURN as f64 * (gap / HALF_TURN as f64).round_ties_even();
            ((beside[0] - beside[1]).abs() > MIN_EDGE * step).then_some(gap)
        });
        let nearest = gaps.min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        if !(nearest.abs() < MAX_TURNED * HALF_TURN as f64 / PI) {
            return None;
        }
        *edge += nearest;
    }
    Some(found)
}

fn shades_around(
    picture: &GreyBytes<'_>,
    point: Vector2<f64>,
    radius: f64,
) -> [f64; 2 * HALF_TURN] {
    std::array::from_fn(|k| picture.level(point + DIRECTIONS[k] * radius))
}

fn opposite_means(shades: &[f64; 2 * HALF_TURN]) -> Ring {
    std::array::from_fn(|k| 0.5 * (shades[k] + shades[k + HALF_TURN]))
}

/// The first of the directions that come before all others in the given order.
fn first_of(ring: &Ring, is_before: impl Fn(f64, f64) -> bool) -> usize {
    (1..HALF_TURN).fold(0, |first, k| {
        if is_before(ring[k], ring[first]) {
            k
        } else {
            first
        }
    })
}

/// A place where a ring crosses zero.
struct SignChange {
    /// The direction before it.
    after: usize,
    /// Fractional direction, between that one and the next.
    place: f64,
}

/// The places where a ring falls below zero, or those where it rises above it.
fn sign_changes(centred: &Ring, turn: Turn) -> Vec<SignChange> {
    let is_above = |k: usize| centred[k % HALF_TURN] > 0.0;
    let was_above = turn == Turn::Falls;
    (0..HALF_TURN)
        .filter(|k| is_above(*k) == was_above && is_above(k + 1) != was_above)
        .map(|after| {
            let next = centred[(after + 1) % HALF_TURN];
            let place = after as f64 + centred[after] / (centred[after] - next);
            SignChange { after, place }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 40;

    /// Two edges that cross at a point in the given directions, blurred by a pixel or so.
    fn crossed_edges(point: Vector2<f64>, angles: [f64; 2]) -> Vec<u8> {
        let across = angles.map(|angle| Vector2::new(-angle.sin(), angle.cos()));
        let soft = |way: f64| (way / 1.2).tanh();
        let shade = |index: usize| {
            let way = Vector2::new((index % SIZE) as f64, (index / SIZE) as f64) - point;
            120.0 + 80.0 * soft(across[0].dot(&way)) * soft(across[1].dot(&way))
        };
        (0..SIZE * SIZE)
            .map(|index| shade(index).round() as u8)
            .collect()
    }

    fn found(values: &[u8], pixels: &[[usize; 2]]) -> Vec<Crossing> {
        let picture = GreyBytes::new(SIZE, SIZE, values).unwrap();
        let candidate = |pixel: &[usize; 2]| SaddleCandidate {
            pixel: *pixel,
            strength: 1.0,
        };
        crossings_at(&picture, &pixels.iter().map(candidate).collect::<Vec<_>>())
    }

    #[test]
    fn a_crossing_has_its_place_and_the_directions_of_its_edges() {
        for (first, between) in [(0.2, 1.6), (1.0, 1.2), (2.4, 1.9)] {
            let place = Vector2::new(19.3, 20.4);
            let values = crossed_edges(place, [first, first + between]);
            let crossings = found(&values, &[[19, 20]]);
            let [crossing] = &crossings[..] else {
                panic!("{crossings:?}")
            };
            assert!((crossing.point - place).amax() < 0.1, "{}", crossing.point);
            for angle in [first, first + between] {
                let way = Vector2::new(angle.cos(), angle.sin());
                let along = crossing.edges.map(|edge| edge.dot(&way).abs());
                assert!(along[0].max(along[1]) > 0.98, "{angle}: {along:?}");
            }
            let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
            for (edge, is_dark) in crossing.edges.iter().zip([true, false]) {
                let clockwise = Vector2::new(-edge.y, edge.x);
                let level = picture.level(crossing.point + edge * 5.0 + clockwise * 2.0);
                assert_eq!(level < 120.0, is_dark);
            }
        }
    }

    #[test]
    fn a_crossing_is_found_once_and_from_two_pixels_away() {
        let values = crossed_edges(Vector2::new(20.0, 20.0), [0.1, 1.6]);
        assert_eq!(found(&values, &[[20, 20], [22, 20], [18, 20]]).len(), 1);
    }

    #[test]
    fn a_single_edge_and_pixels_outside_are_no_crossings() {
        let edge: Vec<u8> = (0..SIZE * SIZE)
            .map(|i| if i % SIZE < 20 { 30 } else { 200 })
            .collect();
        assert!(found(&edge, &[[19, 20], [20, 20]]).is_empty());
        let values = crossed_edges(Vector2::new(20.0, 20.0), [0.1, 1.6]);
        let outside = [[usize::MAX, 20], [20, SIZE], [0, 0]];
        assert!(found(&values, &outside).is_empty());
        let noise = vec![
            SaddleCandidate {
                pixel: [20, 20],
                strength: f64::NAN
            };
            MAX_CANDIDATES + 1
        ];
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        assert!(crossings_at(&picture, &noise).len() <= MAX_CANDIDATES);
    }
}
