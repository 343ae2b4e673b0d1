"""A photograph with the measured edges, and their residuals from the calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trisquare._support.arrays import FloatArray, real_number, whole_number
from trisquare._support.number_text import plus_minus
from trisquare.analysis.residuals import MeasuredSide, measured_sides
from trisquare.camera.camera import camera_parameters
from trisquare.drawing.canvas import (
    Canvas,
    Colour,
    dimmed_grey,
    draw_label,
    draw_legend,
    draw_lines,
    text_scale,
)
from trisquare.drawing.straight_lines import draw_used_and_rejected
from trisquare.images.pixels import ImageSource, picture_size
from trisquare.images.reading import load_picture
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

# BGR. The sides have different colours so that a wrong order can be seen.
SIDE_COLOURS: tuple[Colour, ...] = (
    (80, 220, 255),
    (255, 200, 60),
    (160, 255, 120),
    (255, 140, 220),
)
AXIS_COLOURS: tuple[Colour, ...] = ((60, 60, 255), (60, 220, 60), (255, 120, 60))
RESIDUAL_COLOUR: Colour = (40, 140, 255)
CENTRE_COLOUR: Colour = (255, 255, 255)
CHORD_COLOUR: Colour = (190, 190, 190)
TEXT_COLOUR: Colour = (240, 240, 240)

# Drawn length of the residuals' root mean square, relative to the picture's diagonal.
DRAWN_RESIDUAL = 0.01


def draw_overlay(
    image: ImageSource,
    calibration: Calibration,
    *,
    index: int = 0,
    exaggeration: float | None = None,
) -> Canvas:
    """Draw a calibration over its photograph.

    It shows the photograph, grey and dimmed; the scene's straight lines, those rejected in red;
    each side as the calibration sees it, and its chord as a thin line, which is where a lens
    without distortion would show it; the residuals of its samples as exaggerated normals; each
    plane's number and axes (X red, Y green, Z blue, half a side long) through the full lens model;
    the principal point as a cross; a legend.

    Parameters
    ----------
    image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
        The photograph, grey or BGR; float pictures are taken to span 0 to 1.
    calibration : Calibration
        The calibration to draw; without its edges no samples and residuals are drawn.
    index : int
        Index of this picture among the calibration's.
    exaggeration : float, optional
        Factor by which the residuals are lengthened; by default the round number that draws their
        root mean square about a hundredth of the diagonal long. The legend states it.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)
        BGR.

    Raises
    ------
    ImageError
        If a file is not a complete picture.
    TypeError, ValueError
        If an argument is of another type, the calibration has no such picture, or the picture is
        not of the camera's size.

    Examples
    --------
    >>> ts.draw_overlay("photo.jpg", result).shape  # cv2.imwrite writes it
    (960, 1280, 3)
    """
    if not isinstance(calibration, Calibration):
        raise TypeError(f"calibration must be a Calibration, not {type(calibration).__name__}")
    picture = load_picture(image)
    if picture_size(picture) != calibration.camera.image_size:
        size, camera_size = picture_size(picture), calibration.camera.image_size
        raise ValueError(
            f"the picture has {size[0]} x {size[1]} pixels, but the camera's pictures "
            f"have {camera_size[0]} x {camera_size[1]}"
        )
    picture_counts = (plane.image + 1 for plane in calibration.planes)
    count = max([len(calibration.pictures), *picture_counts])
    if not 0 <= whole_number(index, "index") < count:
        raise ValueError(f"index must be from 0 to {count - 1}, as there are pictures, not {index}")
    if exaggeration is not None:
        exaggeration = real_number(exaggeration, "exaggeration")
    canvas = dimmed_grey(picture)
    thickness = max(1, round(max(canvas.shape) / 1600))
    sides = list(measured_sides(calibration, index))
    rms, readable = drawn_residuals(sides, picture_size(canvas))
    exaggeration = readable if exaggeration is None else exaggeration
    lines = [line for line in calibration.lines if line.image == index]
    used = [line.points for line in lines if line.is_used]
    rejected = [line.points for line in lines if not line.is_used]
    line_entries = draw_used_and_rejected(canvas, used, rejected, " of the scene") if lines else []
    for side in sides:
        draw_lines(canvas, list(needles(side, exaggeration)), RESIDUAL_COLOUR, thickness)
    for number, side in enumerate(sides):
        draw_lines(canvas, [side.curve[[0, -1]]], CHORD_COLOUR, thickness)
        draw_lines(canvas, [side.curve], SIDE_COLOURS[number % 4], 2 * thickness)
    for number, plane in enumerate(calibration.planes):
        if plane.image == index:
            _draw_axes(canvas, calibration, plane, number, thickness)
    centre = np.array([calibration.camera.cx, calibration.camera.cy])
    arm = max(4.0, max(canvas.shape) / 100)
    cross = [np.array([centre - step, centre + step]) for step in ([arm, 0.0], [0.0, arm])]
    draw_lines(canvas, cross, CENTRE_COLOUR, thickness)
    entries = _legend_entries(calibration)
    if sides:
        entries.append(("chords of the sides", CHORD_COLOUR))
        entries.append((f"residuals drawn x {exaggeration:g} (rms {rms:.2g} px)", RESIDUAL_COLOUR))
    corners = [plane.corners for plane in calibration.planes if plane.image == index]
    points_to_keep = [*corners, *(side.points for side in sides), *used, *rejected]
    draw_legend(canvas, entries + line_entries, np.vstack([np.empty((0, 2)), *points_to_keep]))
    return canvas


def drawn_residuals(sides: Sequence[MeasuredSide], size: tuple[int, int]) -> tuple[float, float]:
    """Return the rms of the residuals in a picture, and the factor by which to draw them longer.

    The factor is 1, 2 or 5 times a power of ten, and makes them visible.
    """
    residuals = np.concatenate([side.residuals for side in sides]) if sides else np.zeros(1)
    rms = float(np.sqrt(np.mean(residuals**2)))
    length = DRAWN_RESIDUAL * float(np.hypot(*size)) / max(rms, 1e-9)
    power = 10.0 ** np.floor(np.log10(length))
    steps = [step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)]
    return rms, float(max(steps))


def needles(side: MeasuredSide, exaggeration: float) -> FloatArray:
    """Return a line from each sample along its residual, shape (N, 2, 2)."""
    tips = side.points + exaggeration * side.residuals[:, None] * side.normals
    return np.stack([side.points, tips], axis=1)


def _draw_axes(
    canvas: Canvas, calibration: Calibration, plane: Plane, number: int, thickness: int
) -> None:
    if plane.translation[2] <= 0:
        return
    steps = np.linspace(0, 0.5, 17)
    size = text_scale(canvas)
    origin = _projected(calibration, plane, np.zeros((1, 3)))
    if not len(origin):
        return  # beyond the valid radius
    origin = origin[0]
    directions = []
    for axis, (name, colour) in enumerate(zip("XYZ", AXIS_COLOURS, strict=True)):
        points = np.zeros((len(steps), 3))
        points[:, axis] = steps
        curve = _projected(calibration, plane, points)
        if len(curve) < 2:
            continue
        draw_lines(canvas, [curve], colour, 3 * thickness)
        direction = (curve[-1] - origin) / max(float(np.hypot(*(curve[-1] - origin))), 1.0)
        directions.append(direction)
        draw_label(canvas, name, curve[-1] + 24 * size * direction, colour, size)
    # The number is placed farthest from the directions of the axes.
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    candidates = np.column_stack([np.cos(angles), np.sin(angles)])
    free_direction = (
        candidates[np.argmin((candidates @ np.transpose(directions)).max(axis=1))]
        if directions
        else np.zeros(2)
    )
    draw_label(canvas, str(number), origin + 28 * size * free_direction, CENTRE_COLOUR, 1.2 * size)


def _projected(calibration: Calibration, plane: Plane, points: FloatArray) -> FloatArray:
    """Project points of a plane's frame, shape (N, 3), as far as the camera sees them."""
    seen = points @ plane.rotation.T + plane.translation
    camera = calibration.camera
    return camera.project(seen[camera.can_project(seen)])


def _legend_entries(calibration: Calibration) -> list[tuple[str, Colour]]:
    entries = []
    for name, value in camera_parameters(calibration.camera).items():
        if name in calibration.std:
            text = plus_minus(value, calibration.std[name])
            entries.append((f"{name}  {text}", TEXT_COLOUR))
    entries.append(("+ principal point", CENTRE_COLOUR))
    if calibration.warnings:
        entries.append((f"{len(calibration.warnings)} warning(s)", RESIDUAL_COLOUR))
    return entries
