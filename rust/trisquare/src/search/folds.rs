//! Smoothness of the crossings of a plane.
//!
//! The crossings of a plane are those of a homography, displaced along the radii by the lens. A
//! wrong crossing departs from that by itself; folded paper departs from it all along the fold.

use super::lattice::{Lattice, Site};
use super::lattice_surface::LatticeSurface;
use crate::numeric::median;

/// Ratio to the typical deviation above which a crossing is a stray.
const STRAY_MEDIANS: f64 = 5.0;

/// Deviation that is always tolerated, in pixels of the searched picture, and in cells: the error
/// of a crossing, and the departure of curled paper from the smooth surface.
const MIN_STRAY_PIXELS: f64 = 0.8;
const MIN_STRAY_CELLS: f64 = 0.06;

/// Deviation of a whole row or column, in cells and at least in pixels, above which there is a
/// fold. Curled paper leaves half of it, a fold of 30 degrees twice as much.
const MIN_FOLD_CELLS: f64 = 0.1;
const MIN_FOLD_PIXELS: f64 = 0.6;

/// Maximum number of successive folds at which a lattice is split: two for sheets in a room's
/// corner.
const MAX_FOLDS: usize = 2;

/// Number of sites of a lattice above which no fold is sought: it bounds the time for an unusual
/// picture. The largest boards have 30 x 30 cells.
pub(super) const MAX_SITES: usize = 1000;

impl Lattice {
    /// Splits a lattice where the paper is folded along a row or a column, and removes strays.
    ///
    /// Parts that are too small for their smoothness to be judged are left out: a row or two of
    /// another board. `size` is the picture's width and height.
    pub(super) fn smooth_parts(&self, size: [usize; 2]) -> Vec<Self> {
        self.parts_between_folds(size, MAX_FOLDS)
    }

    fn parts_between_folds(&self, size: [usize; 2], max_folds: usize) -> Vec<Self> {
        if !self.is_large() {
            return Vec::new();
        }
        let deviations = LatticeSurface::of(self, size).deviations(self);
        if largest(&deviations) < MIN_FOLD_PIXELS {
            return vec![self.clone()];
        }
        let (whole_roughness, fold_tolerance) = (roughness(&deviations), self.fold_tolerance());
        let [rows, columns] = self.size();
        if whole_roughness <= fold_tolerance || max_folds == 0 || rows * columns > MAX_SITES {
            let strays = self.strays(&deviations);
            return vec![self.filtered(|site| !strays.contains(&site))];
        }
        let (parts, folds_left) = match self.best_cut(size, whole_roughness, fold_tolerance) {
            Some(parts) => (parts, max_folds - 1),
            None => (vec![self.clone()], 0),
        };
        let smooth = |part: &Self| part.parts_between_folds(size, folds_left);
        parts.iter().flat_map(smooth).collect()
    }

    /// The parts of the best cut: among cuts into flat parts the one that loses fewest crossings,
    /// else the one into the flattest parts.
    fn best_cut(
        &self,
        size: [usize; 2],
        whole_roughness: f64,
        fold_tolerance: f64,
    ) -> Option<Vec<Self>> {
        let [rows, columns] = self.size();
        let across = (1..rows).map(|cut| (0, cut as isize));
        let along = (1..columns).map(|cut| (1, cut as isize));
        let (mut best, mut best_parts) = ((0, whole_roughness), None);
        for (axis, cut) in across.chain(along) {
            let is_first = |(row, column): Site| [row, column][axis] < cut;
            let pair = [
                self.filtered(is_first),
                self.filtered(|site| !is_first(site)),
            ];
            let mut parts: Vec<_> = pair.into_iter().filter(Self::is_large).collect();
            if parts.is_empty() {
                continue;
            }
            let extent = |part: &Self| part.size()[0] * part.size()[1];
            let mut by_extent: Vec<&Self> = parts.iter().collect();
            by_extent.sort_by_key(|part| extent(part));
            let mut rough: f64 = 0.0;
            for part in by_extent {
                rough = rough.max(roughness(&LatticeSurface::of(part, size).deviations(part)));
                if rough > fold_tolerance.max(best.1) {
                    break; // the other, larger one, does not matter
                }
            }
            let kept: usize = parts.iter().map(Self::count).sum();
            let lost = if rough <= fold_tolerance {
                -(kept as isize)
            } else {
                0
            };
            if (lost, rough) < best {
                best = (lost, rough);
                best_parts = Some(std::mem::take(&mut parts));
            }
        }
        best_parts
    }

    /// Whether there are neither folds nor strays.
    pub(super) fn is_smooth(&self, size: [usize; 2]) -> bool {
        let deviations = LatticeSurface::of(self, size).deviations(self);
        largest(&deviations) < MIN_FOLD_PIXELS
            || (roughness(&deviations) <= self.fold_tolerance()
                && self.strays(&deviations).is_empty())
    }

    /// Crossings that are not on the smooth surface of the others.
    fn strays(&self, deviations: &[(Site, f64)]) -> Vec<Site> {
        let typical = median(deviations.iter().map(|(_, off)| *off).collect());
        let limit = (STRAY_MEDIANS * typical.unwrap_or(0.0)).max(self.stray_tolerance());
        let strays = deviations.iter().filter(|(_, off)| *off > limit);
        strays.map(|(site, _)| *site).collect()
    }

    /// Deviation of a crossing that is always tolerated, pixels.
    pub(super) fn stray_tolerance(&self) -> f64 {
        (MIN_STRAY_CELLS * self.pitch()).max(MIN_STRAY_PIXELS)
    }

    /// Largest deviation of a whole row or column that is not a fold, pixels.
    fn fold_tolerance(&self) -> f64 {
        (MIN_FOLD_CELLS * self.pitch()).max(MIN_FOLD_PIXELS)
    }
}

fn largest(deviations: &[(Site, f64)]) -> f64 {
    deviations.iter().map(|(_, off)| *off).fold(0.0, f64::max)
}

/// Median deviation of the row or column where it is largest, pixels.
fn roughness(deviations: &[(Site, f64)]) -> f64 {
    if largest(deviations) < MIN_FOLD_PIXELS {
        return 0.0;
    }
    let line_medians = |number: fn(Site) -> isize| {
        let lines = deviations.iter().map(|(site, _)| number(*site)).max();
        (0..=lines.unwrap_or(0)).filter_map(move |line| {
            let on_line = deviations.iter().filter(|(site, _)| number(*site) == line);
            median(on_line.map(|(_, off)| *off).collect())
        })
    };
    line_medians(|site| site.0)
        .chain(line_medians(|site| site.1))
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::search::bent_board::{BentBoard, SIZE};

    const CENTRE: [f64; 3] = [0.0, 0.0, 30.0];

    fn board() -> Lattice {
        BentBoard::turned(30.0, CENTRE).crossings(0..8, 0..10)
    }

    /// A board with further rows beyond its last one, at the given distances from it in cells.
    fn with_alien_rows(distances: &[f64]) -> Lattice {
        let own = board();
        let mut found: Vec<_> = own.found().collect();
        for (number, distance) in (0..).zip(distances) {
            for column in 0..10 {
                let [before, last] = [6, 7].map(|row| own.at((row, column)).unwrap());
                found.push(((8 + number, column), last + (last - before) * *distance));
            }
        }
        Lattice::of(&found, true)
    }

    #[test]
    fn a_bent_board_is_smooth_and_one_part() {
        assert!(board().is_smooth(SIZE));
        assert_eq!(board().smooth_parts(SIZE), [board()]);
    }

    #[test]
    fn a_row_of_another_board_is_left_out() {
        // A row beyond a fold is nearer than the board's next row would be.
        assert_eq!(with_alien_rows(&[0.6]).smooth_parts(SIZE), [board()]);
    }

    #[test]
    fn rows_on_both_sides_of_a_fold_are_no_part() {
        // A surface that bends freely, like a polynomial, would pass through any three rows.
        let parts = with_alien_rows(&[1.6, 2.2]).smooth_parts(SIZE);
        assert_eq!(parts.iter().map(Lattice::count).max(), Some(80));
        let own: Vec<_> = board().points().collect();
        for part in parts {
            let mut points = part.points();
            let first = own.contains(&points.next().unwrap());
            assert!(points.all(|point| own.contains(&point) == first));
        }
    }

    #[test]
    fn a_stray_is_left_out() {
        let mut lattice = board();
        let moved = lattice
            .at((0, 3))
            .map(|point| point + Vector2::new(4.0, 2.0));
        lattice.set((0, 3), moved);
        assert!(!lattice.is_smooth(SIZE));
        let parts = lattice.smooth_parts(SIZE);
        assert_eq!(parts, [board().filtered(|site| site != (0, 3))]);
    }

    #[test]
    fn a_few_crossings_tell_nothing() {
        assert!(
            board()
                .filtered(|(row, _)| row < 2)
                .smooth_parts(SIZE)
                .is_empty()
        );
    }
}
