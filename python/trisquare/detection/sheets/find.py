"""Detection of the sheets of a known layout in a picture, by their markers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.grey import MIN_PICTURE
from trisquare.detection.sampling import box_around, straight_sides
from trisquare.detection.sheets.aprilgrids import AprilGrid, find_aprilgrids
from trisquare.detection.sheets.layout import Arrangement, Layout, PrintedSheet
from trisquare.detection.sheets.smooth_surface import MIN_POINTS, SmoothSurface
from trisquare.detection.tags.decode import BORDER, WIDE_BORDER, decode_tags
from trisquare.detection.tags.families import WIDE_BORDERED, TagSearch
from trisquare.detection.tags.find import Marker, detect_markers, shortest_side
from trisquare.results.rejected import Rejected

MIN_MARKERS = 3
"""Minimum number of markers of a sheet that has as many: two may lie so by chance, and determine
little."""

MAX_MISFIT = 0.5
"""Maximum distance, in a marker's side, of its corners from where the sheet's homography has them,
or a smooth surface where a fisheye bends it. The strongest other lens bends a whole sheet of ten
markers across by 0.4; a marker that belongs elsewhere is off by one or more."""

MIN_SHARE = 0.8
"""Minimum fraction of a sheet's markers that fit."""

MAX_SIZE_ERROR = 0.04
MAX_SIZE_ERROR_PIXELS = 2.0
"""Maximum difference between the markers' stated side and that seen, over the side, plus pixels: a
thresholded outline lies up to a pixel inside or outside of the edge."""


class SheetMatch(NamedTuple):
    """Markers that lie on a sheet as in its layout.

    Attributes
    ----------
    sheet, arrangement
        The sheet, and the one of its arrangements that fits.
    model : ndarray, shape (N, 4, 2)
        Corners of the markers that fit, sheet coordinates.
    corners : ndarray, shape (N, 4, 2)
        The same in the picture, coarse, pixels.
    border : float
        Width of the markers' black border, over their side.
    cells : ndarray of bool, shape (N, n, n)
        Which cells within the borders are light, in rows from a marker's first side on; n is 0
        where they are not needed.
    """

    sheet: PrintedSheet
    arrangement: Arrangement
    model: FloatArray
    corners: FloatArray
    border: float
    cells: NDArray[np.bool_]


def find_sheets(grey: NDArray[np.uint8], layout: Layout) -> list[SheetMatch | Rejected]:
    """Find the sheets of a layout in a grey picture; sheets that do not fit are rejected."""
    if min(grey.shape) < MIN_PICTURE:
        return []
    if layout.sheets[0].is_touching:
        grids = find_aprilgrids(grey, layout.dictionaries[0])
        return [_match_layout(grid, layout) for grid in grids]
    markers_of_sheets: dict[int, list[tuple[int, FloatArray]]] = {}
    markers = _markers(grey, layout)
    for marker in markers:
        place = layout.place(marker.number)
        if place is not None:
            markers_of_sheets.setdefault(place[0], []).append((place[1], marker.corners))
    found: list[SheetMatch | Rejected] = []
    for index in sorted(markers_of_sheets):
        sheet = layout.sheet(index)
        places = np.array([place for place, _ in markers_of_sheets[index]])
        corners = np.array([corners for _, corners in markers_of_sheets[index]])
        if len(places) >= min(MIN_MARKERS, len(sheet.arrangements[0].corners)):
            cells = np.zeros((len(places), 0, 0), bool)
            found.append(_fit(layout.text, sheet, places, corners, markers[0].border, cells))
    return found


def _match_layout(grid: AprilGrid, layout: Layout) -> SheetMatch | Rejected:
    """Match a grid that was found with the sheet of the layout that has most of its tags."""
    count = len(layout.sheets[0].arrangements[0].corners)
    index, _ = Counter(tag.number // count for tag in grid.tags).most_common(1)[0]
    is_on_sheet = [tag.number // count == index for tag in grid.tags]
    tags = [tag for tag, is_kept in zip(grid.tags, is_on_sheet, strict=True) if is_kept]
    sheet, corners = layout.sheet(index), np.array([tag.corners for tag in tags])
    model = sheet.arrangements[0].corners[[tag.number % count for tag in tags]]
    pitch = 1.0 + sheet.gap
    offsets = model.mean(axis=1) / pitch - [tag.place for tag in tags]
    fits = (np.abs(offsets - np.median(offsets, axis=0)) < 0.5).all(axis=1)
    rejection = _rejection(sheet, layout.text, corners, fits, lambda: pitch / (1.0 + grid.gap))
    if rejection is not None:
        return rejection
    return _match_grid(grid, sheet, model[fits], corners[fits], grid.cells[is_on_sheet][fits])


def find_unknown_grids(grey: NDArray[np.uint8]) -> list[SheetMatch]:
    """Find AprilGrids of any size in a grey picture."""
    if min(grey.shape) < MIN_PICTURE:
        return []
    found = []
    for grid in find_aprilgrids(grey):
        sheet = PrintedSheet(
            "sheet",
            (Arrangement(grid.model),),
            gap=grid.gap,
            is_touching=True,
            is_stated=False,
        )
        corners = np.array([tag.corners for tag in grid.tags])
        found.append(_match_grid(grid, sheet, grid.model, corners, grid.cells))
    return found


def _match_grid(
    grid: AprilGrid,
    sheet: PrintedSheet,
    model: FloatArray,
    corners: FloatArray,
    cells: NDArray[np.bool_],
) -> SheetMatch:
    """Match all of a grid's tags with a sheet: each was found from its neighbours."""
    return SheetMatch(sheet, sheet.arrangements[0], model, corners, grid.border, cells)


def _markers(grey: NDArray[np.uint8], layout: Layout) -> list[Marker]:
    """Detect markers of the layout's dictionary, or of the one that most readings belong to."""
    names = layout.dictionaries
    markers, other_quads = detect_markers(grey, names[0], BORDER)
    if len(names) > 1:
        quads = np.array([marker.corners for marker in markers] + other_quads).reshape(-1, 4, 2)
        tags = decode_tags(grey, straight_sides(quads), np.zeros(len(quads)), TagSearch(names))
        votes = [tag.dictionary for tag in tags if tag is not None]
        if not votes:
            return []
        name = max(sorted(set(votes)), key=votes.count)
        if name != names[0]:
            markers, _ = detect_markers(grey, name, BORDER)
        names = (name,)
    if names[0] != WIDE_BORDERED:
        return markers
    wide_markers, _ = detect_markers(grey, names[0], WIDE_BORDER)
    # If both find as many, the wide ones: a wide border's inner half may pass for a narrow border.
    return max(wide_markers, markers, key=len)


class _Fit(NamedTuple):
    """Markers of a sheet, compared with one of its arrangements."""

    arrangement: Arrangement
    model: FloatArray  # (N, 4, 2), sheet coordinates
    fits: NDArray[np.bool_]  # (N,)
    error: float  # median misfit, in markers' sides
    is_bent: bool  # by the lens, so that no homography fits

    @classmethod
    def of(
        cls,
        arrangement: Arrangement,
        model: FloatArray,
        corners: FloatArray,
        expected: FloatArray,
        *,
        is_bent: bool,
    ) -> _Fit:
        """Compare each marker's corners with those expected; the farthest one counts."""
        errors = np.linalg.norm(expected.reshape(corners.shape) - corners, axis=-1).max(axis=1)
        misfit = np.where(np.isfinite(errors), errors, np.inf) / _sides(corners)
        fits = misfit < MAX_MISFIT
        return cls(arrangement, model, fits, float(np.median(misfit)), is_bent)


def _fit(
    text: str,
    sheet: PrintedSheet,
    places: NDArray[np.intp],
    corners: FloatArray,
    border: float,
    cells: NDArray[np.bool_],
) -> SheetMatch | Rejected:
    """Match markers with a sheet, or return the reason why they are not on it."""
    hypotheses = [
        (arrangement, np.roll(arrangement.corners[places], turns, axis=1))
        for arrangement in sheet.arrangements
        for turns in range(4)  # allows for codes that are all turned alike
    ]
    best = min(
        (_fit_homography(*hypothesis, corners) for hypothesis in hypotheses),
        key=lambda fit: fit.error,
    )
    if best.fits.mean() < MIN_SHARE and 4 * len(places) >= MIN_POINTS:
        best = min(
            (_fit_surface(*hypothesis, corners) for hypothesis in hypotheses),
            key=lambda fit: fit.error,
        )
    kept = best.fits
    rejection = _rejection(sheet, text, corners, kept, lambda: _size_ratio(best, corners))
    if rejection is not None:
        return rejection
    return SheetMatch(
        sheet,
        best.arrangement,
        best.model[kept],
        corners[kept],
        border,
        cells[kept],
    )


def _rejection(
    sheet: PrintedSheet,
    text: str,
    corners: FloatArray,
    fits: NDArray[np.bool_],
    size_ratio: Callable[[], float],
) -> Rejected | None:
    """Return a rejection if markers are not those of a stated sheet.

    `fits` marks those that are in their stated places, `size_ratio` returns their apparent side
    over the stated one.
    """
    if fits.mean() < MIN_SHARE:
        reason = f"its {len(corners)} markers are not where {text} has them"
        return Rejected(sheet.kind, 0, box_around(corners), reason)
    shortest = float(np.median([shortest_side(marker) for marker in corners]))
    ratio = size_ratio()
    if abs(ratio - 1.0) > MAX_SIZE_ERROR + MAX_SIZE_ERROR_PIXELS / shortest:
        reason = f"its markers are {ratio:.2f} times as large as {text} says"
        return Rejected(sheet.kind, 0, box_around(corners), reason)
    return None


def _fit_homography(arrangement: Arrangement, model: FloatArray, corners: FloatArray) -> _Fit:
    tolerance = MAX_MISFIT * float(np.median(_sides(corners)))
    points, seen = model.reshape(-1, 2), corners.reshape(-1, 2)
    homography, _ = cv2.findHomography(points, seen, cv2.RANSAC, tolerance)
    expected = np.full(points.shape, np.inf)
    if homography is not None and np.linalg.det(homography) > 0.0:
        expected[:] = cv2.perspectiveTransform(points[None], homography)[0]
    return _Fit.of(arrangement, model, corners, expected, is_bent=False)


def _fit_surface(arrangement: Arrangement, model: FloatArray, corners: FloatArray) -> _Fit:
    points = model.reshape(-1, 2)
    expected = SmoothSurface.of(points, corners.reshape(-1, 2)).at(points)
    return _Fit.of(arrangement, model, corners, expected, is_bent=True)


def _size_ratio(fit: _Fit, corners: FloatArray) -> float:
    """Return the markers' sides over those stated, from their middles alone if those suffice."""
    model, seen = fit.model[fit.fits], corners[fit.fits]
    middles, image_middles = model.mean(axis=1), _middles(seen)
    if fit.is_bent and len(middles) >= MIN_POINTS:
        expected = SmoothSurface.of(middles, image_middles).at(model)
        return float(np.median(_sides(seen) / _sides(expected)))
    can_use_middles = (
        len(middles) >= 4 and np.linalg.matrix_rank(middles - middles[0], tol=1e-3) == 2
    )
    pairs = (
        (middles, image_middles) if can_use_middles else (model.reshape(-1, 2), seen.reshape(-1, 2))
    )
    sheet_from_image, _ = cv2.findHomography(*pairs[::-1])
    if sheet_from_image is None:
        return math.inf
    mapped = cv2.perspectiveTransform(seen.reshape(1, -1, 2), sheet_from_image)
    ratios = _sides(np.asarray(mapped, dtype=np.float64).reshape(-1, 4, 2)) / _sides(model)
    return float(np.median(ratios)) if np.isfinite(ratios).all() else math.inf


def _middles(corners: FloatArray) -> FloatArray:
    """Return where quadrilaterals' diagonals cross, (N, 2): the images of squares' middles."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    ac, bd, ab = c - a, d - b, b - a
    cross = ac[:, 0] * bd[:, 1] - ac[:, 1] * bd[:, 0]
    part = (ab[:, 0] * bd[:, 1] - ab[:, 1] * bd[:, 0]) / cross
    return np.asarray(a + part[:, None] * ac)


def _sides(corners: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).mean(axis=1))
