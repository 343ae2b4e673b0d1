"""The edges of a chessboard's grid lines, measured between its crossings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trisquare.checked import FloatArray
from trisquare.edge_shift import shift_toward_light, without_shift
from trisquare.edges import PlaneEdges
from trisquare.outlines import Lattice
from trisquare.spans import Samples, Span

PROBE = 0.25
"""Distance from a grid line, in cells, at which a cell's shade is looked up."""

LEAST_LINES = 4
"""Grid lines that a plane needs."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundLattice:
    """A chessboard, whole or in part, that was found: see `Found`.

    A grid line is a chain of spans, one between each two neighbouring crossings; where one of
    them is missing the chain has a gap.
    """

    lattice: Lattice
    rises: tuple[float, ...]
    """Of every span, in the order of `_chains`."""

    @classmethod
    def of(cls, lattice: Lattice, grey: npt.NDArray[np.uint8]) -> FoundLattice:
        """Look up in a grey picture which cells are light."""
        paths = [path for _, chain in _chains(lattice) for path in chain]
        return cls(lattice, tuple(_rises(grey, np.array(paths).reshape(-1, 2, 2))))

    @classmethod
    def with_corner(cls, lattice: Lattice, dark_corner: bool) -> FoundLattice:
        """Know which cells are light from the colour of the whole board's first cell."""
        rises = []
        for direction, r, c in (key for chain in _chain_keys(lattice) for key in chain):
            # The cell on the right-hand normal's side: below, or on the left.
            row, col = (r + 1, c + 1) if direction == "along" else (r + 1, c)
            dark = ((row + col) % 2 == 0) == dark_corner
            rises.append(-1.0 if dark else 1.0)
        return cls(lattice, tuple(rises))

    @property
    def kind(self) -> str:
        """Return ``"chessboard"``."""
        return "chessboard"

    @property
    def quad(self) -> FloatArray:
        """The crossings' bounding rectangle that is smallest, shape (4, 2), pixels."""
        points = self.lattice.crossings[self.lattice.present].astype(np.float32)
        return np.asarray(cv2.boxPoints(cv2.minAreaRect(points)), dtype=np.float64)

    def spans(self, first: int) -> list[Span]:
        """Return the spans of every grid line in turn, bounded by those that cross their ends."""
        numbers: dict[tuple[str, int, int], int] = {}
        keys = [key for chain in _chain_keys(self.lattice) for key in chain]
        for count, key in enumerate(keys):
            numbers[key] = first + count

        def crossing(direction: str, r: int, c: int) -> int | None:
            if direction == "along":  # is crossed by the column's spans below or above
                return numbers.get(("down", r, c), numbers.get(("down", r - 1, c)))
            return numbers.get(("along", r, c), numbers.get(("along", r, c - 1)))

        spans: list[Span] = []
        for key, rise in zip(keys, self.rises, strict=True):
            direction, r, c = key
            start, end = _ends(key)
            path = np.stack([self.lattice.crossings[start], self.lattice.crossings[end]])
            spans.append((path, rise, (crossing(direction, r, c), crossing(direction, *end))))
        return spans

    def figures(self, measured: Sequence[Samples | str], plane: int) -> list[PlaneEdges]:
        """One figure of all grid lines that were measured."""
        return self.figures_and_shift(measured, plane)[0]

    def figures_and_shift(
        self, measured: Sequence[Samples | str], plane: int
    ) -> tuple[list[PlaneEdges], float]:
        """Return the figures, and by how much edges were shifted toward the light, pixels."""
        rows, cols = self.lattice.present.shape
        models = [(0.0, 1.0, (rows - 1) / 2 - r) for r in range(rows)]
        models += [(1.0, 0.0, (cols - 1) / 2 - c) for c in range(cols)]
        signed = iter(zip(measured, self.rises, strict=True))
        lines, joined = [], []
        for model, chain in zip(models, _chain_keys(self.lattice), strict=True):
            samples = _joined([next(signed) for _ in chain])
            if samples is not None:
                lines.append(model)
                joined.append(samples)
        if len(lines) < LEAST_LINES:
            return [], 0.0
        # The board's own zigzag tells the shift that a tone curve leaves, far better than profiles
        # do: there is no drift to account for.
        shift = shift_toward_light(joined)
        board = PlaneEdges(
            np.array(lines),
            tuple(without_shift(points, signs, shift) for points, _, signs in joined),
            tuple(std for _, std, _ in joined),
            plane=plane,
            kind=self.kind,
        )
        return [board], shift


Key = tuple[str, int, int]


def _chain_keys(lattice: Lattice) -> Iterator[list[Key]]:
    """Yield the spans of every row, then of every column: their direction and start."""
    present = lattice.present
    rows, cols = present.shape
    along, down = present[:, :-1] & present[:, 1:], present[:-1] & present[1:]
    for r in range(rows):
        yield [("along", r, c) for c in range(cols - 1) if along[r, c]]
    for c in range(cols):
        yield [("down", r, c) for r in range(rows - 1) if down[r, c]]


def _ends(key: Key) -> tuple[tuple[int, int], tuple[int, int]]:
    """Start and end of a span, as row and column of the crossings."""
    direction, r, c = key
    return (r, c), ((r, c + 1) if direction == "along" else (r + 1, c))


def _chains(lattice: Lattice) -> Iterator[tuple[list[Key], list[FloatArray]]]:
    for keys in _chain_keys(lattice):
        yield keys, [np.stack([lattice.crossings[end] for end in _ends(key)]) for key in keys]


def _joined(
    chain: Sequence[tuple[Samples | str, float]],
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return points, standard deviations and rises of all measured spans of one grid line."""
    samples = [(*span[:2], rise) for span, rise in chain if not isinstance(span, str)]
    if not samples:
        return None
    points, std, rises = zip(*samples, strict=True)
    signs = np.repeat(rises, [len(part) for part in points])
    return np.concatenate(points), np.concatenate(std), signs


def _rises(grey: npt.NDArray[np.uint8], paths: FloatArray) -> list[float]:
    """Return +1 for spans with the lighter cell on their right-hand normal's side, else -1.

    Parameters
    ----------
    grey : ndarray of uint8, shape (H, W)
    paths : ndarray, shape (S, 2, 2)
        Start and end of each span, pixels.
    """
    middle = paths.mean(axis=1)
    along = paths[:, 1] - paths[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) * PROBE
    probes = np.stack([middle + normal, middle - normal], axis=1).astype(np.float32)
    shades = cv2.remap(grey, probes[..., 0], probes[..., 1], cv2.INTER_LINEAR).astype(np.int64)
    return [1.0 if right > left else -1.0 for right, left in shades.tolist()]
