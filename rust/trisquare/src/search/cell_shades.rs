//! The light and the dark cells of a lattice, as the photograph shows them.
//!
//! Blurred, or in a coarse picture, dark tiles apart from each other look like a chessboard that
//! stands on its corner: crossings lie where two tiles are nearest. But there the picture is as
//! light as what is between the tiles. On a chessboard light and dark meet in every crossing, in
//! equal shares.

use nalgebra::Vector2;

use super::lattice::{Lattice, STEPS, Site, beside};
use super::photograph::Photograph;

/// Where the four cells at a crossing are looked at: pixels of the photograph along both of a cell's
/// sides, which is out of the blur, within these parts of the side. A marker leaves an eighth free.
const INTO_CELL: f64 = 3.0;
const LEAST_INTO_CELL: f64 = 0.1;
const MOST_INTO_CELL: f64 = 0.3;

/// Least step between a light cell and a dark one at a crossing, over the mean step: at the rim of a
/// board three of the four are light.
const MIN_CONTRAST: f64 = 0.3;

/// Pixels; the side of a cell whose crossings coincide.
const LEAST_SIDE: f64 = 1e-9;

/// How light crossings and the middles of edges may be, from 0 (as dark cells) to 1 (as light ones).
/// A tone curve lifts the half of it to 0.73, ink that has spread leaves 0.31; crossings of tiles
/// apart from each other have 0.05 or 0.97, and blurred by two pixels 0.13 or 0.80.
const LEAST_SHARE: f64 = 0.2;
const MOST_SHARE: f64 = 0.77;

/// Of a cell's side: where a light cell is looked at beside its edges, as it may hold a marker. The
/// marker's white rim is an eighth.
const RIM: f64 = 0.08;

/// Places in a cell, in units of its sides. The corners of a light cell are farther from a marker
/// than the middle of its rim, which blur darkens where that is narrow.
type Places = [(f64, f64)];
const CORNERS: &Places = &[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
const MIDDLES: &Places = &[(0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0)];
const CENTRE: &Places = &[(0.5, 0.5)];
const RIMS: &Places = &[(RIM, 0.5), (1.0 - RIM, 0.5), (0.5, RIM), (0.5, 1.0 - RIM)];
const INNER: &Places = &[
    (RIM, RIM),
    (1.0 - RIM, RIM),
    (RIM, 1.0 - RIM),
    (1.0 - RIM, 1.0 - RIM),
];

impl Photograph<'_> {
    /// Whether two light cells and two dark ones alternate round a crossing.
    pub fn alternates(&self, lattice: &Lattice, site: Site) -> bool {
        self.shades_around(lattice, site).is_some_and(|shades| {
            let [first, second, third, fourth] = match lattice.is_dark(site) {
                true => shades,
                false => shades.map(|shade| -shade),
            };
            let least = second.min(fourth) - first.max(third);
            let mean = 0.5 * (second + fourth) - 0.5 * (first + third);
            mean > 0.0 && least > MIN_CONTRAST * mean
        })
    }

    /// Grey levels of the four cells at a crossing, clockwise from that of directions 0 and 1; the
    /// sides of cells beyond the lattice are those opposite.
    fn shades_around(&self, lattice: &Lattice, site: Site) -> Option<[f64; 4]> {
        let here = lattice.at(site)?;
        let mut ways = [Vector2::zeros(); 4];
        for (way, step) in ways.iter_mut().zip(STEPS) {
            let ahead = lattice.at(beside(site, step, 1)).map(|next| next - here);
            let behind = || Some(here - lattice.at(beside(site, step, -1))?);
            *way = ahead.or_else(behind)?;
        }
        Some(std::array::from_fn(|k| {
            let (first, second) = (ways[k], ways[(k + 1) % 4]);
            let side = self.scale * first.norm().min(second.norm());
            let part = INTO_CELL / side.max(LEAST_SIDE);
            let part = part.clamp(LEAST_INTO_CELL, MOST_INTO_CELL);
            self.level(here + (first + second) * part)
        }))
    }

    /// Whether crossings and edges are midway between the light and the dark of a lattice's cells.
    pub fn is_chequered(&self, lattice: &Lattice) -> bool {
        let cells = lattice
            .sites()
            .filter_map(|site| Some((site, lattice.cell(site)?)));
        let (dark, light): (Vec<_>, Vec<_>) = cells.partition(|(site, _)| lattice.is_dark(*site));
        let sum_of = |cells: &[(Site, [Vector2<f64>; 4])], places: &Places| -> f64 {
            let points = cells
                .iter()
                .flat_map(|(_, corners)| places.iter().map(move |place| within(corners, *place)));
            points.map(|point| self.level(point)).sum()
        };
        let mean_of = |cells: &[_], places: &Places| {
            sum_of(cells, places) / (cells.len() * places.len()) as f64
        };
        if dark.is_empty() || light.is_empty() {
            return false;
        }
        let darkest = mean_of(&dark, CENTRE);
        let lightest = [CENTRE, RIMS, INNER].map(|places| mean_of(&light, places));
        let lightest = lightest.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let all = [dark, light].concat();
        let share = |places| (mean_of(&all, places) - darkest) / (lightest - darkest);
        let is_midway = |share: f64| share > LEAST_SHARE && share < MOST_SHARE;
        lightest > darkest && is_midway(share(CORNERS)) && is_midway(share(MIDDLES))
    }
}

/// The point at some place in a cell, by bilinear interpolation.
fn within(corners: &[Vector2<f64>; 4], (u, v): (f64, f64)) -> Vector2<f64> {
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    corners
        .iter()
        .zip(weights)
        .map(|(corner, weight)| corner * weight)
        .sum()
}
