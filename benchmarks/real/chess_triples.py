"""Triples of photographs of a chessboard: spread of the camera, and its stated std.

The spread is robust, from the median absolute deviation. Warned: a warning says that the samples of
a side have a common error, since the paper is not flat.
"""

from __future__ import annotations

import json

import cv2
import numpy as np
from harness.rows import NotMeasurableError, Row
from harness.truth import robust_spread
from real.chess_partitions import partition_row, pooled
from real.real_pictures import CHESS

import trisquare as ts

TRIPLES = 40
SEED = 10
TARGETS = "chessboard:9x6"
SAME_MODEL = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
KINDS = ("opencv", "edges", "edges, linear tone", "edges, tone estimated", "pictures")


def measure() -> list[Row]:
    """Print the robust spread of fx over the triples, from edges, from pixels, and by OpenCV."""
    name = f"{TRIPLES} triples: robust spread of fx / that of OpenCV"
    if not CHESS.exists():
        raise NotMeasurableError("no ../shared/data")
    views = json.loads((CHESS / "corners_left_cornerSubPix.json").read_text())
    pictures = [cv2.imread(str(CHESS / view["image"]), cv2.IMREAD_GRAYSCALE) for view in views]
    height, width = pictures[0].shape
    edges = [ts.detect(picture, targets=TARGETS) for picture in pictures]
    linear = [ts.detect(picture, targets=TARGETS, tone="linear") for picture in pictures]
    estimated = [ts.detect(picture, targets=TARGETS, tone="auto") for picture in pictures]
    rng = np.random.default_rng(SEED)
    found: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for _ in range(TRIPLES):
        triple = sorted(rng.choice(len(pictures), 3, replace=False))
        try:
            from_edges, as_linear, as_estimated = (
                ts.calibrate_edges(pooled(measured[index] for index in triple), (width, height))
                for measured in (edges, linear, estimated)
            )
            result = ts.calibrate([pictures[index] for index in triple], targets=TARGETS)
        except ts.TrisquareError as error:
            print(f"  triple {[views[index]['image'] for index in triple]}: {error}")
            continue
        found["edges"].append(from_edges.camera.fx)
        found["edges, linear tone"].append(as_linear.camera.fx)
        found["edges, tone estimated"].append(as_estimated.camera.fx)
        found["pictures"].append(result.camera.fx)
        found["opencv"].append(_zhang([views[index] for index in triple], (width, height)))
    spreads = {kind: robust_spread(values) for kind, values in found.items()}
    for kind, spread in spreads.items():
        print(f"  {kind}: spread {spread:.2f} px about {np.median(found[kind]):.2f}")
    print(f"  pictures: stage {result.stage}; {len(found['opencv'])} triples answered")
    ratio = spreads["pictures"] / spreads["opencv"]
    measured = f"{ratio:.2f} ({spreads['pictures']:.2f} px / {spreads['opencv']:.2f} px)"
    rows = [Row(name, measured, "<= 1", ratio <= 1.0)]
    ratio = spreads["edges, tone estimated"] / spreads["opencv"]
    name = f'{TRIPLES} triples, edges with `tone="auto"`: robust spread of fx / that of OpenCV'
    rows.append(Row(name, f"{ratio:.2f}", "<= 1", ratio <= 1.0))
    return [*rows, partition_row(edges, (width, height))]


def _zhang(views: list[dict], image_size: tuple[int, int]) -> float:
    """Return OpenCV's fx from the given corners, with k1 and k2 free."""
    columns, rows = views[0]["inner_corners"]
    grid = np.indices((columns, rows)).T.reshape(-1, 2)
    board = np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)
    corners = [np.array(view["corners_xy"], dtype=np.float32) for view in views]
    _, K, _, _, _ = cv2.calibrateCamera(
        [board] * len(views), corners, image_size, None, None, flags=SAME_MODEL
    )
    return float(K[0, 0])
