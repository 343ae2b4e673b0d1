"""What has a pose."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt


class StandingPlane(Protocol):
    """A plane that stands somewhere: `PlannedSquare`, `Plane`, `simulate.Target`."""

    @property
    def rotation(self) -> npt.NDArray[np.float64]:
        """Shape (3, 3)."""

    @property
    def translation(self) -> npt.NDArray[np.float64]:
        """Shape (3,), in units of the square's side."""
