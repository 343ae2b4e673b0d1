//! Crossings that were too faint to be found, at places where a lattice continues.

use nalgebra::Vector2;

use super::lattice::{Lattice, Site, neighbour_site};
use super::lattice_surface::LatticeSurface;
use super::link_edges::LINK_STEPS;
use super::outline::Outline;
use super::photograph::Photograph;
use super::saddles::refine_corner;
use crate::image::GreyBytes;

/// Maximum number of rows and columns that are added one after another: as many as a large board
/// has.
const MAX_EXTENSIONS: usize = 12;

/// Distance, in cells, from the outline of another lattice with a rim of one cell, within which
/// there may be a fold.
const FOLD_DISTANCE: f64 = 0.25;

/// Width (px) of the border in which no crossing is predicted: the reach of the filters that find
/// one.
const MARGIN: f64 = 6.0;

impl Lattice {
    /// The lattice with a predicted crossing at every empty site next to an occupied one, and with
    /// one more row and column on every side.
    fn with_neighbours(&self, [width, height]: [usize; 2]) -> Self {
        let surface = LatticeSurface::of(self, [width, height]);
        let padded = self.padded();
        let last = Vector2::new(width as f64, height as f64).add_scalar(-1.0 - MARGIN);
        let mut wider = padded.clone();
        for site in padded.rim() {
            let point = surface.at(neighbour_site(site, (-1, -1), 1));
            let is_inside = point >= Vector2::repeat(MARGIN) && point <= last;
            wider.set(site, is_inside.then_some(point));
        }
        wider
    }

    /// The lattice with crossings that were too faint to be found in a picture.
    ///
    /// At such a crossing the cells alternate, and edges lead to its neighbours in the photograph.
    /// Both may be true at a fold, too, where cells of two sheets happen to meet: crossings near
    /// one of the outlines of `others` are not added.
    pub(super) fn extended(
        &self,
        picture: &GreyBytes<'_>,
        photograph: &Photograph<'_>,
        others: &[&Outline],
    ) -> Self {
        let mut lattice = self.clone();
        for _ in 0..MAX_EXTENSIONS {
            let wider = lattice.with_new_neighbours(picture, photograph, others);
            let wider = wider.complete();
            if wider.count() <= lattice.count() {
                break;
            }
            lattice = wider;
        }
        lattice
    }

    fn with_new_neighbours(
        &self,
        picture: &GreyBytes<'_>,
        photograph: &Photograph<'_>,
        others: &[&Outline],
    ) -> Self {
        let predicted = self.with_neighbours(picture.size());
        let fold_distance = FOLD_DISTANCE * self.pitch();
        let is_new = |site: &Site| !self.has(neighbour_site(*site, (-1, -1), 1));
        let new = predicted.found().filter(|(site, point)| {
            is_new(site)
                && photograph.alternates(&predicted, *site)
                && !others
                    .iter()
                    .any(|outline| outline.is_near(*point, fold_distance))
        });
        let stray_tolerance = self.stray_tolerance();
        let mut wider = self.padded();
        for (site, point) in new {
            let refined = refine_corner(picture, point);
            let is_stray = (refined - point).norm() > stray_tolerance;
            wider.set(site, (!is_stray).then_some(refined));
        }
        let mut linked = wider.clone();
        for step in LINK_STEPS {
            for (site, link) in wider.links(step) {
                // If there is no edge between two crossings, either may be wrong.
                if !photograph.is_edge(wider.is_dark(site) == (step == LINK_STEPS[0]), link) {
                    linked.set(site, None);
                    linked.set(neighbour_site(site, step, 1), None);
                }
            }
        }
        wider.filtered(|site| !is_new(&site) || linked.has(site))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::bent_board::{BentBoard, SIZE};

    #[test]
    fn neighbours_are_foretold_where_the_board_has_them() {
        let whole = BentBoard::turned(30.0, [0.0, 0.0, 30.0]).crossings(0..8, 0..10);
        let inner =
            whole.filtered(|(row, column)| (1..7).contains(&row) && (1..9).contains(&column));
        let wider = inner.with_neighbours(SIZE);
        assert_eq!(wider.size(), whole.size());
        // The corners are not predicted, as they are not next to a crossing.
        assert_eq!(wider.count(), inner.count() + 2 * 8 + 2 * 6);
        for (site, point) in wider.found() {
            assert!((point - whole.at(site).unwrap()).norm() < 1.0);
        }
    }

    #[test]
    fn nothing_is_foretold_beyond_the_picture() {
        let near = BentBoard::turned(0.0, [0.0, 0.0, 8.0]).crossings(0..8, 2..8);
        let wider = near.with_neighbours(SIZE);
        let is_inside = |p: &Vector2<f64>| p.x >= MARGIN && p.y >= MARGIN;
        let new = wider
            .found()
            .filter(|(site, _)| !near.has(neighbour_site(*site, (-1, -1), 1)));
        assert!(new.into_iter().all(|(_, point)| is_inside(&point)));
    }
}
