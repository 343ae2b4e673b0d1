"""Defective printed corners: badly folded, bent, stretched in print."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from trisquare.printing.layout import TargetPage
from trisquare.simulate.scene import Scene, Target
from trisquare_scenes.broken_assumptions import bent


def folded_off(scene: Scene, page: TargetPage, face: int, degrees: float) -> Scene:
    """Turn face 1 or 2 about its fold with face 0, so that the two meet at 90 less `degrees`."""
    target = scene.targets[face]
    half = 0.5 * page.face * _side(target) / page.frames[face].side
    axis, middle = ((1, (-half, 0.0)), (0, (0.0, -half)))[face - 1]
    angle = degrees if face == 1 else -degrees
    turn = cv2.Rodrigues(np.radians(angle) * target.rotation[:, axis])[0]
    held = target.to_camera(np.array([middle]))[0]
    turned = replace(
        target,
        rotation=turn @ target.rotation,
        translation=turn @ (target.translation - held) + held,
    )
    return _with(scene, face, turned)


def with_bent_face(scene: Scene, face: int, bow: float, direction: float) -> Scene:
    """Bend a face to a cylinder whose rise over the face is `bow` of its side.

    `direction` is that of the cylinder's axis in the plane, radians.
    """
    target = scene.targets[face]
    curvature = 8.0 * bow / _side(target)
    return _with(scene, face, bent(target, curvature=curvature, direction=direction))


def stretched(scene: Scene, stretch: float) -> Scene:
    """Stretch the print along the sheet's first axis, by a fraction of its length."""
    along_x = np.diag([1.0 + stretch, 1.0, 1.0])
    targets = (replace(target, rotation=target.rotation @ along_x) for target in scene.targets)
    return replace(scene, targets=tuple(targets))


def _side(target: Target) -> float:
    """Return the figure's side, in the plane's unit."""
    return 2.0 * target.extent[0]


def _with(scene: Scene, face: int, target: Target) -> Scene:
    targets = list(scene.targets)
    targets[face] = target
    return replace(scene, targets=tuple(targets))
