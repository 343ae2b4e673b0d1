//! Sub-pixel samples of edges, from the raw pixels around coarse outlines.
//!
//! Every side is modelled as a blurred step seen through the camera's tone curve,
//! `v = g(b + A Phi(d / w))`: `d` is the signed distance to the side's curve, `w` the blur
//! including the pixel's own box, `Phi` the normal distribution function; `b`, `A` and `w` are
//! quadratic along the side. After these are fitted to all pixels of a band, the side is divided
//! into patches a few pixels long, and each patch gives one offset by Gauss-Newton on its own
//! pixels. Patches share no pixels, so that their errors are independent, and each has a known
//! standard deviation, `sigma_I / sqrt(sum J^2)`.

mod band;
mod blur;
mod blur_differences;
mod blur_shape;
mod coarse;
mod curve;
mod displacement;
mod equations;
mod even_part;
mod far_edge;
mod faults;
mod flip;
mod grid_crossings;
mod grid_line;
mod lines_beside;
mod localiser;
mod measured;
mod motion;
mod parts;
mod patches;
mod pattern;
mod pixel_noise;
mod plateaus;
mod prediction;
mod preview;
mod preview_band;
mod profile;
mod side;
mod side_sums;
mod sought;
mod span;
mod surroundings;
mod tag_cells;
mod thinning;
mod tone_fit;

use crate::image::{Picture, PowerCurve, SRGB, Tone, USUAL};
use even_part::tone_of_even_part;
pub use faults::PictureFaults;
use localiser::Localiser;
pub use motion::MotionBlur;
pub use parts::{ColourDisplacements, PartDisplacement};
use preview::Preview;
pub(crate) use profile::ResidualProfile;
use sought::Sought;
pub use span::{EdgeSpan, NoEdge, SpanEdges};
pub(crate) use tone_fit::MAX_MISFIT;
pub use tone_fit::ToneEstimate;

/// Standard deviation (px) of the common displacement of all edges in a picture of two levels: a
/// threshold halfway between dark and light as they are coded moves an edge by half of its blur.
const TWO_LEVEL_SHIFT_STD: f64 = 0.3;

/// The samples of all spans, the estimate of the tone curve from their profiles, and the picture's
/// faults.
pub type Localised = (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate, PictureFaults);

/// Measures the edges along coarsely known spans.
///
/// Returns the samples of every span, in order, or the reason why there are none; the estimate of
/// the tone curve from their profiles, which may contradict `tone`; and the picture's faults. A
/// span should be at least about 12 pixels long. It may leave the picture, and has no samples
/// outside.
///
/// ```
/// use nalgebra::Vector2;
/// use trisquare::{EdgeSpan, Picture, Tone, localise};
///
/// // Dark up to x = 40.25, then light: the column that the edge passes is three quarters dark.
/// let value = |x: usize| match x {
///     0..=39 => 0.2,
///     40 => 0.35,
///     _ => 0.8,
/// };
/// let values = (0..80 * 80).map(|i| value(i % 80)).collect();
/// let picture = Picture::from_f32(80, 80, 1, values)?;
/// // Upwards, its right-hand side is the light one.
/// let span = EdgeSpan::new(vec![Vector2::new(41.0, 70.0), Vector2::new(39.0, 10.0)], 1.0);
/// let (mut found, _, _) = localise(&picture, &[span], Tone::Linear);
/// let edge = found.remove(0)?;
/// assert!(edge.points.iter().all(|point| (point.x - 40.25).abs() < 0.05));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Each element may be a [`NoEdge`]; all are [`NoEdge::InvalidArgument`] if the tone is not
/// [valid](Tone::is_valid).
#[must_use]
pub fn localise(picture: &Picture, spans: &[EdgeSpan], tone: Tone) -> Localised {
    if !tone.is_valid() {
        let (_, estimate, faults) = localise(picture, &[], Tone::Srgb);
        let reason = NoEdge::InvalidArgument("the tone curve has no positive, finite gamma");
        return (vec![Err(reason); spans.len()], estimate, faults);
    }
    let mut localiser = Localiser::new(picture, tone);
    let mut sought = Sought::of(localiser.reader(), spans);
    let mut previews = localiser.previews(&mut sought);
    let measured = localiser.measure_all(&sought.spans, &previews);
    let faults = PictureFaults::of(localiser.reader(), &previews);
    let estimate = tone_fit::estimate_tone(tone.power(), &mut previews);
    let edges = measured.into_iter().map(|measured| Ok(measured?.edges));
    (sought.joined(edges), estimate, faults)
}

/// Misfit below which profiles that fit no curve are taken for those of linear light, if the
/// estimate has its gamma. With a larger misfit the estimate is meaningless: squares drawn as sRGB
/// into photographs, beside objects with other profiles, had gammas of 0.7 to 1.2 and misfits of at
/// least 0.0034; linear pictures through JPEG had misfits of 0.0015 to 0.0022.
const LINEAR_MISFIT: f64 = 2.5e-3;
/// Misfit above which linear light may have led to any estimate: for linear pictures without any
/// blur but that of the pixels' boxes it was at least 0.024 with gammas of 2 to 3, and after JPEG
/// 88 at most 0.0042.
const LARGE_MISFIT: f64 = 5e-3;

/// Blur (px) above which the misfit is large for any curve, and only gamma distinguishes linear
/// light from other curves: over 5 rendered scenes each, blurred by 3 to 6.5 px, it was 1.9 to 2.1
/// for sRGB and 0.98 to 1.02 if the blur came after the coding; beside other objects 1.1 to 2.0 and
/// 0.7 to 1.0.
const WIDE_BLUR: f64 = 2.5;
/// Standard deviation, in blurs, of the common displacement of all edges if it is uncertain whether
/// the light is linear or coded by a usual curve: the shift between the two is half a blur.
const UNSURE_SHIFT: f64 = 0.25;

/// Ratio of the relative differences in the edges' shifts to those in their light, from side to
/// side, where no curve fits and edges are shifted by their light. Squares under light that
/// decreases by 30 % over the picture, coded by four curves of phones, had errors in `cx` and `cy`
/// of 3 to 6 standard deviations without this, and of 0.3 to 1.1 with it.
const SHIFT_PER_LIGHT: f64 = 5.0;

/// Measures the edges along coarsely known spans of a picture whose tone curve is unknown.
///
/// The curve is estimated from the asymmetry of the edges' profiles, at first from some of the
/// pixels. The samples measured with that curve are moved, by one linear step, to their positions
/// under the estimate from all pixels.
///
/// If the profiles fit no curve with a blur that is normal but for its kurtosis, the even part of
/// the profiles alone may determine the curve: the blur then has another symmetric shape. If that
/// part fits no curve either (JPEG, sharpening, clipped white), the picture is taken as sRGB, as
/// most are, or as linear light if the profiles are close to that, and one common shift of its
/// edges remains unknown. Over 20 rendered scenes each, error over standard deviation was then 0.9
/// to 1.4, against 1.1 to 2.2 with the wrong estimate.
#[must_use]
pub fn localise_with_unknown_tone(picture: &Picture, spans: &[EdgeSpan]) -> Localised {
    let (edges, estimate, mut faults) = with_best_curve(picture, spans);
    if let Some(shift) = estimate.shift_std {
        let light_error = SHIFT_PER_LIGHT * shift * faults.light_spread;
        faults.side_error = faults.side_error.hypot(light_error);
    }
    (edges, estimate, faults)
}

fn with_best_curve(picture: &Picture, spans: &[EdgeSpan]) -> Localised {
    let mut localiser = Localiser::new(picture, Tone::Power(USUAL));
    let mut sought = Sought::of(localiser.reader(), spans);
    let mut previews = localiser.previews(&mut sought);
    let faults = PictureFaults::of(localiser.reader(), &previews);
    let mut first =
        tone_fit::estimate_tone(USUAL, &mut previews).with_common_error(faults.common_error);
    if picture.has_two_levels() {
        first.shift_std = Some(TWO_LEVEL_SHIFT_STD);
    }
    if first.shift_std.is_none() {
        match with_curve(picture, &sought, &previews, &first) {
            (edges, estimate) if estimate.shift_std.is_none() => {
                return (sought.joined(edges), estimate, faults);
            }
            // All pixels show a misfit that a subset of them did not.
            (_, estimate) => first = estimate.with_common_error(faults.common_error),
        }
    }
    if faults.blur > WIDE_BLUR && !picture.has_two_levels() {
        // From a usual curve a single fit does not reach linear light, so a second fit starts
        // there.
        previews = Localiser::new(picture, Tone::Linear).previews(&mut sought);
        let mut rival = tone_fit::estimate_tone(Tone::Linear.power(), &mut previews);
        if rival.shift_std.is_none() {
            let (edges, estimate) = with_curve(picture, &sought, &previews, &rival);
            match estimate.shift_std {
                None => return (sought.joined(edges), estimate, faults),
                Some(std) => rival.misfit_shift = rival.misfit_shift.max(std),
            }
        }
        let is_sure = rival.is_like_linear() == first.is_like_linear();
        if rival.sides > 0 {
            first = ToneEstimate {
                shift_std: Some(rival.misfit_shift.max(faults.common_error)),
                ..rival
            };
        }
        if !is_sure || first.sides == 0 {
            let std = first.shift_std.unwrap_or_default();
            first.shift_std = Some(std.max(UNSURE_SHIFT * faults.blur));
        }
    }
    let (estimate, previews) = with_held_curve(picture, &mut sought, first, &faults);
    let shift_std = estimate.shift_with_held_curve();
    let measured =
        Localiser::new(picture, Tone::Power(estimate.curve)).measure_all(&sought.spans, &previews);
    let edges = displacement::with_shift_std(measured, shift_std.unwrap_or_default());
    (sought.joined(edges), estimate, faults)
}

/// The estimate for profiles that fit no curve with a normal blur, of which there is a `first`
/// estimate, and the previews with a curve near it: the curve that their even part determines, or
/// else linear light or sRGB.
fn with_held_curve(
    picture: &Picture,
    sought: &mut Sought<'_>,
    first: ToneEstimate,
    faults: &PictureFaults,
) -> (ToneEstimate, Vec<Result<Preview, NoEdge>>) {
    let mut previews_with = |curve| Localiser::new(picture, Tone::Power(curve)).previews(sought);
    let linear = Tone::Linear.power();
    let may_be_linear = first.misfit > LARGE_MISFIT || first.is_like_linear();
    let starts: &[PowerCurve] = match (picture.has_two_levels(), may_be_linear) {
        (true, _) => &[],
        (false, true) => &[SRGB, linear],
        (false, false) => &[SRGB],
    };
    for &start in starts {
        let previews = previews_with(start);
        // From far away the previews are not those of the estimated curve.
        let is_near = |even: &ToneEstimate| even.is_like_linear() == start.is_like_linear();
        if let Some(even) = tone_of_even_part(start, &previews).filter(is_near) {
            return (even.with_common_error(faults.common_error), previews);
        }
    }
    let is_linear =
        first.is_like_linear() && (first.misfit < LINEAR_MISFIT || faults.blur > WIDE_BLUR);
    let curve = if is_linear { linear } else { SRGB };
    // Not those of the start: each pass brings the crossings of a board's lines nearer.
    (ToneEstimate { curve, ..first }, previews_with(curve))
}

/// Measures all spans with an estimated curve, and moves the samples to their positions under the
/// estimate from all pixels, which it returns, too.
fn with_curve(
    picture: &Picture,
    sought: &Sought<'_>,
    previews: &[Result<Preview, NoEdge>],
    first: &ToneEstimate,
) -> (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate) {
    let mut localiser =
        Localiser::new(picture, Tone::Power(first.curve)).with_lens_kurtosis(first.kurtosis);
    let measured = localiser.measure_all(&sought.spans, previews);
    let (edges, mut estimate) = displacement::corrected(first.curve, measured);
    // A misfit that a subset of the pixels does not show is chance, or that of a single side.
    estimate.misfit_shift = estimate.misfit_shift.min(first.misfit_shift);
    (edges, estimate)
}
