//! The equations of one block of an arrowhead system as one small matrix, from which unknowns are
//! eliminated.
//!
//! A likelihood of many planes needs some hundred thousand eliminations: with the gradient as an
//! additional column, one pass replaces five products and solutions.

use nalgebra::{DMatrix, DVector};

use super::arrowhead::{Block, Reduced};

/// The equations of a block: rows and columns of its own parameters, of the shared ones, of the
/// gradient, and of the ties. Only the lower triangle of the symmetric matrix is used; the
/// gradient's diagonal element is the contribution of eliminations to minus twice the log
/// likelihood.
#[derive(Clone)]
pub(crate) struct BlockEquations {
    own: usize,
    shared: usize,
    matrix: DMatrix<f64>,
}

impl Block {
    /// The block's equations as one matrix.
    pub fn equations(&self) -> BlockEquations {
        let (own, shared) = self.cross.shape();
        let gradient = own + shared;
        let size = gradient + 1 + self.ties.ncols();
        let mut matrix = DMatrix::zeros(size, size);
        for (i, mut column) in matrix.column_iter_mut().take(gradient).enumerate() {
            if let Some(i) = i.checked_sub(own) {
                column
                    .rows_mut(own, shared)
                    .copy_from(&self.shared.column(i));
                column[gradient] = self.shared_gradient[i];
                continue;
            }
            column.rows_mut(0, own).copy_from(&self.hessian.column(i));
            for j in 0..shared {
                column[own + j] = self.cross[(i, j)];
            }
            column[gradient] = self.gradient[i];
            for j in 0..self.ties.ncols() {
                column[gradient + 1 + j] = self.ties[(i, j)];
            }
        }
        BlockEquations {
            own,
            shared,
            matrix,
        }
    }

    /// The block with other equations of the same parameters.
    pub fn with_equations(&self, equations: &BlockEquations) -> Self {
        let (own, shared) = self.cross.shape();
        let part = |first: [usize; 2], rows: usize, columns: usize| {
            DMatrix::from_fn(rows, columns, |i, j| {
                equations.entry(first[0] + i, first[1] + j)
            })
        };
        let gradient = |first: usize, rows: usize| {
            DVector::from_fn(rows, |i, _| equations.entry(first + i, own + shared))
        };
        Self {
            columns: self.columns.clone(),
            shared: part([own, own], shared, shared),
            shared_gradient: gradient(own, shared),
            hessian: part([0, 0], own, own),
            cross: part([0, own], own, shared),
            gradient: gradient(0, own),
            ties: self.ties.clone(),
        }
    }
}

impl BlockEquations {
    fn entry(&self, i: usize, j: usize) -> f64 {
        self.matrix[(i.max(j), i.min(j))]
    }

    /// Eliminates further unknowns, given as columns: the terms of each by all of them, then by the
    /// block's own parameters, by the shared ones, and the gradient. Returns the logarithm of the
    /// determinant; `None` if they are not positive definite.
    pub fn eliminate(&mut self, unknowns: DMatrix<f64>) -> Option<f64> {
        eliminate(unknowns, (&mut self.matrix, 0))
    }

    /// Adds a prior on the last of the block's own parameters: the precision of each, and the
    /// corresponding gradient.
    pub fn add_prior(&mut self, precisions: &[f64], gradient: &[f64]) {
        let (first, row) = (self.own - precisions.len(), self.own + self.shared);
        for (k, (precision, gradient)) in precisions.iter().zip(gradient).enumerate() {
            self.matrix[(first + k, first + k)] += precision;
            self.matrix[(row, first + k)] += gradient;
        }
    }

    /// The equations with the first of the block's own parameters eliminated, and the logarithm of
    /// their determinant; `None` if they are not positive definite.
    pub fn without_first(mut self, count: usize) -> Option<(Self, f64)> {
        let log_determinant = self.eliminate_first(count)?;
        let remaining = self.matrix.nrows() - count;
        let rest = Self {
            own: self.own - count,
            shared: self.shared,
            matrix: self
                .matrix
                .view((count, count), (remaining, remaining))
                .into_owned(),
        };
        Some((rest, log_determinant))
    }

    /// The equations of the shared parameters, and of the multipliers after them, with the block's
    /// own parameters eliminated; and the block's contribution to minus twice the log likelihood.
    pub fn reduced(mut self) -> Option<(Reduced, f64)> {
        let log_determinant = self.eliminate_first(self.own)?;
        let gradient = self.own + self.shared;
        let remaining = (self.own..self.matrix.nrows()).filter(|i| *i != gradient);
        let remaining: Vec<usize> = remaining.collect();
        let reduced = Reduced {
            information: DMatrix::from_fn(remaining.len(), remaining.len(), |i, j| {
                self.entry(remaining[i], remaining[j])
            }),
            gradient: DVector::from_fn(remaining.len(), |i, _| self.entry(remaining[i], gradient)),
        };
        Some((reduced, log_determinant + self.entry(gradient, gradient)))
    }

    /// Eliminates the first `count` of its own parameters from all that follow.
    fn eliminate_first(&mut self, count: usize) -> Option<f64> {
        let unknowns = self.matrix.columns(0, count).into_owned();
        eliminate(unknowns, (&mut self.matrix, count))
    }
}

/// Eliminates unknowns, given as columns, from each other and from the rest: the rows and columns
/// of a matrix from `first` on.
fn eliminate(mut unknowns: DMatrix<f64>, (rest, first): (&mut DMatrix<f64>, usize)) -> Option<f64> {
    let ((length, count), size) = (unknowns.shape(), rest.nrows());
    let mut log_determinant = 0.0;
    for k in 0..count {
        let (pivot_column, later) = unknowns.as_mut_slice()[length * k..].split_at_mut(length);
        let pivot = pivot_column[k];
        if !(pivot > 0.0) {
            return None;
        }
        log_determinant += pivot.ln();
        let later = later.chunks_exact_mut(length);
        subtract(
            later.map(|column| &mut column[k + 1..]),
            &pivot_column[k + 1..],
            pivot,
        );
        let rest = rest.as_mut_slice()[size * first..].chunks_exact_mut(size);
        subtract(
            rest.map(|column| &mut column[first..]),
            &pivot_column[count..],
            pivot,
        );
    }
    Some(log_determinant)
}

/// Subtracts the outer product of some terms over a pivot from the lower triangle of symmetric
/// columns.
#[inline]
fn subtract<'a>(columns: impl Iterator<Item = &'a mut [f64]>, terms: &[f64], pivot: f64) {
    let inverse = 1.0 / pivot;
    for ((i, term), column) in terms.iter().enumerate().zip(columns) {
        let factor = term * inverse;
        for (value, other_term) in column[i..].iter_mut().zip(&terms[i..]) {
            *value -= factor * other_term;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNKNOWNS: usize = 3;
    const OWN: usize = 4;
    const SHARED: usize = 2;

    /// Compares with dense solutions of all unknowns at once.
    #[test]
    fn what_is_left_is_the_dense_schur_complement() {
        let size = UNKNOWNS + OWN + SHARED;
        let jacobian = DMatrix::from_fn(30, size + 1, |i, j| {
            ((i * 13 + 7) as f64 * (j as f64 + 1.3)).sin()
        });
        let square = jacobian.tr_mul(&jacobian);
        let mut block = Block::zeros(OWN, (0..SHARED).collect());
        let part = |i: usize, j: usize, rows: usize, columns: usize| {
            square
                .view((UNKNOWNS + i, UNKNOWNS + j), (rows, columns))
                .into_owned()
        };
        block.hessian = part(0, 0, OWN, OWN);
        block.cross = part(0, OWN, OWN, SHARED);
        block.shared = part(OWN, OWN, SHARED, SHARED);
        block.gradient = part(0, OWN + SHARED, OWN, 1).column(0).into_owned();
        block.shared_gradient = part(OWN, OWN + SHARED, SHARED, 1).column(0).into_owned();
        block.ties = DMatrix::zeros(OWN, 0);
        let mut equations = block.equations();
        let unknowns = square.columns(0, UNKNOWNS).into_owned();
        let first = equations.eliminate(unknowns).unwrap();

        let schur = |eliminated: usize| {
            let left = size + 1 - eliminated;
            let inverse = square.view((0, 0), (eliminated, eliminated)).into_owned();
            let cross = square
                .view((0, eliminated), (eliminated, left))
                .into_owned();
            let taken = cross.tr_mul(&(inverse.clone().try_inverse().unwrap() * &cross));
            let whole = square.view((eliminated, eliminated), (left, left));
            (whole - taken, inverse.determinant().ln())
        };
        let (expected, own_determinant) = schur(UNKNOWNS);
        let found = block.with_equations(&equations);
        let near = |a: &DMatrix<f64>, b: &DMatrix<f64>| assert!((a - b).norm() < 1e-10 * b.norm());
        near(
            &found.hessian,
            &expected.view((0, 0), (OWN, OWN)).into_owned(),
        );
        near(
            &found.cross,
            &expected.view((0, OWN), (OWN, SHARED)).into_owned(),
        );
        near(
            &found.shared,
            &expected.view((OWN, OWN), (SHARED, SHARED)).into_owned(),
        );
        assert!((first - own_determinant).abs() < 1e-10);

        let (expected, determinant) = schur(UNKNOWNS + OWN);
        let (reduced, criterion) = equations.reduced().unwrap();
        near(
            &reduced.information,
            &expected.view((0, 0), (SHARED, SHARED)).into_owned(),
        );
        let gradient: DVector<f64> = expected.column(SHARED).rows(0, SHARED).into_owned();
        assert!((reduced.gradient - gradient).norm() < 1e-10);
        // Part of the residuals' sum of squares explained by the eliminated unknowns.
        let explained = expected[(SHARED, SHARED)] - square[(size, size)];
        assert!((criterion + first - determinant - explained).abs() < 1e-9);
    }

    #[test]
    fn what_is_singular_is_not_eliminated() {
        let block = Block::zeros(1, vec![0]);
        let mut equations = block.equations();
        assert_eq!(equations.eliminate(DMatrix::zeros(5, 2)), None);
        assert!(equations.reduced().is_none());
    }
}
