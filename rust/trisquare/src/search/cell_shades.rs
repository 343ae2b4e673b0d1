//! The shades of the light and the dark cells of a lattice in the photograph.
//!
//! In a blurred or coarse picture, dark tiles apart from each other look like a chessboard rotated
//! by 45 degrees: crossings are where two tiles are nearest, and each link cuts off the corner of a
//! tile. So a dark cell is light in its corners, or a light one dark beside its edges. The cells of
//! a chessboard have one shade up to their edges, even where dark ones are too small to touch, or
//! so large that they overlap.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::lattice::{Lattice, STEPS, Site, neighbour_site};
use super::photograph::Photograph;

/// Position at which the four cells at a crossing are sampled: pixels of the photograph along both
/// sides of a cell, to be out of the blur, limited to these fractions of the side. A marker leaves
/// an eighth free.
const INTO_CELL: f64 = 3.0;
const MIN_INTO_CELL: f64 = 0.1;
const MAX_INTO_CELL: f64 = 0.3;

/// Smallest step between a light cell and a dark one at a crossing, over the mean step: at the rim
/// of a board three of the four are light.
const MIN_CONTRAST: f64 = 0.3;

/// Smallest side of a cell (px), in case its crossings coincide.
const MIN_SIDE: f64 = 1e-9;

/// Smallest step from the lightest of the dark cells' means near their edges to the darkest of the
/// light cells', over the step between the middles. A chessboard of 8 pixels per cell has 0.19,
/// blurred by 2 pixels or with gaps or overlaps of a sixth of a cell; tiles have 0.15, blurred as
/// much, or less.
const MIN_STEP: f64 = 0.17;

/// Distance from its edges, as a fraction of its side, at which a dark cell is sampled. To detect
/// separate tiles, the two distances must add up to less than a third.
const DARK_RIM: f64 = 0.15;
/// Same for a light cell, which may contain a marker with a white rim of an eighth.
const LIGHT_RIM: f64 = 0.1;

/// Fraction of the places beside and in a space between two boards that must have the expected
/// shade.
const SPACE_SHARE: f64 = 0.9;
/// Minimum lightness of a space, from 0 (that of dark cells) to 1 (that of light ones).
const LIGHT_SPACE: f64 = 0.7;
/// Minimum number of cells beside a space, on both sides together, and of each shade: fewer may be
/// light and dark by chance. Two boards with four crossings opposite each other have six, of which
/// two are light or two dark.
const MIN_SPACE_CELLS: usize = 6;
const MIN_SHADE_CELLS: usize = 2;

/// Places in a cell, in units of its sides.
type Places = [(f64, f64)];
const CENTRE: &Places = &[(0.5, 0.5)];

/// Positions at this distance from the middles of a cell's edges.
const fn middles(rim: f64) -> [(f64, f64); 4] {
    [(rim, 0.5), (1.0 - rim, 0.5), (0.5, rim), (0.5, 1.0 - rim)]
}

/// Positions in the corners of a cell, at this distance from both edges.
const fn corners(rim: f64) -> [(f64, f64); 4] {
    [
        (rim, rim),
        (1.0 - rim, rim),
        (rim, 1.0 - rim),
        (1.0 - rim, 1.0 - rim),
    ]
}

impl Photograph<'_> {
    /// Whether two light and two dark cells alternate around a crossing.
    pub fn alternates(&self, lattice: &Lattice, site: Site) -> bool {
        self.shades_around(lattice, site).is_some_and(|shades| {
            let [first, second, third, fourth] = match lattice.is_dark(site) {
                true => shades,
                false => shades.map(|shade| -shade),
            };
            let min_step = second.min(fourth) - first.max(third);
            let mean = 0.5 * (second + fourth) - 0.5 * (first + third);
            mean > 0.0 && min_step > MIN_CONTRAST * mean
        })
    }

    /// Grey levels of the four cells at a crossing, clockwise from that of directions 0 and 1;
    /// sides of cells beyond the lattice are replaced by the opposite ones.
    fn shades_around(&self, lattice: &Lattice, site: Site) -> Option<[f64; 4]> {
        let here = lattice.at(site)?;
        let mut directions = [Vector2::zeros(); 4];
        for (direction, step) in directions.iter_mut().zip(STEPS) {
            let ahead = lattice
                .at(neighbour_site(site, step, 1))
                .map(|next| next - here);
            let behind = || Some(here - lattice.at(neighbour_site(site, step, -1))?);
            *direction = ahead.or_else(behind)?;
        }
        Some(std::array::from_fn(|k| {
            let (first, second) = (directions[k], directions[(k + 1) % 4]);
            let side = self.scale * first.norm().min(second.norm());
            let part = INTO_CELL / side.max(MIN_SIDE);
            let part = part.clamp(MIN_INTO_CELL, MAX_INTO_CELL);
            self.level(here + (first + second) * part)
        }))
    }

    /// Whether the cells of a lattice are uniformly light or dark up to near their edges.
    pub fn is_chequered(&self, lattice: &Lattice) -> bool {
        let cells = lattice
            .sites()
            .filter_map(|site| Some((site, lattice.cell(site)?)));
        let (dark, light): (Vec<_>, Vec<_>) = cells.partition(|(site, _)| lattice.is_dark(*site));
        if dark.is_empty() || light.is_empty() {
            return false;
        }
        let mean_of = |cells: &[(Site, [Vector2<f64>; 4])], places: &Places| -> f64 {
            let points = cells.iter().flat_map(|(_, around)| {
                places
                    .iter()
                    .map(move |place| point_in_cell(around, *place))
            });
            points.map(|point| self.level(point)).sum::<f64>() / (cells.len() * places.len()) as f64
        };
        let dark_level = mean_of(&dark, CENTRE);
        let rims = |cells: &[_], rim| [middles(rim), corners(rim)].map(|at| mean_of(cells, &at));
        let [dark_rim, dark_corner] = rims(&dark, DARK_RIM);
        let [light_rim, light_corner] = rims(&light, LIGHT_RIM);
        // The middle of a light cell may be in a marker.
        let light_level = mean_of(&light, CENTRE).max(light_rim).max(light_corner);
        let step = light_rim.min(light_corner) - dark_rim.max(dark_corner);
        light_level > dark_level && step > MIN_STEP * (light_level - dark_level)
    }

    /// The boards of a lattice, separated where there is light paper between whole cells of two
    /// boards.
    ///
    /// An object that hides part of one board is seldom as light as paper, and leaves no whole
    /// cells at its rim.
    pub fn boards(&self, lattice: &Lattice) -> Vec<Lattice> {
        let Some((axis, last)) = self.space(lattice) else {
            return vec![lattice.clone()];
        };
        let is_before = |site: Site| across(site, axis) <= last;
        let parts = [
            lattice.filtered(is_before),
            lattice.filtered(|site| !is_before(site)),
        ];
        parts.iter().flat_map(|part| self.boards(part)).collect()
    }

    /// The first space in a lattice: the axis across it, and the last row (axis 0) or column before
    /// it.
    pub fn space(&self, lattice: &Lattice) -> Option<(usize, isize)> {
        [0, 1].into_iter().find_map(|axis| {
            let occupied: BTreeSet<_> = lattice
                .found()
                .map(|crossing| across(crossing.0, axis))
                .collect();
            let ends = occupied.iter().zip(occupied.iter().skip(1));
            let mut gaps = ends.filter(|(last, first)| *first - *last >= 2);
            gaps.find(|(last, first)| self.is_space(lattice, axis, (**last, **first)))
                .map(|(last, _)| (axis, *last))
        })
    }

    /// Whether there is a space between the last row (axis 0) or column of one part and the first
    /// one of the other.
    fn is_space(&self, lattice: &Lattice, axis: usize, (last, first): (isize, isize)) -> bool {
        let [rows, columns] = lattice.size();
        let site = |across: isize, along: isize| match axis {
            0 => (across, along),
            _ => (along, across),
        };
        let half_cell = 0.5 / (first - last) as f64;
        let (mut dark, mut light, mut space) = (Vec::new(), Vec::new(), Vec::new());
        for along in 0..[columns, rows][axis] as isize {
            let around = [(last, 0), (last, 1), (first, 0), (first, 1)];
            let around = around.map(|(across, step)| lattice.at(site(across, along + step)));
            let [Some(a), Some(b), Some(c), Some(d)] = around else {
                continue;
            };
            let level = |place, part| self.level(point_in_cell(&[a, b, c, d], (place, part)));
            for (across, part) in [(last, half_cell), (first - 1, 1.0 - half_cell)] {
                match lattice.is_dark(site(across, along)) {
                    true => dark.push(level(0.5, part)),
                    // Beside a marker that a light cell may contain; in a coarse picture only its
                    // middle is out of the blur.
                    false => {
                        let levels = [LIGHT_RIM, 0.5, 1.0 - LIGHT_RIM].map(|at| level(at, part));
                        light.push(levels.into_iter().fold(0.0, f64::max));
                    }
                }
            }
            space.push(level(0.5, 0.5));
        }
        let count = dark.len() + light.len();
        if count < MIN_SPACE_CELLS || dark.len().min(light.len()) < MIN_SHADE_CELLS {
            return false;
        }
        let mean = |levels: &[f64]| levels.iter().sum::<f64>() / levels.len() as f64;
        let (dark_mean, step) = (mean(&dark), mean(&light) - mean(&dark));
        let share = |levels: &[f64], min_lightness: f64| {
            let lighter = levels
                .iter()
                .filter(|level| **level > dark_mean + min_lightness * step);
            lighter.count() as f64 / levels.len() as f64
        };
        step > 0.0
            && share(&dark, 0.5) <= 1.0 - SPACE_SHARE
            && share(&light, 0.5) >= SPACE_SHARE
            && share(&space, LIGHT_SPACE) >= SPACE_SHARE
    }
}

/// The row (axis 0) or column of a site.
fn across(site: Site, axis: usize) -> isize {
    [site.0, site.1][axis]
}

/// The point at a position in a cell, by bilinear interpolation.
fn point_in_cell(corners: &[Vector2<f64>; 4], (u, v): (f64, f64)) -> Vector2<f64> {
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    corners
        .iter()
        .zip(weights)
        .map(|(corner, weight)| corner * weight)
        .sum()
}
