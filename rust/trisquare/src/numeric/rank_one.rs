//! Sums of outer products, by their lower triangle: the innermost loops of every fit.

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

/// An element of the symmetric matrix whose lower triangle was summed.
pub(crate) fn symmetric<const N: usize>(sums: &[[f64; N]; N], i: usize, j: usize) -> f64 {
    sums[i.max(j)][i.min(j)]
}
