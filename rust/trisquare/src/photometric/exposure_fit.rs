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
    ArrowStep, ArrowSystem, Block, Limits, Loss, Problem, Termination, add_rank_one, each,
    median_scale, minimise,
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
    let distances = each(pixels.figures.len(), |index| {
        let scene = pixels.scene(view, &guess[index], pictures, index)?;
        all_distances(&scene, &pixels.figures[index], |_| true)
    })?;
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
        each(exposures.len(), |index| {
            let mut residuals = Vec::new();
            self.for_each(&exposures[index], index, |shade, _| {
                if shade.coverage.cut_count > 0 {
                    residuals.push(shade.residual);
                }
            })?;
            Some(median_scale(residuals.into_iter()).max(MIN_NOISE))
        })
    }
}

impl<L: Lens> Problem for HeldGeometry<'_, L> {
    type State = Vec<Exposure>;

    fn evaluate(&self, exposures: &Vec<Exposure>) -> Option<(f64, ArrowSystem)> {
        if !self.pixels.are_valid(exposures) {
            return None;
        }
        let found = each(exposures.len(), |index| {
            let to_noise = 1.0 / self.pixels.scales[index];
            let (mut cost, mut sums) = (0.0, ExposureSums::default());
            self.for_each(&exposures[index], index, |shade, row| {
                let (part, weight) = self.pixels.loss.cost_and_weight(shade.residual * to_noise);
                cost += part;
                add_rank_one(&mut sums, &row, weight * to_noise * to_noise);
            })?;
            let mut block = Block::zeros(EXPOSURE_PARAMETERS, Vec::new());
            add_exposure(&mut block, &sums, 0);
            Some((cost, block))
        })?;
        let (costs, blocks): (Vec<f64>, Vec<Block>) = found.into_iter().unzip();
        Some((costs.iter().sum(), ArrowSystem::of(0, blocks.into_iter())))
    }

    fn advance(&self, exposures: &Vec<Exposure>, step: &ArrowStep) -> Vec<Exposure> {
        let steps = exposures.iter().zip(&step.blocks);
        steps
            .map(|(exposure, own)| exposure.moved(own.as_slice()))
            .collect()
    }
}
