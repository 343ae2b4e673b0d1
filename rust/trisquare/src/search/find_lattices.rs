//! Chessboard-like lattices of a picture: linked from its saddle points, one per plane.
//!
//! The picture is searched from coarse to fine. A coarse picture has lost the markers that a light
//! cell may carry, the noise, and the blur of large cells; a finer one has the small cells, and
//! settles and completes what the coarser one showed.

use std::cmp::Reverse;

use super::candidates::candidates;
use super::lattice::Lattice;
use super::level::Level;
use super::outline::Outline;
use super::photograph::Photograph;
use super::replacing::replaced;
use super::saddles::refine_corner;
use super::sectors::{SaddleCandidate, crossings_at};
use crate::image::GreyBytes;

/// Pictures that are searched, at most; the others, which are the coarsest, are left out.
const MAX_PICTURES: usize = 16;

/// What a search for lattices found.
#[derive(Debug)]
pub struct FoundLattices {
    /// From that of most crossings to that of fewest, in pixels of the photograph.
    pub lattices: Vec<Lattice>,
    /// Crossings of edges beside them and a cell round them, in the last one of the pictures.
    pub crossings_beside: usize,
}

/// Finds every lattice of 3 x 3 crossings and more in a photograph.
///
/// The `pictures` are the photograph reduced, each twice as fine as the one before; the last one is
/// the photograph itself or half as fine. If half as fine, and if it shows linked crossings beside
/// its lattices, as the rims of markers fade in it, the whole is searched as well. Without a lattice,
/// enough of them must hang together to be one.
#[must_use]
pub fn find_lattices(photograph: &GreyBytes<'_>, pictures: &[GreyBytes<'_>]) -> FoundLattices {
    find_at_candidates(photograph, pictures, candidates)
}

/// The same with the places of a picture where its crossings may be.
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
    let mut seen = Photograph {
        grey: *photograph,
        scale: f64::from(u32::from(is_halved) + 1) * 2f64.powi(pictures.len() as i32 - 1),
    };
    let mut lattices: Vec<Lattice> = Vec::new();
    let level_of = |picture| Level::new(picture, crossings_at(picture, &candidates(picture)));
    let mut level = level_of(&pictures[0]);
    for (number, picture) in pictures.iter().enumerate() {
        if number > 0 {
            seen.scale *= 0.5;
            level = level_of(picture);
            lattices = lattices
                .iter()
                .map(|it| it.doubled(&level.picture))
                .collect();
        }
        // What a coarse picture makes of a grille, or of the cells of two boards, would else hide
        // from the finer ones what is there.
        lattices.retain(|lattice| seen.has_edges(lattice));
        lattices = level.lattices(lattices, number + 1 == pictures.len());
        lattices.retain(|lattice| lattice.is_board(seen.scale));
    }
    if is_halved && level.shows_more(&lattices) {
        lattices = looked_closer(lattices, &level_of(photograph));
    }
    lattices.retain(|lattice| seen.has_edges(lattice));
    let lattices = extended(&lattices, &level.picture, &seen, |_| true);
    let found = lattices.iter().map(|lattice| {
        let alternating = lattice.filtered(|site| seen.alternates(lattice, site));
        alternating.complete()
    });
    let is_sound = |lattice: &Lattice| {
        lattice.is_board(seen.scale) && seen.has_edges(lattice) && seen.is_chequered(lattice)
    };
    let mut found: Vec<_> = found.filter(is_sound).collect();
    found.sort_by_key(|lattice| Reverse(lattice.count()));
    FoundLattices {
        crossings_beside: level.beside(found.iter().map(Outline::with_rim)).len(),
        lattices: found.iter().map(|it| it.scaled(seen.scale)).collect(),
    }
}

impl Lattice {
    /// In a picture twice as fine.
    fn doubled(&self, finer: &GreyBytes<'_>) -> Self {
        // Every second pixel's centre is kept, so that coordinates only need the factor.
        self.moved(|point| refine_corner(finer, point * 2.0))
    }
}

/// With faint crossings of those for which something holds, but none that may be another one's.
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

/// Searches the photograph itself, of which lattices in the halved picture are known.
fn looked_closer(known: Vec<Lattice>, whole: &Level<'_>) -> Vec<Lattice> {
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
    // Of a small board hardly a crossing may be missing.
    let finer = extended(&finer, &whole.picture, &photograph, |it| !it.is_board(1.0));
    let good = finer
        .iter()
        .filter(|lattice| lattice.is_board(1.0) && photograph.has_edges(lattice));
    replaced(known, good.map(|lattice| lattice.scaled(0.5)).collect())
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use nalgebra::Vector2;

    use super::*;

    const SIZE: usize = 120;
    const CELL: f64 = 14.0;

    /// A board of 6 crossings a row, turned a little, and the pixels of its crossings.
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

    /// The same picture of twice the size.
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
