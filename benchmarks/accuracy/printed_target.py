"""Printed corners: predicted standard deviation, error, and effect of printing errors.

The prediction is for 1280 x 960 pixels, f 1100 px and edges known to 0.02 px per pixel. Pictures
are taken from within 15 degrees of the corner's diagonal and calibrated without options. Right:
three planes, and fx, fy, cx and cy within 4 std; silently wrong: not right, without a warning. The
printing errors are tested with edge points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from accuracy.planned_scenes import camera_of, edges_of
from harness.rows import Row

import trisquare as ts
from trisquare import simulate
from trisquare.printing.target import TargetPage
from trisquare.simulate.scene import Scene, Target, TrueCamera
from trisquare_scenes.printed_photograph import printed_photograph

PICTURES = 60
BOARD_PICTURES = 20  # of the corner with chessboards, which are slower to render
SEED = 41_000
NAMES = ("fx", "fy", "cx", "cy")
SIDE = 84.0  # mm, of A4's corner

# The camera of the advice in docs/photograph.md, with its noise.
CAMERA = TrueCamera(1100.0, 1100.0, 639.5, 479.5, np.array([-0.15, 0.03, 0.0, 0.0, 0.0]))
SIGMA = 0.02  # pixels per pixel of edge: noise 2 of contrast 175, blur 0.7 px
VIEWS = 40
LAYOUTS = ((0.06, 0.6), (0.12, 0.4), (0.12, 0.6), (0.12, 0.8), (0.2, 0.6))  # margins, holes

PAPER_SCENES = 100
SIDE_ERROR = 0.05  # mm; the dots of a printer with 600 to the inch are 0.04 mm apart
STRETCH = 0.001  # of one direction: a slightly worn roller
NOISE, SPACING = 0.05, 4.0  # pixels, of an edge sample


def measure() -> list[Row]:
    """Return the rows of the printed corners."""
    (frames,), (boards,) = (ts.printed_target(kind).pages for kind in ("corner", "boards"))
    return [
        _predicted(frames),
        *_photographed("corner of frames", frames, PICTURES),
        *_photographed("corner of chessboards", boards, BOARD_PICTURES),
        *_photographed("corner of chessboards, 640 x 480", boards, BOARD_PICTURES, (640, 480)),
        *_on_paper(),
    ]


def predicted_std(page: TargetPage) -> dict[str, float]:
    """Return the root mean square of the predicted stds over views of a corner."""
    camera = camera_of(CAMERA)
    squares: dict[str, float] = {}
    for view in range(VIEWS):
        scene = simulate.corner_scene(np.random.default_rng(SEED + view), page=page, camera=CAMERA)
        for name, std in ts.predict(camera, scene.targets, SIGMA).std.items():
            squares[name] = squares.get(name, 0.0) + std**2 / VIEWS
    return {name: float(np.sqrt(square)) for name, square in squares.items()}


def _print_layouts(page: TargetPage) -> None:
    """Print the predictions for other holes and margins."""
    for margin, inner in LAYOUTS:
        side = page.face / (1.0 + 2.0 * margin)
        frames = tuple(replace(frame, side=side, inner=inner) for frame in page.frames)
        std = predicted_std(replace(page, frames=frames))
        shown = ", ".join(f"{name} {std[name]:.2g}" for name in ("fx", "cx", "k1"))
        print(f"  margin {margin:g}, hole {inner:g} of the side: std of {shown}")


def _predicted(page: TargetPage) -> Row:
    _print_layouts(page)
    std = predicted_std(page)
    print("  as printed: std of", ", ".join(f"{name} {value:.2g}" for name, value in std.items()))
    return Row(
        "corner of frames: predicted std of fx, cx",
        f"{std['fx']:.3f}, {std['cx']:.3f} px",
        "fx <= 0.11 px, as of three frames",
        std["fx"] <= 0.11,
    )


def _photographed(
    name: str, page: TargetPage, pictures: int, image_size: tuple[int, int] = (1280, 960)
) -> list[Row]:
    """Calibrate rendered photographs without options."""
    right, silent, errors, ratios = 0, 0, [], []
    for seed in range(SEED + 1000, SEED + 1000 + pictures):
        rng = np.random.default_rng(seed)
        scene = simulate.corner_scene(rng, page=page, image_size=image_size)
        picture = printed_photograph(scene, rng)
        try:
            result = ts.calibrate(picture)
        except ts.TrisquareError as error:
            print(f"  seed {seed}: {type(error).__name__}: {error}")
            continue
        ratio = np.array(
            [
                (getattr(result.camera, name) - getattr(scene.camera, name)) / result.std[name]
                for name in NAMES
            ]
        )
        good = len(result.planes) == 3 and bool(np.abs(ratio).max() < 4.0)
        right += good
        silent += not good and not result.warnings
        if not good:
            print(f"  seed {seed}: {np.round(ratio, 1)} {result.warnings}")
        errors.append(abs(result.camera.fx / scene.camera.fx - 1.0))
        ratios.append(ratio)
    covered = float(np.mean(np.abs(ratios) < 1.96))
    name = f"{name}, {pictures} pictures"
    return [
        Row(
            f"{name}: right; silently wrong",
            f"{right}; {silent}",
            f"{pictures}; 0",
            right == pictures and silent == 0,
        ),
        Row(
            f"{name}: error of fx, median, largest",
            f"{100 * np.median(errors):.4f} %, {100 * max(errors):.3f} %",
            "",
            None,
        ),
        Row(f"{name}: coverage of the 95 % intervals", f"{100 * covered:.1f} %", "", None),
    ]


def _on_paper() -> list[Row]:
    """Calibrate corners with printing errors, from edge points."""
    rng = np.random.default_rng(SEED + 5000)
    errors, covered = [], []
    scenes = f"corner of frames, {PAPER_SCENES} scenes"
    for _ in range(PAPER_SCENES):
        scene = simulate.corner_scene(rng)
        error, ratio = _fx_error(scene, rng, lambda target: _sides_off(target, rng))
        errors.append(error)
        covered.append(abs(ratio) < 1.96)
    stretched = [
        _fx_error(simulate.corner_scene(rng), rng, _stretched)[0] for _ in range(PAPER_SCENES)
    ]
    return [
        Row(
            f"{scenes}, sides off by {SIDE_ERROR} mm: rms error of fx; coverage of its 95 % "
            "intervals",
            f"{100 * np.sqrt(np.mean(np.square(errors))):.2f} %; {100 * np.mean(covered):.0f} %",
            "",
            None,
        ),
        Row(
            f"{scenes}, stretched by {100 * STRETCH:g} % in one direction: rms error of fx",
            f"{100 * np.sqrt(np.mean(np.square(stretched))):.2f} %",
            "",
            None,
        ),
    ]


def _fx_error(
    scene: Scene, rng: np.random.Generator, spoilt: Callable[[Target], Target]
) -> tuple[float, float]:
    """Return the relative error of fx, and its error in stated standard deviations."""
    printed = Scene(scene.camera, tuple(spoilt(target) for target in scene.targets))
    edges = edges_of(printed, rng, NOISE, SPACING)
    result = ts.calibrate_edges(edges, image_size=scene.camera.image_size)
    error = result.camera.fx - scene.camera.fx
    return error / scene.camera.fx, error / result.std["fx"]


def _sides_off(target: Target, rng: np.random.Generator) -> Target:
    left, right, top, bottom = [-0.5, 0.5, -0.5, 0.5] + SIDE_ERROR / SIDE * rng.standard_normal(4)
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return replace(target, printed=corners)


def _stretched(target: Target) -> Target:
    return replace(target, printed=np.array(target.outlines()[0]) * [1.0, 1.0 + STRETCH])
