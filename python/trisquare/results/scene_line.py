"""A straight line of the scene in a calibration."""

from __future__ import annotations

from dataclasses import dataclass, field

from trisquare._support.arrays import FloatArray
from trisquare._support.records import INDEX, NUMBER, TEXT, Record, array, member


@dataclass(frozen=True, slots=True, eq=False)
class SceneLine(Record):
    """A line of the scene, and whether it was used.

    Parameters
    ----------
    image : int
        Index of the picture that shows it.
    points : array_like, shape (N, 2)
        Its samples, pixels of the photograph.
    rms : float, optional
        Root mean square distance of the samples from the image of the straight line that fits them
        best, pixels; None if some samples are beyond the valid radius.
    rejection : str, optional
        Why it was not used; None if it was.

    Examples
    --------
    >>> lines = ts.calibrate("photo.jpg", lines=True).lines
    >>> for line in lines[:2]:
    ...     print(line.image, line.is_used, line.rejection)
    0 True None
    0 True None
    """

    image: int = field(metadata=member(INDEX))
    points: FloatArray = field(metadata=member(array(None, 2)))
    rms: float | None = field(default=None, metadata=member(NUMBER, "rms_px"))
    rejection: str | None = field(default=None, metadata=member(TEXT))

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.points)

    @property
    def is_used(self) -> bool:
        """Whether it was used in the fit."""
        return self.rejection is None

    def __repr__(self) -> str:
        (x0, y0), (x1, y1) = self.points[0].tolist(), self.points[-1].tolist()
        rms = "" if self.rms is None else f", rms {self.rms:.2g} px"
        rejected = f", rejected: {self.rejection}" if self.rejection else ""
        return (
            f"<SceneLine of {self.samples} samples in image {self.image} from ({x0:.0f}, {y0:.0f}) "
            f"to ({x1:.0f}, {y1:.0f}){rms}{rejected}>"
        )
