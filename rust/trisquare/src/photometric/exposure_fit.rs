//! Exposures and noise of all figures, with camera and planes held.
//!
//! The distances of the pixels to the sides do not change then, and are computed once.

use super::exposure::{EXPOSURE_PARAMETERS, Exposure};
use super::figure_chart::all_distances;
use super::figure_sums::{ExposureRow, ExposureSums, add_exposure};
use super::fit::PixelFit;
use super::scene::Shade;
use crate::image::PictureState;
use crate::lens::Lens;
use crate::numeric::{
    ArrowStep, ArrowSystem, Limits, Loss, Problem, Termination, add_rank_one, median_scale,
    minimise,
};
use crate::observations::View;

/// Rounds of the fit: Huber's loss, then Tukey's at the scale found.
const LOSSES: [Loss; 2] = [Loss::Huber, Loss::WideTukey];

/// Evaluations allowed to a round, and the fall of the cost, in units of the noise variance, that
/// ends it.
const LIMITS: Limits = Limits {
    iterations: 40,
    decrease: 1.0,
};

/// Noise (coded, 1 being white) below which pixels agree to rounding.
const MIN_NOISE: f64 = 1e-6;

/// The pixels of a fit with camera and planes held.
struct HeldGeometry<'a, L> {
    pixels: PixelFit<'a>,
    view: &'a View<L>,
    pictures: &'a [PictureState],
    /// For every pixel of every figure, its distances to the near sides.
    distances: Vec<Vec<[f64; 4]>>,
}

/// Fits the exposures from a guess, and measures the noise of each figure's pixels; `None` if
/// they do not show blurred squares.
pub(super) fn fit_exposures<L: Lens>(
    pixels: PixelFit<'_>,
    view: &View<L>,
    pictures: &[PictureState],
    guess: Vec<Exposure>,
) -> Option<(Vec<Exposure>, Vec<f64>)> {
    let mut distances = Vec::with_capacity(pixels.figures.len());
    for (index, figure) in pixels.figures.iter().enumerate() {
        let scene = pixels.scene(view, &guess[index], pictures, index)?;
        distances.push(all_distances(&scene, figure)?);
    }
    let mut problem = HeldGeometry {
        pixels,
        view,
        pictures,
        distances,
    };
    let mut exposures = guess;
    for loss in LOSSES {
        problem.pixels.loss = loss;
        problem.pixels.scales = problem.scales(&exposures)?;
        let minimum = minimise(&problem, exposures, LIMITS)?;
        if minimum.termination != Termination::Converged {
            return None;
        }
        exposures = minimum.state;
    }
    let scales = problem.scales(&exposures)?;
    Some((exposures, scales))
}

impl<L: Lens> HeldGeometry<'_, L> {
    /// Shows the model at every pixel of a figure to `visit`, with its row of the Jacobian.
    fn for_each(
        &self,
        exposure: &Exposure,
        index: usize,
        mut visit: impl FnMut(&Shade, ExposureRow),
    ) -> Option<()> {
        let scene = self
            .pixels
            .scene(self.view, exposure, self.pictures, index)?;
        let figure = &self.pixels.figures[index];
        for (pixel, distances) in figure.pixels.iter().zip(&self.distances[index]) {
            let shade = scene.shade(pixel, Some(distances));
            visit(&shade, scene.exposure_row(&shade));
        }
        Some(())
    }

    /// Robust noise of each figure, from the pixels that an edge cuts.
    fn scales(&self, exposures: &[Exposure]) -> Option<Vec<f64>> {
        let mut scales = Vec::with_capacity(exposures.len());
        for (index, exposure) in exposures.iter().enumerate() {
            let mut residuals = Vec::new();
            self.for_each(exposure, index, |shade, _| {
                if shade.coverage.cut_count > 0 {
                    residuals.push(shade.residual);
                }
            })?;
            scales.push(median_scale(residuals.into_iter()).max(MIN_NOISE));
        }
        Some(scales)
    }
}

impl<L: Lens> Problem for HeldGeometry<'_, L> {
    type State = Vec<Exposure>;

    fn evaluate(&self, exposures: &Vec<Exposure>) -> Option<(f64, ArrowSystem)> {
        let own = exposures.iter().map(|_| EXPOSURE_PARAMETERS);
        let mut system = ArrowSystem::zeros(0, own);
        let mut cost = 0.0;
        for (index, exposure) in exposures.iter().enumerate() {
            let to_noise = 1.0 / self.pixels.scales[index];
            let mut sums = ExposureSums::default();
            self.for_each(exposure, index, |shade, row| {
                let (part, weight) = self.pixels.loss.cost_and_weight(shade.residual * to_noise);
                cost += part;
                add_rank_one(&mut sums, &row, weight * to_noise * to_noise);
            })?;
            add_exposure(&mut system.blocks[index], &sums, 0);
        }
        let valid = self.pixels.are_valid(exposures);
        valid.then_some((cost, system))
    }

    fn advance(&self, exposures: &Vec<Exposure>, step: &ArrowStep) -> Vec<Exposure> {
        let steps = exposures.iter().zip(&step.blocks);
        steps
            .map(|(exposure, own)| exposure.moved(own.as_slice()))
            .collect()
    }
}
