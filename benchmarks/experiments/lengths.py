"""Lengths measured on planes with the camera of each estimator: the paper's own test."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import cv2
import numpy as np
from accuracy.measured_lengths import TRIPLES, real_lengths, segments
from accuracy.planned_scenes import camera_of
from experiments.estimators import zhang_boards, zhang_corners
from harness.truth import Array
from real.real_pictures import CHESS

import trisquare as ts
from trisquare import simulate
from trisquare.simulate.scene import TrueCamera

SEED = 17
PICTURES = 2  # of three squares, per camera
NOISE_RANGE = (1.0, 4.0)  # grey levels
BLUR_RANGE = (0.5, 1.2)  # pixels


def simulated(number: int) -> dict[str, list[float]]:
    """Measure in photographs of one camera.

    All cameras pose the planes from the same edges, so that nothing but the camera differs. A
    photograph where one of them does not exist or does not see a plane is left out.

    Returns
    -------
    dict of str to list of float
        Relative errors of the lengths, by estimator; "truth" is the true camera's.
    """
    rng = np.random.default_rng([SEED, number])
    camera = simulate.random_camera(rng)
    photo = {"noise": rng.uniform(*NOISE_RANGE), "blur": rng.uniform(*BLUR_RANGE)}
    boards = _as_camera(zhang_boards(camera, rng, photo), camera)
    found: dict[str, list[float]] = {}
    for _ in range(PICTURES):
        scene = simulate.random_scene(rng, camera=camera)
        picture = simulate.render(scene, rng, tone="linear", **photo)
        edges = ts.detect(picture, tone="linear")
        size = camera.image_size
        estimates: Mapping[str, Callable[[], ts.Camera]] = {
            "linear": lambda: ts.calibrate_edges(edges, size, method="linear").camera,  # noqa: B023
            "edges": lambda: ts.calibrate_edges(edges, size).camera,  # noqa: B023
            "pixels": lambda: ts.calibrate(picture, tone="linear").camera,  # noqa: B023
            "corners": lambda: _as_camera(zhang_corners(picture, scene, rng), camera),  # noqa: B023
            "boards": lambda: boards,
            "truth": lambda: camera_of(camera),
        }
        try:
            cameras = {name: estimate() for name, estimate in estimates.items()}
            planes = {name: ts.locate(picture, own, tone="linear") for name, own in cameras.items()}
        except (ts.TrisquareError, cv2.error):
            continue
        if {len(own) for own in planes.values()} != {len(scene.targets)}:
            continue
        for index, plane in enumerate(planes["truth"]):
            for pixels, length in segments(scene, plane, cameras["truth"], rng):
                for name, own in cameras.items():
                    seen = ts.measure(planes[name][index], pixels, own, point_std=0)
                    found.setdefault(name, []).append(seen.lengths[0] / length - 1.0)
    return found


def real() -> list[dict[str, list[float]]]:
    """Measure on real chessboards: relative errors by estimator, for each triple of photographs.

    Nothing where the photographs are absent.
    """
    if not CHESS.exists():
        return []
    found, _ = real_lengths()
    own, boards = (
        np.reshape(found[name], (TRIPLES, -1)).tolist() for name in ("trisquare", "Zhang")
    )
    return [{"pixels": first, "boards": second} for first, second in zip(own, boards, strict=True)]


def _as_camera(found: tuple[Array, Array], truth: TrueCamera) -> ts.Camera:
    return ts.Camera(*found, truth.image_size, "brown")
