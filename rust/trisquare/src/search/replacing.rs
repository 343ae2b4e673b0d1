//! Choice between the lattices of a halved picture and those of the whole one.
//!
//! They are paired by position, as a search may return them in any order, joined or in parts.

use super::lattice::Lattice;
use super::outline::Outline;

/// Fraction of a lattice's crossings that the outline of another one must cover to be of the same
/// board. Boards that meet at a fold share a row.
const MIN_SAME_SHARE: f64 = 0.5;

/// The known lattices, each replaced by that of the finer picture if it has at least as many
/// crossings, and the lattices that only the finer picture shows.
///
/// The finer picture may lack known lattices because of noise and blur. All lattices are in the
/// same coordinates.
pub(super) fn with_replacements(known: Vec<Lattice>, finer: Vec<Lattice>) -> Vec<Lattice> {
    let outlines: Vec<_> = finer.iter().map(Outline::of).collect();
    let successors: Vec<_> = known
        .iter()
        .map(|lattice| successor(lattice, &outlines))
        .collect();
    let has_all = |number: usize| {
        let replaced = known.iter().zip(&successors);
        let replaced = replaced.filter(|(_, successor)| **successor == Some(number));
        finer[number].count() >= replaced.map(|(lattice, _)| lattice.count()).sum()
    };
    let is_better: Vec<_> = (0..finer.len()).map(has_all).collect();
    let kept = known.into_iter().zip(&successors);
    let kept = kept.filter(|(_, successor)| successor.is_none_or(|number| !is_better[number]));
    let mut all: Vec<_> = kept.map(|(lattice, _)| lattice).collect();
    let kept_outlines: Vec<_> = all.iter().map(Outline::of).collect();
    let new = finer.into_iter().zip(is_better);
    // A part of a lattice that is kept is not added.
    let new = new.filter(|(lattice, is_better)| {
        *is_better
            && kept_outlines
                .iter()
                .all(|outline| covered_share(lattice, outline) < MIN_SAME_SHARE)
    });
    all.extend(new.map(|(lattice, _)| lattice));
    all
}

/// Index of the outline that covers most of a lattice's crossings, if it covers enough of them.
fn successor(lattice: &Lattice, outlines: &[Outline]) -> Option<usize> {
    let shares = outlines
        .iter()
        .map(|outline| covered_share(lattice, outline));
    let best = shares.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best.1 >= MIN_SAME_SHARE).then_some(best.0)
}

/// Fraction of a lattice's crossings that an outline covers.
fn covered_share(lattice: &Lattice, outline: &Outline) -> f64 {
    let covered = lattice.points().filter(|point| outline.covers(*point));
    covered.count() as f64 / lattice.count().max(1) as f64
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    /// `count` crossings in rows of eight, from the column `left` on.
    fn lattice(left: f64, count: isize) -> Lattice {
        let found: Vec<_> = (0..count)
            .map(|number| {
                let (row, column) = (number / 8, number % 8);
                let way = Vector2::new(column as f64, row as f64) * 10.0;
                ((row, column), way + Vector2::new(left, 0.0))
            })
            .collect();
        Lattice::of(&found, true)
    }

    const A: f64 = 0.0;
    const B: f64 = 200.0;

    #[test]
    fn lattices_are_paired_by_place_in_any_order() {
        let known = vec![lattice(A, 40), lattice(B, 39)];
        // Paired by order, the better one of B would replace A.
        let all = with_replacements(known, vec![lattice(B, 41), lattice(A, 38)]);
        assert_eq!(all, [lattice(A, 40), lattice(B, 41)]);
    }

    #[test]
    fn a_new_one_is_added_and_a_part_of_a_known_one_is_not() {
        let part = lattice(A, 40).filtered(|(row, _)| row > 2);
        let all = with_replacements(vec![lattice(A, 40)], vec![part, lattice(B, 16)]);
        assert_eq!(all, [lattice(A, 40), lattice(B, 16)]);
    }

    #[test]
    fn one_that_joins_two_replaces_both_if_it_has_all_their_crossings() {
        let whole = lattice(A, 48);
        let halves = || {
            let upper = lattice(A, 48).filtered(|(row, _)| row < 3);
            vec![
                upper,
                lattice(A, 48).filtered(|(row, column)| row > 2 && column > 0),
            ]
        };
        assert_eq!(with_replacements(halves(), vec![whole.clone()]), [whole]);
        assert_eq!(with_replacements(halves(), vec![lattice(A, 40)]), halves());
    }

    #[test]
    fn nothing_known_and_nothing_finer() {
        assert!(with_replacements(Vec::new(), Vec::new()).is_empty());
        assert_eq!(
            with_replacements(vec![lattice(A, 9)], Vec::new()),
            [lattice(A, 9).clone()]
        );
    }
}
