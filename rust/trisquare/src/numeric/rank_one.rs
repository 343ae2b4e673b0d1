//! Sums of outer products, stored as lower triangles: the innermost loops of every fit.

use super::chebyshev::LANES;

/// Adds `weight` times the outer product of a row with itself.
#[inline(always)]
pub(crate) fn add_rank_one<const N: usize>(sums: &mut [[f64; N]; N], row: &[f64; N], weight: f64) {
    for i in 0..N {
        let weighted = weight * row[i];
        for j in 0..=i {
            sums[i][j] += weighted * row[j];
        }
    }
}

/// Sums of outer products to which several rows are added at a time, with two partial sums per
/// product.
pub(crate) struct LaneSums<const N: usize>([[[f64; PARTS]; N]; N]);

const PARTS: usize = LANES / 2;

impl<const N: usize> LaneSums<N> {
    pub fn new() -> Self {
        Self([[[0.0; PARTS]; N]; N])
    }

    /// Adds weights times the outer products of rows with themselves; the rows are given as columns
    /// over all of them.
    pub fn add(&mut self, columns: &[[f64; LANES]; N], weights: &[f64; LANES]) {
        for (i, (sums, column)) in self.0.iter_mut().zip(columns).enumerate() {
            let weighted: [f64; LANES] = std::array::from_fn(|lane| weights[lane] * column[lane]);
            for (sum, other) in sums[..=i].iter_mut().zip(columns) {
                for part in 0..PARTS {
                    let lane = part + PARTS;
                    sum[part] += weighted[part] * other[part] + weighted[lane] * other[lane];
                }
            }
        }
    }

    /// The lower triangle.
    pub fn sums(&self) -> [[f64; N]; N] {
        self.0.map(|row| row.map(|parts| parts.iter().sum()))
    }
}

/// An element of a symmetric matrix given by its lower triangle.
pub(crate) fn symmetric_entry<const N: usize>(sums: &[[f64; N]; N], i: usize, j: usize) -> f64 {
    sums[i.max(j)][i.min(j)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_added_together_sum_up_as_one_by_one() {
        let rows: [[f64; 5]; LANES] = std::array::from_fn(|lane| {
            std::array::from_fn(|i| (1.3 * lane as f64 + i as f64).sin())
        });
        let weights: [f64; LANES] = std::array::from_fn(|lane| 1.0 + lane as f64);
        let mut expected = [[0.0; 5]; 5];
        for (row, weight) in rows.iter().zip(weights) {
            add_rank_one(&mut expected, row, weight);
        }
        let mut sums = LaneSums::<5>::new();
        sums.add(&std::array::from_fn(|i| rows.map(|row| row[i])), &weights);
        let found = sums.sums();
        for i in 0..5 {
            for j in 0..=i {
                assert!((found[i][j] - expected[i][j]).abs() < 1e-14);
            }
        }
    }
}
