"""One physical plane of a calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.lengths import length_in
from trisquare._support.records import (
    INDEX,
    NUMBER,
    TEXT,
    Kind,
    Record,
    array,
    member,
    pixels,
    record,
)
from trisquare._support.rotations import rotation_matrix, rotation_vector
from trisquare.results.pose_uncertainty import PoseUncertainty

ROTATION = Kind(
    lambda value, name: rotation_matrix(value), lambda members, key: members.array(key, (3, 3))
)


@dataclass(frozen=True, slots=True, eq=False)
class Plane(Record):
    """One physical plane: its pose and its residuals.

    Parameters
    ----------
    kind : str
        Kind of target on it: ``"square"``, ``"frame"``, ``"rectangle"``, ``"facade"``,
        ``"chessboard"``, ...
    image : int
        Index of the picture it was seen in.
    corners : array_like, shape (4, 2)
        Corners of its (first) figure in the photograph, distorted, in pixels: their projection by
        the calibrated camera. Lengths between corners of one plane are the target's by
        construction, and are no check of the calibration.
    rotation, translation : array_like, shape (3, 3) and (3,)
        ``X_cam = rotation @ X_plane + translation``. The unit is the square's side; the shorter
        side of a rectangle, or its side 1 if its aspect was unknown; the extent of a facade along
        Y, between its outermost lines; the unit of the radii of circles.
    rms : float
        Root mean square residual of its samples, in pixels.
    samples : int
        Number of its samples.
    uncertainty : PoseUncertainty, optional
        Uncertainty of its pose; None in results of versions that did not state it.
    aspect, aspect_std : float, optional
        For a rectangle of unknown aspect: side 0 over side 1, and its standard deviation; for a
        facade its extent along X.
    radii, radii_std : array_like, shape (C,), optional
        For circles of which some radii were unknown: all radii, and their standard deviations,
        zero for known ones.
    side : float, optional
        Length of the unit of `translation`, in metres, as stated at calibration; None for the hole
        of a frame whose outer outline was not measured.
    rejection : str, optional
        Why the camera is not estimated from it; None if it is.

    Examples
    --------
    >>> plane = result.planes[0]
    >>> plane.kind, plane.corners.round().tolist()
    ('frame', [[116.0, 75.0], [465.0, 107.0], [425.0, 432.0], [98.0, 439.0]])
    >>> plane.translation.round(2).tolist()  # in units of its side
    [-1.04, -0.57, 2.33]
    """

    # No annotation, which would add it to `__dataclass_fields__`.
    other_names = MappingProxyType(
        {
            "picture": "image",
            "R": "rotation",
            "t": "translation",
            "pose": "cam_from_plane()",
            "tilt": "np.degrees(np.arccos(plane.rotation[2, 2]))",
            "distance": "np.linalg.norm(plane.tvec)",
        }
    )

    kind: str = field(metadata=member(TEXT))
    image: int = field(metadata=member(INDEX))
    corners: FloatArray = field(metadata=member(pixels(4, 2)))
    rotation: FloatArray = field(metadata=member(ROTATION))
    translation: FloatArray = field(metadata=member(array(3)))
    rms: float = field(metadata=member(NUMBER, "rms_px"))
    samples: int = field(metadata=member(INDEX))
    uncertainty: PoseUncertainty | None = field(
        default=None, metadata=member(record(PoseUncertainty), "pose_uncertainty")
    )
    aspect: float | None = field(default=None, metadata=member(NUMBER))
    aspect_std: float | None = field(default=None, metadata=member(NUMBER))
    radii: FloatArray | None = field(default=None, metadata=member(array(None)))
    radii_std: FloatArray | None = field(default=None, metadata=member(array(None)))
    side: float | None = field(default=None, metadata=member(NUMBER, "side_m"))
    rejection: str | None = field(default=None, metadata=member(TEXT))

    @property
    def is_used(self) -> bool:
        """Whether the camera is estimated from it."""
        return self.rejection is None

    @property
    def stated_side(self) -> float:
        """`side`, or 1 if it is unknown."""
        return 1.0 if self.side is None else self.side

    @property
    def rvec(self) -> FloatArray:
        """The rotation in OpenCV's form: axis times angle, shape (3,), radians."""
        return rotation_vector(self.rotation)

    @property
    def tvec(self) -> FloatArray:
        """`translation` under OpenCV's name, shape (3,): in metres if `side` is known."""
        return self.cam_from_plane()[:3, 3]

    def cam_from_plane(self, side: str | float | None = None) -> FloatArray:
        """Return the pose as a homogeneous matrix, shape (4, 4).

        Parameters
        ----------
        side : str or float, optional
            Length of the unit of `translation`, in most cases the square's side: a text such as
            ``"84mm"``, which is converted to metres, or a number in any unit; the matrix then
            applies to points of the plane in that unit. By default the plane's own `side` in
            metres, or 1 if it is unknown.

        Raises
        ------
        TypeError, ValueError
            If `side` is not a positive length.

        Examples
        --------
        >>> pose = result.planes[0].cam_from_plane(side=84)  # millimetres
        >>> (pose @ [0, 0, 0, 1]).round().tolist()
        [-88.0, -48.0, 196.0, 1.0]
        """
        stated = length_in("m", side, "side")
        length = self.stated_side if stated is None else stated
        pose = np.eye(4)
        pose[:3, :3] = self.rotation
        pose[:3, 3] = length * self.translation
        return pose

    def __repr__(self) -> str:
        x, y, z = self.translation.tolist()
        return (
            f"<Plane {self.kind} in image {self.image}: at ({x:.4g}, {y:.4g}, {z:.4g}), "
            f"rms {self.rms:.3g} px of {self.samples} samples{_rejected(self)}>"
        )


def _rejected(plane: Plane) -> str:
    return "" if plane.is_used else f", rejected: {plane.rejection}"
