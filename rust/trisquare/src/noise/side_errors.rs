//! Do the samples of a side err together, and how much less is then known?
//!
//! Paper curves, ink bleeds, and no lens is exactly its polynomial: the samples of a side then
//! share an error that averaging does not remove. Every side is granted a smooth displacement
//! `sum_k a_k P_k(s)` of its image ([`crate::noise::side_basis`]), `a_k` normal with variance
//! `tau^2 / (1 + (k/2)^2)^1.5`: the spectrum of an error that is correlated over about a third of
//! the side, as the residuals of real boards have it. `tau` follows from the residuals by
//! restricted maximum likelihood (H. D. Patterson & R. Thompson, Biometrika 58 (1971) 545-554),
//! which allows for what the fitted parameters have absorbed. Marginalised over the `a_k`, the
//! normal equations keep the shape of an arrow.

use nalgebra::{DMatrix, DVector};

use super::local::Noise;
use super::side_basis::ORDERS;
use super::side_families::{Family, families_of, spectrum};
use crate::lens::Lens;
use crate::numeric::{ArrowSystem, Block, chi_square_tail};
use crate::observations::{BoardRelief, FreeParameters, ObservedPlane, TERMS, View};

/// Variances tried: from this part of what noise alone leaves of a side's mean, each so many times
/// the last, to what moves a side by pixels.
const FIRST_VARIANCE: f64 = 0.2;
const VARIANCE_RATIO: f64 = 3.0;
const VARIANCES: usize = 19;

/// Part of the first variance that counts as none where sides are to be marginalised all the same.
const NO_VARIANCE: f64 = 1e-6;

/// Probability, before the residuals are seen, that sides do not err together; the rest is spread
/// evenly over the variances tried.
const PRIOR_OF_WHITE: f64 = 0.5;

/// Twice the log likelihood that is lost where a variance is beyond all doubt too large.
const HOPELESS: f64 = 20.0;

/// How often variances of each plane's own are taken where all planes share one.
const CHANCE: f64 = 0.01;

/// The normal equations with what every side says of its displacement.
pub(crate) struct SideErrors {
    /// Under white noise.
    system: ArrowSystem,
    families: Vec<Family>,
    /// Of the boards' out-of-plane shape, by plane.
    board_reliefs: Vec<Option<BoardRelief>>,
}

/// How strongly the sides of each plane err together, all strengths weighed by how well they
/// explain the residuals.
pub(crate) struct Strength {
    /// Probability that they do at all.
    pub probability: f64,
    /// Mean of `tau^2` for every plane, px^2.
    pub mean: Vec<f64>,
}

impl Strength {
    /// Mean of `tau^2` for every plane if they do, px^2.
    pub fn if_any(&self) -> Vec<f64> {
        let probability = self.probability.max(f64::MIN_POSITIVE);
        self.mean.iter().map(|mean| mean / probability).collect()
    }
}

/// What one plane, or several, say of the shared parameters, their own eliminated.
struct Part {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Their own part of minus twice the log likelihood.
    criterion: f64,
}

impl Part {
    fn add(&mut self, other: &Self) {
        self.information += &other.information;
        self.gradient += &other.gradient;
        self.criterion += other.criterion;
    }
}

/// One strength of the side errors.
struct Hypothesis {
    variances: Vec<f64>,
    criterion: f64,
}

impl SideErrors {
    /// From what the residuals of a view sum to, `white` being the variance of their noise in units
    /// of the scale at which they are summed.
    pub fn gather<L: Lens>(
        planes: &[ObservedPlane],
        free: &FreeParameters,
        view: &View<L>,
        noise: &Noise,
        white: f64,
    ) -> Option<Self> {
        let own = |p: usize| {
            view.planes[p].parameter_count() + planes[p].board_relief.map_or(0, |_| TERMS)
        };
        let mut system = ArrowSystem::zeros(free.len(), (0..planes.len()).map(own));
        let mut families = Vec::new();
        for (p, plane) in planes.iter().enumerate() {
            let (state, block) = (&view.planes[p], &mut system.blocks[p]);
            let mut moments = noise.sides[p].iter();
            for (f, figure) in plane.figures.iter().enumerate() {
                let mut own = families_of(figure, p, block.hessian.nrows(), free);
                for (index, side) in figure.sides.iter().enumerate() {
                    let moments = moments.next()?;
                    let family = own.iter_mut().find(|family| family.sides.contains(&index));
                    if let Some(family) = family {
                        let place = (state, f, index, side);
                        family.add(
                            place,
                            plane.board_relief.as_ref(),
                            moments,
                            (&view.lens, free),
                            white,
                            block,
                        )?;
                    }
                }
                families.extend(own);
            }
            if plane.is_outlier() {
                block.hessian.fill_diagonal(1.0);
            }
        }
        Some(Self {
            system,
            families,
            board_reliefs: planes.iter().map(|plane| plane.board_relief).collect(),
        })
    }

    /// Weighs no side errors, and those of growing strength, by their restricted likelihood.
    ///
    /// One strength is common to all planes unless they clearly differ.
    pub fn strength(&self) -> Option<Strength> {
        let planes = self.system.blocks.len();
        let mut found = self.hypotheses(&vec![1.0; planes])?;
        if let Some(apart) = self.relative_variances(&found) {
            found = self.hypotheses(&apart)?;
        }
        combined(&found)
    }

    /// Whether any plane is a board that may not be flat.
    pub fn has_board_relief(&self) -> bool {
        self.board_reliefs.iter().any(Option::is_some)
    }

    /// The likeliest common variance of the sides and its criterion at a variance of the boards'
    /// relief: no larger than one given, for what the relief explains the sides do not.
    pub fn likeliest_at(&self, board_relief: f64, largest: Option<f64>) -> Option<(f64, f64)> {
        let planes = self.system.blocks.len();
        let criterion = |variance: f64| {
            let part = |plane: usize| self.part(plane, board_relief, variance);
            let parts: Option<Vec<Part>> = (0..planes).map(part).collect();
            Some((variance, self.restricted(parts?.iter())?))
        };
        let mut best = criterion(0.0)?;
        for index in 0..VARIANCES {
            let variance = self.first_variance() * VARIANCE_RATIO.powi(index as i32);
            let Some(next) = criterion(variance) else {
                break;
            };
            let beyond = largest.is_some_and(|largest| variance > largest);
            if beyond || next.1 > best.1 + HOPELESS {
                break;
            }
            if next.1 < best.1 {
                best = next;
            }
        }
        Some(best)
    }

    /// White noise, then common variances times those of the planes.
    fn hypotheses(&self, relative: &[f64]) -> Option<Vec<Hypothesis>> {
        let mut found = vec![self.hypothesis(relative, 0.0)?];
        let mut best = found[0].criterion;
        for index in 0..VARIANCES {
            let variance = self.first_variance() * VARIANCE_RATIO.powi(index as i32);
            // Rounding may leave nothing of the information where next to nothing is left.
            let Some(next) = self.hypothesis(relative, variance) else {
                break;
            };
            let criterion = next.criterion;
            if criterion > best + HOPELESS {
                break;
            }
            best = best.min(criterion);
            found.push(next);
        }
        Some(found)
    }

    fn hypothesis(&self, relative: &[f64], variance: f64) -> Option<Hypothesis> {
        let variances: Vec<f64> = relative.iter().map(|r| r * variance).collect();
        let criterion = self.criterion(&variances)?;
        Some(Hypothesis {
            variances,
            criterion,
        })
    }

    /// What displacements of unit variance on each plane alone add to the covariance of the shared
    /// parameters, as they were fitted: at weights that take the noise for white.
    pub fn unit_covariances(&self) -> Option<Vec<DMatrix<f64>>> {
        let information = self.system.reduced_information()?.cholesky()?;
        let shared = self.system.prior.nrows();
        let mut found = vec![DMatrix::zeros(shared, shared); self.system.blocks.len()];
        for family in &self.families {
            let block = &self.system.blocks[family.plane];
            let own = block.hessian.clone().cholesky()?.solve(&block.cross);
            let cross = family.shared.transpose() - own.tr_mul(&family.own.transpose());
            let influence = information.solve(&cross);
            found[family.plane] += &influence * family.covariance() * influence.transpose();
        }
        Some(found)
    }

    /// A part of the variance that noise alone leaves of a side's mean.
    fn first_variance(&self) -> f64 {
        let (mut information, mut sides) = (0.0, 0.0);
        for family in &self.families {
            for side in 0..family.sides.len() {
                information += family.gram[(side * ORDERS, side * ORDERS)];
                sides += 1.0;
            }
        }
        FIRST_VARIANCE * sides / information
    }

    /// Variances of each plane's own, if they explain the residuals clearly better.
    fn relative_variances(&self, together: &[Hypothesis]) -> Option<Vec<f64>> {
        let best = likeliest(together);
        let common = *best.variances.first().filter(|v| **v > 0.0)?;
        let mut variances = best.variances.clone();
        let mut criterion = best.criterion;
        let mut parts = self.parts(&variances)?;
        for plane in 0..variances.len() {
            let (before, after) = parts.split_at(plane);
            let others = self.joined(before.iter().chain(&after[1..]));
            for index in 0..VARIANCES {
                let variance = self.first_variance() * VARIANCE_RATIO.powi(index as i32);
                let Some(own) = self.part(plane, self.board_relief(plane), variance) else {
                    continue;
                };
                let together = self.restricted([&others, &own].into_iter());
                if let Some(found) = together.filter(|c| *c < criterion) {
                    (variances[plane], criterion) = (variance, found);
                    parts[plane] = own;
                }
            }
        }
        let gain = best.criterion - criterion;
        let freedom = (variances.len() - 1).max(1) as f64;
        let clearly = chi_square_tail(gain, freedom) < CHANCE;
        clearly.then(|| variances.iter().map(|v| v / common).collect())
    }

    /// The normal equations marginalised over displacements of the planes' variances.
    pub fn marginal(&self, variances: &[f64]) -> Option<ArrowSystem> {
        let block = |(plane, variance): (usize, &f64)| {
            Some(
                self.marginalise(plane, self.board_relief(plane), *variance)?
                    .0,
            )
        };
        let blocks: Option<Vec<Block>> = variances.iter().enumerate().map(block).collect();
        Some(ArrowSystem {
            prior: self.system.prior.clone(),
            blocks: blocks?,
        })
    }

    /// Minus twice the restricted log likelihood of the planes' variances, but for a constant.
    fn criterion(&self, variances: &[f64]) -> Option<f64> {
        self.restricted(self.parts(variances)?.iter())
    }

    fn parts(&self, variances: &[f64]) -> Option<Vec<Part>> {
        let part = |(plane, variance): (usize, &f64)| {
            self.part(plane, self.board_relief(plane), *variance)
        };
        variances.iter().enumerate().map(part).collect()
    }

    /// Takes the displacements of one plane's sides, and what is known of its relief, into its
    /// equations; returns their part of minus twice the log likelihood.
    fn marginalise(&self, plane: usize, board_relief: f64, variance: f64) -> Option<(Block, f64)> {
        let mut block = self.system.blocks[plane].clone();
        let mut criterion = 0.0;
        if let Some(own) = &self.board_reliefs[plane] {
            criterion += own.hold(board_relief, &mut block);
        }
        for family in self.families.iter().filter(|family| family.plane == plane) {
            let variance = match variance {
                0.0 if family.shifted => NO_VARIANCE * self.first_variance(),
                variance => variance,
            };
            if variance > 0.0 {
                criterion += family.marginalise(variance, &mut block)?;
            }
        }
        Some((block, criterion))
    }

    /// What one plane says of the shared parameters, and of its variances.
    fn part(&self, plane: usize, board_relief: f64, variance: f64) -> Option<Part> {
        let (block, criterion) = self.marginalise(plane, board_relief, variance)?;
        let factor = block.hessian.cholesky()?;
        let log_determinant = 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
        let solved = factor.solve(&block.gradient);
        let own = factor.solve(&block.cross);
        Some(Part {
            information: block.shared - block.cross.tr_mul(&own),
            gradient: block.shared_gradient - block.cross.tr_mul(&solved),
            criterion: criterion + log_determinant - block.gradient.dot(&solved),
        })
    }

    /// Variance of a plane's relief, where it has any.
    fn board_relief(&self, plane: usize) -> f64 {
        self.board_reliefs[plane].map_or(0.0, |board_relief| board_relief.variance)
    }

    /// Minus twice the restricted log likelihood of what all planes say together.
    fn restricted<'a>(&self, parts: impl Iterator<Item = &'a Part>) -> Option<f64> {
        let Part {
            information,
            gradient,
            mut criterion,
        } = self.joined(parts);
        let information = information + &self.system.prior;
        let factor = information.cholesky()?;
        criterion += 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
        criterion -= gradient.dot(&factor.solve(&gradient));
        criterion.is_finite().then_some(criterion)
    }

    /// What several planes say together.
    fn joined<'a>(&self, parts: impl Iterator<Item = &'a Part>) -> Part {
        let shared = self.system.prior.nrows();
        let mut all = Part {
            information: DMatrix::zeros(shared, shared),
            gradient: DVector::zeros(shared),
            criterion: 0.0,
        };
        parts.for_each(|part| all.add(part));
        all
    }
}

fn likeliest(hypotheses: &[Hypothesis]) -> &Hypothesis {
    let by_criterion = |a: &&Hypothesis, b: &&Hypothesis| a.criterion.total_cmp(&b.criterion);
    hypotheses
        .iter()
        .min_by(by_criterion)
        .unwrap_or(&hypotheses[0])
}

/// Probability and mean over all hypotheses, the first of which is white noise.
fn combined(hypotheses: &[Hypothesis]) -> Option<Strength> {
    let best = likeliest(hypotheses);
    let prior = |index: usize| match index {
        0 => PRIOR_OF_WHITE,
        _ => (1.0 - PRIOR_OF_WHITE) / VARIANCES as f64,
    };
    let weights: Vec<f64> = hypotheses
        .iter()
        .enumerate()
        .map(|(i, h)| prior(i) * (0.5 * (best.criterion - h.criterion)).exp())
        .collect();
    let total: f64 = weights.iter().sum();
    let mut mean = vec![0.0; best.variances.len()];
    for (weight, hypothesis) in weights.iter().zip(hypotheses) {
        for (mean, variance) in mean.iter_mut().zip(&hypothesis.variances) {
            *mean += weight / total * variance;
        }
    }
    Some(Strength {
        probability: 1.0 - weights[0] / total,
        mean,
    })
}

/// `tau^2` of sides displaced by a root mean square of so many px.
pub(crate) fn variance_of(displacement: f64) -> f64 {
    displacement * displacement / (0..ORDERS).map(spectrum).sum::<f64>()
}

/// Root mean square displacement of a side, px.
pub(crate) fn rms_displacement(variance: f64) -> f64 {
    (variance * (0..ORDERS).map(spectrum).sum::<f64>()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::side_basis::{basis, direction, places};
    use super::*;
    use crate::geometry::Pose;
    use crate::numeric::Loss;
    use crate::observations::{Fixed, Model, Placement, PlaneState, sort_by_plane};
    use crate::refine::residuals;
    use crate::synthetic::{Scene, SceneOptions};

    const NOISE: f64 = 0.2;

    fn scene() -> (Vec<ObservedPlane>, View<crate::lens::Brown>) {
        let truth = Scene::random(4, SceneOptions::default());
        let planes = sort_by_plane(&truth.edges(1, NOISE, 25.0)).unwrap();
        let state = |pose: &Pose| PlaneState {
            pose: *pose,
            figures: vec![Placement::IDENTITY],
        };
        let view = View {
            lens: truth.camera,
            planes: truth.poses.iter().map(state).collect(),
        };
        (planes, view)
    }

    /// All samples' Jacobian, residuals, weights, and the basis of their sides' displacements.
    fn dense(
        planes: &[ObservedPlane],
        view: &View<crate::lens::Brown>,
        free: &FreeParameters,
    ) -> (DMatrix<f64>, DVector<f64>, DVector<f64>, DMatrix<f64>) {
        let all = residuals(planes, view).unwrap();
        let count: usize = all.iter().map(Vec::len).sum();
        let sides: usize = planes.iter().map(|p| p.sides().count()).sum();
        let mut jacobian = DMatrix::zeros(count, free.len() + 6 * planes.len());
        let mut displacement = DMatrix::zeros(count, ORDERS * sides);
        let (mut residual, mut weight) = (DVector::zeros(count), DVector::zeros(count));
        let (mut row, mut index) = (0, 0);
        for (p, plane) in planes.iter().enumerate() {
            let mut own = all[p].iter();
            for side in plane.sides() {
                let state = &view.planes[p];
                let line = state.line(0, side);
                for (s, sample) in places(&side.samples, &direction(&side.samples).unwrap())
                    .iter()
                    .zip(&side.samples)
                {
                    let pixel_ray = view.lens.unproject_with_jacobian(&sample.pixel).unwrap();
                    let distance =
                        view.lens
                            .line_distance_jacobian(&pixel_ray, &line, free.columns());
                    let mut shared = vec![0.0; free.len()];
                    free.gather(&distance.wrt_lens, &mut shared);
                    for (i, value) in shared.into_iter().enumerate() {
                        jacobian[(row, i)] = value;
                    }
                    let pose = distance.wrt_line.transpose() * state.line_jacobian(0, side);
                    for i in 0..6 {
                        jacobian[(row, free.len() + 6 * p + i)] = pose[i];
                    }
                    for (k, value) in basis(*s).iter().enumerate() {
                        displacement[(row, ORDERS * index + k)] = *value;
                    }
                    residual[row] = own.next().unwrap().distance;
                    let x = residual[row] / NOISE;
                    weight[row] = Loss::Tukey.cost_and_weight(x).1 / (NOISE * NOISE);
                    row += 1;
                }
                index += 1;
            }
        }
        (jacobian, residual, weight, displacement)
    }

    #[test]
    fn marginal_equations_are_those_of_the_dense_covariance() {
        let (planes, view) = scene();
        let free = FreeParameters::new(Model::Radial2, &Fixed::default(), 1.0);
        let (jacobian, residual, weight, displacement) = dense(&planes, &view, &free);
        let all = residuals(&planes, &view).unwrap();
        let noise = Noise::of(&planes, &all, NOISE);
        let errors = SideErrors::gather(&planes, &free, &view, &noise, 1.0).unwrap();
        let criterion = |variance: f64| {
            let spread = DMatrix::from_diagonal(&DVector::from_fn(displacement.ncols(), |i, _| {
                variance * spectrum(i % ORDERS)
            }));
            let noise = DMatrix::from_diagonal(&weight.map(|w| 1.0 / w))
                + &displacement * spread * displacement.transpose();
            let factor = noise.cholesky().unwrap();
            let inverse = factor.inverse();
            let information = jacobian.tr_mul(&(&inverse * &jacobian));
            let gradient = jacobian.tr_mul(&(&inverse * &residual));
            let covariance = information.clone().cholesky().unwrap();
            let log = |l: &DMatrix<f64>| 2.0 * l.diagonal().map(f64::ln).sum();
            let criterion = log(factor.l_dirty())
                + log(covariance.l_dirty())
                + residual.dot(&(inverse * &residual))
                - gradient.dot(&covariance.solve(&gradient));
            (criterion, covariance.inverse())
        };
        let white = criterion(0.0).0 - errors.criterion(&[0.0; 3]).unwrap();
        for variance in [1e-4, 0.04, 5.0] {
            let (expected, covariance) = criterion(variance);
            let found = errors.criterion(&[variance; 3]).unwrap();
            // The Jacobian is a polynomial of the fifth degree along each side here.
            assert!((found + white - expected).abs() < 1e-3 * expected.abs().max(1.0));
            let own =
                crate::uncertainty::covariance(&errors.marginal(&[variance; 3]).unwrap(), 1.0)
                    .unwrap();
            let expected = covariance.view((0, 0), own.shape());
            for i in 0..own.nrows() {
                assert!((own[(i, i)] / expected[(i, i)] - 1.0).abs() < 1e-3);
            }
        }
    }
}
