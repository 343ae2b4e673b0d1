"""What a report shows of a photograph: it and its undistorted self, measured lines over both."""

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
"""Points of a drawn side: no lens bends one so much that a screen shows the chords."""

MAX_NEEDLES = 3000
"""Residuals drawn in a picture: more would be one blot, and a file too large for a mail."""


@dataclass(frozen=True, slots=True)
class PlaneLayer:
    """A plane's lines as paths of SVG, in pixels of the photograph or of the undistorted one."""

    number: int
    x: float
    y: float
    sides: str
    needles: str


@dataclass(frozen=True, slots=True)
class PictureLayers:
    """A photograph and its undistorted self, each with its lines.

    `photograph` and `undistorted` are data URIs, or None where there is no photograph, or no
    undistorting it; `rejected` are paths of SVG. `exaggeration` and `rms` are those of the
    residuals, of which one in `every` is drawn; `rms` is None where there are none.
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
    """Prepare what is shown of a picture; `pixels` are those of its photograph, as shown."""
    camera = calibration.camera
    sides = list(measured_sides(calibration, index))
    rms, exaggeration = drawn_residuals(sides, camera.image_size)
    every = -(-sum(len(side.residuals) for side in sides) // MAX_NEEDLES) or 1
    pinhole, undistorted = _undistorted(camera, pixels)
    seen, straight = [], []
    for number, plane in enumerate(calibration.planes):
        if plane.image != index:
            continue
        own = [side for side in sides if side.plane == number]
        # Without samples, the corners tell where the plane is.
        curves = [_thinned(side.curve) for side in own] or [_closed(plane.corners)]
        centre = plane.corners.mean(axis=0, keepdims=True)
        lines = [_path(n) for side in own for n in needles(side, exaggeration)[::every]]
        seen.append(_plane_layer(number, centre, curves, lines))
        if pinhole is not None:
            centre, *curves = (_through(pinhole, camera, line) for line in (centre, *curves))
            if len(centre) > 0:
                straight.append(_plane_layer(number, centre, curves, []))
    rejected = [other.corners for other in calibration.rejected if other.image == index]
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
    """Return the pinhole that `trisquare undistort` looks through, and what it sees.

    None where nothing of the picture can be undistorted. The pinhole is of the photograph's own
    size, whatever size is shown.
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
    kept = np.linspace(0, len(curve) - 1, min(CURVE_POINTS, len(curve))).astype(int)
    return np.asarray(curve[kept])


def _through(pinhole: Camera, camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return where a pinhole sees what pixels show, but for those that the camera cannot tell."""
    known = np.array(_core.can_unproject(camera_for_core(camera), np.ascontiguousarray(pixels)))
    return pinhole.project(camera.unproject(pixels[known.astype(bool)]))


def _closed(corners: FloatArray) -> FloatArray:
    return np.vstack([corners, corners[:1]])


def _path(points: FloatArray) -> str:
    """Return a polyline as SVG's path; a tenth of a pixel is finer than a screen's."""
    return "".join(
        f"{'L' if place else 'M'}{x:.1f} {y:.1f}" for place, (x, y) in enumerate(points.tolist())
    )
