"""What was found in a picture but plays no part in its calibration, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    index_number,
    not_negative,
    real_array,
    string,
)
from trisquare._support.json_members import JsonFields


@dataclass(frozen=True, slots=True, eq=False)
class Rejected(RebuiltByConstructor):
    """A candidate that was not used.

    Parameters
    ----------
    kind : str
        What it was taken for: ``"square"``, ``"frame"``, ``"chessboard"``, ...
    image : int
        Index of the picture it was found in.
    corners : array_like, shape (4, 2)
        Where it is, in pixels of the photograph.
    reason : str
        Why it was not used.
    residual : float, optional
        Root mean square distance of its samples from the best square that the camera allows,
        in pixels; None if that was not asked.
    """

    kind: str
    image: int
    corners: FloatArray
    reason: str
    residual: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", string(self.kind, "kind"))
        object.__setattr__(self, "image", index_number(self.image, "image"))
        object.__setattr__(self, "corners", real_array(self.corners, "corners", (4, 2)))
        object.__setattr__(self, "reason", string(self.reason, "reason"))
        if self.residual is not None:
            object.__setattr__(self, "residual", not_negative(self.residual, "residual"))

    def __repr__(self) -> str:
        x, y = self.corners.mean(axis=0).tolist()
        return f"<Rejected {self.kind} in image {self.image} at ({x:.0f}, {y:.0f}): {self.reason}>"


def is_reported(warning: str, rejected: Sequence[Rejected]) -> bool:
    """Whether a warning says of one of the rejected why it was not used."""
    return any(candidate.reason in warning for candidate in rejected)


def rejected_members(candidate: Rejected) -> dict[str, Any]:
    """Return one of the ``rejected`` of the JSON format."""
    return {
        "kind": candidate.kind,
        "image": candidate.image,
        "corners": candidate.corners.tolist(),
        "reason": candidate.reason,
        **({} if candidate.residual is None else {"residual_px": candidate.residual}),
    }


def rejected_from_members(members: JsonFields) -> Rejected:
    """Read one of the ``rejected`` of the JSON format."""
    return Rejected(
        kind=members.text("kind"),
        image=members.integer("image"),
        corners=members.array("corners", (4, 2)),
        reason=members.text("reason"),
        residual=members.number("residual_px") if members.has("residual_px") else None,
    )
