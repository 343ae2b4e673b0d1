"""Distortion from the straight lines of a picture: error, and residuals of unused lines.

Photographs are undistorted with a reference lens and distorted with a known lens, which
`straighten` estimates. The error is the difference of the displacements by both lenses, in pixels:
its mean and its maximum over a picture. Straight lines determine the displacement up to a
homography only; the error beyond the best homography is stated as well.

Unused lines are lines of the other pictures of the same camera, or the other half of a picture's
lines. Their residuals are compared with those of a division model with one coefficient about the
middle of the picture.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from harness.rows import NotMeasurableError, Row
from harness.truth import Array

import trisquare as ts
from trisquare.images.pixels import Image, picture_size
from trisquare.straightening.bundle import Bundle, CentredLens
from trisquare.straightening.edges import find_arcs
from trisquare.straightening.fit import (
    MAX_POINTS,
    ROUND_SCALES,
    Fit,
    Problem,
    fit_lens,
    refine,
    with_shared_errors,
)
from trisquare.straightening.radial import RadialLens
from trisquare.straightening.straighten import LONG, are_straight

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SETS = (
    ("opencv-chess", "*.jpg", "reference_left_cornerSubPix.json", "k1k2_notan_fixk3"),
    ("charuco-cube", "cam0/*.jpg", "reference_cam0.json", "k1_only_notan"),
)
"""Pictures and the reference lens that straightens them.

The cube is seen by a telephoto lens, for which k2 has no meaning (its README). References with k2,
k3 or tangential terms differ by .4 to 1.2 px in the mean from the joint result of the lines of all
24 pictures, whose two halves agree to .01 px; k1 alone differs by .2 px.
"""
CORNERS = ("left_calib.jpg", "right_calib.jpg")

COEFFICIENTS = (-0.28, -0.2, -0.12, -0.05, 0.03, 0.08)
FOCAL = 0.9
"""Focal length over the width, for which the coefficients hold."""
MEAN, WORST = 0.5, 2.5
"""Required mean and largest error, in pixels."""
AIM_MEAN, AIM_WORST = 0.1, 0.5
GOOD_PART = 0.8
RIM = (0.8, 0.9)
"""Range of distances from the middle, in half diagonals, where errors are compared with their
standard deviations."""

MAP_STEP = 20.0
STEPS = 6
SEARCHED = (-1.9, 0.4)
SECTIONS = 30


def measure() -> list[Row]:
    """Print the errors of known lenses, and the residuals of lines that were not used."""
    if not DATA.exists():
        raise NotMeasurableError("no ../shared/data")
    return [*_known_lenses(), *_held_out()]


def _known_lenses() -> list[Row]:
    """Straighten photographs that were undistorted and distorted again."""
    rows = []
    for folder, pattern, reference, name in SETS:
        left, bent, in_std, refused = [], [], [], 0
        for number, path in enumerate(sorted((DATA / folder).glob(pattern))):
            k1 = COEFFICIENTS[number % len(COEFFICIENTS)]
            picture = ts.undistort(path, _reference_camera(DATA / folder / reference, name))
            lens = _lens(k1, picture_size(picture))
            try:
                found = ts.straighten(_distorted(picture, lens))
            except ts.TrisquareError as error:
                print(f"  {path.name}, k1 {k1:+.2f}: {error}")
                refused += 1
                continue
            off, unknown, errors = _left(found.camera, lens)
            left.append((off.mean(), off.max()))
            bent.append((unknown.mean(), unknown.max()))
            in_std.append(errors)
            print(
                f"  {path.name}, k1 {k1:+.2f}: error {off.mean():.2f} / {off.max():.2f} px, "
                f"{unknown.mean():.2f} / {unknown.max():.2f} beyond a homography, "
                f"{len(found.used)} lines, centre {'held' if found.centre_held else 'free'}"
            )
        what = f"{folder}: mean / largest error"
        rows.append(_left_row(what, np.array(left), refused))
        rows.append(_left_row(f"{what} beyond a homography", np.array(bent), refused))
        rms = float(np.sqrt(np.mean(np.square(in_std))))
        rows.append(Row(f"{folder}: error / std near the corners, rms", f"{rms:.2f}", "", None))
    return rows


def _left_row(name: str, left: Array, refused: int) -> Row:
    good = int(((left[:, 0] <= MEAN) & (left[:, 1] <= WORST)).sum())
    best = int(((left[:, 0] <= AIM_MEAN) & (left[:, 1] <= AIM_WORST)).sum())
    mean, worst = np.median(left, axis=0)
    count = len(left) + refused
    return Row(
        name,
        f"{good} of {count} within {MEAN} / {WORST} px ({best} within {AIM_MEAN} / {AIM_WORST}), "
        f"median {mean:.2f} / {worst:.2f} px, {refused} refused",
        f"<= {MEAN} / {WORST} px in 4 of 5",
        good >= GOOD_PART * count,
    )


def _reference_camera(path: Path, name: str) -> ts.Camera:
    members = json.loads(path.read_text("utf-8"))
    size = members["image_size"]
    reference = members[name]
    k1, k2 = reference["dist_k1k2p1p2k3"][:2]
    return ts.Camera(reference["K"], [k1, k2, 0, 0, 0], tuple(size))


def _lens(k1: float, size: tuple[int, int]) -> ts.Camera:
    """Return a lens with its centre in the middle of the picture."""
    focal = FOCAL * size[0]
    cx, cy = (np.array(size) - 1) / 2
    K = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])
    return ts.Camera(K, np.array([k1, 0, 0, 0, 0]), size, "radial1")


def _distorted(picture: Image, lens: ts.Camera) -> Image:
    """Distort a picture with a lens, enlarged so that it fills the frame."""
    width, height = lens.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    ideal = lens.undistort_points(pixels.reshape(-1, 2).astype(np.float64))
    middle = np.array([lens.cx, lens.cy])
    zoom = min(1.0, float((middle / np.abs(ideal - middle).max(axis=0)).min()))
    source = (middle + zoom * (ideal - middle)).astype(np.float32).reshape(height, width, 2)
    return np.asarray(cv2.remap(picture, source, None, cv2.INTER_CUBIC))  # type: ignore[call-overload]


def _left(camera: ts.UnscaledCamera, lens: ts.Camera) -> tuple[Array, Array, float]:
    """Return the errors of an estimated displacement, in pixels.

    The errors at each point of a map; the same without the homography of the straightened picture
    that explains most of them, which straight lines do not determine; the median near the corners
    over the median stated standard deviation.
    """
    found = camera.displacement_map(MAP_STEP)
    ideal = lens.undistort_points(found.points)
    off = np.linalg.norm(found.points - found.displacement - ideal, axis=1)
    bent = _beyond_a_homography(found.points - found.displacement, ideal)
    away = np.linalg.norm(found.points - found.points.mean(axis=0), axis=1) / camera.radius
    rim = (away > RIM[0]) & (away < RIM[1])
    std = np.linalg.norm(found.std, axis=1)
    return off, np.linalg.norm(bent, axis=1), float(np.median(off[rim]) / np.median(std[rim]))


def _beyond_a_homography(places: Array, wanted: Array) -> Array:
    """Return the residuals of the homography that fits best by least squares in pixels."""
    middle, size = wanted.mean(axis=0), np.abs(wanted - wanted.mean(axis=0)).max()
    wanted = (wanted - middle) / size
    homography, seen = np.eye(3), (places - middle) / size
    start = np.column_stack([seen, np.ones(len(seen))])
    for _ in range(STEPS):
        x, y = seen.T
        one, none = np.ones_like(x), np.zeros_like(x)
        by_x = np.column_stack([x, y, one, none, none, none, -x * x, -x * y])
        by_y = np.column_stack([none, none, none, x, y, one, -x * y, -y * y])
        off = (wanted - seen).T.ravel()
        step, *_ = np.linalg.lstsq(np.vstack([by_x, by_y]), off, rcond=None)
        homography = (np.eye(3) + np.append(step, 0.0).reshape(3, 3)) @ homography
        moved = start @ homography.T
        seen = moved[:, :2] / moved[:, 2:]
    return np.asarray(size * (seen - wanted))


def _held_out() -> list[Row]:
    """Compare with a model of one parameter on lines that neither fit used."""
    rows = []
    for folder, pattern, _, _ in SETS:
        fits = [_fitted(path) for path in sorted((DATA / folder).glob(pattern))]
        rms = []
        for number, (problem, fit) in enumerate(fits):
            lenses = fit.lens, _one_parameter(problem, fit.straightness.bundle)
            others = [
                line for other in fits[:number] + fits[number + 1 :] for line in _long_lines(other)
            ]
            rms.append([_rms(others, lens, problem) for lens in lenses])
        rows.append(_held_out_row(f"{folder}, lines of the other pictures", np.array(rms)))
    rms = []
    for name in CORNERS:
        problem, fit = _fitted(DATA / "ortho-corner" / name)
        lines = _long_lines((problem, fit))
        for part in (0, 1):
            bundle = Bundle.of(lines[part::2], problem.radius, MAX_POINTS)
            lens = refine(problem, bundle, fit.lens, ROUND_SCALES[-1] * problem.pixel)
            lenses = lens, _one_parameter(problem, bundle)
            rms.append([_rms(lines[1 - part :: 2], lens, problem) for lens in lenses])
    return [*rows, _held_out_row("ortho-corner, the other half of the lines", np.array(rms))]


def _fitted(path: Path) -> tuple[Problem, Fit]:
    picture = cv2.imread(str(path))
    assert picture is not None
    size = np.array(picture_size(picture))
    arcs = find_arcs(picture)
    radius = 0.5 * float(np.hypot(*size))
    problem = Problem(arcs.curves, (size - 1) / 2, radius, arcs.pixel)
    fit = fit_lens(problem)
    return with_shared_errors(problem, fit), fit


def _long_lines(fitted: tuple[Problem, Fit]) -> list[Array]:
    """Return the long lines that a picture's own fit used."""
    problem, fit = fitted
    pairs = zip(fit.lines(), are_straight(problem, fit), strict=True)
    lines = [line for line, is_straight in pairs if is_straight]
    return [line for line in lines if np.linalg.norm(line[-1] - line[0]) > LONG * problem.radius]


def _one_parameter(problem: Problem, bundle: Bundle) -> CentredLens:
    """Fit one division coefficient about the middle of the picture, with the same robust cost."""
    scale = ROUND_SCALES[-1] * problem.pixel

    def lens(first: float) -> CentredLens:
        return CentredLens(RadialLens("division", np.array([first, 0.0, 0.0])), problem.middle)

    def cost(first: float) -> float:
        return problem.cost(lens(first), bundle.measure(lens(first)), scale)

    grid = np.linspace(*SEARCHED, 120)
    best = int(np.argmin([cost(first) for first in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    for _ in range(SECTIONS):
        third = (high - low) / 3
        if cost(low + third) < cost(high - third):
            high -= third
        else:
            low += third
    return lens(0.5 * (low + high))


def _rms(lines: list[Array], lens: CentredLens, problem: Problem) -> float:
    bundle = Bundle.of(lines, problem.radius, MAX_POINTS)
    return float(np.sqrt(np.mean(bundle.measure(lens).rms ** 2)))


def _held_out_row(name: str, rms: Array) -> Row:
    ours, one = np.sqrt(np.mean(rms**2, axis=0))
    smaller = int((rms[:, 0] < rms[:, 1]).sum())
    return Row(
        f"{name}: rms residual / that of the division model",
        f"{ours:.3f} / {one:.3f} px, smaller on {smaller} of {len(rms)}",
        "smaller",
        bool(ours < one),
    )
