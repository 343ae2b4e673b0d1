//! What the samples on one line sum to.

/// Column of the residual, after the three of the line.
pub(super) const RESIDUAL: usize = 3;

/// Costs, and outer products of `(l, residual, shared parameters)`, by their lower triangle.
pub(super) struct LineSums<const N: usize> {
    pub cost: f64,
    pub products: [[f64; N]; N],
}
