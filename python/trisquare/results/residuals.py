"""Distances of the measured edges from their positions according to a calibration."""

from __future__ import annotations

from dataclasses import dataclass, field

from trisquare._support.arrays import FloatArray
from trisquare._support.records import INDEX, Record, arrays, check_members, member


@dataclass(frozen=True, slots=True, eq=False)
class FigureResiduals(Record):
    """Distances of the samples of a figure from the images of its lines.

    Parameters
    ----------
    plane : int
        Index of the calibration's plane that it lies on.
    distances : sequence of array_like, shape (N_i,)
        Signed distances of the samples of each line from its image, in pixels of the photograph.
    normals : sequence of array_like, shape (N_i, 2)
        Unit normals of the line's image at the samples. Distances are positive along them, on the
        side where ``a x + b y + c`` of the line is positive, which is the inside of squares from
        `detect`.

    Examples
    --------
    >>> own = result.residuals[0]
    >>> top = own.distances[0]  # of the samples result.edges[0].points[0]
    >>> print(f"plane {own.plane}: {len(top)} samples, rms {np.sqrt(np.mean(top**2)):.2f} px")
    plane 0: 87 samples, rms 0.01 px
    """

    plane: int = field(metadata=member(INDEX))
    distances: tuple[FloatArray, ...] = field(metadata=member(arrays(None)))
    normals: tuple[FloatArray, ...] = field(metadata=member(arrays(None, 2)))

    def __post_init__(self) -> None:
        check_members(self)
        if len(self.distances) != len(self.normals):
            raise ValueError("distances and normals must be of the same lines")
        for normals, distances in zip(self.normals, self.distances, strict=True):
            if len(normals) != len(distances):
                wanted = (len(distances), 2)
                raise ValueError(f"normals must have shape {wanted}, not {normals.shape}")
