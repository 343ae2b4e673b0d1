//! Classification of lines as straight or curved, and estimation of the straight ones' bend.
//!
//! Real edges bend a little, and some apparent lines are cables or arches. A straight line's smooth
//! displacement has the variance `tau^2`; that of a curved one is larger, and gives no information
//! on the lens. The classes and `tau` are estimated by restricted likelihood (H. D. Patterson & R.
//! Thompson, Biometrika 58 (1971) 545-554) of all lines together with the planes' information on
//! the lens.

use nalgebra::{DMatrix, DVector};

use super::observed_line::{LinePart, SmoothLine};
use crate::noise::displacement_variance;

/// Root mean square bends (px) tried for straight lines, in descending order.
const BENDS: [f64; 10] = [0.3, 0.17, 0.1, 0.06, 0.03, 0.017, 0.01, 0.006, 0.003, 0.0];

/// Prior probability that straight lines do not bend at all.
const NO_BEND_PRIOR: f64 = 0.5;

/// Root mean square bend (px) of curved lines; larger bends carry no information.
const CURVED: f64 = 0.3;

/// Minus twice the logarithm of the prior odds of a curved line: one in ten.
const CURVED_PENALTY: f64 = 4.4;

/// Joint information of lines and planes on the free parameters.
pub(super) struct Mixture {
    pub is_straight: Vec<bool>,
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// Sums over the straight lines and the planes' information.
#[derive(Clone)]
struct Sums {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    rest: f64,
}

impl Sums {
    fn with(&self, part: &LinePart, sign: f64) -> Self {
        Self {
            information: &self.information + &part.information * sign,
            gradient: &self.gradient + &part.gradient * sign,
            rest: self.rest + (part.square + part.log_determinant) * sign,
        }
    }

    /// Minus twice the restricted log likelihood, up to a constant.
    fn criterion(&self) -> f64 {
        let Some(factor) = self.information.clone().cholesky() else {
            return f64::INFINITY;
        };
        let log_determinant: f64 = factor.l_dirty().diagonal().map(f64::ln).sum();
        self.rest + 2.0 * log_determinant - self.gradient.dot(&factor.solve(&self.gradient))
    }
}

/// Classifies the lines, given information and gradient of the parameters from other sources.
pub(super) fn classified(
    lines: &[SmoothLine],
    known: (&DMatrix<f64>, &DVector<f64>),
) -> Option<Mixture> {
    let curved = displacement_variance(CURVED);
    let curved_criterion = |line: &SmoothLine| {
        let log_determinant = line.part(curved)?.log_determinant;
        Some(log_determinant + line.freedom() + CURVED_PENALTY)
    };
    let curved: Vec<f64> = lines.iter().map(curved_criterion).collect::<Option<_>>()?;
    let parts = |bend: f64| -> Option<Vec<LinePart>> {
        lines
            .iter()
            .map(|line| line.part(displacement_variance(bend)))
            .collect()
    };
    let all: Vec<Vec<LinePart>> = BENDS
        .iter()
        .map(|bend| parts(*bend))
        .collect::<Option<_>>()?;
    let sums = |parts: &[LinePart], is_straight: &[bool]| {
        let mut sums = Sums {
            information: known.0.clone(),
            gradient: known.1.clone(),
            rest: 0.0,
        };
        for (i, part) in parts.iter().enumerate() {
            match is_straight[i] {
                true => sums = sums.with(part, 1.0),
                false => sums.rest += curved[i],
            }
        }
        sums
    };
    // The less lines may bend, the more of them are curved.
    let mut is_straight = vec![true; lines.len()];
    let mut best: Option<(f64, Vec<bool>)> = None;
    for parts in &all {
        let start = sums(parts, &is_straight);
        let criterion = switch(start, parts, &curved, &mut is_straight);
        if best.as_ref().is_none_or(|(lowest, _)| criterion < *lowest) {
            best = Some((criterion, is_straight.clone()));
        }
    }
    let (_, is_straight) = best?;
    let criteria = all
        .iter()
        .map(|parts| sums(parts, &is_straight).criterion());
    let mean = sums(
        &parts(mean_bend(&criteria.collect::<Vec<_>>()))?,
        &is_straight,
    );
    Some(Mixture {
        is_straight,
        information: mean.information,
        gradient: mean.gradient,
    })
}

/// Switches lines between straight and curved, one by one, as long as that lowers the criterion;
/// returns the criterion.
fn switch(mut current: Sums, parts: &[LinePart], curved: &[f64], is_straight: &mut [bool]) -> f64 {
    let mut criterion = current.criterion();
    for _ in 0..2 * parts.len() {
        let switched = |i: usize| {
            let sign = if is_straight[i] { -1.0 } else { 1.0 };
            let mut sums = current.with(&parts[i], sign);
            sums.rest -= sign * curved[i];
            sums
        };
        let trials = (0..parts.len()).map(|i| (i, switched(i).criterion()));
        let lowest = trials.min_by(|(_, a), (_, b)| a.total_cmp(b));
        let Some((line, found)) = lowest.filter(|(_, found)| *found < criterion) else {
            break;
        };
        (current, criterion) = (switched(line), found);
        is_straight[line] = !is_straight[line];
    }
    criterion
}

/// The root mean square bend over all that were tried, weighted by their probabilities.
fn mean_bend(criteria: &[f64]) -> f64 {
    let lowest = criteria.iter().copied().fold(f64::INFINITY, f64::min);
    let (mut total, mut squares) = (0.0, 0.0);
    for (bend, criterion) in BENDS.iter().zip(criteria) {
        let prior = match *bend == 0.0 {
            true => NO_BEND_PRIOR,
            false => (1.0 - NO_BEND_PRIOR) / (BENDS.len() - 1) as f64,
        };
        let weight = prior * (0.5 * (lowest - criterion)).exp();
        total += weight;
        squares += weight * bend * bend;
    }
    (squares / total).sqrt()
}
