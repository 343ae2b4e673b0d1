//! Links between crossings of a chessboard's grid lines that follow each other along an edge of the
//! picture.
//!
//! The four directions of a crossing are numbered clockwise on the screen so that the cell
//! clockwise of directions 0 and 2 is dark, and that of 1 and 3 light. At the next crossing of a
//! grid line the dark and light cells are exchanged: an even direction of one leads to an odd
//! direction of the other.

use nalgebra::Vector2;

use crate::image::GreyBytes;

/// Cosine of the largest angle between a neighbour and an edge's direction: 18 degrees, for the
/// effect of noise and of the smoothing of slanted edges on the direction.
const MIN_ALIGNMENT: f64 = 0.95;

/// Same for neighbours that are sought first: 10 degrees, which suffices except for small cells.
/// Print in a cell crosses its white rim, whose middle is 15 degrees from the cell's edge.
const MIN_FIRST_ALIGNMENT: f64 = 0.985;

/// Same for neighbours near a crossing, where the corner of a slanted cell is as small as the blur:
/// 33 degrees.
const MIN_NEAR_ALIGNMENT: f64 = 0.84;

/// Largest distance (px) of such a near neighbour.
const MAX_NEAR_DISTANCE: f64 = 12.0;

/// Positions at which the edge between two crossings is examined, as fractions of the distance. The
/// blur of the crossings reaches them only in the shortest cells, where it is symmetric.
const PLACES: [f64; 6] = [0.15, 0.3, 0.43, 0.57, 0.7, 0.85];

/// Distance (px) from an edge at which the light and the dark side are sampled: the blur has faded
/// enough for the sign, and the white rim of a cell with a marker, an eighth of the cell, is not
/// yet crossed.
const SIDE_DISTANCE: f64 = 1.3;

/// Distance (px) from a crossing within which a sample beside the edge may be in the opposite cell,
/// if the two edges cross at an oblique angle. The middle, from the given fraction on, is examined
/// in any case.
const CORNER_LENGTH: f64 = 2.2;
const MIDDLE_START: f64 = 0.36;

/// Smallest step across an edge, over the mean of all positions; noise and shading leave more.
const MIN_RELATIVE_STEP: f64 = 0.5;

/// Same for the first and the last position: next to a crossing the step fades, the more so the
/// more oblique the two edges are. Noise alone would produce a step of either sign.
const MIN_END_STEP: f64 = 0.1;

/// Smallest mean step across an edge, grey levels: a tenth of a contrast of 30, as remains after
/// two pixels of blur. Noise would not have the same sign at all of `PLACES`.
const MIN_STEP: f64 = 3.0;

/// Maximum number of crossings that are tried in one direction, the nearest first: print in a cell,
/// or beside its edge, comes before the next crossing.
const MAX_TRIED: usize = 12;

/// A point where two edges cross, and the unit vectors of directions 0 and 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Position in pixels.
    pub point: Vector2<f64>,
    /// The cell clockwise of the first is dark; that of the second, which is next clockwise, is
    /// light.
    pub edges: [Vector2<f64>; 2],
}

/// The next crossing in some direction, and the direction there that leads back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Follower {
    /// Index of the crossing.
    pub crossing: usize,
    /// Direction that leads back, 0 to 3.
    pub back: usize,
}

/// The next crossings in the four directions of a crossing.
pub type Followers = [Option<Follower>; 4];

impl GreyBytes<'_> {
    /// Whether one edge leads all the way from one point to another, with the dark side clockwise
    /// of the way (on the right hand, as y points down) or the light one.
    #[must_use]
    pub fn has_edge(&self, start: Vector2<f64>, end: Vector2<f64>, dark_clockwise: bool) -> bool {
        self.has_edge_beyond(0.0, start, end, dark_clockwise)
    }

    /// Same as `has_edge`, without `corner` pixels at both ends.
    fn has_edge_beyond(
        &self,
        corner: f64,
        start: Vector2<f64>,
        end: Vector2<f64>,
        dark_clockwise: bool,
    ) -> bool {
        let chord = end - start;
        let length = chord.norm();
        if !(length > 0.0 && length.is_finite()) {
            return false;
        }
        let clockwise = Vector2::new(-chord.y, chord.x) * (SIDE_DISTANCE / length);
        let sign = if dark_clockwise { 1.0 } else { -1.0 };
        let mut steps = [0.0; PLACES.len()];
        let first = (corner / length).clamp(PLACES[0], MIDDLE_START);
        for (step, place) in steps.iter_mut().zip(PLACES) {
            let on_edge = start + chord * place.clamp(first, 1.0 - first);
            *step =
                sign * (self.bilinear(on_edge - clockwise) - self.bilinear(on_edge + clockwise));
            if *step <= 0.0 {
                return false;
            }
        }
        let [start_step, between @ .., end_step] = steps;
        let mean = steps.iter().sum::<f64>() / PLACES.len() as f64;
        mean > MIN_STEP
            && start_step.min(end_step) > MIN_END_STEP * mean
            && between.iter().all(|step| *step > MIN_RELATIVE_STEP * mean)
    }
}

impl Crossing {
    /// The direction with which a vector is aligned, if there is one.
    #[must_use]
    pub fn direction(&self, vector: Vector2<f64>) -> Option<usize> {
        let (direction, along) = self.nearest_direction(vector);
        (along * along >= MIN_ALIGNMENT * MIN_ALIGNMENT * vector.norm_squared())
            .then_some(direction)
    }

    /// The direction nearest to that of a vector, and the vector's component along it.
    #[inline]
    fn nearest_direction(&self, vector: Vector2<f64>) -> (usize, f64) {
        let along = [self.edges[0].dot(&vector), self.edges[1].dot(&vector)];
        let edge = usize::from(along[1].abs() > along[0].abs());
        (edge + 2 * usize::from(along[edge] < 0.0), along[edge])
    }
}

/// Links each crossing to the nearest ones that are connected to it by an edge of the picture.
///
/// Returns the next crossings of each one in its directions 0 to 3. The two ends of a link are the
/// nearest ones of each other.
#[must_use]
pub fn link_crossings(picture: &GreyBytes<'_>, crossings: &[Crossing]) -> Vec<Followers> {
    let from_each = crossings.iter();
    let nearest: Vec<[Followers; PASSES.len()]> = from_each
        .map(|from| nearest_followers(picture, crossings, from))
        .collect();
    let mut links = vec![[None; 4]; crossings.len()];
    for pass in 0..PASSES.len() {
        add_links(&mut links, &mutual_links(&nearest, pass));
    }
    links
}

/// Adds links between directions that have no link yet.
fn add_links(links: &mut [Followers], new_links: &[Followers]) {
    for (number, new_links) in new_links.iter().enumerate() {
        for (direction, new_link) in new_links.iter().enumerate() {
            let Some(follower) = *new_link else { continue };
            let opposite = links[follower.crossing][follower.back];
            let back = Follower {
                crossing: number,
                back: direction,
            };
            if links[number][direction].is_none() && opposite.is_none_or(|link| link == back) {
                links[number][direction] = Some(follower);
                links[follower.crossing][follower.back] = Some(back);
            }
        }
    }
}

/// Number of crossings in each connected group; crossings with fewer than two links are in no
/// group.
pub(super) fn linked_groups(links: &[Followers]) -> Vec<usize> {
    let is_linked = |number: usize| links[number].iter().flatten().count() >= 2;
    let mut is_new: Vec<bool> = (0..links.len()).map(is_linked).collect();
    let mut groups = Vec::new();
    for first in 0..links.len() {
        if !std::mem::take(&mut is_new[first]) {
            continue;
        }
        let (mut pending, mut count) = (vec![first], 0);
        while let Some(number) = pending.pop() {
            count += 1;
            for follower in links[number].iter().flatten() {
                if std::mem::take(&mut is_new[follower.crossing]) {
                    pending.push(follower.crossing);
                }
            }
        }
        groups.push(count);
    }
    groups
}

/// Requirements on the neighbours in one pass.
#[derive(Debug, Clone, Copy)]
struct Pass {
    /// Cosine of the largest angle between a neighbour and an edge's direction.
    min_alignment: f64,
    /// Largest distance of a neighbour, pixels.
    reach: f64,
    /// Length at both ends of the edge that is not examined, pixels.
    corner: f64,
}

const PASSES: [Pass; 3] = [
    Pass {
        min_alignment: MIN_FIRST_ALIGNMENT,
        reach: f64::INFINITY,
        corner: 0.0,
    },
    Pass {
        min_alignment: MIN_ALIGNMENT,
        reach: f64::INFINITY,
        corner: 0.0,
    },
    Pass {
        min_alignment: MIN_NEAR_ALIGNMENT,
        reach: MAX_NEAR_DISTANCE,
        corner: CORNER_LENGTH,
    },
];

/// Links of a pass whose ends are the nearest ones of each other.
fn mutual_links(nearest: &[[Followers; PASSES.len()]], pass: usize) -> Vec<Followers> {
    let mutual = |number: usize, direction: usize| {
        nearest[number][pass][direction].filter(|follower| {
            let returning = Follower {
                crossing: number,
                back: direction,
            };
            nearest[follower.crossing][pass][follower.back] == Some(returning)
        })
    };
    (0..nearest.len())
        .map(|number| std::array::from_fn(|direction| mutual(number, direction)))
        .collect()
}

/// The nearest crossings, for each pass, that are connected to one by an edge.
///
/// All pairs of crossings are examined, but only once for all passes.
fn nearest_followers(
    picture: &GreyBytes<'_>,
    crossings: &[Crossing],
    from: &Crossing,
) -> [Followers; PASSES.len()] {
    let mut aligned: [[Vec<(f64, Follower)>; 4]; PASSES.len()] = Default::default();
    let mut numbers = vec![0; crossings.len()];
    let count = find_aligned(from, crossings, &mut numbers);
    for &number in &numbers[..count] {
        let other = &crossings[number];
        let offset = other.point - from.point;
        let distance = offset.norm_squared();
        let (direction, along) = from.nearest_direction(offset);
        let (back, along_back) = other.nearest_direction(-offset);
        if distance == 0.0 || (direction + back) % 2 == 0 {
            continue;
        }
        let smaller_along = along.abs().min(along_back.abs());
        for (pass, aligned) in PASSES.iter().zip(&mut aligned) {
            let is_aligned =
                smaller_along * smaller_along >= pass.min_alignment * pass.min_alignment * distance;
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

/// Writes the indices of the crossings that are aligned with a direction of `from` to the start of
/// `numbers`, and counts them.
///
/// There is no branch, since most pairs of crossings are not aligned and should cost little.
fn find_aligned(from: &Crossing, crossings: &[Crossing], numbers: &mut [usize]) -> usize {
    let mut count = 0;
    for (number, other) in crossings.iter().enumerate() {
        let offset = other.point - from.point;
        let distance = offset.norm_squared();
        let is_near = distance <= MAX_NEAR_DISTANCE * MAX_NEAR_DISTANCE;
        let min_alignment = if is_near {
            MIN_NEAR_ALIGNMENT
        } else {
            MIN_ALIGNMENT
        };
        let along = [
            from.edges[0].dot(&offset),
            from.edges[1].dot(&offset),
            other.edges[0].dot(&offset),
            other.edges[1].dot(&offset),
        ];
        let from_along = along[0].abs().max(along[1].abs());
        let other_along = along[2].abs().max(along[3].abs());
        let along = from_along.min(other_along);
        numbers[count] = number;
        count += usize::from(along * along >= min_alignment * min_alignment * distance);
    }
    count
}

/// The nearest of some crossings that is connected by an edge; candidates have squared distances.
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
        // A cell of four, a row of five whose ends have one link each, and a single one.
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
