//! Which crossings of a chessboard's grid lines follow one another: along an edge of the picture.
//!
//! A crossing has four directions, numbered clockwise on the screen so that clockwise of
//! directions 0 and 2 it is dark, and of 1 and 3 light. The next crossing of a grid line has its
//! dark and light cells the other way round: an even direction of one leads to an odd direction of
//! the other.

use nalgebra::Vector2;

use crate::image::GreyBytes;

/// Cosine of how far a neighbour may be beside an edge's direction: 18 degrees, for what noise and
/// the smoothing of slanted edges do to the direction.
const MISALIGNED: f64 = 0.95;

/// The same of a neighbour that is looked for first: 10 degrees, as all but small cells have it.
/// What is printed in a cell crosses its white rim, whose middle is 15 degrees beside the cell's
/// edge.
const MISALIGNED_LITTLE: f64 = 0.985;

/// The same as the first next to a crossing, where the corner of a slanted cell is as small as the
/// blur: 33 degrees.
const MISALIGNED_NEAR: f64 = 0.84;

/// Pixels up to which a neighbour is that near.
const NEAR: f64 = 12.0;

/// Where the edge between two crossings is looked at, as fractions of the way. The blur of the
/// crossings themselves reaches farther in the shortest cells only, where it is symmetric.
const PLACES: [f64; 6] = [0.15, 0.3, 0.43, 0.57, 0.7, 0.85];

/// Pixels beside an edge where it is light or dark: the blur has faded enough for a sign, and the
/// white rim of a cell that holds a marker, an eighth of the cell, is not yet crossed.
const BESIDE: f64 = 1.3;

/// Pixels from a crossing within which the cell opposite is reached beside the edge, if the two
/// edges cross aslant; but the middle of the way, from this fraction on, is always looked at.
const CORNER: f64 = 2.2;
const MIDDLE: f64 = 0.36;

/// Least step across an edge over the mean of all its places: noise and shading leave more.
const FAINTEST: f64 = 0.5;

/// The same at the first and the last place: next to a crossing the step fades, the more so the
/// more aslant the two edges cross. Noise alone would leave a step of either sign.
const FAINTEST_END: f64 = 0.1;

/// Grey levels across an edge: a tenth of a contrast of 30, for what two pixels of blur leave of
/// it; noise would not step the same way at all of `PLACES`.
const MIN_STEP: f64 = 3.0;

/// Crossings that are tried in one direction, the nearest first: what is printed in a cell, or
/// lies beside its edge, comes before the next crossing.
const MAX_TRIED: usize = 12;

/// A place where two edges cross, and the unit vectors of directions 0 and 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// In pixels.
    pub point: Vector2<f64>,
    /// Clockwise of the first it is dark, of the second, which comes next clockwise, light.
    pub edges: [Vector2<f64>; 2],
}

/// The crossing that follows in some direction, and which of its own directions leads back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Follower {
    /// Number of the crossing.
    pub crossing: usize,
    /// Direction, 0 to 3.
    pub back: usize,
}

/// What follows a crossing in its four directions.
pub type Followers = [Option<Follower>; 4];

impl GreyBytes<'_> {
    /// Whether one edge leads all the way from one point to another, dark clockwise of the way
    /// (on the right hand, as y points down) or light.
    #[must_use]
    pub fn has_edge(&self, start: Vector2<f64>, end: Vector2<f64>, dark_clockwise: bool) -> bool {
        self.has_edge_beyond(0.0, start, end, dark_clockwise)
    }

    /// The same, but for so many pixels at both ends of the way.
    fn has_edge_beyond(
        &self,
        corner: f64,
        start: Vector2<f64>,
        end: Vector2<f64>,
        dark_clockwise: bool,
    ) -> bool {
        let way = end - start;
        let length = way.norm();
        if !(length > 0.0 && length.is_finite()) {
            return false;
        }
        let clockwise = Vector2::new(-way.y, way.x) * (BESIDE / length);
        let sign = if dark_clockwise { 1.0 } else { -1.0 };
        let mut steps = [0.0; PLACES.len()];
        let first = (corner / length).clamp(PLACES[0], MIDDLE);
        for (step, place) in steps.iter_mut().zip(PLACES) {
            let on_edge = start + way * place.clamp(first, 1.0 - first);
            *step = sign * (self.at(on_edge - clockwise) - self.at(on_edge + clockwise));
            if *step <= 0.0 {
                return false;
            }
        }
        let [start_step, between @ .., end_step] = steps;
        let mean = steps.iter().sum::<f64>() / PLACES.len() as f64;
        mean > MIN_STEP
            && start_step.min(end_step) > FAINTEST_END * mean
            && between.iter().all(|step| *step > FAINTEST * mean)
    }
}

impl Crossing {
    /// The direction that a vector follows, if it follows one.
    #[must_use]
    pub fn direction(&self, vector: Vector2<f64>) -> Option<usize> {
        let (direction, along) = self.nearest_direction(vector);
        (along * along >= MISALIGNED * MISALIGNED * vector.norm_squared()).then_some(direction)
    }

    /// The direction nearest to that of a vector, and the vector's part along it.
    #[inline]
    fn nearest_direction(&self, vector: Vector2<f64>) -> (usize, f64) {
        let along = [self.edges[0].dot(&vector), self.edges[1].dot(&vector)];
        let edge = usize::from(along[1].abs() > along[0].abs());
        (edge + 2 * usize::from(along[edge] < 0.0), along[edge])
    }
}

/// Links each crossing to the nearest ones that an edge of the picture leads to.
///
/// Returns what follows each crossing in its directions 0 to 3. A link is the nearest at both of
/// its ends.
#[must_use]
pub fn link_crossings(picture: &GreyBytes<'_>, crossings: &[Crossing]) -> Vec<Followers> {
    let from_each = crossings.iter();
    let nearest: Vec<[Followers; PASSES.len()]> = from_each
        .map(|from| nearest_of(picture, crossings, from))
        .collect();
    let mut links = vec![[None; 4]; crossings.len()];
    for pass in 0..PASSES.len() {
        add_links(&mut links, &mutual_links(&nearest, pass));
    }
    links
}

/// Adds links between directions of which neither has one yet.
fn add_links(links: &mut [Followers], others: &[Followers]) {
    for (number, others) in others.iter().enumerate() {
        for (direction, other) in others.iter().enumerate() {
            let Some(follower) = *other else { continue };
            let returning = links[follower.crossing][follower.back];
            let back = Follower {
                crossing: number,
                back: direction,
            };
            if links[number][direction].is_none() && returning.is_none_or(|it| it == back) {
                links[number][direction] = Some(follower);
                links[follower.crossing][follower.back] = Some(back);
            }
        }
    }
}

/// How many crossings hang together, in each group of them; those of fewer than two links are in
/// none.
pub(super) fn linked_groups(links: &[Followers]) -> Vec<usize> {
    let is_linked = |number: usize| links[number].iter().flatten().count() >= 2;
    let mut is_new: Vec<bool> = (0..links.len()).map(is_linked).collect();
    let mut groups = Vec::new();
    for first in 0..links.len() {
        if !std::mem::take(&mut is_new[first]) {
            continue;
        }
        let (mut waiting, mut count) = (vec![first], 0);
        while let Some(number) = waiting.pop() {
            count += 1;
            for follower in links[number].iter().flatten() {
                if std::mem::take(&mut is_new[follower.crossing]) {
                    waiting.push(follower.crossing);
                }
            }
        }
        groups.push(count);
    }
    groups
}

/// Which neighbours are looked for at a time.
#[derive(Debug, Clone, Copy)]
struct Pass {
    /// Cosine of how far a neighbour may be beside an edge's direction.
    aligned: f64,
    /// Pixels to the farthest.
    reach: f64,
    /// Pixels at both ends of the way that are not looked at.
    corner: f64,
}

const PASSES: [Pass; 3] = [
    Pass {
        aligned: MISALIGNED_LITTLE,
        reach: f64::INFINITY,
        corner: 0.0,
    },
    Pass {
        aligned: MISALIGNED,
        reach: f64::INFINITY,
        corner: 0.0,
    },
    Pass {
        aligned: MISALIGNED_NEAR,
        reach: NEAR,
        corner: CORNER,
    },
];

/// Links of a pass that are the nearest at both of their ends.
fn mutual_links(nearest: &[[Followers; PASSES.len()]], pass: usize) -> Vec<Followers> {
    let mutual = |number: usize, direction: usize| {
        nearest[number][pass][direction].filter(|follower| {
            let home = Follower {
                crossing: number,
                back: direction,
            };
            nearest[follower.crossing][pass][follower.back] == Some(home)
        })
    };
    (0..nearest.len())
        .map(|number| std::array::from_fn(|direction| mutual(number, direction)))
        .collect()
}

/// The nearest crossings, pass by pass, that an edge leads to from one.
///
/// All pairs of crossings are looked at, but only once for all passes.
fn nearest_of(
    picture: &GreyBytes<'_>,
    crossings: &[Crossing],
    from: &Crossing,
) -> [Followers; PASSES.len()] {
    let mut aligned: [[Vec<(f64, Follower)>; 4]; PASSES.len()] = Default::default();
    let mut beside = vec![0; crossings.len()];
    let count = numbers_beside(from, crossings, &mut beside);
    for &number in &beside[..count] {
        let other = &crossings[number];
        let way = other.point - from.point;
        let distance = way.norm_squared();
        let (direction, along) = from.nearest_direction(way);
        let (back, along_back) = other.nearest_direction(-way);
        if distance == 0.0 || (direction + back) % 2 == 0 {
            continue;
        }
        let least_along = along.abs().min(along_back.abs());
        for (pass, aligned) in PASSES.iter().zip(&mut aligned) {
            let is_aligned = least_along * least_along >= pass.aligned * pass.aligned * distance;
            if is_aligned && distance <= pass.reach * pass.reach {
                let follower = Follower {
                    crossing: number,
                    back,
                };
                aligned[direction].push((distance, follower));
            }
        }
    }
    std::array::from_fn(|pass| {
        let corner = PASSES[pass].corner;
        std::array::from_fn(|direction| {
            nearest_linked(&mut aligned[pass][direction], |follower| {
                let end = crossings[follower.crossing].point;
                picture.has_edge_beyond(corner, from.point, end, direction % 2 == 0)
            })
        })
    })
}

/// Puts the numbers of the crossings in some direction of one first, and counts them.
///
/// Of all pairs of crossings, those that are not aligned must cost little: there is no branch.
fn numbers_beside(from: &Crossing, crossings: &[Crossing], numbers: &mut [usize]) -> usize {
    let mut count = 0;
    for (number, other) in crossings.iter().enumerate() {
        let way = other.point - from.point;
        let distance = way.norm_squared();
        let is_near = distance <= NEAR * NEAR;
        let least = if is_near { MISALIGNED_NEAR } else { MISALIGNED };
        let along = [
            from.edges[0].dot(&way),
            from.edges[1].dot(&way),
            other.edges[0].dot(&way),
            other.edges[1].dot(&way),
        ];
        let own = along[0].abs().max(along[1].abs());
        let others = along[2].abs().max(along[3].abs());
        let along = own.min(others);
        numbers[count] = number;
        count += usize::from(along * along >= least * least * distance);
    }
    count
}

/// The nearest of some crossings to which an edge leads, with the squares of their distances.
fn nearest_linked(
    candidates: &mut [(f64, Follower)],
    is_linked: impl Fn(&Follower) -> bool,
) -> Option<Follower> {
    let tried = candidates.len().min(MAX_TRIED);
    if tried == 0 {
        return None;
    }
    candidates.select_nth_unstable_by(tried - 1, |a, b| a.0.total_cmp(&b.0));
    let nearest = &mut candidates[..tried];
    nearest.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let found = nearest.iter().find(|(_, follower)| is_linked(follower));
    found.map(|&(_, follower)| follower)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_hang_together_where_links_lead_from_one_to_the_next() {
        // A cell of four, a row of five whose ends have one link each, and one alone.
        let mut links: Vec<Followers> = vec![[None; 4]; 10];
        for (from, to) in [
            (0, 1),
            (1, 2),
            (2, 3),
            (3, 0),
            (4, 5),
            (5, 6),
            (6, 7),
            (7, 8),
        ] {
            let follower = |crossing, back| Some(Follower { crossing, back });
            links[from][0] = follower(to, 1);
            links[to][1] = follower(from, 0);
        }
        assert_eq!(linked_groups(&links), [4, 3]);
        assert!(linked_groups(&[]).is_empty());
    }
}
