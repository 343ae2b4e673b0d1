"""Boards found by the package `calib-targets`, where it is installed; trisquare does not use it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from trisquare.detection.candidates import Lattice

MAX_BOARDS = 6
"""Maximum number of boards; its default is three."""

Finder = Callable[[np.ndarray], list[Lattice]]


def _finder() -> Finder | None:
    try:
        package = import_module("calib_targets")
    except ImportError:
        return None
    settings = package.ChessboardParams(max_components=MAX_BOARDS)

    def find(picture: np.ndarray) -> list[Lattice]:
        boards = package.detect_chessboard_all(np.ascontiguousarray(picture), params=settings)
        return [_lattice(board.corners) for board in boards]

    return find


def _lattice(corners: list) -> Lattice:
    at = np.array([(corner.grid.v, corner.grid.u) for corner in corners])
    at -= at.min(axis=0)
    crossings = np.zeros((*(at.max(axis=0) + 1), 2))
    present = np.zeros(crossings.shape[:2], bool)
    crossings[at[:, 0], at[:, 1]] = [(corner.position[0], corner.position[1]) for corner in corners]
    present[at[:, 0], at[:, 1]] = True
    return Lattice(crossings, present)


def _version() -> str:
    try:
        return version("calib-targets")
    except PackageNotFoundError:
        return ""


VERSION = _version()
find_with_calib_targets = _finder()
