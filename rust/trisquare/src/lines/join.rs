//! Combination of the lines of the scene with the planes.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::follow::moved_like;
use super::mixture::{Mixture, classified};
use super::observed_line::{ObservedLine, SmoothLine};
use super::planes::{PlaneInformation, Planes};
use crate::lens::Lens;
use crate::noise::{LocalNoise, Noise};
use crate::numeric::chi_square_tail;
use crate::observations::{ObservedPlane, View};
use crate::refine::{Refined, residuals, robust_scale};
use crate::result::{Calibration, Plane, SceneLine, Warning};
use crate::solver::{JointProblem, Solution};

/// Maximum number of rounds of measuring, classifying and moving; about four are used.
const MAX_ROUNDS: usize = 30;

/// Factor of a step that is not shorter than the previous one.
const SHORTENED: f64 = 0.5;

/// Square of the length of a step, in standard deviations, below which it is the last.
const LAST_STEP: f64 = 1e-3;

/// Degrees of freedom attributed to the common scale of the noise, when it is combined with a
/// line's own.
const SHARED_FREEDOM: f64 = 8.0;

/// Minimum fraction of the lines that have to be straight: of ten curves one may be straight under
/// some lens that the planes allow.
const MIN_STRAIGHT: f64 = 0.2;

/// Probability of the difference between lines and planes by chance below which they contradict.
const CHANCE: f64 = 1e-4;

/// Joint estimate from lines and planes.
struct Joined<L> {
    lens: L,
    covariance: DMatrix<f64>,
    is_used: Vec<bool>,
}

/// Adds the lines of the scene to a calibration from planes alone. `solution` is the edges' optimum
/// and `fitted` that of the pixels, if the calibration is from these.
pub(crate) fn add_lines<L: Lens>(
    problem: &JointProblem<'_, L>,
    (solution, fitted): (&Solution<L>, Option<&Solution<L>>),
    lines: &[ObservedPlane],
    calibration: &mut Calibration<L>,
) {
    let planes = Planes::of(problem, solution, calibration);
    let found = planes
        .as_ref()
        .and_then(|planes| join(problem, planes, lines));
    let accepted = match found {
        None => Err(Warning::LinesNotUsed { sigmas: None }),
        Some((found, None)) => Ok(found),
        Some((_, sigmas)) => Err(Warning::LinesNotUsed { sigmas }),
    };
    let moved = accepted.and_then(|found| {
        let optimum = fitted.unwrap_or(solution);
        let moved = planes.and_then(|planes| moved_optimum(&planes, optimum, found.lens));
        moved
            .map(|moved| (found, moved))
            .ok_or(Warning::LinesNotUsed { sigmas: None })
    });
    let is_used = match moved {
        Ok((found, moved)) => {
            copy_optimum(problem, &moved, calibration);
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
            rms: ObservedLine::of(&lens, &problem.free, samples).map(|observed| observed.rms()),
            samples: samples.len(),
            is_used,
        }
    };
    calibration.lines = lines.iter().zip(is_used).map(line).collect();
}

/// The joint estimate from lines and planes, and their difference in standard deviations, if beyond
/// chance; `None` if no line is of use.
fn join<L: Lens>(
    problem: &JointProblem<'_, L>,
    planes: &Planes<'_, L>,
    lines: &[ObservedPlane],
) -> Option<(Joined<L>, Option<f64>)> {
    let visible_count = |lens: &L| measured(problem, lens, lines).len();
    let starts = [
        Some(planes.lens),
        planes.lens_with_prior(),
        Some(planes.lens.without_distortion()),
    ];
    let starts = starts.into_iter().flatten().rev();
    let mut lens = starts.max_by_key(|lens| visible_count(lens))?;
    let mut last_length = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        let (numbers, smooth): (Vec<usize>, Vec<SmoothLine>) =
            smoothed(measured(problem, &lens, lines), lines, &planes.units)
                .into_iter()
                .unzip();
        let plane_information = planes.information_at(lens)?;
        let found = Combination::of(&plane_information, &smooth)?;
        let step_fraction = if found.length < last_length {
            1.0
        } else {
            SHORTENED
        };
        lens = planes.stepped_lens(&(&found.step * step_fraction), &lens);
        last_length = found.length;
        if found.length > LAST_STEP {
            continue;
        }
        let mut is_used = vec![false; lines.len()];
        for (number, is_straight) in numbers.into_iter().zip(&found.is_straight) {
            is_used[number] = *is_straight;
        }
        let covariance = found.factor.inverse();
        let contradiction = found.contradiction(&plane_information, &covariance);
        let units = DMatrix::from_diagonal(&planes.units);
        let joined = Joined {
            lens,
            covariance: &units * covariance * &units,
            is_used,
        };
        let used = joined.is_used.iter().filter(|is_used| **is_used).count();
        let is_enough = used > 0 && used as f64 >= MIN_STRAIGHT * lines.len() as f64;
        return is_enough.then_some((joined, contradiction));
    }
    None
}

/// Combination of lines and planes at a lens.
struct Combination {
    is_straight: Vec<bool>,
    /// Factor of their joint information.
    factor: Cholesky<f64, Dyn>,
    /// Step to the joint optimum, and the square of its length in standard deviations.
    step: DVector<f64>,
    length: f64,
}

impl Combination {
    fn of(plane_information: &PlaneInformation, lines: &[SmoothLine]) -> Option<Self> {
        let gradient = &plane_information.information * &plane_information.deviation;
        let Mixture {
            is_straight,
            information,
            gradient,
        } = classified(lines, (&plane_information.information, &gradient))?;
        let factor = information.clone().cholesky()?;
        let step = -factor.solve(&gradient);
        Some(Self {
            is_straight,
            factor,
            length: step.dot(&(information * &step)),
            step,
        })
    }

    /// Difference between lines and planes in standard deviations, if beyond chance.
    fn contradiction(
        &self,
        plane_information: &PlaneInformation,
        covariance: &DMatrix<f64>,
    ) -> Option<f64> {
        let square = plane_information
            .deviation
            .dot(&(&plane_information.information * &plane_information.deviation));
        let square = square.max(plane_information.square);
        let determined =
            self.step.len() as f64 - (&plane_information.information * covariance).trace();
        let is_contradiction = chi_square_tail(square, determined.max(1.0)) < CHANCE;
        is_contradiction.then(|| (square / determined.max(1.0)).sqrt())
    }
}

/// The lines whose samples are seen by a lens, with their indices.
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

/// Smooth displacements of measured lines, each with its own noise.
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
    let noise = Noise::of(&planes, &rough, robust_scale(&rough, 0));
    let smooth_line = |((number, line), line_noise): ((usize, ObservedLine), &LocalNoise)| {
        let variance =
            line_noise.freedom * line_noise.scale.powi(2) + SHARED_FREEDOM * noise.scale.powi(2);
        let scale = (variance / (line_noise.freedom + SHARED_FREEDOM)).sqrt();
        Some((
            number,
            line.smooth(scale, noise.correlation)?.in_units(units),
        ))
    };
    measured
        .into_iter()
        .zip(&noise.planes)
        .filter_map(smooth_line)
        .collect()
}

/// An optimum with its planes moved to their poses under another lens.
fn moved_optimum<L: Lens>(
    planes: &Planes<'_, L>,
    optimum: &Solution<L>,
    lens: L,
) -> Option<Solution<L>> {
    let optimum_view = &optimum.refined.view;
    let (before, after) = (
        planes.plane_states(planes.lens)?,
        planes.plane_states(lens)?,
    );
    let moves = optimum_view.planes.iter().zip(before.iter().zip(&after));
    let mut view = View {
        lens,
        planes: moves
            .map(|(plane, (before, after))| moved_like(plane, before, after))
            .collect(),
        relations: optimum_view.relations.clone(),
    };
    if !view.hold_relations() {
        return None;
    }
    let residuals = residuals(&optimum.planes, &view)?;
    Some(Solution {
        refined: Refined {
            view,
            residuals,
            ..optimum.refined.clone()
        },
        ..optimum.clone()
    })
}

/// Copies a moved optimum to a calibration; the poses' uncertainties given the camera are
/// unchanged.
fn copy_optimum<L: Lens>(
    problem: &JointProblem<'_, L>,
    moved: &Solution<L>,
    calibration: &mut Calibration<L>,
) {
    let found = Calibration::assemble(problem, moved, calibration.stage);
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

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use crate::calibrate;
    use crate::error::Error;
    use crate::lens::Lens;
    use crate::observations::{Options, PlaneEdges};
    use crate::synthetic::{Scene, SceneOptions};

    const BENT: usize = 2;

    /// Lines all over the picture of a scene, one of them bent by some pixels.
    fn lines(scene: &Scene) -> Vec<PlaneEdges> {
        let size = Vector2::new(f64::from(scene.size.width), f64::from(scene.size.height));
        let ends = [
            (0.05, 0.1, 0.95, 0.15),
            (0.1, 0.05, 0.15, 0.9),
            (0.05, 0.9, 0.9, 0.8),
            (0.9, 0.1, 0.95, 0.95),
            (0.1, 0.2, 0.8, 0.95),
            (0.9, 0.3, 0.2, 0.95),
        ];
        let line = |(number, (x0, y0, x1, y1)): (usize, &(f64, f64, f64, f64))| {
            let ray = |x: f64, y: f64| {
                let pixel = Vector2::new(x, y).component_mul(&size);
                scene.camera.unproject(&pixel).unwrap()
            };
            let (start, end) = (ray(*x0, *y0), ray(*x1, *y1));
            let samples = (0..50).map(|i| {
                let place = f64::from(i) / 49.0;
                let pixel = scene.camera.project(&start.lerp(&end, place)).unwrap();
                let noise = 0.1 * (f64::from(i * i) * 78.2 + number as f64).sin();
                let bend = if number == BENT { 3.0 } else { 0.0 };
                pixel + Vector2::new(noise, noise + bend * 4.0 * place * (1.0 - place))
            });
            PlaneEdges::line(samples.collect()).unwrap()
        };
        ends.iter().enumerate().map(line).collect()
    }

    #[test]
    fn straight_lines_tell_the_distortion_and_a_bent_one_is_left_out() {
        let scene = Scene::random(4, SceneOptions::default());
        let squares = scene.edges(1, 0.1, 15.0);
        let alone = calibrate(&squares, scene.size, &Options::default()).unwrap();
        let edges: Vec<_> = lines(&scene).into_iter().chain(squares).collect();
        let found = calibrate(&edges, scene.size, &Options::default()).unwrap();
        let used: Vec<bool> = found.lines.iter().map(|line| line.is_used).collect();
        assert_eq!(used, (0..6).map(|line| line != BENT).collect::<Vec<_>>());
        for ((name, std), (_, before)) in found.std().into_iter().zip(alone.std()) {
            let place = found.position(name).unwrap();
            let off = found.camera.parameters()[place] - scene.camera.parameters()[place];
            assert!(std < before && off.abs() < 4.0 * std, "{name} {off} {std}");
        }
        assert_eq!(found.planes.len(), alone.planes.len());
        assert!(found.rms < 1.1 * alone.rms);
    }

    #[test]
    fn lines_without_a_plane_are_refused() {
        let scene = Scene::random(4, SceneOptions::default());
        let found = calibrate(&lines(&scene), scene.size, &Options::default());
        assert_eq!(found, Err(Error::LinesAlone { lines: 6 }));
    }
}
