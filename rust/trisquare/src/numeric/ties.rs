//! Linear equations that tie the blocks of an arrowhead system to each other, satisfied exactly.
//!
//! With multipliers `m`, the equations of block `p` are `H y + C s + T m = -g`, and those of the
//! ties `sum T^T y = 0`. Eliminating the blocks leaves `D s + M m = -sum T^T H^-1 g`, with
//! `D = sum T^T H^-1 C` and `M = sum T^T H^-1 T`: the multipliers are a function of the shared
//! parameters, whose equations keep the same structure as without ties.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

use super::arrowhead::{ArrowSystem, Block, Reduced};

/// Ratio to the largest eigenvalue below which an eigenvalue belongs to a redundant tie.
const RANK_TOLERANCE: f64 = 1e-10;

/// The ties after elimination of every block.
pub(crate) struct Ties {
    /// `H^-1 T` of every block.
    pub responses: Vec<DMatrix<f64>>,
    /// `M^+`: a pseudo-inverse, as ties may be redundant.
    pub inverse: DMatrix<f64>,
    /// `D`.
    cross: DMatrix<f64>,
    /// `M^+ D`.
    pub by_shared: DMatrix<f64>,
}

impl ArrowSystem {
    /// Number of equations that tie the blocks.
    pub fn tie_count(&self) -> usize {
        self.blocks.first().map_or(0, |block| block.ties.ncols())
    }

    /// The ties after elimination of the blocks; `None` if there are none, or if a block is
    /// singular.
    pub fn own_ties(&self) -> Option<Ties> {
        if self.tie_count() == 0 {
            return None;
        }
        let factors = self.factors()?;
        self.ties(&factors)
    }

    /// The ties after elimination of the blocks, given the factors of every block's own equations;
    /// `None` if there are none.
    pub fn ties(&self, factors: &[Cholesky<f64, Dyn>]) -> Option<Ties> {
        let count = self.tie_count();
        if count == 0 {
            return None;
        }
        let blocks = self.blocks.iter().zip(factors);
        let responses = blocks.map(|(block, factor)| factor.solve(&block.ties));
        let responses: Vec<_> = responses.collect();
        let mut square = DMatrix::zeros(count, count);
        let mut cross = DMatrix::zeros(count, self.prior.nrows());
        for (block, response) in self.blocks.iter().zip(&responses) {
            square.gemm_tr(1.0, &block.ties, response, 1.0);
            cross.gemm_tr(1.0, response, &block.full_cross(self.prior.nrows()), 1.0);
        }
        let (inverse, _) = pseudo_inverse(square);
        Some(Ties {
            by_shared: &inverse * &cross,
            cross,
            inverse,
            responses,
        })
    }
}

impl Ties {
    /// The multipliers at a step of the shared parameters, for the blocks' own gradients.
    pub fn multipliers(&self, system: &ArrowSystem, shared: &DVector<f64>) -> DVector<f64> {
        -(&self.inverse * self.gradient(system) + &self.by_shared * shared)
    }

    /// Contribution of the blocks' own gradients to that of the shared parameters.
    pub fn shift(&self, system: &ArrowSystem) -> DVector<f64> {
        self.by_shared.tr_mul(&self.gradient(system))
    }

    /// A block's cross terms `C` by which the gradient of the shared parameters depends on its own
    /// gradient, as `-C^T H^-1`.
    pub fn cross(&self, block: &Block) -> DMatrix<f64> {
        block.full_cross(self.by_shared.ncols()) - &block.ties * &self.by_shared
    }

    /// Reduction of the inverse of the blocks' own equations by the ties, between two of the
    /// blocks.
    pub fn reduction_between(&self, first: usize, second: usize) -> DMatrix<f64> {
        &self.responses[first] * &self.inverse * self.responses[second].transpose()
    }

    /// Information of the ties on the shared parameters, `D^T M^+ D`.
    pub fn information(&self) -> DMatrix<f64> {
        self.by_shared.tr_mul(&self.cross)
    }

    /// Adds the information of one block on the shared parameters through the ties.
    pub fn add_to(&self, reduced: &mut Reduced, index: usize, block: &Block) {
        let response = &self.responses[index];
        let tie_information = block.ties.tr_mul(response);
        reduced.information += self.by_shared.tr_mul(&(tie_information * &self.by_shared));
        reduced.gradient += self.by_shared.tr_mul(&response.tr_mul(&block.gradient));
    }

    /// `sum T^T H^-1 g`.
    fn gradient(&self, system: &ArrowSystem) -> DVector<f64> {
        let blocks = system.blocks.iter().zip(&self.responses);
        blocks
            .map(|(block, response)| response.tr_mul(&block.gradient))
            .sum()
    }
}

impl Reduced {
    /// The equations with the last `count` parameters, the multipliers, eliminated; and the
    /// contribution of these to minus twice the restricted log likelihood.
    pub fn without_multipliers(self, count: usize) -> (Self, f64) {
        if count == 0 {
            return (self, 0.0);
        }
        let kept = self.gradient.len() - count;
        let square = -self.information.view((kept, kept), (count, count));
        let cross = -self.information.view((kept, 0), (count, kept));
        let gradient = -self.gradient.rows(kept, count);
        let (inverse, log_determinant) = pseudo_inverse(square);
        let criterion = log_determinant + gradient.dot(&(&inverse * &gradient));
        let by_shared = inverse * &cross;
        let reduced = Self {
            information: self.information.view((0, 0), (kept, kept)) + cross.tr_mul(&by_shared),
            gradient: self.gradient.rows(0, kept) + by_shared.tr_mul(&gradient),
        };
        (reduced, criterion)
    }
}

/// Pseudo-inverse of a symmetric positive semidefinite matrix, and the logarithm of the determinant
/// of the inverted part.
pub(crate) fn pseudo_inverse(square: DMatrix<f64>) -> (DMatrix<f64>, f64) {
    let eigen = SymmetricEigen::new(square);
    let limit = RANK_TOLERANCE * eigen.eigenvalues.amax();
    let is_regular = |value: &f64| *value > limit;
    let inverse = eigen
        .eigenvalues
        .map(|value| if is_regular(&value) { 1.0 / value } else { 0.0 });
    let vectors = &eigen.eigenvectors;
    let regular_values = eigen.eigenvalues.iter().filter(|value| is_regular(value));
    (
        vectors * DMatrix::from_diagonal(&inverse) * vectors.transpose(),
        regular_values.map(|value| value.ln()).sum(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHARED: usize = 2;
    const OWN: usize = 3;
    const BLOCKS: usize = 2;

    /// An arrowhead system with ties, the second of which is redundant; its dense Hessian and
    /// gradient; and the directions not fixed by the ties, as columns.
    fn example() -> (ArrowSystem, DMatrix<f64>, DVector<f64>, DMatrix<f64>) {
        let size = SHARED + OWN * BLOCKS;
        let mut system = ArrowSystem::zeros(SHARED, [OWN; BLOCKS].into_iter());
        let mut hessian = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        let mut ties = DMatrix::zeros(size, 2);
        for (p, block) in system.blocks.iter_mut().enumerate() {
            let jacobian = DMatrix::from_fn(20, SHARED + OWN, |i, j| {
                ((i * 13 + 5 * p + 7) as f64 * (j as f64 + 1.3)).sin()
            });
            let residual = DVector::from_fn(20, |i, _| ((i * 7 + p) % 11) as f64 - 5.0);
            let (square, product) = (jacobian.tr_mul(&jacobian), jacobian.tr_mul(&residual));
            block.shared = square.view((0, 0), (SHARED, SHARED)).into_owned();
            block.hessian = square.view((SHARED, SHARED), (OWN, OWN)).into_owned();
            block.cross = square.view((SHARED, 0), (OWN, SHARED)).into_owned();
            block.shared_gradient = product.rows(0, SHARED).into_owned();
            block.gradient = product.rows(SHARED, OWN).into_owned();
            let tie = DVector::from_fn(OWN, |i, _| (i as f64 + 2.0 * p as f64).cos());
            block.ties = DMatrix::from_columns(&[tie.clone(), tie.clone() * 2.0]);
            let own: Vec<usize> = (0..OWN).map(|i| SHARED + OWN * p + i).collect();
            let places: Vec<usize> = (0..SHARED).chain(own.iter().copied()).collect();
            for (i, row) in places.iter().enumerate() {
                gradient[*row] += product[i];
                for (j, column) in places.iter().enumerate() {
                    hessian[(*row, *column)] += square[(i, j)];
                }
            }
            for (i, row) in own.iter().enumerate() {
                ties.set_row(*row, &block.ties.row(i));
            }
        }
        let held = &ties * ties.transpose();
        let eigen = SymmetricEigen::new(held);
        let left = (0..size).filter(|i| eigen.eigenvalues[*i] < 1e-9);
        let left: Vec<_> = left
            .map(|i| eigen.eigenvectors.column(i).into_owned())
            .collect();
        (system, hessian, gradient, DMatrix::from_columns(&left))
    }

    /// The dense covariance of all parameters under the ties.
    fn covariance(hessian: &DMatrix<f64>, left: &DMatrix<f64>) -> DMatrix<f64> {
        let inverse = (left.transpose() * hessian * left).try_inverse().unwrap();
        left * inverse * left.transpose()
    }

    #[test]
    fn the_step_is_the_dense_one_in_the_directions_that_ties_leave() {
        let (system, hessian, gradient, left) = example();
        let expected = -covariance(&hessian, &left) * &gradient;
        let step = system.solve(0.0).unwrap();
        assert!((step.shared - expected.rows(0, SHARED)).norm() < 1e-11);
        assert!((&step.blocks[1] - expected.rows(SHARED + OWN, OWN)).norm() < 1e-11);
        assert!((step.predicted_decrease + 0.5 * gradient.dot(&expected)).abs() < 1e-11);
    }

    #[test]
    fn information_and_responses_are_those_of_the_dense_covariance() {
        let (system, hessian, _, left) = example();
        let expected = covariance(&hessian, &left);
        let shared = system.reduced_information().unwrap().try_inverse().unwrap();
        assert!((&shared - expected.view((0, 0), (SHARED, SHARED))).norm() < 1e-12);
        // Covariance of a block's own parameters: given the shared ones, plus the part that follows
        // these.
        let ties = system.own_ties().unwrap();
        let inverse = system.blocks[1].hessian.clone().try_inverse().unwrap();
        let given = &inverse - ties.reduction_between(1, 1);
        let follow = -inverse * &system.tied_crosses().unwrap()[1];
        let all = given + &follow * shared * follow.transpose();
        let first = SHARED + OWN;
        assert!((all - expected.view((first, first), (OWN, OWN))).norm() < 1e-12);
    }

    #[test]
    fn multipliers_among_the_shared_parameters_tell_the_same() {
        let (system, hessian, gradient, left) = example();
        let all = SHARED + system.tie_count();
        let mut sum = Reduced {
            information: DMatrix::zeros(all, all),
            gradient: DVector::zeros(all),
        };
        let mut own = 0.0;
        for block in &system.blocks {
            let (reduced, criterion) = block.equations().reduced().unwrap();
            sum.information += reduced.information;
            sum.gradient += reduced.gradient;
            own += criterion;
        }
        let (reduced, of_ties) = sum.without_multipliers(system.tie_count());
        let expected = system.reduced_information().unwrap();
        assert!((&reduced.information - &expected).norm() < 1e-10 * expected.norm());
        // Minus twice the log likelihood, up to the scale of the ties: the same for two gradients.
        let inverse = expected.clone().try_inverse().unwrap();
        let found = of_ties + own + expected.determinant().ln()
            - reduced.gradient.dot(&(inverse * &reduced.gradient));
        let dense = covariance(&hessian, &left);
        let kept = (left.transpose() * &hessian * &left).determinant().ln();
        let square: f64 = system.blocks.iter().map(|b| b.ties.norm_squared()).sum();
        let asked = kept + square.ln() - gradient.dot(&(dense * &gradient));
        assert!(
            (found - asked).abs() < 1e-9 * asked.abs(),
            "{found} {asked}"
        );
    }
}
