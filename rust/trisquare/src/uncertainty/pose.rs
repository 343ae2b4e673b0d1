//! Uncertainty of the poses of the planes, together with the camera.
//!
//! With `H` and `C` a plane's block of the normal equations and its cross terms with the camera,
//! the pose that fits best follows the camera by `-H^-1 C`, and has the covariance `H^-1` (in units
//! of the noise) where the camera is given. The joint covariance of camera and pose follows from
//! these and from the camera's own, whether it was found from the same planes or from others. Where
//! the sides of a plane have common errors (paper that is not flat), each side's error moves the
//! pose like the sum of its samples' gradients. An eliminated parameter, the error of a picture's
//! tone curve, contributes to both: it follows the camera, and is not known where the camera is
//! given.
//!
//! An unknown aspect of a rectangle is one more parameter of its plane, as is every unknown radius
//! of a circle.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

use crate::lens::{Columns, Lens};
use crate::numeric::{ArrowSystem, Block, Loss, Problem, Ties};
use crate::observations::{FreeParameters, ObservedPlane, POSE_PARAMETERS};
use crate::refine::{EdgeProblem, Refined};
use crate::result::{Calibration, PoseUncertainty};

/// Number of samples of each side to compute how a pose follows the camera: that depends on where
/// the sides are, and little on how densely they are sampled.
const SAMPLES_PER_SIDE: usize = 8;

/// Uncertainty of the estimated parameters of a plane.
pub(crate) struct PlaneUncertainty {
    pub pose: PoseUncertainty,
    /// Uncertainty of the aspect or the radii of its first figure, where they are unknown.
    pub shape: Vec<ShapeUncertainty>,
}

/// Variance of an aspect or a radius where the camera is given, and its derivative with respect to
/// the camera.
pub(crate) struct ShapeUncertainty {
    variance: f64,
    by_camera: DVector<f64>,
}

impl ShapeUncertainty {
    /// Standard deviation, with the uncertainty of the camera included.
    pub fn std<L: Lens>(&self, calibration: &Calibration<L>) -> f64 {
        let names = L::parameter_names();
        let mut by_free = DVector::zeros(calibration.parameters.len());
        for (place, name) in names.iter().enumerate() {
            if let Some(free) = calibration.position(name) {
                by_free[free] += self.by_camera[place];
            }
        }
        if let (true, Some(fx)) = (calibration.aspect_fixed, calibration.position("fx")) {
            let focal = calibration.camera.focal();
            by_free[fx] += self.by_camera[1] * focal.y / focal.x; // fy follows
        }
        let camera_variance = by_free.dot(&(&calibration.covariance * &by_free));
        (self.variance + camera_variance).sqrt()
    }
}

impl PlaneUncertainty {
    /// Creates it from the covariance of all estimated parameters of a plane where the camera is
    /// given, and from their derivative with respect to the camera; `None` where they are not
    /// finite.
    fn of(
        given_camera: &DMatrix<f64>,
        by_camera: &DMatrix<f64>,
        shape_parameters: usize,
    ) -> Option<Self> {
        let mut numbers = given_camera.iter().chain(by_camera.iter());
        let shape = POSE_PARAMETERS..POSE_PARAMETERS + shape_parameters;
        numbers.all(|number| number.is_finite()).then(|| Self {
            pose: PoseUncertainty {
                given_camera: given_camera.fixed_view::<6, 6>(0, 0).into_owned(),
                by_camera: by_camera.fixed_rows::<POSE_PARAMETERS>(0).into_owned(),
            },
            shape: shape
                .map(|parameter| ShapeUncertainty {
                    variance: given_camera[(parameter, parameter)],
                    by_camera: by_camera.row(parameter).transpose(),
                })
                .collect(),
        })
    }
}

/// Returns the uncertainty of every plane of an optimum; `None` where its own samples do not
/// determine its pose.
///
/// `independent` is the covariance of the free parameters under independent noise, which are in
/// these `columns` of the camera's; `displacements` are the errors of the sides of each plane
/// beyond that noise, px.
pub(crate) fn pose_uncertainties<L: Lens>(
    planes: &[ObservedPlane],
    refined: &Refined<L>,
    (independent, columns): (&DMatrix<f64>, &[usize]),
    displacements: &[f64],
) -> Vec<Option<PlaneUncertainty>> {
    let free = independent.nrows();
    let eliminated = refined.system.eliminated.as_ref();
    let eliminated = eliminated.map(|elimination| (elimination, elimination.covariance()));
    let system = refined.system.leading(free);
    let variance = match (free, system.reduced_information()) {
        (1.., Some(information)) => (information * independent).trace() / free as f64,
        _ => refined.covariance_factor,
    };
    let subsampled = planes.iter().map(|p| p.subsampled(SAMPLES_PER_SIDE));
    let subsampled: Vec<ObservedPlane> = subsampled.collect();
    let full_system = full_system(&subsampled, refined);
    let ties = system.own_ties();
    let full_ties = full_system.as_ref().and_then(ArrowSystem::own_ties);
    let gradients = subsampled.iter().enumerate();
    let gradients = gradients.map(|(i, plane)| side_gradients(plane, i, refined));
    let gradients: Vec<_> = gradients.collect();
    let plane_uncertainty = |(i, block): (usize, &Block)| {
        let full_block = &full_system.as_ref()?.blocks[i];
        let factor = full_block.hessian.clone().cholesky()?;
        let mut inverse = block.hessian.clone().cholesky()?.inverse();
        if let Some(ties) = &ties {
            inverse -= ties.reduction_between(i, i);
        }
        let size = factor.l_dirty().nrows(); // the pixels' blocks hold exposures as well
        let mut given_camera = inverse.view((0, 0), (size, size)) * variance;
        for response in side_responses(i, &factor, full_ties.as_ref(), &gradients, displacements)? {
            given_camera += &response * response.transpose();
        }
        let mut by_camera = -match &full_ties {
            Some(ties) => factor.solve(&ties.cross(full_block)),
            None => factor.solve(&full_block.cross),
        };
        if let Some((eliminated, covariance)) = &eliminated {
            let mut moves = DMatrix::zeros(size, covariance.nrows());
            let mut add = |block, response: DMatrix<f64>| {
                eliminated.add_derivatives(&mut moves, block, &response.rows(0, size).into_owned());
            };
            add(i, -inverse);
            if let Some(ties) = &ties {
                let others = (0..system.blocks.len()).filter(|other| *other != i);
                others.for_each(|other| add(other, ties.reduction_between(i, other)));
            }
            given_camera += &moves * covariance * moves.transpose() * variance;
            let eliminated_response = moves * &eliminated.by_kept;
            for (place, column) in columns.iter().enumerate() {
                let mut camera_column = by_camera.column_mut(*column);
                camera_column += eliminated_response.column(place);
            }
        }
        let shape_parameters = refined.view.planes[i].figures[0].parameter_count();
        PlaneUncertainty::of(&given_camera, &by_camera, shape_parameters)
    };
    system
        .blocks
        .iter()
        .enumerate()
        .map(plane_uncertainty)
        .collect()
}

/// Returns the moves of a plane's parameters when each side, one after the other, is displaced by
/// the error of its plane. Planes that are tied to each other are moved by each other's sides.
fn side_responses(
    plane: usize,
    factor: &Cholesky<f64, Dyn>,
    ties: Option<&Ties>,
    gradients: &[Option<Vec<DVector<f64>>>],
    displacements: &[f64],
) -> Option<Vec<DVector<f64>>> {
    let mut responses = Vec::new();
    let Some(ties) = ties else {
        for gradient in gradients[plane].as_ref()? {
            responses.push(factor.solve(gradient) * displacements[plane]);
        }
        return Some(responses);
    };
    for (other, gradients) in gradients.iter().enumerate() {
        let between = ties.reduction_between(plane, other);
        for gradient in gradients.as_ref()? {
            let mut response = -(&between * gradient);
            if other == plane {
                response += factor.solve(gradient);
            }
            responses.push(response * displacements[other]);
        }
    }
    Some(responses)
}

/// Returns the gradient, with respect to a plane's own parameters, of each of its sides with all
/// samples displaced by 1 px.
fn side_gradients<L: Lens>(
    plane: &ObservedPlane,
    index: usize,
    refined: &Refined<L>,
) -> Option<Vec<DVector<f64>>> {
    let (lens, state) = (&refined.view.lens, &refined.view.planes[index]);
    let none = Columns::of(std::iter::empty());
    let mut gradients = Vec::new();
    for (f, side) in plane.sides_by_figure() {
        let to_scale = side.weight_factor() / refined.scale;
        let mut gradient = DVector::zeros(state.parameter_count());
        for found in state.model_lines(lens, f, side) {
            let (model, range) = found?;
            let line = state.line(f, &model.line);
            let mut wrt_line = Vector3::zeros();
            for sample in &side.samples[range] {
                let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
                let distance = lens.line_distance_jacobian(&pixel_ray, &line, none);
                let to_noise = sample.weight * to_scale;
                let (_, weight) = Loss::Tukey.cost_and_weight(distance.value * to_noise);
                wrt_line += distance.wrt_line * (weight * to_noise * to_noise);
            }
            gradient += state.line_jacobian(f, &model).tr_mul(&wrt_line);
        }
        gradients.push(gradient);
    }
    Some(gradients)
}

/// Returns the normal equations over all of the camera's parameters.
fn full_system<L: Lens>(planes: &[ObservedPlane], refined: &Refined<L>) -> Option<ArrowSystem> {
    let all = FreeParameters::all::<L>();
    let problem = EdgeProblem::new(planes, &all, refined.scale);
    Some(problem.evaluate(&refined.view)?.1)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use crate::calibrate;
    use crate::geometry::Pose;
    use crate::image_size::ImageSize;
    use crate::lens::{Brown, Lens};
    use crate::observations::{Fixed, Options};
    use crate::result::Calibration;
    use crate::synthetic::{Scene, SceneOptions};

    /// Calibrates a scene with its camera held.
    fn held(scene: &Scene, camera: Brown) -> Calibration {
        let fixed = Fixed {
            focal: true,
            principal_point: true,
            distortion: true,
            ..Fixed::default()
        };
        let options = Options {
            fixed,
            initial: Some(camera),
            ..Options::default()
        };
        let size = ImageSize {
            width: 1280,
            height: 960,
        };
        calibrate(&scene.edges(1, 0.05, 4.0), size, &options).unwrap()
    }

    fn change(from: &Pose, to: &Pose) -> (Vector3<f64>, Vector3<f64>) {
        let turn = nalgebra::Rotation3::from_matrix(&(to.rotation * from.rotation.transpose()));
        (turn.scaled_axis(), to.translation - from.translation)
    }

    #[test]
    fn poses_follow_the_camera_as_they_do_when_fitted_again() {
        let scene = Scene::random(4, SceneOptions::default());
        let found = held(&scene, scene.camera);
        let parameters = scene.camera.parameters();
        let mut worst: f64 = 0.0;
        let steps = [1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1.0];
        for (i, step) in steps.iter().enumerate() {
            let mut moved = parameters.clone();
            moved[i] += step;
            let again = held(&scene, scene.camera.with_parameters(&moved));
            for (before, after) in found.planes.iter().zip(&again.planes) {
                let (turn, shift) = change(&before.pose, &after.pose);
                let expected = before.uncertainty.as_ref().unwrap().by_camera.column(i) * *step;
                let (turned, shifted) = (expected.fixed_rows::<3>(0), expected.fixed_rows::<3>(3));
                let size = turn.norm() + shift.norm();
                worst = worst.max(((turn - turned).norm() + (shift - shifted).norm()) / size);
            }
        }
        // The rest is the second order, and robust weights that differ a little between all samples
        // and some.
        assert!(worst < 0.1, "{worst}");
    }
}
