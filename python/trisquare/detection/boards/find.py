"""Chessboard-like lattices of a picture: linked from its saddle points, one per plane.

The picture is searched from coarse to fine. A coarse picture has lost the markers that a light
cell may carry, the noise, and the blur of large cells; a finer one has the small cells, and
settles and completes what the coarser one showed.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trisquare._support.arrays import FloatArray
from trisquare.detection.boards.alternation import is_chequered
from trisquare.detection.boards.grids import Grid, grids_of, grow, trimmed
from trisquare.detection.boards.links import link
from trisquare.detection.boards.merging import joined, with_neighbours
from trisquare.detection.boards.outliers import (
    LEAST_STRAY,
    LEAST_STRAY_CELLS,
    is_large,
    smooth_parts,
)
from trisquare.detection.boards.saddles import Saddles, find_saddles, settle
from trisquare.detection.candidates import Lattice
from trisquare.detection.sampling import sample

FINEST = 1000
"""Longest side in pixels of a picture that is searched as it is; a larger one is halved once,
which leaves its smallest cells (10 pixels) five pixels. Where that shows crossings which make no
lattice, as the rims of markers fade in it, the whole is searched as well."""

COARSEST = 100
"""Shortest side in pixels of the coarsest picture: a board in it has cells of five pixels."""

LEAST_CROSSINGS = 9
LEAST_SIDE = 3
"""Crossings of a lattice, and per direction: fewer come about by chance, and are single squares."""

LEAST_CELL = 7.5
"""Side in pixels of the photograph of the square as large as a typical cell: smaller ones are
pictures of boards on a screen or in print, or nothing."""

SMALL = 16
SMALL_SHARE = 0.9
"""A lattice of fewer crossings must have this share of its rows and columns: pieces of random
mosaics are ragged."""

PLACES = np.array([0.2, 0.35, 0.5, 0.65, 0.8])
BESIDE = 1.3
"""Where edges are looked for between crossings: fractions of the way, and pixels of the searched
picture beside it."""

EDGE_SHARE = 0.7
"""Of the links between crossings, those that must be edges in the photograph, too, in the rows as
well as in the columns. A grille
or a keyboard is a chessboard on its corner when it is blurred, and only then."""

SMALL_EDGE_SHARE = 0.95
"""The same of a lattice of fewer than `SMALL` crossings: print and stripes have some of them."""

MOST_EXTENSIONS = 12
"""Rows and columns that are added one after another: as many as a large board has."""

AT_FOLD = 0.25
"""Cells from the outline of another lattice, with one cell round it, at which a fold may be."""

INTO_CELL = 3.0
LEAST_INTO_CELL = 0.1
MOST_INTO_CELL = 0.3
"""Where the four cells at a crossing are looked at: pixels of the photograph along both of a cell's
sides, which is out of the blur, within these parts of the side. A marker leaves an eighth free."""

MIN_CONTRAST = 0.3
"""Least step between a light cell and a dark one at a crossing, over the mean step: at the rim of
a board three of the four are light."""


def find_lattices(grey: NDArray[np.uint8]) -> list[Lattice]:
    """Find every lattice of 3 x 3 crossings and more in a grey picture.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)

    Returns
    -------
    list of Lattice
        From the one of most crossings to the one of fewest; empty if there is none.
    """
    grids: list[Grid] = []
    pictures, scale = _pictures(grey)
    for level, picture in enumerate(pictures, 1 - len(pictures)):
        size = scale << -level
        grids = [_doubled(grid, picture) for grid in grids]
        saddles = find_saddles(picture)
        # What a coarse picture makes of a grille, or of the cells of two boards, would else hide
        # from the finer ones what is there.
        grids = [grid for grid in grids if _has_edges(grid, grey, size)]
        # What hangs on by a thread in a coarse picture is better seen in the next.
        grids = _grids_at(picture, saddles, grids, thorough=level == 0)
        grids = [grid for grid in grids if _is_lattice(grid, size)]
    if scale > 1 and _shows_more(picture, saddles, grids):
        grids = _looked_closer(grids, grey)
    grids = [grid for grid in grids if _has_edges(grid, grey, scale)]
    outlines = [_outline(grid) for grid in grids]
    grids = [
        _extended(grid, picture, grey, outlines[:number] + outlines[number + 1 :])
        for number, grid in enumerate(grids)
    ]
    grids = [_complete(_alternating(grid, grey, scale)) for grid in grids]
    grids = [grid for grid in grids if _is_lattice(grid, scale) and _has_edges(grid, grey, scale)]
    grids = [grid for grid in grids if is_chequered(grid, grey, scale)]
    found = [_lattice(grid, scale) for grid in grids if _is_lattice(grid, scale)]
    return sorted(found, key=lambda lattice: -int(np.count_nonzero(lattice.present)))


def _pictures(grey: NDArray[np.uint8]) -> tuple[list[NDArray[np.uint8]], int]:
    """Pictures to search, from coarse to fine, and photograph pixels per pixel of the finest."""
    picture, scale = grey, 1
    if max(grey.shape) > FINEST and min(grey.shape) > COARSEST:
        picture, scale = np.asarray(cv2.pyrDown(grey), dtype=np.uint8), 2
    pictures = [picture]
    while min(picture.shape) >= 2 * COARSEST:
        picture = np.asarray(cv2.pyrDown(picture), dtype=np.uint8)
        pictures.append(picture)
    return pictures[::-1], scale


def _doubled(grid: Grid, picture: NDArray[np.uint8]) -> Grid:
    """Carry a grid over into a picture twice as fine."""
    points = grid.points.copy()
    # pyrDown keeps every second pixel's centre, so that coordinates only need the factor.
    points[grid.present] = settle(picture, 2.0 * grid.points[grid.present])
    return Grid(points, grid.dark_first)


def _grids_at(
    picture: NDArray[np.uint8], saddles: Saddles, known: list[Grid], *, thorough: bool = True
) -> list[Grid]:
    """Complete the grids known from a coarser picture and find those that it did not show."""
    if len(saddles) < LEAST_CROSSINGS:
        return known
    grids, scraps = _grown(picture, saddles, known, thorough)
    parts = _smooth(grids, scraps, picture)
    if len(parts) == len(grids) and _crossings(parts) > _crossings(grids) - LEAST_SIDE:
        return parts
    # What a grid had of its neighbour over a fold is there for the neighbour now, and between two
    # pieces that were joined there may be more.
    return _smooth(*_grown(picture, saddles, parts, thorough), picture)


def _crossings(grids: list[Grid]) -> int:
    return sum(int(np.count_nonzero(grid.present)) for grid in grids)


def _smooth(grids: list[Grid], scraps: list[Grid], picture: NDArray[np.uint8]) -> list[Grid]:
    """Parts of grids that are smooth and have whole cells, put together where they continue."""
    parts = [part for grid in grids for part in smooth_parts(_complete(grid), picture.shape)]
    parts = [_complete(part) for part in parts]
    whole = [part for part in parts if is_large(part)]
    rest = [_complete(scrap) for scrap in scraps] + [part for part in parts if not is_large(part)]
    return joined(whole, [scrap for scrap in rest if scrap.present.any()], picture.shape)


def _grown(
    picture: NDArray[np.uint8], saddles: Saddles, known: list[Grid], thorough: bool
) -> tuple[list[Grid], list[Grid]]:
    """Grow known grids, each into what no other has, and then those that nothing is known of.

    The latter that have remained small come apart from the others; if `thorough`, only after
    faint crossings have been looked for beside theirs.
    """
    grids: list[Grid] = []
    for number, grid in enumerate(known):
        others = saddles.subset(~_covered(saddles.points, grids + known[number + 1 :]))
        grids.append(grow(grid, picture, others))
    free = saddles.subset(~_covered(saddles.points, grids))
    scraps: list[Grid] = []
    if len(free) < LEAST_CROSSINGS:
        return grids, scraps
    for seed in grids_of(free.points, link(picture, free)):
        if _covered(seed.points[seed.present], grids).any():
            continue
        left = free.subset(~_covered(free.points, grids))
        grid = grow(seed, picture, left)
        if thorough and not is_large(_complete(grid)):
            outlines = [_outline(one) for one in grids]
            grid = grow(_extended(grid, picture, picture, outlines), picture, left)
        (grids if is_large(grid) else scraps).append(grid)
    return grids, scraps


def _shows_more(picture: NDArray[np.uint8], saddles: Saddles, grids: list[Grid]) -> bool:
    """Whether there are as many linked crossings beside some grids as a lattice has."""
    free = saddles.subset(~_covered(saddles.points, grids))
    if len(free) < LEAST_CROSSINGS:
        return False
    linked = np.count_nonzero(link(picture, free).following >= 0, axis=1)
    return bool(np.count_nonzero(linked >= 2) >= LEAST_CROSSINGS)


def _looked_closer(grids: list[Grid], grey: NDArray[np.uint8]) -> list[Grid]:
    """Search the photograph itself, of which grids in the halved picture are known."""
    doubled = [_doubled(grid, grey) for grid in grids]
    finer = [_complete(grid) for grid in _grids_at(grey, find_saddles(grey), doubled)]
    outlines = [_outline(grid) for grid in finer]
    # Of a small board hardly a crossing may be missing.
    finer = [
        grid
        if _is_lattice(grid, 1)
        else _extended(grid, grey, grey, outlines[:number] + outlines[number + 1 :])
        for number, grid in enumerate(finer)
    ]
    good = [_is_lattice(grid, 1) and _has_edges(grid, grey, 1) for grid in finer]
    halved = [Grid(0.5 * grid.points, grid.dark_first) for grid in finer]
    # Noise and blur may hide from the photograph what the halved picture shows.
    known = [
        new if kept and np.count_nonzero(new.present) >= np.count_nonzero(old.present) else old
        for old, new, kept in zip(grids, halved, good, strict=False)
    ]
    count = len(grids)
    return known + [new for new, kept in zip(halved[count:], good[count:], strict=True) if kept]


def _covered(points: FloatArray, grids: list[Grid]) -> NDArray[np.bool_]:
    """Which points, shape (N, 2), some grid already has within its outline."""
    covered = np.zeros(len(points), bool)
    for grid in grids:
        hull = _hull(grid.points[grid.present])
        edges = np.roll(hull, -1, axis=0) - hull
        gap = points[:, None] - hull
        covered |= (edges[:, 0] * gap[..., 1] - edges[:, 1] * gap[..., 0] > -1e-6).all(axis=1)
    return covered


def _hull(points: FloatArray) -> FloatArray:
    """Convex hull of points, shape (M, 2), clockwise on the screen, shape (N, 2)."""
    hull = cv2.convexHull(points.astype(np.float32), clockwise=False)
    return np.asarray(hull, dtype=np.float64).reshape(-1, 2)


def _complete(grid: Grid) -> Grid:
    """Leave out crossings of which no whole cell is there."""
    present = grid.present
    cells = present[:-1, :-1] & present[1:, :-1] & present[:-1, 1:] & present[1:, 1:]
    around = np.pad(cells, 1)
    kept = around[:-1, :-1] | around[1:, :-1] | around[:-1, 1:] | around[1:, 1:]
    if not (present & ~kept).any():
        return grid
    return trimmed(Grid(np.where(kept[..., None], grid.points, np.nan), grid.dark_first))


def _is_lattice(grid: Grid, scale: int) -> bool:
    """Whether a grid has enough crossings, far enough apart."""
    present = grid.present
    count = int(np.count_nonzero(present))
    if min(present.shape) < LEAST_SIDE or count < LEAST_CROSSINGS:
        return False
    if count < SMALL and count < SMALL_SHARE * present.size:
        return False
    first = grid.points[1:, 1:] - grid.points[:-1, :-1]
    second = grid.points[1:, :-1] - grid.points[:-1, 1:]
    areas = 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    return bool(scale * np.sqrt(np.nanmedian(areas)) >= LEAST_CELL)


def _extended(
    grid: Grid, picture: NDArray[np.uint8], grey: NDArray[np.uint8], others: list[FloatArray]
) -> Grid:
    """Add crossings that were too faint to be found, but are where the lattice goes on.

    Cells alternate round them, and edges lead to their neighbours in the photograph. At a fold
    they do so, too, where two sheets' cells happen to meet: what is next to one of the `others`,
    outlines of shape (N, 2), is not added.
    """
    scale = round(grey.shape[0] / picture.shape[0])
    for _ in range(MOST_EXTENSIONS):
        wider = with_neighbours(grid, picture.shape)
        known = np.pad(grid.present, 1)
        new = _alternating(wider, grey, scale).present & ~known
        new[new] = ~_is_at(wider.points[new], others, AT_FOLD * grid.cell)
        if not new.any():
            break
        points = wider.points.copy()
        points[new] = settle(picture, wider.points[new])
        gap = np.linalg.norm(points - wider.points, axis=2)
        new &= ~(gap > max(LEAST_STRAY, LEAST_STRAY_CELLS * grid.cell))
        wider = Grid(np.where((new | known)[..., None], points, np.nan), grid.dark_first)
        linked = wider.present
        for axis, edge in enumerate(reversed(_edges(wider, grey, scale))):
            # Without an edge between two crossings, one of them may be none.
            first, second = (
                np.split(linked, [-1], axis=axis)[0],
                np.split(linked, [1], axis=axis)[1],
            )
            first &= edge
            second &= edge
        kept = (new & linked) | known
        wider = Grid(np.where(kept[..., None], points, np.nan), grid.dark_first)
        extended = trimmed(_complete(wider))
        if np.count_nonzero(extended.present) <= np.count_nonzero(grid.present):
            break
        grid = extended
    return grid


def _outline(grid: Grid) -> FloatArray:
    """Convex outline of a grid and one cell round it, clockwise on the screen, shape (N, 2)."""
    around = [grid.points]
    for axis in (0, 1):
        step = np.diff(grid.points, axis=axis)
        before = np.split(grid.points, [1], axis=axis)[1]
        after = np.split(grid.points, [-1], axis=axis)[0]
        around += [before + step, after - step]
    known = np.concatenate([part.reshape(-1, 2) for part in around])
    return _hull(known[np.isfinite(known[:, 0])])


def _is_at(points: FloatArray, outlines: list[FloatArray], reach: float) -> NDArray[np.bool_]:
    """Which points, shape (N, 2), are in some outline or within a distance of it."""
    return np.array(
        [
            any(
                cv2.pointPolygonTest(outline.astype(np.float32), point, True) > -reach
                for outline in outlines
            )
            for point in points.tolist()
        ],
        dtype=bool,
    )


def _has_edges(grid: Grid, grey: NDArray[np.uint8], scale: int) -> bool:
    """Whether edges lead from crossing to crossing in the photograph, in rows and in columns."""
    share = SMALL_EDGE_SHARE if np.count_nonzero(grid.present) < SMALL else EDGE_SHARE
    present = grid.present
    links = present[:, 1:] & present[:, :-1], present[1:] & present[:-1]
    edges = _edges(grid, grey, scale)
    # Rows that are linked across every second one have all the edges that lie along them.
    return all(edge[link].mean() >= share for edge, link in zip(edges, links, strict=True))


def _edges(
    grid: Grid, grey: NDArray[np.uint8], scale: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which links of the rows, and of the columns, are edges of the right sign, or are not there.

    Shapes (rows, cols - 1) and (rows - 1, cols).
    """
    points = scale * grid.points
    rows, cols = np.indices(grid.present.shape)
    dark = ((rows + cols) % 2 == 0) == grid.dark_first
    ways = [points[:, 1:] - points[:, :-1], points[1:] - points[:-1]]
    starts = [points[:, :-1], points[:-1]]
    signs = [np.where(dark[:, :-1], 1.0, -1.0), np.where(dark[:-1], -1.0, 1.0)]
    way = np.concatenate([part.reshape(-1, 2) for part in ways])
    start = np.concatenate([part.reshape(-1, 2) for part in starts])
    sign = np.concatenate([part.ravel() for part in signs])
    known = np.isfinite(way[:, 0])
    edge = np.ones(len(way), bool)
    way, start, sign = way[known], start[known], sign[known]
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    clockwise = np.stack([-way[:, 1], way[:, 0]], axis=1) * (scale * BESIDE / length)[:, None]
    at = start[:, None] + PLACES[:, None] * way[:, None]
    before, after = (
        sample(grey, at - clockwise[:, None]),
        sample(grey, at + clockwise[:, None]),
    )
    edge[known] = (sign[:, None] * (before - after) > 0.0).all(axis=1)
    in_row, in_column = np.split(edge, [signs[0].size])
    return in_row.reshape(signs[0].shape), in_column.reshape(signs[1].shape)


def _alternating(grid: Grid, grey: NDArray[np.uint8], scale: int) -> Grid:
    """Leave out crossings at which two light cells and two dark ones do not alternate."""
    rows, cols = np.indices(grid.present.shape)
    points = scale * np.pad(grid.points, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    here = points[1:-1, 1:-1]
    beside = [points[1:-1, 2:], points[2:, 1:-1], points[1:-1, :-2], points[:-2, 1:-1]]
    ways = [
        np.where(np.isfinite(ahead), ahead - here, here - behind)
        for ahead, behind in zip(beside, beside[2:] + beside[:2], strict=True)
    ]
    levels = []
    for first, second in zip(ways, ways[1:] + ways[:1], strict=True):
        side = np.minimum(np.linalg.norm(first, axis=2), np.linalg.norm(second, axis=2))
        part = np.clip(INTO_CELL / np.maximum(side, 1e-9), LEAST_INTO_CELL, MOST_INTO_CELL)
        at = here + part[..., None] * (first + second)
        known = np.isfinite(at[..., 0])
        level = np.full(known.shape, np.nan)
        level[known] = sample(grey, at[known])
        levels.append(level)
    dark = ((rows + cols) % 2 == 0) == grid.dark_first
    sign = np.where(dark, 1.0, -1.0)
    even, odd = sign * np.stack(levels[::2]), sign * np.stack(levels[1::2])
    least = odd.min(axis=0) - even.max(axis=0)
    mean = odd.mean(axis=0) - even.mean(axis=0)
    keep = (mean > 0.0) & (least > MIN_CONTRAST * mean)
    return Grid(np.where(keep[..., None], grid.points, np.nan), grid.dark_first)


def _lattice(grid: Grid, scale: int) -> Lattice:
    """Crossings in pixels of the photograph."""
    crossings = np.where(grid.present[..., None], scale * grid.points, 0.0)
    present = grid.present
    crossings.flags.writeable = present.flags.writeable = False
    return Lattice(crossings, present)
