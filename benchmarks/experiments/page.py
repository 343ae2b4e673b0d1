"""The page of the experiments: every number of it is one of results.json."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from experiments.estimators import BLUR, CONTRAST, LABELS
from experiments.plots import ANSWERED, is_shown
from experiments.printed_corner import TARGET
from experiments.results import PARAMETERS, Results
from experiments.sweeps import SPACING, SWEEPS, Setting, Sweep

PIXELS = PARAMETERS[:4]

INTRODUCTION = """\
<!-- Written by `make experiments`, of the numbers in experiments/results.json. -->
# The paper's experiments

Zhou, Cui, Gao & Wang (*Optics and Lasers in Engineering* 51 (2013) 1332-1343) tried their method on
simulated scenes: how the errors of the camera change with the noise, the number of squares, their
sides and so on, and how well lengths are measured with it. Here such experiments are run with the
estimators of today, all on the same scenes:

| | what it is given | |
| --- | --- | --- |
| linear steps | edge points | the paper's three steps, `method="linear"` |
| maximum likelihood, edge points | the same | `ts.calibrate_edges` |
| maximum likelihood, pixels | a rendered photograph | `ts.calibrate` |
| Zhang, corners of the same squares | the same photograph | `cv2.cornerSubPix`, `cv2.calibrateCamera` |
| Zhang, 13 photographs of a board | 13 rendered photographs, 9 x 6 corners each | the same |

**The scenes.** 1280 x 960 pixels, f 1100 px, k1 -0.15, k2 0.03; the principal point is drawn about
the centre with a standard deviation of 1.2 % of the width. Unless the plot says otherwise, three
squares have sides of 0.30-0.42 of the height and are tilted by 25-50 degrees, and each has an edge
point every {spacing:g} px with noise of {noise:g} px. A picture has the noise that lets its pixels
know an edge as well: {grey:.1f} grey levels of contrast {contrast:g}, blur {blur:g} px. Every level has
{edges} scenes for edge points, of which {pictures} are rendered; the boards have {boards} sessions.
All estimate fx, fy, cx, cy, k1 and k2; but three squares have 24 coordinates of corners for 24
unknowns, which OpenCV refuses, so that Zhang from the corners of three takes k2 as 0. The start of
`cv2.cornerSubPix` is 0.3 px from the truth, as a detector's corner is; nobody else is told anything.

**The plots** show rms errors; k1's is in per cent of k1. A band is where the rms would be, in 95 %
of cases, over as many scenes drawn anew (bootstrap). A point is left out where less than {answered:.0f} % of
the scenes have an answer: trisquare refuses a camera that the edges do not determine. The tables
have the rms over fx, fy, cx and cy, in pixels.

`make experiments` repeats it all, in about ten minutes; the seeds are in the code, and were fixed
before the first run. Measured with trisquare {trisquare} and OpenCV {opencv}.
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
    return (
        f"## {TITLES[sweep.name]}\n\n{condition}"
        f"![Error of each parameter over {sweep.axis}](experiments/{sweep.name}.svg)\n\n"
        f"{_seen(sweep, levels)}\n\n{_table(sweep, levels)}\n"
    )


def _seen(sweep: Sweep, levels: list[Results]) -> str:
    """Say what a plot shows, from its own numbers."""
    if sweep.name == "noise":
        return _at_noise(levels)
    first, last = (
        next((level for level in order if is_shown(level["edges"])), order[0])
        for order in (levels, levels[::-1])
    )
    best = min(levels, key=lambda level: pixel_rms(level["edges"]))
    ratios = [
        pixel_rms(level["linear"]) / pixel_rms(level["edges"])
        for level in levels
        if is_shown(level["linear"]) and is_shown(level["edges"])
    ]
    said = (
        f"From {sweep.axis} {first['at']:g} to {last['at']:g}, maximum likelihood from edge points goes "
        f"from {_px(first['edges'])} to {_px(last['edges'])} (least, at {best['at']:g}: "
        f"{_px(best['edges'])})"
    )
    if ratios:
        said += f"; the linear steps have {min(ratios):.1f}-{max(ratios):.1f} times its error"
    corners = [
        pixel_rms(level["corners"]) / pixel_rms(level["pixels"])
        for level in levels
        if is_shown(level["corners"]) and is_shown(level["pixels"])
    ]
    if corners:
        said += (
            f", and Zhang from the squares' corners {min(corners):.0f}-{max(corners):.0f} times that "
            "of the pixels"
        )
    return f"{said}.{_against_boards(levels)}"


def _at_noise(levels: list[Results]) -> str:
    level = max((level for level in levels if "pixels" in level), key=lambda level: level["at"])
    parts = [f"{_px(level[name])} ({LABELS[name]})" for name in LABELS if is_shown(level.get(name))]
    low, high = levels[0]["edges"], levels[-1]["edges"]
    growth = pixel_rms(high) / pixel_rms(low)
    return (
        f"Noise of {level['at']:g} px gives errors of {', '.join(parts)}; for "
        f"{levels[-1]['at'] / levels[0]['at']:.0f} times the noise, maximum likelihood from edge points "
        f"has {growth:.0f} times the error.{_against_boards(levels)}"
    )


def _against_boards(levels: list[Results]) -> str:
    """Say how one photograph of three squares stands to 13 of a board."""
    ratios = [
        pixel_rms(level["pixels"]) / pixel_rms(level["boards"])
        for level in levels
        if is_shown(level.get("pixels")) and is_shown(level.get("boards"))
    ]
    if not ratios:
        return ""
    return (
        f" One photograph of three squares has {min(ratios):.1f}-{max(ratios):.1f} times the error of "
        "thirteen of a board."
    )


def pixel_rms(point: Results | None) -> float:
    """Return the rms over fx, fy, cx and cy, pixels; infinite where nothing answered."""
    if not point or not point["answered"]:
        return np.inf
    return float(np.sqrt(np.mean([point[name]["rms"] ** 2 for name in PIXELS])))


def _px(point: Results) -> str:
    return f"{_digits(pixel_rms(point))} px"


def _digits(value: float) -> str:
    """Two digits, without an exponent."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:.0f}" if rounded >= 100 else f"{rounded:g}"


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


def _markdown(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    lines = [head := list(head), ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _lengths(found: Results) -> str:
    simulated, real = found["simulated"], found["real"]
    own, boards, truth = (simulated[name] for name in ("pixels", "boards", "truth"))
    said = (
        f"On simulated planes the photograph's own camera (pixels) measures lengths to {_percent(own)}, "
        f"the paper's linear steps to {_percent(simulated['linear'])}, and the camera of 13 boards to "
        f"{_percent(boards)}; the true camera, where only the pose errs, to {_percent(truth)}."
    )
    if real:
        ratio = real["pixels"]["rms"] / real["boards"]["rms"]
        said += (
            f" On real chessboards three photographs' own camera has {ratio:.1f} times the error of "
            f"Zhang's ({_percent(real['pixels'])}, {_percent(real['boards'])}), which was made from all "
            "thirteen photographs, the measured ones among them."
        )
    else:
        said += " The real chessboards are left out: their photographs were not there."
    return (
        "## Lengths measured on planes\n\n"
        "Every camera measures the same lengths on the same planes, which it poses from the same edges. "
        "Cameras, noise and blur of the simulated photographs are drawn as [how exact it is](how-exact.md) "
        "says; on the real chessboards the pose rests on four of nine columns, and the lengths are on "
        "the rest. The edges are those of the photographs, for the linear steps too.\n\n"
        f"![Error of lengths by camera](experiments/lengths.svg)\n\n{said}\n"
    )


def _percent(point: Results) -> str:
    return f"{_digits(0.01 * point['rms'])} %"


def _corner(found: Results, sheets: dict[str, float]) -> str:
    ratio, better = found["ratio"], found["better"]
    window = better.rpartition("_")[2]
    nearer = sum(
        corner < boards
        for corner, boards in zip(
            found["by_scene"]["corner"], found["by_scene"][better], strict=True
        )
    )
    other = next(name for name in found["by_scene"] if name not in ("corner", better))
    met = "which it is" if ratio["rms"] <= TARGET else "which it is not"
    rows = [[name, f"{promise:.2f}"] for name, promise in sheets.items()]
    return (
        "## The printed corner beside thirteen boards\n\n"
        "One rendered photograph of the [printed corner](target.md), and thirteen of a chessboard of "
        "9 x 6 corners, by each of "
        f"{found['scenes']} cameras, with the same noise and blur. Every point is a camera: the rms error of "
        "fx, fy, cx, cy.\n\n"
        "![Error from the corner over that from the boards](experiments/corner.svg)\n\n"
        f"The corner's one photograph has {ratio['rms']:.2f} times the error of the thirteen "
        f"({ratio['low']:.2f}-{ratio['high']:.2f} in 95 % of cases; {_digits(found['corner']['rms'])} px and "
        f"{_digits(found[better]['rms'])} px), and is nearer the truth for {nearer} of "
        f"{found['answered']} cameras. The boards' corners are those of the better half window of "
        f"`cv2.cornerSubPix`, {window} px; with {other.rpartition('_')[2]} px they give "
        f"{_digits(found[other]['rms'])} px. The aim was {TARGET:g} times, {met}.\n\n"
        "What other sheets could give: the least error that their edges allow (the Cramér-Rao bound over "
        "the same views, equal noise), in units of today's frames. Bands and cells of half a frame's "
        "margin are 5 to 10 px wide in a photograph of 1280 x 960, and blurred into each other in a smaller "
        "one, so the sheet stays as it is.\n\n"
        f"{_markdown(['on each face', 'least error'], rows)}\n"
    )


def _gallery(found: list[Results]) -> str:
    head = "## Real photographs\n\n"
    if not found:
        return f"{head}Left out: the photographs were not there.\n"
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
    return (
        f"{head}The lines that trisquare measured, each plane in a colour, without a pixel of the "
        "photographs, which are not part of this repository.\n\n"
        "![The measured lines of four photographs](experiments/gallery.svg)\n\n"
        "All planes are found without an option but the squares, whose edge points are given and whose lens "
        "has one coefficient; fx is within two stated standard deviations of what others found for "
        f"{_agreeing(found)} of {len(found)}.\n\n"
        f"{_markdown(['photograph', 'planes', 'fx', 'from elsewhere', 'rms of edges'], rows)}\n"
    )


def _agreeing(found: list[Results]) -> int:
    return sum(abs(shown["fx"] - shown["reference"]) <= 2.0 * shown["std"] for shown in found)
