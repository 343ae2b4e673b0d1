"""The focal length in Exif blocks, which Pillow writes."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from trisquare.images.exif import ExifBlock, stated_focal_length
from trisquare.images.orientation import find_orientation

SIZE = (64, 48)
FOCAL, EQUIVALENT, WIDTH, HEIGHT = 0x920A, 0xA405, 0xA002, 0xA003
X_RESOLUTION, Y_RESOLUTION, UNIT = 0xA20E, 0xA20F, 0xA210
IN_FOCAL_PLANE = {WIDTH: 64, HEIGHT: 48, X_RESOLUTION: 254.0, Y_RESOLUTION: 508.0, UNIT: 2}


def encoded(tags, *, kind="JPEG", orientation=None, size=SIZE):
    exif = Image.Exif()
    if tags:
        exif[0x8769] = {t: IFDRational(v) if isinstance(v, float) else v for t, v in tags.items()}
    if orientation is not None:
        exif[0x0112] = orientation
    if kind == "TIFF":
        return exif.tobytes()[len(b"Exif\0\0") :]  # the block alone is a TIFF file without pixels
    stream = io.BytesIO()
    Image.fromarray(np.zeros(size[::-1], np.uint8)).save(stream, kind, exif=exif)
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_the_resolution_in_the_focal_plane_tells_the_size_of_a_pixel(kind):
    found = stated_focal_length(encoded({FOCAL: 5.8, **IN_FOCAL_PLANE}, kind=kind), SIZE)
    assert found.millimetres == pytest.approx(5.8)
    assert found.pixels_per_millimetre == pytest.approx((10.0, 20.0))
    assert not found.is_nominal


@pytest.mark.parametrize(("unit", "scale"), [(2, 10.0), (3, 25.4), (4, 254.0)])
def test_units_of_the_resolution(unit, scale):
    found = stated_focal_length(encoded({FOCAL: 5.8, **IN_FOCAL_PLANE, UNIT: unit}), SIZE)
    assert found.pixels_per_millimetre[0] == pytest.approx(scale)


def test_the_equivalent_for_film_stands_in_for_it():
    """A picture of 36 x 24 mm has the same diagonal; a crop factor of 2 halves it."""
    size = (360, 240)
    found = stated_focal_length(encoded({FOCAL: 25.0, EQUIVALENT: 50}, size=size), size)
    assert found.is_nominal
    assert found.pixels_per_millimetre == pytest.approx((20.0, 20.0))


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {FOCAL: 5.8},
        {EQUIVALENT: 28},
        {FOCAL: 0.0, EQUIVALENT: 28},
        {FOCAL: 5.8, EQUIVALENT: 0},
        IN_FOCAL_PLANE,
        {FOCAL: 5.8, **IN_FOCAL_PLANE, WIDTH: 128, HEIGHT: 96},  # the picture was reduced since
        {FOCAL: 5.8, X_RESOLUTION: 254.0},
        {FOCAL: 5.8, **IN_FOCAL_PLANE, UNIT: 9},
    ],
)
def test_nothing_is_said_where_something_is_missing(tags):
    assert stated_focal_length(encoded(tags), SIZE) is None


def test_the_orientation_is_found_beside_it():
    tag = find_orientation(encoded({FOCAL: 5.8}, orientation=6))
    assert tag.turn == "turned clockwise by 90 degrees"
    assert find_orientation(encoded({FOCAL: 5.8})) is None


WHOLE = encoded({FOCAL: 5.8, **IN_FOCAL_PLANE, EQUIVALENT: 28}, orientation=3)
BLOCK = ExifBlock.find(WHOLE).start


@given(st.integers(0, 220), st.binary(min_size=1, max_size=8), st.integers(0, 300))
def test_damaged_blocks_are_harmless(at, inserted, cut):
    """The result is a number or None."""
    damaged = WHOLE[: BLOCK + at] + inserted + WHOLE[BLOCK + at + len(inserted) :]
    for each in (damaged, damaged[: len(damaged) - cut], damaged[: BLOCK + cut]):
        found = stated_focal_length(each, SIZE)
        if found is not None:
            assert np.isfinite([found.millimetres, *found.pixels_per_millimetre]).all()
            assert min(found.millimetres, *found.pixels_per_millimetre) > 0
        find_orientation(each)
