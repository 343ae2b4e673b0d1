//! Test whether the lens departs from its model. Residuals that all planes have in common, at the
//! same places in the picture, are due to the lens; residuals of single sides and boards are due to
//! these.
//!
//! Two explanations of the residuals are compared: sides with errors and sheets with bends or
//! stretches of their own, or squares that are not square; and, in addition, further fields that
//! displace the picture ([`crate::noise::PictureFields`]). The fields have a normal prior of the
//! strength that lenses have, so that the restricted likelihoods compare as marginal ones do: fields that explain the
//! sides' own errors by chance cost more than they gain. A few bent planes always resemble some
//! lens a little; but if a lens is the only cause, no bend is left beside its fields.

use nalgebra::{DMatrix, DVector};

use super::covariance::covariance;
use crate::lens::Lens;
use crate::noise::{Assumption, FIELDS, Noise, PictureFields, SideErrors, white_variance};
use crate::numeric::{ArrowSystem, chi_square_tail};
use crate::observations::{
    Deformation, DeformationKind, DeformationPrior, FreeParameters, ObservedPlane,
};
use crate::refine::Refined;
use crate::result::{Calibration, Warning};

/// Probability that independent noise alone shows as much of the fields, below which the
/// explanations are compared.
const CHANCE: f64 = 1e-3;

/// Twice the logarithm of the odds by which an explanation has to be better than the others.
const CLEARLY: f64 = 12.0;

/// Kinds of deformation and their variances that are tried: heights from a thousandth of half the
/// extent to a tenth, or such stretches.
const KINDS: [DeformationKind; 2] = [DeformationKind::Bent, DeformationKind::Stretched];
const VARIANCES: [f64; 4] = [NEARLY_EXACT, 1e-5, 1e-4, 1e-2];

/// The smallest variance, which absorbs the little that a model leaves.
const NEARLY_EXACT: f64 = 1e-6;

/// Variances (px^2) that are tried of the positions of the sides of squares that are not square,
/// each `LINES_RATIO` times the one before.
const LINES: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1e3];
const LINES_RATIO: f64 = 10.0;

/// Conclusion from the residuals about the lens.
pub(crate) enum LensVerdict {
    /// The residuals do not require another lens, and no plane is deformed.
    Held,
    /// Sheets that are bent or stretched explain the residuals best.
    Deformed,
    /// Fields alone explain the residuals: the change of the free parameters with a lens that has
    /// them, to first order.
    Beyond(DVector<f64>),
    /// Fields explain the residuals best, and something else nearly as well: the same change.
    Likely(DVector<f64>),
    /// Squares that are not square explain the residuals, and fields perhaps as well.
    NoSquares(NoSquares),
    /// Fields explain a part of the residuals.
    Unclear {
        /// Whether they do so clearly.
        is_evident: bool,
    },
}

/// Effect on the result of squares that are not square.
pub(crate) struct NoSquares {
    /// Change of the free parameters if the shapes were accounted for, to first order.
    change: DVector<f64>,
    /// Covariance of the free parameters then.
    covariance: DMatrix<f64>,
    /// Distance of the sides from where true squares would have them, px.
    displacement: f64,
    /// The change with a lens that has the fields, if these explain the residuals about as well.
    pub lens: Option<DVector<f64>>,
}

/// Tests whether the residuals require a lens that has the fields; `None` if that cannot be
/// computed.
pub(crate) fn beyond_lens<L: Lens>(
    planes: &[ObservedPlane],
    (free, fields): (&FreeParameters, PictureFields),
    refined: &Refined<L>,
    noise: &Noise,
) -> Option<LensVerdict> {
    let white = white_variance(noise, refined);
    let view = &refined.view;
    let gather = |planes: &[ObservedPlane]| {
        SideErrors::gather(planes, (free, Some(fields)), view, noise, white)
    };
    let deviations = [false, true].map(|any| PictureFields::deviations(free, any));
    let mut exact = gather(planes)?;
    if !exact.has_deformation() {
        exact.set_field_priors(&deviations[1]);
        let system = exact.marginal(&vec![0.0; planes.len()])?;
        let gain = 2.0 * system.freeing_gain(FIELDS)?;
        if chi_square_tail(gain, PictureFields::count(free)) > CHANCE {
            return Some(LensVerdict::Held);
        }
    }
    // A square may be deformed like a board, but its samples show less of a bend.
    let mut planes = planes.to_vec();
    for (plane, state) in planes.iter_mut().zip(&view.planes) {
        if plane.deformation.is_none() && !plane.is_outlier() {
            plane.deformation = Some(Deformation::none(plane, view, state)?);
        }
    }
    let mut errors = gather(&planes)?;
    let [deformed, beyond] = Explanation::deformed(&mut errors, deviations)?;
    let misshapen = Explanation::misshapen(&mut exact, deviations[0]);
    let misshapen_criterion = misshapen
        .as_ref()
        .map_or(f64::INFINITY, |explanation| explanation.criterion);
    if deformed.is_notable() && deformed.criterion + CLEARLY < beyond.exact.min(misshapen_criterion)
    {
        return Some(LensVerdict::Deformed);
    }
    if beyond.criterion + CLEARLY < deformed.criterion.min(misshapen_criterion) {
        let needs_deformation =
            beyond.exact + CLEARLY >= deformed.criterion.min(misshapen_criterion);
        return Some(
            match beyond.deformation != DeformationPrior::EXACT && needs_deformation {
                true => LensVerdict::Unclear { is_evident: true },
                false => LensVerdict::Beyond(beyond.change(&mut errors, free)?),
            },
        );
    }
    if let Some(misshapen) =
        misshapen.filter(|explanation| explanation.criterion + CLEARLY < deformed.exact)
    {
        let is_lens_off = beyond.exact < misshapen_criterion + CLEARLY;
        return Some(LensVerdict::NoSquares(NoSquares {
            change: misshapen.change(&mut exact, free)?,
            covariance: misshapen.covariance(&mut exact, free)?,
            displacement: misshapen.line_variance.sqrt(),
            lens: match is_lens_off {
                true => Some(beyond.change(&mut errors, free)?),
                false => None,
            },
        }));
    }
    if beyond.exact + CLEARLY < deformed.exact
        && beyond.exact < deformed.criterion.min(misshapen_criterion)
    {
        return Some(LensVerdict::Likely(beyond.change(&mut errors, free)?));
    }
    Some(match deformed.is_notable() {
        true => LensVerdict::Unclear { is_evident: false },
        false => LensVerdict::Held,
    })
}

/// An explanation of the residuals beside noise, with its most likely strengths.
struct Explanation {
    /// Standard deviations of the picture's fields.
    fields: [f64; FIELDS],
    deformation: DeformationPrior,
    /// Variance of the positions of squares' sides (px^2).
    line_variance: f64,
    /// Variance of the own errors of each plane's sides.
    variances: Vec<f64>,
    /// Minus twice the logarithm of the likelihood.
    criterion: f64,
    /// The same without a deformation.
    exact: f64,
}

impl Explanation {
    /// Explanations by deformed or exact planes, with fields of either strength.
    fn deformed(errors: &mut SideErrors, fields: [[f64; FIELDS]; 2]) -> Option<[Self; 2]> {
        let of_kind = |kind| VARIANCES.map(|variance| DeformationPrior { kind, variance });
        let exact = std::iter::once(DeformationPrior::EXACT);
        let priors: Vec<DeformationPrior> =
            exact.chain(KINDS.into_iter().flat_map(of_kind)).collect();
        let assumptions = |&deformation: &DeformationPrior| {
            fields.each_ref().map(|fields| Assumption {
                deformation,
                fields,
            })
        };
        let tried: Vec<Assumption<'_>> = priors.iter().flat_map(assumptions).collect();
        let found = errors.likeliest_under(&tried, None);
        let mut likeliest = |index: usize| {
            let (_, exact) = found[index]?; // the first prior
            let found = found.iter().skip(index).step_by(fields.len());
            let found = priors.iter().zip(found);
            let found = found.filter_map(|(prior, found)| Some((*prior, (*found)?)));
            let (deformation, common) = found.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
            let fields = fields[index];
            errors.set_field_priors(&fields);
            errors.set_deformation_prior(deformation);
            let (variances, criterion) = errors.likeliest(common)?;
            Some(Self {
                fields,
                deformation,
                line_variance: 0.0,
                variances,
                criterion: criterion + prior_norm(&fields),
                exact: exact + prior_norm(&fields),
            })
        };
        Some([likeliest(0)?, likeliest(1)?])
    }

    /// Explanation by squares that are not square, with fields; `None` without squares.
    fn misshapen(errors: &mut SideErrors, fields: [f64; FIELDS]) -> Option<Self> {
        let exact = Assumption {
            deformation: DeformationPrior::EXACT,
            fields: &fields,
        };
        let tried = LINES.iter().filter_map(|line_variance| {
            errors.set_line_variance(*line_variance).then_some(())?;
            let (variance, criterion) = errors.likeliest_under(&[exact], None)[0]?;
            Some((*line_variance, variance, criterion + prior_norm(&fields)))
        });
        let tried: Vec<(f64, f64, f64)> = tried.collect();
        errors.set_line_variance(0.0);
        let by_criterion = |a: &usize, b: &usize| tried[*a].2.total_cmp(&tried[*b].2);
        let likeliest = (0..tried.len()).min_by(by_criterion)?;
        let (best_variance, variance, criterion) = tried[likeliest];
        // Between the variances tried, the criterion is interpolated by a parabola over their
        // logarithms.
        let neighbours = likeliest.checked_sub(1).zip(tried.get(likeliest + 1));
        let line_variance = neighbours.map_or(best_variance, |(before, after)| {
            let [before, after] = [tried[before].2, after.2].map(|other| other - criterion);
            let curvature = (before + after).max(f64::MIN_POSITIVE);
            best_variance * LINES_RATIO.powf(0.5 * (before - after) / curvature)
        });
        Some(Self {
            fields,
            deformation: DeformationPrior::EXACT,
            line_variance,
            variances: vec![variance; errors.plane_count()],
            criterion,
            exact: criterion,
        })
    }

    /// Whether targets are deformed by more than a model may leave.
    fn is_notable(&self) -> bool {
        self.deformation.variance > NEARLY_EXACT
    }

    /// Returns the change of the free parameters, to first order.
    fn change(&self, errors: &mut SideErrors, free: &FreeParameters) -> Option<DVector<f64>> {
        let step = self.system(errors)?.solve(0.0)?;
        Some(step.shared.rows(0, free.len()).into_owned())
    }

    /// Covariance of the free parameters then.
    fn covariance(&self, errors: &mut SideErrors, free: &FreeParameters) -> Option<DMatrix<f64>> {
        let all = covariance(&self.system(errors)?, 1.0)?;
        let size = free.len();
        Some(all.view((0, 0), (size, size)).into_owned())
    }

    /// Returns the normal equations under this explanation.
    fn system(&self, errors: &mut SideErrors) -> Option<ArrowSystem> {
        errors.set_field_priors(&self.fields);
        errors.set_deformation_prior(self.deformation);
        errors.set_line_variance(self.line_variance);
        errors.marginal(&self.variances)
    }
}

/// Normalisation of the fields' prior, as those of the deformations and of the sides have it.
fn prior_norm(fields: &[f64]) -> f64 {
    fields.iter().map(|std| 2.0 * std.ln()).sum()
}

impl<L: Lens> Calibration<L> {
    /// Adds the change of the free parameters by a lens beyond the model to the covariance; the
    /// warning names the model that fits the lens, with its `fx`.
    pub(crate) fn allow_for_lens(
        &mut self,
        change: &DVector<f64>,
        cure: Option<(String, f64)>,
        certain: bool,
        held: Vec<&'static str>,
    ) -> Option<Warning> {
        let (parameter, factor) = self.add_doubt(&(change * change.transpose()))?;
        Some(Warning::LensBeyondModel {
            certain,
            parameter: parameter.into(),
            factor,
            cure,
            held: held.into_iter().map(Into::into).collect(),
        })
    }

    /// The same for squares that are not square, or for what is held at a wrong value.
    pub(crate) fn allow_for_no_squares(
        &mut self,
        found: &NoSquares,
        free: &FreeParameters,
    ) -> Option<Warning> {
        let doubt = &found.covariance + &found.change * found.change.transpose();
        let (parameter, factor) = self.add_doubt(&doubt)?;
        Some(Warning::NoSquares {
            displacement: found.displacement,
            parameter: parameter.into(),
            factor,
            held: free.held().into_iter().map(Into::into).collect(),
        })
    }

    /// Adds `doubt` to the covariance; returns the parameter whose standard deviation grows most,
    /// and its factor.
    fn add_doubt(&mut self, doubt: &DMatrix<f64>) -> Option<(&'static str, f64)> {
        let (added, variances) = (doubt.diagonal(), self.covariance.diagonal());
        let factors = added.iter().zip(&variances);
        let factors = factors.map(|(added, variance)| (1.0 + added / variance).sqrt());
        let names = self.parameters.iter().copied();
        let largest = names.zip(factors).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let correlation = &mut self.residual_correlation;
        self.covariance += doubt;
        correlation.added += doubt;
        Some(largest)
    }
}
