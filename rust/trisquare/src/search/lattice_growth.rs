//! Growth of a lattice: predicts the next crossings, and adds those that exist.

use std::collections::HashSet;

use nalgebra::Vector2;

use super::edge_following::Crossing;
use super::lattice::{Lattice, STEPS, Site, neighbour_site};
use super::pieces::MAX_KINK_SINE;
use crate::image::GreyBytes;

/// Maximum number of rounds, each of which adds at most one row or column on every side.
const MAX_ROUNDS: usize = 100;

/// Maximum distance, in cells, of a crossing from its predicted position; perspective and lens
/// account for a tenth.
const MAX_PREDICTION_ERROR: f64 = 0.22;

impl Lattice {
    /// The lattice with all neighbouring crossings that fit added, round by round.
    pub(super) fn grown(&self, picture: &GreyBytes<'_>, crossings: &[Crossing]) -> Self {
        let mut lattice = self.clone();
        let mut used = HashSet::new();
        for _ in 0..MAX_ROUNDS {
            lattice = lattice.padded();
            let mut fitting: Vec<(f64, Site, usize)> = lattice
                .rim()
                .filter_map(|site| lattice.fitting_crossing(site, picture, crossings))
                .collect();
            fitting.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut is_finished = true;
            for (_, site, number) in fitting {
                if used.insert(number) {
                    lattice.set(site, Some(crossings[number].point));
                    is_finished = false;
                }
            }
            lattice = lattice.filtered(|_| true);
            if is_finished {
                break;
            }
        }
        lattice
    }

    /// The empty sites next to a crossing.
    pub(super) fn rim(&self) -> impl Iterator<Item = Site> {
        let is_next = |site: Site| {
            STEPS
                .iter()
                .any(|step| self.has(neighbour_site(site, *step, 1)))
        };
        self.sites()
            .filter(move |site| !self.has(*site) && is_next(*site))
    }

    /// Position of a site's crossing for a smooth continuation of the lattice.
    fn predicted(&self, site: Site) -> Option<Vector2<f64>> {
        let mut sum = Vector2::zeros();
        let mut weight = 0.0;
        for (direction, step) in STEPS.into_iter().enumerate() {
            let Some(first) = self.at(neighbour_site(site, step, 1)) else {
                continue;
            };
            let next = STEPS[(direction + 1) % 4];
            if let Some(second) = self.at(neighbour_site(site, step, 2)) {
                let extrapolated = match self.at(neighbour_site(site, step, 3)) {
                    Some(third) => (first - second) * 3.0 + third,
                    None => first * 2.0 - second,
                };
                sum += extrapolated;
                weight += 1.0;
            }
            let diagonal = (step.0 + next.0, step.1 + next.1);
            let around = [next, diagonal].map(|step| self.at(neighbour_site(site, step, 1)));
            if let [Some(other), Some(far)] = around {
                sum += first + other - far;
                weight += 1.0;
            }
            if let (0 | 1, Some(behind)) = (direction, self.at(neighbour_site(site, step, -1))) {
                // Interpolated between two of them: the most reliable.
                sum += (first + behind) * 2.0;
                weight += 4.0;
            }
        }
        (weight > 0.0).then(|| sum / weight)
    }

    /// The crossing for a site, if there is one at its predicted position: the distance from that,
    /// the site, and the crossing's index.
    fn fitting_crossing(
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
        (gap < MAX_PREDICTION_ERROR * cell).then_some((gap, site, number))
    }

    /// Length of the shortest edge to a neighbour; `None` unless straight edges lead to all
    /// neighbours.
    fn shortest_edge(
        &self,
        site: Site,
        picture: &GreyBytes<'_>,
        crossing: &Crossing,
    ) -> Option<f64> {
        let mut shortest = f64::INFINITY;
        for (direction, step) in STEPS.into_iter().enumerate() {
            let Some(neighbour) = self.at(neighbour_site(site, step, 1)) else {
                continue;
            };
            let offset = neighbour - crossing.point;
            if let Some(beyond) = self.at(neighbour_site(site, step, 2)) {
                let next_offset = beyond - neighbour;
                if offset.perp(&next_offset).abs()
                    > MAX_KINK_SINE * offset.norm() * next_offset.norm()
                {
                    return None;
                }
            }
            let dark = self.is_dark(site) == direction.is_multiple_of(2);
            let link_direction = crossing.direction(offset)?;
            if (link_direction % 2 == 0) != dark
                || !picture.has_edge(crossing.point, neighbour, dark)
            {
                return None;
            }
            shortest = shortest.min(offset.norm());
        }
        shortest.is_finite().then_some(shortest)
    }
}
