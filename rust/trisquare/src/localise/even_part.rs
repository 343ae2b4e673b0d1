//! Estimate of a tone curve from the even part of the edges' profiles.
//!
//! Any symmetric blur leaves a step in light odd about its edge, whatever the blur's shape: a
//! pixel's box alone, a filter that was applied to the pixels, a lens out of focus. The even part
//! of the decoded profiles is then zero under the right tone curve. With weights that are symmetric
//! about the edge, the odd part has no effect on the estimate.

use nalgebra::{Matrix2, Vector2};

use super::band::Pixel;
use super::pixel_noise::robust_weight;
use super::prediction::Prediction;
use super::preview::Preview;
use super::profile::ResidualProfile;
use super::side::SideModel;
use super::span::NoEdge;
use super::thinning::subset;
use super::tone_fit::{
    MAX_STEP, Pooled, ToneEstimate, ToneShare, Trust, gamma_shift, hidden_shift, is_sound, pool,
    stride,
};
use crate::image::{PowerCurve, Tone, ToneCurve};
use crate::numeric::median;

/// Maximum number of curves that are tried, and the first step of the logarithm of gamma.
const MAX_TRIALS: usize = 7;
const FIRST_STEP: f64 = 0.1;
/// Step, in standard deviations, that ends the search.
const LAST_STEP: f64 = 0.2;
/// Minimum ratio of the change of a step to the change of the curve: below it the even part hardly
/// depends on the curve.
const MIN_SLOPE: f64 = 0.3;
/// Number of standard deviations of gamma by which a curve differs from linear light and is below
/// usual curves if it is neither: the picture was then blurred after it was coded, or it passed
/// through JPEG.
const UNUSUAL_DEVIATIONS: f64 = 3.0;
/// Number of rounds in which a side is fitted to the even part of its profile under one curve.
const SIDE_ROUNDS: usize = 3;
/// Misfit of the even part above which it does not determine the curve.
const MAX_MISFIT: f64 = 1e-3;

/// A side, fitted to the even part of its profile, the pixels that are used, and their noise.
struct SidePixels {
    side: SideModel,
    pixels: Vec<Pixel>,
    noise: f64,
}

/// What the even part of all profiles says about one curve.
struct Trial {
    curve: PowerCurve,
    /// Step of the logarithm of its gamma to the best curve, and its variance, according to a normal
    /// blur.
    step: f64,
    variance: f64,
    /// The estimate according to a normal blur.
    estimate: ToneEstimate,
    /// Median of the sides' blurs, px.
    blur: f64,
}

/// Estimates the gamma of a curve, starting from `start`, the curve of the previews' predictions;
/// `None` if the even part fits no curve, or if the picture was blurred after it was coded.
///
/// The steps are those of a normal blur. Since another blur changes their size, the curve where
/// they vanish is found by the secant method.
pub(super) fn tone_of_even_part(
    start: PowerCurve,
    previews: &[Result<Preview, NoEdge>],
) -> Option<ToneEstimate> {
    let count = previews.len();
    let found = previews.iter().flatten();
    let mut sides: Vec<SidePixels> = found
        .map(|preview| SidePixels::of(preview, count))
        .collect();
    let mut last = trial(&mut sides, [start, start])?;
    let mut change = FIRST_STEP.copysign(last.step);
    for _ in 1..MAX_TRIALS {
        let next = trial(&mut sides, [last.curve, last.curve_at(change)])?;
        let slope = (last.step - next.step) / (next.log_gamma() - last.log_gamma());
        if slope.abs() < MIN_SLOPE {
            return None;
        }
        if next.step.powi(2) < LAST_STEP * LAST_STEP * next.variance {
            return next.accepted(slope);
        }
        change = (next.step / slope).clamp(-MAX_STEP, MAX_STEP);
        // If even the largest gamma that is likely is not usual, the search ends in vain.
        let margin = UNUSUAL_DEVIATIONS * next.variance.sqrt() / slope.abs();
        let most = next.curve_at(change + margin);
        if !most.is_like_linear() && hidden_shift(next.blur, &most, 0.0) > 0.0 {
            return None;
        }
        last = next;
    }
    None
}

/// Tries the second of two curves, given sides that were fitted with the first.
fn trial(sides: &mut [SidePixels], [old, new]: [PowerCurve; 2]) -> Option<Trial> {
    for own in &mut *sides {
        own.side.recode(Tone::Power(old), Tone::Power(new));
    }
    let tone = Tone::Power(new).curve();
    let shares = sides.iter_mut().filter_map(|own| own.settled_share(&tone));
    let shares: Vec<ToneShare> = shares.collect();
    let Pooled {
        step,
        covariance,
        estimate,
    } = pool(new, shares.iter(), Trust::Full);
    // The step with the toe held.
    let by_toe = covariance[(0, 1)] / covariance[(1, 1)];
    Some(Trial {
        curve: new,
        step: step[0] - by_toe * step[1],
        variance: covariance[(0, 0)] - by_toe * covariance[(0, 1)],
        estimate,
        blur: median(shares.iter().map(|share| share.blur).collect())?,
    })
}

impl Trial {
    fn log_gamma(&self) -> f64 {
        self.curve.gamma.ln()
    }

    /// The curve whose logarithm of gamma differs by `change`.
    fn curve_at(&self, change: f64) -> PowerCurve {
        PowerCurve {
            gamma: (self.log_gamma() + change).exp(),
            ..self.curve
        }
    }

    /// The estimate of this curve, given the slope of its step.
    fn accepted(self, slope: f64) -> Option<ToneEstimate> {
        let Self {
            curve,
            estimate,
            blur,
            ..
        } = self;
        let covariance = Matrix2::from_diagonal(&Vector2::new(self.variance / slope.powi(2), 0.0));
        let gamma_std = curve.effective_gamma_std(&covariance);
        let margin = UNUSUAL_DEVIATIONS * gamma_std;
        // No camera's gamma is below 1: JPEG changed the profiles of a curve with a shoulder.
        let is_linear = (curve.effective_gamma() - 1.0).abs() < margin;
        let is_usual = !curve.is_like_linear() && hidden_shift(blur, &curve, margin) == 0.0;
        let is_clear =
            estimate.sides > 0 && estimate.misfit < MAX_MISFIT && (is_linear || is_usual);
        let held_shift = gamma_shift(gamma_std, blur).hypot(estimate.misfit_shift);
        is_clear.then_some(ToneEstimate {
            curve,
            covariance,
            shift_std: None,
            held_shift: Some(held_shift),
            ..estimate
        })
    }
}

impl SidePixels {
    fn of(preview: &Preview, sides: usize) -> Self {
        let stride = stride(preview.pixels.len(), sides);
        Self {
            side: preview.side.clone(),
            pixels: subset(preview.pixels.iter().copied(), stride).collect(),
            noise: preview.noise,
        }
    }

    /// The share of the even part of the side's profile, after fitting the side to that part.
    fn settled_share(&mut self, tone: &ToneCurve) -> Option<ToneShare> {
        let mut predictions = Vec::with_capacity(self.pixels.len());
        for _ in 0..SIDE_ROUNDS {
            self.side.predict_all(tone, &self.pixels, &mut predictions);
            let share = share(&self.side, tone, (&self.pixels, &predictions), self.noise)?;
            self.side.apply_own_step(&share);
        }
        self.side.predict_all(tone, &self.pixels, &mut predictions);
        share(&self.side, tone, (&self.pixels, &predictions), self.noise)
    }
}

/// The share of the even part of a side's profile, in light.
fn share(
    side: &SideModel,
    tone: &ToneCurve,
    (pixels, predictions): (&[Pixel], &[Prediction]),
    noise: f64,
) -> Option<ToneShare> {
    let mut profile = ResidualProfile::default();
    let usable = pixels.iter().zip(predictions);
    let usable = usable.filter(|(pixel, p)| !p.is_silent && pixel.flip.is_clear());
    let rows = usable.map(|(pixel, p)| {
        let mirrored = side.mirrored_light(pixel, p);
        let gains = [p.by_base, tone.encode_with_slope(mirrored).1];
        // The noise of half the sum of a pixel's light and that at its mirror image.
        let noise_of_even = noise * (0.5 * (gains[0].powi(-2) + gains[1].powi(-2))).sqrt();
        let [here, there] = [tone.sensitivity(p.light), tone.sensitivity(mirrored)];
        let by_tone = |k: usize| 0.5 * (here[k] / gains[0] + there[k] / gains[1]);
        let residual = tone.tone().decode(pixel.value) - p.light;
        // Both halves share their bins, so that the odd part cancels.
        profile.add(-p.blurs.abs(), residual);
        let inverse_variance = pixel.count / (noise_of_even * noise_of_even);
        let weight = robust_weight(residual * residual * inverse_variance) * inverse_variance;
        let own = [
            p.by_height,
            p.by_base,
            p.by_contrast,
            p.by_blur,
            side.by_spread(pixel, p),
        ];
        let [by_height, by_base, by_contrast, by_blur, by_spread] = own.map(|own| own / gains[0]);
        let row = [
            by_height,
            by_base,
            by_contrast,
            by_blur,
            by_spread,
            by_tone(0),
            by_tone(1),
            0.0,
            residual,
        ];
        (pixel.s, weight, row)
    });
    let mut share = ToneShare::of_rows(side, rows, is_sound(side, tone, noise))?;
    share.profile = profile.relative_to(side.contrast[0]);
    Some(share)
}
