"""Poses of planes before a camera, and squares that are to be photographed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import FloatArray, RebuiltByConstructor, real_array, real_number
from trisquare._support.rotations import rotation_matrix, tilt_degrees, tilted
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.camera.camera_of import camera_of
from trisquare.results.calibration import Calibration

UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

OUTLINED = ("square", "tag", "frame")
"""Kinds of targets from which a calibration can be predicted."""

ANY_SIGMA = 0.01
"""Standard deviation of a sample (px), where only ratios of predictions are used."""

FRAME_HOLE = 0.6
"""Side of a frame's hole over that of the frame, if unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSquare(RebuiltByConstructor):
    """A square that is to be photographed.

    Parameters
    ----------
    rotation, translation : array_like, shape (3, 3) and (3,)
        ``X_cam = rotation @ X_plane + translation``, in units of the square's side; the plane's
        origin is the square's centre and its Z axis points away from the camera.
    inner : float, optional
        Side of the square hole that makes it a frame, in units of its own side.

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type or shape, or is not a rotation or not a hole.

    Examples
    --------
    >>> planned = ts.PlannedSquare(np.eye(3), [0, 0, 3], inner=0.6)
    >>> planned.translation.tolist()
    [0.0, 0.0, 3.0]
    """

    rotation: FloatArray
    translation: FloatArray
    inner: float | None = None

    if TYPE_CHECKING:  # the constructor accepts more types than the attributes have

        def __init__(
            self, rotation: npt.ArrayLike, translation: npt.ArrayLike, inner: float | None = None
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", rotation_matrix(self.rotation))
        object.__setattr__(self, "translation", real_array(self.translation, "translation", (3,)))
        if self.inner is not None:
            inner = real_number(self.inner, "inner")
            if not 0.0 < inner < 1.0:
                raise ValueError(f"inner must be between 0 and 1, not {inner}")
            object.__setattr__(self, "inner", inner)

    @classmethod
    def at(
        cls,
        camera: Calibration | Camera,
        centre: tuple[float, float],
        side: float,
        *,
        tilt: float,
        direction: float,
        spin: float = 0.0,
        inner: float | None = None,
    ) -> PlannedSquare:
        """Place a square by its appearance.

        Parameters
        ----------
        camera : Calibration or Camera
            The camera, or an estimate of it.
        centre : (float, float)
            Position of its centre in the picture, pixels.
        side : float
            Length of its side in the picture if it faced the camera, pixels.
        tilt : float
            Angle between its plane and the image plane, degrees.
        direction : float
            Angle of the axis of the tilt, in the image plane from x toward y, degrees: at 0 the
            upper edge leans toward the camera, at 90 the right one.
        spin : float
            Angle by which the square is turned in its own plane before the tilt, degrees.
        inner : float, optional
            Side of a hole, which makes the square a frame; see the class.

        Raises
        ------
        ValueError
            If the centre lies where the camera's distortion is not invertible, or the side is
            not positive.

        Examples
        --------
        >>> planned = ts.PlannedSquare.at(camera, (640, 480), 350, tilt=35, direction=120)
        >>> print(f"{planned.translation[2]:.1f} sides away")
        2.6 sides away
        """
        camera = camera_of(camera)
        length = real_number(side, "side")
        if length <= 0.0:
            raise ValueError(f"side must be positive, not {length}")
        angles = [real_number(angle, "an angle") for angle in (tilt, direction, spin)]
        ray = ray_at(camera, real_array(centre, "centre", (2,)))
        return cls(tilted(*angles), ray * (camera.fx / length), inner)

    def __repr__(self) -> str:
        x, y, z = self.translation.tolist()
        name = "PlannedSquare" if self.inner is None else f"PlannedSquare (hole {self.inner:g})"
        tilt = tilt_degrees(self.rotation)
        return f"<{name} at ({x:.4g}, {y:.4g}, {z:.4g}), tilted {tilt:.1f} degrees>"


class StandingPlane(Protocol):
    """A plane with a pose: `PlannedSquare`, `Plane`, `simulate.Target`."""

    @property
    def rotation(self) -> FloatArray:
        """Shape (3, 3)."""

    @property
    def translation(self) -> FloatArray:
        """Shape (3,), in units of the square's side."""


class PosedPlane(NamedTuple):
    """A plane's pose, and the corners of the outlines on it, shape (4, 2) each."""

    rotation: FloatArray
    translation: FloatArray
    outlines: Sequence[FloatArray]


def posed(plane: StandingPlane) -> PosedPlane:
    """Return the pose and the outlines of a square or a frame.

    Raises
    ------
    TypeError, ValueError
        If it is neither, or for the reasons of `PlannedSquare`.
    """
    if not hasattr(plane, "rotation"):
        raise TypeError(f"planes must contain PlannedSquare, Plane or Target, not {plane!r:.80}")
    inner = getattr(plane, "inner", None)
    kind = getattr(plane, "kind", "square" if inner is None else "frame")
    square = PlannedSquare(plane.rotation, plane.translation, inner)
    return PosedPlane(square.rotation, square.translation, outlines_of(kind, square.inner))


def predicted(
    camera: Camera,
    planes: Iterable[PosedPlane],
    fixed: Sequence[str],
    *,
    sigma: float = ANY_SIGMA,
    spacing: float = 1.0,
    model: str | None = None,
    judged: bool = False,
    free: Sequence[str] = (),
) -> _core.Prediction:
    """Predict a calibration from planes, as `predict` does; refuse a bad one only if `judged`.

    Without `sigma`, only ratios of standard deviations are meaningful.

    Raises
    ------
    ValueError
        If a plane is not completely in the picture.
    TrisquareError
        If the planes do not determine the camera.
    """
    return _core.predict(
        camera_for_core(camera),
        camera.image_size,
        [(rotation, place.tolist(), outlines) for rotation, place, outlines in planes],
        sigma=sigma,
        spacing=spacing,
        model=model or camera.model,
        fixed=fixed,
        judged=judged,
        free=free,
    )


def ray_at(camera: Camera, pixel: FloatArray) -> FloatArray:
    """Return the ray seen at a pixel, shape (3,), with Z = 1.

    Raises
    ------
    ValueError
        If the camera's distortion is not invertible there, or the ray is at right angles to the
        optical axis or beyond, as a fisheye's may be.
    """
    (ray,) = camera.unproject(pixel[None])
    if not ray[2] > 0.0:
        x, y = pixel
        raise ValueError(f"the ray at ({x:g}, {y:g}) is 90 degrees or more from the optical axis")
    return np.asarray(ray / ray[2])


def onto_plane(pixels: FloatArray, camera: Camera, plane: StandingPlane) -> FloatArray:
    """Intersect the rays of pixels, shape (N, 2), with a plane; return plane coordinates.

    Raises
    ------
    ValueError
        If a pixel lies beyond the valid radius, or at or beyond the plane's horizon.
    """
    pose = (plane.rotation, plane.translation)
    return _core.points_on_plane(camera_for_core(camera), pose, pixels)


def outlines_of(kind: str, inner: float | None = None) -> list[FloatArray]:
    """Return the outlines of a square or frame: corners, shape (4, 2) each, in plane units.

    A frame of unknown hole is assumed to have a hole of 0.6 of its side.

    Raises
    ------
    ValueError
        If it is neither a square nor a frame.
    """
    if kind not in OUTLINED:
        raise ValueError(
            f"a prediction needs squares, tags or frames, not a {kind}: predict with a "
            "PlannedSquare within its outline, whose standard deviations are larger"
        )
    if kind != "frame":
        return [UNIT_SQUARE]
    return [UNIT_SQUARE, UNIT_SQUARE * (FRAME_HOLE if inner is None else inner)]
