//! Search for the chessboard-like lattices of a picture, linked from its saddle points, one per
//! plane.
//!
//! The picture is searched from coarse to fine. A coarse picture does not show the markers in light
//! cells, the noise, and the blur of large cells. A finer one shows small cells, and serves to
//! refine and complete the lattices of the coarser one.

use std::cmp::Reverse;

use super::candidates::candidates;
use super::lattice::Lattice;
use super::level::Level;
use super::outline::Outline;
use super::photograph::Photograph;
use super::replacing::with_replacements;
use super::saddles::refine_corner;
use super::sectors::{SaddleCandidate, crossings_at};
use crate::image::GreyBytes;

/// Maximum number of pictures that are searched; the coarsest ones are left out.
const MAX_PICTURES: usize = 16;

/// Result of a search for lattices.
#[derive(Debug)]
pub struct FoundLattices {
    /// The lattices, by decreasing number of crossings, in pixels of the photograph.
    pub lattices: Vec<Lattice>,
    /// Number of crossings of edges that are not on the lattices or within a cell of them, in the
    /// last of the pictures.
    pub crossings_beside: usize,
}

/// Finds every lattice of at least 3 x 3 crossings in a photograph.
///
/// The `pictures` are the photograph at reduced sizes, each twice as fine as the one before; the
/// last one is the photograph itself or half as fine. In the latter case the photograph is searched
/// as well if the last picture shows linked crossings beside its lattices, as it does where the
/// rims of markers fade in it; without a lattice, only if enough crossings are linked to form one.
#[must_use]
pub fn find_lattices(photograph: &GreyBytes<'_>, pictures: &[GreyBytes<'_>]) -> FoundLattices {
    find_at_candidates(photograph, pictures, candidates)
}

/// Same as `find_lattices`, with a function for the places in a picture where crossings may be.
fn find_at_candidates(
    photograph: &GreyBytes<'_>,
    pictures: &[GreyBytes<'_>],
    candidates: impl Fn(&GreyBytes<'_>) -> Vec<SaddleCandidate>,
) -> FoundLattices {
    let pictures = &pictures[pictures.len().saturating_sub(MAX_PICTURES)..];
    let Some(finest) = pictures.last() else {
        return FoundLattices {
            lattices: Vec::new(),
            crossings_beside: 0,
        };
    };
    let is_halved = finest.size() != photograph.size();
    let mut scaled_photograph = Photograph {
        grey: *photograph,
        scale: f64::from(u32::from(is_halved) + 1) * 2f64.powi(pictures.len() as i32 - 1),
    };
    let mut lattices: Vec<Lattice> = Vec::new();
    let level_of = |picture| Level::new(picture, crossings_at(picture, &candidates(picture)));
    let mut level = level_of(&pictures[0]);
    for (number, picture) in pictures.iter().enumerate() {
        if number > 0 {
            scaled_photograph.scale *= 0.5;
            level = level_of(picture);
            lattices = lattices
                .iter()
                .map(|lattice| lattice.doubled(&level.picture))
                .collect();
        }
        // Otherwise a lattice that a coarse picture shows in a grille, or in the cells of two
        // boards, would hide the true ones from the finer pictures.
        lattices.retain(|lattice| scaled_photograph.has_edges(lattice));
        lattices = level.lattices(lattices, number + 1 == pictures.len());
        lattices.retain(|lattice| lattice.is_board(scaled_photograph.scale));
    }
    if is_halved && level.has_more_crossings(&lattices) {
        lattices = search_photograph(lattices, &level_of(photograph));
    }
    lattices.retain(|lattice| scaled_photograph.has_edges(lattice));
    let lattices = extended(&lattices, &level.picture, &scaled_photograph, |_| true);
    let found = lattices.iter().map(|lattice| {
        let alternating = lattice.filtered(|site| scaled_photograph.alternates(lattice, site));
        alternating.complete()
    });
    let is_sound = |lattice: &Lattice| {
        lattice.is_board(scaled_photograph.scale)
            && scaled_photograph.has_edges(lattice)
            && scaled_photograph.is_chequered(lattice)
    };
    let mut found: Vec<_> = found.filter(is_sound).collect();
    found.sort_by_key(|lattice| Reverse(lattice.count()));
    FoundLattices {
        crossings_beside: level
            .free_crossings(found.iter().map(Outline::with_rim))
            .len(),
        lattices: found
            .iter()
            .map(|lattice| lattice.scaled(scaled_photograph.scale))
            .collect(),
    }
}

impl Lattice {
    /// The lattice in a picture twice as fine.
    fn doubled(&self, finer: &GreyBytes<'_>) -> Self {
        // Reduced pictures keep the centre of every second pixel, so that coordinates are only
        // multiplied.
        self.moved(|point| refine_corner(finer, point * 2.0))
    }
}

/// The lattices, those that satisfy `needs_more` with faint crossings added, but none that may
/// belong to another one.
fn extended(
    lattices: &[Lattice],
    picture: &GreyBytes<'_>,
    photograph: &Photograph<'_>,
    needs_more: impl Fn(&Lattice) -> bool,
) -> Vec<Lattice> {
    let outlines: Vec<_> = lattices.iter().map(Outline::with_rim).collect();
    let extended = lattices.iter().enumerate().map(|(number, lattice)| {
        let others = outlines
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != number);
        let others: Vec<_> = others.map(|(_, outline)| outline).collect();
        match needs_more(lattice) {
            true => lattice.extended(picture, photograph, &others),
            false => lattice.clone(),
        }
    });
    extended.collect()
}

/// Searches the photograph itself, given the lattices in the halved picture.
fn search_photograph(known: Vec<Lattice>, whole: &Level<'_>) -> Vec<Lattice> {
    let photograph = Photograph {
        grey: whole.picture,
        scale: 1.0,
    };
    let doubled = known
        .iter()
        .map(|lattice| lattice.doubled(&whole.picture))
        .collect();
    let finer = whole.lattices(doubled, true);
    let finer: Vec<_> = finer.iter().map(Lattice::complete).collect();
    // A small board must have nearly all of its crossings.
    let finer = extended(&finer, &whole.picture, &photograph, |lattice| {
        !lattice.is_board(1.0)
    });
    let boards = finer
        .iter()
        .filter(|lattice| lattice.is_board(1.0) && photograph.has_edges(lattice));
    with_replacements(known, boards.map(|lattice| lattice.scaled(0.5)).collect())
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use nalgebra::Vector2;

    use super::*;

    const SIZE: usize = 120;
    const CELL: f64 = 14.0;

    /// A board with 6 crossings per row, slightly rotated, and the pixels of its crossings.
    fn board(rows: u32) -> (Vec<u8>, Vec<SaddleCandidate>) {
        let along = Vector2::new(0.98, 0.2) * CELL;
        let down = Vector2::new(-0.2, 0.98) * CELL;
        let first = Vector2::new(30.0, 18.0);
        let wave = |way: f64| (2.5 * (std::f64::consts::PI * way).sin()).tanh();
        let shade = |index: usize| {
            let way = Vector2::new((index % SIZE) as f64, (index / SIZE) as f64) - first;
            let (u, v) = (
                way.dot(&along) / CELL.powi(2),
                way.dot(&down) / CELL.powi(2),
            );
            let is_on_it = u > -1.0 && u < 6.0 && v > -1.0 && v < f64::from(rows);
            if is_on_it {
                120.0 + 80.0 * wave(u) * wave(v)
            } else {
                200.0
            }
        };
        let values = (0..SIZE * SIZE)
            .map(|index| shade(index).round() as u8)
            .collect();
        let sites = (0..rows).flat_map(|row| (0..6).map(move |column| (row, column)));
        let candidate = |(row, column): (u32, u32)| {
            let point = first + along * f64::from(column) + down * f64::from(row);
            SaddleCandidate {
                pixel: [point.x.round() as usize, point.y.round() as usize],
                strength: 1.0,
            }
        };
        (values, sites.map(candidate).collect())
    }

    #[test]
    fn a_board_is_found_whole_with_all_its_crossings_or_some_that_are_too_faint() {
        let (values, candidates) = board(5);
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        for missing in [0, 3] {
            let some = |_: &GreyBytes<'_>| candidates[missing..].to_vec();
            let found = find_at_candidates(&picture, &[picture], some);
            let [lattice] = &found.lattices[..] else {
                panic!("{found:?}")
            };
            assert_eq!(found.crossings_beside, 0);
            let mut size = lattice.size();
            size.sort_unstable();
            assert_eq!((size, lattice.count()), ([5, 6], 30));
            for (site, point) in lattice.found() {
                let near = |it: &SaddleCandidate| {
                    (Vector2::from(it.pixel.map(|x| x as f64)) - point).amax()
                };
                assert!(candidates.iter().any(|it| near(it) < 1.0), "{site:?}");
            }
        }
    }

    /// The same picture at twice the size.
    fn doubled(values: &[u8]) -> Vec<u8> {
        let at = |index: usize| index / (4 * SIZE) * SIZE + index % (2 * SIZE) / 2;
        (0..4 * SIZE * SIZE)
            .map(|index| values[at(index)])
            .collect()
    }

    #[test]
    fn a_photograph_is_searched_itself_if_its_half_shows_crossings_without_a_lattice() {
        for (rows, is_lattice) in [(2, false), (5, true)] {
            let (values, known) = board(rows);
            let whole = doubled(&values);
            let halved = GreyBytes::new(SIZE, SIZE, &values).unwrap();
            let photograph = GreyBytes::new(2 * SIZE, 2 * SIZE, &whole).unwrap();
            let looked_closer = Cell::new(false);
            let candidates = |picture: &GreyBytes<'_>| {
                looked_closer.set(picture.size() == photograph.size());
                known.clone()
            };
            let found = find_at_candidates(&photograph, &[halved], candidates);
            assert_eq!(looked_closer.get(), !is_lattice);
            assert_eq!(found.crossings_beside == 0, is_lattice);
            let mut points = found.lattices.iter().flat_map(Lattice::points);
            assert_eq!(is_lattice, points.any(|point| point.x > 1.2 * SIZE as f64));
        }
    }

    #[test]
    fn nothing_is_found_in_nothing() {
        let flat = vec![100; SIZE * SIZE];
        let picture = GreyBytes::new(SIZE, SIZE, &flat).unwrap();
        let anywhere = |_: &GreyBytes<'_>| board(5).1;
        let found = find_at_candidates(&picture, &[picture], anywhere);
        for found in [find_lattices(&picture, &[]), found] {
            assert!(found.lattices.is_empty());
            assert_eq!(found.crossings_beside, 0);
        }
    }

    #[test]
    fn a_board_is_found_in_its_picture_alone() {
        let (values, _) = board(5);
        let picture = GreyBytes::new(SIZE, SIZE, &values).unwrap();
        let found = find_lattices(&picture, &[picture]).lattices;
        assert_eq!(found.iter().map(Lattice::count).collect::<Vec<_>>(), [30]);
    }
}
