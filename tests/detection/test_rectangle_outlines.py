"""Rectangles are found although other things touch them."""

import cv2
import numpy as np
import pytest

from trisquare import simulate
from trisquare.detection.squares.find import find_plain_rectangles
from trisquare.detection.squares.rectangle_shape import RectangleShape

A4 = RectangleShape(2.0**0.5)
SHEET = np.array([[60, 80], [330, 60], [350, 260], [50, 250]], np.float64)
TOLERANCE = 2.0
"""Maximum distance of the corners in pixels."""


def sheet(*things):
    """A sheet on a darker ground, on top of some things: `(centre, radius, level)` or a line."""
    picture = np.full((320, 420), 90, np.uint8)
    for where, size, level in things:
        if np.ndim(size) == 0:
            cv2.circle(picture, where, size, level, -1, cv2.LINE_AA)
        else:
            cv2.line(picture, where, size, level, 6, cv2.LINE_AA)
    cv2.fillPoly(picture, [np.rint(16 * SHEET).astype(np.int32)], 210, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def distance_from_sheet(found):
    """The largest distance of the corners from the sheet's, in any order, in pixels."""
    corners = found.outer.corners
    return min(np.abs(np.roll(corners, k, axis=0) - SHEET).max() for k in range(4))


@pytest.mark.parametrize(
    "things",
    [
        [],
        [((200, 55), 30, 210)],
        [((200, 55), 30, 250)],
        [((30, 130), (100, 40), 215)],
        [((190, 260), (190, 319), 210), ((345, 190), 30, 205)],
        [((60, 80), 25, 210), ((330, 60), (400, 20), 220)],
        [((345, 250), 40, 208), ((52, 180), 30, 20)],
    ],
)
def test_a_sheet_is_found_whatever_touches_it(things):
    found = find_plain_rectangles(sheet(*things), A4)
    assert len(found) == 1
    assert distance_from_sheet(found[0]) < TOLERANCE


def test_two_sides_and_a_crossing_line_are_no_rectangle():
    picture = np.full((320, 420), 90, np.uint8)
    cv2.line(picture, (60, 80), (330, 60), 210, 6, cv2.LINE_AA)
    cv2.line(picture, (60, 80), (50, 250), 210, 6, cv2.LINE_AA)
    cv2.line(picture, (10, 300), (400, 200), 210, 6, cv2.LINE_AA)
    assert not find_plain_rectangles(picture, A4)


def test_a_label_is_not_taken_for_the_sheet_that_it_lies_on():
    picture = sheet()
    label = np.array([[100, 110], [200, 102], [205, 200], [98, 205]])
    cv2.fillPoly(picture, [label.astype(np.int32)], 60, cv2.LINE_AA)
    (found,) = find_plain_rectangles(picture, A4)
    assert distance_from_sheet(found) < TOLERANCE


@pytest.mark.parametrize("place", [(0.3, 0.3), (0.5, 0.5), (0.35, 0.6), (0.62, 0.42), (0.7, 0.7)])
@pytest.mark.parametrize("size", [0.15, 0.2, 0.25])
def test_a_picture_of_the_sheets_own_shape_is_not_taken_for_the_sheet(place, size):
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    rotation, _ = cv2.Rodrigues(np.array([0.5, 0.4, 0.1]))

    def seen(corners):
        on_sheet = np.column_stack([(corners - 0.5) * [297.0, 210.0], np.zeros(4)])
        x, y, z = rotation @ on_sheet.T + [[0.0], [0.0], [460.0]]
        return np.stack([400.0 * x / z + 210.0, 400.0 * y / z + 160.0], axis=1)

    picture = np.full((320, 420), 90, np.uint8)
    printed = np.array(place) + size * (unit - 0.5)
    for corners, level in ((unit, 210), (printed, 60)):
        outline = np.rint(16 * seen(corners)).astype(np.int32)
        cv2.fillPoly(picture, [outline], level, cv2.LINE_AA, 4)
    (found,) = find_plain_rectangles(cv2.GaussianBlur(picture, (0, 0), 0.8), A4)
    off = [np.abs(np.roll(found.outer.corners, k, axis=0) - seen(unit)).max() for k in range(4)]
    assert min(off) < TOLERANCE


def fill(picture, corners, level):
    cv2.fillPoly(picture, [np.rint(16 * corners).astype(np.int32)], int(level), cv2.LINE_AA, 4)


def is_outline(found, corners):
    """Whether an outline is that of the corners, in any order."""
    orders = [np.roll(one, k, axis=0) for one in (corners, corners[::-1]) for k in range(4)]
    return min(np.abs(found.outer.corners - order).max() for order in orders) < 1.5 * TOLERANCE


@pytest.mark.parametrize("seed", range(8))
def test_a_print_with_a_border_is_not_taken_for_its_sheet(seed):
    rng = np.random.default_rng([7, seed])
    scene = simulate.random_scene(rng, aspect=A4.aspect)
    picture = np.full(scene.camera.image_size[::-1], 90, np.uint8)
    sheets = []
    for number, target in enumerate(scene.targets):
        corners = target.outlines()[0]
        middle, half = corners.mean(axis=0), np.ptp(corners, axis=0) / 2
        sheets.append(scene.image_points(number, corners))
        inner_half = half - rng.uniform(0.24, 0.4) * half.min()  # equal margins
        printed = middle + (corners - middle) / half * inner_half
        fill(picture, sheets[-1], 225)
        fill(picture, scene.image_points(number, printed), rng.integers(60, 180))
        for _ in range(6):
            patch = middle + rng.uniform(-0.9, 0.9, (5, 2)) * inner_half
            fill(picture, scene.image_points(number, patch), rng.integers(20, 220))
    found = find_plain_rectangles(cv2.GaussianBlur(picture, (0, 0), 0.8), A4)
    assert len(found) == 3
    assert all(any(is_outline(one, sheet) for one in found) for sheet in sheets)
