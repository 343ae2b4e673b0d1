"""Real photographs as measured by trisquare: outlines only, without pixels."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from experiments.plots import WIDTH, standalone
from real.real_pictures import CHESS, DATA

import trisquare as ts
from trisquare.analysis.residuals import measured_sides
from trisquare.report.plot_style import FAINT, INK, plane_colour, plotting

POINTS = 5
"""Number of points drawn of each line's image: enough for its bend, few enough for a small file."""


class Exhibit(NamedTuple):
    """One photograph, and the focal length of its camera from another source."""

    title: str
    calibrate: Callable[[], ts.Calibration]
    reference: float  # fx, pixels
    known: str  # source of the reference


EXHIBITS = (
    Exhibit(
        "three squares",
        lambda: _three_squares(),
        1110.0 * (1.0 - 0.024),
        "a pinhole with one coefficient, fitted to the same points",
    ),
    Exhibit(
        "three chessboards in a wooden corner",
        lambda: ts.calibrate(DATA / "ortho-corner" / "left_calib.jpg"),
        1624.0,
        "the EXIF tags",
    ),
    Exhibit(
        "a paper cube, photograph 7",
        lambda: ts.calibrate(DATA / "charuco-cube" / "cam0" / "7.jpg"),
        5145.0,
        "Zhang on 24 photographs",
    ),
    Exhibit(
        "a chessboard: left01, left05 and left12",
        lambda: ts.calibrate([CHESS / f"left{number}.jpg" for number in ("01", "05", "12")]),
        533.1,
        "Zhang on 13 photographs",
    ),
)


def draw(folder: Path) -> list[dict[str, Any]]:
    """Write ``gallery.svg`` and return its numbers; an empty list without the photographs."""
    if not DATA.exists():
        return []
    from matplotlib.figure import Figure

    results = [exhibit.calibrate() for exhibit in EXHIBITS]
    with plotting():
        figure = Figure(figsize=(WIDTH, 7.0))
        for axes, exhibit, result in zip(
            figure.subplots(2, 2).flat, EXHIBITS, results, strict=True
        ):
            width, height = result.camera.image_size
            for side in measured_sides(result):
                shown = np.linspace(0, len(side.points) - 1, POINTS).astype(int)
                axes.plot(*side.curve[shown].T, color=plane_colour(side.plane), linewidth=1.0)
            axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.grid(visible=False)
            axes.spines[:].set(visible=True, color=FAINT)
            axes.set_title(exhibit.title, fontsize=10.0, color=INK)
        svg = standalone(figure, "gallery")
    (folder / "gallery.svg").write_text(svg, encoding="utf-8")
    return [
        {
            "title": exhibit.title,
            "planes": len(result.planes),
            "fx": float(result.camera.fx),
            "std": float(result.std["fx"]),
            "rms": float(result.rms),
            "reference": exhibit.reference,
            "known": exhibit.known,
        }
        for exhibit, result in zip(EXHIBITS, results, strict=True)
    ]


def _three_squares() -> ts.Calibration:
    """Calibrate from edge points instead of the photograph, which cannot be published."""
    record = json.loads((DATA / "three-squares" / "edges.json").read_text(encoding="utf-8"))
    edges = [
        ts.PlaneEdges.square([np.array(side) for side in square]) for square in record["squares"]
    ]
    return ts.calibrate_edges(edges, tuple(record["image_size"]), model="radial1")
