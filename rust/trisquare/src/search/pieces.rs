//! Pieces of lattices: linked crossings to which closed cells assign rows and columns.

use std::collections::{HashMap, HashSet, VecDeque};

use nalgebra::Vector2;

use super::edge_following::{Crossing, Follower, Followers};
use super::lattice::{Lattice, STEPS, Site, beside};

/// Maximum sine of the turn of a grid line at a crossing: lenses bend a grid line of four cells by
/// 0.1 per crossing, folded paper by more.
pub(super) const KINK: f64 = 0.22;

/// Maximum ratio of two neighbouring cells' lengths; no perspective at 70 degrees reaches it.
const UNEVEN: f64 = 1.75;

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
    following: &'a [Followers],
}

/// Assigns rows and columns to linked crossings; returns the largest piece first.
///
/// Cells are joined across an edge if the grid lines at both of its ends run straight across it, so
/// that a fold of the paper ends a piece.
pub(super) fn pieces(crossings: &[Crossing], following: &[Followers]) -> Vec<Lattice> {
    let net = Net {
        crossings,
        following,
    };
    let all = (0..crossings.len()).flat_map(|crossing| (0..4).map(move |k| (crossing, k)));
    let closed: HashSet<Link> = all.clone().filter(|link| net.closes(*link)).collect();
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
        self.following[crossing][direction]
    }

    /// The next link around the cell clockwise of a link.
    fn round(&self, link: Link) -> Option<Link> {
        let follower = self.next(link)?;
        Some((follower.crossing, (follower.back + 3) % 4))
    }

    /// Whether the cell clockwise of a link is closed after four links.
    fn closes(&self, link: Link) -> bool {
        let end = (0..4).try_fold(link, |link, _| self.round(link));
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
        ahead.perp(&behind).abs() <= KINK * along[0] * along[1]
            && along[0] <= UNEVEN * along[1]
            && along[1] <= UNEVEN * along[0]
            && ahead.dot(&behind) > 0.0
    }

    /// Whether the lines at both ends of a link continue straight, away from the link's own cell.
    fn may_be_crossed(&self, (crossing, direction): Link) -> bool {
        self.is_straight((crossing, (direction + 1) % 4))
            && self
                .round((crossing, direction))
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
        let mut taken: HashMap<Site, usize> = HashMap::from([((0, 0), start.0)]);
        let mut queue = VecDeque::from([(start, 0)]);
        let mut cells = 0;
        while let Some((link, step)) = queue.pop_front() {
            if visited.contains(&link) {
                continue;
            }
            let Some(walk) = self.walk(link, step, &places, &taken) else {
                continue; // around a corner of the room, or a false link
            };
            cells += 1;
            for (link, step, follower) in walk {
                visited.insert(link);
                let place = beside(places[&link.0], STEPS[step], 1);
                places.insert(follower.crossing, place);
                taken.insert(place, follower.crossing);
                let home = (follower.crossing, follower.back);
                if [link, home].iter().all(|l| closed.contains(l)) && self.may_be_crossed(link) {
                    queue.push_back((home, (step + 2) % 4));
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
    fn walk(
        &self,
        mut link: Link,
        mut step: usize,
        places: &HashMap<usize, Site>,
        taken: &HashMap<Site, usize>,
    ) -> Option<Vec<(Link, usize, Follower)>> {
        let mut walk = Vec::with_capacity(4);
        let mut place = *places.get(&link.0)?;
        for _ in 0..4 {
            let follower = self.next(link)?;
            walk.push((link, step, follower));
            place = beside(place, STEPS[step], 1);
            if places
                .get(&follower.crossing)
                .is_some_and(|known| *known != place)
                || taken
                    .get(&place)
                    .is_some_and(|known| *known != follower.crossing)
            {
                return None;
            }
            link = self.round(link)?;
            step = (step + 1) % 4;
        }
        Some(walk)
    }
}
