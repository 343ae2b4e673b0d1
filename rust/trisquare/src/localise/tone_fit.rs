//! Estimate of a picture's tone curve from the profiles of its edges.
//!
//! A blurred step in light is symmetric about its edge; any asymmetry of the coded step is due to
//! the tone curve. Every side has its own curve, base, contrast and blur, which are eliminated. The
//! remaining information of all sides on their shared parameters, those of the tone curve and the
//! kurtosis of the lens's blur, is summed.

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

/// Distance of a side's dark or light from the file's limits below which the side is clipped there,
/// in standard deviations of its noise, and at least as a value: the asymmetry of a clipped profile
/// is not that of the tone curve.
const CLIPPED_DEVIATIONS: f64 = 2.5;
const CLIPPED_VALUE: f64 = 1.5 / 255.0;

/// Maximum number of rounds of the first fit, and the step, in standard deviations of the estimate,
/// that ends it.
const MAX_ROUNDS: usize = 10;
const LAST_STEP: f64 = 0.3;
/// Maximum step of the logarithm of gamma per round.
pub(super) const MAX_STEP: f64 = 0.4;

/// Number of a side's own parameters, including its spread, which has the effect of a shift by a
/// tone curve.
const SIDE_PARAMETERS: usize = PARAMETERS + 1;
const SPREAD: usize = PARAMETERS;
/// Standard deviation (px) of a wide prior on the spread, which keeps the equations regular for a
/// side without any.
const SPREAD_STD: f64 = 1.0;
/// Number of parameters that the sides of a picture share: those of the tone curve, and the
/// kurtosis that the lens adds to that of the pixel's box.
///
/// A pixel's box, a lens out of focus and sharpening all make a blur that is not quite normal, but
/// symmetric. For a curved tone a symmetric misfit looks like another curve: without the box's
/// kurtosis (at a blur of half a pixel) gamma is wrong by 0.2, and by as much without that of a
/// lens that spreads light over a disc of 0.8 pixels.
const SHARED: usize = TONE_PARAMETERS + 1;
/// Index of the kurtosis among the shared parameters; among the parameters of a fit to the pixels
/// it is [`crate::image::KURTOSIS`].
pub(super) const SHARED_KURTOSIS: usize = TONE_PARAMETERS;
/// Values of the shared parameters, or a step of them; of the kurtosis, whose effect is linear,
/// always the value.
pub(super) type Shared = SVector<f64, SHARED>;
pub(super) type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
/// Total number of parameters.
const TOTAL: usize = SIDE_PARAMETERS + SHARED;

/// Misfit of the mean profile, as a fraction of the contrast, at which the information on the tone
/// curve is halved: with a larger misfit, JPEG or sharpening is measured instead. Squares in
/// photographs passed through JPEG 85 had misfits of 0.004 and errors of gamma ten times as large
/// as their noise explains.
const TRUSTED_MISFIT: f64 = 5e-4;
/// Misfit above which the profiles are taken to fit no tone curve at all.
pub(crate) const MAX_MISFIT: f64 = 1.5e-3;
/// Ratio of a side's squared contradiction to the median of all sides above which the side does not
/// count: in clean pictures 2 sides in a million are beyond it by chance.
const MAX_CONTRADICTION: f64 = 12.0;
/// Median of chi square with three degrees of freedom.
const CHI_SQUARE_MEDIAN: f64 = 2.4;
/// Rounds of finding the sides that agree.
const AGREEMENT_ROUNDS: usize = 3;

/// Shift, in blurs per unit of misfit, that a misfit may hide where no curve fits, and where the
/// fitted curve is used. A shift of one blur changes the profile by 0.2 in root mean square over
/// its bins; a third of that remains after a fit, and less where the fitted curve is used. For a
/// fitted curve, k1 of rendered pictures after JPEG 88 to 95 was wrong by 1.5 to 2.5 standard
/// deviations with factors of 0 and 15, and by 0.9 to 1.2 with this one.
const SHIFT_PER_MISFIT: f64 = 15.0;
const SHIFT_PER_FITTED_MISFIT: f64 = 40.0;
/// Upper limit of that shift, in blurs: for any profiles, the edges are located within their blur.
const MAX_SHIFT: f64 = 1.0;
/// Standard deviation of the shift (px) if no side can be used: that of taking sRGB for linear
/// light or the reverse.
const BLIND_SHIFT_STD: f64 = 0.1;

/// Excess of the gamma of usual curves over that of linear light, and their shift of an edge
/// between levels 40 and 215 towards the dark, in blurs.
const USUAL_EXCESS: f64 = 1.2;
const USUAL_SHIFT: f64 = 0.5;
/// Smallest shift, in blurs, that profiles of no curve leave undetermined: frames under S-shaped
/// curves, which determine it to hundredths of that, were shifted by 0.1 to 0.3 where their misfit
/// allowed for 0.03.
const MIN_UNDETERMINED_SHIFT: f64 = 0.1;
/// Number of standard deviations of a gamma by which its difference from the usual one is reduced.
const GAMMA_DEVIATIONS: f64 = 1.0;
/// Smallest blur (px) with which a photograph is coded: that of the pixel's box and some of a lens.
const MIN_BLUR: f64 = 0.4;
/// Same for a photograph that was made smaller afterwards, which makes the box smaller, too.
const MIN_BLUR_OF_SMALLER: f64 = 0.3;

/// Maximum number of pixels that are used, per picture and per side. The camera does not lose
/// accuracy: its own geometry determines most of the effect of a tone curve on it, and the fit to
/// the pixels uses them all.
const PIXELS: usize = 20_000;
const MAX_PIXELS: usize = 1500;

/// Minimum number of pixels per side, which determine the side's own parameters as well.
const MIN_PIXELS: usize = 300;

/// One in this many of a side's pixels is used, in a picture with the given number of sides: the
/// tone is the same everywhere along the side.
pub(super) fn stride(pixels: usize, sides: usize) -> usize {
    let max_pixels = (PIXELS / sides.max(1)).clamp(MIN_PIXELS, MAX_PIXELS);
    pixels.div_ceil(max_pixels).max(1)
}

/// Number of the first bin, before any pixel; the side's middle is a boundary of bins.
const FIRST_BIN: f64 = -1e6;

/// Number of columns of a pixel's row: derivatives with respect to height, base, contrast, blur,
/// spread and the shared parameters, and the residual.
pub(super) const COLUMNS: usize = 5 + SHARED + 1;

/// Estimate of the tone curve of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ToneEstimate {
    /// The curve.
    pub curve: PowerCurve,
    /// Covariance of the logarithm of its gamma and of its toe.
    pub covariance: Matrix2<f64>,
    /// Number of sides used; without any, the curve is the usual one.
    pub sides: usize,
    /// Root mean square difference of the mean profile of these sides from the model, as a fraction
    /// of the contrast.
    pub misfit: f64,
    /// Standard deviation, in pixels, of a shift of all edges towards the dark that a blur after
    /// the coding may hide.
    pub hidden_shift: f64,
    /// Standard deviation, in pixels, of the shift by that and the misfit together.
    pub misfit_shift: f64,
    /// That standard deviation if the profiles fit no curve; `None` if they fit one.
    pub shift_std: Option<f64>,
    /// Standard deviation, in pixels, of a shift of all edges by the curve's uncertainty, if only
    /// the even part of the profiles fits: a fit to the pixels must then hold the curve, since it
    /// would attribute the shape of the blur to it.
    pub held_shift: Option<f64>,
    /// Kurtosis that the lens adds to that of the pixel's box, over 24.
    pub(super) kurtosis: f64,
}

impl ToneEstimate {
    /// Standard deviation of the curve's effective gamma.
    #[must_use]
    pub fn effective_gamma_std(&self) -> f64 {
        self.curve.effective_gamma_std(&self.covariance)
    }

    /// Difference of a stated curve from this one, in standard deviations of the effective gamma;
    /// zero if the profiles fit no curve, as they contradict none.
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

    /// The same estimate with a common shift of at least this standard deviation, px, unless the
    /// curve is to be estimated further.
    pub(super) fn with_common_error(self, std: f64) -> Self {
        Self {
            shift_std: self.shift_std.map(|own| own.max(std)),
            held_shift: self.held_shift.map(|own| own.max(std)),
            ..self
        }
    }

    /// Whether the estimated curve is closer to linear light than any usual one.
    pub(super) fn is_like_linear(&self) -> bool {
        self.sides > 0 && self.curve.is_like_linear()
    }

    /// Standard deviation, in pixels, of a common shift of all edges if later stages hold the curve;
    /// `None` if they estimate it further.
    #[must_use]
    pub fn shift_with_held_curve(&self) -> Option<f64> {
        self.shift_std.or(self.held_shift)
    }

    /// What later stages assume about the picture's coding.
    #[must_use]
    pub fn picture_tone(&self) -> PictureTone {
        match self.shift_with_held_curve() {
            Some(std) => PictureTone::Shifted(self.curve, std),
            None if self.misfit_shift > 0.0 => {
                PictureTone::Approximated(self.curve, self.misfit_shift)
            }
            None => PictureTone::Estimated(self.curve),
        }
    }
}

/// One side's normal equations for the shared parameters, with the side's own parameters
/// eliminated.
pub(super) struct ToneShare {
    factor: Cholesky<f64, Const<SIDE_PARAMETERS>>,
    cross: SMatrix<f64, SIDE_PARAMETERS, SHARED>,
    right: SVector<f64, SIDE_PARAMETERS>,
    information: SharedMatrix,
    gradient: Shared,
    pub profile: ResidualProfile,
    pub blur: f64,
    /// Whether it is a line of a board, with light and dark in turn on either side.
    is_crossed: bool,
    /// Whether the profile's asymmetry is due to the tone curve only.
    pub is_sound: bool,
}

impl ToneShare {
    /// The share of a side, from pixels and the side's predictions for them with a tone curve,
    /// given the current kurtosis of the lens's blur; `None` if they leave one of the side's
    /// parameters undetermined.
    pub fn of<'a>(
        side: &SideModel,
        (tone, lens_kurtosis): (&ToneCurve, f64),
        pixels: impl Iterator<Item = (&'a Pixel, &'a Prediction)>,
        noise: f64,
    ) -> Option<Self> {
        let inverse_variance = 1.0 / (noise * noise);
        let mut profile = ResidualProfile::default();
        let blur = side.mean_blur();
        let pixel_kurtosis = box_kurtosis(&side.curve.along, blur);
        let usable = pixels.filter(|(pixel, p)| !p.is_silent && pixel.flip.is_clear());
        let rows = usable.map(|(pixel, p)| {
            let [by_gamma, by_toe] = tone.sensitivity(p.light);
            // Edgeworth: the kurtosis adds to Phi(z) a multiple of (z^3 - 3 z) phi(z).
            let by_kurtosis = p.by_offset * blur * p.blurs * (p.blurs * p.blurs - 3.0);
            let residual = p.residual - pixel_kurtosis * by_kurtosis;
            let lighter = side.contrast[0] * pixel.flip.slope;
            profile.add(
                p.blurs * lighter.signum(),
                residual - lens_kurtosis * by_kurtosis,
            );
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
        let mut share = Self::of_rows(side, rows, is_sound(side, tone, noise))?;
        let [before, after] = side.plateaus().map(|light| tone.encode_with_slope(light).0);
        share.profile = profile.relative_to(after - before);
        Some(share)
    }

    /// The share of a side, without its profile, from the rows of its pixels, each with its `s` and
    /// a weight.
    pub fn of_rows(
        side: &SideModel,
        rows: impl Iterator<Item = (f64, f64, [f64; COLUMNS])>,
        is_sound: bool,
    ) -> Option<Self> {
        let bins_per_s = side.curve.half_length / BIN_LENGTH;
        let sums = SideSums::of(rows, bins_per_s, FIRST_BIN);
        let (all, direct) = sums.assembled::<TOTAL>(side.degrees());
        let mut side_block = all
            .fixed_view::<SIDE_PARAMETERS, SIDE_PARAMETERS>(0, 0)
            .into_owned();
        let cross = all
            .fixed_view::<SIDE_PARAMETERS, SHARED>(0, SIDE_PARAMETERS)
            .into_owned();
        let right = direct.fixed_rows::<SIDE_PARAMETERS>(0).into_owned();
        side_block[(SPREAD, SPREAD)] += 1.0 / (SPREAD_STD * SPREAD_STD);
        let factor = side_block.cholesky()?;
        let square = all.fixed_view::<SHARED, SHARED>(SIDE_PARAMETERS, SIDE_PARAMETERS);
        let direct = direct.fixed_rows::<SHARED>(SIDE_PARAMETERS);
        Some(Self {
            information: square - cross.tr_mul(&factor.solve(&cross)),
            gradient: direct - cross.tr_mul(&factor.solve(&right)),
            factor,
            cross,
            right,
            profile: ResidualProfile::default(),
            blur: side.mean_blur(),
            is_crossed: side.spread.is_some(),
            is_sound,
        })
    }

    /// Squared deviation of the side's own estimate of the shared parameters from a step of them, in
    /// its variances; zero if the side does not determine them, and for a line of a board: gaps
    /// between its cells make all lines contradict each other.
    fn contradiction(&self, step: &Shared) -> f64 {
        if self.is_crossed {
            return 0.0;
        }
        let gradient = self.gradient - self.information * step;
        self.information
            .cholesky()
            .map_or(0.0, |factor| gradient.dot(&factor.solve(&gradient)))
    }

    /// The step of the side's own parameters with the shared ones held.
    fn own_step(&self) -> SVector<f64, SIDE_PARAMETERS> {
        self.factor.solve(&self.right)
    }

    /// The step of the side's own parameters for a step of the shared ones.
    pub fn side_step(&self, step: &Shared) -> SVector<f64, SIDE_PARAMETERS> {
        self.factor.solve(&(self.right - self.cross * step))
    }

    /// Derivatives of the side's height above its chord, as coefficients of the powers of `s`, with
    /// respect to the shared parameters.
    pub fn drift(&self) -> SMatrix<f64, COEFFICIENTS, SHARED> {
        let all = -self.factor.solve(&self.cross);
        all.fixed_rows::<COEFFICIENTS>(0).into_owned()
    }
}

pub(super) fn is_sound(side: &SideModel, tone: &ToneCurve, noise: f64) -> bool {
    let margin = CLIPPED_VALUE.max(CLIPPED_DEVIATIONS * noise);
    let is_whole = |light| (margin..=1.0 - margin).contains(&tone.encode_with_slope(light).0);
    !side.has_far_edge && side.plateaus().into_iter().all(is_whole)
}

/// Whether a misfit of the profiles reduces their weight: only once the curve is the best one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    Full,
    ByMisfit,
}

/// Result from all sides: a step of the shared parameters, its covariance, and the estimate after
/// it.
pub(super) struct Pooled {
    pub step: Shared,
    pub covariance: SharedMatrix,
    pub estimate: ToneEstimate,
}

/// Combines the shares of the sides with the prior, starting from `curve`.
pub(super) fn pool<'a>(
    curve: PowerCurve,
    shares: impl Iterator<Item = &'a ToneShare>,
    trust: Trust,
) -> Pooled {
    let prior = TonePrior::at(&curve);
    let [gamma_information, toe_information] = prior.information;
    let prior_information = SharedMatrix::from_diagonal(&Shared::new(
        gamma_information,
        toe_information,
        USUAL_KURTOSIS,
    ));
    let prior_gradient = Shared::new(prior.gradient[0], prior.gradient[1], 0.0);
    let sound = shares.filter(|share| share.is_sound && share.blur.is_finite());
    let sound: Vec<_> = sound.collect();
    let agreeing = agreeing(&sound, (&prior_information, &prior_gradient));
    let sides = agreeing.len();
    let mut profile = ResidualProfile::default();
    let mut blurs = 0.0;
    for share in &agreeing {
        profile.merge(&share.profile);
        blurs += share.blur;
    }
    let misfit = profile.misfit();
    let trust = match trust {
        Trust::Full => 1.0,
        Trust::ByMisfit => 1.0 / (1.0 + (misfit / TRUSTED_MISFIT).powi(2)),
    };
    let (side_information, side_gradient) = summed(&agreeing);
    let information = prior_information + side_information * trust;
    let gradient = prior_gradient + side_gradient * trust;
    let has_fit = sides > 0 && misfit < MAX_MISFIT;
    let mean_blur = blurs / sides as f64;
    // The prior makes it positive definite, unless it overflows.
    let covariance = information
        .try_inverse()
        .unwrap_or_else(SharedMatrix::zeros);
    let step = covariance * gradient;
    let curve = curve.moved(&[step[0], step[1]]);
    let misfit_shift = match sides {
        0 => BLIND_SHIFT_STD,
        _ if has_fit => SHIFT_PER_FITTED_MISFIT * misfit * mean_blur,
        _ => {
            let misfit_blurs = (SHIFT_PER_MISFIT * misfit).min(MAX_SHIFT);
            misfit_blurs.hypot(undetermined_shift(&curve)) * mean_blur
        }
    };
    let curve_covariance = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let hidden_shift = match sides {
        0 => 0.0,
        _ => hidden_shift(
            mean_blur,
            &curve,
            curve.effective_gamma_std(&curve_covariance),
        ),
    };
    let misfit_shift = misfit_shift.hypot(hidden_shift);
    let estimate = ToneEstimate {
        curve,
        covariance: curve_covariance,
        sides,
        misfit,
        hidden_shift,
        misfit_shift,
        shift_std: (!has_fit).then_some(misfit_shift),
        held_shift: None,
        kurtosis: step[SHARED_KURTOSIS],
    };
    Pooled {
        step,
        covariance,
        estimate,
    }
}

/// Returns the sides that agree on a step of the shared parameters, at least half of them. The
/// border of a shadow, for example, makes a side contradict the others by hundreds of standard
/// deviations.
fn agreeing<'a>(
    shares: &[&'a ToneShare],
    (prior_information, prior_gradient): (&SharedMatrix, &Shared),
) -> Vec<&'a ToneShare> {
    let mut kept = agreeing_on(shares, &Shared::zeros());
    for _ in 1..AGREEMENT_ROUNDS {
        let (information, gradient) = summed(&kept);
        let Some(factor) = (prior_information + information).cholesky() else {
            break;
        };
        kept = agreeing_on(shares, &factor.solve(&(prior_gradient + gradient)));
    }
    kept
}

/// Returns the sides that do not contradict a step of the shared parameters far more than most do.
fn agreeing_on<'a>(shares: &[&'a ToneShare], step: &Shared) -> Vec<&'a ToneShare> {
    let squares: Vec<f64> = shares.iter().map(|own| own.contradiction(step)).collect();
    let typical = median(squares.clone()).unwrap_or(0.0);
    let limit = MAX_CONTRADICTION * typical.max(CHI_SQUARE_MEDIAN);
    let with_squares = shares.iter().zip(squares);
    let agreeing = with_squares.filter(|(_, square)| *square <= limit);
    agreeing.map(|(share, _)| *share).collect()
}

/// Sums of the sides' information and gradients.
fn summed(shares: &[&ToneShare]) -> (SharedMatrix, Shared) {
    let none = (SharedMatrix::zeros(), Shared::zeros());
    shares.iter().fold(none, |(information, gradient), share| {
        (information + share.information, gradient + share.gradient)
    })
}

/// Additional shift of all edges towards the dark, in blurs, that this curve may lack if no curve
/// fits their profiles. A usual curve may have coded them all the same: a shoulder, or wings of the
/// blur, can hide its asymmetry.
fn undetermined_shift(curve: &PowerCurve) -> f64 {
    let excess = curve.effective_gamma() - 1.0;
    // A fit that diverged has no effective gamma, and gives no information.
    let part = if excess.is_nan() {
        0.0
    } else {
        excess / USUAL_EXCESS
    };
    (USUAL_SHIFT * (1.0 - part.clamp(0.0, 1.0))).max(MIN_UNDETERMINED_SHIFT)
}

/// Standard deviation of the shift of all edges by an uncertain gamma, px.
pub(super) fn gamma_shift(gamma_std: f64, blur: f64) -> f64 {
    USUAL_SHIFT / USUAL_EXCESS * gamma_std * blur
}

/// Additional shift of all edges towards the dark, compared with a curve below the usual ones, if
/// the picture was blurred or made smaller after it was coded.
///
/// A usual curve moves an edge of blur `b0` by `c b0` and gives it a third moment, proportional to
/// `b0^3`. A later blur changes neither. Fitted at the whole blur `b`, however, the moment is that
/// of a fraction `(b0 / b)^3` of the usual excess of gamma, which at `b` moves the edge by only
/// `c b (b0 / b)^3`. A picture's gamma alone does not show whether its curve is another one or was
/// blurred.
pub(super) fn hidden_shift(blur: f64, curve: &PowerCurve, gamma_std: f64) -> f64 {
    // A deficit within the uncertainty of the estimate is not attributed to a later blur.
    let excess = curve.effective_gamma() - 1.0 + GAMMA_DEVIATIONS * gamma_std;
    let coded_blur = (excess / USUAL_EXCESS).clamp(0.0, 1.0).cbrt();
    // A fit that diverged has no effective gamma; its misfit gives the possible displacement of the
    // edges.
    let min_blur = match curve.is_like_linear() {
        true => MIN_BLUR,
        false => MIN_BLUR_OF_SMALLER,
    };
    if !excess.is_finite() || blur * coded_blur < min_blur {
        return 0.0;
    }
    USUAL_SHIFT * blur * (coded_blur - coded_blur.powi(3))
}

/// Estimates the tone curve from the previews of all spans, whose predictions use the curve to
/// start from, and fits their sides to it. The previews keep only the pixels that are used.
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
        let scale = (MAX_STEP / step[0].abs()).min(1.0);
        let step = step * scale;
        let next = power.moved(&[step[0], step[1]]);
        for (preview, share) in previews.iter_mut().zip(&shares) {
            if let (Ok(preview), Some(share)) = (preview, share) {
                preview.side.apply_shared_step(
                    share,
                    &step,
                    [Tone::Power(power), Tone::Power(next)],
                );
            }
        }
        (power, kurtosis) = (next, step[SHARED_KURTOSIS]);
        let deviations = step[0].powi(2) / estimate.covariance[(0, 0)];
        let has_settled = scale >= 1.0 && deviations < LAST_STEP * LAST_STEP;
        if rounds == MAX_ROUNDS || (has_settled && trust == Trust::ByMisfit) {
            share_spread(previews);
            return ToneEstimate {
                curve: power,
                ..estimate
            };
        }
        if has_settled {
            trust = Trust::ByMisfit;
        }
    }
}

/// Gives all crossed lines with a small spread their median spread: a slightly wrong tone curve
/// spreads all of them alike, and the differences between lines are noise.
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
    /// Makes the side's own step for a step of the shared parameters.
    ///
    /// The effect of the curve's change on base and contrast is far from linear where there is
    /// little light, but their coded values hardly change: these are kept instead.
    fn apply_shared_step(&mut self, share: &ToneShare, step: &Shared, [old, new]: [Tone; 2]) {
        let old_step = share.own_step();
        let mut side_step = share.side_step(step);
        side_step
            .fixed_rows_mut::<{ BLUR - BASE }>(BASE)
            .copy_from(&old_step.fixed_rows::<{ BLUR - BASE }>(BASE));
        self.advance_with_spread(&side_step);
        self.recode(old, new);
    }

    /// Makes the side's own step with the shared parameters held.
    pub(super) fn apply_own_step(&mut self, share: &ToneShare) {
        self.advance_with_spread(&share.own_step());
    }

    fn advance_with_spread(&mut self, step: &SVector<f64, SIDE_PARAMETERS>) {
        self.advance(&step.fixed_rows::<PARAMETERS>(0).into_owned());
        self.spread = self.spread.map(|spread| spread + step[SPREAD]);
    }

    /// Replaces the light on both sides of the edge by that which has the same coded values with
    /// another curve.
    pub(super) fn recode(&mut self, old: Tone, new: Tone) {
        let translated = |light: f64| new.decode(old.encode(light));
        // At both ends of the side and in its middle, for both plateaus.
        let base = PLACES.map(|s| polynomial(&self.base, s));
        let light =
            PLACES.map(|s| translated(polynomial(&self.base, s) + polynomial(&self.contrast, s)));
        let base = base.map(translated);
        self.base = polynomial_through(base);
        self.contrast = polynomial_through([0, 1, 2].map(|i| light[i] - base[i]));
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
                factor: SMatrix::<f64, SIDE_PARAMETERS, SIDE_PARAMETERS>::identity()
                    .cholesky()
                    .unwrap(),
                cross: SMatrix::zeros(),
                right: SVector::zeros(),
                information: SharedMatrix::identity(),
                gradient: Shared::zeros(),
                profile,
                blur,
                is_crossed: false,
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
        let shift = |gamma| undetermined_shift(&PowerCurve { gamma, toe: 0.0 });
        let away = PowerCurve {
            gamma: 0.63,
            toe: -0.21,
        };
        assert_eq!(undetermined_shift(&away), USUAL_SHIFT);
        assert_eq!(shift(0.8), USUAL_SHIFT);
        assert!((shift(1.6) - 0.5 * USUAL_SHIFT).abs() < 1e-12);
        assert_eq!(shift(2.3), MIN_UNDETERMINED_SHIFT);
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
                    has_far_edge: false,
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
