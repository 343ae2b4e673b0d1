"""Photographs of boards: error on rows and columns that the fit does not use.

trisquare fits a camera to the lines of two thirds of the rows and columns, and OpenCV, also with k1
and k2, to another detector's corners of the same rows and columns. Both cameras are tested on the
remaining third: on the corners, with poses from the other corners, and on the samples of the lines,
with poses from the other lines. The thirds are drawn several times.

The poses are least-squares poses of flat boards, as in OpenCV's fit. trisquare attributes the bend
of the paper to the boards, and OpenCV partly to the lens. An unused row lies between rows that are
bent in the same way, so that a lens that has absorbed the bend predicts it. Lines are therefore
tested with bent boards as well, the same for both cameras. The angles between three perpendicular
boards are not used by any fit.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from accuracy.board_pose import LineSamples, fit_pose
from harness.rows import NotMeasurableError, Row
from real.real_boards import FOLDS, SEED, SQUARE_CORNERS, Board, Case, Thirds, cases
from real.real_pictures import DATA

import trisquare as ts

Array = npt.NDArray[np.float64]

DRAWS = 5  # of thirds
FIELD = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST  # k1 and k2, as ours
NOISE = 2.0  # standard deviations of the mean over the folds up to which a difference is ignored
KINDS = ("lines", "corners", "lines, bent boards")
REQUIRED = "no worse on any, better on most"


class Score(NamedTuple):
    """Root mean square errors of the held-out data, in pixels (of corners, per coordinate)."""

    lines: float
    corners: float
    bent: float
    angles: float  # deviation from a right angle between the planes fitted with the camera, degrees


class Fit(NamedTuple):
    """A camera, and the boards' normals from the same fit."""

    camera: ts.Camera
    normals: list[Array]


def measure() -> list[Row]:
    """Print both cameras' errors by set, and the number of sets where trisquare's are smaller."""
    if not DATA.exists():
        raise NotMeasurableError("no ../shared/data")
    ratios: dict[str, Array] = {}
    angles = []
    for case in cases():
        scores = _all_scores(case)
        if len(scores) < 2:
            continue
        errors = np.exp(np.log(scores[:, :, :3]).mean(axis=0))
        ratios[case.name] = np.log(scores[:, 0, :3] / scores[:, 1, :3])
        print(f"  {case.name}, {len(case.boards)} boards, {len(scores)} folds: {_summary(errors)}")
        if case.name in SQUARE_CORNERS:
            angles.append(np.sqrt((scores[:, :, 3] ** 2).mean(axis=0)))
            print(f"    angles off by {angles[-1][0]:.2f} degrees, OpenCV's {angles[-1][1]:.2f}")
    both = {name: found[:, :2].mean(axis=1) for name, found in ratios.items()}
    rows = [_row("lines and corners", both, REQUIRED)]
    rows += [
        _row(kind, {name: found[:, column] for name, found in ratios.items()})
        for column, kind in enumerate(KINDS)
    ]
    return [*rows, _angle_row(np.array(angles))]


def _summary(scores: Array) -> str:
    """Compare both cameras' errors."""
    return "; ".join(
        f"{kind} {scores[0, column]:.3f} px, OpenCV {scores[1, column]:.3f}"
        for column, kind in enumerate(KINDS)
    )


def _row(what: str, ratios: dict[str, Array], target: str = "") -> Row:
    """Compare the mean over the folds with its standard deviation.

    Folds share most of their training data: the variance of their mean is not `1 / n` of theirs but
    `1 / n + 1 / (FOLDS - 1)` (C. Nadeau & Y. Bengio, Machine Learning 52 (2003) 239-281).
    """
    smaller, larger, clearly = 0, [], []
    for name, found in ratios.items():
        noise = found.std(ddof=1) * np.sqrt(1.0 / len(found) + 1.0 / (FOLDS - 1.0))
        smaller += found.mean() < 0.0
        if found.mean() > 0.0:
            larger.append(f"{name} ({np.expm1(found.mean()):+.1%})")
        if found.mean() > NOISE * noise:
            clearly.append(name)
    print(f"  {what}: larger in the mean on {', '.join(larger) or 'none'}")
    mean = np.expm1(np.mean([found.mean() for found in ratios.values()]))
    measured = f"smaller on {smaller} of {len(ratios)}, {mean:+.1%} in the mean"
    good = not clearly and 2 * smaller > len(ratios)
    return Row(
        f"{len(ratios)} sets, {what}: error compared with OpenCV",
        measured + (f", clearly larger on {', '.join(clearly)}" if clearly else ""),
        target,
        good if target else None,
    )


def _angle_row(angles: Array) -> Row:
    """Compare the angles between planes that are known to be perpendicular."""
    ours, theirs = np.sqrt((angles**2).mean(axis=0))
    return Row(
        f"{len(angles)} photographs of three perpendicular boards: rms error of the angles",
        f"{ours:.2f} degrees (OpenCV {theirs:.2f})",
        "<= OpenCV",
        bool(ours <= theirs),
    )


def _all_scores(case: Case) -> Array:
    """Score both cameras on every fold of every draw, shape (folds, 2, scores)."""
    rng = np.random.default_rng(SEED)
    scores = []
    for _ in range(DRAWS):
        thirds = [board.thirds(rng) for board in case.boards]
        pairs = [(b, t) for b, t in zip(case.boards, thirds, strict=True) if t is not None]
        for fold in range(FOLDS):
            try:
                scores.append(_scores(case.size, pairs, fold))
            except (ts.TrisquareError, ValueError) as error:
                print(f"  {case.name}: {error}")
    return np.array(scores)


def _scores(
    size: tuple[int, int], boards: list[tuple[Board, Thirds]], fold: int
) -> tuple[Score, Score]:
    """Fit both cameras without a fold, and test them on it."""
    ours, theirs = _our_fit(size, boards, fold), _their_fit(size, boards, fold)
    return _score(ours, boards, fold), _score(theirs, boards, fold)


def _our_fit(size: tuple[int, int], boards: list[tuple[Board, Thirds]], fold: int) -> Fit:
    kept = [board.with_lines(thirds.lines != fold) for board, thirds in boards]
    result = ts.calibrate_edges(kept, size)
    return Fit(result.camera, [plane.rotation[:, 2] for plane in result.planes])


def _their_fit(size: tuple[int, int], boards: list[tuple[Board, Thirds]], fold: int) -> Fit:
    kept = [~thirds.held_corners(fold) for _, thirds in boards]
    pairs = list(zip(boards, kept, strict=True))
    _, K, distortion, turns, _ = cv2.calibrateCamera(
        [board.corners[chosen].astype(np.float32) for (board, _), chosen in pairs],
        [board.pixels[chosen].astype(np.float32) for (board, _), chosen in pairs],
        size,
        None,
        None,
        flags=FIELD,
    )
    camera = ts.Camera(K, distortion.ravel()[:5], size, "radial2")
    return Fit(camera, [cv2.Rodrigues(turn)[0][:, 2] for turn in turns])


def _score(fit: Fit, boards: list[tuple[Board, Thirds]], fold: int) -> Score:
    """Test a camera on the held-out part of every board."""
    camera = fit.camera
    lines, corners, bent = [], [], []
    for board, thirds in boards:
        held_corners = thirds.held_corners(fold)
        on_board, pixels = board.corners[~held_corners], board.pixels[~held_corners]
        _, turn, shift = cv2.solvePnP(on_board, pixels, camera.K, camera.distortion)
        asked = board.corners[held_corners]
        seen, _ = cv2.projectPoints(asked, turn, shift, camera.K, camera.distortion)
        corners.append((seen.reshape(-1, 2) - board.pixels[held_corners]).ravel())
        used, unused = (
            LineSamples.of(camera, board.edges.lines[own], board.samples(own))
            for own in (thirds.lines != fold, thirds.lines == fold)
        )
        start = np.concatenate([turn.ravel(), shift.ravel()])
        flat = fit_pose(start, used, bent=False)
        lines.append(flat.errors(unused))
        bent.append(fit_pose(flat.pose, used, bent=True).errors(unused))
    return Score(_rms(lines), _rms(corners), _rms(bent), _off_square(fit.normals))


def _rms(errors: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def _off_square(normals: list[Array]) -> float:
    """Return the root mean square deviation of the planes' angles from a right one, in degrees."""
    sines = np.clip([a @ b for a, b in combinations(normals, 2)], -1.0, 1.0)
    return float(np.sqrt(np.mean(np.degrees(np.arcsin(sines)) ** 2)))
