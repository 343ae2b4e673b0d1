//! Sub-pixel samples of edges, from the raw pixels around coarse outlines.
//!
//! Every side is modelled as a blurred step seen through the camera's tone curve,
//! `v = g(b + A Phi(d / w))`: `d` is the signed distance to the side's curve, `w` the blur with the
//! pixel's own box, `Phi` the normal distribution function, `b`, `A` and `w` quadratic along the side.
//! With these fitted to all pixels of a band, the side is cut into patches a few pixels long, and
//! each patch gives one offset by Gauss-Newton on its own pixels. Patches share no pixels, so their
//! errors are independent, and each has a known standard deviation, `sigma_I / sqrt(sum J^2)`.

mod band;
mod blur;
mod blur_differences;
mod blur_shape;
mod coarse;
mod curve;
mod displacement;
mod equations;
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

use crate::image::{Picture, SRGB, Tone, USUAL};
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

/// How far all edges of a picture in two levels may lie off (px, standard deviation): a threshold
/// halfway between dark and light as they are coded moves an edge by half of its blur.
const TWO_LEVEL_SHIFT_STD: f64 = 0.3;

/// The samples of all spans, what their profiles tell of the tone curve, and of the picture's faults.
pub type Localised = (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate, PictureFaults);

/// Measures the edges along coarsely known spans.
///
/// Gives, for every span in order, its samples or why there are none; and what their profiles tell
/// of the tone curve, which may contradict the stated one. A span needs about 12 pixels of length;
/// it may leave the picture, where it just has no samples.
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

/// Profiles that fit no curve are taken for those of linear light if their estimate has its gamma
/// and a misfit below this. With more misfit the estimate tells nothing: squares drawn as sRGB into
/// photographs, beside things with other profiles, had gammas of 0.7 to 1.2 and misfits from 0.0034
/// on; linear pictures through JPEG had misfits of 0.0015 to 0.0022.
const LINEAR_MISFIT: f64 = 2.5e-3;

/// Of a wider blur (px) the misfit is larger, whatever the curve, and the two are told by gamma
/// alone: over 5 rendered scenes each, blurred by 3 to 6.5 px, it was 1.9 to 2.1 of sRGB and 0.98 to
/// 1.02 where the blur came after the coding; among other things 1.1 to 2.0 and 0.7 to 1.0.
const WIDE_BLUR: f64 = 2.5;
/// Where it is not sure which of the two it is, edges may lie off by the shift between them, half a
/// blur; in blurs, as a standard deviation.
const UNSURE_SHIFT: f64 = 0.25;

/// Where no curve fits, edges are shifted by their light: where that differs from side to side by a
/// part, so do the shifts, by so many times that part of the common one. Squares under light that
/// falls by 30 % over the picture, coded by four curves of phones, had `cx` and `cy` off by 3 to 6 of
/// the standard deviations without this, by 0.3 to 1.1 with it.
const SHIFT_PER_LIGHT: f64 = 5.0;

/// Measures the edges along coarsely known spans of a picture whose tone curve is not known.
///
/// The curve is estimated from the asymmetry of the edges' profiles, at first from some of the
/// pixels; the samples measured with that are moved to where the estimate from all pixels sees
/// them, which one linear step reaches.
///
/// Where the profiles fit no curve (JPEG, sharpening, clipped white) they tell none: the picture is
/// taken as sRGB, as most are, or as linear light where the profiles come near to that, and one
/// common shift of its edges is left open. Over 20 rendered scenes each, error over standard
/// deviation was then 0.9 to 1.4, 1.1 to 2.2 about the misled estimate.
#[must_use]
pub fn localise_with_unknown_tone(picture: &Picture, spans: &[EdgeSpan]) -> Localised {
    let (edges, estimate, mut faults) = with_best_curve(picture, spans);
    if let Some(shift) = estimate.shift_std {
        let own = SHIFT_PER_LIGHT * shift * faults.light_spread;
        faults.side_error = faults.side_error.hypot(own);
    }
    (edges, estimate, faults)
}

fn with_best_curve(picture: &Picture, spans: &[EdgeSpan]) -> Localised {
    let mut localiser = Localiser::new(picture, Tone::Power(USUAL));
    let mut sought = Sought::of(localiser.reader(), spans);
    let mut previews = localiser.previews(&mut sought);
    let faults = PictureFaults::of(localiser.reader(), &previews);
    let with_common_error = |estimate: ToneEstimate| ToneEstimate {
        shift_std: estimate.shift_std.map(|std| std.max(faults.common_error)),
        ..estimate
    };
    let mut first = with_common_error(tone_fit::estimate_tone(USUAL, &mut previews));
    if picture.has_two_levels() {
        first.shift_std = Some(TWO_LEVEL_SHIFT_STD);
    }
    if first.shift_std.is_none() {
        match with_curve(picture, &sought, &previews, &first) {
            (edges, estimate) if estimate.shift_std.is_none() => {
                return (sought.joined(edges), estimate, faults);
            }
            // All pixels show a misfit that some did not.
            (_, estimate) => first = with_common_error(estimate),
        }
    }
    if faults.blur > WIDE_BLUR && !picture.has_two_levels() {
        // A usual curve is too far from the profiles of linear light for one fit to tell the two.
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
    let is_linear =
        first.is_like_linear() && (first.misfit < LINEAR_MISFIT || faults.blur > WIDE_BLUR);
    let assumed = match is_linear {
        true => Tone::Linear.power(),
        false => SRGB,
    };
    let mut localiser = Localiser::new(picture, Tone::Power(assumed));
    let previews = localiser.previews(&mut sought);
    let measured = localiser.measure_all(&sought.spans, &previews);
    let shift_std = first.shift_std.unwrap_or_default();
    let estimate = ToneEstimate {
        curve: assumed,
        ..first
    };
    let edges = displacement::shifted(measured, shift_std);
    (sought.joined(edges), estimate, faults)
}

/// Measures all spans by an estimated curve, moves the samples to where the estimate from all pixels
/// sees them, and gives that.
fn with_curve(
    picture: &Picture,
    sought: &Sought<'_>,
    previews: &[Result<Preview, NoEdge>],
    first: &ToneEstimate,
) -> (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate) {
    let mut localiser =
        Localiser::new(picture, Tone::Power(first.curve)).telling_tone(first.kurtosis);
    let measured = localiser.measure_all(&sought.spans, previews);
    let (edges, mut estimate) = displacement::corrected(first.curve, measured);
    // A misfit that some pixels do not show is chance, or a single side's.
    estimate.misfit_shift = estimate.misfit_shift.min(first.misfit_shift);
    (edges, estimate)
}
