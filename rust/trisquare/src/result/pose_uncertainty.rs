//! How well the pose of a plane is known.

use nalgebra::{Matrix6, Matrix6xX};

/// How well a pose is known, and how it would follow another camera.
///
/// A pose's parameters are a rotation vector applied after its rotation, in camera coordinates
/// (radians), and the translation (units of the plane).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PoseUncertainty {
    /// Covariance of the pose where the camera is given.
    pub given_camera: Matrix6<f64>,
    /// Derivative of the pose by all of the camera's parameters, free or held, in the order of
    /// [`Lens::parameter_names`](crate::lens::Lens::parameter_names).
    pub by_camera: Matrix6xX<f64>,
}
