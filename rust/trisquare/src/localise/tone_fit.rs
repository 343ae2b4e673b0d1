//! What the profiles of a picture's edges tell of its tone curve.
//!
//! A blurred step in light is symmetric about its edge; what asymmetry the coded step has is the
//! tone curve's. Every side has its own curve, base, contrast and blur, which are eliminated; the
//! information that all sides have left on what they share, the tone curve's parameters and the
//! kurtosis of the lens's blur, adds up.

use nalgebra::{Cholesky, Const, Matrix2, SMatrix, SVector};

use super::band::Pixel;
use super::curve::COEFFICIENTS;
use super::equations::{BASE, BLUR, PARAMETERS};
use super::pixel_noise::robust_weight;
use super::prediction::Prediction;
use super::preview::Preview;
use super::profile::ResidualProfile;
use super::side::{PLACES, SideModel, polynomial, polynomial_through};
use super::side_sums::{BIN_LENGTH, SideSums};
use super::span::NoEdge;
use crate::image::{
    PictureTone, PowerCurve, TONE_PARAMETERS, Tone, ToneCurve, TonePrior, USUAL_KURTOSIS,
    box_kurtosis,
};
use crate::numeric::median;

/// A side whose dark or light comes this near to the file's limits, in deviations of its noise and
/// at least in values, is clipped there: its profile's asymmetry is not the tone curve's.
const CLIPPED_DEVIATIONS: f64 = 2.5;
const CLIPPED_VALUE: f64 = 1.5 / 255.0;

/// Rounds of the first fit, and the step, in deviations of the estimate, that is the last.
const MAX_ROUNDS: usize = 10;
const LAST_STEP: f64 = 0.3;
/// A round's step of the logarithm of gamma is cut to this.
const MAX_STEP: f64 = 0.4;

/// A side's own parameters, and its spread, which looks like a tone curve's shift.
const OWN: usize = PARAMETERS + 1;
const SPREAD: usize = PARAMETERS;
/// Any spread is as likely; where there is none, this keeps the equations regular.
const SPREAD_STD: f64 = 1.0;
/// What the sides of a picture share: the tone curve's parameters, and what the lens adds to the
/// kurtosis of the pixel's box.
///
/// A pixel's box, a lens out of focus and sharpening all make a blur that is not quite normal, but
/// symmetric. Where the tone is curved a symmetric misfit looks like another curve: without the
/// box's kurtosis (at a blur of half a pixel) gamma is off by 0.2, and by as much without that of a
/// lens that spreads light over a disc of 0.8 pixels.
const SHARED: usize = TONE_PARAMETERS + 1;
/// The kurtosis among what is shared; among the parameters of a fit to the pixels it is [`crate::image::KURTOSIS`].
pub(super) const KURTOSIS_OF_SHARED: usize = TONE_PARAMETERS;
/// Values of what is shared, or a step of them: of the kurtosis, whose effect is linear, the value.
pub(super) type Shared = SVector<f64, SHARED>;
pub(super) type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
/// All parameters.
const TOTAL: usize = OWN + SHARED;

/// A mean profile that departs by this part of the contrast leaves the tone curve half the
/// information that its noise alone would: with more, it is JPEG or sharpening that is measured.
/// Squares in photographs passed through JPEG 85 had misfits of 0.004 and errors of gamma ten times
/// what their noise explains.
const TRUSTED_MISFIT: f64 = 5e-4;
/// From here on the profiles are taken to be those of no tone curve at all.
pub(crate) const MAX_MISFIT: f64 = 1.5e-3;
/// The shift, in blurs, that a misfit may hide. A shift of one blur changes the profile by 0.2 in
/// root mean square over its bins; what is left after a fit is a third of what there was, and less
/// where the fitted curve is believed: with that, k1 of rendered pictures after JPEG 88 to 95 was
/// off by 1.5 to 2.5 standard deviations for shifts of 0 and 15, by 0.9 to 1.2 for this one.
const SHIFT_PER_MISFIT: f64 = 15.0;
const SHIFT_PER_FITTED_MISFIT: f64 = 40.0;
/// It is no more than this: whatever the profiles are, the edges are seen within their blur.
const MAX_SHIFT: f64 = 1.0;
/// The shift (px) that must be reckoned with where no side tells anything: that of taking sRGB for
/// linear light or the reverse.
const BLIND_SHIFT_STD: f64 = 0.1;

/// What usual curves have above the gamma of linear light, and how far they move an edge between
/// levels 40 and 215 to the dark, in blurs.
const USUAL_EXCESS: f64 = 1.2;
const USUAL_SHIFT: f64 = 0.5;
/// Profiles of no curve leave at least this shift open, in blurs: frames under S-shaped curves, which
/// tell it to hundredths of that, were shifted by 0.1 to 0.3 where their misfit allowed for 0.03.
const MIN_UNREAD_SHIFT: f64 = 0.1;
/// A gamma counts as smaller than the usual one by what exceeds so many of its deviations.
const GAMMA_DEVIATIONS: f64 = 1.0;
/// No photograph was coded sharper than with this blur (px): the pixel's box and some of a lens.
const MIN_BLUR: f64 = 0.4;
/// But of one that was made smaller since, the box is smaller as well.
const MIN_BLUR_OF_SMALLER: f64 = 0.3;

/// Pixels that are asked, of a picture and of each of its sides at most. The camera loses nothing:
/// its own geometry tells most of what a tone curve does to it, and the fit to the pixels asks them
/// all.
const PIXELS: usize = 20_000;
const MAX_PIXELS: usize = 1500;

/// But of each side so many at least: they tell its own parameters as well.
const MIN_PIXELS: usize = 300;

/// One in how many of a side's pixels is asked, where the picture has so many sides: wherever along
/// the side it is, the tone is the same.
pub(super) fn stride(pixels: usize, sides: usize) -> usize {
    let most = (PIXELS / sides.max(1)).clamp(MIN_PIXELS, MAX_PIXELS);
    pixels.div_ceil(most).max(1)
}

/// Bins are counted from this one, before any pixel; the side's middle parts two.
const FIRST_BIN: f64 = -1e6;

/// Columns of a pixel's row: derivatives by height, base, contrast, blur and spread, by what is
/// shared, and the residual.
const COLUMNS: usize = 5 + SHARED + 1;

/// What is known of the tone curve of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ToneEstimate {
    /// The curve.
    pub curve: PowerCurve,
    /// Covariance of the logarithm of its gamma, and its toe.
    pub covariance: Matrix2<f64>,
    /// Number of sides that told it; without any it is what is usual.
    pub sides: usize,
    /// How far, in root mean square over the profile and parts of the contrast, the mean profile of
    /// these sides is from the model.
    pub misfit: f64,
    /// How far a blur after the coding may hide that all edges were shifted towards the dark, as a
    /// standard deviation in pixels.
    pub hidden_shift: f64,
    /// How far that and the misfit together may shift them.
    pub misfit_shift: f64,
    /// The same where the profiles are those of no curve.
    pub shift_std: Option<f64>,
    /// What the lens adds to the kurtosis of the pixel's box, over 24.
    pub(super) kurtosis: f64,
}

impl ToneEstimate {
    /// Standard deviation of the curve's effective gamma.
    #[must_use]
    pub fn effective_gamma_std(&self) -> f64 {
        self.curve.effective_gamma_std(&self.covariance)
    }

    /// How far a stated curve is from this one, in standard deviations of the effective gamma; zero
    /// where the profiles are those of no curve, and contradict none.
    #[must_use]
    pub fn deviations_from(&self, stated: Tone) -> f64 {
        let stated = stated.power().effective_gamma();
        let away = (self.curve.effective_gamma() - stated).abs() / self.effective_gamma_std();
        if self.shift_std.is_none() && away.is_finite() {
            away
        } else {
            0.0
        }
    }

    /// Whether the sides tell a curve that is nearer to linear light than any usual one.
    pub(super) fn is_like_linear(&self) -> bool {
        self.sides > 0 && self.curve.is_like_linear()
    }

    /// What is to be assumed of the picture from here on.
    #[must_use]
    pub fn picture_tone(&self) -> PictureTone {
        match self.shift_std {
            Some(std) => PictureTone::Shifted(self.curve, std),
            None if self.misfit_shift > 0.0 => {
                PictureTone::Approximated(self.curve, self.misfit_shift)
            }
            None => PictureTone::Estimated(self.curve),
        }
    }
}

/// One side's normal equations with what all sides share, the side's own parameters eliminated.
pub(super) struct ToneShare {
    factor: Cholesky<f64, Const<OWN>>,
    cross: SMatrix<f64, OWN, SHARED>,
    right: SVector<f64, OWN>,
    information: SharedMatrix,
    gradient: Shared,
    profile: ResidualProfile,
    blur: f64,
    /// Whether the profile's asymmetry is the tone curve's alone.
    pub is_sound: bool,
}

impl ToneShare {
    /// From pixels and what the side predicts of them by a tone curve, with the kurtosis of the lens's
    /// blur that is known so far; `None` if they leave one of the side's parameters open.
    pub fn of<'a>(
        side: &SideModel,
        (tone, of_lens): (&ToneCurve, f64),
        pixels: impl Iterator<Item = (&'a Pixel, &'a Prediction)>,
        noise: f64,
    ) -> Option<Self> {
        let inverse_variance = 1.0 / (noise * noise);
        let bins_per_s = side.curve.half_length / BIN_LENGTH;
        let mut profile = ResidualProfile::default();
        let blur = side.mean_blur();
        let of_box = box_kurtosis(&side.curve.along, blur);
        let told = pixels.filter(|(pixel, p)| !p.is_silent && pixel.flip.is_clear());
        let rows = told.map(|(pixel, p)| {
            let [by_gamma, by_toe] = tone.sensitivity(p.light);
            // Edgeworth: the kurtosis adds to Phi(z) a multiple of (z^3 - 3 z) phi(z).
            let by_kurtosis = p.by_offset * blur * p.blurs * (p.blurs * p.blurs - 3.0);
            let residual = p.residual - of_box * by_kurtosis;
            let lighter = side.contrast[0] * pixel.flip.slope;
            profile.add(p.blurs * lighter.signum(), residual - of_lens * by_kurtosis);
            let row = [
                p.by_height,
                p.by_base,
                p.by_contrast,
                p.by_blur,
                side.by_spread(pixel, p),
                by_gamma,
                by_toe,
                by_kurtosis,
                residual,
            ];
            let inverse_variance = inverse_variance * pixel.count;
            let weight = robust_weight(p.residual * p.residual * inverse_variance);
            (pixel.s, weight * inverse_variance, row)
        });
        let sums = SideSums::of(rows, bins_per_s, FIRST_BIN);
        let share = Self::reduced(side, sums, is_sound(side, tone, noise))?;
        let [before, after] = side.plateaus().map(|light| tone.encode_with_slope(light).0);
        Some(Self {
            profile: profile.relative_to(after - before),
            ..share
        })
    }

    fn reduced(side: &SideModel, sums: SideSums<COLUMNS>, is_sound: bool) -> Option<Self> {
        let (all, direct) = sums.assembled::<TOTAL>(side.degrees());
        let mut own = all.fixed_view::<OWN, OWN>(0, 0).into_owned();
        let cross = all.fixed_view::<OWN, SHARED>(0, OWN).into_owned();
        let right = direct.fixed_rows::<OWN>(0).into_owned();
        own[(SPREAD, SPREAD)] += 1.0 / (SPREAD_STD * SPREAD_STD);
        let factor = own.cholesky()?;
        let square = all.fixed_view::<SHARED, SHARED>(OWN, OWN);
        let direct = direct.fixed_rows::<SHARED>(OWN);
        Some(Self {
            information: square - cross.tr_mul(&factor.solve(&cross)),
            gradient: direct - cross.tr_mul(&factor.solve(&right)),
            factor,
            cross,
            right,
            profile: ResidualProfile::default(),
            blur: side.mean_blur(),
            is_sound,
        })
    }

    /// The step of the side's own parameters that goes with one of what is shared.
    pub fn own_step(&self, step: &Shared) -> SVector<f64, OWN> {
        self.factor.solve(&(self.right - self.cross * step))
    }

    /// By what the side's height above its chord changes with what is shared, by the powers of `s`.
    pub fn drift(&self) -> SMatrix<f64, COEFFICIENTS, SHARED> {
        let all = -self.factor.solve(&self.cross);
        all.fixed_rows::<COEFFICIENTS>(0).into_owned()
    }
}

fn is_sound(side: &SideModel, tone: &ToneCurve, noise: f64) -> bool {
    let margin = CLIPPED_VALUE.max(CLIPPED_DEVIATIONS * noise);
    let is_whole = |light| (margin..=1.0 - margin).contains(&tone.encode_with_slope(light).0);
    !side.feels_far_edge && side.plateaus().into_iter().all(is_whole)
}

/// Whether a misfit of the profiles is held against them: not before the curve is the best one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    Full,
    ByMisfit,
}

/// What all sides tell together: a step of what they share, its covariance, and the estimate there.
pub(super) struct Pooled {
    pub step: Shared,
    pub covariance: SharedMatrix,
    pub estimate: ToneEstimate,
}

/// Pools what the sides tell, with what is usual, from `curve` on.
pub(super) fn pool<'a>(
    curve: PowerCurve,
    shares: impl Iterator<Item = &'a ToneShare>,
    trust: Trust,
) -> Pooled {
    let prior = TonePrior::at(&curve);
    let [of_gamma, of_toe] = prior.information;
    let mut information =
        SharedMatrix::from_diagonal(&Shared::new(of_gamma, of_toe, USUAL_KURTOSIS));
    let mut gradient = Shared::new(prior.gradient[0], prior.gradient[1], 0.0);
    let mut sides = 0_u32;
    let mut profile = ResidualProfile::default();
    let mut blurs = 0.0;
    let mut told = (SharedMatrix::zeros(), Shared::zeros());
    for share in shares.filter(|share| share.is_sound && share.blur.is_finite()) {
        told.0 += share.information;
        told.1 += share.gradient;
        profile.merge(&share.profile);
        blurs += share.blur;
        sides += 1;
    }
    let misfit = profile.misfit();
    let trust = match trust {
        Trust::Full => 1.0,
        Trust::ByMisfit => 1.0 / (1.0 + (misfit / TRUSTED_MISFIT).powi(2)),
    };
    information += told.0 * trust;
    gradient += told.1 * trust;
    let fits = sides > 0 && misfit < MAX_MISFIT;
    let mean_blur = blurs / f64::from(sides);
    // The prior alone makes it positive definite, but for overflow.
    let covariance = information
        .try_inverse()
        .unwrap_or_else(SharedMatrix::zeros);
    let step = covariance * gradient;
    let curve = curve.moved(&[step[0], step[1]]);
    let misfit_shift = match sides {
        0 => BLIND_SHIFT_STD,
        _ if fits => SHIFT_PER_FITTED_MISFIT * misfit * mean_blur,
        _ => {
            let of_misfit = (SHIFT_PER_MISFIT * misfit).min(MAX_SHIFT);
            of_misfit.hypot(unread_shift(&curve)) * mean_blur
        }
    };
    let of_curve = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let hidden_shift = match sides {
        0 => 0.0,
        _ => hidden_shift(mean_blur, &curve, curve.effective_gamma_std(&of_curve)),
    };
    let misfit_shift = misfit_shift.hypot(hidden_shift);
    let estimate = ToneEstimate {
        curve,
        covariance: of_curve,
        sides: sides as usize,
        misfit,
        hidden_shift,
        misfit_shift,
        shift_std: (!fits).then_some(misfit_shift),
        kurtosis: step[KURTOSIS_OF_SHARED],
    };
    Pooled {
        step,
        covariance,
        estimate,
    }
}

/// How much farther towards the dark, in blurs, all edges may lie than this curve says, where no curve
/// fits their profiles. A usual one may have coded them all the same: a shoulder, or wings of the blur,
/// hide its asymmetry.
fn unread_shift(curve: &PowerCurve) -> f64 {
    let excess = curve.effective_gamma() - 1.0;
    // A fit that ran away has no effective gamma, and tells nothing.
    let told = if excess.is_nan() {
        0.0
    } else {
        excess / USUAL_EXCESS
    };
    (USUAL_SHIFT * (1.0 - told.clamp(0.0, 1.0))).max(MIN_UNREAD_SHIFT)
}

/// By how much more all edges may lie towards the dark than a curve below the usual ones tells,
/// because the picture was blurred or made smaller after it was coded.
///
/// A usual curve moves an edge of blur `b0` by `c b0` and makes it asymmetric by its third moment,
/// which goes with `b0^3`. A later blur leaves both, but fitted at the whole blur `b` the moment is
/// that of a part `(b0 / b)^3` of the usual excess of gamma, which at `b` moves the edge by
/// `c b (b0 / b)^3` only. A picture's gamma alone does not tell whether its curve is another or was
/// blurred.
fn hidden_shift(blur: f64, curve: &PowerCurve, gamma_std: f64) -> f64 {
    // No more than the estimate leaves open is held for a later blur.
    let excess = curve.effective_gamma() - 1.0 + GAMMA_DEVIATIONS * gamma_std;
    let coded_blur = (excess / USUAL_EXCESS).clamp(0.0, 1.0).cbrt();
    // A fit that ran away has no effective gamma: its misfit tells how far edges may lie off.
    let least = match curve.is_like_linear() {
        true => MIN_BLUR,
        false => MIN_BLUR_OF_SMALLER,
    };
    if !excess.is_finite() || blur * coded_blur < least {
        return 0.0;
    }
    USUAL_SHIFT * blur * (coded_blur - coded_blur.powi(3))
}

/// Estimates the tone curve from the previews of all spans, whose predictions are by the curve to
/// start from, and fits their sides to it; of their pixels those are left that were asked.
pub(super) fn estimate_tone(
    start: PowerCurve,
    previews: &mut [Result<Preview, NoEdge>],
) -> ToneEstimate {
    let sides = previews.len();
    for preview in previews.iter_mut().flatten() {
        preview.thin(stride(preview.pixels.len(), sides));
    }
    let mut power = start;
    let mut kurtosis = 0.0;
    let mut trust = Trust::Full;
    let mut rounds = 0;
    loop {
        rounds += 1;
        let tone = Tone::Power(power).curve();
        let share = |preview: &mut Result<Preview, NoEdge>| {
            let Preview {
                side,
                pixels,
                predictions,
                noise,
                ..
            } = preview.as_mut().ok()?;
            if rounds > 1 {
                side.predict_all(&tone, pixels, predictions);
            }
            let pixels = pixels.iter().zip(&*predictions);
            ToneShare::of(side, (&tone, kurtosis), pixels, *noise)
        };
        let shares: Vec<Option<ToneShare>> = previews.iter_mut().map(share).collect();
        let Pooled { step, estimate, .. } = pool(power, shares.iter().flatten(), trust);
        let cut = (MAX_STEP / step[0].abs()).min(1.0);
        let step = step * cut;
        let next = power.moved(&[step[0], step[1]]);
        for (preview, share) in previews.iter_mut().zip(&shares) {
            if let (Ok(preview), Some(share)) = (preview, share) {
                preview
                    .side
                    .follow(share, &step, [Tone::Power(power), Tone::Power(next)]);
            }
        }
        (power, kurtosis) = (next, step[KURTOSIS_OF_SHARED]);
        let deviations = step[0].powi(2) / estimate.covariance[(0, 0)];
        let settled = cut >= 1.0 && deviations < LAST_STEP * LAST_STEP;
        if rounds == MAX_ROUNDS || (settled && trust == Trust::ByMisfit) {
            share_spread(previews);
            return ToneEstimate {
                curve: power,
                ..estimate
            };
        }
        if settled {
            trust = Trust::ByMisfit;
        }
    }
}

/// Gives all crossed lines whose spread is small the same: a tone curve that is a little off spreads
/// all of them alike, and what a line's own differs by is its noise.
fn share_spread(previews: &mut [Result<Preview, NoEdge>]) {
    let small = previews
        .iter()
        .flatten()
        .filter_map(|preview| preview.side.small_spread());
    let shared = median(small.collect());
    for preview in previews.iter_mut().flatten() {
        if preview.side.small_spread().is_some() {
            preview.side.spread = shared;
        }
    }
}

impl SideModel {
    /// The side's own step, given the tone curve's.
    ///
    /// What the curve's change does to base and contrast is far from linear where there is little
    /// light, but their coded values hardly change: these are kept instead.
    fn follow(&mut self, share: &ToneShare, step: &Shared, [old, new]: [Tone; 2]) {
        let at_old = share.factor.solve(&share.right);
        let mut own = share.own_step(step);
        own.fixed_rows_mut::<{ BLUR - BASE }>(BASE)
            .copy_from(&at_old.fixed_rows::<{ BLUR - BASE }>(BASE));
        self.advance(&own.fixed_rows::<PARAMETERS>(0).into_owned());
        self.spread = self.spread.map(|spread| spread + own[SPREAD]);
        let translated = |light: f64| new.decode(old.encode(light));
        // At both ends of the side and in its middle, on both of its sides.
        let base = PLACES.map(|s| polynomial(&self.base, s));
        let lit =
            PLACES.map(|s| translated(polynomial(&self.base, s) + polynomial(&self.contrast, s)));
        let base = base.map(translated);
        self.base = polynomial_through(base);
        self.contrast = polynomial_through([0, 1, 2].map(|i| lit[i] - base[i]));
    }
}

#[cfg(test)]
mod tests {
    use super::super::blur::BlurShape;
    use super::super::curve::ChordCurve;
    use super::*;
    use nalgebra::Vector2;

    #[test]
    fn no_misfit_shifts_edges_by_more_than_their_blur() {
        let share = |residual: f64, blur: f64| {
            let mut profile = ResidualProfile::default();
            (0..40).for_each(|i| profile.add(0.1 * f64::from(i) - 2.0, residual));
            ToneShare {
                factor: SMatrix::<f64, OWN, OWN>::identity().cholesky().unwrap(),
                cross: SMatrix::zeros(),
                right: SVector::zeros(),
                information: SharedMatrix::identity(),
                gradient: Shared::zeros(),
                profile,
                blur,
                is_sound: true,
            }
        };
        let shares = [share(1.0, 1.5), share(0.9, f64::NAN)];
        let found = pool(Tone::Srgb.power(), shares.iter(), Trust::ByMisfit).estimate;
        assert_eq!(found.sides, 1);
        assert!(found.misfit > 0.5 && found.misfit_shift < 2.0);
        assert_eq!(found.shift_std, Some(found.misfit_shift));
    }

    #[test]
    fn a_curve_that_ran_away_hides_no_more_than_its_misfit() {
        let away = PowerCurve {
            gamma: 0.63,
            toe: -0.21,
        };
        assert!(away.effective_gamma().is_nan());
        assert_eq!(hidden_shift(0.42, &away, 0.1), 0.0);
    }

    #[test]
    fn profiles_of_no_curve_may_be_those_of_a_usual_one() {
        let shift = |gamma| unread_shift(&PowerCurve { gamma, toe: 0.0 });
        let away = PowerCurve {
            gamma: 0.63,
            toe: -0.21,
        };
        assert_eq!(unread_shift(&away), USUAL_SHIFT);
        assert_eq!(shift(0.8), USUAL_SHIFT);
        assert!((shift(1.6) - 0.5 * USUAL_SHIFT).abs() < 1e-12);
        assert_eq!(shift(2.3), MIN_UNREAD_SHIFT);
    }

    #[test]
    fn small_spreads_become_that_of_all_lines() {
        let preview = |spread| {
            Ok(Preview {
                side: SideModel {
                    curve: ChordCurve::chord(Vector2::zeros(), Vector2::new(40.0, 0.0)).unwrap(),
                    base: [0.1, 0.0, 0.0],
                    contrast: [0.7, 0.0, 0.0],
                    blur: [0.9, 0.0, 0.0],
                    blur_degree: 0,
                    shape: BlurShape::NORMAL,
                    spread,
                    feels_far_edge: false,
                },
                noise: 0.01,
                reach: [5.0; 2],
                hidden: Vec::new(),
                pixels: Vec::new(),
                predictions: Vec::new(),
            })
        };
        let spreads = [Some(0.03), Some(-0.02), None, Some(0.01), Some(0.3)];
        let mut previews: Vec<_> = spreads.into_iter().map(preview).collect();
        share_spread(&mut previews);
        let found = previews.iter().flatten().map(|own| own.side.spread);
        assert!(found.eq([Some(0.01), Some(0.01), None, Some(0.01), Some(0.3)]));
    }
}
