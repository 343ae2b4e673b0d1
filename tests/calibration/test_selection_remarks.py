"""Warnings about planes that the choice among candidates drops."""

from types import SimpleNamespace

import numpy as np
import pytest

from trisquare.calibration.select import chosen_planes
from trisquare.simulate.scene import rectangle


def outcome_and_figures(kind):
    """Three planes of a kind that are kept, and a larger square that is not."""
    figures = [SimpleNamespace(plane=i, kind=kind, image=0) for i in range(3)]
    figures.append(SimpleNamespace(plane=3, kind="square", image=0))
    verdicts = [SimpleNamespace(figure=i, kept=i < 3, residual=None) for i in range(4)]
    quads = {i: 200.0 * i + rectangle(*[20.0 if i < 3 else 60.0] * 2) for i in range(4)}
    return SimpleNamespace(verdicts=verdicts, doubt=None), figures, quads


@pytest.mark.parametrize(
    ("kind", "severity"), [("square", "medium"), ("frame", "medium"), ("tag", "low")]
)
def test_a_larger_square_is_doubted_beside_tags_that_agree(kind, severity):
    chosen = chosen_planes(*outcome_and_figures(kind))
    assert [warning.severity for warning in chosen.warnings] == [severity]
    assert chosen.warnings[0].code == "larger_rejected"
    assert len(chosen.figures) == 3
    np.testing.assert_array_equal(chosen.rejected[0].corners.mean(axis=0), [600.0, 600.0])


def test_planes_of_several_pictures_may_be_of_several_zooms():
    outcome, figures, quads = outcome_and_figures("square")
    figures[3].image = 1
    (warning,) = chosen_planes(outcome, figures, quads).warnings
    assert str(warning).endswith("Were all pictures taken with one camera, zoom and focus?")
    figures[3].image = 0
    (warning,) = chosen_planes(outcome, figures, quads).warnings
    assert "zoom" not in str(warning)
