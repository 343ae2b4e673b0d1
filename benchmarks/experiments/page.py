"""The page of the experiments, with every number taken from results.json."""

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

Zhou, Cui, Gao & Wang (*Optics and Lasers in Engineering* 51 (2013) 1332-1343) tried their method
on simulated scenes: how the errors of the camera change with the noise, the number of squares,
their sides and so on, and how well lengths are measured with it. Here such experiments are run
with the estimators of today, all on the same scenes:

| | what it is given | |
| --- | --- | --- |
| linear steps | edge points | the paper's three steps, `method="linear"` |
| maximum likelihood, edge points | the same | `ts.calibrate_edges` |
| maximum likelihood, pixels | a rendered photograph | `ts.calibrate` |
| Zhang, corners of the same squares | the same photograph | `cornerSubPix`, `calibrateCamera` |
| Zhang, 13 photographs of a board | 13 rendered photographs of 9 x 6 corners | the same |

**The scenes.** 1280 x 960 pixels, f 1100 px, k1 -0.15, k2 0.03; the principal point is drawn
about the centre with a standard deviation of 1.2 % of the width. Unless the plot says otherwise,
three squares have sides of 0.30-0.42 of the height and are tilted by 25-50 degrees, and their
edges have a point every {spacing:g} px with noise of {noise:g} px. A picture has the noise that
lets its pixels know an edge as well: {grey:.1f} grey levels of contrast {contrast:g}, blur
{blur:g} px. Every level has {edges} scenes for edge points, the first {pictures} of which are
rendered; {boards} cameras photograph the board. All estimate fx, fy, cx, cy, k1 and k2; but
three squares have 24 coordinates of corners for 24 unknowns, which OpenCV refuses, so that Zhang
from the corners of three takes k2 as 0. `cornerSubPix` starts 0.3 px from the truth, as from a
detector; nobody else is told anything.

**The plots** show rms errors; k1's is in per cent of k1. A band is the 95 % interval of the rms
over as many scenes drawn anew (bootstrap). A point is left out where less than {answered:.0f} %
of the scenes have an answer: trisquare refuses a camera that the edges do not determine. The
tables have the rms over fx, fy, cx and cy, in pixels, and how many scenes have an answer where
not all do.

`make experiments` repeats it all; the seeds were fixed before the first full run. Measured with
trisquare {trisquare} and OpenCV {opencv}.
"""

TITLES = {
    "noise": "Noise",
    "count": "Number of squares",
    "side": "Length of the sides",
    "tilt": "Tilt",
    "field": "Field of view",
}

CONDITIONS = {
    "noise": "Pictures end at 0.1 px: with more noise they would be clipped.",
    "count": "All squares have sides of 0.2 of the height, so that twelve fit.",
    "side": "",
    "tilt": "",
    "field": (
        "k1 and k2 change with the focal length, so that the picture is bent alike at every field "
        "of view."
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
        return "Too few scenes have an answer."
    first, last = shown[0], shown[-1]
    said = (
        f"{RANGES[sweep.name].format(first['at'], last['at'])}, the error of maximum likelihood "
        f"goes from {_px(first['edges'])} to {_px(last['edges'])} (edge points)"
    )
    if linear := _ratios(levels, "linear", "edges"):
        said += f"; the linear steps have {linear} times as much"
    if corners := _ratios(levels, "corners", "pixels"):
        said += f", and the squares' corners {corners} times as much as their pixels"
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
        f"{last['at'] / first['at']:.0f} times the noise, from end to end, gives maximum "
        f"likelihood from edge points {growth:.0f} times the error."
    )


def _against_boards(levels: list[Results]) -> str:
    """Compare one photograph of squares with 13 of a board."""
    ratios = _ratios(levels, "pixels", "boards")
    if not ratios:
        return ""
    return f" One photograph of three squares has {ratios} times the error of thirteen of a board."


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

Every camera measures the same lengths on the same planes, which it poses from the same edges, so
that they differ by nothing but the camera. The linear steps have the edges of the photograph
here. Cameras, noise and blur of the simulated photographs are drawn as [how exact it
is](how-exact.md) says. On the real chessboards the pose rests on four of nine columns, and the
lengths are on the rest.

![Error of lengths by camera](experiments/lengths.svg)

On simulated planes, one photograph's own camera measures lengths to {own} by maximum likelihood
from its pixels and to {linear} by the linear steps; the camera of thirteen boards to {boards};
and the true camera, where only the pose errs, to {truth}.
"""

REAL_LENGTHS = """\
On real chessboards the own camera of three photographs has {ratio:.1f} times the error of
Zhang's ({own}, {boards}), which was made from all thirteen photographs, the measured ones among
them.
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

One rendered photograph of a [printed corner](target.md), of frames or of chessboards, and
thirteen of a chessboard of 9 x 6 corners by Zhang, by each of {scenes} cameras, with the same
noise and blur. Every point is a camera: the rms error of fx, fy, cx and cy.

![Error from one photograph of a corner over that of thirteen of a board](experiments/corner.svg)

Over all cameras the photograph of the boards' corner has {boards[rms]:.2f} times the error of
the thirteen ({boards[low]:.2f}-{boards[high]:.2f} in 95 % of cases), and that of the frames'
corner {frames[rms]:.2f} times ({frames[low]:.2f}-{frames[high]:.2f}). The aim was {target:g}
times: the boards {boards_verdict} it, the frames {frames_verdict} it. The thirteen have the
better of two half windows of `cornerSubPix`.

{errors}

What a face of the sheet could carry, by the least error that its edges allow (the Cramér-Rao
bound, over the same views with equal noise), in units of the frame's:

{sheets}
"""


def _corner(found: Results, sheets: dict[str, float]) -> str:
    names = {
        "boards": "one photograph of the corner of three chessboards",
        "frames": "one photograph of the corner of three frames",
    }
    for window in WINDOWS:
        names[f"zhang_{window}"] = f"thirteen of a board, half window of {window} px"
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
            ["on each face", "least error"], [[name, f"{own:.2f}"] for name, own in sheets.items()]
        ),
        **found["ratio"],
        **verdicts,
    )


GALLERY = """\
## Real photographs

The lines that trisquare measured, each plane in a colour, without a pixel of the photographs,
which are not part of the repository.

![The measured lines of four photographs](experiments/gallery.svg)

The chessboards are found without an option; of the three squares only edge points may be passed
on, and their lens is given one coefficient. For {agreeing} of {count}, fx is within two stated
standard deviations of what is known from elsewhere.

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
    head = ["photograph", "planes", "fx", "from elsewhere", "rms of its edges"]
    return GALLERY.format(agreeing=agreeing, count=len(found), table=_markdown(head, rows))
