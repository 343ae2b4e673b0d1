//! The pixels as a least-squares problem over camera, planes and exposures.

use crate::arrow::{ArrowStep, ArrowSystem};
use crate::parameters::FreeParameters;
use crate::photometric::band::PixelFigure;
use crate::photometric::exposure::{EXPOSURE_PARAMETERS, Exposure};
use crate::photometric::figure_sums::FigureSums;
use crate::photometric::scene::Scene;
use crate::robust::{Loss, Spread};
use crate::tone::ToneCurve;
use crate::view::View;
use crate::{Brown, Lens};

/// What the fit moves.
#[derive(Clone)]
pub(crate) struct PixelState {
    pub view: View<Brown>,
    /// One per figure, in the order of the figures.
    pub exposures: Vec<Exposure>,
}

/// The pixels around all figures, at given scales of their noise.
#[derive(Clone)]
pub(crate) struct PixelFit<'a> {
    pub figures: &'a [PixelFigure],
    pub free: &'a FreeParameters,
    pub curve: &'a ToneCurve,
    pub loss: Loss,
    /// Noise of each figure's pixels, coded.
    pub scales: Vec<f64>,
}

/// Half the robust sum of squares, its normal equations, and the spread of the pixels that an edge
/// cuts, in units of the scales.
pub(crate) struct PixelSystem {
    pub cost: f64,
    pub system: ArrowSystem,
    pub spread: Spread,
}

impl PixelFit<'_> {
    /// One figure under a view and an exposure; `None` where the lens does not see its corners.
    pub(super) fn scene<'a>(
        &'a self,
        view: &'a View<Brown>,
        exposure: &'a Exposure,
        index: usize,
    ) -> Option<Scene<'a>> {
        Scene::new(&self.figures[index], self.curve, view, exposure)
    }

    fn add_figure<const N: usize>(
        &self,
        state: &PixelState,
        index: usize,
        sum: &mut PixelSystem,
    ) -> Option<()> {
        let scene = self.scene(&state.view, &state.exposures[index], index)?;
        let figure = scene.figure;
        let plane = &state.view.planes[figure.plane];
        let jacobians = [0, 1, 2, 3].map(|i| plane.line_jacobian(figure.figure, &figure.sides[i]));
        let exposure_offset = self.exposure_offset(state, index);
        let block = &mut sum.system.blocks[figure.plane];
        let mut sums = FigureSums::<N>::new(self.free, jacobians, exposure_offset);
        let to_noise = 1.0 / self.scales[index];
        for pixel in &figure.pixels {
            let sight = match scene.may_cut(pixel) {
                true => Some(scene.lens.sight(&pixel.place)?),
                false => None,
            };
            let distances = sight.map(|sight| scene.distances(pixel, &sight));
            let shade = scene.shade(pixel, distances.as_ref());
            let (cost, weight) = self.loss.cost_and_weight(shade.residual * to_noise);
            sum.cost += cost;
            if shade.coverage.cut_count > 0 {
                sum.spread.add(self.loss, shade.residual * to_noise);
            }
            let weight = weight * to_noise * to_noise;
            match (shade.coverage.cut_count, &sight) {
                (1, Some(sight)) => sums.add_cut(&scene, sight, &shade, weight),
                (2, Some(sight)) => sums.add_corner(&scene, sight, &shade, weight, block),
                _ => sums.add_plateau(&scene.exposure_row(&shade), weight),
            }
        }
        sums.finish(block);
        Some(())
    }

    /// Where a figure's exposure begins among its plane's own parameters.
    fn exposure_offset(&self, state: &PixelState, index: usize) -> usize {
        let figure = &self.figures[index];
        state.view.planes[figure.plane].parameter_count() + EXPOSURE_PARAMETERS * figure.figure
    }

    fn assemble<const N: usize>(&self, state: &PixelState) -> Option<PixelSystem> {
        if !state.exposures.iter().all(Exposure::is_valid) {
            return None;
        }
        let own = state
            .view
            .planes
            .iter()
            .map(|plane| plane.parameter_count() + EXPOSURE_PARAMETERS * plane.figures.len());
        let mut sum = PixelSystem {
            cost: 0.0,
            system: ArrowSystem::zeros(self.free.len(), own),
            spread: Spread::default(),
        };
        for index in 0..self.figures.len() {
            self.add_figure::<N>(state, index, &mut sum)?;
        }
        // A plane without figures stays where it is.
        for (p, block) in sum.system.blocks.iter_mut().enumerate() {
            if self.figures.iter().all(|figure| figure.plane != p) {
                block.hessian.fill_diagonal(1.0);
            }
        }
        Some(sum)
    }

    /// Cost and normal equations at a state; `None` where they are not defined.
    pub fn evaluate(&self, state: &PixelState) -> Option<PixelSystem> {
        // One instance per number of shared parameters, so that the innermost loops are unrolled.
        match self.free.len() {
            0 => self.assemble::<9>(state),
            1 => self.assemble::<10>(state),
            2 => self.assemble::<11>(state),
            3 => self.assemble::<12>(state),
            4 => self.assemble::<13>(state),
            5 => self.assemble::<14>(state),
            6 => self.assemble::<15>(state),
            7 => self.assemble::<16>(state),
            8 => self.assemble::<17>(state),
            _ => self.assemble::<18>(state),
        }
    }

    /// The state after a step.
    pub fn advance(&self, state: &PixelState, step: &ArrowStep) -> PixelState {
        let exposures = state.exposures.iter().enumerate().map(|(index, exposure)| {
            let own = &step.blocks[self.figures[index].plane];
            let offset = self.exposure_offset(state, index);
            exposure.moved(&own.as_slice()[offset..offset + EXPOSURE_PARAMETERS])
        });
        PixelState {
            exposures: exposures.collect(),
            view: state.view.advanced(self.free, step),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observations::sort_by_plane;
    use crate::photometric::Photographs;
    use crate::photometric::band::collect;
    use crate::synthetic::{Scene as Truth, SceneOptions};
    use crate::view::PlaneState;
    use crate::{Fixed, Model, Picture, Polarity, Tone};
    use nalgebra::DVector;

    fn free() -> FreeParameters {
        FreeParameters::new(Model::Brown, &Fixed::default(), 1.0)
    }

    /// The figures of a scene, filled with what the model itself makes of them.
    fn modelled() -> (Vec<PixelFigure>, PixelState) {
        let truth = Truth::random(2, SceneOptions::default());
        let mut edges = truth.edges(0, 0.0, 20.0);
        edges
            .iter_mut()
            .for_each(|e| e.polarity = Some(Polarity::DarkInside));
        let planes = sort_by_plane(&edges).unwrap();
        let (width, height) = (truth.size.width as usize, truth.size.height as usize);
        let blank = Picture::from_u8(width, height, 1, vec![128; width * height]).unwrap();
        let photographs = Photographs {
            pictures: &[&blank],
            tone: Tone::Srgb,
        };
        let view = View {
            lens: truth.camera,
            planes: truth
                .poses
                .iter()
                .map(|pose| PlaneState {
                    pose: *pose,
                    figures: vec![crate::observations::Placement::IDENTITY],
                })
                .collect(),
        };
        let Ok(mut figures) = collect(&edges, &planes, &view, &photographs) else {
            panic!("squares of known polarity");
        };
        let state = PixelState {
            view,
            exposures: vec![
                Exposure {
                    ground: 0.7,
                    contrast: -0.6,
                    gradient: [0.05, -0.03],
                    blur: 0.9,
                };
                3
            ],
        };
        let (free, curve) = (free(), Tone::Srgb.curve());
        let mut values = Vec::new();
        for index in 0..figures.len() {
            let fit = problem(&figures, &free, &curve);
            let scene = fit
                .scene(&state.view, &state.exposures[index], index)
                .unwrap();
            let shades = figures[index].pixels.iter().map(|p| {
                let sight = state.view.lens.sight(&p.place).unwrap();
                let distances = scene.distances(p, &sight);
                scene.shade(p, scene.may_cut(p).then_some(&distances))
            });
            values.push(
                shades
                    .zip(&figures[index].pixels)
                    .map(|(shade, pixel)| shade.residual + pixel.value)
                    .collect::<Vec<_>>(),
            );
        }
        for (figure, values) in figures.iter_mut().zip(values) {
            for (pixel, value) in figure.pixels.iter_mut().zip(values) {
                pixel.value = value;
            }
        }
        (figures, state)
    }

    fn problem<'a>(
        figures: &'a [PixelFigure],
        free: &'a FreeParameters,
        curve: &'a ToneCurve,
    ) -> PixelFit<'a> {
        PixelFit {
            figures,
            free,
            curve,
            loss: Loss::Tukey,
            scales: vec![0.01, 0.012, 0.009],
        }
    }

    fn zero_step(system: &ArrowSystem) -> ArrowStep {
        ArrowStep {
            shared: DVector::zeros(system.prior.nrows()),
            blocks: system
                .blocks
                .iter()
                .map(|b| DVector::zeros(b.hessian.nrows()))
                .collect(),
            predicted_decrease: 0.0,
        }
    }

    #[test]
    fn residual_and_gradient_vanish_at_the_truth() {
        let (figures, state) = modelled();
        let (free, curve) = (free(), Tone::Srgb.curve());
        let fit = problem(&figures, &free, &curve);
        let PixelSystem { cost, system, .. } = fit.evaluate(&state).unwrap();
        assert!(cost < 1e-20);
        assert!(system.blocks.iter().all(|b| b.gradient.norm() < 1e-6));
        assert!(figures.iter().all(|f| f.pixels.len() > 5000));
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        let (figures, truth) = modelled();
        let (free, curve) = (free(), Tone::Srgb.curve());
        let fit = problem(&figures, &free, &curve);
        let system = fit.evaluate(&truth).unwrap().system;
        // A little off the truth, so that the gradient does not vanish.
        let mut away = zero_step(&system);
        for (i, block) in away.blocks.iter_mut().enumerate() {
            for k in 0..6 {
                block[k] = 1e-4 * (i as f64 + k as f64 - 3.0);
            }
            block[8] = 0.01;
            block[10] = 0.03;
        }
        let state = fit.advance(&truth, &away);
        let system = fit.evaluate(&state).unwrap().system;
        let cost = |step: &ArrowStep| fit.evaluate(&fit.advance(&state, step)).unwrap().cost;
        let check = |set: &dyn Fn(&mut ArrowStep, f64), gradient: f64, hessian: f64, name: &str| {
            // Long enough for the steps at the plateaus to average out.
            let h = 1e-3 / hessian.sqrt();
            let (mut up, mut down) = (zero_step(&system), zero_step(&system));
            set(&mut up, h);
            set(&mut down, -h);
            let expected = (cost(&up) - cost(&down)) / (2.0 * h);
            // In units of the parameter's own standard deviation.
            let error = (gradient - expected) / hessian.sqrt();
            assert!(
                error.abs() < 2e-3 * (gradient / hessian.sqrt()).abs().max(1.0),
                "{name}: {gradient} {expected}"
            );
        };
        for i in 0..free.len() {
            let (mut gradient, mut hessian) = (0.0, 0.0);
            for block in &system.blocks {
                gradient += block.shared_gradient[i];
                hessian += block.shared[(i, i)];
            }
            check(
                &|s, h| s.shared[i] = h,
                gradient,
                hessian,
                &format!("shared {i}"),
            );
        }
        for (b, block) in system.blocks.iter().enumerate() {
            for i in 0..block.gradient.len() {
                let (gradient, hessian) = (block.gradient[i], block.hessian[(i, i)]);
                check(
                    &|s, h| s.blocks[b][i] = h,
                    gradient,
                    hessian,
                    &format!("plane {b}, {i}"),
                );
            }
        }
    }
}
