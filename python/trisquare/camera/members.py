"""The camera as members of JSON objects."""

from __future__ import annotations

import math
from typing import Any

from trisquare._support.arrays import size_of_image
from trisquare._support.json_members import JsonFields
from trisquare.camera.camera import Camera, camera_matrix
from trisquare.camera.lens_models import COEFFICIENTS, checked_model


def camera_members(camera: Camera) -> dict[str, Any]:
    """Return the ``camera`` object of the JSON format."""
    return {
        "model": camera.model,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        **({"skew": camera.skew} if camera.skew else {}),
        "distortion": camera.distortion.tolist(),
        "valid_radius": camera.valid_radius,
    }


def camera_from_members(members: JsonFields, image_size: tuple[int, ...]) -> Camera:
    """Read the ``camera`` object of the JSON format."""
    fx, fy, cx, cy = (members.number(name) for name in ("fx", "fy", "cx", "cy"))
    skew = members.number_or("skew", 0.0)
    unlimited = members.value("valid_radius") is None
    model = checked_model(members.text("model"))
    return Camera(
        K=camera_matrix(fx, fy, cx, cy, skew),
        distortion=members.array("distortion", (len(COEFFICIENTS[model]),)),
        image_size=size_of_image(image_size),
        model=model,
        valid_radius=math.inf if unlimited else members.number("valid_radius"),
    )
