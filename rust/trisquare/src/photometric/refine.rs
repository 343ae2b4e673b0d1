//! Runs the joint fit to the pixels and decides whether its result replaces that of the edges.
//!
//! Every pixel near an outline is modelled as `v = g(L (b + A C))`, with `g` the tone curve, `L`
//! light that varies over the figure, and `C` the fraction of the pixel covered by the blurred
//! square: the normal distribution function of its distances to the near sides over the blur `w`,
//! which varies as well, bivariate at a corner. The distances follow from the joint camera and
//! pose, so that corners contribute as well. The noise of pixels is independent: no information is
//! lost between patches.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{DMatrix, DVector, Vector2};

use super::band::Bands;
use super::band_pixels::{PixelFigure, Width};
use super::exposure::Exposure;
use super::exposure_fit::fit_exposure;
use super::fit::{PixelFit, PixelState, PixelSystem};
use super::hidden_stretches::{DisturbedSide, departures, disturbed, disturbed_sides, plain_reach};
use super::optimum::{converge, optimum};
use super::photographs::{Photographs, Refusal};
use super::scene::Scene;
use super::stated_tone::contradicted_tone;
use crate::image::{KurtosisRole, PictureState, PictureTone, Tone};
use crate::lens::Lens;
use crate::noise::corrected_for_drift;
use crate::numeric::{Loss, each};
use crate::observations::{FreeParameters, PlaneEdges, View};
use crate::refine::{Refined, residuals};
use crate::result::{Calibration, Stage, Warning};
use crate::solver::{JointProblem, Solution};
use crate::uncertainty::{Correlated, covariance};

/// Stride of the pixels to which the exposures are fitted with camera and planes fixed.
const EXPOSURE_STRIDE: u32 = 12;

/// Stride of the pixels used to detect covered stretches of a side.
const JUDGED_STRIDE: u32 = 8;

/// Maximum fraction of all sides that covered stretches may take up: with more, it is the sides
/// that deviate from the model, and the remainder would be misleading.
const MAX_HIDDEN: f64 = 0.1;

/// Approximate number of pixels kept in memory from step to step, to avoid reading them again:
/// those of a few pictures. The pixels of further pictures are read again for every step.
const HELD_PIXELS: usize = 400_000;

/// Approximate number of pixels per figure in the first steps, if that is at most one in
/// `MIN_STRIDE`: the more pixels there are, the farther, in standard deviations, are the edge
/// samples and the exposures estimated from a twelfth of the pixels.
const FIRST_PIXELS: usize = 4_000;
const MIN_STRIDE: usize = 2;

/// Fraction of the band's widest blur above which a wider band is used.
const WIDEST_BLUR: f64 = 0.98;

/// Maximum mean log ratio of the pixels' standard deviations to the edge samples'. The samples' own
/// are too small, since those of a side share its blur and contrast, and the pixels' are not: by
/// 0.22 at most in 32 pictures with corners twice as blurred as their centre.
const MAX_LOG_RATIO: f64 = 0.3;

/// Mean square shift per parameter, in standard deviations of the edges' result, above which the
/// pixels are taken to violate the model.
const MAX_MEAN_SQUARE_SHIFT: f64 = 9.0;

/// Maximum ratio of the edge samples' residuals under the pixels' result to those under their own,
/// if tone curves are estimated. It is 1.13 in pictures that darken to a third at their corners,
/// and at most 1.09 in all others that were examined. Light that falls off nonlinearly, as of a
/// lamp nearby, is mistaken for a tone curve.
const MAX_RESIDUALS: f64 = 1.2;

/// Fits the photographs and replaces the calibration's numbers if that improves them; returns the
/// optimum of that fit then.
pub(crate) fn improve<L: Lens>(
    edges: &[PlaneEdges],
    problem: &JointProblem<'_, L>,
    solution: &Solution<L>,
    photographs: &Photographs<'_>,
    calibration: &mut Calibration<L>,
) -> Option<Solution<L>> {
    match attempt(edges, problem, solution, photographs, calibration) {
        Ok((better, fitted)) => {
            *calibration = better;
            return Some(fitted);
        }
        Err(Refusal::NotApplicable) => {}
        Err(Refusal::Reason(reason)) => {
            calibration.warnings.push(Warning::PixelsNotUsed {
                reason: reason.into(),
            });
        }
    }
    None
}

/// Start of the joint fit.
struct Start<L> {
    figures: Vec<PixelFigure>,
    /// Noise of each figure's pixels.
    scales: Vec<f64>,
    state: PixelState<L>,
    disturbed: Vec<DisturbedSide>,
    /// Number of all pixels, including those that the figures do not store.
    pixels: usize,
}

fn attempt<L: Lens>(
    edges: &[PlaneEdges],
    problem: &JointProblem<'_, L>,
    solution: &Solution<L>,
    photographs: &Photographs<'_>,
    calibration: &Calibration<L>,
) -> Result<(Calibration<L>, Solution<L>), Refusal> {
    let tones = photographs.tones;
    let is_known = tones.iter().all(|t| matches!(t, PictureTone::Known(_)));
    let view = &solution.refined.view;
    let source = Bands::new(edges, &solution.planes, view, photographs);
    let start = start_fit(&source, solution, tones)?.ok_or(BROKEN)?;
    let unused: f64 = start.disturbed.iter().map(|side| side.part).sum();
    if unused > MAX_HIDDEN * 4.0 * start.figures.len() as f64 {
        return Err(Refusal::Reason(
            "more than a tenth of all sides lies off its lines (is the paper bent?)",
        ));
    }
    let fit = PixelFit {
        figures: &start.figures,
        pixel_source: Some(&source),
        free: &problem.free,
        free_pictures: if is_known { 0 } else { tones.len() },
        loss: Loss::WideTukey,
        scales: start.scales,
    };
    let near = approach(&fit, start.state, start.pixels).ok_or(BROKEN)?;
    let (state, found) = optimum(&fit, near).ok_or(BROKEN)?;
    let contradicted = match is_known {
        true => contradicted_tone(&fit, &state),
        false => None,
    };
    // The samples' stated deviations are informative of the pixels' only if measured from them.
    let figures = solution.planes.iter().flat_map(|plane| &plane.figures);
    let has_deviations = figures
        .into_iter()
        .all(|figure| edges[figure.index].std.is_some());
    let (mut better, fitted) = answer(
        &fit,
        state.clone(),
        found,
        (problem, solution),
        has_deviations,
    )
    .ok_or(BROKEN)?;
    check_improvement(&problem.free, calibration, &better)?;
    // With a wrong stated tone curve they contradict as well, and a warning says so.
    if !is_known && better.rms > MAX_RESIDUALS * calibration.rms {
        return Err(CONTRADICTED);
    }
    if let Some(doubted) = doubted_kurtosis(&fit, &state)? {
        doubted.add_to_covariance(&mut better);
    }
    if let Some((warning, change)) = contradicted {
        better.covariance += &change * change.transpose();
        better.warnings.insert(0, warning);
    }
    let folding = |_| Refusal::Reason("with it the distortion turns back inside the picture");
    problem.check_reach(&better.camera).map_err(folding)?;
    let hidden = start.disturbed.into_iter().filter(|side| side.is_hidden);
    better
        .warnings
        .extend(hidden.map(|hidden| Warning::PartlyHidden {
            plane: hidden.plane,
            figure: hidden.figure,
            side: hidden.side,
            part: hidden.part,
        }));
    Ok((better, fitted))
}

const CONTRADICTED: Refusal = Refusal::Reason(
    "the pixels contradict the edge samples (texture, glare or a wrong tone curve?)",
);

const BROKEN: Refusal = Refusal::Reason("the pixels near an outline do not show a blurred step");

/// Exposures and noise of all figures under the edges' camera, and their pixels; `None` if these do
/// not show blurred squares.
fn start_fit<L: Lens>(
    bands: &Bands<'_, L>,
    solution: &Solution<L>,
    tones: &[PictureTone],
) -> Result<Option<Start<L>>, Refusal> {
    let view = &solution.refined.view;
    let pictures: Vec<PictureState> = tones.iter().map(|tone| PictureState::of(*tone)).collect();
    // Which figures keep their pixels depends on the threads, but pixels read again are the same.
    let held = AtomicUsize::new(0);
    let starts_in_bands = |p: usize, width| {
        let figures = bands.of_plane(p, width)?.into_iter().map(|figure| {
            let (tone, picture) = (tones[figure.image].tone(), &pictures[figure.image]);
            let sides = &solution.planes[p].figures[figure.figure].sides;
            let is_outlier: Vec<bool> = sides.iter().map(|side| side.is_outlier).collect();
            FigureStart::of(figure, (view, picture, tone), &is_outlier)
        });
        Ok(figures.collect::<Option<Vec<FigureStart>>>())
    };
    let plane_starts = |p: usize| {
        let mut figure_starts = match starts_in_bands(p, Width::Usual)? {
            Some(starts) if starts.iter().all(FigureStart::fits_blur) => Some(starts),
            _ => starts_in_bands(p, Width::Wide)?,
        };
        for start in figure_starts.iter_mut().flatten() {
            let pixels = &mut start.figure.pixels;
            if held.fetch_add(pixels.len(), Ordering::Relaxed) > HELD_PIXELS {
                *pixels = Vec::new();
            }
        }
        Ok(figure_starts)
    };
    let planes = each(solution.planes.len(), |p| Some(plane_starts(p))).unwrap_or_default();
    let planes: Vec<Option<Vec<FigureStart>>> =
        planes.into_iter().collect::<Result<_, Refusal>>()?;
    let Some(planes) = planes.into_iter().collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let mut start = Start {
        figures: Vec::new(),
        scales: Vec::new(),
        state: PixelState {
            view: view.clone(),
            exposures: Vec::new(),
            pictures,
        },
        disturbed: Vec::new(),
        pixels: held.into_inner(),
    };
    for figure_start in planes.into_iter().flatten() {
        start.figures.push(figure_start.figure);
        start.scales.push(figure_start.scale);
        start.state.exposures.push(figure_start.exposure);
        start.disturbed.extend(figure_start.disturbed);
    }
    Ok(Some(start))
}

/// Start of the joint fit of one figure.
struct FigureStart {
    figure: PixelFigure,
    scale: f64,
    exposure: Exposure,
    disturbed: Vec<DisturbedSide>,
}

impl FigureStart {
    fn of<L: Lens>(
        mut figure: PixelFigure,
        (view, picture, tone): (&View<L>, &PictureState, Tone),
        is_outlier: &[bool],
    ) -> Option<Self> {
        let few = figure.subsampled(EXPOSURE_STRIDE);
        let guess = Exposure::guess(&few, tone)?;
        let (exposure, scale) = fit_exposure(&few, view, picture, guess)?;
        let judged = figure.subsampled(JUDGED_STRIDE);
        let departures = departures(&Scene::new(&judged, picture, view, &exposure)?, scale)?;
        let stretches = disturbed(&judged, &departures);
        figure.limit_reach(plain_reach(
            &judged,
            &departures,
            &stretches,
            exposure.widest_blur(),
        ));
        let disturbed = disturbed_sides(&figure, &stretches);
        let mut dropped = stretches.stretches;
        for (mark, side) in dropped.iter_mut().zip(&figure.stretch_sides) {
            *mark |= is_outlier[usize::from(*side)];
        }
        figure.drop_stretches(dropped);
        Some(Self {
            figure,
            scale,
            exposure,
            disturbed,
        })
    }

    /// Whether the band is wide enough for the blur; in a band that is not, the fit stops at the
    /// limit.
    fn fits_blur(&self) -> bool {
        self.exposure.widest_blur() < WIDEST_BLUR * self.figure.width.widest_blur()
    }
}

/// Start of the steps with all pixels: in a large photograph, the optimum of some of them. `None`
/// if the steps do not converge.
fn approach<L: Lens>(
    fit: &PixelFit<'_>,
    state: PixelState<L>,
    pixels: usize,
) -> Option<PixelState<L>> {
    let first_pixels = FIRST_PIXELS * fit.figures.len().max(1);
    let stride = pixels / first_pixels;
    if stride < MIN_STRIDE || first_pixels > HELD_PIXELS {
        return Some(state);
    }
    let few = PixelFit {
        figures: &fit.subsampled(stride as u32)?,
        ..fit.clone()
    };
    let (state, _, step) = converge(&few, state)?;
    Some(fit.advance(&state, &step))
}

/// The calibration of an optimum, and the solution.
fn answer<L: Lens>(
    fit: &PixelFit<'_>,
    state: PixelState<L>,
    PixelSystem { system, spread, .. }: PixelSystem,
    (problem, solution): (&JointProblem<'_, L>, &Solution<L>),
    has_deviations: bool,
) -> Option<(Calibration<L>, Solution<L>)> {
    let Solution {
        planes,
        refined,
        correlated,
        ..
    } = solution;
    let covariance_factor = spread.covariance_factor(problem.free.len() as f64);
    let tones = fit.tone_fits(&state, &system, covariance_factor)?;
    let lens = problem.free.len();
    // With fixed coding of the pictures; known coding is not among the parameters.
    let held_tone = match tones.is_empty() {
        true => None,
        false => covariance(&system.leading(lens), covariance_factor),
    };
    let system = system.marginal(lens)?;
    // Dependent noise of pixels shows in the samples measured from them.
    let residual_correlation = &correlated.residual_correlation;
    let dependence = match has_deviations {
        true => residual_correlation.pixels,
        false => residual_correlation.neighbours,
    };
    let independent = covariance(&system, covariance_factor)?;
    let total = independent * dependence + &residual_correlation.added;
    // The known errors of sides are the effect of an unknown tone curve on each of them.
    let tone_growth = held_tone.and_then(|held| {
        let held = held * dependence + &residual_correlation.added - &correlated.known;
        largest_growth(&total, &held)
    });
    // The samples were measured with a less certain tone curve.
    let planes = corrected_for_drift(planes, &state.view)?;
    let fitted = Solution {
        correlated: Correlated {
            covariance: total,
            ..correlated.clone()
        },
        refined: Refined {
            residuals: residuals(&planes, &state.view)?,
            view: state.view,
            system,
            covariance_factor,
            ..*refined
        },
        planes,
        noise: None,
    };
    let mut better = Calibration::assemble(problem, &fitted, Stage::Pixels);
    better.set_pose_uncertainties(&fitted);
    better.tones = tones;
    better.tone_growth = tone_growth;
    Some((better, fitted))
}

/// Changes due to a free kurtosis of the blur, for the pictures where it is in doubt.
struct Doubted {
    /// The camera's free parameters.
    lens: DVector<f64>,
    /// The parameters of each picture's tone curve.
    curves: Vec<Vector2<f64>>,
}

impl Doubted {
    /// Adds the change to the covariance, as a possible error of the result.
    fn add_to_covariance<L: Lens>(&self, answer: &mut Calibration<L>) {
        answer.covariance += &self.lens * self.lens.transpose();
        for (tone, change) in answer.tones.iter_mut().zip(&self.curves) {
            if let Some(covariance) = &mut tone.covariance {
                *covariance += change * change.transpose();
            }
        }
    }
}

/// Changes due to a free kurtosis; `None` if it is in doubt in no picture.
fn doubted_kurtosis<L: Lens>(
    fit: &PixelFit<'_>,
    held: &PixelState<L>,
) -> Result<Option<Doubted>, Refusal> {
    let is_doubted = |picture: &PictureState| picture.kurtosis_role == KurtosisRole::Doubted;
    if !held.pictures.iter().any(is_doubted) {
        return Ok(None);
    }
    // One step from the optimum without a kurtosis is not enough: the optimum with one may be far
    // away.
    let (freed, _) = optimum(fit, held.clone().with_free_kurtosis()).ok_or(Refusal::Reason(
        "what another shape of the blur would change is not found",
    ))?;
    let pairs = freed.pictures.iter().zip(&held.pictures);
    let curves = pairs.map(|(freed, held)| {
        let [freed, held] = [freed, held].map(|picture| picture.curve.tone().power());
        Vector2::new((freed.gamma / held.gamma).ln(), freed.toe - held.toe)
    });
    Ok(Some(Doubted {
        lens: fit.free.difference(&freed.view.lens, &held.view.lens),
        curves: curves.collect(),
    }))
}

/// Largest ratio of the standard deviations of a covariance to those of the other.
fn largest_growth(covariance: &DMatrix<f64>, other: &DMatrix<f64>) -> Option<f64> {
    let ratios = covariance.diagonal().component_div(&other.diagonal());
    let largest = ratios.iter().copied().reduce(f64::max)?;
    (largest > 0.0 && largest.is_finite()).then(|| largest.sqrt())
}

/// Rejects a result that is less certain than the edges', or far from it.
fn check_improvement<L: Lens>(
    free: &FreeParameters,
    edges: &Calibration<L>,
    pixels: &Calibration<L>,
) -> Result<(), Refusal> {
    if free.len() == 0 {
        return Ok(());
    }
    let less_certain = || Refusal::Reason("they are less certain than the edge samples");
    let factor = edges
        .covariance
        .clone()
        .cholesky()
        .ok_or_else(less_certain)?;
    // Mean log ratio of the standard deviations, over all directions equally.
    let log_ratio = pixels
        .covariance
        .clone()
        .cholesky()
        .ok_or_else(less_certain)?
        .ln_determinant()
        - factor.ln_determinant();
    if !(log_ratio < MAX_LOG_RATIO * 2.0 * free.len() as f64) {
        return Err(less_certain());
    }
    let shift = free.difference(&pixels.camera, &edges.camera);
    let mean_square = shift.dot(&factor.solve(&shift)) / free.len() as f64;
    if !(mean_square < MAX_MEAN_SQUARE_SHIFT) {
        return Err(CONTRADICTED);
    }
    Ok(())
}
