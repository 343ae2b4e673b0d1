"""Places of the markers of a printed sheet: ChArUco boards, grids of tags, and layouts from files.

Sheet coordinates: x right and y down on the sheet as it is read, the origin at its middle; the
unit is a chess square or a marker's side, in layouts from files that of the first marker.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray, real_array
from trisquare._support.json_members import parse_json
from trisquare._support.paths import naming, read_text
from trisquare.detection.tags.families import (
    APRILTAG,
    ARUCO,
    LARGEST,
    SIZES,
    WIDE_BORDERED,
    dictionary_name,
)

GRAMMAR = (
    "charuco:COLSxROWS:RATIO (squares across and down, marker side over square side), "
    "aruco:COLSxROWS:GAP, apriltag:COLSxROWS:GAP or aprilgrid:COLSxROWS:GAP (markers across and "
    "down, gap over marker side; an aprilgrid's borders are two cells wide), each with "
    ":DICTIONARY if you like, or FILE.json"
)

MAX_ACROSS = 100
"""Maximum number of markers or squares in a row: no dictionary has enough for more both ways."""

MIN_SQUARES = 3
"""Minimum number of chess squares each way."""

RATIOS = (0.1, 0.99)
"""Range of marker over square: below it nothing could be read, above it no white would be left."""

GAPS = (0.01, 10.0)
"""Range of gap over marker; for an AprilGrid ..."""

GRID_GAPS = (0.1, 1.0)
"""... that in which neighbours are searched for."""

MAX_FILE_BYTES = 10_000_000

KIND_DICTIONARIES = {
    "charuco": LARGEST,
    "aruco": ARUCO,
    "apriltag": APRILTAG,
    "aprilgrid": (WIDE_BORDERED,),
}
"""Dictionaries of a layout's markers if it names none."""

UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """One way in which a sheet's markers may be arranged.

    Attributes
    ----------
    corners : ndarray, shape (M, 4, 2)
        Corners of every marker, clockwise from the top left of its code, sheet coordinates.
    dark_corner : bool or None
        For a chessboard, whether its top left square is dark.
    """

    corners: FloatArray
    dark_corner: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PrintedSheet:
    """A printed sheet with markers.

    Attributes
    ----------
    kind : str
        ``"charuco"`` or ``"sheet"``.
    arrangements : tuple of Arrangement
        Those that have the same name; the picture shows which it is.
    squares : tuple of int or None
        Chess squares across and down.
    rim : float
        For a chessboard, the white between a square's edges and its marker, over the square's side.
    gap : float
        White round a marker before the next thing, over the marker's side.
    is_touching : bool
        Whether the markers' borders are two cells wide, and dark squares touch their corners.
    is_stated : bool
        Whether the layout was given, rather than seen in the picture.
    """

    kind: str
    arrangements: tuple[Arrangement, ...]
    squares: tuple[int, int] | None = None
    rim: float = 0.0
    gap: float = math.inf
    is_touching: bool = False
    is_stated: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The sheets that a picture may show.

    Attributes
    ----------
    text : str
        The layout as it was requested.
    dictionaries : tuple of str
        Dictionaries of which one is the markers'.
    sheets : tuple of PrintedSheet
        One sheet that is repeated with further numbers, or those of a file.
    numbers : tuple of dict or None
        For each sheet of a file, the place of each marker number; None if the one sheet is
        repeated: sheet f carries the numbers from f M to f M + M - 1.
    """

    text: str
    dictionaries: tuple[str, ...]
    sheets: tuple[PrintedSheet, ...]
    numbers: tuple[dict[int, int], ...] | None = None

    def place(self, number: int) -> tuple[int, int] | None:
        """Return the sheet of a marker and its place on that; None if it is on no sheet."""
        if self.numbers is None:
            return divmod(number, len(self.sheets[0].arrangements[0].corners))
        for sheet, places in enumerate(self.numbers):
            if number in places:
                return sheet, places[number]
        return None

    def sheet(self, index: int) -> PrintedSheet:
        """Return the sheet of that index."""
        return self.sheets[0] if self.numbers is None else self.sheets[index]


def parse_layout(text: str) -> Layout:
    """Read a layout: see `GRAMMAR`.

    Raises
    ------
    ValueError
        If it is invalid; the message gives the valid forms.
    """
    if text.lower().endswith(".json"):
        return _from_file(Path(text))
    if text.startswith("chessboard"):
        raise ValueError(f'a board without markers is not a layout: give targets="{text}"')
    match = re.fullmatch(
        r"(charuco|aruco|apriltag|aprilgrid):(\d{1,4})x(\d{1,4}):(\d{0,6}\.?\d{0,9})(?::(\w+))?",
        text,
    )
    if match is None or not any(character.isdigit() for character in match[4]):
        raise ValueError(f"unknown board {text!r}: give {GRAMMAR}")
    kind, cols, rows, size = match[1], int(match[2]), int(match[3]), float(match[4])
    min_count = MIN_SQUARES if kind == "charuco" else 1
    if not (min_count <= cols <= MAX_ACROSS and min_count <= rows <= MAX_ACROSS):
        raise ValueError(
            f"a board of {cols} x {rows} in {text!r}: give from {min_count} to {MAX_ACROSS} each "
            "way"
        )
    if kind == "charuco":
        quantity, (low, high) = "marker over square", RATIOS
    else:
        quantity, (low, high) = "gap", GRID_GAPS if kind == "aprilgrid" else GAPS
    if not low <= size <= high:
        raise ValueError(f"{quantity} {size:g} in {text!r}: give from {low:g} to {high:g}")
    if kind == "charuco":
        sheet = _charuco(cols, rows, size)
    else:
        sheet = _grid(cols, rows, size, is_touching=kind == "aprilgrid")
    count = len(sheet.arrangements[0].corners)
    names: tuple[str, ...] = tuple(name for name in LARGEST if name in KIND_DICTIONARIES[kind])
    if match[5] is not None:
        names = (dictionary_name(match[5]),)
    large_enough = tuple(name for name in names if SIZES[name] >= count)
    if not large_enough:
        raise ValueError(f"{text!r} needs {count} markers, more than {', '.join(names)} have")
    return Layout(text, large_enough, (sheet,))


def _charuco(cols: int, rows: int, ratio: float) -> PrintedSheet:
    """Return a ChArUco board, with markers in the white squares, row by row.

    With an even number of rows, the colour of the first square distinguishes OpenCV's pattern from
    that before 4.6.
    """
    middle = np.array([cols, rows]) / 2.0
    rim = 0.5 * (1.0 - ratio)
    arrangements = []
    for dark_corner in (True, False) if rows % 2 == 0 else (True,):
        white = [
            (x, y) for y in range(rows) for x in range(cols) if ((x + y) % 2 == 1) == dark_corner
        ]
        corners = 0.5 + ratio * (UNIT_SQUARE - 0.5) - middle + np.array(white)[:, None]
        arrangements.append(Arrangement(corners, dark_corner))
    return PrintedSheet("charuco", tuple(arrangements), (cols, rows), rim, rim / ratio)


def _grid(cols: int, rows: int, gap: float, *, is_touching: bool) -> PrintedSheet:
    """Return markers row by row, from the top as in OpenCV, or from the bottom as in Kalibr."""
    x, y = np.meshgrid(np.arange(cols), np.arange(rows))
    cells = np.stack([x.ravel(), y.ravel()], axis=1) * (1.0 + gap)
    corners = UNIT_SQUARE + cells[:, None] - 0.5 * (cells[-1] + 1.0)
    from_bottom = corners.reshape(rows, cols, 4, 2)[::-1].reshape(-1, 4, 2)
    arrangements = (
        (Arrangement(from_bottom),)
        if is_touching
        else (Arrangement(corners), Arrangement(from_bottom))
    )
    return PrintedSheet("sheet", arrangements, gap=gap, is_touching=is_touching)


def _from_file(path: Path) -> Layout:
    """Read ``{"dictionary": ..., "sheets": [{"name": ..., "markers": {"7": [[x, y] x 4]}}]}``.

    One sheet's ``markers`` may stand alone, without ``sheets``; dictionary and names are optional.
    """
    if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path}: too large for a layout")
    text = read_text(path)
    with naming(path):
        content = parse_json(text)
    if not isinstance(content, dict):
        raise ValueError(f'{path}: must be an object with "sheets" or "markers"')
    given = content.get("sheets", [content])
    if not isinstance(given, list) or not given:
        raise ValueError(f"{path}: sheets must be a list of at least one")
    sheets: list[PrintedSheet] = []
    numbers: list[dict[int, int]] = []
    seen_numbers: set[int] = set()
    for index, member in enumerate(given):
        sheet, places = _file_sheet(path, index, member)
        if repeated := sorted(seen_numbers.intersection(places)):
            raise ValueError(f"{path}: marker {repeated[0]} is on two sheets")
        seen_numbers.update(places)
        sheets.append(sheet)
        numbers.append(places)
    name = content.get("dictionary")
    if name is not None and not isinstance(name, str):
        raise ValueError(f"{path}: dictionary must be a string")
    try:
        names = LARGEST if name is None else (dictionary_name(name),)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Layout(str(path), names, tuple(sheets), tuple(numbers))


def _file_sheet(path: Path, index: int, member: Any) -> tuple[PrintedSheet, dict[int, int]]:
    markers = member.get("markers") if isinstance(member, dict) else None
    if not isinstance(markers, dict) or not markers:
        raise ValueError(f"{path}: sheet {index} needs markers, an object of corners by number")
    places: dict[int, int] = {}
    corners = []
    for place, (key, value) in enumerate(markers.items()):
        if not re.fullmatch(r"\d{1,6}", key) or int(key) in places:
            raise ValueError(
                f"{path}: {key!r:.60} must be a marker number, and different from the others"
            )
        places[int(key)] = place
        try:
            corners.append(real_array(value, f"marker {key}", (4, 2)))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from error
        if not _is_clockwise_square(corners[-1]):
            raise ValueError(
                f"{path}: marker {key} must be a square, its corners clockwise (x right, y down)"
            )
    if not isinstance(member.get("name", ""), str):
        raise ValueError(f"{path}: the name of sheet {index} must be a string")
    # Relative to the middle, in sides: this keeps digits and good conditioning.
    all_corners = np.array(corners)
    middle = 0.5 * (all_corners.min(axis=(0, 1)) + all_corners.max(axis=(0, 1)))
    side = float(np.linalg.norm(all_corners[0, 1] - all_corners[0, 0]))
    return PrintedSheet("sheet", (Arrangement((all_corners - middle) / side),)), places


def _is_clockwise_square(corners: FloatArray) -> bool:
    along = np.roll(corners, -1, axis=0) - corners
    next_along = np.roll(along, -1, axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        side = np.linalg.norm(along[0])
        turned = np.stack([-along[:, 1], along[:, 0]], axis=1)
        return bool(0.0 < side < np.inf and np.abs(next_along - turned).max() < 1e-3 * side)
