"""The page of the experiments; every number is from results.json."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from experiments.estimators import BLUR, CONTRAST, LABELS
from experiments.plots import ANSWERED, is_shown
from experiments.printed_corner import TARGET, WINDOWS
from experiments.results import PARAMETERS, Results
from experiments.sweeps import SPACING, SWEEPS, Setting, Sweep

PIXELS = PARAMETERS[:4]

INTRODUCTION = """\
<!-- Written by `make experiments`, of the numbers in experiments/results.json. -->
# The paper's experiments

Zhou, Cui, Gao & Wang (*Optics and Lasers in Engineering* 51 (2013) 1332-1343) tested their method
on simulated scenes: the errors of the camera by noise, number of squares, length of their sides and
other properties, and the errors of lengths measured with it. Similar experiments follow, with
several estimators on the same scenes:

| estimator | input | method |
| --- | --- | --- |
| linear steps | edge points | the paper's three steps, `method="linear"` |
| maximum likelihood, edge points | the same | `ts.calibrate_edges` |
| maximum likelihood, pixels | a rendered picture | `ts.calibrate` |
| Zhang, corners of the same squares | the same picture | `cornerSubPix`, `calibrateCamera` |
| Zhang, 13 photographs of a board | 13 rendered pictures of 9 x 6 corners | the same |

**Scenes.** 1280 x 960 pixels, f 1100 px, k1 -0.15, k2 0.03; the principal point is drawn about the
centre with a standard deviation of 1.2 % of the width. Unless the plot says otherwise, three
squares have sides of 0.30-0.42 of the height and are tilted by 25-50 degrees, and their edges have
a point every {spacing:g} px with noise of {noise:g} px. Pictures have noise at which an edge in the
picture is as exact as these points: {grey:.1f} grey levels at a contrast of {contrast:g} and a blur
of {blur:g} px. Every level has {edges} scenes for edge points, the first {pictures} of which
are rendered; the board is rendered for {boards} cameras. All estimators estimate fx, fy, cx, cy, k1
and k2, with one exception: three squares have 24 coordinates of corners for 24 unknowns, which
OpenCV refuses; k2 is then fixed at 0. `cornerSubPix` starts 0.3 px from the true corner, the error
of a detector; the other methods get no starting values.

**Plots.** The errors are rms errors, that of k1 in per cent of k1. A band is the 95 % bootstrap
interval of the rms. A point is left out if less than {answered:.0f} % of the scenes have a result:
trisquare refuses a camera that the edges do not determine. The tables have the rms over fx, fy, cx
and cy, in pixels, and the number of scenes with a result if not all have one.

`make experiments` repeats all experiments; the seeds were fixed before the first full run. Measured
with trisquare {trisquare} and OpenCV {opencv}.
"""

TITLES = {
    "noise": "Noise",
    "count": "Number of squares",
    "side": "Length of the sides",
    "tilt": "Tilt",
    "field": "Field of view",
}

CONDITIONS = {
    "noise": "Pictures are rendered up to 0.1 px: with more noise they would be clipped.",
    "count": "All squares have sides of 0.2 of the height, so that twelve fit.",
    "side": "",
    "tilt": "",
    "field": (
        "k1 and k2 change with the focal length, so that the distortion in pixels is the same at "
        "every field of view."
    ),
}

RANGES = {
    "count": "From {:g} to {:g} squares",
    "side": "From sides of {:g} to {:g} of the height",
    "tilt": "From {:g} to {:g} degrees of tilt",
    "field": "From {:g} to {:g} degrees",
}


def text(found: Results) -> str:
    """Return the page."""
    setting = Setting()
    parts = [
        INTRODUCTION.format(
            spacing=SPACING,
            noise=setting.noise,
            grey=setting.grey,
            contrast=CONTRAST,
            blur=BLUR,
            answered=100 * ANSWERED,
            **found["scenes"],
            **found["software"],
        )
    ]
    parts += [_sweep(sweep, found["sweeps"][sweep.name]) for sweep in SWEEPS]
    parts += [_lengths(found["lengths"]), _corner(found["corner"], found["sheets"])]
    parts.append(_gallery(found["gallery"]))
    return "\n".join(parts)


def _sweep(sweep: Sweep, levels: list[Results]) -> str:
    condition = f"{CONDITIONS[sweep.name]}\n\n" if CONDITIONS[sweep.name] else ""
    said = _at_noise(levels) if sweep.name == "noise" else _over_range(sweep, levels)
    return (
        f"## {TITLES[sweep.name]}\n\n{condition}"
        f"![Error of each parameter over {sweep.axis}](experiments/{sweep.name}.svg)\n\n"
        f"{said}{_against_boards(levels)}\n\n{_table(sweep, levels)}\n"
    )


def _over_range(sweep: Sweep, levels: list[Results]) -> str:
    """Describe the change of maximum likelihood over the levels, and its ratio to the others."""
    shown = [level for level in levels if is_shown(level["edges"])]
    if not shown:
        return "Too few scenes have a result."
    first, last = shown[0], shown[-1]
    said = (
        f"{RANGES[sweep.name].format(first['at'], last['at'])}, the error of maximum likelihood "
        f"goes from {_px(first['edges'])} to {_px(last['edges'])} (edge points)"
    )
    if linear := _ratios(levels, "linear", "edges"):
        said += f"; that of the linear steps is {linear} times as large"
    if corners := _ratios(levels, "corners", "pixels"):
        said += f"; that of Zhang from the corners is {corners} times that from the pixels"
    return f"{said}."


def _at_noise(levels: list[Results]) -> str:
    """Describe the errors at the largest noise of pictures."""
    level = max((level for level in levels if "pixels" in level), key=lambda level: level["at"])
    errors = ", ".join(
        f"{_px(level[name])} ({label})"
        for name, label in LABELS.items()
        if is_shown(level.get(name))
    )
    first, last = levels[0], levels[-1]
    growth = pixel_rms(last["edges"]) / pixel_rms(first["edges"])
    return (
        f"Noise of {level['at']:g} px gives errors of {errors}; "
        f"the error of maximum likelihood from edge points grows by a factor of {growth:.0f} for "
        f"{last['at'] / first['at']:.0f} times the noise."
    )


def _against_boards(levels: list[Results]) -> str:
    """Compare one photograph of squares with 13 of a board."""
    ratios = _ratios(levels, "pixels", "boards")
    if not ratios:
        return ""
    return (
        f" The error from one picture of three squares is {ratios} times that from thirteen of a "
        "board."
    )


def _ratios(levels: list[Results], name: str, other: str) -> str:
    """Return the range of one estimator's error over another's; empty where no level has both."""
    ratios = [
        pixel_rms(level[name]) / pixel_rms(level[other])
        for level in levels
        if is_shown(level.get(name)) and is_shown(level.get(other))
    ]
    if not ratios:
        return ""
    least, most = _digits(min(ratios)), _digits(max(ratios))
    return least if least == most else f"{least} to {most}"


def pixel_rms(point: Results) -> float:
    """Return the rms over fx, fy, cx and cy, in pixels."""
    return float(np.sqrt(np.mean([point[name]["rms"] ** 2 for name in PIXELS])))


def _px(point: Results) -> str:
    return f"{_digits(pixel_rms(point))} px"


def _digits(value: float) -> str:
    """Format a value with two digits, without an exponent."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:.0f}" if rounded >= 100.0 else f"{rounded:g}"


def _table(sweep: Sweep, levels: list[Results]) -> str:
    names = [name for name in LABELS if any(name in level for level in levels)]
    rows = [[LABELS[name], *(_cell(level.get(name)) for level in levels)] for name in names]
    return _markdown([sweep.axis, *(f"{level['at']:g}" for level in levels)], rows)


def _cell(point: Results | None) -> str:
    if point is None:
        return ""
    share = f"{point['answered']} of {point['scenes']}"
    if not point["answered"]:
        return share
    rms = _digits(pixel_rms(point))
    return rms if point["answered"] == point["scenes"] else f"{rms} ({share})"


def _markdown(head: list[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


LENGTHS = """\
## Lengths measured on planes

All cameras measure the same lengths on the same planes, with poses from the same edges, so that
only the camera differs. The linear steps use the edges of the picture. Cameras, noise and blur of
the simulated pictures are those of [how exact it is](how-exact.md#what-is-measured). On the real
chessboards the pose is fitted to four of nine columns, and the lengths are on the rest.

![Error of lengths by camera](experiments/lengths.svg)

On simulated planes, the rms error of the lengths is {own} with the camera from the same picture by
maximum likelihood from the pixels, {linear} with that of the linear steps, {boards} with that of
thirteen pictures of a board, and {truth} with the true camera, where only the pose has an error.
"""

REAL_LENGTHS = """\
On real chessboards, the error with the camera from three other photographs is {ratio:.1f} times
that with Zhang's camera ({own}, {boards}), which is from all thirteen photographs, including the
measured ones.
"""

NO_LENGTHS = "The real chessboards are left out: their photographs were not there.\n"


def _lengths(found: Results) -> str:
    errors = {name: _percent(point) for name, point in found["simulated"].items()}
    said = LENGTHS.format(own=errors["pixels"], **errors)
    if not (real := found["real"]):
        return said + NO_LENGTHS
    return said + REAL_LENGTHS.format(
        ratio=real["pixels"]["rms"] / real["boards"]["rms"],
        own=_percent(real["pixels"]),
        boards=_percent(real["boards"]),
    )


def _percent(point: Results) -> str:
    return f"{_digits(0.01 * point['rms'])} %"


CORNER = """\
## A printed corner beside thirteen boards

One rendered picture of a [printed corner](target.md), of frames or of chessboards, is compared with
thirteen of a chessboard of 9 x 6 corners, calibrated by Zhang's method. The noise and blur are the
same. Each point of the plot is one of {scenes} cameras, with its rms error over fx, fy, cx and cy.

![Error from one photograph of a corner over that of thirteen of a board](experiments/corner.svg)

Over all cameras, the error from the corner of chessboards is {boards[rms]:.2f} times that from the
thirteen pictures (95 % interval {boards[low]:.2f}-{boards[high]:.2f}), and the error from the
corner of frames {frames[rms]:.2f} times ({frames[low]:.2f}-{frames[high]:.2f}). The required ratio
was {target:g}: the chessboards {boards_verdict} it, the frames {frames_verdict} it. For the
thirteen pictures, the better of two half windows of `cornerSubPix` is used.

{errors}

Other figures could be printed on the faces of the sheet. The table has their Cramer-Rao bounds over
the same views with equal noise, relative to that of the frame:

{sheets}
"""


def _corner(found: Results, sheets: dict[str, float]) -> str:
    names = {
        "boards": "one picture of the corner of three chessboards",
        "frames": "one picture of the corner of three frames",
    }
    for window in WINDOWS:
        names[f"zhang_{window}"] = f"thirteen pictures of a board, half window of {window} px"
    errors = [[names[name], f"{_digits(found['rms'][name]['rms'])} px"] for name in names]
    verdicts = {
        f"{sheet}_verdict": "reach" if ratio["rms"] <= TARGET else "miss"
        for sheet, ratio in found["ratio"].items()
    }
    return CORNER.format(
        scenes=found["scenes"],
        target=TARGET,
        errors=_markdown(["", "rms error of fx, fy, cx, cy"], errors),
        sheets=_markdown(
            ["on each face", "Cramer-Rao bound, relative"],
            [[name, f"{own:.2f}"] for name, own in sheets.items()],
        ),
        **found["ratio"],
        **verdicts,
    )


GALLERY = """\
## Real photographs

The plot shows the lines that trisquare measured, each plane in a colour. The photographs
themselves are not part of the repository.

![The measured lines of four photographs](experiments/gallery.svg)

The chessboards are found without options. Of the photograph of three squares only the edge points
may be published; its lens model is `radial1`. For {agreeing} of {count} photographs, fx is within
two stated standard deviations of the value from another source.

{table}
"""

NO_GALLERY = "## Real photographs\n\nLeft out: the photographs were not there.\n"


def _gallery(found: list[Results]) -> str:
    if not found:
        return NO_GALLERY
    rows = [
        [
            shown["title"],
            str(shown["planes"]),
            f"{shown['fx']:.0f} +- {_digits(shown['std'])} px",
            f"{shown['reference']:.0f} px ({shown['known']})",
            f"{_digits(shown['rms'])} px",
        ]
        for shown in found
    ]
    agreeing = sum(abs(shown["fx"] - shown["reference"]) <= 2.0 * shown["std"] for shown in found)
    head = ["photograph", "planes", "fx", "fx from another source", "rms residual"]
    return GALLERY.format(agreeing=agreeing, count=len(found), table=_markdown(head, rows))
