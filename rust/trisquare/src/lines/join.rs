//! The lines joined with what the planes say.

use nalgebra::{DMatrix, DVector};

use super::follow::{moved_like, planes_under};
use super::mixture::{Mixture, sorted};
use super::observed_line::{ObservedLine, SmoothLine};
use crate::lens::{INTRINSICS, Lens};
use crate::noise::{LocalNoise, Noise};
use crate::numeric::chi_square_tail;
use crate::observations::{ObservedPlane, View};
use crate::refine::{Refined, residuals, robust_scale};
use crate::result::{Calibration, Plane, SceneLine, Warning};
use crate::solver::{JointProblem, Solution};

/// Rounds of measuring, sorting and moving allowed; about four are used.
const MAX_ROUNDS: usize = 15;

/// Square of the last step, in standard deviations.
const LAST_STEP: f64 = 1e-3;

/// A line's own scale of the noise counts beside that of all as if this rested on so many degrees of
/// freedom.
const SHARED_FREEDOM: f64 = 8.0;

/// How often chance alone makes lines and planes differ so much.
const CHANCE: f64 = 1e-4;

/// Where lines and planes agree.
struct Joined<L> {
    lens: L,
    covariance: DMatrix<f64>,
    is_used: Vec<bool>,
}

/// What the planes say of the free parameters, each in units of its standard deviation.
struct Known<L> {
    lens: L,
    units: DVector<f64>,
    information: DMatrix<f64>,
}

/// Adds the lines of the scene to a calibration from planes alone, `solution` being the edges'
/// optimum and `fitted` that of the pixels, where the calibration is from these.
pub(crate) fn add_lines<L: Lens>(
    problem: &JointProblem<'_, L>,
    (solution, fitted): (&Solution<L>, Option<&Solution<L>>),
    lines: &[ObservedPlane],
    calibration: &mut Calibration<L>,
) {
    let found = Known::of(calibration).and_then(|known| join(problem, &known, lines));
    let accepted = match found {
        None => Err(Warning::LinesNotUsed { sigmas: None }),
        Some((found, None)) => Ok(found),
        Some((_, sigmas)) => Err(Warning::LinesNotUsed { sigmas }),
    };
    let moved = accepted.and_then(|found| {
        let view = moved_view(problem, (solution, fitted), calibration, found.lens);
        view.map(|view| (found, view))
            .ok_or(Warning::LinesNotUsed { sigmas: None })
    });
    let is_used = match moved {
        Ok((found, view)) => {
            take(problem, fitted.unwrap_or(solution), view, calibration);
            calibration.covariance = found.covariance;
            found.is_used
        }
        Err(warning) => {
            calibration.warnings.push(warning);
            vec![false; lines.len()]
        }
    };
    let lens = calibration.camera;
    let line = |(line, is_used): (&ObservedPlane, bool)| {
        let samples = &line.figures[0].sides[0].samples;
        SceneLine {
            figure: line.figures[0].index,
            image: line.image,
            rms: ObservedLine::of(&lens, &problem.free, samples).map(|own| own.rms()),
            samples: samples.len(),
            is_used,
        }
    };
    calibration.lines = lines.iter().zip(is_used).map(line).collect();
}

impl<L: Lens> Known<L> {
    /// `None` where nothing is free.
    fn of(calibration: &Calibration<L>) -> Option<Self> {
        let covariance = &calibration.covariance;
        let units = covariance.diagonal().map(f64::sqrt);
        let size = units.len();
        let scaled = DMatrix::from_fn(size, size, |i, j| {
            covariance[(i, j)] / (units[i] * units[j])
        });
        let information = scaled.cholesky()?.inverse();
        (size > 0).then_some(Self {
            lens: calibration.camera,
            units,
            information,
        })
    }

    fn moved(&self, problem: &JointProblem<'_, L>, step: &DVector<f64>, from: &L) -> L {
        problem.free.advance(from, &step.component_mul(&self.units))
    }

    /// The lens with its distortion held to what lenses are like: of small squares alone it may see
    /// no corner of the picture.
    fn usual(&self, problem: &JointProblem<'_, L>) -> Option<L> {
        let (values, usual) = (
            self.lens.parameters(),
            self.lens.coefficient_priors(problem.size),
        );
        let (mut information, size) = (self.information.clone(), self.units.len());
        let mut gradient = DVector::zeros(size);
        for (i, name) in problem.free.names().into_iter().enumerate() {
            let column = L::parameter_names().iter().position(|own| *own == name)?;
            if column >= INTRINSICS {
                let by_std = self.units[i] / usual[column - INTRINSICS];
                information[(i, i)] += by_std * by_std;
                gradient[i] = by_std * values[column] / usual[column - INTRINSICS];
            }
        }
        let step = -information.cholesky()?.solve(&gradient);
        Some(self.moved(problem, &step, &self.lens))
    }

    /// How far a lens is from what the planes say.
    fn deviation(&self, problem: &JointProblem<'_, L>, lens: &L) -> DVector<f64> {
        problem
            .free
            .difference(lens, &self.lens)
            .component_div(&self.units)
    }
}

/// Where lines and planes agree, and by how many standard deviations they do not, if beyond chance;
/// `None` where no line is of use.
fn join<L: Lens>(
    problem: &JointProblem<'_, L>,
    known: &Known<L>,
    lines: &[ObservedPlane],
) -> Option<(Joined<L>, Option<f64>)> {
    let seen = |lens: &L| measured(problem, lens, lines).len();
    let starts = [
        Some(known.lens),
        known.usual(problem),
        Some(known.lens.without_distortion()),
    ];
    let starts = starts.into_iter().flatten().rev();
    let mut lens = starts.max_by_key(|lens| seen(lens))?;
    for _ in 0..MAX_ROUNDS {
        let (numbers, smooth): (Vec<usize>, Vec<SmoothLine>) =
            smoothed(measured(problem, &lens, lines), lines, &known.units)
                .into_iter()
                .unzip();
        let deviation = known.deviation(problem, &lens);
        let gradient = &known.information * &deviation;
        let Mixture {
            is_straight,
            information,
            gradient,
        } = sorted(&smooth, (&known.information, &gradient))?;
        let factor = information.clone().cholesky()?;
        let step = -factor.solve(&gradient);
        lens = known.moved(problem, &step, &lens);
        if step.dot(&(&information * &step)) > LAST_STEP {
            continue;
        }
        let mut is_used = vec![false; lines.len()];
        for (number, is_straight) in numbers.into_iter().zip(&is_straight) {
            is_used[number] = *is_straight;
        }
        let inverse = factor.inverse();
        let deviation = known.deviation(problem, &lens);
        let square = deviation.dot(&(&known.information * &deviation));
        let told = known.units.len() as f64 - (&known.information * &inverse).trace();
        let contradicts = chi_square_tail(square, told.max(1.0)) < CHANCE;
        let units = DMatrix::from_diagonal(&known.units);
        let joined = Joined {
            lens,
            covariance: &units * inverse * &units,
            is_used,
        };
        let any = joined.is_used.contains(&true);
        return any.then_some((joined, contradicts.then(|| (square / told.max(1.0)).sqrt())));
    }
    None
}

/// The lines whose samples a lens sees, with their numbers.
fn measured<L: Lens>(
    problem: &JointProblem<'_, L>,
    lens: &L,
    lines: &[ObservedPlane],
) -> Vec<(usize, ObservedLine)> {
    let measured = |(number, line): (usize, &ObservedPlane)| {
        let samples = &line.figures[0].sides[0].samples;
        Some((number, ObservedLine::of(lens, &problem.free, samples)?))
    };
    lines.iter().enumerate().filter_map(measured).collect()
}

/// What measured lines say, each by its own noise.
fn smoothed(
    measured: Vec<(usize, ObservedLine)>,
    lines: &[ObservedPlane],
    units: &DVector<f64>,
) -> Vec<(usize, SmoothLine)> {
    let planes: Vec<_> = measured
        .iter()
        .map(|(number, _)| lines[*number].clone())
        .collect();
    let rough = measured
        .iter()
        .map(|(_, line)| line.rough.clone())
        .collect();
    let noise = Noise::of(&planes, &rough, robust_scale(&rough));
    let of_line = |((number, line), own): ((usize, ObservedLine), &LocalNoise)| {
        let variance = own.freedom * own.scale.powi(2) + SHARED_FREEDOM * noise.scale.powi(2);
        let scale = (variance / (own.freedom + SHARED_FREEDOM)).sqrt();
        Some((
            number,
            line.smooth(scale, noise.correlation)?.in_units(units),
        ))
    };
    measured
        .into_iter()
        .zip(&noise.planes)
        .filter_map(of_line)
        .collect()
}

/// The view of a calibration with its planes moved to where they stand under another lens.
fn moved_view<L: Lens>(
    problem: &JointProblem<'_, L>,
    (solution, fitted): (&Solution<L>, Option<&Solution<L>>),
    calibration: &Calibration<L>,
    lens: L,
) -> Option<View<L>> {
    let model = problem.options.model;
    let under = |lens: L| planes_under(lens, &solution.planes, &solution.refined, model);
    let (before, after) = (under(calibration.camera)?, under(lens)?);
    let own = &fitted.unwrap_or(solution).refined.view.planes;
    let moves = before.iter().zip(&after);
    let planes = own.iter().zip(moves);
    Some(View {
        lens,
        planes: planes
            .map(|(own, (before, after))| moved_like(own, before, after))
            .collect(),
    })
}

/// Puts a moved view in a calibration; how well the poses are known beside the camera stays.
fn take<L: Lens>(
    problem: &JointProblem<'_, L>,
    optimum: &Solution<L>,
    view: View<L>,
    calibration: &mut Calibration<L>,
) {
    let Some(residuals) = residuals(&optimum.planes, &view) else {
        return;
    };
    let moved = Solution {
        refined: Refined {
            view,
            residuals,
            ..optimum.refined.clone()
        },
        ..optimum.clone()
    };
    let found = Calibration::assemble(problem, &moved, calibration.stage);
    let states = &moved.refined.view.planes;
    for ((plane, found), state) in calibration.planes.iter_mut().zip(found.planes).zip(states) {
        let first = &state.figures[0];
        if let Some(aspect) = &mut plane.aspect {
            aspect.value = first.stretch;
        }
        let estimated = plane.radii.iter_mut().filter(|radius| radius.std > 0.0);
        for (radius, value) in estimated.zip(&first.radii) {
            radius.value = *value;
        }
        *plane = Plane {
            pose: found.pose,
            corners: found.corners,
            rms: found.rms,
            ..plane.clone()
        };
    }
    calibration.camera = found.camera;
    calibration.residuals = found.residuals;
    calibration.rms = found.rms;
}
