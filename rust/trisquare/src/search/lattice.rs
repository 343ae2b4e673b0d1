//! Crossings of a chessboard's grid lines in rows and columns.

use nalgebra::Vector2;

use crate::numeric::median;

/// Row and column of a lattice.
pub type Site = (isize, isize);

/// Row and column steps of a lattice's directions, clockwise on the screen: along a row, down a
/// column, and back.
pub(super) const STEPS: [Site; 4] = [(0, 1), (1, 0), (0, -1), (-1, 0)];

/// Crossings of a lattice, and per direction: fewer come about by chance, and are single squares.
pub(super) const MIN_CROSSINGS: usize = 9;
const MIN_SIDE: usize = 3;

/// Side in pixels of the photograph of the square as large as a typical cell: smaller ones are
/// pictures of boards on a screen or in print, or nothing.
const MIN_CELL: f64 = 7.5;

/// A lattice of fewer crossings must have this share of its rows and columns: pieces of random
/// mosaics are ragged.
pub(super) const SMALL: usize = 16;
const SMALL_SHARE: f64 = 0.9;

/// The site some steps on.
pub(super) fn beside(site: Site, step: Site, count: isize) -> Site {
    (site.0 + count * step.0, site.1 + count * step.1)
}

fn is_even((row, column): Site) -> bool {
    (row ^ column) & 1 == 0
}

/// Crossings of a chessboard's grid lines; columns go clockwise from rows on the screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    rows: usize,
    columns: usize,
    crossings: Vec<Option<Vector2<f64>>>,
    /// Whether it is dark clockwise of the row that leaves crossing (0, 0).
    dark_first: bool,
}

impl Lattice {
    /// The lattice of some crossings at any sites, of which no row or column at the rim is empty.
    ///
    /// `is_dark` says whether it is dark clockwise of the row that leaves site (0, 0).
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
        let dark_first = is_dark == is_even((top, left));
        let mut lattice = Self::empty(rows, columns, dark_first);
        for &((row, column), point) in found {
            lattice.set((row - top, column - left), Some(point));
        }
        lattice
    }

    fn empty(rows: usize, columns: usize, dark_first: bool) -> Self {
        Self {
            rows,
            columns,
            crossings: vec![None; rows * columns],
            dark_first,
        }
    }

    /// Numbers of rows and of columns.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.rows, self.columns]
    }

    /// The crossing of a row and a column, in pixels; `None` if it was not found.
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

    /// Puts a crossing at a site, or takes it away; sites outside stay empty.
    pub(super) fn set(&mut self, site: Site, crossing: Option<Vector2<f64>>) {
        if let Some(index) = self.index(site) {
            self.crossings[index] = crossing;
        }
    }

    /// Whether it is dark clockwise of the row that leaves a site.
    pub(super) fn is_dark(&self, site: Site) -> bool {
        is_even(site) == self.dark_first
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

    /// How many crossings were found.
    #[must_use]
    pub fn count(&self) -> usize {
        self.points().count()
    }

    /// The crossings of which both ends of a step are found, from one to the next.
    pub(super) fn links(&self, step: Site) -> impl Iterator<Item = (Site, [Vector2<f64>; 2])> {
        self.found().filter_map(move |(site, start)| {
            let end = self.at(beside(site, step, 1))?;
            Some((site, [start, end]))
        })
    }

    /// The corners of a cell whose four crossings are found: (0, 0), (0, 1), (1, 0), (1, 1).
    pub(super) fn cell(&self, (row, column): Site) -> Option<[Vector2<f64>; 4]> {
        Some([
            self.at((row, column))?,
            self.at((row, column + 1))?,
            self.at((row + 1, column))?,
            self.at((row + 1, column + 1))?,
        ])
    }

    /// Length of a typical link, in the direction where they are shorter, pixels.
    pub(super) fn pitch(&self) -> f64 {
        let length = |(_, [start, end]): (Site, [Vector2<f64>; 2])| (end - start).norm();
        let typical = |step| median(self.links(step).map(length).collect());
        let typical = [typical(STEPS[1]), typical(STEPS[0])];
        typical.into_iter().flatten().fold(f64::NAN, f64::min)
    }

    /// Without the crossings for which something does not hold.
    pub(super) fn filtered(&self, mut keep: impl FnMut(Site) -> bool) -> Self {
        let kept = self.found().filter(|(site, _)| keep(*site));
        Self::of(&kept.collect::<Vec<_>>(), self.dark_first)
    }

    /// Without the crossings of which no whole cell is there.
    pub(super) fn complete(&self) -> Self {
        self.filtered(|(row, column)| {
            let around = [(-1, -1), (-1, 0), (0, -1), (0, 0)];
            around
                .iter()
                .any(|(down, right)| self.cell((row + down, column + right)).is_some())
        })
    }

    /// With one more row and column on every side, which are empty.
    pub(super) fn padded(&self) -> Self {
        let mut padded = Self::empty(self.rows + 2, self.columns + 2, self.dark_first);
        for ((row, column), point) in self.found() {
            padded.set((row + 1, column + 1), Some(point));
        }
        padded
    }

    /// In a picture that is so many times as fine.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        self.moved(|point| point * factor)
    }

    /// With other crossings at the same sites.
    pub(super) fn moved(&self, place: impl Fn(Vector2<f64>) -> Vector2<f64>) -> Self {
        Self {
            crossings: self.crossings.iter().map(|c| c.map(&place)).collect(),
            ..self.clone()
        }
    }

    /// Whether there are enough crossings to tell whether they lie smoothly.
    pub(super) fn is_large(&self) -> bool {
        self.rows.min(self.columns) >= MIN_SIDE && self.count() >= MIN_CROSSINGS
    }

    /// Whether there are enough crossings for a board, and they are far enough apart in a photograph
    /// that is `scale` times as fine.
    pub(super) fn is_board(&self, scale: f64) -> bool {
        let count = self.count();
        let sites = (self.rows * self.columns) as f64;
        if !self.is_large() || (count < SMALL && (count as f64) < SMALL_SHARE * sites) {
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

    /// Crossings 10 pixels apart at all sites but some.
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
