"""Check, by its photograph, whether a sheet is printed to scale, folded square and flat enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from trisquare._support.convex_quads import quad_areas
from trisquare._support.number_text import listed, plus_minus
from trisquare.analysis.departures import Departures, Estimate, departures
from trisquare.errors import NotEnoughPlanesError
from trisquare.printing.layout import RULER, PrintedBoard, PrintedFrame
from trisquare.printing.target import TargetKind, printed_target
from trisquare.results.calibration import Calibration

Verdict: TypeAlias = Literal["ok", "not ok", "cannot tell"]

VERDICT_STDS = 3.0
"""Standard deviations that a number must be away from its limit for a verdict."""

MAX_FOLD_ERROR = 2.0
"""Maximum error of a fold, degrees. A calibration assumes no right angles: folded 20 degrees off,
its focal lengths are as good. But three square faces that are closed at the cut and the tab fit
together only at right angles: 2 degrees are a gap of 3.7 mm at the cut's end on A4, and nothing
keeps the faces flat. Besides, ``orthogonal=`` assumes right angles."""

MAX_BOW = 0.001
"""Maximum bow, as a fraction of a frame's side: on one face of three it shifts fx by 0.3 % and fy
by 0.4 % (rms, 30 views)."""

MAX_BOW_OF_BOARD = 0.01
"""Maximum bow, as a fraction of a board's side. A board's many lines distinguish its bow from the
lens, and the calibration corrects it: on one face of three it shifts fx and fy by 0.04 % at most
(rms, 5 views). A larger bow leaves errors of second order."""

MAX_JUDGED_BOW = 0.01
"""Bow, as a fraction of the side, above which angles and stretch are not judged: they have errors
of second order in the bow (at 2 %, up to 1.3 degrees and 0.4 %)."""

MAX_STRETCH = 0.003
"""Maximum stretch of one axis of the paper relative to the other: it shifts fx or fy by up to 0.3 %
(30 views)."""

MAX_SCALE_ERROR = 0.01
"""Maximum relative error of the scale. Printers that print at 100 % have smaller errors, those that
fit the page to their margins are 3 % and more off. The camera does not depend on the scale; lengths
computed from the nominal side have the same relative error."""

RULER_STD = 0.1
"""Standard deviation of a reading of the printed ruler, millimetres."""

MAX_HIDDEN = 2
"""Maximum number of rows or columns of cells, outside the picture or hidden, that the board found
most completely may lack. A board with fewer cells is another one."""

FRAME_KINDS = ("frame", "square")
"""Kinds of planes that printed frames are found as: a square if only the outline, or only the hole,
is measured."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check.

    Attributes
    ----------
    check : {"folded", "flat", "stretched", "size"}
    faces : tuple of int
        The planes of the calibration that were checked.
    verdict : {"ok", "not ok", "cannot tell"}
    value, std : float, optional
        Value and standard deviation in `unit`; None if they cannot be determined.
    limit : float
        Maximum deviation.
    unit : str
        ``"degrees"``, ``"mm"`` or ``"%"``.
    text : str
        Description of the finding.
    advice : str
        What to do about it; empty if nothing needs to be done.
    """

    check: str
    faces: tuple[int, ...]
    verdict: Verdict
    value: float | None
    std: float | None
    limit: float
    unit: str
    text: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class SheetCheck:
    """Result of checking a printed sheet by a photograph and a reading of its ruler.

    Attributes
    ----------
    kind : {"corner", "boards", "flat"}
        Kind of sheet that was assumed.
    side : float
        Nominal side of its figures, millimetres.
    true_side : float, optional
        Side according to the ruler, millimetres.
    faces : tuple of int
        Indices of the planes that carry the sheet's figures.
    findings : tuple of Finding
    """

    kind: TargetKind
    side: float
    true_side: float | None
    faces: tuple[int, ...]
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all findings."""
        verdicts = [finding.verdict for finding in self.findings]
        return next((verdict for verdict in ("not ok", "cannot tell") if verdict in verdicts), "ok")


def check_sheet(
    calibration: Calibration,
    kind: TargetKind = "both",
    *,
    page: str = "A4",
    side: str | float | None = None,
    ruler: float | None = None,
) -> SheetCheck:
    """Judge a printed sheet by the calibration from its photograph.

    Parameters
    ----------
    calibration : Calibration
        From one photograph, with edges and without fixed parameters.
    kind, page, side
        As in `printed_target`; "both" is the folded corner, of boards if three boards were found.
    ruler : float, optional
        Measured length of the sheet's ruler of 100 mm, millimetres.

    Raises
    ------
    NotEnoughPlanesError
        If the photograph does not show three of the sheet's figures; chessboards with other
        numbers of cells do not count.
    TypeError, ValueError
        As `printed_target`.
    """
    boards = _largest_planes(calibration, ("chessboard",))
    if kind == "both":
        kind = "boards" if len(boards) >= 3 else "corner"
    faces = boards if kind == "boards" else _largest_planes(calibration, FRAME_KINDS)
    if len(faces) < 3:
        figure_name = "chessboards" if kind == "boards" else "frames"
        raise NotEnoughPlanesError(
            f"the photograph shows {len(faces)} of the sheet's 3 {figure_name}: show all of them, "
            "and state which kind of sheet it is"
        )
    figure = printed_target(kind, page=page, side=side).pages[0].frames[0]
    units, limit = 1.0, MAX_BOW
    if isinstance(figure, PrintedBoard):
        units, limit = figure.cells, MAX_BOW_OF_BOARD
        _check_cell_counts([_cell_counts(calibration, face) for face in faces], figure.cells)
    estimates = departures(calibration, faces, units, is_corner=kind != "flat")
    findings = [
        *(_fold_findings(estimates, faces) if kind != "flat" else ()),
        *_bow_findings(estimates, faces, _measured_sides(calibration, faces, figure), limit),
        _stretch_finding(estimates, faces),
        _size_finding(figure.side, ruler),
    ]
    true_side = None if ruler is None else figure.side * ruler / RULER
    return SheetCheck(kind, figure.side, true_side, faces, tuple(findings))


def _largest_planes(calibration: Calibration, kinds: Sequence[str]) -> tuple[int, ...]:
    """Return the three largest planes of these kinds, by their areas in the picture, in order."""
    indices = [index for index, plane in enumerate(calibration.planes) if plane.kind in kinds]
    areas = {index: float(quad_areas(calibration.planes[index].corners)) for index in indices}
    return tuple(sorted(sorted(indices, key=areas.__getitem__, reverse=True)[:3]))


def _measured_sides(
    calibration: Calibration, faces: Sequence[int], figure: PrintedFrame | PrintedBoard
) -> list[float]:
    """Return the side (mm) of each face's unit; if only a hole was measured, that of the hole."""
    if isinstance(figure, PrintedBoard):
        return [figure.side for _ in faces]
    figures = zip(calibration.edges, calibration.residuals, strict=True)
    outlined = {residuals.plane for edges, residuals in figures if edges.polarity != -1}
    return [figure.side * (1.0 if face in outlined else figure.inner) for face in faces]


def _cell_counts(calibration: Calibration, face: int) -> tuple[int, int]:
    """Return the numbers of cells, across and down, of a plane's board as found."""
    figures = zip(calibration.edges, calibration.residuals, strict=True)
    lines = np.concatenate([edges.lines for edges, residuals in figures if residuals.plane == face])
    # The cells between the outermost lines, and one more beyond each of these two.
    across, down = (
        round(float(np.ptp(lines[is_along, 2] * lines[is_along, axis]))) + 2
        for axis, is_along in enumerate(np.abs(lines[:, :2]).T > 0.5)
    )
    return across, down


def _check_cell_counts(found: Sequence[tuple[int, int]], expected: int) -> None:
    """Refuse boards that are not the sheet's; some of the sheet's boards may be found in part."""
    largest = max(max(cells) for cells in found)
    if not expected - MAX_HIDDEN <= largest <= expected:
        shown = listed([f"{across} x {down}" for across, down in found])
        raise NotEnoughPlanesError(
            f"the photograph shows chessboards of {shown} cells, but those of the sheet "
            f"have {expected} x {expected}"
        )


def _verdict(deviations: Sequence[Estimate], limit: float) -> Verdict:
    """Judge a deviation; if there are several estimates, any of them may be right."""
    if all(deviation.value + VERDICT_STDS * deviation.std <= limit for deviation in deviations):
        return "ok"
    if all(deviation.value - VERDICT_STDS * deviation.std > limit for deviation in deviations):
        return "not ok"
    return "cannot tell"


def _bent_faces(estimates: Departures, faces: Sequence[int]) -> list[int]:
    """Return the faces whose bend is too large to judge angles and stretch."""
    return [
        face for face, bow in zip(faces, estimates.bows, strict=True) if bow.value > MAX_JUDGED_BOW
    ]


def _fold_findings(estimates: Departures, faces: Sequence[int]) -> Iterator[Finding]:
    deviations = {
        pair: Estimate(abs(value - 90.0), std) for pair, (value, std) in estimates.angles.items()
    }
    bent = _bent_faces(estimates, faces)
    for pair, angle in estimates.angles.items():
        verdict: Verdict = "cannot tell" if bent else _verdict([deviations[pair]], MAX_FOLD_ERROR)
        text = f"faces {pair[0]} and {pair[1]} meet at {plus_minus(*angle)} degrees"
        advice = {
            "ok": "",
            "not ok": "fold along the dashed lines against a book's corner and glue the tab; a "
            "calibration with this sheet is right if the planes are not stated to be "
            "orthogonal",
            "cannot tell": _flatten_first(bent),
        }[verdict]
        if verdict == "not ok" and min(deviations.values()).value > MAX_FOLD_ERROR:
            advice = "is this the folded corner? For the three flat sheets give --kind flat"
        yield Finding("folded", pair, verdict, *angle, MAX_FOLD_ERROR, "degrees", text, advice)


def _bow_findings(
    estimates: Departures, faces: Sequence[int], sides: Sequence[float], limit: float
) -> Iterator[Finding]:
    for face, side, bow in zip(faces, sides, estimates.bows, strict=True):
        verdict = _verdict([bow], limit)
        arch = Estimate(side * bow.value, side * bow.std)
        text = (
            f"face {face} is bent by {plus_minus(*arch)} mm over a side of {side:.4g} mm (the "
            f"limit is {side * limit:.2g} mm)"
        )
        advice = {
            "ok": "",
            "not ok": "glue the paper to stiff cardboard, or into the corner of a box",
            "cannot tell": "photograph it larger and sharper",
        }[verdict]
        yield Finding("flat", (face,), verdict, *arch, side * limit, "mm", text, advice)


def _stretch_finding(estimates: Departures, faces: Sequence[int]) -> Finding:
    bent = _bent_faces(estimates, faces)
    verdict: Verdict = "cannot tell" if bent else _verdict(estimates.stretches, MAX_STRETCH)
    best = Estimate(*(100.0 * number for number in estimates.stretches[0]))
    text = f"the print is stretched along one axis of the paper by {plus_minus(*best)} %"
    advice = {
        "ok": "",
        "not ok": "print at 100 %, without fitting to the page, or on another printer",
        "cannot tell": _flatten_first(bent),
    }[verdict]
    limit = 100.0 * MAX_STRETCH
    return Finding("stretched", tuple(faces), verdict, *best, limit, "%", text, advice)


def _flatten_first(bent: Sequence[int]) -> str:
    if bent:
        named = listed([str(face) for face in bent])
        are = f"face {named} first: it is" if len(bent) == 1 else f"faces {named} first: they are"
        return f"flatten {are} bent too far to judge this"
    return "photograph it larger, sharper, and from nearer its front"


def _size_finding(side: float, ruler: float | None) -> Finding:
    limit = 100.0 * MAX_SCALE_ERROR
    if ruler is None:
        text = "a photograph does not show the size without a known length"
        advice = (
            f"measure the printed ruler of {RULER:g} mm and give its length, such as --ruler 99.5mm"
        )
        return Finding("size", (), "cannot tell", None, None, limit, "%", text, advice)
    scale = Estimate(ruler / RULER, RULER_STD / RULER)
    verdict = _verdict([Estimate(abs(scale.value - 1.0), scale.std)], MAX_SCALE_ERROR)
    length = Estimate(side * scale.value, side * scale.std)
    per_cent = Estimate(100.0 * scale.value, 100.0 * scale.std)
    text = (
        f"according to the ruler, the print has {plus_minus(*per_cent)} % of its nominal size, "
        f"and a side of {plus_minus(*length)} mm"
    )
    advice = (
        f"print at 100 %, or calibrate with --side {length.value:.4g}mm: the camera is the same"
    )
    if verdict == "ok":
        advice = ""
    return Finding("size", (), verdict, *per_cent, limit, "%", text, advice)
