//! Sub-pixel samples of edges, from the raw pixels around coarse outlines.
//!
//! Every side is modelled as a blurred step seen through the camera's tone curve,
//! `v = g(b + A Phi(d / w))`: `d` is the signed distance to the side's curve, `w` the blur with the
//! pixel's own box, `Phi` the normal distribution function, `b` and `A` linear along the side.
//! With these fitted to all pixels of a band, the side is cut into patches a few pixels long, and
//! each patch gives one offset by Gauss-Newton on its own pixels. Patches share no pixels, so their
//! errors are independent, and each has a known standard deviation, `sigma_I / sqrt(sum J^2)`.

mod band;
mod blur;
mod blur_shape;
mod coarse;
mod curve;
mod displacement;
mod equations;
mod faults;
mod flip;
mod grid_crossings;
mod grid_line;
mod lines_beside;
mod measured;
mod motion;
mod parts;
mod patches;
mod pattern;
mod pixel_noise;
mod plateaus;
mod prediction;
mod preview;
mod profile;
mod side;
mod side_sums;
mod sought;
mod span;
mod surroundings;
mod tag_cells;
mod thinning;
mod tone_fit;

use crate::image::{GreyReader, Picture, SRGB, Tone, USUAL};
use band::{Band, Pixel};
use blur::BlurShape;
use coarse::CoarseEdge;
pub use faults::PictureFaults;
use grid_crossings::GridCrossings;
use measured::Measured;
pub use motion::MotionBlur;
pub use parts::{ColourDisplacements, PartDisplacement};
use prediction::Prediction;
use preview::Preview;
use side::{BLUR_RANGE, LAST_STEP, Side};
use sought::Sought;
pub use span::{EdgeSpan, NoEdge, SpanEdges};
use surroundings::{FAR_RATIO, far_margin, inner_end, limits, margin, near};
pub use tone_fit::ToneEstimate;
use tone_fit::ToneShare;

/// An edge with a smaller margin, in blurs, is not measured: at twice that distance the next thing
/// takes or adds 2 % of what the edge rises by where it is steepest.
const LEAST_MARGIN_BLURS: f64 = 1.5;
/// The first fit, which only finds curve and blur, uses about this many columns of pixels, one in
/// an odd number: of a steep side they are rows, even and odd ones.
const PREVIEW_COLUMNS: f64 = 50.0;
/// It is made twice: roughly, on the pixels that the coarse edge points to, until a step is below
/// this many pixels; then on those that the result points to.
const LAST_ROUGH_STEP: f64 = 0.1;
const PREVIEW_STEPS: usize = 12;
/// Spread (px) that hardly widens a line's blur, and may be its noise: of AprilGrids that have none,
/// the errors of fx were a quarter larger with the lines' own.
const LEAST_SPREAD: f64 = 0.1;
/// Rounds of a crossed line's spread, and of all else with it.
const SPREAD_ROUNDS: usize = 3;
const FINAL_STEPS: usize = 6;
/// How far all edges of a picture in two levels may lie off (px, standard deviation): a threshold
/// halfway between dark and light as they are coded moves an edge by half of its blur.
const TWO_LEVEL_SHIFT_STD: f64 = 0.3;
/// Contrast over noise below which a step of this length, pixels, or less cannot be told from
/// texture. It is the whole side that shows a step: a longer one may have less, by the root of its
/// length.
const MIN_CONTRAST: f64 = 4.0;
const EVIDENT_LENGTH: f64 = 50.0;
/// Pixels that a fit needs, three for each of its parameters.
const MIN_PIXELS: usize = 30;
/// Fewer samples do not make a line.
const MIN_SAMPLES: usize = 2;

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
    let mut sought = Sought::of(&localiser.reader, spans);
    let mut previews = localiser.previews(&mut sought);
    let measured = localiser.measure_all(&sought.spans, &previews);
    let faults = PictureFaults::of(&localiser.reader, &previews);
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
    let mut localiser = Localiser::new(picture, Tone::Power(USUAL));
    let mut sought = Sought::of(&localiser.reader, spans);
    let mut previews = localiser.previews(&mut sought);
    let faults = PictureFaults::of(&localiser.reader, &previews);
    let mut first = tone_fit::estimate_tone(USUAL, &mut previews);
    if picture.has_two_levels() {
        first.shift_std = Some(TWO_LEVEL_SHIFT_STD);
    } else {
        first.shift_std = first.shift_std.map(|std| std.max(faults.common_error));
    }
    if first.shift_std.is_none() {
        match with_curve(picture, &sought, &previews, &first) {
            (edges, estimate) if estimate.shift_std.is_none() => {
                return (sought.joined(edges), estimate, faults);
            }
            // All pixels show a misfit that some did not.
            (_, estimate) => first = estimate,
        }
    }
    if faults.blur > WIDE_BLUR && !picture.has_two_levels() {
        // A usual curve is too far from the profiles of linear light for one fit to tell the two.
        previews = Localiser::new(picture, Tone::Linear).previews(&mut sought);
        let rival = tone_fit::estimate_tone(Tone::Linear.power(), &mut previews);
        if rival.shift_std.is_none() {
            let (edges, estimate) = with_curve(picture, &sought, &previews, &rival);
            if estimate.shift_std.is_none() {
                return (sought.joined(edges), estimate, faults);
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
    let mut localiser = Localiser::new(picture, Tone::Power(first.curve));
    localiser.tells_tone = true;
    let measured = localiser.measure_all(&sought.spans, previews);
    let (edges, mut estimate) = displacement::corrected(first.curve, measured);
    // A misfit that some pixels do not show is chance, or a single side's.
    estimate.misfit_shift = estimate.misfit_shift.min(first.misfit_shift);
    (edges, estimate)
}

/// What all spans share: the picture's reader, and buffers.
struct Localiser<'a> {
    reader: GreyReader<'a>,
    tone: Tone,
    /// Whether the sides are asked for the tone curve.
    tells_tone: bool,
    /// No noise is taken to be below this.
    noise_floor: f64,
    pixels: Vec<Pixel>,
    /// The pixels of a preview's wider band.
    wide: Vec<Pixel>,
    predictions: Vec<Prediction>,
    residuals: Vec<f64>,
}

impl<'a> Localiser<'a> {
    fn new(picture: &'a Picture, tone: Tone) -> Self {
        Self {
            reader: picture.reader(tone),
            tone,
            tells_tone: false,
            noise_floor: picture.rounding_noise(),
            pixels: Vec::new(),
            wide: Vec::new(),
            predictions: Vec::new(),
            residuals: Vec::new(),
        }
    }

    fn previews(&mut self, sought: &mut Sought<'_>) -> Vec<Result<Preview, NoEdge>> {
        let indices = 0..sought.spans.len();
        let mut previews: Vec<_> = indices.map(|index| self.preview(sought, index)).collect();
        for index in sought.settle_crossings(&self.reader, &previews) {
            previews[index] = self.preview(sought, index);
        }
        previews
    }

    /// Fits a span's edge to some of its pixels, away from its ends.
    fn preview(&mut self, sought: &Sought<'_>, index: usize) -> Result<Preview, NoEdge> {
        let spans = &sought.spans;
        let span = &spans[index];
        let coarse = sought.coarse[index].as_ref().map_err(|&reason| reason)?;
        let is_crossed = !span.crossings.is_empty();
        let mut side = self.first_guess(coarse, is_crossed);
        let length = side.curve.length();
        let end = match is_crossed {
            true => side.curve.half_length,
            false => inner_end(&side),
        };
        let margin = margin(spans, index, &side);
        let within = |width: f64| margin.map(|margin| width.min(margin));
        let crossings = |side: &Side| {
            is_crossed.then(|| GridCrossings::coarse(spans, index, &side.curve, side.edge_shape()))
        };
        let crossed = crossings(&side);
        let band = |curve, near, reach, crossings| Band {
            curve,
            near,
            reach,
            ends: [-end, end],
            limits: Vec::new(),
            hidden: &coarse.hidden,
            crossings,
            stride: 2 * (0.5 * length / PREVIEW_COLUMNS) as usize + 1,
        };
        let narrow = near(&side);
        let curve = side.curve.clone();
        self.gather(&band(curve, narrow, within(narrow), crossed.as_ref()))?;
        self.predict(&side);
        let noise = self.noise_about(&side);
        self.fit(&mut side, noise, (PREVIEW_STEPS, LAST_ROUGH_STEP));
        self.settle_spread(&mut side, noise);

        let near = near(&side).min(margin[0].max(margin[1]));
        let far = (FAR_RATIO * near).min(far_margin(&side, is_crossed));
        let far = within(far.max(near));
        let crossed = crossings(&side);
        let curve = side.curve.clone();
        self.gather(&band(curve, far[0].max(far[1]), far, crossed.as_ref()))?;
        std::mem::swap(&mut self.pixels, &mut self.wide);
        let is_near = |pixel: &&Pixel| side.distance(pixel).abs() <= near;
        self.pixels.clear();
        self.pixels.extend(self.wide.iter().filter(is_near));
        self.predict(&side);
        let noise = self.noise_about(&side);
        self.fit(&mut side, noise, (PREVIEW_STEPS, LAST_STEP));
        self.settle_spread(&mut side, noise);
        side.predict_all(self.reader.curve(), &self.wide, &mut self.predictions);
        let mut noise = self.noise_about(&side);
        // A crossed line's changes of sides assume a normal blur; and what a wrong shape shifts,
        // it shifts to and fro from cell to cell.
        if !is_crossed && side.shape(self.reader.curve(), &self.pixels, noise) {
            side.predict_all(self.reader.curve(), &self.wide, &mut self.predictions);
            noise = self.noise_about(&side);
        }
        // What lies beside the edge is no noise: the patches, which have their own light, tell.
        if !span.is_beside_others {
            self.judge(&side, span.polarity, noise)?;
        }
        if span.margin[0].min(span.margin[1]) < LEAST_MARGIN_BLURS * side.blur {
            return Err(NoEdge::Cramped);
        }
        let reach = plateaus::reach(&side, &self.predictions, noise, near, far);
        let all = self.wide.iter().zip(&self.predictions);
        let within = all.filter(|(p, _)| (-reach[0]..=reach[1]).contains(&side.distance(p)));
        let (mut pixels, mut predictions) = (Vec::new(), Vec::new());
        pixels.reserve_exact(self.wide.len());
        predictions.reserve_exact(self.wide.len());
        for (pixel, prediction) in within {
            pixels.push(*pixel);
            predictions.push(*prediction);
        }
        Ok(Preview {
            side,
            noise,
            reach,
            hidden: coarse.hidden.clone(),
            pixels,
            predictions,
        })
    }

    /// Measures all spans, whose curves are known.
    fn measure_all(
        &mut self,
        spans: &[EdgeSpan],
        previews: &[Result<Preview, NoEdge>],
    ) -> Vec<Result<Measured, NoEdge>> {
        let indices = 0..spans.len();
        indices
            .map(|index| self.measure(spans, index, previews))
            .collect()
    }

    /// Measures a span once its own curve and those it meets are known.
    fn measure(
        &mut self,
        spans: &[EdgeSpan],
        index: usize,
        previews: &[Result<Preview, NoEdge>],
    ) -> Result<Measured, NoEdge> {
        let preview = previews[index].as_ref().map_err(|&reason| reason)?;
        let Preview {
            side,
            noise,
            reach,
            hidden,
            ..
        } = preview;
        let mut side = side.clone();
        let span = &spans[index];
        let is_crossed = !span.crossings.is_empty();
        let found = |line| preview::found(previews, line);
        let crossings = is_crossed
            .then(|| GridCrossings::fitted(spans, index, (&side.curve, side.edge_shape()), found));
        let (ends, limits) = match is_crossed {
            true => ([-1.0, 1.0].map(|s| s * side.curve.half_length), Vec::new()),
            false => limits(span, &side, previews),
        };
        let margin = margin(spans, index, &side);
        let near = near(&side).min(margin[0].max(margin[1]));
        let band = Band {
            curve: side.curve.clone(),
            near,
            reach: [0, 1].map(|i| reach[i].max(near).min(margin[i])),
            ends,
            limits,
            hidden,
            crossings: crossings.as_ref(),
            stride: 1,
        };
        self.gather(&band)?;
        self.predict(&side);
        self.fit(&mut side, *noise, (FINAL_STEPS, LAST_STEP));
        if side.reshape(self.reader.curve(), &self.pixels, *noise) || self.predictions.is_empty() {
            self.predict(&side);
        }
        let (samples, noise) = patches::measure(
            &side,
            self.reader.curve(),
            (&self.pixels, &self.predictions),
            (*noise, self.noise_floor),
            span.is_beside_others,
            &mut self.residuals,
        );
        self.judge(&side, span.polarity, noise)?;
        if samples.points.len() < MIN_SAMPLES {
            return Err(NoEdge::Unmeasurable);
        }
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let share = match self.tells_tone {
            true => {
                let stride = tone_fit::stride(self.pixels.len(), spans.len());
                let asked = thinning::some_of(self.pixels.iter().zip(&self.predictions), stride);
                ToneShare::of(&side, self.reader.curve(), asked, noise)
            }
            false => None,
        };
        let edges = SpanEdges {
            points: samples.points,
            std: samples.std,
            blur: side.blur,
            dark: before.min(after),
            light: before.max(after),
            noise,
            tone_drift: Vec::new(),
        };
        Ok(Measured {
            edges,
            side,
            share,
            is_crossed,
        })
    }

    fn first_guess(&self, coarse: &CoarseEdge, is_crossed: bool) -> Side {
        let [before, after] = coarse.plateaus.map(|coded| self.tone.decode(coded));
        Side {
            curve: coarse.curve.clone(),
            base: [before, 0.0],
            contrast: [after - before, 0.0],
            blur: coarse.blur.clamp(BLUR_RANGE[0], BLUR_RANGE[1]),
            shape: BlurShape::NORMAL,
            blur_slope: 0.0,
            spread: is_crossed.then_some(0.0),
        }
    }

    /// Collects a band's pixels, if there are enough.
    fn gather(&mut self, band: &Band<'_>) -> Result<(), NoEdge> {
        band.gather(&self.reader, &mut self.pixels);
        if self.pixels.len() < MIN_PIXELS {
            return Err(NoEdge::Unmeasurable);
        }
        Ok(())
    }

    /// Predicts the pixels that were gathered.
    fn predict(&mut self, side: &Side) {
        side.predict_all(self.reader.curve(), &self.pixels, &mut self.predictions);
    }

    /// Fits a side, whose predictions there are, to these; afterwards there may be none.
    fn fit(&mut self, side: &mut Side, noise: f64, steps: (usize, f64)) {
        let tone = self.reader.curve();
        side.fit(tone, &self.pixels, &mut self.predictions, noise, steps);
    }

    /// Fits the spread of a crossed line that was fitted, and all else with it, if there is one.
    fn settle_spread(&mut self, side: &mut Side, noise: f64) {
        let Some(before) = side.spread else {
            return;
        };
        for _ in 0..SPREAD_ROUNDS {
            if self.predictions.is_empty() {
                self.predict(side);
            }
            let step = side.fit_spread(&self.pixels, &self.predictions, noise);
            if side
                .spread
                .is_some_and(|spread| spread.abs() < LEAST_SPREAD)
            {
                side.spread = Some(0.0);
            }
            if side.spread == Some(before) || step < LAST_STEP {
                return;
            }
            self.predict(side);
            let noise = self.noise_about(side);
            self.fit(side, noise, (PREVIEW_STEPS, LAST_STEP));
        }
    }

    /// The noise that the last predictions show.
    fn noise_about(&mut self, side: &Side) -> f64 {
        side.edge_noise(&self.predictions, self.noise_floor, &mut self.residuals)
    }

    /// Whether a fitted side is a step of the expected polarity, above the noise.
    fn judge(&self, side: &Side, polarity: f64, noise: f64) -> Result<(), NoEdge> {
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let contrast = polarity.signum() * (after - before);
        let relative_length = EVIDENT_LENGTH / side.curve.length();
        let least = MIN_CONTRAST * noise * relative_length.sqrt().min(1.0);
        let is_step = side.blur < BLUR_RANGE[1] && contrast > least;
        if is_step {
            Ok(())
        } else {
            Err(NoEdge::Unmeasurable)
        }
    }
}
