"""Files that people write or damage: outlines, names of targets, and results, as any JSON."""

import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trisquare as ts
from trisquare._support.json_members import JsonFields
from trisquare._support.records import record_from_members, record_members
from trisquare.detection.annotations.formats import annotated_pictures
from trisquare.detection.kinds import TargetKinds
from trisquare.results.rejected import Rejected

many = settings(max_examples=60, derandomize=True)

numbers = st.one_of(
    st.integers(-3, 2000),
    st.floats(-100.0, 2000.0),
    st.sampled_from([np.nan, np.inf, 1e308, 2**70]),
)
leaves = st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=6))
points = st.lists(st.lists(numbers, min_size=2, max_size=2), max_size=6)
values = st.recursive(leaves, lambda inner: st.lists(inner, max_size=5), max_leaves=12) | points


CORNERS = [[100, 100], [200, 110], [190, 210], [95, 200]]

shapes = st.one_of(
    st.dictionaries(st.sampled_from(["corners", "sides", "polygon", "inner"]), values, min_size=1),
    values.map(lambda inner: {"corners": CORNERS, "inner": {"corners": inner}}),
)
own = st.builds(
    lambda squares, rest: {"format": "trisquare-outlines/1", **squares, **rest},
    st.one_of(st.just({}), st.lists(shapes, max_size=3).map(lambda some: {"squares": some})),
    st.dictionaries(st.sampled_from(["index", "file", "width", "height", "pictures"]), values),
)
labelme = st.fixed_dictionaries(
    {
        "shapes": st.lists(
            st.fixed_dictionaries(
                {
                    "points": values,
                    "shape_type": st.sampled_from(["polygon", "linestrip", 3]),
                    "group_id": leaves,
                }
            ),
            max_size=3,
        ),
        "imagePath": leaves,
        "imageWidth": leaves,
        "imageHeight": leaves,
    }
)


@many
@given(st.one_of(values, own, labelme))
def test_any_outlines_are_read_or_refused(members):
    with suppress(ValueError):
        for picture in annotated_pictures(members):
            repr(picture)


@many
@given(
    st.one_of(
        st.text(max_size=30),
        st.builds(
            "{}:{}x{}:{}{}".format,
            st.sampled_from(["charuco", "aruco", "apriltag", "chessboard", "tags"]),
            st.integers(-1, 99999),
            st.integers(-1, 99999),
            st.one_of(st.floats(), st.sampled_from([".", "", "0.75", "1e3"])),
            st.sampled_from(["", ":", ":6X6_250", ":36h11", ":nothing"]),
        ),
    )
)
def test_any_name_of_targets_is_known_or_refused(text):
    with suppress(ValueError, FileNotFoundError):  # ".json" names a file
        assert isinstance(TargetKinds.parse(text), TargetKinds)


REJECTED = Rejected("square", 0, np.array([[1.0, 2.0], [9.0, 2.0], [9.0, 8.0], [1.0, 8.0]]), "why")


@many
@given(
    st.sampled_from(sorted(record_members(REJECTED))),
    st.one_of(values, st.just(...)),
)
def test_a_damaged_rejected_square_is_refused_or_whole(key, value):
    members = record_members(REJECTED)
    if value is ...:
        del members[key]
    else:
        members[key] = value
    with suppress(ValueError):
        candidate = record_from_members(Rejected, JsonFields(members, "rejected"))
        # Accepted values can be written and read again.
        text = json.dumps(record_members(candidate), allow_nan=False)
        again = record_from_members(Rejected, JsonFields(json.loads(text), "rejected"))
        np.testing.assert_array_equal(again.corners, candidate.corners)


def grille(size, pitch):
    picture = np.full((size, size), 230, np.uint8)
    for offset in (0, 1):
        picture[offset::pitch] = 20
        picture[:, offset::pitch] = 20
    return picture


def checkerboard(size, cell):
    return ((np.indices((size, size)) // cell).sum(axis=0) % 2 * 255).astype(np.uint8)


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((1, 1), np.uint8),
        np.tile(np.arange(3000, dtype=np.uint16).astype(np.uint8), (2, 1)),
        checkerboard(500, 1),
        checkerboard(300, 8),
        grille(400, 8),
    ],
    ids=["a pixel", "two rows", "pixels", "cells", "grille"],
)
def test_pictures_full_of_structure_end_in_an_error(picture):
    with pytest.raises((ts.DetectionError, ts.NotEnoughPlanesError, ts.DegenerateGeometryError)):
        ts.calibrate(picture)
