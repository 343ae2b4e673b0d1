//! Does the lens do what its model cannot? What all planes miss alike, at their places in the
//! picture, is the lens; what sides and boards miss on their own is theirs.
//!
//! Two explanations of the residuals are weighed: that sides err, and boards are bent, each on its
//! own, or squares are none; and that further fields displace the picture besides
//! ([`crate::noise::PictureFields`]). The fields are normal beforehand, of the strength that lenses
//! have, so that the restricted likelihoods compare as marginal ones do: fields that explain by
//! chance what sides do on their own cost more than they gain. Few planes that are bent look a
//! little like any lens; but with a lens alone for the cause, no bend is left beside its fields.

use nalgebra::{DMatrix, DVector};

use super::covariance::covariance;
use crate::lens::Lens;
use crate::noise::{Assumption, FIELDS, FLAT, Noise, PictureFields, SideErrors, white_variance};
use crate::numeric::{ArrowSystem, chi_square_tail};
use crate::observations::{BoardRelief, FreeParameters, ObservedPlane};
use crate::refine::Refined;
use crate::result::{Calibration, Warning};

/// How often independent noise alone shows so much of the fields: the weighing is then begun.
const CHANCE: f64 = 1e-3;

/// Twice the logarithm of the odds by which the fields have to explain the residuals better.
const CLEARLY: f64 = 12.0;

/// Variances tried of the planes' relief: none, and heights of a thousandth of half the extent to a
/// tenth.
const RELIEFS: [f64; 5] = [FLAT, NEARLY_FLAT, 1e-5, 1e-4, 1e-2];

/// The least of them: it takes up what little a model leaves.
const NEARLY_FLAT: f64 = 1e-6;

/// Variances (px^2) tried of where the sides lie of squares that are none, each so many times the one
/// before.
const LINES: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1e3];
const LINES_RATIO: f64 = 10.0;

/// What the residuals say of the lens.
pub(crate) enum LensVerdict {
    /// They do not ask for another, and no plane is bent.
    Held,
    /// Sheets that are not flat explain them best.
    NotFlat,
    /// Fields alone explain them: by how much the free parameters would change with a lens that has
    /// them, to first order.
    Beyond(DVector<f64>),
    /// Fields explain them best, and something else nearly as well: the same.
    Likely(DVector<f64>),
    /// Squares that are none explain them, and fields perhaps as well.
    NoSquares(NoSquares),
    /// Fields explain a part of them.
    Unclear {
        /// Whether they do clearly.
        asked: bool,
    },
}

/// What squares that are none make of the answer.
pub(crate) struct NoSquares {
    /// By how much the free parameters would change if it were known, to first order, ...
    change: DVector<f64>,
    /// ... and their covariance then.
    covariance: DMatrix<f64>,
    /// How far sides lie from where true squares would have them, px.
    displacement: f64,
    /// Where fields explain the residuals about as well: the change with a lens that has them.
    pub lens: Option<DVector<f64>>,
}

/// Whether the residuals ask for a lens that has the fields; `None` where that cannot be told.
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
    let mut flat = gather(planes)?;
    if !flat.has_board_relief() {
        flat.hold_fields(&deviations[1]);
        let system = flat.marginal(&vec![0.0; planes.len()])?;
        let gain = 2.0 * system.gain_of_last(FIELDS)?;
        if chi_square_tail(gain, PictureFields::count(free)) > CHANCE {
            return Some(LensVerdict::Held);
        }
    }
    // A square may be bent as well as a board, only that it tells less of it.
    let mut planes = planes.to_vec();
    for (plane, state) in planes.iter_mut().zip(&view.planes) {
        if plane.board_relief.is_none() && !plane.is_outlier() {
            plane.board_relief = Some(BoardRelief::flat(plane, view, state)?);
        }
    }
    let mut errors = gather(&planes)?;
    let [bent, beyond] = Explanation::bent(&mut errors, deviations)?;
    let misshapen = Explanation::misshapen(&mut flat, deviations[0]);
    let shapes = misshapen.as_ref().map_or(f64::INFINITY, |it| it.criterion);
    if bent.relief > NEARLY_FLAT && bent.criterion + CLEARLY < beyond.flat.min(shapes) {
        return Some(LensVerdict::NotFlat);
    }
    if beyond.criterion + CLEARLY < bent.criterion.min(shapes) {
        let needs_relief = beyond.flat + CLEARLY >= bent.criterion.min(shapes);
        return Some(match beyond.relief > FLAT && needs_relief {
            true => LensVerdict::Unclear { asked: true },
            false => LensVerdict::Beyond(beyond.change(&mut errors, free)?),
        });
    }
    if let Some(misshapen) = misshapen.filter(|it| it.criterion + CLEARLY < bent.flat) {
        let as_well = beyond.flat < shapes + CLEARLY;
        return Some(LensVerdict::NoSquares(NoSquares {
            change: misshapen.change(&mut flat, free)?,
            covariance: misshapen.covariance(&mut flat, free)?,
            displacement: misshapen.line_variance.sqrt(),
            lens: match as_well {
                true => Some(beyond.change(&mut errors, free)?),
                false => None,
            },
        }));
    }
    if beyond.flat + CLEARLY < bent.flat && beyond.flat < bent.criterion.min(shapes) {
        return Some(LensVerdict::Likely(beyond.change(&mut errors, free)?));
    }
    Some(match bent.relief > NEARLY_FLAT {
        true => LensVerdict::Unclear { asked: false },
        false => LensVerdict::Held,
    })
}

/// What explains the residuals beside noise, its strengths the likeliest.
struct Explanation {
    /// Standard deviations of the picture's fields.
    fields: [f64; FIELDS],
    /// Variance of the planes' relief, ...
    relief: f64,
    /// ... of where the sides of squares lie (px^2), ...
    line_variance: f64,
    /// ... and of what the sides of each plane err on their own.
    variances: Vec<f64>,
    /// Minus twice the logarithm of its likelihood, ...
    criterion: f64,
    /// ... and of that without a relief.
    flat: f64,
}

impl Explanation {
    /// Planes that are bent, or flat, beside fields of either strength.
    fn bent(errors: &mut SideErrors, fields: [[f64; FIELDS]; 2]) -> Option<[Self; 2]> {
        let under = |relief| {
            fields
                .each_ref()
                .map(|fields| Assumption { relief, fields })
        };
        let tried: Vec<Assumption<'_>> = RELIEFS.into_iter().flat_map(under).collect();
        let found = errors.likeliest_under(&tried, None);
        let mut likeliest = |own: usize| {
            let (_, flat) = found[own]?; // FLAT comes first
            let found = found.iter().skip(own).step_by(fields.len());
            let criteria = RELIEFS.into_iter().zip(found);
            let criteria = criteria.filter_map(|(relief, found)| Some((relief, (*found)?)));
            let by_criterion =
                |a: &(f64, (f64, f64)), b: &(f64, (f64, f64))| a.1.1.total_cmp(&b.1.1);
            let (relief, common) = criteria.min_by(by_criterion)?;
            let fields = fields[own];
            errors.hold_fields(&fields);
            errors.set_relief(relief);
            let (variances, criterion) = errors.likeliest(common)?;
            Some(Self {
                fields,
                relief,
                line_variance: 0.0,
                variances,
                criterion: criterion + norm(&fields),
                flat: flat + norm(&fields),
            })
        };
        Some([likeliest(0)?, likeliest(1)?])
    }

    /// Squares that are none, beside fields; `None` without squares.
    fn misshapen(errors: &mut SideErrors, fields: [f64; FIELDS]) -> Option<Self> {
        let flat = Assumption {
            relief: FLAT,
            fields: &fields,
        };
        let tried = LINES.iter().filter_map(|line_variance| {
            errors.set_lines(*line_variance).then_some(())?;
            let (variance, criterion) = errors.likeliest_under(&[flat], None)[0]?;
            Some((*line_variance, variance, criterion + norm(&fields)))
        });
        let tried: Vec<(f64, f64, f64)> = tried.collect();
        errors.set_lines(0.0);
        let by_criterion = |a: &usize, b: &usize| tried[*a].2.total_cmp(&tried[*b].2);
        let likeliest = (0..tried.len()).min_by(by_criterion)?;
        let (at, variance, criterion) = tried[likeliest];
        // Between those tried it follows a parabola over their logarithms.
        let around = likeliest.checked_sub(1).zip(tried.get(likeliest + 1));
        let line_variance = around.map_or(at, |(before, after)| {
            let [before, after] = [tried[before].2, after.2].map(|other| other - criterion);
            let curvature = (before + after).max(f64::MIN_POSITIVE);
            at * LINES_RATIO.powf(0.5 * (before - after) / curvature)
        });
        Some(Self {
            fields,
            relief: FLAT,
            line_variance,
            variances: vec![variance; errors.plane_count()],
            criterion,
            flat: criterion,
        })
    }

    /// By how much the free parameters would change, to first order, ...
    fn change(&self, errors: &mut SideErrors, free: &FreeParameters) -> Option<DVector<f64>> {
        let step = self.system(errors)?.solve(0.0)?;
        Some(step.shared.rows(0, free.len()).into_owned())
    }

    /// ... and their covariance then.
    fn covariance(&self, errors: &mut SideErrors, free: &FreeParameters) -> Option<DMatrix<f64>> {
        let all = covariance(&self.system(errors)?, 1.0)?;
        let size = free.len();
        Some(all.view((0, 0), (size, size)).into_owned())
    }

    /// The normal equations that allow for it.
    fn system(&self, errors: &mut SideErrors) -> Option<ArrowSystem> {
        errors.hold_fields(&self.fields);
        errors.set_relief(self.relief);
        errors.set_lines(self.line_variance);
        errors.marginal(&self.variances)
    }
}

/// As the relief's and the sides' own priors, that of the fields has its norm.
fn norm(fields: &[f64]) -> f64 {
    fields.iter().map(|std| 2.0 * std.ln()).sum()
}

impl<L: Lens> Calibration<L> {
    /// Adds to the covariance how far a lens beyond the model moves the free parameters; the warning
    /// names the model that holds it, with `fx` there.
    pub(crate) fn allow_for_lens(
        &mut self,
        change: &DVector<f64>,
        cure: Option<(String, f64)>,
        certain: bool,
        held: Vec<&'static str>,
    ) -> Option<Warning> {
        let (parameter, factor) = self.raise(&(change * change.transpose()))?;
        Some(Warning::LensBeyondModel {
            certain,
            parameter: parameter.into(),
            factor,
            cure,
            held: held.into_iter().map(Into::into).collect(),
        })
    }

    /// The same for squares that are none, or for what is held at a wrong value.
    pub(crate) fn allow_for_no_squares(
        &mut self,
        found: &NoSquares,
        free: &FreeParameters,
    ) -> Option<Warning> {
        let doubt = &found.covariance + &found.change * found.change.transpose();
        let (parameter, factor) = self.raise(&doubt)?;
        Some(Warning::NoSquares {
            displacement: found.displacement,
            parameter: parameter.into(),
            factor,
            held: free.held().into_iter().map(Into::into).collect(),
        })
    }

    /// Adds a doubt to the covariance; returns the parameter whose standard deviation grows most,
    /// and how many times.
    fn raise(&mut self, doubt: &DMatrix<f64>) -> Option<(&'static str, f64)> {
        let (added, own) = (doubt.diagonal(), self.covariance.diagonal());
        let factors = added.iter().zip(&own);
        let factors = factors.map(|(added, own)| (1.0 + added / own).sqrt());
        let names = self.parameters.iter().copied();
        let most = names.zip(factors).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let correlation = &mut self.residual_correlation;
        self.covariance += doubt;
        correlation.added += doubt;
        Some(most)
    }
}
