"""The core's choice among candidates, without a picture."""

from __future__ import annotations

from collections.abc import Sequence

import trisquare as ts
import trisquare._core as _core


def choose(edges: Sequence[ts.PlaneEdges], image_size: tuple[int, int]) -> _core.Outcome:
    """Choose among figures as in a picture, and calibrate with the default lens model."""
    return _core.calibrate(
        edges,
        image_size,
        choosing=True,
        method="ml",
        model="radial2",
        fixed=(),
        initial=None,
        pictures=None,
        tones=[],
    )
