"""Which pictures are reported as taken by another camera."""

from types import SimpleNamespace

import pytest

from trisquare.calibration.select import FALSE_PLANE_REASON
from trisquare.calibration.unexplained_pictures import unexplained_pictures


def plane(image, kind="chessboard", rejection=None):
    return SimpleNamespace(image=image, kind=kind, rejection=rejection)


BOARDS = [plane(image) for image in range(4)]


@pytest.mark.parametrize(
    ("displacements", "expected"),
    [
        ((0.0, 0.0, 0.004, 0.03), []),
        ((0.1, 0.2, 0.15, 0.9), []),
        ((0.004, 0.3, 0.006, 0.2), [1, 3]),
        ((0.004, 0.3, 0.006, 0.005), []),  # one board may be bent
    ],
)
def test_boards_that_seem_bent_far_more_than_the_flattest_are_of_another_camera(
    displacements, expected
):
    assert unexplained_pictures(BOARDS, [], displacements) == expected


def test_planes_that_are_left_out_count_where_their_pictures_have_no_other():
    outlier, false = plane(4, rejection="outlier"), plane(5)
    false.reason = FALSE_PLANE_REASON
    displacements = [0.01] * 5
    assert unexplained_pictures([*BOARDS, outlier], [], displacements) == []
    assert unexplained_pictures([*BOARDS, outlier], [false], displacements) == [4, 5]
    false.reason = "it is cut by the picture's border"
    assert unexplained_pictures([*BOARDS, outlier], [false], displacements) == []
    beside = plane(3, rejection="outlier")
    false.reason = FALSE_PLANE_REASON
    assert unexplained_pictures([*BOARDS, beside], [false], displacements) == []


def test_squares_that_are_left_out_need_to_be_three():
    used = [plane(0, "square") for _ in range(3)]
    others = [plane(1, "square") for _ in range(3)]
    for other in others:
        other.reason = FALSE_PLANE_REASON
    assert unexplained_pictures(used, others[:2], [0.01] * 3) == []
    assert unexplained_pictures(used, others, [0.01] * 3) == [1]
