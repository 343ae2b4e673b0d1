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
mod flip;
mod grid_crossings;
mod grid_line;
mod measured;
mod patches;
mod pixel_noise;
mod plateaus;
mod preview;
mod profile;
mod side;
mod span;
mod tone_fit;

use crate::image::{GreyReader, Picture, SRGB, Tone, USUAL};
use band::{Band, Pixel, SearchLimit};
use blur::BlurShape;
use coarse::CoarseEdge;
use grid_crossings::GridCrossings;
use measured::Measured;
use preview::Preview;
use side::{BLUR_RANGE, LAST_STEP, Side};
pub use span::{EdgeSpan, NoEdge, SpanEdges};
pub use tone_fit::ToneEstimate;
use tone_fit::ToneShare;

/// How far from the curve pixels hold an edge: so many blurs, and at least so many pixels.
const NEAR_BLURS: f64 = 3.5;
const MIN_NEAR: f64 = 3.0;
/// How far the plateaus beside it are read, at most: so many times further, but only a share of the
/// length, because small targets stand close together.
const FAR_RATIO: f64 = 2.5;
const FAR_SHARE: f64 = 0.25;
/// Of the distance between neighbouring grid lines a line has this much to either side.
const SPACING_SHARE: f64 = 0.5;
/// An edge with a smaller margin, in blurs, is not measured: at twice that distance the next thing
/// takes or adds 2 % of what the edge rises by where it is steepest.
const LEAST_MARGIN_BLURS: f64 = 1.5;
/// Before the neighbours are known, pixels this near to the path's ends are left out, in pixels or
/// as a share of the length, whichever is less.
const END_MARGIN: f64 = 6.0;
const END_MARGIN_SHARE: f64 = 0.2;
/// Once they are known, the band runs this far beyond the path's ends, to meet them.
const EXTENSION: f64 = 6.0;
/// Distance from a neighbour's curve, in its blurs, from which pixels are used. Measured on the
/// corner of a square: the last patch is then off by 0.05 of its standard deviation at a noise of
/// 2 in 255; at 2 blurs it is 0.2, and at 3 the side loses half a blur more at each end.
const BOUND_CLEARANCE: f64 = 2.5;
/// The first fit, which only finds curve and blur, uses about this many columns of pixels.
const PREVIEW_COLUMNS: f64 = 50.0;
/// It is made twice: roughly, on the pixels that the coarse edge points to, until a step is below
/// this many pixels; then on those that the result points to.
const LAST_ROUGH_STEP: f64 = 0.1;
const PREVIEW_STEPS: usize = 12;
const FINAL_STEPS: usize = 6;
/// Contrast over noise below which a step of this length, pixels, or less cannot be told from
/// texture. It is the whole side that shows a step: a longer one may have less, by the root of its
/// length.
const MIN_CONTRAST: f64 = 4.0;
const EVIDENT_LENGTH: f64 = 50.0;
/// Pixels that a fit needs, three for each of its parameters.
const MIN_PIXELS: usize = 30;
/// Fewer samples do not make a line.
const MIN_SAMPLES: usize = 2;

/// Measures the edges along coarsely known spans.
///
/// Gives, for every span in order, its samples or why there are none; and what their profiles tell
/// of the tone curve, which may contradict the stated one. A span needs about 12 pixels of length;
/// it may leave the picture, where it just has no samples.
///
/// # Errors
/// Each element may be a [`NoEdge`].
#[must_use]
pub fn localise(
    picture: &Picture,
    spans: &[EdgeSpan],
    tone: Tone,
) -> (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate) {
    let mut localiser = Localiser::new(picture, tone);
    let mut previews = localiser.previews(spans);
    let measured = localiser.measure_all(spans, &previews);
    let estimate = tone_fit::estimate_tone(tone.power(), &mut previews);
    let edges = measured.into_iter().map(|measured| Ok(measured?.edges));
    (edges.collect(), estimate)
}

/// Measures the edges along coarsely known spans of a picture whose tone curve is not known.
///
/// The curve is estimated from the asymmetry of the edges' profiles, at first from some of the
/// pixels; the samples measured with that are moved to where the estimate from all pixels sees
/// them, which one linear step reaches.
///
/// Where the profiles fit no curve (JPEG, sharpening, clipped white) they tell none: the picture is
/// taken as sRGB, as most are, and one common shift of its edges is left open. Over 20 rendered
/// scenes each, error over standard deviation was then 0.7 to 1.3 (1.9 where a third of the scale
/// is clipped), 1.1 to 2.2 about the misled estimate.
#[must_use]
pub fn localise_with_unknown_tone(
    picture: &Picture,
    spans: &[EdgeSpan],
) -> (Vec<Result<SpanEdges, NoEdge>>, ToneEstimate) {
    let mut localiser = Localiser::new(picture, Tone::Power(USUAL));
    let mut previews = localiser.previews(spans);
    let first = tone_fit::estimate_tone(USUAL, &mut previews).curve;
    let measured = Localiser::new(picture, Tone::Power(first)).measure_all(spans, &previews);
    let (edges, estimate) = displacement::corrected(first, measured);
    let Some(shift_std) = estimate.shift_std else {
        return (edges, estimate);
    };
    let mut localiser = Localiser::new(picture, Tone::Power(SRGB));
    let previews = localiser.previews(spans);
    let measured = localiser.measure_all(spans, &previews);
    let estimate = ToneEstimate {
        curve: SRGB,
        ..estimate
    };
    (displacement::shifted(measured, shift_std), estimate)
}

/// What all spans share: the picture's reader, and buffers.
struct Localiser<'a> {
    reader: GreyReader<'a>,
    tone: Tone,
    /// No noise is taken to be below this.
    noise_floor: f64,
    pixels: Vec<Pixel>,
    /// The pixels of a preview's wider band.
    wide: Vec<Pixel>,
    residuals: Vec<f64>,
}

impl<'a> Localiser<'a> {
    fn new(picture: &'a Picture, tone: Tone) -> Self {
        Self {
            reader: picture.reader(tone),
            tone,
            noise_floor: picture.rounding_noise(),
            pixels: Vec::new(),
            wide: Vec::new(),
            residuals: Vec::new(),
        }
    }

    fn previews(&mut self, spans: &[EdgeSpan]) -> Vec<Result<Preview, NoEdge>> {
        let indices = 0..spans.len();
        indices.map(|index| self.preview(spans, index)).collect()
    }

    /// Finds a span's edge and fits it to some of its pixels, away from its ends.
    fn preview(&mut self, spans: &[EdgeSpan], index: usize) -> Result<Preview, NoEdge> {
        let span = &spans[index];
        let is_crossed = !span.crossings.is_empty();
        let coarse = match is_crossed {
            true => grid_line::find(&self.reader, spans, index)?,
            false => coarse::find(&self.reader, span)?,
        };
        let mut side = self.first_guess(&coarse);
        let length = side.curve.length();
        let end = match is_crossed {
            true => side.curve.half_length,
            false => inner_end(&side),
        };
        let margin = margin(spans, index, &side);
        let within = |width: f64| margin.map(|margin| width.min(margin));
        let crossings = |side: &Side| {
            is_crossed.then(|| GridCrossings::coarse(spans, index, &side.curve, side.blur))
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
            stride: (length / PREVIEW_COLUMNS) as usize + 1,
        };
        let narrow = near(&side);
        let curve = side.curve.clone();
        self.gather(&band(curve, narrow, within(narrow), crossed.as_ref()))?;
        let noise = self.noise_about(&side);
        let steps = (PREVIEW_STEPS, LAST_ROUGH_STEP);
        side.fit(self.reader.curve(), &self.pixels, noise, steps);

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
        let noise = self.noise_about(&side);
        let steps = (PREVIEW_STEPS, LAST_STEP);
        side.fit(self.reader.curve(), &self.pixels, noise, steps);
        let noise = self.noise_about(&side);
        // A crossed line's changes of sides assume a normal blur; and what a wrong shape shifts,
        // it shifts to and fro from cell to cell.
        let reshaped = !is_crossed && side.shape(self.reader.curve(), &self.pixels, noise);
        let noise = match reshaped {
            true => self.noise_about(&side),
            false => noise,
        };
        self.judge(&side, span.polarity, noise)?;
        if span.margin[0].min(span.margin[1]) < LEAST_MARGIN_BLURS * side.blur {
            return Err(NoEdge::Cramped);
        }
        let reach = plateaus::reach(&side, self.reader.curve(), &self.wide, noise, near, far);
        let pixels = self.wide_within(&side, reach);
        Ok(Preview {
            side,
            noise,
            reach,
            hidden: coarse.hidden,
            pixels,
        })
    }

    /// The pixels of the wider band that lie within reach of a side.
    fn wide_within(&self, side: &Side, [before, after]: [f64; 2]) -> Vec<Pixel> {
        let all = self.wide.iter();
        all.filter(|pixel| (-before..=after).contains(&side.distance(pixel)))
            .copied()
            .collect()
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
        let found = |line: usize| {
            let found: &Preview = previews.get(line)?.as_ref().ok()?;
            Some((&found.side.curve, found.side.blur))
        };
        let crossings = is_crossed
            .then(|| GridCrossings::fitted(spans, index, (&side.curve, side.blur), found));
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
        side.fit(
            self.reader.curve(),
            &self.pixels,
            *noise,
            (FINAL_STEPS, LAST_STEP),
        );
        side.reshape(self.reader.curve(), &self.pixels, *noise);
        let (samples, noise) = patches::measure(
            &side,
            self.reader.curve(),
            &self.pixels,
            *noise,
            self.noise_floor,
            &mut self.residuals,
        );
        self.judge(&side, span.polarity, noise)?;
        if samples.points.len() < MIN_SAMPLES {
            return Err(NoEdge::Unmeasurable);
        }
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let share = match self.tone {
            Tone::Power(_) => ToneShare::of(&side, self.reader.curve(), &self.pixels, noise),
            _ => None,
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

    fn first_guess(&self, coarse: &CoarseEdge) -> Side {
        let [before, after] = coarse.plateaus.map(|coded| self.tone.decode(coded));
        Side {
            curve: coarse.curve.clone(),
            base: [before, 0.0],
            contrast: [after - before, 0.0],
            blur: coarse.blur.clamp(BLUR_RANGE[0], BLUR_RANGE[1]),
            shape: BlurShape::NORMAL,
            blur_slope: 0.0,
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

    fn noise_about(&mut self, side: &Side) -> f64 {
        side.edge_noise(
            self.reader.curve(),
            &self.pixels,
            self.noise_floor,
            &mut self.residuals,
        )
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

/// How far from a side's curve its edge is felt, pixels.
fn near(side: &Side) -> f64 {
    MIN_NEAR.max(NEAR_BLURS * side.blur)
}

/// How far to either side of an edge its surroundings are its own, pixels.
fn margin(spans: &[EdgeSpan], index: usize, side: &Side) -> [f64; 2] {
    let span = &spans[index];
    if span.crossings.is_empty() {
        return span.margin;
    }
    let spacing = grid_crossings::spacing(spans, index, side.curve.along);
    span.margin
        .map(|margin| margin.min(SPACING_SHARE * spacing))
}

/// The same for plateaus, where nothing crosses the edge and its length has to tell what is not
/// known.
fn far_margin(side: &Side, is_crossed: bool) -> f64 {
    match is_crossed {
        true => f64::INFINITY,
        false => FAR_SHARE * side.curve.length(),
    }
}

/// The end, along the chord, of what surely is edge while the corners are not known.
fn inner_end(side: &Side) -> f64 {
    side.curve.half_length - END_MARGIN.min(END_MARGIN_SHARE * side.curve.length())
}

/// How far along its chord a span's pixels are used, and the neighbours they keep clear of.
fn limits<'a>(
    span: &EdgeSpan,
    side: &Side,
    previews: &'a [Result<Preview, NoEdge>],
) -> ([f64; 2], Vec<SearchLimit<'a>>) {
    let middle = side.curve.point(0.0, 0.0);
    let mut ends = [-inner_end(side), inner_end(side)];
    let mut limits = Vec::with_capacity(2);
    for (end, bound) in ends.iter_mut().zip(span.bounds) {
        if let Some(Ok(neighbour)) = bound.and_then(|bound| previews.get(bound)) {
            let Side { curve, blur, .. } = &neighbour.side;
            let (distance, clearance) = (curve.signed_distance(middle), BOUND_CLEARANCE * blur);
            // A neighbour that runs along this span, or is it, bounds nothing.
            if distance.abs() > clearance {
                let side_of_curve = distance.signum();
                *end = (side.curve.half_length + EXTENSION).copysign(*end);
                limits.push(SearchLimit {
                    curve,
                    side: side_of_curve,
                    clearance,
                });
            }
        }
    }
    (ends, limits)
}
