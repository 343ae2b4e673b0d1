//! The lattices of one picture: completes those known from a coarser one, and finds others.

use std::borrow::Cow;
use std::cell::OnceCell;

use super::edge_following::{Crossing, Followers, link_crossings, linked_groups};
use super::lattice::{Lattice, MIN_CROSSINGS};
use super::merging::joined;
use super::outline::Outline;
use super::photograph::Photograph;
use super::pieces::pieces;
use crate::image::GreyBytes;

/// Number of crossings lost to strays for which there is a second search.
const MIN_LOST: usize = 3;

/// A picture and the crossings of edges in it.
pub(super) struct Level<'a> {
    pub picture: GreyBytes<'a>,
    crossings: Vec<Crossing>,
    /// The next crossings of each one, once they have been computed.
    links: OnceCell<Vec<Followers>>,
}

/// Lattices that are large enough to judge whether they are smooth, and fragments.
struct Grown {
    lattices: Vec<Lattice>,
    fragments: Vec<Lattice>,
}

impl<'a> Level<'a> {
    pub fn new(picture: &GreyBytes<'a>, crossings: Vec<Crossing>) -> Self {
        Self {
            picture: *picture,
            crossings,
            links: OnceCell::new(),
        }
    }

    /// Completes the lattices known from a coarser picture and finds those that it did not show.
    ///
    /// Faint crossings beside those of lattices that have remained small are only sought if
    /// `is_thorough`: weak connections in a coarse picture are better seen in the next one.
    pub fn lattices(&self, known: Vec<Lattice>, is_thorough: bool) -> Vec<Lattice> {
        if self.crossings.len() < MIN_CROSSINGS {
            return known;
        }
        let grown = self.grown(&known, is_thorough);
        let (count, crossings) = (grown.lattices.len(), crossing_count(&grown.lattices));
        let parts = self.smooth(grown);
        if parts.len() == count && crossing_count(&parts) + MIN_LOST > crossings {
            return parts;
        }
        // Crossings of a neighbour that a lattice had over a fold are free for the neighbour now,
        // and there may be more crossings between two pieces that were joined.
        self.smooth(self.grown(&parts, is_thorough))
    }

    /// Whether there are at least as many linked crossings beside the lattices as a lattice has.
    ///
    /// Each of them may be missing from one of the lattices. If there are no lattices, they must be
    /// in one connected group: clutter has small groups of links in many places.
    pub fn has_more_crossings(&self, lattices: &[Lattice]) -> bool {
        let free = self.free_crossings(lattices.iter().map(Outline::of));
        if free.len() < MIN_CROSSINGS {
            return false;
        }
        let groups = linked_groups(&self.links(&free));
        let linked_count = match lattices.is_empty() {
            true => groups.into_iter().max().unwrap_or(0),
            false => groups.into_iter().sum(),
        };
        linked_count >= MIN_CROSSINGS
    }

    /// The crossings that no outline covers.
    pub fn free_crossings(&self, outlines: impl Iterator<Item = Outline>) -> Vec<Crossing> {
        uncovered(&self.crossings, &outlines.collect::<Vec<_>>())
    }

    /// Divides lattices into boards, and these into smooth parts of whole cells; then joins the
    /// parts that continue each other.
    fn smooth(&self, grown: Grown) -> Vec<Lattice> {
        let size = self.picture.size();
        let photograph = self.own_photograph();
        let boards = grown
            .lattices
            .iter()
            .flat_map(|lattice| photograph.boards(lattice));
        let parts = boards.flat_map(|board| board.complete().smooth_parts(size));
        let (whole, rest): (Vec<_>, Vec<_>) = parts
            .map(|part| part.complete())
            .partition(Lattice::is_large);
        let fragments = grown.fragments.iter().map(Lattice::complete).chain(rest);
        let fragments = fragments.filter(|lattice| lattice.count() > 0).collect();
        joined(whole, fragments, size, |union| {
            photograph.space(union).is_some()
        })
    }

    /// Grows the known lattices, each by crossings that no other one has, and then new lattices
    /// from the remaining crossings.
    fn grown(&self, known: &[Lattice], is_thorough: bool) -> Grown {
        let mut outlines: Vec<_> = known.iter().map(Outline::of).collect();
        let mut lattices: Vec<Lattice> = Vec::new();
        for (number, lattice) in known.iter().enumerate() {
            let (before, own_and_after) = outlines.split_at(number);
            let others = uncovered(&uncovered(&self.crossings, before), &own_and_after[1..]);
            let grown = lattice.grown(&self.picture, &others);
            outlines[number] = Outline::of(&grown);
            lattices.push(grown);
        }
        let mut free = uncovered(&self.crossings, &outlines);
        let mut fragments = Vec::new();
        if free.len() < MIN_CROSSINGS {
            return Grown {
                lattices,
                fragments,
            };
        }
        for seed in pieces(&free, &self.links(&free)) {
            if seed
                .points()
                .any(|point| outlines.iter().any(|outline| outline.covers(point)))
            {
                continue;
            }
            let mut lattice = seed.grown(&self.picture, &free);
            if is_thorough && !lattice.complete().is_large() {
                let others: Vec<_> = lattices.iter().map(Outline::with_rim).collect();
                lattice = self.extended(&lattice, &others.iter().collect::<Vec<_>>());
                lattice = lattice.grown(&self.picture, &free);
            }
            if lattice.is_large() {
                let outline = Outline::of(&lattice);
                free.retain(|crossing| !outline.covers(crossing.point));
                outlines.push(outline);
                lattices.push(lattice);
            } else {
                fragments.push(lattice);
            }
        }
        Grown {
            lattices,
            fragments,
        }
    }

    /// The next crossings of each of some crossings of this picture; for all of them they are
    /// computed only once.
    fn links(&self, crossings: &[Crossing]) -> Cow<'_, [Followers]> {
        let linked = || link_crossings(&self.picture, crossings);
        match crossings.len() == self.crossings.len() {
            true => Cow::Borrowed(self.links.get_or_init(linked)),
            false => Cow::Owned(linked()),
        }
    }

    /// The lattice with faint crossings of this picture added, without using a finer one.
    fn extended(&self, lattice: &Lattice, others: &[&Outline]) -> Lattice {
        lattice.extended(&self.picture, &self.own_photograph(), others)
    }

    /// This picture as its own photograph.
    fn own_photograph(&self) -> Photograph<'_> {
        Photograph {
            grey: self.picture,
            scale: 1.0,
        }
    }
}

fn crossing_count(lattices: &[Lattice]) -> usize {
    lattices.iter().map(Lattice::count).sum()
}

/// The crossings that no outline covers.
fn uncovered(crossings: &[Crossing], outlines: &[Outline]) -> Vec<Crossing> {
    let is_free = |crossing: &&Crossing| {
        !outlines
            .iter()
            .any(|outline| outline.covers(crossing.point))
    };
    crossings.iter().filter(is_free).copied().collect()
}
