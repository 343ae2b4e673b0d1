"""Boards of given size compared with boards whose size is not given: found, and error.

Pictures of three boards of 7 x 7 inner corners. In every second picture, two rows of cells of the
first board are hidden.
"""

from __future__ import annotations

import cv2
import numpy as np
from accuracy.lattice_bound import board_scene
from harness.rows import Row

import trisquare as ts
from trisquare import simulate
from trisquare.detection.kinds import TargetKinds
from trisquare.measurement.find import search

SEED = 91
PICTURES = 30
CORNERS = 7
"""Number of inner corners of each of three boards, in a row and in a column."""

HIDDEN = 2.0
"""Number of cells at one end of the first board that are covered in every second picture."""

NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.5)  # pixels


def measure() -> list[Row]:
    """Draw three boards of one size, with two rows of the first hidden in every second picture."""
    names = ("auto", f"chessboard:{CORNERS}x{CORNERS}")
    found = dict.fromkeys(names, 0)
    answered = dict.fromkeys(names, 0)
    scores: dict[str, list[float]] = {name: [] for name in names}
    for index in range(PICTURES):
        rng = np.random.default_rng([SEED, index])
        scene = board_scene(rng, CORNERS)
        picture = simulate.render(
            scene, rng, noise=rng.uniform(*NOISE_RANGE), blur=rng.uniform(*BLUR_RANGE)
        )
        if index % 2:
            size = 0.5 * (CORNERS + 1)
            # In the board's own cells, beyond its border.
            low, high = HIDDEN - size, size + 1.0
            cover = np.array([[-high, -high], [high, -high], [high, low], [-high, low]])
            cell = np.linalg.norm(np.ptp(scene.targets[0].board_corners(), axis=0)) / (
                np.sqrt(2.0) * (CORNERS - 1)
            )
            hidden = scene.image_points(0, cell * cover)
            cv2.fillConvexPoly(picture, np.rint(hidden).astype(np.int32), 120.0)
        for name in names:
            found[name] += len(search(picture, TargetKinds.parse(name)).targets)
            try:
                result = ts.calibrate(picture, targets=name)
            except ts.TrisquareError as error:
                print(f"  picture {index}, {name}: {error}")
                continue
            answered[name] += 1
            scores[name].append((result.camera.fx - scene.camera.fx) / result.std["fx"])
    auto, given = names
    rms = {name: float(np.sqrt(np.mean(np.square(of)))) for name, of in scores.items()}
    return [
        Row(
            f"{PICTURES} pictures: boards found, size given and not; answered",
            f"{found[given]}, {found[auto]}; {answered[given]}, {answered[auto]}",
            "not fewer",
            found[given] >= found[auto] and answered[given] >= answered[auto],
        ),
        Row(
            f"{PICTURES} pictures: error / std of fx, rms, size given and not",
            f"{rms[given]:.2f}, {rms[auto]:.2f}",
            "not larger",
            rms[given] <= 1.05 * rms[auto],
        ),
    ]
