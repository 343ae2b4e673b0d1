"""The gap between tags, from edges of grid lines alone."""

import numpy as np
import pytest

from trisquare.measurement.grid_gaps import LineSamples, measured_gap

TAGS = 5
HOMOGRAPHY = np.array([[95.0, 20.0, 200.0], [-15.0, 80.0, 300.0], [0.05, -0.03, 1.0]])
NOISE = 0.03  # pixels
LENS = 0.25


def grid_lines(gap, *, seed, tags=TAGS, hidden=0.0):
    """Samples on the sides of tags and of the dark squares between them, distorted by a lens."""
    rng = np.random.default_rng(seed)
    numbers = np.arange(2 * tags)
    places = numbers // 2 * (1.0 + gap) + numbers % 2
    lines = []
    for is_row in (True, False):
        for number in numbers:
            cells = np.repeat(numbers[:-1], 4)
            share = np.tile([0.2, 0.4, 0.6, 0.8], len(numbers) - 1)
            along = places[cells] + share * (places[cells + 1] - places[cells])
            across = np.full_like(along, places[number])
            plane = np.stack([along, across] if is_row else [across, along], axis=1)
            mapped = np.column_stack([plane, np.ones(len(plane))]) @ HOMOGRAPHY.T
            points = mapped[:, :2] / mapped[:, 2:]
            off = (points - 400.0) / 800.0
            points = 400.0 + 800.0 * off * (1.0 - LENS * (off**2).sum(axis=1, keepdims=True))
            points += NOISE * rng.standard_normal(points.shape)
            seen = rng.uniform(size=len(points)) >= hidden
            lines.append(LineSamples(is_row, int(number), points[seen], cells[seen]))
    return lines


@pytest.mark.parametrize("gap", [0.2, 0.3, 0.35])
def test_a_usual_gap_is_found_exactly_where_corners_are_hundredths_off(gap):
    for seed in range(5):
        found = measured_gap(grid_lines(gap, seed=seed), gap + 0.035)
        assert found == pytest.approx(gap, abs=1e-12)


def test_an_unusual_gap_is_not_taken_for_a_usual_one():
    found = [measured_gap(grid_lines(0.28, seed=seed), 0.3) for seed in range(5)]
    np.testing.assert_allclose(found, 0.28, atol=1e-3)


def test_hidden_edges_leave_the_gap_of_the_others():
    found = measured_gap(grid_lines(0.33, seed=1, hidden=0.3), 0.31)
    assert found == pytest.approx(0.33, abs=2e-3)


def test_few_edges_leave_the_gap_that_corners_show():
    assert measured_gap(grid_lines(0.3, seed=2, tags=2), 0.32) == 0.32
    assert measured_gap([], 0.32) == 0.32
