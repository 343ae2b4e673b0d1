"""One physical plane of a calibration."""

from __future__ import annotations

from dataclasses import dataclass

from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    index_number,
    not_negative,
    real_array,
    string,
)
from trisquare._support.rotations import rotation_matrix
from trisquare.results.pose_uncertainty import PoseUncertainty


@dataclass(frozen=True, slots=True, eq=False)
class Plane(RebuiltByConstructor):
    """One physical plane: where it stands, and how well it fits.

    Parameters
    ----------
    kind : str
        What was found on it: ``"square"``, ``"frame"``, ``"chessboard"``, ...
    image : int
        Index of the picture it was seen in.
    corners : array_like, shape (4, 2)
        Corners of its (first) figure in the photograph, distorted, in pixels.
    rotation, translation : array_like, shape (3, 3) and (3,)
        ``X_cam = rotation @ X_plane + translation``, in units of the square's side.
    rms : float
        Root mean square residual of its samples, in pixels.
    samples : int
        How many samples it rests on.
    uncertainty : PoseUncertainty, optional
        How well its pose is known; None in results of versions that did not say.
    """

    kind: str
    image: int
    corners: FloatArray
    rotation: FloatArray
    translation: FloatArray
    rms: float
    samples: int
    uncertainty: PoseUncertainty | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", string(self.kind, "kind"))
        object.__setattr__(self, "image", index_number(self.image, "image"))
        object.__setattr__(self, "corners", real_array(self.corners, "corners", (4, 2)))
        object.__setattr__(self, "rotation", rotation_matrix(self.rotation))
        object.__setattr__(self, "translation", real_array(self.translation, "translation", (3,)))
        object.__setattr__(self, "rms", not_negative(self.rms, "rms"))
        object.__setattr__(self, "samples", index_number(self.samples, "samples"))
        if self.uncertainty is not None and not isinstance(self.uncertainty, PoseUncertainty):
            raise TypeError("uncertainty must be of the class PoseUncertainty")

    def __repr__(self) -> str:
        x, y, z = self.translation.tolist()
        return (
            f"<Plane {self.kind} in image {self.image}: at ({x:.4g}, {y:.4g}, {z:.4g}), "
            f"rms {self.rms:.3g} px of {self.samples} samples>"
        )
