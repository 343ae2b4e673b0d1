"""Distance between the projections of two cameras, and whether their uncertainties explain it.

Two calibrations of one camera are never exactly equal, and a comparison of their parameters is not
informative: a longer focal length and a stronger distortion may project alike. What matters is the
pixels at which directions are seen. But a calibration does not determine the direction of the
camera: a shift of the principal point is nearly equivalent to a rotation of the camera, and has no
effect if the camera's pose is estimated afterwards. Therefore the directions seen at pixels of the
first camera are rotated by the one rotation that brings the second camera's projections of them
closest (least squares over the picture), and the remaining distance is the difference. The idea of
comparing after such a rotation is mrcal's (https://mrcal.secretsauce.net, "projection difference").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray, RebuiltByConstructor
from trisquare._support.json_members import dump_members
from trisquare._support.number_text import decimals_shown
from trisquare.camera.camera import Camera
from trisquare.camera.camera_of import camera_of
from trisquare.camera.projection_uncertainty import picture_grid
from trisquare.results.calibration import Calibration
from trisquare.results.uncertain_camera import uncertain_camera

__all__ = ["Comparison", "compare"]

COMPARISON_FORMAT = "trisquare-comparison/1"

SIGNIFICANCE = 0.05
"""Probability of a significant difference between cameras that are the same."""

MAX_EQUAL_DISTANCE = 1e-6
"""Maximum distance (px) of cameras that are taken as equal whatever their uncertainty; the rounding
of files is of this order."""

REMARKABLE_STDS = 2.0
"""Difference, in standard deviations, that a single place seldom exceeds."""

MAX_EXPECTED = 0.01
"""Expected rms, as a fraction of the picture's width, above which agreement means nothing. A focal
length wrong by 2.8 % moves a picture of 4:3 by no more (rms)."""

MIN_STATED = 1e-6
"""Smallest probability that is stated: no noise is normal so far out."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison(RebuiltByConstructor):
    """Differences between the projections of two cameras.

    Parameters
    ----------
    first, second : Camera
        The cameras that were compared; pixels are those of the first.
    rotation : ndarray, shape (3, 3)
        ``second_from_first``: rotates the first camera's directions into the second's.
    x, y : ndarray, shape (C,) and (R,)
        Columns and rows of the grid, pixels, from border to border.
    difference : ndarray, shape (R, C, 2)
        The second camera's projection of the direction that the first sees at ``(x[j], y[i])``,
        minus that pixel; infinite where the map of one of the two is not valid.
    std : ndarray, shape (R, C), or None
        Expected root mean square distance of two calibrations of one camera, by the stated
        uncertainties, pixels, infinite likewise; None if neither states one.
    p_value : float or None
        Probability that two calibrations of one camera, from different photographs, differ at
        least as much (chi-squared). For calibrations from the same photographs it is too large. For
        targets on paper it is too small: paper is not flat, and over sets of photographs of one
        camera the results scatter more than they state (docs/how-exact.md).
    degrees_of_freedom : int
        Degrees of freedom of the chi-squared: independent differences that the uncertainties allow.
    unexplained : float
        Root mean square, pixels, of the part of the difference that no change of the uncertain
        parameters explains; 0 if no uncertainty is stated.
    targets : sequence of ndarray, shape (N, 2)
        Corners of the planes that each camera was calibrated from, pixels; only of cameras whose
        planes are known.

    Examples
    --------
    >>> comparison = ts.compare(result, camera)
    >>> print(comparison.verdict.partition(":")[0])
    the same within their uncertainty
    """

    first: Camera
    second: Camera
    rotation: FloatArray
    x: FloatArray
    y: FloatArray
    difference: FloatArray
    std: FloatArray | None
    p_value: float | None
    degrees_of_freedom: int
    unexplained: float
    targets: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        for name in ("rotation", "x", "y", "difference", "std"):
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, dtype=np.float64, order="C")
                array.flags.writeable = False
                object.__setattr__(self, name, array)

    def members(self) -> dict[str, Any]:
        """Return all but the grid as a JSON object; `trisquare compare --json` prints it.

        Examples
        --------
        >>> ts.compare(result, camera).members()["format"]
        'trisquare-comparison/1'
        """
        return {
            "format": COMPARISON_FORMAT,
            "image_size": list(self.first.image_size),
            "rms_px": self.rms,
            "worst_px": self.worst,
            "worst_at": list(self.worst_at),
            "worst_beyond_targets": self.worst_beyond_targets,
            "rms_among_targets_px": self.rms_among_targets,
            "expected_rms_among_targets_px": self.expected_rms_among_targets,
            "worst_in_stds": self.worst_in_stds,
            "expected_rms_px": self.expected_rms,
            "unexplained_px": self.unexplained,
            "p_value": self.p_value,
            "degrees_of_freedom": self.degrees_of_freedom,
            "same": self.same,
            "verdict": self.verdict,
            "coverage": self.coverage,
            "rotation": self.rotation.tolist(),
            "angle_degrees": self.angle,
        }

    def to_json(self) -> str:
        """Return `members` as JSON text.

        Examples
        --------
        >>> import json
        >>> json.loads(ts.compare(result, camera).to_json())["same"]
        True
        """
        return dump_members(self.members())

    @property
    def distance(self) -> FloatArray:
        """Length of the difference, shape (R, C), pixels; infinite where it is unknown."""
        return np.asarray(np.hypot(self.difference[..., 0], self.difference[..., 1]))

    @property
    def rms(self) -> float:
        """Root mean square distance over the picture, pixels."""
        return _rms(self.distance)

    @property
    def expected_rms(self) -> float | None:
        """Expected rms by the stated uncertainties, pixels."""
        return None if self.std is None else _rms(self.std)

    @property
    def worst(self) -> float:
        """The largest distance, pixels."""
        distance = self.distance
        return float(np.max(distance[np.isfinite(distance)]))

    @property
    def worst_at(self) -> tuple[float, float]:
        """The pixel of the largest distance."""
        row, column = np.argwhere(self.distance == self.worst)[0]
        return float(self.x[column]), float(self.y[row])

    @property
    def worst_beyond_targets(self) -> bool | None:
        """Whether the pixel of `worst_at` is outside the targets of one of the cameras.

        The distortion is extrapolated there. None if the planes of neither are known.
        """
        if not self.targets:
            return None
        return any(not _are_enclosed(self.worst_at, corners) for corners in self.targets)

    @property
    def rms_among_targets(self) -> float | None:
        """Root mean square distance within the targets of both cameras, pixels.

        None if the planes of neither are known, or no point of the grid is within them.
        """
        return self._rms_among_targets(self.distance)

    @property
    def expected_rms_among_targets(self) -> float | None:
        """Expected rms within the targets by the stated uncertainties, pixels."""
        return None if self.std is None else self._rms_among_targets(self.std)

    def _rms_among_targets(self, values: FloatArray) -> float | None:
        pixels = np.stack(np.meshgrid(self.x, self.y), axis=-1)
        is_known = np.isfinite(values)
        for corners in self.targets:
            is_known &= _are_enclosed(pixels, corners)
        return _rms(values[is_known]) if self.targets and is_known.any() else None

    @property
    def worst_in_stds(self) -> float | None:
        """The largest ratio of the distance to its expected value in the picture."""
        if self.std is None:
            return None
        is_known = np.isfinite(self.distance) & (self.std > 0)
        return float(np.max(self.distance[is_known] / self.std[is_known], initial=0.0))

    @property
    def angle(self) -> float:
        """The angle of the rotation between the two, degrees."""
        # From the antisymmetric part, which is exact for small angles; the trace is not.
        skew = self.rotation - self.rotation.T
        sine = 0.5 * math.hypot(skew[2, 1], skew[0, 2], skew[1, 0])
        return math.degrees(math.atan2(sine, 0.5 * (float(np.trace(self.rotation)) - 1.0)))

    @property
    def coverage(self) -> float:
        """Fraction of the picture's grid in which the maps of both cameras are valid."""
        return float(np.isfinite(self.distance).mean())

    @property
    def same(self) -> bool | None:
        """Whether the uncertainties explain the difference.

        None if that cannot be decided: if neither camera states its uncertainty, or if more than
        1 % of the picture's width (rms) is to be expected by the uncertainties, even if the
        parameters are equal.
        """
        expected = self.expected_rms
        if self.p_value is None or expected is None:
            return None
        is_different = self.p_value < SIGNIFICANCE or self.unexplained > expected
        if is_different and self.worst > MAX_EQUAL_DISTANCE:
            return False
        return True if expected <= self._max_expected else None

    @property
    def _max_expected(self) -> float:
        return MAX_EXPECTED * self.first.image_size[0]

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        x, y = self.worst_at
        apart = (
            f"{two_digits(self.rms)} px apart (rms over the picture), "
            f"{two_digits(self.worst)} px at most, at ({x:.0f}, {y:.0f})"
        )
        if self.worst_beyond_targets and self.worst > MAX_EQUAL_DISTANCE:
            apart += f", which lies beyond the targets{self._targets_text()}"
        expected, stds, p_value = self.expected_rms, self.worst_in_stds, self.p_value
        if expected is None or stds is None or p_value is None:
            return (
                f"{apart}; neither camera states its uncertainty, so that the significance of the "
                "difference is unknown"
            )
        expected_text = f"{two_digits(expected)} px (rms) is expected"
        if self.same is None:
            limit_text = f"{two_digits(self._max_expected)} px (1 % of the picture's width)"
            return (
                f"it cannot be decided whether the cameras differ: {apart}; {expected_text}, and "
                f"more than {limit_text} hides a difference"
            )
        if self.worst <= MAX_EQUAL_DISTANCE:
            return f"the same within their uncertainty: {apart}; {expected_text}"
        p = f"p = {p_value:.2g}" if p_value > MIN_STATED else f"p < {MIN_STATED:g}"
        if self.same:
            return f"the same within their uncertainty: {apart}; {expected_text}, {p}"
        size = f"up to {two_digits(stds)} standard deviations"
        if stds < REMARKABLE_STDS:
            size = (
                f"{size}, but the pattern of the differences is known more precisely than the "
                "difference at any one place"
            )
        verdict = f"they differ by more than their stated uncertainty: {apart}; {size}, {p}"
        if self.unexplained <= expected:
            return verdict
        return (
            f"{verdict}; {two_digits(self.unexplained)} px (rms) remain that no uncertain "
            "parameter explains"
        )

    def _targets_text(self) -> str:
        found, expected = self.rms_among_targets, self.expected_rms_among_targets
        if found is None or expected is None:
            return ""
        return f" (among them {two_digits(found)} px, where {two_digits(expected)} is expected)"

    def __repr__(self) -> str:
        return f"<Comparison: {self.verdict}>"


def compare(first: Calibration | Camera, second: Calibration | Camera) -> Comparison:
    """Compare the projections of two cameras after the rotation that fits best.

    Parameters
    ----------
    first, second : Calibration or Camera
        Cameras for pictures of the same size. A `Calibration` has an uncertainty, in which fixed
        parameters count as exact; a `Camera` is taken as exact. They are assumed to be from
        different photographs: from the same photographs they share errors, and differ by less than
        is expected.

    Returns
    -------
    Comparison

    Raises
    ------
    TypeError
        If an argument is neither a calibration nor a camera.
    ValueError
        If the pictures' sizes differ, or the cameras have too little of the picture in common.

    Examples
    --------
    >>> other = ts.calibrate("photo.jpg", tone="srgb")
    >>> ts.compare(result, other).same
    True
    """
    a, b = camera_of(first, "first"), camera_of(second, "second")
    if a.image_size != b.image_size:
        sizes = " and ".join("{} x {}".format(*camera.image_size) for camera in (a, b))
        raise ValueError(f"the cameras' pictures differ in size, {sizes}: rescale one of them")
    x, y = picture_grid(a.image_size)
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rotation, difference, test = _core.compare_projections(
        uncertain_camera(first), uncertain_camera(second), pixels
    )
    std, p_value, freedom, unexplained = test or (None, None, 0, 0.0)
    difference = difference.reshape(len(y), len(x), 2)
    if std is not None:
        std = std.reshape(len(y), len(x))
    corners = [
        [plane.corners for plane in camera.planes if plane.is_used]
        for camera in (first, second)
        if isinstance(camera, Calibration)
    ]
    targets = tuple(np.concatenate(camera_corners) for camera_corners in corners if camera_corners)
    return Comparison(a, b, rotation, x, y, difference, std, p_value, freedom, unexplained, targets)


def _are_enclosed(pixels: npt.ArrayLike, corners: FloatArray) -> npt.NDArray[np.bool_]:
    """Return whether pixels, (..., 2), are inside the convex hull of corners.

    A pixel is outside if there is no corner on one side of some line through it.
    """
    arms = corners - np.asarray(pixels)[..., None, :]
    angles = np.sort(np.arctan2(arms[..., 1], arms[..., 0]), axis=-1)
    gaps = np.diff(angles, append=angles[..., :1] + 2.0 * np.pi, axis=-1)
    return np.asarray(gaps.max(axis=-1) <= np.pi)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values[np.isfinite(values)] ** 2)))


def two_digits(value: float) -> str:
    """Format a number with two significant digits, without an exponent."""
    return f"{value:.{min(decimals_shown(value), 6)}f}" if value >= MAX_EQUAL_DISTANCE else "0"
