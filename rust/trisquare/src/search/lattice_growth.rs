//! Growing a lattice of crossings: where the next one must be, and whether there is one.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use nalgebra::Vector2;

use super::edge_following::Crossing;
use crate::image::GreyBytes;

/// Rows and columns that are added one after another.
const MOST_ROUNDS: usize = 100;

/// Cells that a crossing may be off its predicted place; perspective and lens leave a tenth.
const OFF_COURSE: f64 = 0.22;

/// How far a crossing may be off the line of its two neighbours, as the sine of the turn: lenses
/// curve a grid line of four cells by 0.1 a crossing, folded paper by more.
const KINK: f64 = 0.22;

/// Row and column steps of a lattice's directions, clockwise on the screen: along a row, down a
/// column, and back.
const STEPS: [(i32, i32); 4] = [(0, 1), (1, 0), (0, -1), (-1, 0)];

/// Row and column of a crossing; any integers.
pub type Site = (i32, i32);

/// The site some rows and columns on; the last integer is followed by the first, as sites may be
/// any integers.
fn beside(site: Site, step: (i32, i32)) -> Site {
    (site.0.wrapping_add(step.0), site.1.wrapping_add(step.1))
}

/// Crossings in rows and columns, columns clockwise from rows on the screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// In pixels.
    pub crossings: BTreeMap<Site, Vector2<f64>>,
    /// Whether it is dark clockwise of the row that leaves crossing (0, 0).
    pub dark_first: bool,
}

impl Lattice {
    /// Adds neighbouring crossings, round by round, as long as there are any.
    pub fn grow(&mut self, picture: &GreyBytes<'_>, crossings: &[Crossing]) {
        let mut taken = HashSet::new();
        for _ in 0..MOST_ROUNDS {
            let mut fitting: Vec<(f64, Site, usize)> = self
                .rim()
                .into_iter()
                .filter_map(|site| self.fitting(site, picture, crossings))
                .collect();
            fitting.sort_by(|a, b| a.0.total_cmp(&b.0));
            let before = self.crossings.len();
            for (_, site, number) in fitting {
                if taken.insert(number) {
                    self.crossings.insert(site, crossings[number].point);
                }
            }
            if self.crossings.len() == before {
                break;
            }
        }
    }

    fn at(&self, site: Site, step: (i32, i32), count: i32) -> Option<Vector2<f64>> {
        let place = beside(site, (count * step.0, count * step.1));
        self.crossings.get(&place).copied()
    }

    /// Empty sites next to a crossing.
    fn rim(&self) -> BTreeSet<Site> {
        let around = |site: &Site| STEPS.map(|step| beside(*site, step));
        let sites = self.crossings.keys().flat_map(around);
        sites.filter(|s| !self.crossings.contains_key(s)).collect()
    }

    /// Where a site's crossing must be if the lattice goes on smoothly.
    fn predicted(&self, site: Site) -> Option<Vector2<f64>> {
        let mut sum = Vector2::zeros();
        let mut weight = 0.0;
        for (direction, step) in STEPS.into_iter().enumerate() {
            let Some(one) = self.at(site, step, 1) else {
                continue;
            };
            let next = STEPS[(direction + 1) % 4];
            if let Some(two) = self.at(site, step, 2) {
                let goes_on = match self.at(site, step, 3) {
                    Some(three) => (one - two) * 3.0 + three,
                    None => one * 2.0 - two,
                };
                sum += goes_on;
                weight += 1.0;
            }
            let diagonal = (step.0 + next.0, step.1 + next.1);
            if let (Some(other), Some(far)) = (self.at(site, next, 1), self.at(site, diagonal, 1)) {
                sum += one + other - far;
                weight += 1.0;
            }
            if let (0 | 1, Some(behind)) = (direction, self.at(site, step, -1)) {
                sum += (one + behind) * 2.0; // between two of them: the surest
                weight += 4.0;
            }
        }
        (weight > 0.0).then(|| sum / weight)
    }

    /// The crossing for a site, if there is one where it must be: how far off it is, and its
    /// number.
    fn fitting(
        &self,
        site: Site,
        picture: &GreyBytes<'_>,
        crossings: &[Crossing],
    ) -> Option<(f64, Site, usize)> {
        let predicted = self.predicted(site)?;
        let off = |crossing: &Crossing| (crossing.point - predicted).norm_squared();
        let nearest =
            |(_, a): &(usize, &Crossing), (_, b): &(usize, &Crossing)| off(a).total_cmp(&off(b));
        let (number, crossing) = crossings.iter().enumerate().min_by(nearest)?;
        let gap = off(crossing).sqrt();
        let cell = self.shortest_edge(site, picture, crossing)?;
        (gap < OFF_COURSE * cell).then_some((gap, site, number))
    }

    /// Length of the shortest edge to a present neighbour, if straight edges lead to all of them.
    fn shortest_edge(
        &self,
        site: Site,
        picture: &GreyBytes<'_>,
        crossing: &Crossing,
    ) -> Option<f64> {
        let mut shortest = f64::INFINITY;
        for (direction, step) in STEPS.into_iter().enumerate() {
            let Some(there) = self.at(site, step, 1) else {
                continue;
            };
            let way = there - crossing.point;
            if let Some(beyond) = self.at(site, step, 2) {
                let onward = beyond - there;
                if way.perp(&onward).abs() > KINK * way.norm() * onward.norm() {
                    return None;
                }
            }
            // Odd sums stay odd where they wrap.
            let sum = site.0.wrapping_add(site.1).wrapping_add(direction as i32);
            let even = sum.rem_euclid(2) == 0;
            let dark = even == self.dark_first;
            let follows = crossing.direction(way)?;
            if (follows % 2 == 0) != dark || !picture.has_edge(crossing.point, there, dark) {
                return None;
            }
            shortest = shortest.min(way.norm());
        }
        shortest.is_finite().then_some(shortest)
    }
}
