"""Minimum size of squares for a picture's size: as the error states it, and as found."""

import re

import cv2
import numpy as np
import pytest

import trisquare as ts

SIZES = [800, 1600, 2100]


def picture(size, width, *, is_plain=False):
    """Three dark squares on plain ground, or beside something equally dark."""
    pixels = np.full((size, size), 220, np.uint8)
    for turn, middle in enumerate(((0.3, 0.3), (0.7, 0.35), (0.5, 0.7))):
        angles = 0.4 + turn + np.arange(4) * np.pi / 2.0
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=1) * width / np.sqrt(2.0)
        corners += np.multiply(middle, size)
        cv2.fillPoly(pixels, [np.rint(256.0 * corners).astype(np.int32)], 40, cv2.LINE_AA, 8)
    if not is_plain:
        pixels[:, : size // 50] = 40
    pixels = cv2.GaussianBlur(pixels, (0, 0), 0.8)
    noise = np.random.default_rng(size).normal(0.0, 2.0, pixels.shape)
    return np.clip(pixels + noise, 0, 255).astype(np.uint8)


def widths_said(size):
    """The widths stated by the error: of any square, and of three that alone are dark."""
    with pytest.raises(ts.DetectionError) as error:
        ts.detect(np.full((size, size), 128, np.uint8), targets="squares")
    said = re.fullmatch(
        rf".*: no square found: .* at least (\d+) pixels wide in a picture of {size} x {size}"
        r"(?:; .* 0\.5 % of it, as three squares (\d+) pixels wide do)?"
        "; boards and tags were not searched for, which targets auto does",
        str(error.value),
    )
    return int(said[1]), int(said[2] or said[1])


def test_the_error_says_how_wide_squares_must_be_in_a_picture_of_its_size():
    said = [widths_said(size) for size in (640, 1200, 2000, 3000, 4000, 6000)]
    assert said == [(30, 30), (30, 50), (30, 90), (60, 130), (60, 170), (120, 250)]


@pytest.mark.parametrize("size", SIZES)
def test_squares_of_that_width_are_found(size):
    width, _ = widths_said(size)
    assert len(ts.detect(picture(size, width), targets="squares")) == 3


def test_squares_of_30_pixels_are_too_small_for_a_large_picture():
    with pytest.raises(ts.DetectionError, match="at least 60 pixels wide"):
        ts.detect(picture(2100, 30), targets="squares")
    with pytest.raises(ts.DetectionError, match="as three squares 90 pixels wide do"):
        ts.detect(picture(2100, 60, is_plain=True), targets="squares")


@pytest.mark.parametrize("size", SIZES)
def test_so_are_squares_that_alone_are_dark(size):
    _, width = widths_said(size)
    assert len(ts.detect(picture(size, width, is_plain=True), targets="squares")) == 3


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        ("auto", "at least 60 pixels wide, tags 60, in a picture of 3000 x 2500; if nothing else"),
        ("tags", "at least 60 pixels wide in a picture of 3000 x 2500$"),
        ("a4", "at least 60 pixels wide in a picture of 3000 x 2500$"),
    ],
)
def test_so_says_the_error_of_other_targets(targets, said):
    for function in (ts.detect, ts.calibrate):
        with pytest.raises(ts.DetectionError, match=said):
            function(np.full((2500, 3000), 128, np.uint8), targets=targets)
