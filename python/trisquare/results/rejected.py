"""Candidates that were found in a picture but not used in its calibration, with the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from trisquare._support.arrays import FloatArray
from trisquare._support.records import INDEX, NUMBER, TEXT, Record, member, pixels

CUT_BY_BORDER = "it is cut by the picture's border"
"""Reason for a shape that is only partly in the picture; its corners are those of a box."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejected(Record):
    """A candidate that was not used.

    Parameters
    ----------
    kind : str
        Assumed kind: ``"square"``, ``"frame"``, ``"chessboard"``, ...
    image : int
        Index of the picture it was found in.
    corners : array_like, shape (4, 2)
        Its corners, in pixels of the photograph.
    reason : str
        Why it was not used.
    residual : float, optional
        Root mean square distance of its samples from the best square that the camera allows,
        in pixels; None if it was not computed.

    Examples
    --------
    >>> one = ts.Rejected("square", 0, [[10, 10], [20, 11], [19, 20], [9, 19]], "too small")
    >>> one.kind, one.reason
    ('square', 'too small')
    """

    kind: str = field(metadata=member(TEXT))
    image: int = field(metadata=member(INDEX))
    corners: FloatArray = field(metadata=member(pixels(4, 2)))
    reason: str = field(metadata=member(TEXT))
    residual: float | None = field(default=None, metadata=member(NUMBER, "residual_px"))

    def __repr__(self) -> str:
        x, y = self.corners.mean(axis=0).tolist()
        return f"<Rejected {self.kind} in image {self.image} at ({x:.0f}, {y:.0f}): {self.reason}>"


def is_reported(warning: str, rejected: Sequence[Rejected]) -> bool:
    """Return whether a warning includes the reason of one of the rejected candidates."""
    return any(candidate.reason in warning for candidate in rejected)
