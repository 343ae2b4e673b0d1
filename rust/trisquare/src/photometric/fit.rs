//! Least-squares problem of the pixels over camera, planes and exposures.

use std::borrow::Cow;
use std::ops::Range;

use super::band::Pixels;
use super::band_pixels::{BandPixel, PixelFigure};
use super::blur_prior;
use super::exposure::{EXPOSURE_PARAMETERS, Exposure};
use super::figure_chart::FigureChart;
use super::figure_sums::FigureSums;
use super::scene::Scene;
use crate::image::{PICTURE_PARAMETERS, PicturePrior, PictureState, SHIFT, ToneFit};
use crate::lens::Lens;
use crate::numeric::{ArrowStep, ArrowSystem, Block, LANES, Loss, ResidualSpread, each};
use crate::observations::{FreeParameters, View};

/// Free variables of the fit.
#[derive(Clone)]
pub(crate) struct PixelState<L> {
    pub view: View<L>,
    /// One per figure, in the order of the figures.
    pub exposures: Vec<Exposure>,
    /// One per picture.
    pub pictures: Vec<PictureState>,
}

impl<L> PixelState<L> {
    /// The state with the kurtosis estimated in all pictures where it is in doubt.
    pub fn with_free_kurtosis(mut self) -> Self {
        let pictures = self.pictures.into_iter();
        self.pictures = pictures.map(PictureState::with_free_kurtosis).collect();
        self
    }
}

/// The pixels around all figures, at given scales of their noise.
#[derive(Clone)]
pub(crate) struct PixelFit<'a> {
    pub figures: &'a [PixelFigure],
    /// Source of the pixels of figures that do not store theirs; `None` if all do.
    pub pixel_source: Option<&'a dyn Pixels>,
    pub free: &'a FreeParameters,
    /// Number of pictures with parameters of their own: all, or 0 if all tones are known.
    pub free_pictures: usize,
    pub loss: Loss,
    /// Noise of each figure's pixels, coded.
    pub scales: Vec<f64>,
}

/// Half the robust sum of squares, its normal equations, and the spread of the pixels cut by an
/// edge, in units of the scales.
pub(crate) struct PixelSystem {
    pub cost: f64,
    pub system: ArrowSystem,
    pub spread: ResidualSpread,
}

/// Contribution of the figures of one plane to a [`PixelSystem`].
struct PlaneSystem {
    cost: f64,
    block: Block,
    spread: ResidualSpread,
}

impl PixelFit<'_> {
    /// Scene of one figure under a view and an exposure; `None` if the lens does not see its
    /// corners.
    pub(super) fn scene<'a, L: Lens>(
        &'a self,
        view: &'a View<L>,
        exposure: &'a Exposure,
        pictures: &'a [PictureState],
        index: usize,
    ) -> Option<Scene<'a, L>> {
        let figure = &self.figures[index];
        Scene::new(figure, &pictures[figure.image], view, exposure)
    }

    /// The pixels of a figure, read again if it does not store them.
    fn pixels_of<'b>(&self, figure: &'b PixelFigure) -> Option<Cow<'b, [BandPixel]>> {
        Some(match self.pixel_source {
            Some(pixel_source) if figure.pixels.is_empty() => {
                Cow::Owned(pixel_source.read(figure)?)
            }
            _ => Cow::Borrowed(&figure.pixels),
        })
    }

    /// All figures, each with about one in `stride` of its pixels.
    pub fn subsampled(&self, stride: u32) -> Option<Vec<PixelFigure>> {
        let figures = self.figures.iter();
        figures
            .map(|figure| Some(figure.with_some_of(&self.pixels_of(figure)?, stride)))
            .collect()
    }

    /// Shared parameters of the camera and of all pictures.
    fn shared_count(&self) -> usize {
        self.free.len() + PICTURE_PARAMETERS * self.free_pictures
    }

    /// Columns of the shared parameters that a plane depends on: the camera's, and its picture's.
    fn shared_columns(&self, plane: usize) -> Vec<usize> {
        let mut columns: Vec<usize> = (0..self.free.len()).collect();
        let figure = self.figures[self.figures_of(plane)].first();
        if let Some(figure) = figure.filter(|_| self.free_pictures > 0) {
            let first = self.picture_offset(figure.image);
            columns.extend(first..first + PICTURE_PARAMETERS);
        }
        columns
    }

    /// Index of a picture's first parameter among the shared ones.
    pub fn picture_offset(&self, image: usize) -> usize {
        self.free.len() + PICTURE_PARAMETERS * image
    }

    fn add_figure<L: Lens>(
        &self,
        state: &PixelState<L>,
        index: usize,
        sum: &mut PlaneSystem,
    ) -> Option<()> {
        let scene = self.scene(&state.view, &state.exposures[index], &state.pictures, index)?;
        let figure = scene.figure;
        let plane = &state.view.planes[figure.plane];
        let jacobians =
            [0, 1, 2, 3].map(|i| plane.line_jacobian(figure.figure, &figure.sides[i].into()));
        let exposure_offset = self.exposure_offset(state, index);
        let block = &mut sum.block;
        let shared = block.columns.len();
        let plane_layout = (block.hessian.nrows(), exposure_offset);
        let chart = FigureChart::of(&scene)?;
        let stretches = figure.stretch_sides.len();
        let mut sums = FigureSums::new(self.free, shared, jacobians, plane_layout, stretches);
        let to_noise = 1.0 / self.scales[index];
        for pixels in self.pixels_of(figure)?.chunks(LANES) {
            let distances = match pixels.iter().any(|pixel| scene.may_cut(pixel)) {
                true => chart.distances(pixels),
                false => [[0.0; 4]; LANES],
            };
            for (pixel, distances) in pixels.iter().zip(&distances) {
                if !scene.may_cut(pixel) {
                    let inside = pixel.depth() > 0.0;
                    if let Some(residual) = scene.plateau_residual(pixel, inside) {
                        let (cost, weight) = self.loss.cost_and_weight(residual * to_noise);
                        sum.cost += cost;
                        let weight = weight * to_noise * to_noise;
                        sums.add_flat(pixel, inside, residual, weight);
                    }
                    continue;
                }
                let shade = scene.shade(pixel, Some(distances));
                let (cost, weight) = self.loss.cost_and_weight(shade.residual * to_noise);
                sum.cost += cost;
                if shade.coverage.cut_count > 0 {
                    sum.spread.add(self.loss, shade.residual * to_noise, weight);
                }
                let weight = weight * to_noise * to_noise;
                match shade.coverage.cut_count {
                    0 if shade.is_silent => {}
                    0 => {
                        let inside = shade.coverage.value > 0.5;
                        sums.add_flat(pixel, inside, shade.residual, weight);
                    }
                    1 => sums.add_cut(&scene, (&chart, pixel), &shade, weight),
                    _ => sums.add_corner(&scene, pixel, &shade, weight, block)?,
                }
            }
        }
        sums.finish(&scene, &chart, block)?;
        sum.cost += blur_prior::add_wide(scene.exposure(), block, exposure_offset);
        Some(())
    }

    /// Index of a figure's first exposure parameter among its plane's own parameters.
    pub(super) fn exposure_offset<L: Lens>(&self, state: &PixelState<L>, index: usize) -> usize {
        let figure = &self.figures[index];
        state.view.planes[figure.plane].parameter_count() + EXPOSURE_PARAMETERS * figure.figure
    }

    /// Whether every exposure can be fitted to its figure's pixels.
    fn are_valid(&self, exposures: &[Exposure]) -> bool {
        let mut pairs = exposures.iter().zip(self.figures);
        pairs.all(|(exposure, figure)| exposure.is_valid(figure))
    }

    /// Cost and normal equations at a state; `None` if they are not defined there.
    pub fn evaluate<L: Lens>(&self, state: &PixelState<L>) -> Option<PixelSystem> {
        if !self.are_valid(&state.exposures) {
            return None;
        }
        let planes = each(state.view.planes.len(), |p| self.of_plane(state, p))?;
        let mut spread = ResidualSpread::default();
        planes.iter().for_each(|plane| spread.merge(&plane.spread));
        let mut sum = PixelSystem {
            cost: planes.iter().map(|plane| plane.cost).sum(),
            system: ArrowSystem::of(
                self.shared_count(),
                planes.into_iter().map(|plane| plane.block),
            ),
            spread,
        };
        self.add_priors(state, &mut sum);
        state.view.tie(&mut sum.system);
        Some(sum)
    }

    fn of_plane<L: Lens>(&self, state: &PixelState<L>, p: usize) -> Option<PlaneSystem> {
        let plane = &state.view.planes[p];
        let size = plane.parameter_count() + EXPOSURE_PARAMETERS * plane.figures.len();
        let mut sum = PlaneSystem {
            cost: 0.0,
            block: Block::zeros(size, self.shared_columns(p)),
            spread: ResidualSpread::default(),
        };
        let figures = self.figures_of(p);
        // A plane without figures does not move.
        if figures.is_empty() {
            sum.block.hessian.fill_diagonal(1.0);
        }
        for index in figures {
            self.add_figure(state, index, &mut sum)?;
        }
        Some(sum)
    }

    /// Range of the figures of a plane; figures are in the order of the planes.
    fn figures_of(&self, plane: usize) -> Range<usize> {
        let before = |plane: usize| self.figures.partition_point(|figure| figure.plane < plane);
        before(plane)..before(plane + 1)
    }

    /// Estimated tones of the pictures; empty if they were known.
    pub fn tone_fits<L: Lens>(
        &self,
        state: &PixelState<L>,
        system: &ArrowSystem,
        covariance_factor: f64,
    ) -> Option<Vec<ToneFit>> {
        if self.free_pictures == 0 {
            return Some(Vec::new());
        }
        let covariance = system.reduced_information()?.cholesky()?.inverse() * covariance_factor;
        let fits = state.pictures.iter().enumerate().map(|(image, picture)| {
            let first = self.picture_offset(image);
            let block = covariance.fixed_view::<2, 2>(first, first).into_owned();
            let shifted = first + SHIFT;
            let (curve, shift) = (picture.has_free_curve(), picture.has_free_shift());
            Some(ToneFit {
                curve: picture.curve.tone().power(),
                covariance: curve.then_some(block),
                shift: (shift && !curve)
                    .then(|| (picture.shift, covariance[(shifted, shifted)].sqrt())),
            })
        });
        fits.collect()
    }

    /// Adds the priors of the lens's and the pictures' parameters.
    fn add_priors<L: Lens>(&self, state: &PixelState<L>, sum: &mut PixelSystem) {
        sum.cost += self.free.add_prior(&state.view.lens, &mut sum.system);
        for (image, picture) in state.pictures.iter().enumerate().take(self.free_pictures) {
            let PicturePrior {
                information,
                gradient,
            } = picture.prior();
            for i in 0..PICTURE_PARAMETERS {
                let column = self.picture_offset(image) + i;
                sum.system.prior[(column, column)] += information[i];
                sum.system.prior_gradient[column] -= gradient[i];
                sum.cost += 0.5 * gradient[i] * gradient[i] / information[i];
            }
        }
    }

    /// The Newton step of an optimum's normal equations.
    pub fn step(&self, system: &ArrowSystem) -> Option<ArrowStep> {
        Some(system.solve(0.0)?.scaled(self.loss.newton_factor()))
    }

    /// The state after a step.
    pub fn advance<L: Lens>(&self, state: &PixelState<L>, step: &ArrowStep) -> PixelState<L> {
        let pictures = self.advanced_pictures(state, step);
        let exposures = state.exposures.iter().enumerate().map(|(index, exposure)| {
            let figure = &self.figures[index];
            let plane_step = &step.blocks[figure.plane];
            let offset = self.exposure_offset(state, index);
            let moved =
                exposure.moved(&plane_step.as_slice()[offset..offset + EXPOSURE_PARAMETERS]);
            let [from, to] = [&state.pictures, &pictures].map(|all| all[figure.image].curve.tone());
            if from == to {
                moved
            } else {
                moved.translated(from, to)
            }
        });
        PixelState {
            exposures: exposures.collect(),
            view: state.view.advanced(self.free, step),
            pictures,
        }
    }

    fn advanced_pictures<L: Lens>(
        &self,
        state: &PixelState<L>,
        step: &ArrowStep,
    ) -> Vec<PictureState> {
        if self.free_pictures == 0 {
            return state.pictures.clone();
        }
        let moved = state.pictures.iter().enumerate().map(|(image, picture)| {
            let offset = self.picture_offset(image);
            picture.moved(&step.shared.as_slice()[offset..offset + PICTURE_PARAMETERS])
        });
        moved.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::band::Bands;
    use super::super::band_pixels::Width;
    use super::super::exposure::{BlurDifferences, Variation};
    use super::super::figure_chart::all_distances;
    use super::super::kept::pixels_to_keep;
    use super::super::photographs::Photographs;
    use super::*;
    use crate::image::{Picture, PictureTone, PowerCurve};
    use crate::lens::DefaultLens;
    use crate::observations::{PlaneState, Polarity, sort_by_plane};
    use crate::synthetic::Scene as Truth;
    use crate::synthetic::SceneOptions;
    use nalgebra::DVector;

    const CURVE: PowerCurve = PowerCurve {
        gamma: 2.3,
        toe: 0.03,
    };
    const DIFFERENT: BlurDifferences = BlurDifferences {
        sides: [0.0, 0.05, -0.03, 0.1],
        variation: Variation {
            gradient: [-0.1, 0.2],
            curvature: 0.3,
        },
    };
    const ESTIMATED: PictureTone = PictureTone::Estimated(CURVE);
    const APPROXIMATED: PictureTone = PictureTone::Approximated(CURVE, 0.05);
    const SHIFTED: PictureTone = PictureTone::Shifted(CURVE, 0.05);

    fn free() -> FreeParameters {
        FreeParameters::all::<DefaultLens>()
    }

    /// The figures of a scene, with pixel values computed by the model itself.
    fn modelled(
        tone: PictureTone,
        differences: BlurDifferences,
    ) -> (Vec<PixelFigure>, PixelState<DefaultLens>) {
        let truth = Truth::random(2, SceneOptions::default());
        let mut edges = truth.edges(0, 0.0, 20.0);
        edges
            .iter_mut()
            .for_each(|e| e.polarity = Some(Polarity::DarkInside));
        let planes = sort_by_plane(&edges).unwrap();
        let (width, height) = (truth.size.width as usize, truth.size.height as usize);
        let blank = Picture::from_u8(width, height, 1, vec![128; width * height]).unwrap();
        let photographs = Photographs {
            pictures: &[&pixels_to_keep(&blank, &edges, 0.0)],
            tones: &[tone],
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
            relations: Vec::new(),
        };
        let bands = Bands::new(&edges, &planes, &view, &photographs);
        let of_plane = |p| {
            bands
                .of_plane(p, Width::Usual)
                .ok()
                .expect("squares of known polarity")
        };
        let mut figures: Vec<PixelFigure> = (0..planes.len()).flat_map(of_plane).collect();
        let state = PixelState {
            view,
            exposures: vec![
                Exposure {
                    ground: 0.7,
                    contrast: -0.6,
                    light: Variation {
                        gradient: [0.05, -0.03],
                        curvature: -0.04,
                    },
                    blur: 0.9,
                    differences,
                };
                3
            ],
            pictures: vec![PictureState::of(tone)],
        };
        let free = free();
        let mut values = Vec::new();
        for index in 0..figures.len() {
            let fit = problem(&figures, &free);
            let scene = fit
                .scene(&state.view, &state.exposures[index], &state.pictures, index)
                .unwrap();
            let distances = all_distances(&scene, &figures[index], |_| true).unwrap();
            let pixels = figures[index].pixels.iter().zip(&distances);
            let shades =
                pixels.map(|(p, distances)| scene.shade(p, scene.may_cut(p).then_some(distances)));
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

    fn problem<'a>(figures: &'a [PixelFigure], free: &'a FreeParameters) -> PixelFit<'a> {
        PixelFit {
            figures,
            pixel_source: None,
            free,
            free_pictures: 1,
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
        let (figures, state) = modelled(
            PictureTone::Known(crate::image::Tone::Srgb),
            BlurDifferences::default(),
        );
        let free = free();
        let fit = PixelFit {
            free_pictures: 0,
            ..problem(&figures, &free)
        };
        let PixelSystem { cost, system, .. } = fit.evaluate(&state).unwrap();
        assert!(cost < 1e-20);
        assert!(system.blocks.iter().all(|b| b.gradient.norm() < 1e-6));
        assert!(figures.iter().all(|f| f.pixels.len() > 5000));
    }

    struct Held<'a>(&'a [PixelFigure]);

    impl Pixels for Held<'_> {
        fn read(&self, figure: &PixelFigure) -> Option<Vec<BandPixel>> {
            Some(self.0[figure.plane].pixels.clone())
        }
    }

    #[test]
    fn some_pixels_are_the_same_whether_figures_hold_theirs() {
        let (figures, _) = modelled(ESTIMATED, DIFFERENT);
        let free = free();
        let mut emptied = figures.clone();
        emptied[1].pixels.clear();
        let without_pixels = PixelFit {
            pixel_source: Some(&Held(&figures)),
            ..problem(&emptied, &free)
        };
        let [found, expected] =
            [without_pixels, problem(&figures, &free)].map(|fit| fit.subsampled(5).unwrap());
        assert_eq!(format!("{found:?}"), format!("{expected:?}"));
        for (some, all) in expected.iter().zip(&figures) {
            assert!((some.pixels.len() * 5).abs_diff(all.pixels.len()) < all.pixels.len() / 20);
        }
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        check_gradient(ESTIMATED);
        check_gradient(APPROXIMATED);
        check_gradient(SHIFTED);
    }

    fn check_gradient(tone: PictureTone) {
        let (figures, truth) = modelled(tone, DIFFERENT);
        let free = free();
        let fit = problem(&figures, &free);
        let system = fit.evaluate(&truth).unwrap().system;
        // A little off the truth, so that the gradient does not vanish.
        let mut away = zero_step(&system);
        for (i, block) in away.blocks.iter_mut().enumerate() {
            for k in 0..6 {
                block[k] = 2e-4 * (i as f64 + k as f64 - 3.0);
            }
            block[6] = 0.005;
            block[7] = -0.005;
            block[8] = 0.01;
            block[10] = 0.03;
            block[13] = -0.02;
        }
        let state = fit.advance(&truth, &away);
        let system = fit.evaluate(&state).unwrap().system;
        let cost = |step: &ArrowStep| fit.evaluate(&fit.advance(&state, step)).unwrap().cost;
        let check = |set: &dyn Fn(&mut ArrowStep, f64), gradient: f64, hessian: f64, name: &str| {
            // Long enough to average out the discontinuities at the plateaus.
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
        for i in 0..free.len() + PICTURE_PARAMETERS {
            let mut gradient = system.prior_gradient[i];
            let mut hessian = system.prior[(i, i)];
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
