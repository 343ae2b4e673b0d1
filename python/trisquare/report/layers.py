"""What a report shows of a photograph: pictures as JPEG, and measured lines drawn over them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare.analysis.residuals import MeasuredSide
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.drawing.overlay import round_exaggeration
from trisquare.images.pixels import Image, picture_size
from trisquare.report.pictures import ReportedPicture
from trisquare.report.plot_style import SERIES
from trisquare.results.calibration import Calibration
from trisquare.undistortion.undistort import Undistorter

JPEG_QUALITY = 85
"""Its errors are under what a screen shows at this size."""

CURVE_POINTS = 25
"""Points of a drawn side: no lens bends one so much that a screen shows the chords."""

MOST_NEEDLES = 3000
"""Residuals drawn in a picture: more would be one blot, and a file too large for a mail."""


@dataclass(frozen=True, slots=True)
class PlaneLayer:
    """A plane's lines as paths of SVG, in pixels of the photograph or of the undistorted one."""

    number: int
    colour: int
    x: float
    y: float
    sides: str
    needles: str


@dataclass(frozen=True, slots=True)
class RejectedLayer:
    """The outline of a candidate that was not used."""

    outline: str


@dataclass(frozen=True, slots=True)
class PictureLayers:
    """A photograph and its undistorted self, each with its lines.

    `photograph` and `undistorted` are data URIs, or None where there is no photograph, or no
    undistorting it; `view_box` is in pixels, whose centres are whole numbers. `exaggeration` and
    `rms` are those of the residuals, of which one in `every` is drawn.
    """

    name: str
    index: int
    photograph: str | None
    undistorted: str | None
    view_box: str
    ratio: str
    label_size: float
    centre: tuple[float, float]
    planes: tuple[PlaneLayer, ...]
    undistorted_planes: tuple[PlaneLayer, ...]
    rejected: tuple[RejectedLayer, ...]
    exaggeration: float
    rms: float | None
    every: int


def picture_layers(calibration: Calibration, picture: ReportedPicture) -> PictureLayers:
    """Prepare what is shown of a picture."""
    camera = calibration.camera
    width, height = camera.image_size
    sides = picture.sides
    samples = sum(len(side.residuals) for side in sides)
    rms = float(np.sqrt(np.mean(np.concatenate([s.residuals for s in sides]) ** 2))) if sides else 0
    exaggeration = round_exaggeration(rms, float(np.hypot(width, height)))
    every = -(-samples // MOST_NEEDLES) or 1
    pinhole, undistorted = _undistorted(camera, picture.pixels)
    return PictureLayers(
        name=picture.name,
        index=picture.index,
        photograph=None if picture.pixels is None else jpeg_uri(picture.pixels),
        undistorted=None if undistorted is None else jpeg_uri(undistorted),
        view_box=f"-0.5 -0.5 {width} {height}",
        ratio=f"{width} / {height}",
        label_size=max(width, height) / 32.0,
        centre=(camera.cx, camera.cy),
        planes=_plane_layers(calibration, picture, None, exaggeration, every),
        undistorted_planes=(
            () if pinhole is None else _plane_layers(calibration, picture, pinhole, 0.0, every)
        ),
        rejected=tuple(
            RejectedLayer(_path(np.vstack([other.corners, other.corners[:1]])))
            for other in calibration.rejected
            if other.image == picture.index
        ),
        exaggeration=exaggeration,
        rms=rms if sides else None,
        every=every,
    )


def jpeg_uri(pixels: Image) -> str:
    """Return 8-bit pixels as the URI of a JPEG that it holds itself."""
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")


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


def _plane_layers(
    calibration: Calibration,
    picture: ReportedPicture,
    pinhole: Camera | None,
    exaggeration: float,
    every: int,
) -> tuple[PlaneLayer, ...]:
    """Lay out the planes of a picture, seen through a pinhole or as they are."""
    layers = []
    camera = calibration.camera
    for number, plane in enumerate(calibration.planes):
        if plane.image != picture.index:
            continue
        own = [side for side in picture.sides if side.plane == number]
        curves = [_thinned(side.curve) for side in own]
        # Without samples, the corners tell where the plane is.
        curves = curves or [np.vstack([plane.corners, plane.corners[:1]])]
        centre = plane.corners.mean(axis=0, keepdims=True)
        if pinhole is not None:
            curves = [_through(pinhole, camera, curve) for curve in curves]
            centre = _through(pinhole, camera, centre)
        if len(centre) == 0:
            continue
        x, y = centre[0].tolist()
        needles = "" if pinhole is not None else _needles(own, exaggeration, every)
        sides = "".join(_path(curve) for curve in curves)
        layers.append(PlaneLayer(number, number % SERIES, x, y, sides, needles))
    return tuple(layers)


def _thinned(curve: FloatArray) -> FloatArray:
    kept = np.linspace(0, len(curve) - 1, min(CURVE_POINTS, len(curve))).astype(int)
    return np.asarray(curve[kept])


def _through(pinhole: Camera, camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return where a pinhole sees what pixels show, but for those that the camera cannot tell."""
    known = np.array(_core.can_unproject(camera_for_core(camera), np.ascontiguousarray(pixels)))
    return pinhole.project(camera.unproject(pixels[known.astype(bool)]))


def _needles(sides: Sequence[MeasuredSide], exaggeration: float, every: int) -> str:
    path = []
    for side in sides:
        tips = side.points + exaggeration * side.residuals[:, None] * side.normals
        path += [_path(needle) for needle in np.stack([side.points, tips], axis=1)[::every]]
    return "".join(path)


def _path(points: FloatArray) -> str:
    """Return a polyline as SVG's path; a tenth of a pixel is finer than a screen's."""
    return "".join(
        f"{'L' if place else 'M'}{x:.1f} {y:.1f}" for place, (x, y) in enumerate(points.tolist())
    )
