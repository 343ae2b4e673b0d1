//! Measures the edges of spans: roughly on some of their pixels at first, then on all, once those
//! that a span meets are known.

use crate::image::{GreyReader, Picture, Tone};

use super::band::{Band, Pixel};
use super::blur::BlurShape;
use super::coarse::CoarseEdge;
use super::equations::Normal;
use super::grid_crossings::GridCrossings;
use super::measured::Measured;
use super::prediction::Prediction;
use super::preview::{self, Preview};
use super::preview_band::PreviewBand;
use super::side::{BLUR_RANGE, LAST_STEP, SideModel};
use super::side_sums::LIGHT;
use super::sought::Sought;
use super::span::{EdgeSpan, NoEdge, SpanEdges};
use super::surroundings::{
    FAR_RATIO, far_margin, margin, near, near_within, refuse_thin_bars, whole_band,
};
use super::tone_fit::{self, ToneShare};
use super::{blur_differences, patches, plateaus, thinning};

/// An edge with a smaller margin, in blurs, is not measured: at twice that distance the next thing
/// takes or adds 2 % of what the edge rises by where it is steepest.
const MIN_MARGIN_BLURS: f64 = 1.5;
/// The first fit is made twice: roughly, on the pixels that the coarse edge points to, until a step
/// is below this many pixels; then on those that the result points to.
const LAST_ROUGH_STEP: f64 = 0.1;
const PREVIEW_STEPS: usize = 12;
/// Rounds of a crossed line's spread, and of all else with it.
const SPREAD_ROUNDS: usize = 3;
const FINAL_STEPS: usize = 6;
/// Rounds in which the two edges of a thin bar settle, each as the other was last seen.
const BAR_ROUNDS: usize = 4;
/// Contrast over noise below which a step of this length, pixels, or less cannot be told from
/// texture. It is the whole side that shows a step: a longer one may have less, by the root of its
/// length.
const MIN_CONTRAST: f64 = 4.0;
const EVIDENT_LENGTH: f64 = 50.0;
/// Pixels that a fit needs, three for each of its parameters.
const MIN_PIXELS: usize = 30;
/// Fewer samples do not make a line.
const MIN_SAMPLES: usize = 2;

/// What all spans share: the picture's reader, and buffers.
pub(super) struct Localiser<'a> {
    reader: GreyReader<'a>,
    tone: Tone,
    /// The kurtosis of the lens's blur, over 24, where the sides are asked for the tone curve.
    lens_kurtosis: Option<f64>,
    /// No noise is taken to be below this.
    noise_floor: f64,
    pixels: Vec<Pixel>,
    /// The pixels of a preview's wider band.
    wide: Vec<Pixel>,
    predictions: Vec<Prediction>,
    residuals: Vec<f64>,
}

impl<'a> Localiser<'a> {
    pub fn new(picture: &'a Picture, tone: Tone) -> Self {
        Self {
            reader: picture.reader(tone),
            tone,
            lens_kurtosis: None,
            noise_floor: picture.rounding_noise(),
            pixels: Vec::new(),
            wide: Vec::new(),
            predictions: Vec::new(),
            residuals: Vec::new(),
        }
    }

    /// The same, but its sides are asked for the tone curve, the lens's blur having this kurtosis.
    pub fn telling_tone(self, lens_kurtosis: f64) -> Self {
        Self {
            lens_kurtosis: Some(lens_kurtosis),
            ..self
        }
    }

    pub fn reader(&self) -> &GreyReader<'a> {
        &self.reader
    }

    /// Fits the edges of all spans to some of their pixels.
    pub fn previews(&mut self, sought: &mut Sought<'_>) -> Vec<Result<Preview, NoEdge>> {
        let indices = 0..sought.spans.len();
        let is_of_bar = |index: &usize| sought.spans[*index].far_edge.is_some();
        let of_bars: Vec<usize> = indices.clone().filter(is_of_bar).collect();
        let mut previews: Vec<_> = indices
            .map(|index| self.preview(sought, index, &[]))
            .collect();
        let moved = sought.settle_crossings(&self.reader, &previews);
        let rounds = std::iter::repeat_n(of_bars, BAR_ROUNDS).flatten();
        for index in moved.into_iter().chain(rounds) {
            previews[index] = self.preview(sought, index, &previews);
        }
        refuse_thin_bars(&sought.spans, &mut previews);
        previews
    }

    /// Fits a span's edge to some of its pixels, away from its ends, with the far edge of a thin bar
    /// where it is known best.
    fn preview<'b>(
        &mut self,
        sought: &'b Sought<'_>,
        index: usize,
        known: &'b [Result<Preview, NoEdge>],
    ) -> Result<Preview, NoEdge> {
        let span = &sought.spans[index];
        let coarse = sought.coarse[index].as_ref().map_err(|&reason| reason)?;
        let is_crossed = !span.crossings.is_empty();
        let mut side = self.first_guess(coarse, is_crossed);
        let around = PreviewBand::about(&side, sought, index, known, self.tone)?;
        let margin = margin(&sought.spans, index, &side);
        let within = |width: f64| margin.map(|margin| width.min(margin));
        let narrow = near(&side);
        self.gather_around(&around, &side, narrow, within(narrow))?;
        self.predict(&side);
        let noise = self.noise_about(&side);
        self.fit(&mut side, noise, (PREVIEW_STEPS, LAST_ROUGH_STEP));
        if !is_crossed {
            side.blur_degree = LIGHT - 1;
        }
        self.settle_spread(&mut side, noise);

        let near = near_within(&side, margin);
        let far = (FAR_RATIO * near).min(far_margin(&side, is_crossed));
        let far = within(far.max(near));
        let far_edge = around.far_edge(&side);
        side.feels_far_edge = far_edge.is_some_and(|far_edge| far_edge.is_felt);
        self.gather_around(&around, &side, far[0].max(far[1]), far)?;
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
        if span.margin[0].min(span.margin[1]) < MIN_MARGIN_BLURS * side.mean_blur() {
            return Err(NoEdge::Cramped);
        }
        let reach = plateaus::reach(&side, &self.predictions, noise, near, far);
        let (pixels, predictions) = self.wide_within(&side, reach);
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
    pub fn measure_all(
        &mut self,
        spans: &[EdgeSpan],
        previews: &[Result<Preview, NoEdge>],
    ) -> Vec<Result<Measured, NoEdge>> {
        let indices = 0..spans.len();
        let mut measured: Vec<_> = indices
            .map(|index| self.measure(spans, index, previews))
            .collect();
        blur_differences::settle(measured.iter_mut().flatten());
        measured
    }

    /// Measures a span once its own curve and those it meets are known.
    fn measure(
        &mut self,
        spans: &[EdgeSpan],
        index: usize,
        previews: &[Result<Preview, NoEdge>],
    ) -> Result<Measured, NoEdge> {
        let preview = previews[index].as_ref().map_err(|&reason| reason)?;
        let noise = &preview.noise;
        let mut side = preview.side.clone();
        let span = &spans[index];
        let is_crossed = !span.crossings.is_empty();
        let found = |line| preview::found(previews, line);
        let crossings = is_crossed
            .then(|| GridCrossings::fitted(spans, index, (&side.curve, side.edge_shape()), found));
        let band = whole_band(spans, index, previews, preview, crossings.as_ref())?;
        side.feels_far_edge = band.far_edge.is_some();
        self.gather(&band)?;
        self.predict(&side);
        let normal = self.fit(&mut side, *noise, (FINAL_STEPS, LAST_STEP));
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
        let share = match self.lens_kurtosis {
            Some(kurtosis) => {
                let stride = tone_fit::stride(self.pixels.len(), spans.len());
                let asked = thinning::some_of(self.pixels.iter().zip(&self.predictions), stride);
                ToneShare::of(&side, (self.reader.curve(), kurtosis), asked, noise)
            }
            None => None,
        };
        let edges = SpanEdges {
            points: samples.points,
            std: samples.std,
            blur: side.mean_blur(),
            dark: before.min(after),
            light: before.max(after),
            noise,
            tone_drift: Vec::new(),
        };
        Ok(Measured {
            edges,
            side,
            normal,
            share,
            is_crossed,
        })
    }

    fn first_guess(&self, coarse: &CoarseEdge, is_crossed: bool) -> SideModel {
        let [before, after] = coarse.plateaus.map(|coded| self.tone.decode(coded));
        SideModel {
            curve: coarse.curve.clone(),
            base: [before, 0.0, 0.0],
            contrast: [after - before, 0.0, 0.0],
            blur: [coarse.blur.clamp(BLUR_RANGE[0], BLUR_RANGE[1]), 0.0, 0.0],
            blur_degree: 0,
            shape: BlurShape::NORMAL,
            spread: is_crossed.then_some(0.0),
            feels_far_edge: false,
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

    /// Collects the pixels of a preview about a side.
    fn gather_around(
        &mut self,
        around: &PreviewBand<'_>,
        side: &SideModel,
        near: f64,
        reach: [f64; 2],
    ) -> Result<(), NoEdge> {
        let crossings = around.crossings(side);
        self.gather(&around.band(side, near, reach, crossings.as_ref()))
    }

    /// The pixels of the wider band within reach of a side, and what was predicted of them.
    fn wide_within(&self, side: &SideModel, reach: [f64; 2]) -> (Vec<Pixel>, Vec<Prediction>) {
        let (mut pixels, mut predictions) = (Vec::new(), Vec::new());
        pixels.reserve_exact(self.wide.len());
        predictions.reserve_exact(self.wide.len());
        for (pixel, prediction) in self.wide.iter().zip(&self.predictions) {
            if (-reach[0]..=reach[1]).contains(&side.distance(pixel)) {
                pixels.push(*pixel);
                predictions.push(*prediction);
            }
        }
        (pixels, predictions)
    }

    /// Predicts the pixels that were gathered.
    fn predict(&mut self, side: &SideModel) {
        side.predict_all(self.reader.curve(), &self.pixels, &mut self.predictions);
    }

    /// Fits a side, whose predictions there are, to these; afterwards there may be none.
    fn fit(&mut self, side: &mut SideModel, noise: f64, steps: (usize, f64)) -> Normal {
        let tone = self.reader.curve();
        side.fit(tone, &self.pixels, &mut self.predictions, noise, steps)
    }

    /// Fits the spread of a crossed line that was fitted, and all else with it, if there is one.
    fn settle_spread(&mut self, side: &mut SideModel, noise: f64) {
        let Some(before) = side.spread else {
            return;
        };
        for _ in 0..SPREAD_ROUNDS {
            if self.predictions.is_empty() {
                self.predict(side);
            }
            let step = side.fit_spread(&self.pixels, &self.predictions, noise);
            if side.small_spread().is_some() {
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
    fn noise_about(&mut self, side: &SideModel) -> f64 {
        side.edge_noise(&self.predictions, self.noise_floor, &mut self.residuals)
    }

    /// Whether a fitted side is a step of the expected polarity, above the noise.
    fn judge(&self, side: &SideModel, polarity: f64, noise: f64) -> Result<(), NoEdge> {
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let contrast = polarity.signum() * (after - before);
        let relative_length = EVIDENT_LENGTH / side.curve.length();
        let least = MIN_CONTRAST * noise * relative_length.sqrt().min(1.0);
        let is_step = side.mean_blur() < BLUR_RANGE[1] && contrast > least;
        if is_step {
            Ok(())
        } else {
            Err(NoEdge::Unmeasurable)
        }
    }
}
