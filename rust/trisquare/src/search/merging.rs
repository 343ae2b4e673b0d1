//! Merging of the pieces of one board, by the positions of their crossings on each other's surface.
//!
//! An arm in front of a board, a highlight or a row of crossings that are too blurred divide it
//! into pieces. As separate planes they would count as independent, and each would determine less
//! than the whole.

use std::cmp::Reverse;

use nalgebra::{Matrix2, Vector2};

use super::folds::MAX_SITES;
use super::lattice::{Lattice, STEPS, Site};
use super::lattice_surface::LatticeSurface;
use crate::numeric::median;

/// Maximum distance, in cells, of a piece's crossings from those predicted by another one's
/// surface: less than half a cell, so that the nearest site is the right one.
const MAX_PIECE_ERROR: f64 = 0.3;

/// Maximum distance, in cells, of each crossing from a site of the host, and minimum number of
/// crossings: by chance this happens once in a million.
const MAX_SITE_ERROR: f64 = 0.15;
const MIN_MISLINKED: usize = 6;

/// Maximum distance, in cells, between two crossings that are the same, found twice.
const MAX_DUPLICATE_DISTANCE: f64 = 0.25;

/// Minimum distance, in cells, between the crossings of two boards, each of which extends by one
/// cell.
const MIN_BOARD_DISTANCE: isize = 2;

/// Crossings at the sites of another lattice.
struct Placed {
    crossings: Vec<(Site, Vector2<f64>)>,
    /// Whether the dark cells are dark cells of the other lattice, too.
    has_same_shades: bool,
}

/// Joins lattices that continue each other, and fragments of lattices to them.
///
/// Each of the `hosts` is large enough to determine its surface; fragments that continue none are
/// dropped. `size` is the picture's width and height; `has_space` returns whether a lattice
/// consists of several boards.
pub(super) fn joined(
    mut hosts: Vec<Lattice>,
    fragments: Vec<Lattice>,
    size: [usize; 2],
    has_space: impl Fn(&Lattice) -> bool,
) -> Vec<Lattice> {
    hosts.sort_by_key(|host| Reverse(host.count()));
    let hosts = hosts.into_iter().map(|host| (true, host));
    let fragments = fragments.into_iter().map(|fragment| (false, fragment));
    let mut pieces: Vec<_> = hosts.chain(fragments).collect();
    let mut done = Vec::new();
    while let Some(first) = pieces.iter().position(|(is_host, _)| *is_host) {
        let (_, host) = pieces.remove(first);
        done.push(join_pieces(host, &mut pieces, size, &has_space));
    }
    done
}

/// Joins the pieces that continue a lattice to it, and removes them from the list, as well as
/// wrongly linked ones.
fn join_pieces(
    mut host: Lattice,
    pieces: &mut Vec<(bool, Lattice)>,
    size: [usize; 2],
    has_space: impl Fn(&Lattice) -> bool,
) -> Lattice {
    let mut surface = LatticeSurface::of(&host, size);
    let mut number = 0;
    while let Some((_, piece)) = pieces.get(number) {
        let union = host.union(piece, &surface);
        if union.as_ref().is_some_and(&has_space) {
            number += 1;
        } else if let Some(union) = union.filter(|lattice| lattice.is_smooth(size)) {
            (host, surface) = (union.clone(), LatticeSurface::of(&union, size));
            pieces.remove(number);
            number = 0; // the larger lattice may reach other pieces
        } else if host.is_mislinked(piece, &surface) {
            pieces.remove(number);
        } else {
            number += 1;
        }
    }
    host
}

impl Lattice {
    /// Both as one lattice, if the piece's crossings are where its own must be.
    fn union(&self, piece: &Self, surface: &LatticeSurface) -> Option<Self> {
        let placed = self.placed(piece, surface)?;
        placed
            .has_same_shades
            .then(|| self.merged(&placed.crossings))?
    }

    /// The piece's crossings at this lattice's sites, if they are near some of its sites.
    fn placed(&self, piece: &Self, surface: &LatticeSurface) -> Option<Placed> {
        let (index, points): (Vec<Site>, Vec<_>) = piece.found().unzip();
        let sites = surface.sites(points.iter().copied());
        if !sites.iter().all(|s| s.x.is_finite() && s.y.is_finite()) || !self.is_near(&sites) {
            return None;
        }
        let index: Vec<_> = index.into_iter().map(|(row, col)| [row, col]).collect();
        let sites: Vec<_> = sites.into_iter().map(|s| s.yx()).collect(); // row, column
        let turn = turn_between(&index, &sites)?;
        let (down, right) = (STEPS[(turn + 1) % 4], STEPS[turn]);
        let turned = index.iter().map(|[row, column]| {
            (
                row * down.0 + column * right.0,
                row * down.1 + column * right.1,
            )
        });
        let turned: Vec<Site> = turned.collect();
        let gaps = || {
            sites
                .iter()
                .zip(&turned)
                .map(|(site, place)| site - as_vector(*place))
        };
        let offset = [
            median(gaps().map(|gap| gap.x).collect())?,
            median(gaps().map(|gap| gap.y).collect())?,
        ];
        let offset = offset.map(|cells| cells.round_ties_even() as isize);
        let placed: Vec<Site> = turned
            .iter()
            .map(|(row, column)| {
                (
                    row.saturating_add(offset[0]),
                    column.saturating_add(offset[1]),
                )
            })
            .collect();
        let errors = sites
            .iter()
            .zip(&placed)
            .map(|(site, place)| (site - as_vector(*place)).amax());
        if median(errors.collect())? > MAX_PIECE_ERROR {
            return None;
        }
        let [row, column] = *index.first()?;
        let dark = piece.is_dark((row, column)) == turn.is_multiple_of(2);
        Some(Placed {
            has_same_shades: dark == self.is_dark(*placed.first()?),
            crossings: placed.into_iter().zip(points).collect(),
        })
    }

    /// Whether a piece consists of crossings of the host's own lattice in wrong rows and columns.
    fn is_mislinked(&self, piece: &Self, surface: &LatticeSurface) -> bool {
        let sites = surface.sites(piece.points());
        let is_close = |site: &Vector2<f64>| {
            let off = site.map(|cells| (cells - cells.round_ties_even()).abs());
            off.x < MAX_SITE_ERROR && off.y < MAX_SITE_ERROR
        };
        sites.len() >= MIN_MISLINKED
            && sites.iter().all(is_close)
            && self.is_near(&sites)
            && !self.is_other_board(piece, surface)
    }

    /// Whether a piece is another board, which is a whole number of cells away by chance.
    ///
    /// Its cells are as large as this lattice's own, and dark where those would be light. Wrong
    /// links between this board's own crossings cannot produce that: they follow edges from light
    /// to dark.
    fn is_other_board(&self, piece: &Self, surface: &LatticeSurface) -> bool {
        let [rows, columns] = self.size();
        let is_apart = |&((row, column), _): &(Site, Vector2<f64>)| {
            let beyond = |at: isize, count: usize| (-at).max(at - count as isize + 1);
            beyond(row, rows).max(beyond(column, columns)) >= MIN_BOARD_DISTANCE
        };
        self.placed(piece, surface)
            .is_some_and(|placed| !placed.has_same_shades && placed.crossings.iter().all(is_apart))
    }

    /// Whether the nearest of some sites (column, row) is no farther from the lattice than its
    /// extent.
    fn is_near(&self, sites: &[Vector2<f64>]) -> bool {
        let [rows, columns] = self.size();
        let last = Vector2::new(columns as f64 - 1.0, rows as f64 - 1.0);
        let beyond = sites.iter().map(|site| (-site).sup(&(site - last)).max());
        beyond.fold(f64::INFINITY, f64::min) <= rows.max(columns) as f64
    }

    /// The lattice with further crossings; `None` if they contradict its own.
    fn merged(&self, placed: &[(Site, Vector2<f64>)]) -> Option<Self> {
        let gap = |&(site, point): &(Site, Vector2<f64>)| Some((self.at(site)? - point).norm());
        if placed.iter().filter_map(gap).fold(0.0, f64::max) > MAX_DUPLICATE_DISTANCE * self.pitch()
        {
            return None;
        }
        let [rows, columns] = self.size();
        let extent = |coordinate: fn(&(Site, Vector2<f64>)) -> isize, count: usize| {
            let (first, last) = placed
                .iter()
                .map(coordinate)
                .fold((0, count as isize - 1), |(f, l), at| (at.min(f), at.max(l)));
            last.abs_diff(first).saturating_add(1)
        };
        let (height, width) = (extent(|p| p.0.0, rows), extent(|p| p.0.1, columns));
        if height.saturating_mul(width) > MAX_SITES {
            return None;
        }
        let all: Vec<_> = placed.iter().copied().chain(self.found()).collect();
        Some(Self::of(&all, self.is_dark((0, 0))))
    }
}

fn as_vector((row, column): Site) -> Vector2<f64> {
    Vector2::new(row as f64, column as f64)
}

/// The direction of the host in which a piece's rows run, by linear regression of the host's rows
/// and columns on the piece's.
fn turn_between(index: &[[isize; 2]], sites: &[Vector2<f64>]) -> Option<usize> {
    let count = index.len() as f64;
    let piece_sites: Vec<_> = index
        .iter()
        .map(|i| Vector2::from(i.map(|n| n as f64)))
        .collect();
    let piece_mean = piece_sites.iter().sum::<Vector2<f64>>() / count;
    let mean = sites.iter().sum::<Vector2<f64>>() / count;
    let (mut normal, mut right) = (Matrix2::zeros(), Matrix2::zeros());
    for (piece_site, site) in piece_sites.iter().zip(sites) {
        let centred = piece_site - piece_mean;
        normal += centred * centred.transpose();
        right += centred * (site - mean).transpose();
    }
    let slopes = normal.try_inverse()? * right;
    (0..4).find(|turn| {
        let (down, right) = (STEPS[(turn + 1) % 4], STEPS[*turn]);
        let along =
            Matrix2::from_rows(&[as_vector(down).transpose(), as_vector(right).transpose()]);
        (slopes - along).amax() < MAX_PIECE_ERROR
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::bent_board::{BentBoard, SIZE, quarter_turned};

    const CENTRE: [f64; 3] = [0.0, 0.0, 30.0];

    fn never(_: &Lattice) -> bool {
        false
    }

    fn board() -> BentBoard {
        BentBoard::turned(35.0, CENTRE)
    }

    #[test]
    fn pieces_of_a_board_are_joined_whichever_way_they_are_turned() {
        let first = board().crossings(0..8, 0..4);
        let mut second = board().crossings(3..8, 6..10);
        for _ in 0..4 {
            let whole = joined(vec![second.clone(), first.clone()], Vec::new(), SIZE, never);
            let expected = board().crossings(0..8, 0..10);
            let expected =
                expected.filtered(|(row, column)| column < 4 || (column >= 6 && row >= 3));
            assert_eq!(whole, [expected]);
            second = quarter_turned(&second);
        }
    }

    #[test]
    fn fragments_are_joined_or_left_out() {
        let host = board().crossings(0..8, 0..6);
        let fragment = board().crossings(2..5, 7..9);
        let strange = BentBoard::turned(-20.0, [14.0, 0.0, 30.0]).crossings(0..3, 0..2);
        let whole = joined(vec![host], vec![strange, fragment], SIZE, never);
        assert_eq!(
            whole.iter().map(Lattice::count).collect::<Vec<_>>(),
            [48 + 6]
        );
    }

    #[test]
    fn what_contradicts_is_not_joined() {
        let host = board().crossings(0..8, 0..4);
        let piece = board().crossings(0..8, 6..10);
        // The host's own crossings, linked wrongly: dark cells next to it where light ones must be.
        let next = board().crossings(0..8, 4..10);
        let swapped =
            |it: &Lattice| Lattice::of(&it.found().collect::<Vec<_>>(), !it.is_dark((0, 0)));
        let own = joined(
            vec![
                host.clone(),
                swapped(&next).filtered(|(_, column)| column < 3),
            ],
            Vec::new(),
            SIZE,
            never,
        );
        assert!(matches!(&own[..], [only] if *only == host));
        // At this distance it is another board.
        let other = swapped(&piece);
        assert_eq!(
            joined(vec![host.clone(), other.clone()], Vec::new(), SIZE, never),
            [host.clone(), other]
        );
        let half = 0.5 * (piece.at((0, 1)).unwrap() - piece.at((0, 0)).unwrap());
        let between = piece.moved(|point| point + half);
        assert_eq!(
            joined(vec![host.clone(), between], Vec::new(), SIZE, never).len(),
            2
        );
        let folded = BentBoard::turned(-25.0, [3.0, 0.0, 30.0]).crossings(0..8, 6..10);
        assert_eq!(joined(vec![host, folded], Vec::new(), SIZE, never).len(), 2);
    }

    #[test]
    fn every_second_row_is_no_lattice_of_its_own() {
        let board = BentBoard::turned(20.0, CENTRE);
        let host = board.crossings(0..8, 0..10);
        let rows = board.crossings(8..14, 0..10);
        let second: Vec<_> = rows
            .found()
            .filter(|((row, _), _)| row % 2 == 0)
            .map(|((row, column), point)| ((row / 2, column), point))
            .collect();
        let second = Lattice::of(&second, true);
        assert_eq!(
            joined(vec![host.clone(), second], Vec::new(), SIZE, never),
            [host]
        );
    }

    #[test]
    fn boards_apart_stay_two_even_where_one_continues_the_other() {
        let first = board().crossings(0..8, 0..4);
        let second = board().crossings(0..8, 6..10);
        let apart = joined(
            vec![first.clone(), second.clone()],
            Vec::new(),
            SIZE,
            |lattice| lattice.count() == 64,
        );
        assert_eq!(apart, [first, second]);
    }
}
