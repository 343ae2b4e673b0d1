//! Variances of side errors by restricted maximum likelihood (H. D. Patterson & R. Thompson,
//! Biometrika 58 (1971) 545-554).

use nalgebra::{DMatrix, DVector};

use super::side_errors::SideErrors;
use crate::numeric::{BlockEquations, Reduced, chi_square_tail};
use crate::observations::DeformationPrior;

/// Ratio of successive variances tried, and their number: up to errors of pixels.
const VARIANCE_RATIO: f64 = 3.0;
const VARIANCES: usize = 19;

/// Prior probability of no common errors along sides; the rest is spread evenly over the variances
/// tried.
const WHITE_NOISE_PRIOR: f64 = 0.5;

/// Loss of twice the log likelihood above which a variance is certainly too large.
pub(super) const HOPELESS: f64 = 20.0;

/// Significance level for separate variances per plane: the probability of choosing them if all
/// planes share one.
const CHANCE: f64 = 0.01;

/// Strength of the common errors along the sides of each plane, averaged over all strengths with
/// weights by their likelihood.
pub(crate) struct Strength {
    /// Probability that there are any.
    pub probability: f64,
    /// Mean of `tau^2` for every plane, px^2.
    pub mean: Vec<f64>,
}

impl Strength {
    /// Mean of `tau^2` for every plane, given that there are any, px^2.
    pub fn mean_if_any(&self) -> Vec<f64> {
        let probability = self.probability.max(f64::MIN_POSITIVE);
        self.mean.iter().map(|mean| mean / probability).collect()
    }
}

/// Information of one or several planes on the shared parameters, followed by the multipliers that
/// tie planes; their own parameters are eliminated.
#[derive(Clone)]
struct Part {
    reduced: Reduced,
    /// Their contribution to minus twice the log likelihood.
    criterion: f64,
}

impl Part {
    /// Adds another, multiplied by `times`.
    fn add(&mut self, other: &Self, factor: f64) {
        let (reduced, other_reduced) = (&mut self.reduced, &other.reduced);
        let add = |sum: &mut f64, value: f64| *sum += factor * value;
        reduced
            .information
            .zip_apply(&other_reduced.information, add);
        reduced.gradient.zip_apply(&other_reduced.gradient, add);
        self.criterion += other.criterion * factor;
    }
}

/// Assumptions besides the sides' errors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Assumption<'a> {
    /// Prior of the targets' deformations.
    pub deformation: DeformationPrior,
    /// Standard deviations of the picture's fields, if there are any.
    pub fields: &'a [f64],
}

/// One strength of the side errors.
struct Hypothesis {
    variances: Vec<f64>,
    /// Part of each plane at its variance.
    parts: Vec<Part>,
    criterion: f64,
}

impl SideErrors {
    /// Weights hypotheses of no side errors, and of errors of increasing strength, by their
    /// restricted likelihood.
    ///
    /// All planes share one strength unless they clearly differ.
    pub fn strength(&self) -> Option<Strength> {
        let planes = self.system.blocks.len();
        let mut found = self.hypotheses(&vec![1.0; planes])?;
        if let Some(relative) = self.relative_variances(&found) {
            found = self.hypotheses(&relative)?;
        }
        combined(&found)
    }

    /// The likeliest variances of the sides, separate per plane if they clearly differ, and minus
    /// twice their restricted log likelihood. `common` is the likeliest common variance and its
    /// criterion.
    pub fn likeliest(&self, common: (f64, f64)) -> Option<(Vec<f64>, f64)> {
        let planes = self.system.blocks.len();
        let (variance, criterion) = common;
        let mut found = (vec![variance; planes], criterion);
        if variance > 0.0 {
            let common_hypotheses = self.hypotheses(&vec![1.0; planes])?;
            if let Some(relative) = self.relative_variances(&common_hypotheses) {
                let separate_hypotheses = self.hypotheses(&relative)?;
                let best = likeliest(&separate_hypotheses);
                if best.criterion < criterion {
                    found = (best.variances.clone(), best.criterion);
                }
            }
        }
        Some(found)
    }

    /// The likeliest common variance of the sides and its criterion for every assumption, in their
    /// order. The variance is at most `largest`, if given, since a deformation reduces the sides'
    /// errors. Computations common to several assumptions are done once.
    pub fn likeliest_under(
        &mut self,
        assumptions: &[Assumption<'_>],
        largest: Option<f64>,
    ) -> Vec<Option<(f64, f64)>> {
        let mut best = vec![None; assumptions.len()];
        let mut open = vec![true; assumptions.len()];
        for variance in std::iter::once(0.0).chain(self.variances()) {
            if largest.is_some_and(|largest| variance > largest) || !open.contains(&true) {
                break;
            }
            let open_indices = (0..assumptions.len()).filter(|i| open[*i]);
            let open_indices: Vec<usize> = open_indices.collect();
            let prior = |index: usize| assumptions[index].deformation;
            let groups = || open_indices.chunk_by(|a, b| prior(*a) == prior(*b));
            let priors: Vec<DeformationPrior> = groups().map(|group| prior(group[0])).collect();
            for (group, all) in groups().zip(self.sums(&priors, variance)) {
                for &i in group {
                    self.set_field_priors(assumptions[i].fields);
                    let criterion = all.clone().and_then(|all| self.restricted(all));
                    let lowest = best[i].map_or(f64::INFINITY, |(_, lowest)| lowest);
                    match criterion {
                        Some(found) if found < lowest => best[i] = Some((variance, found)),
                        // With a deformation that explains a part there are two optima: one of
                        // the sides' errors, one of the deformation.
                        Some(found) => open[i] = largest.is_some() || found <= lowest + HOPELESS,
                        None => open[i] = false,
                    }
                }
            }
        }
        best
    }

    /// Sum of all planes' parts at a common variance of their sides, for each prior of their
    /// deformation.
    fn sums(&self, priors: &[DeformationPrior], variance: f64) -> Vec<Option<Part>> {
        let mut sums = vec![Some(self.empty_part()); priors.len()];
        for plane in 0..self.system.blocks.len() {
            let unfinished = self.before_deformation(plane, variance);
            for (prior, all) in priors.iter().zip(&mut sums) {
                let part = unfinished
                    .clone()
                    .and_then(|part| self.finished(plane, *prior, part));
                match (&mut *all, part) {
                    (Some(all), Some(part)) => all.add(&part, 1.0),
                    _ => *all = None,
                }
            }
        }
        sums
    }

    /// Hypotheses of white noise, then of common variances times the relative ones of the planes.
    fn hypotheses(&self, relative: &[f64]) -> Option<Vec<Hypothesis>> {
        let mut found = vec![self.hypothesis(relative, 0.0)?];
        let mut best = found[0].criterion;
        for variance in self.variances() {
            // Rounding may leave no information if next to none is left.
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
        let parts = self.parts(&variances)?;
        Some(Hypothesis {
            criterion: self.restricted(self.joined(&parts))?,
            variances,
            parts,
        })
    }

    /// Separate variances of the planes, relative to the common one, if they explain the residuals
    /// clearly better; `common_hypotheses` are the common ones already tried.
    fn relative_variances(&self, common_hypotheses: &[Hypothesis]) -> Option<Vec<f64>> {
        let best = likeliest(common_hypotheses);
        let common = *best.variances.first().filter(|v| **v > 0.0)?;
        let mut variances = best.variances.clone();
        let mut criterion = best.criterion;
        let mut parts = best.parts.clone();
        let mut all = self.joined(&parts);
        for plane in 0..variances.len() {
            let mut others = all.clone();
            others.add(&parts[plane], -1.0);
            let mut lowest = criterion;
            for (index, variance) in self.variances().enumerate() {
                // The first hypothesis is white noise.
                let tried = common_hypotheses
                    .get(index + 1)
                    .map(|tried| tried.parts[plane].clone());
                let computed = || self.part(plane, self.deformation_prior(plane), variance);
                let Some(plane_part) = tried.or_else(computed) else {
                    continue;
                };
                let mut joint = others.clone();
                joint.add(&plane_part, 1.0);
                let Some(found) = self.restricted(joint.clone()) else {
                    continue;
                };
                if found > lowest + HOPELESS {
                    break;
                }
                lowest = lowest.min(found);
                if found < criterion {
                    (variances[plane], criterion) = (variance, found);
                    (parts[plane], all) = (plane_part, joint);
                }
            }
        }
        let gain = best.criterion - criterion;
        let freedom = (variances.len() - 1).max(1) as f64;
        let is_clear = chi_square_tail(gain, freedom) < CHANCE;
        is_clear.then(|| variances.iter().map(|v| v / common).collect())
    }

    /// Minus twice the restricted log likelihood of the planes' variances, up to a constant.
    #[cfg(test)]
    pub(super) fn criterion(&self, variances: &[f64]) -> Option<f64> {
        self.restricted(self.joined(&self.parts(variances)?))
    }

    fn parts(&self, variances: &[f64]) -> Option<Vec<Part>> {
        let part = |(plane, variance): (usize, &f64)| {
            self.part(plane, self.deformation_prior(plane), *variance)
        };
        variances.iter().enumerate().map(part).collect()
    }

    /// Information of one plane on the shared parameters, and its criterion.
    fn part(&self, plane: usize, deformation: DeformationPrior, variance: f64) -> Option<Part> {
        let unfinished = self.before_deformation(plane, variance)?;
        self.finished(plane, deformation, unfinished)
    }

    /// `part` from the plane's equations without its deformation.
    fn finished(
        &self,
        plane: usize,
        deformation: DeformationPrior,
        (mut equations, criterion): (BlockEquations, f64),
    ) -> Option<Part> {
        let deformation_criterion = self.add_deformation_prior(plane, deformation, &mut equations);
        let (reduced, plane_criterion) = equations.reduced()?;
        Some(Part {
            reduced,
            criterion: criterion + deformation_criterion + plane_criterion,
        })
    }

    /// The variances tried.
    fn variances(&self) -> impl Iterator<Item = f64> + use<> {
        let first = self.first_variance;
        (0..VARIANCES).map(move |index| first * VARIANCE_RATIO.powi(index as i32))
    }

    /// Minus twice the restricted log likelihood of all planes together.
    fn restricted(&self, all: Part) -> Option<f64> {
        let Part {
            reduced,
            mut criterion,
        } = all;
        let (reduced, tie_criterion) = reduced.without_multipliers(self.system.tie_count());
        criterion += tie_criterion;
        let information = reduced.information + &self.system.prior;
        let gradient = reduced.gradient + &self.system.prior_gradient;
        let factor = information.cholesky()?;
        criterion += 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
        criterion -= gradient.dot(&factor.solve(&gradient));
        criterion.is_finite().then_some(criterion)
    }

    /// Sum of several planes' parts.
    fn joined(&self, parts: &[Part]) -> Part {
        let mut all = self.empty_part();
        parts.iter().for_each(|part| all.add(part, 1.0));
        all
    }

    /// Part without information.
    fn empty_part(&self) -> Part {
        let size = self.system.prior.nrows() + self.system.tie_count();
        Part {
            reduced: Reduced {
                information: DMatrix::zeros(size, size),
                gradient: DVector::zeros(size),
            },
            criterion: 0.0,
        }
    }
}

fn likeliest(hypotheses: &[Hypothesis]) -> &Hypothesis {
    let by_criterion = |a: &&Hypothesis, b: &&Hypothesis| a.criterion.total_cmp(&b.criterion);
    hypotheses
        .iter()
        .min_by(by_criterion)
        .unwrap_or(&hypotheses[0])
}

/// Averages over all hypotheses, the first of which is white noise.
fn combined(hypotheses: &[Hypothesis]) -> Option<Strength> {
    let best = likeliest(hypotheses);
    let prior = |index: usize| match index {
        0 => WHITE_NOISE_PRIOR,
        _ => (1.0 - WHITE_NOISE_PRIOR) / VARIANCES as f64,
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
        // Not one minus the rest, which rounding may make 0 although the mean is not.
        probability: weights[1..].iter().sum::<f64>() / total,
        mean,
    })
}
