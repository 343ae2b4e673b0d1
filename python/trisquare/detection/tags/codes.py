"""The printed codes of ArUco and AprilTag dictionaries, and their look-up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.bool_]

Real = TypeVar("Real", np.float32, np.float64)

BLOCK = 64
"""Number of codes, and of readings, that are multiplied at a time."""

MIN_BITS_TO_CORRECT = 25
"""Minimum number of bits of a code for one wrong bit to be accepted: codes of 16 bits are so close
that chance matches would be accepted five times as often."""


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """The codes of one dictionary.

    Attributes
    ----------
    name : str
        One of `families.DICTIONARIES`.
    codes : ndarray of bool, shape (N, n, n)
        By number; True is white; without the border.
    """

    name: str
    codes: Bits

    @property
    def side(self) -> int:
        """Cells along a code's side, `n`."""
        return int(self.codes.shape[1])

    @property
    def correctable(self) -> int:
        """Number of wrong bits that are accepted."""
        return int(self.side**2 >= MIN_BITS_TO_CORRECT)

    @property
    def chance(self) -> float:
        """Probability that random bits match one of the codes in any orientation."""
        bits = self.side**2
        words = sum(math.comb(bits, wrong) for wrong in range(self.correctable + 1))
        return min(1.0, 4.0 * len(self.codes) * words / 2.0**bits)

    def look_up(self, read: Bits) -> list[tuple[int, int] | None]:
        """Look up readings, (Q, n, n): number and how often the code was turned left, or None.

        If it was turned left once, a code's top left corner is the reading's bottom left one.
        """
        signs = np.where(read.reshape(-1, self.side**2), np.float32(1.0), np.float32(-1.0))
        best, agreement = largest_products(signs, _turned_codes(self.name))
        wrong = (signs.shape[1] - agreement) / 2.0
        return [
            (int(place) % len(self.codes), int(place) // len(self.codes))
            if errors <= self.correctable
            else None
            for place, errors in zip(best, wrong, strict=True)
        ]


@cache
def dictionary(name: str) -> Dictionary:
    """Return a dictionary by its exact name."""
    source = opencv_dictionary(name)
    side = source.markerSize
    bits_of = cv2.aruco.Dictionary.getBitsFromByteList
    rows = (source.bytesList[row : row + 1] for row in range(len(source.bytesList)))
    codes = np.array([bits_of(row, side) for row in rows]).astype(bool)
    codes.flags.writeable = False
    return Dictionary(name, codes)


def opencv_dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's dictionary of that name."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


@cache
def _turned_codes(name: str) -> NDArray[np.float32]:
    """Return codes as +1 and -1 in their four orientations, as `largest_products` takes them."""
    codes = dictionary(name).codes
    turned = np.concatenate([np.rot90(codes, turns, axes=(1, 2)) for turns in range(4)])
    signs = np.where(turned.reshape(len(turned), -1), np.float32(1.0), np.float32(-1.0))
    return in_blocks(signs)


def in_blocks(codes: NDArray[Real]) -> NDArray[Real]:
    """Arrange codes, (C, n), for `largest_products`; the last one is repeated to fill a block."""
    filled = np.concatenate([codes, np.repeat(codes[-1:], -len(codes) % BLOCK, axis=0)])
    blocks = filled.reshape(-1, BLOCK, codes.shape[1])
    return np.ascontiguousarray(blocks.transpose(0, 2, 1))


def largest_products(
    rows: NDArray[Real], blocks: NDArray[Real]
) -> tuple[NDArray[np.intp], NDArray[Real]]:
    """Find for each row, shape (Q, n), the code in blocks with the largest scalar product.

    The products are small, so that BLAS starts no threads, which would take longer than all of it.

    Returns
    -------
    numbers : ndarray of int, shape (Q,)
    products : ndarray, shape (Q,)
    """
    numbers = np.empty(len(rows), np.intp)
    largest = np.empty_like(rows, shape=len(rows))
    for first in range(0, len(rows), BLOCK):
        batch = slice(first, first + BLOCK)
        products = (rows[batch] @ blocks).swapaxes(0, 1).reshape(-1, len(blocks) * BLOCK)
        numbers[batch], largest[batch] = products.argmax(axis=1), products.max(axis=1)
    return numbers, largest
