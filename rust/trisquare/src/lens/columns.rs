//! Sets of columns of a lens Jacobian.

use super::MAX_LENS_COLUMNS;

/// A set of columns of a lens Jacobian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns(u32);

/// Maximum number of columns in a set.
const SIZE: usize = u32::BITS as usize;

impl Columns {
    /// No column.
    pub const NONE: Self = Self(0);

    /// Every column.
    pub const ALL: Self = Self(u32::MAX);

    /// Returns the set of the listed columns.
    ///
    /// # Panics
    /// If one is 32 or more: no lens has as many.
    pub fn of(columns: impl IntoIterator<Item = usize>) -> Self {
        let with = |set: u32, column: usize| {
            assert!(column < SIZE, "no lens has a column {column}");
            set | 1 << column
        };
        Self(columns.into_iter().fold(0, with))
    }

    /// Whether a column is in the set.
    #[inline]
    pub fn contains(self, column: usize) -> bool {
        column < SIZE && self.0 & (1 << column) != 0
    }

    /// The columns of this set that are not in another.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The columns, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..MAX_LENS_COLUMNS).filter(move |column| self.contains(*column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_listed_and_taken_out_of_one_another() {
        let set = Columns::of([9, 4, 5]);
        assert_eq!(set.iter().collect::<Vec<_>>(), [4, 5, 9]);
        assert_eq!(set.without(Columns::of([4, 17])), Columns::of([5, 9]));
        assert_eq!(set.without(Columns::ALL), Columns::NONE);
        assert_eq!(Columns::ALL.iter().count(), MAX_LENS_COLUMNS);
        assert!(!Columns::ALL.contains(40));
    }
}
