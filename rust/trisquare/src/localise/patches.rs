//! Independent samples of a fitted side: one offset per short patch of its pixels.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

use super::band::Pixel;
use super::pixel_noise;
use super::pixel_noise::robust_weight;
use super::prediction::Prediction;
use super::side::SideModel;
use crate::image::ToneCurve;

/// Length of a patch along the curve, pixels: longer ones would smooth the distortion of a line,
/// shorter ones have too few pixels to be judged.
const PATCH_LENGTH: f64 = 4.0;
/// Standard deviation of a patch's offset, pixels, above which blur and noise require longer
/// patches: beyond some blurs the step is no longer linear in the offset, and the maximum offset
/// would reject real ones.
const MAX_STD: f64 = 0.35;
/// Minimum number of patches that a side keeps when they are made longer.
const MIN_PATCHES: f64 = 8.0;
/// Minimum information of a patch, as a fraction of the median patch's ...
const MIN_INFORMATION: f64 = 0.25;
/// ... and maximum offset from the side's curve, pixels.
const MAX_OFFSET: f64 = 1.5;
/// Maximum excess over 1 of a patch's mean square residual in variances, in standard deviations of
/// it.
const MAX_CHI_DEVIATIONS: f64 = 6.0;
/// Maximum contribution of a single outlier, in variances, so that it reduces the weight of a patch
/// but does not reject it.
const CHI_CAP: f64 = 16.0;
/// Number of parameters of a patch with its own light that the pixels at the edge determine: its
/// offset, and about half of base and contrast.
const PARAMETERS_IN_LIGHT: f64 = 2.0;
/// Noise, coded, for which no residual is an outlier.
const NO_OUTLIERS: f64 = 1e6;
/// Step (px) above which a patch is measured again from its new offset; after a shorter step
/// Gauss-Newton leaves a cubically small error, a fiftieth of the best samples' noise.
const LAST_STEP: f64 = 0.05;

/// The sums of one patch, and the current offset along the curve's normal.
#[derive(Debug, Clone, Copy, Default)]
struct Patch {
    offset: f64,
    /// Last change of the offset; `None` before the first pass.
    step: Option<f64>,
    /// Weighted squares of the modelled value's derivative with respect to the offset.
    information: f64,
    right: f64,
    /// `information` times the foot's coordinate along the chord, and times the sign of the
    /// contrast.
    moment: f64,
    sign: f64,
    light: PatchLight,
    /// Squared residuals at the edge, and the number of them.
    squares: f64,
    edge_pixels: f64,
}

/// Differences of a patch's base and contrast from its side's, and the sums to determine them.
#[derive(Debug, Clone, Copy, Default)]
struct PatchLight {
    shift: Vector2<f64>,
    information: Matrix2<f64>,
    right: Vector2<f64>,
    /// Products with the derivative with respect to the offset.
    cross: Vector2<f64>,
    /// Derivative of the best shift with respect to the offset.
    per_offset: Vector2<f64>,
}

/// Measures a side's samples, and the standard deviation of the residuals about it (at least
/// `floor`), given its expected value.
///
/// With `has_own_light`, every patch has its own base and contrast: where there are other objects
/// beside the edge, those of the side would displace its samples.
pub(super) fn measure(
    side: &SideModel,
    tone: &ToneCurve,
    (pixels, predictions): (&[Pixel], &[Prediction]),
    (expected_noise, floor): (f64, f64),
    has_own_light: bool,
    residuals: &mut Vec<f64>,
) -> (Samples, f64) {
    let mut patches = Patches::over(side, tone, pixels, expected_noise);
    let mut parameters = side.edge_parameters();
    let side_prediction = |index: usize, _: &Pixel, _: &Patch| predictions[index];
    let patch_prediction = |_: usize, pixel: &Pixel, patch: &Patch| {
        side.predict(tone, pixel, patch.offset, patch.light.shift.into())
    };
    residuals.clear();
    if has_own_light {
        patches.have_own_light = true;
        // The patch's light is still that of the side, so that no pixel can be taken for an
        // outlier.
        patches.update(pixels, side_prediction, NO_OUTLIERS, |_| {});
        patches
            .patches
            .iter_mut()
            .for_each(|patch| patch.step = None);
        parameters = PARAMETERS_IN_LIGHT * patches.patches.len() as f64;
        patches.update(pixels, patch_prediction, expected_noise, |r| {
            residuals.push(r)
        });
    } else {
        patches.update(pixels, side_prediction, expected_noise, |r| {
            residuals.push(r)
        });
    }
    let noise = pixel_noise::scale(residuals, parameters, floor);
    if patches.patches.iter().any(Patch::is_unsettled) {
        patches.update(pixels, patch_prediction, noise, |_| {});
    }
    (patches.samples(side, noise), noise)
}

/// Sub-pixel points, and the standard deviation of each along the side's normal.
pub(super) struct Samples {
    pub points: Vec<Vector2<f64>>,
    pub std: Vec<f64>,
}

/// The patches of a side: equal parts of the range that its pixels' feet cover.
struct Patches {
    patches: Vec<Patch>,
    first: f64,
    per_s: f64,
    have_own_light: bool,
}

impl Patches {
    fn over(side: &SideModel, tone: &ToneCurve, pixels: &[Pixel], noise: f64) -> Self {
        let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
        for pixel in pixels {
            first = first.min(pixel.foot);
            last = last.max(pixel.foot);
        }
        let length = ((last - first) * side.curve.half_length).max(0.0);
        let count = (length / patch_length(side, tone, noise, length))
            .round()
            .max(1.0);
        Self {
            patches: vec![Patch::default(); count as usize],
            first,
            per_s: count * side.curve.half_length / length.max(PATCH_LENGTH),
            have_own_light: false,
        }
    }

    /// Makes one Gauss-Newton step of the offset of every unsettled patch, and passes the residuals
    /// at the edge to `record_residual`.
    ///
    /// `prediction` returns the prediction for a pixel, given its index and its patch.
    fn update(
        &mut self,
        pixels: &[Pixel],
        prediction: impl Fn(usize, &Pixel, &Patch) -> Prediction,
        noise: f64,
        mut record_residual: impl FnMut(f64),
    ) {
        for patch in self.patches.iter_mut().filter(|p| p.is_unsettled()) {
            *patch = Patch {
                offset: patch.offset,
                step: patch.step,
                light: PatchLight {
                    shift: patch.light.shift,
                    ..PatchLight::default()
                },
                ..Patch::default()
            };
        }
        let inverse_variance = 1.0 / (noise * noise);
        let last = self.patches.len() - 1;
        for (number, pixel) in pixels.iter().enumerate() {
            let index = ((pixel.foot - self.first) * self.per_s) as u32 as usize;
            let patch = &mut self.patches[index.min(last)];
            if !patch.is_unsettled() {
                continue;
            }
            let p = prediction(number, pixel, patch);
            let square = p.residual * p.residual * inverse_variance;
            let weight = robust_weight(square);
            let weighted = weight * p.by_offset;
            if self.have_own_light {
                let by_light = Vector2::new(p.by_base, p.by_contrast);
                let counted = by_light * (weight * pixel.count);
                patch.light.information += counted * by_light.transpose();
                patch.light.right += counted * p.residual;
                patch.light.cross += by_light * weighted;
            }
            patch.information += weighted * p.by_offset;
            patch.right += weighted * p.residual;
            patch.moment += weighted * p.by_offset * pixel.foot;
            patch.sign += weighted * p.by_offset * pixel.flip.slope.signum();
            if p.is_at_edge() {
                patch.squares += square.min(CHI_CAP) * noise * noise;
                patch.edge_pixels += 1.0;
                record_residual(p.residual);
            }
        }
        for patch in self.patches.iter_mut().filter(|p| p.is_unsettled()) {
            patch.advance(self.have_own_light);
        }
    }

    /// The reliable patches, as points of the picture.
    fn samples(&self, side: &SideModel, noise: f64) -> Samples {
        let mut information: Vec<f64> =
            self.patches.iter().map(|patch| patch.information).collect();
        let middle = information.len() / 2;
        let (_, median, _) = information.select_nth_unstable_by(middle, f64::total_cmp);
        let min_information = MIN_INFORMATION * *median;
        let (mut points, mut std) = (Vec::new(), Vec::new());
        for patch in self
            .patches
            .iter()
            .filter(|patch| patch.is_sound(min_information, noise))
        {
            let [foot, sign] = [patch.moment, patch.sign].map(|sum| sum / patch.information);
            let across = side.spread_at(1.0) * sign + patch.offset;
            points.push(side.curve.point(foot, across));
            std.push(noise / patch.information.sqrt());
        }
        Samples { points, std }
    }
}

/// Length of the patches of a side that is `length` pixels long.
fn patch_length(side: &SideModel, tone: &ToneCurve, noise: f64, length: f64) -> f64 {
    let [before, after] = side.plateaus().map(|light| tone.encode_with_slope(light).0);
    // Variance of the offset of a Gaussian-blurred step from one pixel of length.
    let variance = (noise / (after - before)).powi(2) * 2.0 * PI.sqrt() * side.mean_blur();
    let longest = (length / MIN_PATCHES).max(PATCH_LENGTH);
    (variance / (MAX_STD * MAX_STD)).clamp(PATCH_LENGTH, longest)
}

impl Patch {
    fn is_unsettled(&self) -> bool {
        self.step.is_none_or(|step| step.abs() > LAST_STEP)
    }

    /// Makes the step given by the sums; it reduces the squares by as much as the model predicts.
    fn advance(&mut self, has_own_light: bool) {
        if has_own_light {
            self.eliminate_light();
        }
        let mut step = 0.0;
        if self.information > 0.0 {
            step = (self.right / self.information).clamp(-MAX_OFFSET, MAX_OFFSET);
            self.squares -= step * (2.0 * self.right - step * self.information);
        }
        self.light.shift += self.light.per_offset * step;
        self.offset += step;
        self.step = Some(step);
    }

    /// Makes the step of the light at a constant offset, and reduces the sums to the information on
    /// the offset with the light free.
    fn eliminate_light(&mut self) {
        let light = &mut self.light;
        let Some(factor) = light.information.cholesky() else {
            self.information = 0.0;
            return;
        };
        let step = factor.solve(&light.right);
        light.per_offset = -factor.solve(&light.cross);
        light.shift += step;
        let remaining = self.information + light.cross.dot(&light.per_offset);
        self.squares -= light.right.dot(&step);
        self.right -= light.cross.dot(&step);
        self.moment *= remaining / self.information;
        self.sign *= remaining / self.information;
        self.information = remaining;
    }

    fn is_sound(&self, min_information: f64, noise: f64) -> bool {
        let freedom = self.edge_pixels - 1.0;
        let mean_square = self.squares / (noise * noise * freedom);
        self.information > 0.0
            && self.information >= min_information
            && freedom >= 1.0
            && self.offset.abs() < MAX_OFFSET
            && mean_square < 1.0 + MAX_CHI_DEVIATIONS * (2.0 / freedom).sqrt()
    }
}
