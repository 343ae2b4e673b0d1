"""Boards whose size is told beside boards that are found untold: as many, and as accurate."""

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
    told, untold = names[1], names[0]
    rms = {name: float(np.sqrt(np.mean(np.square(of)))) for name, of in scores.items()}
    return [
        Row(
            f"{PICTURES} pictures of three boards, one often hidden in part: boards found told, "
            "untold; answered",
            f"{found[told]}, {found[untold]}; {answered[told]}, {answered[untold]}",
            "as many",
            found[told] >= found[untold] and answered[told] >= answered[untold],
        ),
        Row(
            "the same: fx error / std, rms, told and untold",
            f"{rms[told]:.2f}, {rms[untold]:.2f}",
            "no worse told",
            rms[told] <= 1.05 * rms[untold],
        ),
    ]
