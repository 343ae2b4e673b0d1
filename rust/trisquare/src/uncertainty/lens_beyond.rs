//! Does the lens do what its model cannot? What all planes miss alike, at their places in the
//! picture, is the lens; what sides and boards miss on their own is theirs.
//!
//! Two explanations of the residuals are weighed: that sides err, and boards are bent, each on its
//! own, or squares are none; and that further fields displace the picture besides
//! ([`crate::noise::PictureFields`]). The fields are normal beforehand, of the strength that lenses
//! have, so that the restricted likelihoods compare as marginal ones do: fields that explain by
//! chance what sides do on their own cost more than they gain. Few planes that are bent look a
//! little like any lens; but with a lens alone for the cause, no bend is left beside its fields.

use nalgebra::DVector;

use crate::lens::Lens;
use crate::noise::{FIELDS, FLAT, Noise, PictureFields, SideErrors, white_variance};
use crate::numeric::chi_square_tail;
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

/// Variances (px^2) tried of where the sides lie of squares that are none.
const LINES: [f64; 4] = [0.01, 0.1, 1.0, 10.0];

/// What the residuals say of the lens.
pub(crate) enum LensVerdict {
    /// They do not ask for another, and no plane is bent.
    Held,
    /// Sheets that are not flat explain them best.
    NotFlat,
    /// Fields alone explain them: by how much the free parameters would change with a lens that has
    /// them, to first order.
    Beyond(DVector<f64>),
    /// Fields explain a part of them, or squares are none.
    Unclear {
        /// Whether fields explain a part clearly.
        asked: bool,
    },
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
    let mut errors = SideErrors::gather_with_fields(planes, (free, fields), view, noise, white)?;
    errors.hold_fields(&PictureFields::deviations(free, true));
    if !errors.has_board_relief() {
        let system = errors.marginal(&vec![0.0; planes.len()])?;
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
    let mut errors = SideErrors::gather_with_fields(&planes, (free, fields), view, noise, white)?;
    let no_fields = PictureFields::deviations(free, false);
    let bent = Explanation::likeliest(&mut errors, &no_fields)?;
    let misshapen = misshapen(&mut errors, &no_fields).unwrap_or(f64::INFINITY);
    let beyond = Explanation::likeliest(&mut errors, &PictureFields::deviations(free, true))?;
    if bent.criterion.min(misshapen) - beyond.criterion < CLEARLY {
        return Some(match bent.relief > NEARLY_FLAT {
            true if bent.criterion + CLEARLY < beyond.flat.min(misshapen) => LensVerdict::NotFlat,
            true => LensVerdict::Unclear { asked: false },
            false => LensVerdict::Held,
        });
    }
    if beyond.relief > FLAT {
        return Some(LensVerdict::Unclear { asked: true });
    }
    errors.set_relief(beyond.relief);
    let step = errors.marginal(&beyond.variances)?.solve(0.0)?;
    Some(LensVerdict::Beyond(
        step.shared.rows(0, free.len()).into_owned(),
    ))
}

/// The likeliest strength of what sides err on their own, beside a relief and fields or none.
struct Explanation {
    relief: f64,
    variances: Vec<f64>,
    /// Minus twice the logarithm of its likelihood, ...
    criterion: f64,
    /// ... and of that without a relief.
    flat: f64,
}

impl Explanation {
    /// With fields of these standard deviations.
    fn likeliest(errors: &mut SideErrors, fields: &[f64]) -> Option<Self> {
        errors.hold_fields(fields);
        let tried = RELIEFS.iter().filter_map(|relief| {
            let criterion = errors.likeliest_at(*relief, None)?.1;
            Some((*relief, criterion))
        });
        let tried: Vec<(f64, f64)> = tried.collect();
        let (_, flat) = *tried.first()?;
        let (relief, _) = tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        errors.set_relief(relief);
        let (variances, criterion) = errors.likeliest()?;
        Some(Self {
            relief,
            variances,
            criterion: criterion + norm(fields),
            flat: flat + norm(fields),
        })
    }
}

/// Minus twice the logarithm of the likelihood of squares that are none; `None` without squares.
fn misshapen(errors: &mut SideErrors, fields: &[f64]) -> Option<f64> {
    errors.set_relief(FLAT);
    let tried = LINES.iter().filter_map(|variance| {
        errors.set_lines(*variance).then_some(())?;
        Some(errors.likeliest_at(FLAT, None)?.1)
    });
    let criterion = tried.min_by(f64::total_cmp);
    errors.set_lines(0.0);
    Some(criterion? + norm(fields))
}

/// As the relief's and the sides' own priors, that of the fields has its norm.
fn norm(fields: &[f64]) -> f64 {
    fields.iter().map(|std| 2.0 * std.ln()).sum()
}

impl<L: Lens> Calibration<L> {
    /// Adds to the covariance how far a lens beyond the model moves the free parameters, and warns
    /// of it first, with the model that holds it and `fx` there.
    pub(crate) fn allow_for_lens(&mut self, change: &DVector<f64>, cure: Option<(String, f64)>) {
        let variances = self.covariance.diagonal();
        let factors = change.iter().zip(&variances);
        let factors = factors.map(|(change, own)| (1.0 + change * change / own).sqrt());
        let names = self.parameters.iter().copied();
        let by_factor = |a: &(f64, &str), b: &(f64, &str)| a.0.total_cmp(&b.0);
        let Some((factor, parameter)) = factors.zip(names).max_by(by_factor) else {
            return;
        };
        let doubt = change * change.transpose();
        let correlation = &mut self.residual_correlation;
        self.covariance += &doubt;
        correlation.added += &doubt;
        correlation.added_to_pixels += &doubt;
        let warning = Warning::LensBeyondModel {
            parameter,
            factor,
            cure,
        };
        self.warnings.insert(0, warning);
    }
}
