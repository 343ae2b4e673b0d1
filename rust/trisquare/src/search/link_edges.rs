//! Test of the links between crossings: edges in the photograph.
//!
//! A blurred grille or keyboard looks like a chessboard rotated by 45 degrees; a sharp one does
//! not.

use nalgebra::Vector2;

use super::lattice::{Lattice, SMALL_COUNT, STEPS, Site};
use super::photograph::Photograph;

/// Positions at which edges between crossings are examined, as fractions of the link, and the
/// distance beside it, in pixels of the searched picture.
const PLACES: [f64; 5] = [0.2, 0.35, 0.5, 0.65, 0.8];
const SIDE_DISTANCE: f64 = 1.3;

/// Minimum fraction of the links between crossings that are edges in the photograph, too, both in
/// the rows and in the columns.
const EDGE_SHARE: f64 = 0.7;

/// Same for a lattice of fewer than `SMALL_COUNT` crossings, as print and stripes have some edges.
const SMALL_EDGE_SHARE: f64 = 0.95;

/// The steps of links in rows and in columns.
pub(super) const LINK_STEPS: [Site; 2] = [STEPS[0], STEPS[1]];

/// Smallest length of a link (px), in case its ends coincide.
const MIN_LENGTH: f64 = 1e-9;

impl Photograph<'_> {
    /// Whether enough of a lattice's links are edges, in rows and in columns.
    pub fn has_edges(&self, lattice: &Lattice) -> bool {
        let min_share = match lattice.count() < SMALL_COUNT {
            true => SMALL_EDGE_SHARE,
            false => EDGE_SHARE,
        };
        // Both are tested: in rows that are linked across every second one, all links along them
        // are edges.
        LINK_STEPS.iter().all(|step| {
            let links = lattice.links(*step);
            let (mut edges, mut count) = (0, 0);
            for (site, link) in links {
                count += 1;
                edges += usize::from(
                    self.is_edge(lattice.is_dark(site) == (*step == LINK_STEPS[0]), link),
                );
            }
            count > 0 && f64::from(edges as u32) / f64::from(count) >= min_share
        })
    }

    /// Whether a link is an edge all along, with the dark or the light side clockwise of it.
    pub fn is_edge(&self, dark_clockwise: bool, [start, end]: [Vector2<f64>; 2]) -> bool {
        let chord = end - start;
        let clockwise =
            Vector2::new(-chord.y, chord.x) * (SIDE_DISTANCE / chord.norm().max(MIN_LENGTH));
        let sign = if dark_clockwise { 1.0 } else { -1.0 };
        PLACES.iter().all(|place| {
            let at = start + chord * *place;
            sign * (self.level(at - clockwise) - self.level(at + clockwise)) > 0.0
        })
    }
}
