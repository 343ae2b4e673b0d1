//! Sums over the samples on one line.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::lens::MAX_LENS_COLUMNS;
use crate::numeric::{Block, symmetric_entry};

/// Column of the residual, after the three of the line.
pub(super) const RESIDUAL: usize = 3;

/// Columns before the shared parameters: the line's three, and the residual.
pub(super) const SHARED_OFFSET: usize = RESIDUAL + 1;

/// Cost, and lower triangle of the outer products of `(l, residual, shared parameters)`.
pub(super) struct LineSums<const N: usize> {
    pub cost: f64,
    pub products: [[f64; N]; N],
}

/// The sums that involve the line.
pub(super) struct LineProducts {
    pub cost: f64,
    pub line_square: Matrix3<f64>,
    pub line_residual: Vector3<f64>,
    /// One column for each shared parameter; the others are zero.
    pub line_shared: SMatrix<f64, 3, MAX_LENS_COLUMNS>,
}

impl<const N: usize> LineSums<N> {
    /// Adds the products of the shared parameters to a block, and returns the others.
    // Not inlined: inlined where the sums are made, rustc 1.95 computes wrong ones, with eight
    // columns, in a test program that is optimised across crates. `make test-release` shows it.
    #[inline(never)]
    pub fn split(&self, shared: usize, block: &mut Block) -> LineProducts {
        let at = |i: usize, j: usize| symmetric_entry(&self.products, i, j);
        for i in 0..shared {
            for j in 0..shared {
                block.shared[(i, j)] += at(SHARED_OFFSET + i, SHARED_OFFSET + j);
            }
            block.shared_gradient[i] += at(SHARED_OFFSET + i, RESIDUAL);
        }
        LineProducts {
            cost: self.cost,
            line_square: Matrix3::from_fn(at),
            line_residual: Vector3::from_fn(|i, _| at(i, RESIDUAL)),
            line_shared: SMatrix::from_fn(|i, j| match j < shared {
                true => at(i, SHARED_OFFSET + j),
                false => 0.0,
            }),
        }
    }
}
