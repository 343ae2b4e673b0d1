//! Chessboard-like lattices of a picture: linked from its saddle points, one per plane.
//!
//! The picture is searched from coarse to fine. A coarse picture has lost the markers that a light
//! cell may carry, the noise, and the blur of large cells; a finer one has the small cells, and
//! settles and completes what the coarser one showed.

use std::cmp::Reverse;

use super::lattice::Lattice;
use super::level::Level;
use super::outline::Outline;
use super::photograph::Photograph;
use super::saddles::refine_corner;
use super::sectors::{Candidate, crossings_at};
use crate::image::GreyBytes;

/// Pictures that are searched, at most; the others, which are the coarsest, are left out.
const MOST_PICTURES: usize = 16;

/// A picture to search, and where its crossings may be.
#[derive(Debug, Clone)]
pub struct ReducedPicture<'a> {
    /// A photograph, reduced or as it is.
    pub picture: GreyBytes<'a>,
    /// Pixels whose grey levels are curved as at a saddle.
    pub candidates: Vec<Candidate>,
}

/// Finds every lattice of 3 x 3 crossings and more in a photograph, from that of most crossings to
/// that of fewest, in pixels of the photograph.
///
/// The `pictures` are the photograph reduced, each twice as fine as the one before; the last one is
/// the photograph itself or half as fine. If half as fine, and if it shows crossings which make no
/// lattice, as the rims of markers fade in it, the whole is searched as well, for the `candidates`
/// in it.
///
/// # Errors
/// What `candidates` fails with.
pub fn find_lattices<E>(
    photograph: &GreyBytes<'_>,
    pictures: &[ReducedPicture<'_>],
    candidates: impl FnOnce() -> Result<Vec<Candidate>, E>,
) -> Result<Vec<Lattice>, E> {
    let pictures = &pictures[pictures.len().saturating_sub(MOST_PICTURES)..];
    let Some(finest) = pictures.last() else {
        return Ok(Vec::new());
    };
    let is_halved = finest.picture.size() != photograph.size();
    let mut seen = Photograph {
        grey: *photograph,
        scale: f64::from(u32::from(is_halved) + 1) * 2f64.powi(pictures.len() as i32 - 1),
    };
    let mut lattices: Vec<Lattice> = Vec::new();
    let mut level = Level::of(&pictures[0]);
    for (number, reduced) in pictures.iter().enumerate() {
        if number > 0 {
            seen.scale *= 0.5;
            level = Level::of(reduced);
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
        let whole = Level {
            picture: *photograph,
            crossings: crossings_at(photograph, &candidates()?),
        };
        lattices = looked_closer(lattices, &whole);
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
    Ok(found
        .iter()
        .map(|lattice| lattice.scaled(seen.scale))
        .collect())
}

impl<'a> Level<'a> {
    fn of(reduced: &ReducedPicture<'a>) -> Self {
        Self {
            picture: reduced.picture,
            crossings: crossings_at(&reduced.picture, &reduced.candidates),
        }
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
    let halved = finer.iter().map(|lattice| {
        let is_good = lattice.is_board(1.0) && photograph.has_edges(lattice);
        is_good.then(|| lattice.scaled(0.5))
    });
    let mut halved: Vec<_> = halved.collect();
    let new = halved.split_off(known.len().min(halved.len()));
    // Noise and blur may hide from the photograph what the halved picture shows.
    let replaced = known.iter().zip(halved).map(|(old, new)| {
        let better = new.filter(|new| new.count() >= old.count());
        better.unwrap_or_else(|| old.clone())
    });
    replaced.chain(new.into_iter().flatten()).collect()
}
