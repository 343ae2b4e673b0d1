//! The crossings of a chessboard's grid lines, in rows and columns.

use nalgebra::Vector2;

use crate::numeric::median;

/// Row and column of a lattice.
pub type Site = (isize, isize);

/// Row and column steps of a lattice's four directions, clockwise on the screen: along a row, down
/// a column, and back.
pub(super) const STEPS: [Site; 4] = [(0, 1), (1, 0), (0, -1), (-1, 0)];

/// Minimum number of crossings of a lattice, in total and per direction: smaller lattices occur by
/// chance, or are single squares.
pub(super) const MIN_CROSSINGS: usize = 9;
const MIN_SIDE: usize = 3;

/// Minimum side, in pixels of the photograph, of a square with the area of the median cell:
/// lattices with smaller cells are pictures of boards on a screen or in print, or nothing.
const MIN_CELL: f64 = 7.5;

/// Number of crossings below which a lattice must have at least the given fraction of its sites
/// occupied: pieces of random mosaics are ragged.
pub(super) const SMALL_COUNT: usize = 16;
const SMALL_SHARE: f64 = 0.9;

/// The site `count` steps away.
pub(super) fn neighbour_site(site: Site, step: Site, count: isize) -> Site {
    (site.0 + count * step.0, site.1 + count * step.1)
}

fn is_even((row, column): Site) -> bool {
    (row ^ column) & 1 == 0
}

/// Crossings of a chessboard's grid lines; the direction of columns is clockwise of that of rows on
/// the screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    rows: usize,
    columns: usize,
    crossings: Vec<Option<Vector2<f64>>>,
    /// Whether the cell clockwise of the row's direction at crossing (0, 0) is dark.
    is_first_dark: bool,
}

impl Lattice {
    /// The lattice of some crossings at any sites, reduced to the rows and columns that they cover.
    ///
    /// `is_dark` tells whether the cell clockwise of the row's direction at site (0, 0) is dark.
    #[must_use]
    pub fn of(found: &[(Site, Vector2<f64>)], is_dark: bool) -> Self {
        let range = |coordinate: fn(&Site) -> isize| {
            let all = || found.iter().map(|(site, _)| coordinate(site));
            let first = all().min().unwrap_or(0);
            (
                first,
                all().max().map_or(0, |last| last.abs_diff(first) + 1),
            )
        };
        let ((top, rows), (left, columns)) = (range(|site| site.0), range(|site| site.1));
        let is_first_dark = is_dark == is_even((top, left));
        let mut lattice = Self::empty(rows, columns, is_first_dark);
        for &((row, column), point) in found {
            lattice.set((row - top, column - left), Some(point));
        }
        lattice
    }

    fn empty(rows: usize, columns: usize, is_first_dark: bool) -> Self {
        Self {
            rows,
            columns,
            crossings: vec![None; rows * columns],
            is_first_dark,
        }
    }

    /// Numbers of rows and of columns.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }

    /// The crossing at a site, in pixels; `None` if it was not found.
    #[must_use]
    pub fn at(&self, site: Site) -> Option<Vector2<f64>> {
        self.crossings[self.index(site)?]
    }

    fn index(&self, (row, column): Site) -> Option<usize> {
        let row = usize::try_from(row).ok().filter(|row| *row < self.rows)?;
        let column = usize::try_from(column).ok();
        Some(row * self.columns + column.filter(|column| *column < self.columns)?)
    }

    pub(super) fn has(&self, site: Site) -> bool {
        self.at(site).is_some()
    }

    /// Sets or removes the crossing at a site; sites outside stay empty.
    pub(super) fn set(&mut self, site: Site, crossing: Option<Vector2<f64>>) {
        if let Some(index) = self.index(site) {
            self.crossings[index] = crossing;
        }
    }

    /// Whether the cell clockwise of the row's direction at a site is dark.
    pub(super) fn is_dark(&self, site: Site) -> bool {
        is_even(site) == self.is_first_dark
    }

    /// All sites, row by row.
    pub(super) fn sites(&self) -> impl Iterator<Item = Site> + use<> {
        let (rows, columns) = (self.rows as isize, self.columns as isize);
        (0..rows).flat_map(move |row| (0..columns).map(move |column| (row, column)))
    }

    /// The crossings that were found, row by row.
    pub fn found(&self) -> impl Iterator<Item = (Site, Vector2<f64>)> {
        let crossings = self.sites().zip(&self.crossings);
        crossings.filter_map(|(site, crossing)| Some((site, (*crossing)?)))
    }

    pub(super) fn points(&self) -> impl Iterator<Item = Vector2<f64>> {
        self.crossings.iter().copied().flatten()
    }

    /// Number of crossings that were found.
    #[must_use]
    pub fn count(&self) -> usize {
        self.points().count()
    }

    /// The crossings that have a neighbour at a step, each with the points of both.
    pub(super) fn links(&self, step: Site) -> impl Iterator<Item = (Site, [Vector2<f64>; 2])> {
        self.found().filter_map(move |(site, start)| {
            let end = self.at(neighbour_site(site, step, 1))?;
            Some((site, [start, end]))
        })
    }

    /// The corners of a cell, if all four are found: (0, 0), (0, 1), (1, 0), (1, 1).
    pub(super) fn cell(&self, (row, column): Site) -> Option<[Vector2<f64>; 4]> {
        Some([
            self.at((row, column))?,
            self.at((row, column + 1))?,
            self.at((row + 1, column))?,
            self.at((row + 1, column + 1))?,
        ])
    }

    /// Median length of the links, in the direction in which they are shorter, pixels.
    pub(super) fn pitch(&self) -> f64 {
        let length = |(_, [start, end]): (Site, [Vector2<f64>; 2])| (end - start).norm();
        let typical = |step| median(self.links(step).map(length).collect());
        let typical = [typical(STEPS[1]), typical(STEPS[0])];
        typical.into_iter().flatten().fold(f64::NAN, f64::min)
    }

    /// The lattice without the crossings for which `keep` is false.
    pub(super) fn filtered(&self, mut keep: impl FnMut(Site) -> bool) -> Self {
        let kept = self.found().filter(|(site, _)| keep(*site));
        Self::of(&kept.collect::<Vec<_>>(), self.is_first_dark)
    }

    /// The lattice without crossings that belong to no whole cell.
    pub(super) fn complete(&self) -> Self {
        self.filtered(|(row, column)| {
            let around = [(-1, -1), (-1, 0), (0, -1), (0, 0)];
            around
                .iter()
                .any(|(down, right)| self.cell((row + down, column + right)).is_some())
        })
    }

    /// The lattice with one more row and column on every side, which are empty.
    pub(super) fn padded(&self) -> Self {
        let mut padded = Self::empty(self.rows + 2, self.columns + 2, self.is_first_dark);
        for ((row, column), point) in self.found() {
            padded.set((row + 1, column + 1), Some(point));
        }
        padded
    }

    /// The lattice in a picture that is `factor` times as fine.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        self.moved(|point| point * factor)
    }

    /// The lattice with its crossings moved by a function.
    pub(super) fn moved(&self, place: impl Fn(Vector2<f64>) -> Vector2<f64>) -> Self {
        Self {
            crossings: self.crossings.iter().map(|c| c.map(&place)).collect(),
            ..self.clone()
        }
    }

    /// Whether there are enough crossings to judge whether they are on a smooth surface.
    pub(super) fn is_large(&self) -> bool {
        self.rows.min(self.columns) >= MIN_SIDE && self.count() >= MIN_CROSSINGS
    }

    /// Whether there are enough crossings for a board, far enough apart in a photograph that is
    /// `scale` times as fine.
    pub(super) fn is_board(&self, scale: f64) -> bool {
        let count = self.count();
        let sites = (self.rows * self.columns) as f64;
        if !self.is_large() || (count < SMALL_COUNT && (count as f64) < SMALL_SHARE * sites) {
            return false;
        }
        let cells = self.sites().filter_map(|site| self.cell(site));
        let area = |[a, b, c, d]: [Vector2<f64>; 4]| 0.5 * (d - a).perp(&(c - b)).abs();
        median(cells.map(area).collect()).is_some_and(|area| scale * area.sqrt() >= MIN_CELL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Crossings 10 pixels apart at all sites except `missing`.
    fn lattice(rows: isize, columns: isize, missing: &[Site]) -> Lattice {
        let sites = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let found: Vec<_> = sites
            .filter(|site| !missing.contains(site))
            .map(|(row, column)| {
                (
                    (row, column),
                    Vector2::new(column as f64, row as f64) * 10.0,
                )
            })
            .collect();
        Lattice::of(&found, true)
    }

    #[test]
    fn empty_rows_at_the_rim_are_left_out_and_shades_stay_with_their_sites() {
        let whole = lattice(4, 5, &[]);
        let part = whole.filtered(|(row, column)| row > 0 && column != 4);
        assert_eq!(part.size(), [3, 4]);
        assert_eq!(part.at((0, 0)), whole.at((1, 0)));
        assert_eq!(part.is_dark((0, 0)), whole.is_dark((1, 0)));
        assert_eq!(part.padded().is_dark((1, 1)), part.is_dark((0, 0)));
    }

    #[test]
    fn crossings_without_a_whole_cell_are_left_out() {
        let ragged = lattice(4, 4, &[(0, 0), (0, 1), (0, 3), (2, 3)]);
        let complete = ragged.complete();
        assert_eq!(complete.size(), [3, 3]);
        assert_eq!(complete.count(), 9);
        assert!(lattice(1, 5, &[]).complete().count() == 0);
    }

    #[test]
    fn a_board_has_nine_crossings_and_cells_of_some_pixels() {
        assert!(lattice(3, 3, &[]).is_board(1.0));
        assert!(!lattice(3, 3, &[]).is_board(0.5));
        assert!(!lattice(2, 8, &[]).is_board(1.0));
        assert!(!lattice(3, 4, &[(0, 0), (2, 3)]).is_board(1.0));
        assert_eq!(lattice(3, 3, &[]).pitch(), 10.0);
        assert!(lattice(1, 1, &[]).pitch().is_nan());
    }
}
