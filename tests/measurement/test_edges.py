"""PlaneEdges: what it accepts and refuses, and the model of a square's sides."""

import json
import pickle
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trisquare.edges import PlaneEdges
from trisquare.errors import NotEnoughDataError

# Normals inward. The second has X along side 0 and Z away from the camera for the opposite order.
CLOCKWISE_SQUARE = ((0.0, 1.0, 0.5), (-1.0, 0.0, 0.5), (0.0, -1.0, 0.5), (1.0, 0.0, 0.5))
COUNTER_CLOCKWISE_SQUARE = ((0.0, -1.0, 0.5), (-1.0, 0.0, 0.5), (0.0, 1.0, 0.5), (1.0, 0.0, 0.5))

# Clockwise on the screen, y down; a strongly foreshortened square.
CORNERS = np.array([[410.0, 100.0], [700.0, 190.0], [640.0, 520.0], [395.0, 480.0]])


def sides_between(corners, count=9, sagitta=0.0):
    """Samples of the sides, bent outward by `sagitta` of their length."""
    share = (np.arange(count) + 0.5) / count
    sides = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([end[1] - start[1], start[0] - end[0]])
        bend = 4 * sagitta * share * (1 - share)
        sides.append(start + np.outer(share, end - start) + np.outer(bend, normal))
    return sides


SIDES = sides_between(CORNERS)


def test_lines_are_normalised_and_arrays_are_frozen_copies():
    lines = np.array([[0, 3, 1], [4, 0, 2], [3, 4, 10], [-2, 0, 1]])
    points = [side.copy() for side in SIDES]
    edges = PlaneEdges(lines, points, [np.full(9, 0.1)] * 4)
    np.testing.assert_allclose(edges.lines[2], [0.6, 0.8, 2.0], rtol=0, atol=1e-15)
    points[0][:] = 0
    np.testing.assert_array_equal(edges.points[0], SIDES[0])
    for array in (edges.lines, *edges.points, *edges.std):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(AttributeError):
        edges.image = 1


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("sagitta", [-0.06, 0.0, 0.06])
def test_the_square_of_either_winding_faces_away_from_the_camera(first, sagitta):
    sides = sides_between(CORNERS, sagitta=sagitta)
    clockwise = PlaneEdges.square([sides[(first + i) % 4] for i in range(4)])
    counter = PlaneEdges.square([sides[(first - i) % 4] for i in range(4)])
    np.testing.assert_array_equal(clockwise.lines, CLOCKWISE_SQUARE)
    np.testing.assert_array_equal(counter.lines, COUNTER_CLOCKWISE_SQUARE)


@pytest.mark.parametrize("model", [CLOCKWISE_SQUARE, COUNTER_CLOCKWISE_SQUARE])
def test_the_model_square_has_x_along_side_0_from_corner_0_to_corner_1(model):
    corners = [np.cross(model[i - 1], model[i]) for i in range(4)]
    corners = np.array([corner[:2] / corner[2] for corner in corners])
    np.testing.assert_array_equal(corners[1] - corners[0], [1, 0])
    np.testing.assert_array_equal(corners.mean(axis=0), [0, 0])


def test_only_orders_of_neighbours_are_a_square():
    for order in permutations(range(4)):
        in_order = all((order[i] - order[i - 1]) % 2 == 1 for i in range(4))
        sides = [SIDES[i] for i in order]
        if in_order:
            PlaneEdges.square(sides)
        else:
            with pytest.raises(ValueError, match="not in order"):
                PlaneEdges.square(sides)


def test_crossed_order_is_found_when_opposite_sides_are_parallel():
    sides = sides_between(np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]]))
    with pytest.raises(ValueError, match="not in order"):
        PlaneEdges.square([sides[i] for i in (0, 2, 1, 3)])


def test_a_side_may_be_covered_in_part_and_in_any_order():
    rng = np.random.default_rng(5)
    sides = [rng.permutation(side[:4]) for side in SIDES]
    np.testing.assert_array_equal(PlaneEdges.square(sides).lines, CLOCKWISE_SQUARE)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"points": SIDES[:3]}, ValueError, "4 arrays"),
        (
            {"points": [*SIDES[:3], np.array([[1.0, 2.0], [3.0, np.nan]])]},
            ValueError,
            r"points\[3\] contains NaN .* the first at \[1, 1\]: leave out the samples",
        ),
        ({"points": [*SIDES[:3], np.array([[1.0, np.inf], [2, 3]])]}, ValueError, "infinite"),
        ({"points": [*SIDES[:3], np.array([[1.0, 1e10], [2, 3]])]}, ValueError, "beyond"),
        ({"points": [*SIDES[:3], np.zeros((5, 3))]}, ValueError, "shape"),
        ({"points": [*SIDES[:3], [[1, 2], [3]]]}, ValueError, "ragged"),
        ({"points": [*SIDES[:3], [["1", "2"], ["3", "4"]]]}, TypeError, "real numbers"),
        ({"points": [*SIDES[:3], SIDES[3] + 0j]}, TypeError, "real numbers"),
        ({"points": [*SIDES[:3], None]}, TypeError, "real numbers"),
        ({"points": 3}, TypeError, "sequence"),
        ({"points": [*SIDES[:3], SIDES[3][:1]]}, NotEnoughDataError, "at least 2"),
        ({"points": [*SIDES[:3], []]}, NotEnoughDataError, "at least 2"),
        ({"points": [*SIDES[:3], SIDES[3][[0, 0, 0]]]}, NotEnoughDataError, "distinct"),
        ({"std": [np.ones(9)] * 3}, ValueError, "4 arrays"),
        ({"std": [*[np.ones(9)] * 3, np.ones(8)]}, ValueError, "shape"),
        ({"std": [*[np.ones(9)] * 3, np.zeros(9)]}, ValueError, "positive"),
        ({"std": [*[np.ones(9)] * 3, np.full(9, np.nan)]}, ValueError, r"std\[3\] contains NaN"),
        ({"std": "0.1"}, TypeError, "sequence of arrays"),
        ({"lines": np.array(CLOCKWISE_SQUARE)[:3]}, NotEnoughDataError, "4 lines"),
        ({"lines": np.zeros((4, 3))}, ValueError, "direction"),
        ({"lines": np.ones((4, 2))}, ValueError, "shape"),
        ({"lines": np.full((4, 3), "1")}, TypeError, "real numbers"),
        ({"polarity": 0}, ValueError, "polarity"),
        ({"polarity": 1.0}, TypeError, "polarity"),
        ({"plane": "a"}, TypeError, "plane"),
        ({"plane": True}, TypeError, "plane"),
        ({"image": -1}, ValueError, "image"),
        ({"image": None}, TypeError, "image"),
        ({"kind": None}, TypeError, "kind"),
        ({"freedom": "free"}, ValueError, "freedom"),
        ({"freedom": None}, TypeError, "freedom"),
    ],
)
def test_what_is_wrong_is_refused_by_name(change, error, message):
    arguments = {"lines": CLOCKWISE_SQUARE, "points": SIDES, **change}
    with pytest.raises(error, match=message):
        PlaneEdges(**arguments)


def test_a_square_has_four_sides():
    with pytest.raises(NotEnoughDataError, match="4 sides"):
        PlaneEdges.square(SIDES[:3])
    with pytest.raises(ValueError, match="4 arrays"):
        PlaneEdges.square([*SIDES, SIDES[0]])


def same(first, second):
    """Return whether two sets of edges agree to the last bit."""
    assert first.std is not None
    pairs = zip(
        (first.lines, *first.points, *first.std),
        (second.lines, *second.points, *second.std),
        strict=True,
    )
    names = ("polarity", "plane", "image", "kind", "freedom")
    return all(np.array_equal(a, b) and not b.flags.writeable for a, b in pairs) and all(
        getattr(first, name) == getattr(second, name) for name in names
    )


@given(
    lines=st.lists(
        st.tuples(*[st.floats(-1e6, 1e6)] * 3).filter(lambda line: np.hypot(*line[:2]) > 1e-3),
        min_size=4,
        max_size=6,
    ),
    polarity=st.sampled_from([None, 1, -1]),
    plane=st.none() | st.integers(-5, 5),
    freedom=st.sampled_from(["auto", "fixed", "size", "similarity"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_json_and_pickle_are_exact(lines, polarity, plane, freedom, seed):
    rng = np.random.default_rng(seed)
    points = [rng.normal(scale=1e3, size=(rng.integers(2, 6), 2)) for _ in lines]
    edges = PlaneEdges(
        lines,
        points,
        [rng.uniform(1e-3, 1, len(samples)) for samples in points],
        polarity=polarity,
        plane=plane,
        image=2,
        kind="frame",
        freedom=freedom,
    )
    assert same(edges, PlaneEdges.from_json(edges.to_json()))
    assert same(edges, pickle.loads(pickle.dumps(edges)))


def test_json_without_deviations():
    assert PlaneEdges.from_json(PlaneEdges.square(SIDES).to_json()).std is None


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format", "trisquare/1", "format"),
        ("lines", [[1, 2]], "lines"),
        ("points", {}, "points"),
        ("points", [[["a", 1], [1, 2]]] * 4, r"points\[0\]"),
        ("std", 1, "std"),
        ("image", 0.5, "image"),
        ("plane", "x", "plane"),
        ("freedom", 1, "freedom"),
    ],
)
def test_wrong_json_is_refused_by_key(key, value, message):
    members = json.loads(PlaneEdges.square(SIDES).to_json())
    with pytest.raises(ValueError, match=message):
        PlaneEdges.from_json(json.dumps({**members, key: value}))


def test_repr_tells_what_a_person_asks():
    edges = PlaneEdges.square(SIDES, polarity=-1, plane=2, image=1, kind="frame")
    assert repr(edges) == (
        "<PlaneEdges frame: 4 lines with 9, 9, 9, 9 samples, light inside, plane 2, image 1>"
    )


def test_a_line_too_far_away_for_a_number_is_refused():
    lines = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2e-311, 0.0, 1.0], [0.0, 1.0, -1.0]])
    with pytest.raises(ValueError, match="infinite"):
        PlaneEdges(lines, [np.zeros((3, 2))] * 4)
