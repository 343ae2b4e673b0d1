"""Outlines drawn by hand, with corners up to 5 px off: same camera as from a search.

Two cameras are the same if fx, fy, cx and cy differ by less than 0.1 std.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from harness.rows import Row

import trisquare as ts
from trisquare import simulate
from trisquare.images.pixels import Image
from trisquare.simulate.scene import Scene

SEED = 55
SCENES = 50  # of each kind
OFF = 5.0  # pixels
SAME = 0.1  # maximum difference between the two results, in standard deviations
TARGET = 0.98


def measure() -> list[Row]:
    """Count the scenes with the same camera from drawn outlines as from a search."""
    return [_row("srgb", "stated"), _row("auto", "estimated")]


def _row(tone: str, tone_curve: str) -> Row:
    same, compared, wrong = 0, 0, 0
    for kind in ("plain", "photo_like"):
        gaps = []
        for seed in range(SCENES):
            rng = np.random.default_rng([SEED, seed])
            picture, scene = _plain(rng) if kind == "plain" else simulate.photo_like(rng)[:2]
            drawn = _drawn(scene, rng)
            try:
                searched = ts.calibrate(picture, tone=tone)
            except ts.TrisquareError:
                continue  # nothing to compare with
            gaps.append(_gap(picture, drawn, searched, tone))
        same += sum(gap < SAME for gap in gaps)
        wrong += sum(gap == np.inf for gap in gaps)
        compared += len(gaps)
        worst = ", ".join(f"{gap:.2g}" for gap in sorted(gaps)[-3:])
        print(f"  {kind}: {len(gaps)} compared, largest gaps {worst} standard deviations")
    return Row(
        f"tone curve {tone_curve}: same camera as from a search",
        f"{same} of {compared} ({wrong} without a result)",
        f">= {TARGET:.0%}",
        same >= TARGET * compared,
    )


def _plain(rng: np.random.Generator) -> tuple[Image, Scene]:
    scene = simulate.random_scene(rng, kind="square" if rng.random() < 0.5 else "frame")
    noise, blur = rng.uniform(1.0, 8.0), rng.uniform(0.5, 1.5)
    return simulate.render(scene, rng, noise=noise, blur=blur, tone="srgb"), scene


def _drawn(scene: Scene, rng: np.random.Generator) -> dict[str, Any]:
    """Return all outlines, with each corner drawn uniformly from a disc around its position."""
    squares = []
    for number, target in enumerate(scene.targets):
        outlines = []
        for outline in target.outlines():
            radius, angle = OFF * np.sqrt(rng.uniform(size=4)), rng.uniform(0, 2 * np.pi, 4)
            off = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
            outlines.append({"corners": (scene.image_points(number, outline) + off).tolist()})
        squares.append({**outlines[0], **({"inner": outlines[1]} if outlines[1:] else {})})
    return {"format": "trisquare-outlines/1", "squares": squares}


def _gap(picture: Image, drawn: dict[str, Any], searched: ts.Calibration, tone: str) -> float:
    """Return the difference of the two cameras in standard deviations; infinite without one."""
    try:
        found = ts.calibrate(picture, outlines=drawn, tone=tone)
    except ts.TrisquareError:
        return np.inf
    if len(found.planes) != len(searched.planes):
        return np.inf
    return max(
        abs(getattr(found.camera, name) - getattr(searched.camera, name)) / searched.std[name]
        for name in ("fx", "fy", "cx", "cy")
    )
