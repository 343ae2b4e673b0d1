"""Prediction for a photograph if it were taken now, and the change that would help most.

The squares' poses come from their outlines alone, with a guessed camera: square pixels, the
principal point in the centre of the picture, and the focal length and, if sides are curved, the
distortion that fit the outlines best. Standard deviations depend only weakly on the guess.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.convex_quads import quad_areas
from trisquare._support.rotations import tilted
from trisquare.analysis.plan import PlannedSquare, posed, predicted
from trisquare.analysis.predict import predict
from trisquare.calibration.calibrate import calibrate_edges
from trisquare.camera.camera import Camera, centred_pinhole
from trisquare.camera.lens_models import LensModel, is_fisheye
from trisquare.camera.settings import Method
from trisquare.edges import PlaneEdges
from trisquare.errors import DegenerateGeometryError, NotEnoughPlanesError, TrisquareError
from trisquare.results.calibration import Calibration
from trisquare.results.plane import Plane

ENOUGH_SQUARES = 3
SIGMA = 0.03
"""Standard deviation of an edge sample of a sharp picture, pixels."""

COARSE = 8.0
"""Pixels of edge per sample if only ratios are needed, which hardly depend on it."""

OUTLINE_SAMPLES = 12
"""Number of points that represent a straight side."""

METHOD: Method = "linear"
"""Method for a guess: accurate enough, and a hundred times as fast as the joint fit."""

GUESSED_FOCAL = 0.9
"""Focal length over the picture's width, if the outlines do not determine it: a phone's camera."""

FOCAL_RANGE = (0.3, 4.0)
"""Range of focal lengths over the picture's width; estimates outside it are noise."""

MORE_TILT = 12.0  # degrees
MAX_TILT = 60.0
"""Maximum tilt, degrees: beyond it, a square is too foreshortened to be found."""

ENLARGEMENT = 1.25
MAX_GOOD_STD = 5e-4
"""Standard deviation that is good enough, relative to focal length and picture width."""

WORTHWHILE = 0.93
"""Ratio of the standard deviations after and before a change, above which it is not mentioned."""

TILT_EDGES = {0.0: "lower", 90.0: "left", 180.0: "upper", 270.0: "right"}
"""Direction of a tilt, and the edge of the square that it moves away from the camera."""

MIN_NAMED_OFFSET = 0.12
"""Distance from the centre, as a fraction of the picture's size, above which a position has the
name of a side."""


@dataclass(frozen=True, slots=True)
class Guidance:
    """Predicted precision of a photograph, and advice.

    Attributes
    ----------
    std : dict of str to float, or None
        Predicted standard deviations by parameter, pixels for ``fx fy cx cy``; None if the squares
        do not determine the camera.
    focal : float
        Focal length of the guessed camera, pixels.
    advice : str
        One sentence of advice.
    is_enough : bool
        Whether the camera would be known well, or no single change would improve it much.
    """

    std: dict[str, float] | None
    focal: float
    advice: str
    is_enough: bool


class OutlinedSquare(NamedTuple):
    """A square or a frame in the picture.

    Attributes
    ----------
    corners : ndarray, shape (4, 2)
    inner : ndarray, shape (4, 2), or None
        Corners of the hole, if it is a frame.
    sides : sequence of four ndarrays, shape (N, 2), or None
        Points along the sides, if they were found; else the sides are assumed to be straight.
    """

    corners: FloatArray
    inner: FloatArray | None = None
    sides: Sequence[FloatArray] | None = None


def guide(
    squares: Sequence[OutlinedSquare],
    image_size: tuple[int, int],
    camera: Camera | None = None,
    *,
    sigma: float = SIGMA,
) -> Guidance:
    """Predict the precision of a photograph of these outlines.

    Parameters
    ----------
    squares : sequence of OutlinedSquare
        Outlines as found, with errors of a pixel or two.
    image_size : (int, int)
        Width and height.
    camera : Camera, optional
        An earlier calibration of the camera, for pictures of this size, instead of a guess.
    sigma : float
        As in `predict`.

    Raises
    ------
    TypeError, ValueError
        For bad arguments.
    """
    guess, posed_squares = _posed_squares(squares, image_size, camera)
    planes = [plane for _, plane in posed_squares]
    missing = ENOUGH_SQUARES - len(planes)
    if missing > 0:
        count_text = "no square is found" if not planes else f"{len(planes)} of 3 squares found"
        request = "three squares" if missing == 3 else "one more" if missing == 1 else "two more"
        advice = f"{count_text}: show {request}, tilted in different directions"
        return Guidance(None, guess.fx, advice[0].upper() + advice[1:] + ".", False)
    try:
        prediction = predict(guess, planes, sigma, model=_estimated(guess))
    except (DegenerateGeometryError, NotEnoughPlanesError):
        prediction = None
    except ValueError:  # a square is partly outside the guessed camera's picture
        return Guidance(None, guess.fx, "Show all squares wholly, with some margin.", False)
    ratio, change = _best_change(guess, planes, [square.corners for square, _ in posed_squares])
    if prediction is None:
        change = change or "Tilt the squares, each in another direction"
        return Guidance(None, guess.fx, f"{change}.", False)
    std = {name: float(value) for name, value in prediction.std.items()}
    if ratio > WORTHWHILE:
        return Guidance(std, guess.fx, "Good: no single change would help much.", True)
    improvement = f"{change}: the camera would be known {100 * (1 / ratio - 1):.0f} % better."
    is_enough = std["fx"] < MAX_GOOD_STD * guess.fx and std["cx"] < MAX_GOOD_STD * image_size[0]
    advice = (
        f"Good; better still: {improvement[0].lower()}{improvement[1:]}"
        if is_enough
        else improvement
    )
    return Guidance(std, guess.fx, advice, is_enough)


def _posed_squares(
    squares: Sequence[OutlinedSquare], image_size: tuple[int, int], camera: Camera | None
) -> tuple[Camera, list[tuple[OutlinedSquare, PlannedSquare]]]:
    """Return a camera and the squares with their poses; those without a pose are left out."""
    if camera is not None and camera.image_size != image_size:
        camera = camera.rescaled(image_size)
    figures = [_edges(square) for square in squares]
    if camera is None:
        are_curved = all(square.sides is not None for square in squares)
        guess = _guessed_calibration(figures, are_curved, image_size)
        if guess is not None:
            pairs = zip(squares, guess.planes, strict=True)
            return guess.camera, [(square, _planned(square, plane)) for square, plane in pairs]
        camera = centred_pinhole(GUESSED_FOCAL * image_size[0], image_size)
    posed_squares = []
    fixed = ("focal", "principal_point", "distortion")
    for square, figure in zip(squares, figures, strict=True):
        with suppress(TrisquareError):
            located = calibrate_edges(
                [figure],
                image_size,
                method=METHOD,
                model=camera.model,
                fix=fixed,
                initial=camera,
            )
            posed_squares.append((square, _planned(square, located.planes[0])))
    return camera, posed_squares


def _guessed_calibration(
    figures: list[PlaneEdges], are_curved: bool, image_size: tuple[int, int]
) -> Calibration | None:
    """Return a calibration from the outlines, or None if they do not determine it."""
    width, _ = image_size
    for model in ("radial2", "none") if are_curved else ("none",):
        fixed = ("aspect", "principal_point")
        with suppress(TrisquareError, ValueError):
            calibration = calibrate_edges(
                figures, image_size, method=METHOD, model=model, fix=fixed
            )
            if FOCAL_RANGE[0] * width < calibration.camera.fx < FOCAL_RANGE[1] * width:
                return calibration
    return None


def _planned(square: OutlinedSquare, plane: Plane) -> PlannedSquare:
    inner = None if square.inner is None else _hole(square)
    return PlannedSquare(plane.rotation, plane.translation, inner)


def _edges(square: OutlinedSquare) -> PlaneEdges:
    if square.sides is not None:
        return PlaneEdges.square(square.sides)
    corners = square.corners
    shares = (np.arange(OUTLINE_SAMPLES) + 0.5)[:, None] / OUTLINE_SAMPLES
    following = np.roll(corners, -1, axis=0)
    sides = [a + shares * (b - a) for a, b in zip(corners, following, strict=True)]
    return PlaneEdges.square(sides)


def _hole(square: OutlinedSquare) -> float:
    """Return the side of a frame's hole relative to the frame's, from their areas."""
    assert square.inner is not None
    ratio = math.sqrt(float(quad_areas(square.inner) / quad_areas(square.corners)))
    return min(max(ratio, 0.05), 0.95)


def _best_change(
    camera: Camera, planes: list[PlannedSquare], corners: Sequence[FloatArray]
) -> tuple[float, str | None]:
    """Return the ratio of the std of fx and cx after and before the best change, and its text."""
    spread_before = _spread(camera, planes)
    if spread_before is None:
        return 1.0, None
    best: tuple[float, str | None] = (1.0, None)
    for text, changed in _changes(camera, planes, corners):
        spread_after = _spread(camera, changed)
        if spread_after is not None and spread_after / spread_before < best[0]:
            best = spread_after / spread_before, text
    return best


def _spread(camera: Camera, planes: Sequence[PlannedSquare]) -> float | None:
    """Return the geometric mean of the std of fx and cx, up to a factor."""
    try:
        model = _estimated(camera)
        std = predicted(camera, map(posed, planes), (), spacing=COARSE, model=model).std
    except (TrisquareError, ValueError):
        return None  # a square leaves the picture
    return math.sqrt(std["fx"] * std["cx"])


def _estimated(camera: Camera) -> LensModel:
    """Return the model whose coefficients are estimated from a photograph of squares."""
    return camera.model if is_fisheye(camera.model) else "radial2"


def _changes(
    camera: Camera, planes: list[PlannedSquare], corners: Sequence[FloatArray]
) -> Iterator[tuple[str, list[PlannedSquare]]]:
    """Yield possible changes of the squares, as texts, and the changed poses."""
    enlarged = [PlannedSquare(p.rotation, p.translation / ENLARGEMENT, p.inner) for p in planes]
    yield "Come nearer, or show larger squares", enlarged
    names = _names([quad.mean(axis=0) for quad in corners], camera.image_size)
    for number, (name, plane) in enumerate(zip(names, planes, strict=True)):
        for direction, edge in TILT_EDGES.items():
            rotation = tilted(MORE_TILT, direction, 0.0) @ plane.rotation
            if rotation[2, 2] < math.cos(math.radians(MAX_TILT)):
                continue
            turned = PlannedSquare(rotation, plane.translation, plane.inner)
            text = f"Tilt the {name} square: move its {edge} edge away from the camera"
            yield text, [*planes[:number], turned, *planes[number + 1 :]]


def _names(centres: Sequence[FloatArray], image_size: tuple[int, int]) -> list[str]:
    """Return names of squares by their positions, with the fewest words that distinguish them."""
    size = np.array(image_size)
    offsets = [(np.asarray(centre) - 0.5 * (size - 1)) / size for centre in centres]
    words = [
        (
            "upper" if y < -MIN_NAMED_OFFSET else "lower" if y > MIN_NAMED_OFFSET else "",
            "left" if x < -MIN_NAMED_OFFSET else "right" if x > MIN_NAMED_OFFSET else "",
        )
        for x, y in offsets
    ]
    names = []
    for index, (vertical, horizontal) in enumerate(words):
        other_words = words[:index] + words[index + 1 :]
        if horizontal and all(word != horizontal for _, word in other_words):
            names.append(horizontal)
        elif vertical and all(word != vertical for word, _ in other_words):
            names.append(vertical)
        else:
            names.append(" ".join(filter(None, (vertical, horizontal))) or "middle")
    return names
