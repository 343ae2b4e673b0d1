"""How far the measured edges are from where a calibration says that they should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    index_number,
    real_array,
)
from trisquare._support.json_members import JsonFields


@dataclass(frozen=True, slots=True, eq=False)
class FigureResiduals(RebuiltByConstructor):
    """How far the samples of a figure are from the images of its lines.

    Parameters
    ----------
    plane : int
        Which of the calibration's planes it lies on.
    distances : sequence of array_like, shape (N_i,)
        Signed distances of the samples of each line from its image, in pixels of the photograph.
    normals : sequence of array_like, shape (N_i, 2)
        Unit normals of the line's image at the samples, towards which the distances are positive.
    """

    plane: int
    distances: tuple[FloatArray, ...]
    normals: tuple[FloatArray, ...]

    def __post_init__(self) -> None:
        if len(self.distances) != len(self.normals):
            raise ValueError("distances and normals must be of the same lines")
        distances = [real_array(d, "distances", (None,)) for d in self.distances]
        normals = [
            real_array(normal, "normals", (len(own), 2))
            for normal, own in zip(self.normals, distances, strict=True)
        ]
        object.__setattr__(self, "plane", index_number(self.plane, "plane"))
        object.__setattr__(self, "distances", tuple(distances))
        object.__setattr__(self, "normals", tuple(normals))


def residuals_members(residuals: FigureResiduals) -> dict[str, Any]:
    """Return a member of ``residuals`` of the JSON format."""
    return {
        "plane": residuals.plane,
        "distances": [distances.tolist() for distances in residuals.distances],
        "normals": [normals.tolist() for normals in residuals.normals],
    }


def residuals_from_members(members: JsonFields) -> FigureResiduals:
    """Read a member of ``residuals`` of the JSON format."""
    distances: Sequence[FloatArray] = members.arrays("distances", (None,))
    normals: Sequence[FloatArray] = members.arrays("normals", (None, 2))
    return FigureResiduals(members.integer("plane"), tuple(distances), tuple(normals))
