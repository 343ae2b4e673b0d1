"""Layers of a report's pictures: the photograph, undistorted too, with measured lines over both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.analysis.residuals import measured_sides
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.drawing.overlay import drawn_residuals, needles
from trisquare.images.pixels import Image, picture_size
from trisquare.report.pictures import jpeg_uri
from trisquare.results.calibration import Calibration
from trisquare.undistortion.undistort import Undistorter

CURVE_POINTS = 25
"""Number of points of a drawn side: the chords between them are not visible on a screen."""

MAX_NEEDLES = 3000
"""Maximum number of residuals drawn in a picture: more would overlap, and make the file too large
to be sent by mail."""


@dataclass(frozen=True, slots=True)
class PlaneLayer:
    """A plane's lines as SVG paths, in pixels of the photograph or of the undistorted picture."""

    number: int
    x: float
    y: float
    sides: str
    needles: str


@dataclass(frozen=True, slots=True)
class PictureLayers:
    """A photograph and its undistorted version, each with its lines.

    `photograph` and `undistorted` are data URIs, or None if there is no photograph or it cannot be
    undistorted; `rejected` are SVG paths. `exaggeration` and `rms` are those of the residuals, of
    which one in `every` is drawn; `rms` is None if there are none.
    """

    index: int
    photograph: str | None
    undistorted: str | None
    planes: tuple[PlaneLayer, ...]
    undistorted_planes: tuple[PlaneLayer, ...]
    rejected: tuple[str, ...]
    exaggeration: float
    rms: float | None
    every: int


def picture_layers(calibration: Calibration, index: int, pixels: Image | None) -> PictureLayers:
    """Return the layers of a picture; `pixels` are those of its photograph, as shown."""
    camera = calibration.camera
    sides = list(measured_sides(calibration, index))
    rms, exaggeration = drawn_residuals(sides, camera.image_size)
    every = -(-sum(len(side.residuals) for side in sides) // MAX_NEEDLES) or 1
    pinhole, undistorted = _undistorted(camera, pixels)
    seen, straight = [], []
    for number, plane in enumerate(calibration.planes):
        if plane.image != index:
            continue
        plane_sides = [side for side in sides if side.plane == number]
        # Without samples, the outline of the corners is drawn.
        curves = [_thinned(side.curve) for side in plane_sides] or [_closed(plane.corners)]
        centre = plane.corners.mean(axis=0, keepdims=True)
        lines = [_path(n) for side in plane_sides for n in needles(side, exaggeration)[::every]]
        seen.append(_plane_layer(number, centre, curves, lines))
        if pinhole is not None:
            centre, *curves = (_through(pinhole, camera, line) for line in (centre, *curves))
            if len(centre) > 0:
                straight.append(_plane_layer(number, centre, curves, []))
    rejected = [candidate.corners for candidate in calibration.rejected if candidate.image == index]
    return PictureLayers(
        index=index,
        photograph=None if pixels is None else jpeg_uri(pixels),
        undistorted=None if undistorted is None else jpeg_uri(undistorted),
        planes=tuple(seen),
        undistorted_planes=tuple(straight),
        rejected=tuple(_path(_closed(corners)) for corners in rejected),
        exaggeration=exaggeration,
        rms=rms if sides else None,
        every=every,
    )


def _undistorted(camera: Camera, pixels: Image | None) -> tuple[Camera | None, Image | None]:
    """Return the pinhole of `trisquare undistort`, and the picture that it sees.

    Both are None if no part of the picture can be undistorted. The size of the pinhole's picture is
    that of the photograph, whatever size is shown.
    """
    try:
        pinhole = camera.undistorted()
        if pixels is None:
            return pinhole, None
        shown_camera = camera.rescaled(picture_size(pixels))
        shown_pinhole = pinhole.rescaled(picture_size(pixels))
        undistorter = Undistorter(shown_camera, new_camera=shown_pinhole)
        return pinhole, undistorter.undistort(pixels)
    except ValueError:
        return None, None


def _plane_layer(
    number: int, centre: FloatArray, curves: Sequence[FloatArray], lines: Sequence[str]
) -> PlaneLayer:
    x, y = centre[0].tolist()
    return PlaneLayer(number, x, y, "".join(_path(curve) for curve in curves), "".join(lines))


def _thinned(curve: FloatArray) -> FloatArray:
    indices = np.linspace(0, len(curve) - 1, min(CURVE_POINTS, len(curve))).astype(int)
    return np.asarray(curve[indices])


def _through(pinhole: Camera, camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return the pixels of a pinhole that show the same; those without a direction are left out."""
    can_unproject = np.array(
        _core.can_unproject(camera_for_core(camera), np.ascontiguousarray(pixels))
    )
    return pinhole.project(camera.unproject(pixels[can_unproject.astype(bool)]))


def _closed(corners: FloatArray) -> FloatArray:
    return np.vstack([corners, corners[:1]])


def _path(points: FloatArray) -> str:
    """Return a polyline as an SVG path; a tenth of a pixel is finer than a screen's."""
    return "".join(
        f"{'L' if place else 'M'}{x:.1f} {y:.1f}" for place, (x, y) in enumerate(points.tolist())
    )
