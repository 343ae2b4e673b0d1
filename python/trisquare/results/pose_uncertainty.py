"""How well a plane's pose is known, together with the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray, RebuiltByConstructor, real_array
from trisquare._support.json_members import JsonFields

POSE_PARAMETERS = 6
CAMERA_PARAMETERS = 9


@dataclass(frozen=True, slots=True, eq=False)
class PoseUncertainty(RebuiltByConstructor):
    """How well a pose is known, and how it would follow another camera.

    A pose's parameters are a rotation vector applied after its rotation, in camera coordinates
    (radians), and the translation (units of the square's side).

    Parameters
    ----------
    given_camera : array_like, shape (6, 6)
        Covariance of the pose where the camera is given.
    by_camera : array_like, shape (6, 9)
        Derivative of the pose by all of the camera's parameters, free or held, in the order
        ``fx fy cx cy k1 k2 k3 p1 p2``.
    """

    given_camera: FloatArray
    by_camera: FloatArray

    def __post_init__(self) -> None:
        shape = (POSE_PARAMETERS, POSE_PARAMETERS)
        given_camera = real_array(self.given_camera, "given_camera", shape)
        object.__setattr__(self, "given_camera", given_camera)
        by_camera = real_array(self.by_camera, "by_camera", (POSE_PARAMETERS, CAMERA_PARAMETERS))
        object.__setattr__(self, "by_camera", by_camera)

    def __repr__(self) -> str:
        turn, shift = np.sqrt(np.diag(self.given_camera)).reshape(2, 3).max(axis=1).tolist()
        return f"<PoseUncertainty given the camera: {turn:.2g} rad, {shift:.2g} sides>"


def uncertainty_members(uncertainty: PoseUncertainty) -> dict[str, Any]:
    """Return the ``pose_uncertainty`` object of the JSON format."""
    return {
        "given_camera": uncertainty.given_camera.tolist(),
        "by_camera": uncertainty.by_camera.tolist(),
    }


def uncertainty_from_members(members: JsonFields) -> PoseUncertainty:
    """Read the ``pose_uncertainty`` object of the JSON format."""
    return PoseUncertainty(
        given_camera=members.array("given_camera", (POSE_PARAMETERS, POSE_PARAMETERS)),
        by_camera=members.array("by_camera", (POSE_PARAMETERS, CAMERA_PARAMETERS)),
    )
