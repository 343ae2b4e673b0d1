//! Measurement of the edges of spans: first roughly on some of their pixels, then on all, once the
//! curves that a span meets are known.

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
    FAR_RATIO, far_margin, margin, near, near_within, reject_thin_bars, whole_band,
};
use super::tone_fit::{self, ToneShare};
use super::{blur_differences, patches, plateaus, thinning};

/// Smallest margin, in blurs, of an edge that is measured: the next edge, at twice that distance,
/// changes the steepest rise of this one by 2 %.
const MIN_MARGIN_BLURS: f64 = 1.5;
/// Step (px) below which the first of two preview fits ends. It uses the pixels near the coarse
/// edge, the second fit those near its result.
const LAST_ROUGH_STEP: f64 = 0.1;
const PREVIEW_STEPS: usize = 12;
/// Maximum number of rounds of fitting a crossed line's spread, and everything else with it.
const SPREAD_ROUNDS: usize = 12;
const FINAL_STEPS: usize = 6;
/// Number of rounds for the two edges of a thin bar, each of which is fitted with the last result
/// for the other.
const BAR_ROUNDS: usize = 4;
/// Contrast over noise below which a step of `EVIDENT_LENGTH` pixels or less cannot be told from
/// texture. All of a side shows its step: for a longer side the threshold decreases with the square
/// root of its length.
const MIN_CONTRAST: f64 = 4.0;
const EVIDENT_LENGTH: f64 = 50.0;
/// Minimum number of pixels for a fit, three for each of its parameters.
const MIN_PIXELS: usize = 30;
/// Minimum number of samples of a line.
const MIN_SAMPLES: usize = 2;

/// The picture's reader and the buffers, which all spans share.
pub(super) struct Localiser<'a> {
    reader: GreyReader<'a>,
    tone: Tone,
    /// Kurtosis of the lens's blur, over 24, if the sides are used to estimate the tone curve.
    lens_kurtosis: Option<f64>,
    /// Lower bound of the noise.
    noise_floor: f64,
    pixels: Vec<Pixel>,
    /// The pixels of a preview's wider band.
    wide_pixels: Vec<Pixel>,
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
            wide_pixels: Vec::new(),
            predictions: Vec::new(),
            residuals: Vec::new(),
        }
    }

    /// The same localiser, with its sides used to estimate the tone curve, for this kurtosis of the
    /// lens's blur.
    pub fn with_lens_kurtosis(self, lens_kurtosis: f64) -> Self {
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
        let is_bar = |index: &usize| sought.spans[*index].far_edge.is_some();
        let bar_spans: Vec<usize> = indices.clone().filter(is_bar).collect();
        let mut previews: Vec<_> = indices
            .map(|index| self.preview(sought, index, &[]))
            .collect();
        let moved = sought.move_crossings(&self.reader, &previews);
        let rounds = std::iter::repeat_n(bar_spans, BAR_ROUNDS).flatten();
        for index in moved.into_iter().chain(rounds) {
            previews[index] = self.preview(sought, index, &previews);
        }
        reject_thin_bars(&sought.spans, &mut previews);
        previews
    }

    /// Fits a span's edge to some of its pixels, away from its ends. The far edge of a thin bar is
    /// taken from `previews`, if it is there.
    fn preview<'b>(
        &mut self,
        sought: &'b Sought<'_>,
        index: usize,
        previews: &'b [Result<Preview, NoEdge>],
    ) -> Result<Preview, NoEdge> {
        let span = &sought.spans[index];
        let coarse = sought.coarse[index].as_ref().map_err(|&reason| reason)?;
        let is_crossed = !span.crossings.is_empty();
        let mut side = self.initial_side(coarse, is_crossed);
        let preview_band = PreviewBand::around(&side, sought, index, previews, self.tone)?;
        let margin = margin(&sought.spans, index, &side);
        let within = |width: f64| margin.map(|margin| width.min(margin));
        let narrow = near(&side);
        self.gather_around(&preview_band, &side, narrow, within(narrow))?;
        self.predict(&side);
        let noise = self.edge_noise(&side);
        self.fit(&mut side, noise, (PREVIEW_STEPS, LAST_ROUGH_STEP));
        if !is_crossed {
            side.blur_degree = LIGHT - 1;
        }
        self.refine_spread(&mut side, noise);

        let near = near_within(&side, margin);
        let far = (FAR_RATIO * near).min(far_margin(&side, is_crossed));
        let far = within(far.max(near));
        let far_edge = preview_band.far_edge(&side);
        side.has_far_edge = far_edge.is_some_and(|far_edge| far_edge.is_modelled);
        self.gather_around(&preview_band, &side, far[0].max(far[1]), far)?;
        std::mem::swap(&mut self.pixels, &mut self.wide_pixels);
        let is_near = |pixel: &&Pixel| side.distance(pixel).abs() <= near;
        self.pixels.clear();
        self.pixels.extend(self.wide_pixels.iter().filter(is_near));
        self.predict(&side);
        let noise = self.edge_noise(&side);
        self.fit(&mut side, noise, (PREVIEW_STEPS, LAST_STEP));
        self.refine_spread(&mut side, noise);
        side.predict_all(
            self.reader.curve(),
            &self.wide_pixels,
            &mut self.predictions,
        );
        let mut noise = self.edge_noise(&side);
        // The flips of a crossed line assume a normal blur, and the shift by a wrong shape
        // alternates in sign from cell to cell.
        if !is_crossed && side.fit_shape(self.reader.curve(), &self.pixels, noise) {
            side.predict_all(
                self.reader.curve(),
                &self.wide_pixels,
                &mut self.predictions,
            );
            noise = self.edge_noise(&side);
        }
        // Other objects beside the edge are not noise. Such a side is judged once its patches,
        // which have their own light, are measured.
        if !span.is_beside_others {
            self.check_step(&side, span.polarity, noise)?;
        }
        if span.margin[0].min(span.margin[1]) < MIN_MARGIN_BLURS * side.mean_blur() {
            return Err(NoEdge::Cramped);
        }
        let reach = plateaus::reach(&side, &self.predictions, noise, near, far);
        let (pixels, predictions) = self.pixels_within(&side, reach);
        Ok(Preview {
            side,
            noise,
            reach,
            hidden: coarse.hidden.clone(),
            pixels,
            predictions,
        })
    }

    /// Measures all spans, given their previews.
    pub fn measure_all(
        &mut self,
        spans: &[EdgeSpan],
        previews: &[Result<Preview, NoEdge>],
    ) -> Vec<Result<Measured, NoEdge>> {
        let indices = 0..spans.len();
        let mut measured: Vec<_> = indices
            .map(|index| self.measure(spans, index, previews))
            .collect();
        blur_differences::reduce_blur_changes(measured.iter_mut().flatten());
        measured
    }

    /// Measures a span, given its own curve and those that it meets.
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
        side.has_far_edge = band.far_edge.is_some();
        self.gather(&band)?;
        self.predict(&side);
        let normal = self.fit(&mut side, *noise, (FINAL_STEPS, LAST_STEP));
        if side.refine_shape(self.reader.curve(), &self.pixels, *noise)
            || self.predictions.is_empty()
        {
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
        self.check_step(&side, span.polarity, noise)?;
        if samples.points.len() < MIN_SAMPLES {
            return Err(NoEdge::Unmeasurable);
        }
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let share = match self.lens_kurtosis {
            Some(kurtosis) => {
                let stride = tone_fit::stride(self.pixels.len(), spans.len());
                let sampled = thinning::subset(self.pixels.iter().zip(&self.predictions), stride);
                ToneShare::of(&side, (self.reader.curve(), kurtosis), sampled, noise)
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

    fn initial_side(&self, coarse: &CoarseEdge, is_crossed: bool) -> SideModel {
        let [before, after] = coarse.plateaus.map(|coded| self.tone.decode(coded));
        SideModel {
            curve: coarse.curve.clone(),
            base: [before, 0.0, 0.0],
            contrast: [after - before, 0.0, 0.0],
            blur: [coarse.blur.clamp(BLUR_RANGE[0], BLUR_RANGE[1]), 0.0, 0.0],
            blur_degree: 0,
            shape: BlurShape::NORMAL,
            spread: is_crossed.then_some(0.0),
            has_far_edge: false,
        }
    }

    /// Collects a band's pixels; an error if there are too few.
    fn gather(&mut self, band: &Band<'_>) -> Result<(), NoEdge> {
        band.gather(&self.reader, &mut self.pixels);
        if self.pixels.len() < MIN_PIXELS {
            return Err(NoEdge::Unmeasurable);
        }
        Ok(())
    }

    /// Collects the pixels of a preview around a side.
    fn gather_around(
        &mut self,
        preview_band: &PreviewBand<'_>,
        side: &SideModel,
        near: f64,
        reach: [f64; 2],
    ) -> Result<(), NoEdge> {
        let crossings = preview_band.crossings(side);
        self.gather(&preview_band.band(side, near, reach, crossings.as_ref()))
    }

    /// The pixels of the wider band within reach of a side, and their predictions.
    fn pixels_within(&self, side: &SideModel, reach: [f64; 2]) -> (Vec<Pixel>, Vec<Prediction>) {
        let (mut pixels, mut predictions) = (Vec::new(), Vec::new());
        pixels.reserve_exact(self.wide_pixels.len());
        predictions.reserve_exact(self.wide_pixels.len());
        for (pixel, prediction) in self.wide_pixels.iter().zip(&self.predictions) {
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

    /// Fits a side, given its predictions; afterwards the predictions may be empty.
    fn fit(&mut self, side: &mut SideModel, noise: f64, steps: (usize, f64)) -> Normal {
        let tone = self.reader.curve();
        side.fit(tone, &self.pixels, &mut self.predictions, noise, steps)
    }

    /// Fits the spread of a fitted crossed line, and everything else with it; does nothing for
    /// other sides.
    fn refine_spread(&mut self, side: &mut SideModel, noise: f64) {
        let Some(before) = side.spread else {
            return;
        };
        for _ in 0..SPREAD_ROUNDS {
            if self.predictions.is_empty() {
                self.predict(side);
            }
            let step = side.step_spread(&self.pixels, &self.predictions, noise);
            if side.small_spread().is_some() {
                side.spread = Some(0.0);
            }
            if side.spread == Some(before) || step < LAST_STEP {
                return;
            }
            self.predict(side);
            let noise = self.edge_noise(side);
            self.fit(side, noise, (PREVIEW_STEPS, LAST_STEP));
        }
    }

    /// The noise in the residuals of the last predictions.
    fn edge_noise(&mut self, side: &SideModel) -> f64 {
        side.edge_noise(&self.predictions, self.noise_floor, &mut self.residuals)
    }

    /// Checks that a fitted side is a step of the expected polarity, above the noise.
    fn check_step(&self, side: &SideModel, polarity: f64, noise: f64) -> Result<(), NoEdge> {
        let [before, after] = side.plateaus().map(|light| self.tone.encode(light));
        let contrast = polarity.signum() * (after - before);
        let relative_length = EVIDENT_LENGTH / side.curve.length();
        let min_contrast = MIN_CONTRAST * noise * relative_length.sqrt().min(1.0);
        let is_step = side.mean_blur() < BLUR_RANGE[1] && contrast > min_contrast;
        if is_step {
            Ok(())
        } else {
            Err(NoEdge::Unmeasurable)
        }
    }
}
