//! The last stage when there is a picture: the joint model fitted to the pixels themselves.
//!
//! Every pixel near an outline is modelled as `v = g(b + A C)`, `g` the tone curve, `b` and `A`
//! linear over the figure, and `C` the part of the blurred square that covers it: the normal
//! distribution function of its distances to the near sides over the blur `w`, bivariate at a
//! corner. The distances follow from the joint camera and pose, so that corners count as well. A
//! pixel carries its own independent noise: nothing is lost between patches.

mod band;
mod coverage;
mod exposure;
mod fit;

use crate::arrow::ArrowSystem;
use crate::consistency::disagreement;
use crate::covariance::covariance;
use crate::levenberg::{Limits, Termination, minimise};
use crate::observations::ObservedPlane;
use crate::parameters::FreeParameters;
use crate::refine::{Refined, View, residuals};
use crate::result::{Calibration, Stage, Warning};
use crate::robust::Loss;
use crate::{Brown, Picture, PlaneEdges, Tone};
use band::{PixelFigure, collect};
use exposure::Exposure;
use fit::{PixelFit, PixelState};

/// The pictures that show the figures, and how they were coded.
#[derive(Debug, Clone, Copy)]
pub struct Photographs<'a> {
    /// One picture per image index of the figures.
    pub pictures: &'a [&'a Picture],
    /// The tone curve of all of them.
    pub tone: Tone,
}

/// One pixel in so many finds blur, contrast and noise before all of them are used.
const PREVIEW_STRIDE: usize = 8;

/// Rounds of the preview: Huber's loss, then Tukey's at the scale found.
const PREVIEW_LOSSES: [Loss; 2] = [Loss::Huber, Loss::Tukey];

/// Evaluations allowed to a round of the preview.
const PREVIEW_ITERATIONS: usize = 25;

/// Evaluations allowed on all pixels: one or two steps suffice from the preview's answer.
const FINAL_ITERATIONS: usize = 6;

/// Fall of the cost, in units of the noise variance, below which a step is the last.
const LAST_DECREASE: f64 = 0.02;

/// The mean square shift per parameter, in standard deviations of the edges' answer, beyond which
/// the pixels are taken to break the model.
const MAX_MEAN_SQUARE_SHIFT: f64 = 9.0;

/// Fits the photographs and replaces the calibration's numbers where that improves them.
pub(crate) fn improve(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<Brown>,
    photographs: &Photographs<'_>,
    calibration: &mut Calibration,
) {
    match attempt(edges, planes, free, refined, photographs, calibration) {
        Ok(better) => *calibration = better,
        Err(Refusal::NotApplicable) => {}
        Err(Refusal::Reason(reason)) => {
            calibration.warnings.push(Warning::PixelsNotUsed { reason });
        }
    }
}

/// Why the fit to the pixels is not taken.
enum Refusal {
    /// The figures are not squares of known polarity in known pictures.
    NotApplicable,
    Reason(&'static str),
}

fn attempt(
    edges: &[PlaneEdges],
    planes: &[ObservedPlane],
    free: &FreeParameters,
    refined: &Refined<Brown>,
    photographs: &Photographs<'_>,
    calibration: &Calibration,
) -> Result<Calibration, Refusal> {
    let figures = collect(edges, planes, &refined.view, photographs)?;
    let broken = || Refusal::Reason("the pixels near an outline do not show a blurred step");
    let exposures: Option<Vec<Exposure>> = figures
        .iter()
        .map(|figure| Exposure::guess(figure, photographs.tone))
        .collect();
    let mut state = PixelState {
        view: refined.view.clone(),
        exposures: exposures.ok_or_else(broken)?,
    };
    let curve = photographs.tone.curve();

    let thinned: Vec<PixelFigure> = figures.iter().map(|f| f.thinned(PREVIEW_STRIDE)).collect();
    let mut preview = PixelFit {
        figures: &thinned,
        free,
        curve: &curve,
        loss: Loss::Huber,
        scales: Vec::new(),
    };
    for loss in PREVIEW_LOSSES {
        preview.loss = loss;
        preview.scales = preview.measure_scales(&state).ok_or_else(broken)?;
        let limits = Limits {
            iterations: PREVIEW_ITERATIONS,
            decrease: LAST_DECREASE,
        };
        let minimum = minimise(&preview, state, limits).ok_or_else(broken)?;
        if minimum.termination != Termination::Converged {
            return Err(broken());
        }
        state = minimum.state;
    }
    let scales = preview.measure_scales(&state).ok_or_else(broken)?;
    let full = PixelFit {
        figures: &figures,
        scales: scales.clone(),
        ..preview
    };
    let limits = Limits {
        iterations: FINAL_ITERATIONS,
        decrease: LAST_DECREASE,
    };
    let minimum = minimise(&full, state, limits).ok_or_else(broken)?;
    if minimum.termination != Termination::Converged {
        return Err(broken());
    }
    preview.scales = scales;
    let spread = preview.spread(&minimum.state).ok_or_else(broken)?;
    let factor = spread.covariance_factor(free.len());
    let better = replaced(
        planes,
        free,
        &minimum.state.view,
        &minimum.system,
        factor,
        refined,
        calibration,
    );
    let better = better.ok_or_else(broken)?;
    check_improvement(free, calibration, &better)?;
    Ok(better)
}

/// The calibration with the pixels' camera, planes and covariance.
fn replaced(
    planes: &[ObservedPlane],
    free: &FreeParameters,
    view: &View<Brown>,
    system: &ArrowSystem,
    factor: f64,
    refined: &Refined<Brown>,
    calibration: &Calibration,
) -> Option<Calibration> {
    let covariance = match free.len() {
        0 => calibration.covariance.clone(),
        _ => covariance(system, factor)?,
    };
    let warnings = disagreement(system, free, view.lens.focal().x, factor);
    let fitted = refined.with_view(view.clone());
    Some(Calibration::assemble(
        planes,
        free,
        calibration.image_size,
        &fitted,
        covariance,
        &residuals(planes, view)?,
        warnings.map(Warning::Disagreement).into_iter().collect(),
        Stage::Pixels,
    ))
}

/// Refuses an answer that is less certain than the edges', or far from it.
fn check_improvement(
    free: &FreeParameters,
    edges: &Calibration,
    pixels: &Calibration,
) -> Result<(), Refusal> {
    if free.len() == 0 {
        return Ok(());
    }
    let unsure = || Refusal::Reason("they are less certain than the edge samples");
    let factor = edges.covariance.clone().cholesky().ok_or_else(unsure)?;
    // Mean log ratio of the standard deviations, over all directions alike.
    let log_ratio = pixels
        .covariance
        .clone()
        .cholesky()
        .ok_or_else(unsure)?
        .ln_determinant()
        - factor.ln_determinant();
    if !(log_ratio < 0.0) {
        return Err(unsure());
    }
    let shift = free.difference(&pixels.camera, &edges.camera);
    let mean_square = shift.dot(&factor.solve(&shift)) / free.len() as f64;
    if !(mean_square < MAX_MEAN_SQUARE_SHIFT) {
        return Err(Refusal::Reason(
            "they contradict the edge samples (texture, glare or a wrong tone curve?)",
        ));
    }
    Ok(())
}
