//! Fit of exposure and noise of a figure, with camera and planes fixed.
//!
//! The distances of the pixels to the sides are then constant, and computed once.

use super::band_pixels::PixelFigure;
use super::blur_prior;
use super::exposure::{EXPOSURE_PARAMETERS, Exposure};
use super::figure_chart::all_distances;
use super::scene::{Scene, Shade};
use crate::image::PictureState;
use crate::lens::Lens;
use crate::numeric::{
    ArrowStep, ArrowSystem, Block, Limits, Loss, Problem, Termination, add_rank_one, median_scale,
    minimise, symmetric_entry,
};
use crate::observations::View;

/// Losses of the successive rounds of the fit: Huber's, then Tukey's at the scale found.
const LOSSES: [Loss; 2] = [Loss::Huber, Loss::WideTukey];

/// Maximum number of evaluations per round, and the decrease of the cost, in units of the noise
/// variance, below which a round ends.
const LIMITS: Limits = Limits {
    iterations: 40,
    decrease: 1.0,
};

/// Lower bound of the noise (coded, 1 being white): residuals below it are rounding errors.
const MIN_NOISE: f64 = 1e-6;

/// Length of a pixel's row in this fit: `(exposure, residual)`.
const ROW: usize = EXPOSURE_PARAMETERS + 1;

/// Fit of a figure's pixels with camera and planes fixed.
struct HeldGeometry<'a, L> {
    figure: &'a PixelFigure,
    view: &'a View<L>,
    picture: &'a PictureState,
    /// For every pixel, its distances to the near sides.
    distances: Vec<[f64; 4]>,
    loss: Loss,
    /// Noise of the pixels, coded.
    scale: f64,
}

/// Fits the exposure from a guess, and measures the noise of the figure's pixels; `None` if they do
/// not show a blurred square.
pub(super) fn fit_exposure<L: Lens>(
    figure: &PixelFigure,
    view: &View<L>,
    picture: &PictureState,
    guess: Exposure,
) -> Option<(Exposure, f64)> {
    let scene = Scene::new(figure, picture, view, &guess)?;
    let mut problem = HeldGeometry {
        figure,
        view,
        picture,
        distances: all_distances(&scene, figure, |_| true)?,
        loss: LOSSES[0],
        scale: 1.0,
    };
    let mut exposure = guess;
    for loss in LOSSES {
        problem.loss = loss;
        problem.scale = problem.noise(&exposure)?;
        let minimum = minimise(&problem, exposure, LIMITS)?;
        if minimum.termination != Termination::Converged {
            return None;
        }
        exposure = minimum.state;
    }
    let noise = problem.noise(&exposure)?;
    Some((exposure, noise))
}

impl<L: Lens> HeldGeometry<'_, L> {
    /// Calls `visit` with the model of every pixel.
    fn for_each(
        &self,
        exposure: &Exposure,
        mut visit: impl FnMut(&Scene<'_, L>, &Shade),
    ) -> Option<()> {
        let scene = Scene::new(self.figure, self.picture, self.view, exposure)?;
        for (pixel, distances) in self.figure.pixels.iter().zip(&self.distances) {
            let shade = scene.shade(pixel, Some(distances));
            visit(&scene, &shade);
        }
        Some(())
    }

    /// Robust noise of the pixels cut by an edge.
    fn noise(&self, exposure: &Exposure) -> Option<f64> {
        let mut residuals = Vec::new();
        self.for_each(exposure, |_, shade| {
            if shade.coverage.cut_count > 0 {
                residuals.push(shade.residual);
            }
        })?;
        Some(median_scale(residuals.into_iter()).max(MIN_NOISE))
    }
}

impl<L: Lens> Problem for HeldGeometry<'_, L> {
    type State = Exposure;

    fn evaluate(&self, exposure: &Exposure) -> Option<(f64, ArrowSystem)> {
        if !exposure.is_valid(self.figure) {
            return None;
        }
        let to_noise = 1.0 / self.scale;
        let (mut cost, mut sums) = (0.0, [[0.0; ROW]; ROW]);
        self.for_each(exposure, |scene, shade| {
            let mut row = [shade.residual; ROW];
            row[..EXPOSURE_PARAMETERS].copy_from_slice(&scene.wrt_exposure(shade));
            let (part, weight) = self.loss.cost_and_weight(shade.residual * to_noise);
            cost += part;
            add_rank_one(&mut sums, &row, weight * to_noise * to_noise);
        })?;
        let mut block = Block::zeros(EXPOSURE_PARAMETERS, Vec::new());
        for i in 0..EXPOSURE_PARAMETERS {
            for j in 0..EXPOSURE_PARAMETERS {
                block.hessian[(i, j)] = symmetric_entry(&sums, i, j);
            }
            block.gradient[i] = symmetric_entry(&sums, i, EXPOSURE_PARAMETERS);
        }
        cost += blur_prior::add_wide(exposure, &mut block, 0);
        Some((cost, ArrowSystem::of(0, std::iter::once(block))))
    }

    fn advance(&self, exposure: &Exposure, step: &ArrowStep) -> Exposure {
        exposure.moved(step.blocks[0].as_slice())
    }
}
