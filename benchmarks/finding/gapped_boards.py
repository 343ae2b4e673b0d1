"""Chessboards with gaps or overlaps between the dark cells: found, and error.

A board is found if the only lattice has at least 90 % of its crossings, each within 2 px, and no
wrong ones. The errors are those of fx, fy, cx and cy.
"""

from __future__ import annotations

import numpy as np
from harness.rows import Row

from trisquare import TrisquareError, calibrate, simulate
from trisquare.detection.boards.find import find_lattices
from trisquare.detection.candidates import Lattice
from trisquare.simulate.scene import Scene
from trisquare_scenes.gapped_boards import gapped_scene

SEED = 67
PICTURES = 200
GAPS = (-2.0, 3.0)
"""Range of the gap between dark cells, in pixels; negative where they overlap."""

NEAR = 2.0
"""Maximum distance, in pixels, of a crossing found from its true position."""
WHOLE = 0.9
"""Minimum fraction of a board's crossings in its lattice."""
FOUND_TARGET = 0.97

CAMERAS = 60
"""Number of cameras, each calibrated from three boards of one kind."""
LARGE_CELLS = (30.0, 90.0)
"""Range of cell sizes, in pixels; three boards with smaller cells hardly determine a camera."""
MAX_SIGMAS = 4.0
RMS_RANGE = (0.7, 1.3)


def is_found(scene: Scene, lattices: list[Lattice]) -> bool:
    """Return whether the only lattice has nearly all crossings of the only board, and no others."""
    if len(lattices) != 1:
        return False
    truth = scene.image_points(0, scene.targets[0].board_corners())
    points = lattices[0].crossings[lattices[0].present]
    gaps = np.linalg.norm(points[:, None] - truth, axis=2)
    return bool((gaps.min(axis=1) < NEAR).all() and np.mean(gaps.min(axis=0) < NEAR) >= WHOLE)


def measure() -> list[Row]:
    """Print the missed boards, and the errors of cameras calibrated from such boards."""
    return [_found(), _calibrated()]


def _light(rng: np.random.Generator) -> dict[str, float]:
    return {"noise": rng.uniform(1.0, 4.0), "blur": rng.uniform(0.5, 1.2)}


def _found() -> Row:
    found = 0
    for index in range(PICTURES):
        rng = np.random.default_rng([SEED, index])
        gap = rng.uniform(*GAPS)
        scene = gapped_scene(rng, gap)
        is_right = is_found(scene, find_lattices(simulate.render(scene, rng, **_light(rng))))
        found += is_right
        if not is_right:
            cell = scene.camera.fx / scene.targets[0].translation[2]
            print(f"    missed: picture {index}, gap {gap:.2f} px, cells of {cell:.0f} px")
    return Row(
        f"{PICTURES} boards, cells of 15-90 px, gaps of 0-3 px or overlaps of 0-2 px: found",
        f"{found}",
        f">= {FOUND_TARGET:.0%}",
        found >= FOUND_TARGET * PICTURES,
    )


def _calibrated() -> Row:
    sigmas, refused = [], 0
    for index in range(CAMERAS):
        rng = np.random.default_rng([SEED, 1, index])
        camera = simulate.random_camera(rng)
        gap, cell = rng.uniform(*GAPS), rng.uniform(*LARGE_CELLS)
        scenes = [gapped_scene(rng, gap, cell=cell, camera=camera) for _ in range(3)]
        pictures = [simulate.render(scene, rng, **_light(rng)) for scene in scenes]
        try:
            result = calibrate(pictures, tone="linear")
        except TrisquareError as refusal:
            print(f"    camera {index}, gap {gap:.2f} px, cells of {cell:.0f} px: {refusal}")
            refused += 1
            continue
        names = ("fx", "fy", "cx", "cy")
        off = [
            (getattr(result.camera, name) - getattr(camera, name)) / result.std[name]
            for name in names
        ]
        sigmas.append(off)
        if np.abs(off).max() > MAX_SIGMAS:
            print(
                f"    camera {index}, gap {gap:.2f} px, cells of {cell:.0f} px: {np.round(off, 1)}"
            )
    rms = float(np.sqrt(np.mean(np.square(sigmas))))
    worst = float(np.abs(sigmas).max())
    return Row(
        f"{CAMERAS} cameras from three such boards each: error / std, rms; largest",
        f"{rms:.2f}; {worst:.1f} ({refused} refused)",
        f"{RMS_RANGE[0]}-{RMS_RANGE[1]}; < {MAX_SIGMAS:.0f}",
        RMS_RANGE[0] <= rms <= RMS_RANGE[1] and worst < MAX_SIGMAS,
    )


if __name__ == "__main__":
    for row in measure():
        print(row)
