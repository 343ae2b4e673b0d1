//! Normal equations with arrowhead structure: parameters shared by all planes, and a block of own
//! parameters per plane.
//!
//! Eliminating every plane's block (Schur complement) leaves a small system for the shared
//! parameters, so that the cost is linear in the number of planes.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Relative lower bound of a diagonal element, below which damping would have no effect on it.
const DIAGONAL_FLOOR: f64 = 1e-12;

/// Contribution of one plane to the normal equations.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    /// The shared parameters that the plane depends on, ascending; nothing is stored for the
    /// others.
    pub columns: Vec<usize>,
    /// `J_shared^T W J_shared` of the plane's residuals, by `columns`.
    pub shared: DMatrix<f64>,
    /// `J_shared^T W r`.
    pub shared_gradient: DVector<f64>,
    /// `J_p^T W J_p`.
    pub hessian: DMatrix<f64>,
    /// `J_p^T W J_shared`.
    pub cross: DMatrix<f64>,
    /// `J_p^T W r`.
    pub gradient: DVector<f64>,
    /// Coefficients of the equations that tie the planes' own parameters to each other, a column
    /// each.
    pub ties: DMatrix<f64>,
}

impl Block {
    pub fn zeros(own: usize, columns: Vec<usize>) -> Self {
        let shared = columns.len();
        Self {
            columns,
            shared: DMatrix::zeros(shared, shared),
            shared_gradient: DVector::zeros(shared),
            hessian: DMatrix::zeros(own, own),
            cross: DMatrix::zeros(own, shared),
            gradient: DVector::zeros(own),
            ties: DMatrix::zeros(own, 0),
        }
    }

    /// The block restricted to the columns for which `place` gives a new index among the shared
    /// parameters.
    fn renumbered(&self, place: impl Fn(usize) -> Option<usize>) -> Self {
        let kept = (0..self.columns.len())
            .filter_map(|index| Some((index, place(self.columns[index])?)))
            .collect::<Vec<_>>();
        let indices: Vec<usize> = kept.iter().map(|(index, _)| *index).collect();
        Self {
            columns: kept.iter().map(|(_, place)| *place).collect(),
            shared: self.shared.select_rows(&indices).select_columns(&indices),
            shared_gradient: self.shared_gradient.select_rows(&indices),
            hessian: self.hessian.clone(),
            cross: self.cross.select_columns(&indices),
            gradient: self.gradient.clone(),
            ties: self.ties.clone(),
        }
    }

    /// The block with `additional` shared parameters, without any information on them yet.
    pub fn extended(&self, additional: &[usize]) -> Self {
        let mut extended = self.clone();
        extended.columns.extend(additional);
        let count = extended.columns.len();
        extended.shared.resize_mut(count, count, 0.0);
        extended.shared_gradient.resize_vertically_mut(count, 0.0);
        extended.cross.resize_horizontally_mut(count, 0.0);
        extended
    }

    /// The part of a step of the shared parameters on which the plane depends.
    fn shared_part(&self, shared: &DVector<f64>) -> DVector<f64> {
        shared.select_rows(&self.columns)
    }

    /// The cross terms with all `shared` parameters.
    pub fn full_cross(&self, shared: usize) -> DMatrix<f64> {
        let mut full = DMatrix::zeros(self.cross.nrows(), shared);
        for (index, column) in self.columns.iter().enumerate() {
            full.set_column(*column, &self.cross.column(index));
        }
        full
    }
}

/// `J^T W J` and `J^T W r` of a problem with shared parameters and one block per plane.
#[derive(Debug, Clone)]
pub(crate) struct ArrowSystem {
    /// Information on the shared parameters from other sources than the planes.
    pub prior: DMatrix<f64>,
    /// The corresponding gradient.
    pub prior_gradient: DVector<f64>,
    pub blocks: Vec<Block>,
    /// Further shared parameters, if they were eliminated.
    pub eliminated: Option<Eliminated>,
}

/// Eliminated shared parameters: their uncertainty given the others.
#[derive(Debug, Clone)]
pub(crate) struct Eliminated {
    /// For every block, the eliminated parameters that it depends on, and its cross terms with
    /// them.
    crosses: Vec<(Vec<usize>, DMatrix<f64>)>,
    /// Factor of the information on them, given the kept parameters.
    factor: Cholesky<f64, Dyn>,
    /// Derivatives of them by the kept parameters.
    pub by_kept: DMatrix<f64>,
}

impl Eliminated {
    /// Their covariance given the kept parameters, in units of the noise.
    pub fn covariance(&self) -> DMatrix<f64> {
        self.factor.inverse()
    }

    /// Adds the contribution of a block to `derivatives`, the derivatives of some parameters by the
    /// eliminated ones. `response` is the derivatives of these parameters by the block's own
    /// gradient.
    pub fn add_derivatives(
        &self,
        derivatives: &mut DMatrix<f64>,
        block: usize,
        response: &DMatrix<f64>,
    ) {
        let (columns, cross) = &self.crosses[block];
        for (column, derivative) in columns.iter().zip((response * cross).column_iter()) {
            let mut sum = derivatives.column_mut(*column);
            sum += derivative;
        }
    }
}

/// A step of all parameters, and the predicted decrease of the linearised cost.
#[derive(Debug, Clone)]
pub(crate) struct ArrowStep {
    pub shared: DVector<f64>,
    pub blocks: Vec<DVector<f64>>,
    pub predicted_decrease: f64,
}

/// Equations of the shared parameters that a plane depends on after elimination of its own.
#[derive(Debug, Clone)]
pub(crate) struct Reduced {
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

impl Reduced {
    fn zeros(shared: usize) -> Self {
        Self {
            information: DMatrix::zeros(shared, shared),
            gradient: DVector::zeros(shared),
        }
    }

    /// Adds information on some of the parameters.
    fn add(&mut self, columns: &[usize], information: &DMatrix<f64>, gradient: &DVector<f64>) {
        for (j, &column) in columns.iter().enumerate() {
            for (i, &row) in columns.iter().enumerate() {
                self.information[(row, column)] += information[(i, j)];
            }
            self.gradient[column] += gradient[j];
        }
    }
}

impl ArrowSystem {
    /// System of planes that depend on all shared parameters.
    pub fn zeros(shared: usize, own: impl Iterator<Item = usize>) -> Self {
        Self::of(shared, own.map(|n| Block::zeros(n, (0..shared).collect())))
    }

    /// System of planes that may depend on a subset of the shared parameters.
    pub fn of(shared: usize, blocks: impl Iterator<Item = Block>) -> Self {
        Self {
            prior: DMatrix::zeros(shared, shared),
            prior_gradient: DVector::zeros(shared),
            blocks: blocks.collect(),
            eliminated: None,
        }
    }

    /// The Levenberg-Marquardt step with the diagonal raised by `damping`; `None` if singular.
    pub fn solve(&self, damping: f64) -> Option<ArrowStep> {
        let mut reduced = Reduced {
            information: self.prior.clone(),
            gradient: self.prior_gradient.clone(),
        };
        for block in &self.blocks {
            reduced.add(&block.columns, &block.shared, &block.shared_gradient);
        }
        let shared_gradient = reduced.gradient.clone();
        reduced.information = damped(&reduced.information, damping);
        let mut factors = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            let factor = Cholesky::new(damped(&block.hessian, damping))?;
            let (information, shift) = elimination_terms(block, &factor);
            reduced.add(&block.columns, &-information, &-shift);
            factors.push(factor);
        }
        let ties = self.ties(&factors);
        if let Some(ties) = &ties {
            reduced.information += ties.information();
            reduced.gradient += ties.shift(self);
        }
        let shared = -Cholesky::new(reduced.information)?.solve(&reduced.gradient);
        let multipliers = ties.map(|ties| ties.multipliers(self, &shared));
        let mut decrease = -shared_gradient.dot(&shared);
        let mut blocks = Vec::with_capacity(self.blocks.len());
        for (block, factor) in self.blocks.iter().zip(&factors) {
            let mut gradient = &block.gradient + &block.cross * block.shared_part(&shared);
            if let Some(multipliers) = &multipliers {
                gradient += &block.ties * multipliers;
            }
            let block_step = -factor.solve(&gradient);
            decrease -= block.gradient.dot(&block_step);
            blocks.push(block_step);
        }
        let step = ArrowStep {
            shared,
            blocks,
            predicted_decrease: 0.5 * decrease,
        };
        (decrease.is_finite() && step.is_finite()).then_some(step)
    }

    /// The equations with only the first `shared` of the shared parameters; the others are fixed.
    pub fn leading(&self, shared: usize) -> Self {
        self.selected(&(0..shared).collect::<Vec<_>>())
    }

    /// The equations of some of the shared parameters, ascending; the others are fixed.
    pub fn selected(&self, shared: &[usize]) -> Self {
        let place = |column: usize| shared.binary_search(&column).ok();
        Self {
            prior: self.prior.select_rows(shared).select_columns(shared),
            prior_gradient: self.prior_gradient.select_rows(shared),
            blocks: self.blocks.iter().map(|b| b.renumbered(place)).collect(),
            eliminated: None,
        }
    }

    /// Information of every plane on the shared parameters that it depends on (on all of them if
    /// planes are tied), with its own parameters eliminated. It equals the covariance of the
    /// gradient for unit noise of the plane's samples.
    pub fn contributions(&self) -> Option<Vec<Reduced>> {
        let factors = self.factors()?;
        let ties = self.ties(&factors);
        let blocks = self.blocks.iter().zip(&factors).enumerate();
        let contributions = blocks.map(|(p, (block, factor))| {
            let (information, shift) = elimination_terms(block, factor);
            let mut reduced = Reduced {
                information: &block.shared - information,
                gradient: &block.shared_gradient - shift,
            };
            if let Some(ties) = &ties {
                let mut tied = Reduced::zeros(self.prior.nrows());
                tied.add(&block.columns, &reduced.information, &reduced.gradient);
                ties.add_to(&mut tied, p, block);
                reduced = tied;
            }
            reduced
        });
        Some(contributions.collect())
    }

    /// The factors of the blocks' own equations; `None` if one is singular.
    pub fn factors(&self) -> Option<Vec<Cholesky<f64, Dyn>>> {
        let blocks = self.blocks.iter();
        blocks
            .map(|block| Cholesky::new(block.hessian.clone()))
            .collect()
    }

    /// The cross terms `C` by which the gradient of the shared parameters depends on the blocks'
    /// own gradients, as `-C^T H^-1`.
    pub fn tied_crosses(&self) -> Option<Vec<DMatrix<f64>>> {
        let blocks = self.blocks.iter();
        if self.tie_count() == 0 {
            let shared = self.prior.nrows();
            return Some(blocks.map(|block| block.full_cross(shared)).collect());
        }
        let ties = self.own_ties()?;
        Some(blocks.map(|block| ties.cross(block)).collect())
    }

    /// The information on the shared parameters, marginal over all others.
    pub fn reduced_information(&self) -> Option<DMatrix<f64>> {
        let mut total = Reduced {
            information: self.prior.clone(),
            gradient: self.prior_gradient.clone(),
        };
        let all: Vec<usize> = (0..self.prior.nrows()).collect();
        for (block, contribution) in self.blocks.iter().zip(self.contributions()?) {
            let columns = match self.tie_count() {
                0 => &block.columns,
                _ => &all,
            };
            total.add(columns, &contribution.information, &contribution.gradient);
        }
        Some(total.information)
    }

    /// The equations with the shared parameters after the first `kept` eliminated: the loss of
    /// information is subtracted from the prior, so that the reduced information is the marginal
    /// one.
    pub fn marginal(&self, kept: usize) -> Option<Self> {
        if kept == self.prior.nrows() {
            return Some(self.clone());
        }
        let full = self.reduced_information()?;
        let further = full.nrows() - kept;
        let cross = full.view((kept, 0), (further, kept)).into_owned();
        let square = full.view((kept, kept), (further, further)).into_owned();
        let factor = square.cholesky()?;
        let by_kept = -factor.solve(&cross);
        let mut system = self.leading(kept);
        system.prior += cross.tr_mul(&by_kept);
        let place = |column: usize| column.checked_sub(kept);
        let crosses = self.blocks.iter().map(|block| {
            let further = block.renumbered(place);
            (further.columns, further.cross)
        });
        system.eliminated = Some(Eliminated {
            crosses: crosses.collect(),
            factor,
            by_kept,
        });
        Some(system)
    }
}

impl ArrowSystem {
    /// Additional decrease of the linearised cost if the last `count` shared parameters are free as
    /// well: half of their score statistic (C. R. Rao, Math. Proc. Camb. Philos. Soc. 44 (1948)
    /// 50-57), in units of the noise.
    pub fn freeing_gain(&self, count: usize) -> Option<f64> {
        let with_all = self.solve(0.0)?.predicted_decrease;
        let with_leading = self.leading(self.prior.nrows() - count).solve(0.0)?;
        Some(with_all - with_leading.predicted_decrease)
    }
}

impl ArrowStep {
    /// The step to the minimum of a cost whose curvature is `1 / factor` of the normal equations'.
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            shared: self.shared * factor,
            blocks: self
                .blocks
                .into_iter()
                .map(|block| block * factor)
                .collect(),
            predicted_decrease: self.predicted_decrease * factor,
        }
    }

    pub fn parameter_count(&self) -> usize {
        self.shared.len() + self.blocks.iter().map(|block| block.len()).sum::<usize>()
    }

    fn is_finite(&self) -> bool {
        self.shared.iter().all(|v| v.is_finite())
            && self.blocks.iter().all(|b| b.iter().all(|v| v.is_finite()))
    }
}

fn damped(hessian: &DMatrix<f64>, damping: f64) -> DMatrix<f64> {
    let mut raised = hessian.clone();
    let floor = DIAGONAL_FLOOR * raised.diagonal().amax();
    for i in 0..raised.nrows() {
        raised[(i, i)] += damping * raised[(i, i)].max(floor);
    }
    raised
}

/// `C^T H^-1 C` and `C^T H^-1 g` of one block.
fn elimination_terms(block: &Block, factor: &Cholesky<f64, Dyn>) -> (DMatrix<f64>, DVector<f64>) {
    let lower_factor = factor.l_dirty();
    // With H = L L^T, both are products of L^-1 C; the first one is then exactly symmetric.
    let mut cross = block.cross.clone();
    let mut gradient = block.gradient.clone();
    lower_factor.solve_lower_triangular_unchecked_mut(&mut cross);
    lower_factor.solve_lower_triangular_unchecked_mut(&mut gradient);
    (cross.tr_mul(&cross), cross.tr_mul(&gradient))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A random-looking Jacobian with two planes of three parameters and two shared ones.
    fn dense_and_arrow() -> (DMatrix<f64>, DVector<f64>, ArrowSystem) {
        let mut jacobian = DMatrix::zeros(40, 8);
        let residual = DVector::from_fn(40, |i, _| ((i * 7 % 11) as f64 - 5.0) * 0.1);
        let mut arrow = ArrowSystem::zeros(2, [3, 3].into_iter());
        for i in 0..40 {
            let plane = i % 2;
            for j in 0..8 {
                let mine = j < 2 || (j - 2) / 3 == plane;
                jacobian[(i, j)] = if mine {
                    ((i * 13 + 7) as f64 * (j as f64 + 1.3)).sin()
                } else {
                    0.0
                };
            }
            let row = jacobian.row(i).transpose();
            let shared = row.rows(0, 2).into_owned();
            let own = row.rows(2 + 3 * plane, 3).into_owned();
            let block = &mut arrow.blocks[plane];
            block.shared += &shared * shared.transpose();
            block.shared_gradient += &shared * residual[i];
            block.hessian += &own * own.transpose();
            block.cross += &own * shared.transpose();
            block.gradient += &own * residual[i];
        }
        (jacobian, residual, arrow)
    }

    #[test]
    fn arrow_step_is_the_dense_gauss_newton_step() {
        let (jacobian, residual, arrow) = dense_and_arrow();
        let hessian = jacobian.tr_mul(&jacobian);
        let expected = -hessian
            .cholesky()
            .unwrap()
            .solve(&jacobian.tr_mul(&residual));
        let step = arrow.solve(0.0).unwrap();
        assert!((step.shared - expected.rows(0, 2)).norm() < 1e-12);
        assert!((&step.blocks[1] - expected.rows(5, 3)).norm() < 1e-12);
        let after = (&jacobian * &expected + &residual).norm_squared();
        let decrease = 0.5 * (residual.norm_squared() - after);
        assert!((step.predicted_decrease - decrease).abs() < 1e-12);
    }

    #[test]
    fn what_was_eliminated_leaves_a_block_as_open_as_the_dense_covariance_says() {
        let (jacobian, _, arrow) = dense_and_arrow();
        // Given the first shared parameter, with the second one unknown.
        let hessian = jacobian.tr_mul(&jacobian);
        let dense = hessian.view((1, 1), (7, 7)).into_owned();
        let covariance = dense.try_inverse().unwrap();
        let follows = -(&covariance * hessian.view((1, 0), (7, 1)));

        let system = arrow.marginal(1).unwrap();
        let eliminated = system.eliminated.as_ref().unwrap();
        let block = &system.blocks[1];
        let inverse = block.hessian.clone().try_inverse().unwrap();
        let mut moves = DMatrix::zeros(3, 1);
        eliminated.add_derivatives(&mut moves, 1, &-&inverse);
        let own = &inverse + &moves * eliminated.covariance() * moves.transpose();
        assert!((own - covariance.view((4, 4), (3, 3))).norm() < 1e-12);
        let followed = -(&inverse * &block.cross) + &moves * &eliminated.by_kept;
        assert!((followed - follows.rows(4, 3)).norm() < 1e-12);
    }

    #[test]
    fn reduced_information_is_the_inverse_of_the_dense_covariance() {
        let (jacobian, _, arrow) = dense_and_arrow();
        let covariance = jacobian.tr_mul(&jacobian).try_inverse().unwrap();
        let reduced = arrow.reduced_information().unwrap().try_inverse().unwrap();
        assert!((reduced - covariance.view((0, 0), (2, 2))).norm() < 1e-12);
    }

    #[test]
    fn planes_that_depend_on_a_part_are_as_planes_that_do_not_vary_with_the_rest() {
        let (mut whole, mut part) = (
            ArrowSystem::zeros(4, [3, 2].into_iter()),
            ArrowSystem::of(
                4,
                [(3, vec![0, 2]), (2, vec![0, 1, 3])]
                    .map(|(own, columns)| Block::zeros(own, columns))
                    .into_iter(),
            ),
        );
        for system in [&mut whole, &mut part] {
            system.prior.fill_diagonal(0.1);
        }
        for k in 0..2 {
            let (columns, own) = (
                part.blocks[k].columns.clone(),
                part.blocks[k].hessian.nrows(),
            );
            let rows = DMatrix::from_fn(20, columns.len() + own + 1, |i, j| {
                ((i * 13 + 7 * k + 3) as f64 * (j as f64 + 1.3)).sin()
            });
            let (shared, own) = (
                rows.columns(0, columns.len()),
                rows.columns(columns.len(), own),
            );
            let mut all = DMatrix::zeros(20, 4);
            for (own, column) in columns.iter().enumerate() {
                all.set_column(*column, &shared.column(own));
            }
            let residual = rows.column(rows.ncols() - 1);
            for (block, shared) in [
                (&mut part.blocks[k], shared.into_owned()),
                (&mut whole.blocks[k], all),
            ] {
                block.shared = shared.tr_mul(&shared);
                block.shared_gradient = shared.tr_mul(&residual);
                block.hessian = own.tr_mul(&own);
                block.cross = own.tr_mul(&shared);
                block.gradient = own.tr_mul(&residual);
            }
        }
        let [one, other] = [&part, &whole].map(|system| system.solve(0.0).unwrap());
        assert!((one.shared - other.shared).norm() < 1e-12);
        assert!((&one.blocks[1] - &other.blocks[1]).norm() < 1e-12);
        let [one, other] = [&part, &whole].map(|system| {
            let kept = system.selected(&[0, 1, 3]);
            let further = kept.blocks.iter().map(|block| block.extended(&[3]));
            let mut extended = ArrowSystem::of(4, further);
            extended.prior.fill_diagonal(1.0);
            let marginal = system.marginal(2).unwrap();
            [system, &kept, &extended, &marginal].map(|s| s.reduced_information().unwrap())
        });
        for (one, other) in one.iter().zip(&other) {
            assert!((one - other).norm() < 1e-12);
        }
    }

    #[test]
    fn the_marginal_information_is_that_of_the_whole_covariance() {
        let mut system = ArrowSystem::zeros(4, [3, 2].into_iter());
        for (k, block) in system.blocks.iter_mut().enumerate() {
            let own = block.hessian.nrows();
            let rows = DMatrix::from_fn(20, 4 + own, |i, j| {
                ((i * 13 + 7 * k + 3) as f64 * (j as f64 + 1.3)).sin()
            });
            let square = rows.tr_mul(&rows);
            block.shared = square.view((0, 0), (4, 4)).into_owned();
            block.hessian = square.view((4, 4), (own, own)).into_owned();
            block.cross = square.view((4, 0), (own, 4)).into_owned();
        }
        let whole = system.reduced_information().unwrap().try_inverse().unwrap();
        let marginal = system.marginal(3).unwrap().reduced_information().unwrap();
        let covariance = marginal.try_inverse().unwrap();
        assert!((covariance - whole.view((0, 0), (3, 3))).norm() < 1e-12);
    }
}
