//! The model of one side, `v = g(b + A Phi(d / w))`, fitted to the pixels of its band. For a blur
//! that is not normal, `Phi` is replaced by another distribution of variance 1.

use super::band::Pixel;
use super::blur::BlurShape;
use super::curve::{COEFFICIENTS, ChordCurve};
use super::equations::{BASE, BLUR, CONTRAST, Equations, Normal, Step};
use super::flip::EdgeShape;
use super::pixel_noise;
use super::pixel_noise::robust_weight;
use super::prediction::Prediction;
use super::side_sums::{Degrees, LIGHT};
use crate::image::ToneCurve;

/// Bounds of the blur, pixels: a pixel's own box alone has 0.29, and above the upper bound there is
/// no edge to speak of.
pub(super) const BLUR_RANGE: [f64; 2] = [0.3, 10.0];
/// Spread (px) below which it hardly widens a line's blur, and may be noise: for AprilGrids without
/// any spread, the errors of fx were a quarter larger with an estimated spread for each line.
const MIN_SPREAD: f64 = 0.1;
/// Length of a step (px) that ends the iteration: the next one would be quadratically smaller,
/// below a tenth of the best samples' noise, and the patches correct the remainder.
pub(super) const LAST_STEP: f64 = 0.02;
/// Length of a step (px) below which predictions are updated linearly: the error is below 1e-4 of
/// the contrast.
const LAST_FOLLOWED_STEP: f64 = 5e-3;
/// Limits of a step: pixels of position, and factor of the blur.
const MAX_SHIFT: f64 = 1.5;
const MAX_BLUR_RATIO: f64 = 1.6;
const FIRST_DAMPING: f64 = 1e-6;
const DAMPING_RATIO: f64 = 30.0;
/// Number of pixels that are predicted together.
const BLOCK: usize = 16;

/// One side: its curve, and a model of the pixels near it.
#[derive(Debug, Clone)]
pub(super) struct SideModel {
    pub curve: ChordCurve,
    /// Light where the distance is negative, as coefficients of the powers of `s`: lenses darken
    /// the corners of their pictures (25 % of the light there changed fx by 0.1 % when this was
    /// linear).
    pub base: [f64; LIGHT],
    /// Rise of the light across the edge, likewise.
    pub contrast: [f64; LIGHT],
    /// Standard deviation of the blur with the pixel's own box, pixels, likewise: a lens blurs the
    /// corners of its picture more, and the angle between a bent side and a motion changes along
    /// the side. With one blur of .6 to .85 px per side, a curved tone changed fx by four standard
    /// deviations.
    pub blur: [f64; LIGHT],
    /// Degree in `s` of the blur.
    pub blur_degree: usize,
    /// The blur's shape.
    pub shape: BlurShape,
    /// Displacement of the edges of a crossed line from the curve towards their light, pixels:
    /// where ink has spread, or the cells of a board do not touch. `None` without crossings, where
    /// the curve itself includes it.
    pub spread: Option<f64>,
    /// Whether the far edge of a thin bar is modelled beside it; the asymmetry of its profile is
    /// then not that of a tone curve.
    pub has_far_edge: bool,
}

/// Position of a pixel in the blur of its edge.
#[derive(Clone, Copy, Default)]
struct Place {
    blurs: f64,
    inverse_blur: f64,
}

/// The light on a pixel, and its derivatives.
#[derive(Clone, Copy, Default)]
struct Light {
    value: f64,
    by_contrast: f64,
    by_blurs: f64,
}

/// A prediction, from its stages; the coded `value` comes with the gain of the tone curve.
#[inline(always)]
fn predicted(pixel: &Pixel, place: Place, light: Light, (value, gain): (f64, f64)) -> Prediction {
    let residual = pixel.value - value;
    let is_silent = pixel.is_clipped && residual <= 0.0;
    let (residual, gain) = if is_silent {
        (0.0, 0.0)
    } else {
        (residual, gain)
    };
    let by_blurs = gain * light.by_blurs;
    let by_distance = by_blurs * place.inverse_blur;
    Prediction {
        residual,
        light: light.value,
        is_silent,
        blurs: place.blurs,
        by_height: -by_distance * pixel.cosine,
        by_base: gain,
        by_contrast: gain * light.by_contrast,
        by_blur: -by_blurs * place.blurs * place.inverse_blur,
        by_offset: -by_distance,
    }
}

/// The value at `s` of a polynomial.
#[inline(always)]
pub(super) fn polynomial(coefficients: &[f64; LIGHT], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

/// Places along a side at which values determine a polynomial: both ends and the middle.
pub(super) const PLACES: [f64; LIGHT] = [-1.0, 0.0, 1.0];

/// The polynomial through values at the [`PLACES`].
pub(super) fn polynomial_through([before, middle, after]: [f64; LIGHT]) -> [f64; LIGHT] {
    let (mean, half) = (0.5 * (before + after), 0.5 * (after - before));
    [middle, half, mean - middle]
}

impl SideModel {
    /// Light on the two sides of the middle of the edge, the negative side first.
    pub fn plateaus(&self) -> [f64; 2] {
        [self.base[0], self.base[0] + self.contrast[0]]
    }

    /// The blur's mean along the side, pixels.
    pub fn mean_blur(&self) -> f64 {
        self.blur[0] + self.blur[2] / 3.0
    }

    /// Distance of a pixel from the curve, positive along its normal.
    #[inline]
    pub fn distance(&self, pixel: &Pixel) -> f64 {
        (pixel.y - self.curve.height(pixel.s)) * pixel.cosine
    }

    /// The shape of the edge's profile, for the lines that it crosses.
    pub fn edge_shape(&self) -> EdgeShape {
        EdgeShape {
            blur: self.mean_blur(),
            spread: self.spread.unwrap_or(0.0),
        }
    }

    /// 1 if the light is on the side to which the normal points, with a [`Flip`](super::flip::Flip)
    /// of this slope, else -1.
    #[inline]
    fn light_sign(&self, slope: f64) -> f64 {
        (self.contrast[0] * slope).signum()
    }

    /// Displacement of the edge from the curve along its normal, with a flip of this slope.
    #[inline]
    pub fn spread_at(&self, slope: f64) -> f64 {
        self.spread.unwrap_or(0.0) * self.light_sign(slope)
    }

    /// Derivative of a prediction with respect to the spread, without the effect of crossings.
    #[inline]
    pub fn by_spread(&self, pixel: &Pixel, prediction: &Prediction) -> f64 {
        match self.spread {
            Some(_) => prediction.by_offset * self.light_sign(pixel.flip.slope),
            None => 0.0,
        }
    }

    /// Modelled light at the mirror image of a pixel's position about the edge.
    pub fn mirrored_light(&self, pixel: &Pixel, prediction: &Prediction) -> f64 {
        let [base, contrast] = [&self.base, &self.contrast].map(|own| polynomial(own, pixel.s));
        2.0 * base + contrast - prediction.light
    }

    /// The fraction of the step at a pixel, and its derivative with respect to an offset of the
    /// edge along its normal, recovered from a prediction that is not silent.
    pub fn step_fraction(&self, pixel: &Pixel, prediction: &Prediction) -> (f64, f64) {
        let contrast = polynomial(&self.contrast, pixel.s);
        let by_light = prediction.by_base;
        (
            prediction.by_contrast / by_light,
            prediction.by_offset / (by_light * contrast),
        )
    }

    /// Predicts one pixel, with the curve moved by `offset` along its normal, and with `base` and
    /// `contrast` added to those of the side.
    pub fn predict(
        &self,
        tone: &ToneCurve,
        pixel: &Pixel,
        offset: f64,
        [base, contrast]: [f64; 2],
    ) -> Prediction {
        let place = self.place(pixel, offset);
        let step = self.shape.step_and_density(place.blurs);
        let light = self.light(pixel, step, [base, contrast]);
        predicted(pixel, place, light, tone.encode_with_slope(light.value))
    }

    /// Predicts all pixels.
    ///
    /// Each stage is computed for a block of pixels at a time, since it has to wait for the stage
    /// before.
    pub fn predict_all(
        &self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        predictions: &mut Vec<Prediction>,
    ) {
        predictions.clear();
        predictions.reserve(pixels.len());
        let mut places = [Place::default(); BLOCK];
        let mut steps = [(0.0, 0.0); BLOCK];
        let mut lights = [Light::default(); BLOCK];
        let mut values = [(0.0, 0.0); BLOCK];
        for block in pixels.chunks(BLOCK) {
            for (place, pixel) in places.iter_mut().zip(block) {
                *place = self.place(pixel, 0.0);
            }
            for (step, place) in steps.iter_mut().zip(&places[..block.len()]) {
                *step = self.shape.step_and_density(place.blurs);
            }
            for ((light, step), pixel) in lights.iter_mut().zip(&steps).zip(block) {
                *light = self.light(pixel, *step, [0.0; 2]);
            }
            for (value, light) in values.iter_mut().zip(&lights[..block.len()]) {
                *value = tone.encode_with_slope(light.value);
            }
            let stages = places.iter().zip(&lights).zip(&values).zip(block);
            predictions.extend(
                stages.map(|(((place, light), value), pixel)| {
                    predicted(pixel, *place, *light, *value)
                }),
            );
        }
    }

    #[inline(always)]
    fn place(&self, pixel: &Pixel, offset: f64) -> Place {
        let inverse_blur = 1.0 / polynomial(&self.blur, pixel.s).max(BLUR_RANGE[0]);
        let offset = self.spread_at(pixel.flip.slope) + offset;
        Place {
            blurs: (self.distance(pixel) - offset) * inverse_blur,
            inverse_blur,
        }
    }

    #[inline(always)]
    fn light(
        &self,
        pixel: &Pixel,
        (step, density): (f64, f64),
        [base, contrast]: [f64; 2],
    ) -> Light {
        let step = pixel.flipped(step);
        let contrast = polynomial(&self.contrast, pixel.s) + contrast;
        // To first order the spread removes as much light near a crossing as elsewhere. The
        // displaced step includes the part proportional to its slope; this is the rest.
        let spread = self.spread.unwrap_or(0.0) / self.blur[0] * (1.0 - pixel.flip.slope.abs());
        let spread_loss = contrast.abs() * spread * density;
        Light {
            value: polynomial(&self.base, pixel.s) + base + contrast * step - spread_loss,
            by_contrast: step,
            by_blurs: contrast * pixel.flip.slope * density,
        }
    }

    /// Fits all parameters by damped Gauss-Newton; `noise` is the expected scale of the residuals.
    ///
    /// The iteration ends with a step shorter than `last_step` pixels, or after `max_steps`. The
    /// side is left at the lowest cost found, except that a last step too small to matter is made
    /// without evaluating its cost. `predictions` are the side's predictions for the pixels, before
    /// and after; they are empty afterwards if the last step was too long for a linear update.
    /// Returns the matrix of the last normal equations.
    pub fn fit(
        &mut self,
        tone: &ToneCurve,
        pixels: &[Pixel],
        predictions: &mut Vec<Prediction>,
        noise: f64,
        (max_steps, last_step): (usize, f64),
    ) -> Normal {
        let along = (self.curve.length(), self.degrees());
        let mut damping = FIRST_DAMPING;
        let mut best = Equations::of(along, pixels, predictions, noise);
        let mut are_current = true;
        for _ in 0..max_steps {
            let Some(step) = best.step(damping) else {
                damping *= DAMPING_RATIO;
                continue;
            };
            let mut next = self.clone();
            let length = next.advance(&step);
            if length < last_step {
                are_current &= length < LAST_FOLLOWED_STEP;
                if are_current {
                    next.update_predictions(self, pixels, predictions);
                }
                *self = next;
                break;
            }
            next.predict_all(tone, pixels, predictions);
            let equations = Equations::of(along, pixels, predictions, noise);
            are_current = equations.cost < best.cost;
            if are_current {
                (*self, best) = (next, equations);
                damping = (damping / DAMPING_RATIO).max(FIRST_DAMPING);
            } else {
                damping *= DAMPING_RATIO;
            }
        }
        if !are_current {
            predictions.clear();
        }
        best.normal
    }

    /// Makes one Gauss-Newton step of the spread with all else held: only the spread's effect
    /// alternates from cell to cell. Returns the length of the step, pixels.
    pub fn step_spread(&mut self, pixels: &[Pixel], predictions: &[Prediction], noise: f64) -> f64 {
        let inverse_variance = 1.0 / (noise * noise);
        let (mut square, mut product) = (0.0, 0.0);
        for (pixel, p) in pixels.iter().zip(predictions) {
            let inverse_variance = inverse_variance * pixel.count;
            let weight = robust_weight(p.residual * p.residual * inverse_variance);
            let by_spread = self.by_spread(pixel, p);
            square += weight * by_spread * by_spread;
            product += weight * by_spread * p.residual;
        }
        let step = match square > 0.0 {
            true => (product / square).clamp(-MAX_SHIFT, MAX_SHIFT),
            false => 0.0,
        };
        self.spread = self.spread.map(|spread| spread + step);
        step.abs()
    }

    /// The spread of a crossed line, if it is so small that it hardly widens the line's blur.
    pub fn small_spread(&self) -> Option<f64> {
        self.spread.filter(|spread| spread.abs() < MIN_SPREAD)
    }

    /// Changes the predictions of a side very near to this one into those of this one, linearly.
    fn update_predictions(
        &self,
        previous: &Self,
        pixels: &[Pixel],
        predictions: &mut [Prediction],
    ) {
        let mut moved = self.curve.clone();
        for (difference, old) in moved
            .coefficients
            .iter_mut()
            .zip(previous.curve.coefficients)
        {
            *difference -= old;
        }
        let base = std::array::from_fn(|k| self.base[k] - previous.base[k]);
        let contrast = std::array::from_fn(|k| self.contrast[k] - previous.contrast[k]);
        let blur = std::array::from_fn(|k| self.blur[k] - previous.blur[k]);
        for (pixel, p) in pixels.iter().zip(predictions) {
            p.residual -= p.by_height * moved.height(pixel.s)
                + p.by_base * polynomial(&base, pixel.s)
                + p.by_contrast * polynomial(&contrast, pixel.s)
                + p.by_blur * polynomial(&blur, pixel.s);
        }
    }

    /// Makes a step, limited to what is plausible; returns the largest change of the edge's
    /// position or of its blur, pixels.
    pub(super) fn advance(&mut self, step: &Step) -> f64 {
        let mut moved = self.curve.clone();
        moved.coefficients = std::array::from_fn(|k| step[k]);
        let shift = moved.greatest_height();
        let scale = (MAX_SHIFT / shift).min(1.0);
        for k in 0..COEFFICIENTS {
            self.curve.coefficients[k] += scale * step[k];
        }
        for k in 0..LIGHT {
            self.base[k] += scale * step[BASE + k];
            self.contrast[k] += scale * step[CONTRAST + k];
        }
        let blur_step = std::array::from_fn(|k| scale * step[BLUR + k]);
        let old = PLACES.map(|s| polynomial(&self.blur, s));
        let new = [0, 1, 2].map(|i| {
            (old[i] + polynomial(&blur_step, PLACES[i]))
                .clamp(old[i] / MAX_BLUR_RATIO, old[i] * MAX_BLUR_RATIO)
                .clamp(BLUR_RANGE[0], BLUR_RANGE[1])
        });
        self.blur = polynomial_through(new);
        let blur_changes = old.iter().zip(new).map(|(old, new)| (new - old).abs());
        blur_changes.fold(scale * shift, f64::max)
    }

    /// Robust standard deviation of the residuals at the edge, at least `floor`.
    pub fn edge_noise(
        &self,
        predictions: &[Prediction],
        floor: f64,
        residuals: &mut Vec<f64>,
    ) -> f64 {
        residuals.clear();
        let at_edge = predictions.iter().filter(|p| p.is_at_edge());
        residuals.extend(at_edge.map(|p| p.residual));
        pixel_noise::scale(residuals, self.edge_parameters(), floor)
    }

    /// Number of parameters that the pixels at the edge determine: those of the curve and of the
    /// blur, and about half of those of base and contrast.
    pub fn edge_parameters(&self) -> f64 {
        let Degrees { curve, light, blur } = self.degrees();
        (curve + light + blur) as f64 + 3.0
    }

    /// The degrees in `s` of the parameters. On a crossed line the effect of curved light or of a
    /// changing blur alternates from cell to cell, as that of a wrong tone curve does, so that they
    /// cannot be distinguished.
    pub fn degrees(&self) -> Degrees {
        Degrees {
            curve: self.curve.degree,
            light: self.spread.map_or(LIGHT - 1, |_| 1),
            blur: self.blur_degree,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::super::flip::Flip;
    use super::*;
    use crate::image::Tone;

    /// Pixels across a step from 0.1 to 1.5 whose edge lies at 0.3, clipped at 1.
    fn clipped_pixels(truth: &SideModel, tone: &ToneCurve) -> Vec<Pixel> {
        let places = (0..40).flat_map(|i| (-6..=6).map(move |j| (i, f64::from(j))));
        let pixels = places.map(|(i, y)| {
            let s = (f64::from(i) - 19.5) / 20.0;
            let mut pixel = Pixel {
                s,
                y: y + 0.37 * s,
                foot: s,
                cosine: 1.0,
                value: 0.0,
                count: 1.0,
                flip: Flip::NONE,
                is_clipped: false,
            };
            let value = -truth.predict(tone, &pixel, 0.0, [0.0; 2]).residual;
            pixel.value = value.min(1.0);
            pixel.is_clipped = value > 1.0;
            pixel
        });
        pixels.collect()
    }

    #[test]
    fn clipped_pixels_only_bound_the_light() {
        let tone = Tone::Srgb.curve();
        let mut curve = ChordCurve::chord(Vector2::zeros(), Vector2::new(40.0, 0.0)).unwrap();
        curve.coefficients[0] = 0.3;
        let truth = SideModel {
            curve,
            base: [0.1, 0.0, 0.0],
            contrast: [1.4, 0.0, 0.0],
            blur: [0.9, 0.0, 0.0],
            blur_degree: 0,
            shape: BlurShape::NORMAL,
            spread: None,
            has_far_edge: false,
        };
        let pixels = clipped_pixels(&truth, &tone);
        assert!(pixels.iter().any(|pixel| pixel.is_clipped));
        let mut side = truth.clone();
        side.curve.coefficients[0] = 0.0;
        (side.contrast[0], side.blur[0]) = (0.9, 0.7);
        let mut predictions = Vec::new();
        side.predict_all(&tone, &pixels, &mut predictions);
        side.fit(&tone, &pixels, &mut predictions, 1e-3, (40, 1e-6));
        assert!((side.curve.coefficients[0] - 0.3).abs() < 1e-4);
        assert!((side.contrast[0] - 1.4).abs() < 1e-3);
        // A pixel far on the light side has no further information.
        let last = pixels.last().unwrap();
        let p = side.predict(&tone, last, 0.0, [0.0; 2]);
        assert!(p.is_silent && p.residual == 0.0 && p.by_offset == 0.0 && p.by_base == 0.0);
    }
}
