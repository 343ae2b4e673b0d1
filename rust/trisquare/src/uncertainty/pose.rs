//! How well the poses of the planes are known, together with the camera.
//!
//! With `H` and `C` a plane's block of the normal equations and its cross terms with the camera,
//! the pose that fits best follows the camera by `-H^-1 C`, and is known to `H^-1` (in units of
//! the noise) where the camera is given. The covariance of camera and pose together follows from
//! these and from the camera's own, whether it was found from the same planes or from others.
//! Where the sides of a plane err together (paper that is not flat), each side's error moves the
//! pose as the sum of its samples' gradients.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::lens::{Columns, Lens};
use crate::numeric::{ArrowSystem, Block, Loss, Problem};
use crate::observations::{FreeParameters, ObservedPlane, POSE_PARAMETERS};
use crate::refine::{EdgeProblem, Refined};
use crate::result::PoseUncertainty;

/// Samples of each side from which it is told how a pose follows the camera: that depends on where
/// the sides are, and little on how densely they are sampled.
const SAMPLES_PER_SIDE: usize = 16;

/// Of every plane of an optimum, `None` where its own samples do not determine its pose.
///
/// `independent` is the covariance of the free parameters that independent noise gives, and
/// `displacements` are what the sides of each plane err by beyond it, px.
pub(crate) fn pose_uncertainties<L: Lens>(
    planes: &[ObservedPlane],
    refined: &Refined<L>,
    independent: &DMatrix<f64>,
    displacements: &[f64],
) -> Vec<Option<PoseUncertainty>> {
    let free = independent.nrows();
    let system = refined.system.leading(free);
    let variance = match (free, system.reduced_information()) {
        (1.., Some(information)) => (information * independent).trace() / free as f64,
        _ => refined.covariance_factor,
    };
    let subsampled = planes.iter().map(|p| p.subsampled(SAMPLES_PER_SIDE));
    let some: Vec<ObservedPlane> = subsampled.collect();
    let following = following(&some, refined);
    let of_plane = |(i, block): (usize, &Block)| {
        let follows = &following.as_ref()?.blocks[i];
        let factor = follows.hessian.clone().cholesky()?;
        let inverse = block.hessian.clone().cholesky()?.inverse();
        let mut given_camera =
            inverse.fixed_view::<POSE_PARAMETERS, POSE_PARAMETERS>(0, 0) * variance;
        for gradient in gradients_of_sides(&some[i], i, refined)? {
            let moved = factor.solve(&gradient) * displacements[i];
            let moved = moved.fixed_rows::<POSE_PARAMETERS>(0);
            given_camera += moved * moved.transpose();
        }
        let by_camera = -factor.solve(&follows.cross);
        let found = PoseUncertainty {
            given_camera,
            by_camera: by_camera.fixed_rows::<POSE_PARAMETERS>(0).into_owned(),
        };
        let finite = found.given_camera.iter().chain(found.by_camera.iter());
        finite.copied().all(f64::is_finite).then_some(found)
    };
    system.blocks.iter().enumerate().map(of_plane).collect()
}

/// The gradient, by a plane's own parameters, of each of its sides' samples all displaced by 1 px.
fn gradients_of_sides<L: Lens>(
    plane: &ObservedPlane,
    index: usize,
    refined: &Refined<L>,
) -> Option<Vec<DVector<f64>>> {
    let (lens, state) = (&refined.view.lens, &refined.view.planes[index]);
    let none = Columns::of(std::iter::empty());
    let mut gradients = Vec::new();
    for (f, side) in plane.sides_by_figure() {
        let line = state.line(f, side);
        let to_scale = side.trust() / refined.scale;
        let mut wrt_line = Vector3::zeros();
        for sample in &side.samples {
            let pixel_ray = lens.unproject_with_jacobian(&sample.pixel)?;
            let distance = lens.line_distance_jacobian(&pixel_ray, &line, none);
            let to_noise = sample.weight * to_scale;
            let (_, weight) = Loss::Tukey.cost_and_weight(distance.value * to_noise);
            wrt_line += distance.wrt_line * (weight * to_noise * to_noise);
        }
        gradients.push(state.line_jacobian(f, side).tr_mul(&wrt_line));
    }
    Some(gradients)
}

/// The normal equations over all of the camera's parameters.
fn following<L: Lens>(planes: &[ObservedPlane], refined: &Refined<L>) -> Option<ArrowSystem> {
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

    /// The calibration of a scene, its camera held.
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
        let steps = [1.0, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4];
        for (i, step) in steps.iter().enumerate() {
            let mut moved: [f64; 9] = parameters.as_slice().try_into().unwrap();
            moved[i] += step;
            let again = held(&scene, Brown::new(moved));
            for (before, after) in found.planes.iter().zip(&again.planes) {
                let (turn, shift) = change(&before.pose, &after.pose);
                let expected = before.uncertainty.as_ref().unwrap().by_camera.column(i) * *step;
                let (turned, shifted) = (expected.fixed_rows::<3>(0), expected.fixed_rows::<3>(3));
                let size = turn.norm() + shift.norm();
                worst = worst.max(((turn - turned).norm() + (shift - shifted).norm()) / size);
            }
        }
        // Second order, and robust weights that differ a little between all samples and some.
        assert!(worst < 0.1, "{worst}");
    }
}
