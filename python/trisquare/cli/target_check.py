"""`trisquare target --check`: check of a printed sheet by its photograph."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import typer

from trisquare._support.lengths import length_in
from trisquare.analysis.sheet_check import Finding, SheetCheck, check_sheet
from trisquare.calibration.calibrate import calibrate
from trisquare.cli.console import answer, progress_bar
from trisquare.cli.framework import NOT_ALL_PASSED_EXIT, reading
from trisquare.cli.input_files import photographs_named
from trisquare.cli.tables import warning_lines
from trisquare.errors import NotEnoughPlanesError
from trisquare.printing.target import TargetKind, printed_target
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import warning_members

CHECK_FORMAT = "trisquare-target-check/1"


def check_photograph(
    photo: Path,
    kind: TargetKind,
    page: str,
    side: float | None,
    ruler: str | None,
    *,
    json: bool,
    quiet: bool,
) -> None:
    """Calibrate a photograph of the sheet, and print the findings about the sheet.

    Raises
    ------
    typer.Exit
        If something is not ok.
    """
    printed_target(kind, page=page, side=side)  # raises errors before the photograph is read
    if (count := len(photographs_named([photo]))) != 1:
        raise ValueError(f"{photo}: --check takes one photograph of the sheet, not {count}")
    length = length_in("m", ruler, "--ruler")
    with progress_bar("measuring", quiet, then="fitting") as progress, reading():
        try:
            calibration = calibrate(photo, progress=progress)
        except NotEnoughPlanesError as error:
            error.args = (f"all three figures of the sheet must be in the photograph: {error}",)
            raise
    measured = None if length is None else 1000.0 * length
    check = check_sheet(calibration, kind, page=page, side=side, ruler=measured)
    members = {
        "format": CHECK_FORMAT,
        "verdict": check.verdict,
        "kind": check.kind,
        "page": page,
        "side_mm": check.side,
        "true_side_mm": check.true_side,
        "faces": [
            {"plane": face, "corners": calibration.planes[face].corners.tolist()}
            for face in check.faces
        ],
        "findings": [asdict(finding) for finding in check.findings],
        "warnings": warning_members(calibration.warnings),
    }
    warnings = warning_lines(calibration, verbose=False)
    answer(json, quiet, members, _lines(check, calibration), warnings)
    if check.verdict == "not ok":
        raise typer.Exit(NOT_ALL_PASSED_EXIT)


def _lines(check: SheetCheck, calibration: Calibration) -> Iterator[str]:
    places = (
        "{} around ({:.0f}, {:.0f})".format(face, *calibration.planes[face].corners.mean(axis=0))
        for face in check.faces
    )
    yield f"{check.kind}, side {check.side:g} mm; face {', '.join(places)}"
    width = max(len(finding.check) for finding in check.findings)
    for finding in check.findings:
        yield f"  {finding.check:<{width}}  {finding.verdict:<11}  {_sentence(finding)}"
    partly = check.verdict == "cannot tell" and any(
        finding.verdict == "ok" for finding in check.findings
    )
    is_doubted = any(warning.severity == "high" for warning in calibration.warnings)
    summary = "ok, but not all could be checked" if partly and not is_doubted else check.verdict
    yield f"the sheet: {summary}"


def _sentence(finding: Finding) -> str:
    return f"{finding.text}: {finding.advice}" if finding.advice else finding.text
