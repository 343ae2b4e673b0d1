//! Pieces of lattices: linked crossings to which closed cells assign rows and columns.

use std::collections::{HashMap, HashSet, VecDeque};

use nalgebra::Vector2;

use super::edge_following::{Crossing, Follower, Followers};
use super::lattice::{Lattice, STEPS, Site, neighbour_site};

/// Maximum sine of the turn of a grid line at a crossing: lenses bend a grid line of four cells by
/// 0.1 per crossing, folded paper by more.
pub(super) const MAX_KINK_SINE: f64 = 0.22;

/// Maximum ratio of two neighbouring cells' lengths; no perspective at 70 degrees reaches it.
const MAX_LENGTH_RATIO: f64 = 1.75;

/// Minimum number of adjoining cells that start a lattice: a single one may occur by chance, and is
/// less reliable for predicting the next crossings.
const MIN_CELLS: usize = 2;

/// Maximum number of rows times columns of a piece, which bounds the memory for a long diagonal:
/// all crossings of a picture fill a twentieth of it.
const MAX_SITES: usize = 100_000;

/// Crossing and direction of a link.
type Link = (usize, usize);

/// Crossings, and the next ones in their four directions.
struct Net<'a> {
    crossings: &'a [Crossing],
    followers: &'a [Followers],
}

/// Assigns rows and columns to linked crossings; returns the largest piece first.
///
/// Cells are joined across an edge if the grid lines at both of its ends run straight across it, so
/// that a fold of the paper ends a piece.
pub(super) fn pieces(crossings: &[Crossing], followers: &[Followers]) -> Vec<Lattice> {
    let net = Net {
        crossings,
        followers,
    };
    let all = (0..crossings.len()).flat_map(|crossing| (0..4).map(move |k| (crossing, k)));
    let closed: HashSet<Link> = all.clone().filter(|link| net.is_closed(*link)).collect();
    let mut visited = HashSet::new();
    let mut pieces = Vec::new();
    for start in all.filter(|link| closed.contains(link)) {
        if !visited.contains(&start) {
            pieces.extend(net.piece(start, &closed, &mut visited));
        }
    }
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.count()));
    pieces
}

impl Net<'_> {
    fn next(&self, (crossing, direction): Link) -> Option<Follower> {
        self.followers[crossing][direction]
    }

    /// The next link around the cell clockwise of a link.
    fn next_around_cell(&self, link: Link) -> Option<Link> {
        let follower = self.next(link)?;
        Some((follower.crossing, (follower.back + 3) % 4))
    }

    /// Whether the cell clockwise of a link is closed after four links.
    fn is_closed(&self, link: Link) -> bool {
        let end = (0..4).try_fold(link, |link, _| self.next_around_cell(link));
        end.is_some_and(|(crossing, _)| crossing == link.0)
    }

    /// Whether the grid line through a crossing continues in a direction.
    ///
    /// It does not if it ends, has a kink, or if its cells' lengths change abruptly.
    fn is_straight(&self, (crossing, direction): Link) -> bool {
        let opposite = (crossing, (direction + 2) % 4);
        let (Some(next), Some(previous)) = (self.next((crossing, direction)), self.next(opposite))
        else {
            return false;
        };
        let here = self.crossings[crossing].point;
        let ahead = self.crossings[next.crossing].point - here;
        let behind = here - self.crossings[previous.crossing].point;
        let along = [ahead.norm(), behind.norm()];
        ahead.perp(&behind).abs() <= MAX_KINK_SINE * along[0] * along[1]
            && along[0] <= MAX_LENGTH_RATIO * along[1]
            && along[1] <= MAX_LENGTH_RATIO * along[0]
            && ahead.dot(&behind) > 0.0
    }

    /// Whether the lines at both ends of a link continue straight, away from the link's own cell.
    fn continues_across(&self, (crossing, direction): Link) -> bool {
        self.is_straight((crossing, (direction + 1) % 4))
            && self
                .next_around_cell((crossing, direction))
                .is_some_and(|link| self.is_straight(link))
    }

    /// The crossings that can be reached from the cell clockwise of a link, if there are enough.
    fn piece(
        &self,
        start: Link,
        closed: &HashSet<Link>,
        visited: &mut HashSet<Link>,
    ) -> Option<Lattice> {
        let mut places: HashMap<usize, Site> = HashMap::from([(start.0, (0, 0))]);
        let mut occupied: HashMap<Site, usize> = HashMap::from([((0, 0), start.0)]);
        let mut queue = VecDeque::from([(start, 0)]);
        let mut cells = 0;
        while let Some((link, step)) = queue.pop_front() {
            if visited.contains(&link) {
                continue;
            }
            let Some(cell_links) = self.cell_links(link, step, &places, &occupied) else {
                continue; // around a corner of the room, or a false link
            };
            cells += 1;
            for (link, step, follower) in cell_links {
                visited.insert(link);
                let place = neighbour_site(places[&link.0], STEPS[step], 1);
                places.insert(follower.crossing, place);
                occupied.insert(place, follower.crossing);
                let opposite = (follower.crossing, follower.back);
                if [link, opposite].iter().all(|l| closed.contains(l))
                    && self.continues_across(link)
                {
                    queue.push_back((opposite, (step + 2) % 4));
                }
            }
        }
        let extent = |coordinate: fn(&Site) -> isize| {
            let all = || places.values().map(coordinate);
            all().max().unwrap_or(0).abs_diff(all().min().unwrap_or(0)) + 1
        };
        if cells < MIN_CELLS || extent(|site| site.0) * extent(|site| site.1) > MAX_SITES {
            return None;
        }
        let found: Vec<(Site, Vector2<f64>)> = places
            .into_iter()
            .map(|(crossing, site)| (site, self.crossings[crossing].point))
            .collect();
        Some(Lattice::of(&found, start.1.is_multiple_of(2)))
    }

    /// The four links around a cell, each with its step and the next crossing; `None` if they
    /// contradict known rows and columns.
    fn cell_links(
        &self,
        mut link: Link,
        mut step: usize,
        places: &HashMap<usize, Site>,
        occupied: &HashMap<Site, usize>,
    ) -> Option<Vec<(Link, usize, Follower)>> {
        let mut cell_links = Vec::with_capacity(4);
        let mut place = *places.get(&link.0)?;
        for _ in 0..4 {
            let follower = self.next(link)?;
            cell_links.push((link, step, follower));
            place = neighbour_site(place, STEPS[step], 1);
            if places
                .get(&follower.crossing)
                .is_some_and(|known| *known != place)
                || occupied
                    .get(&place)
                    .is_some_and(|known| *known != follower.crossing)
            {
                return None;
            }
            link = self.next_around_cell(link)?;
            step = (step + 1) % 4;
        }
        Some(cell_links)
    }
}
