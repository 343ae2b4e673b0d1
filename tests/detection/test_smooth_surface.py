"""A cubic surface fitted to a bent sheet, robust against a few wrong points."""

from __future__ import annotations

import numpy as np

from trisquare.detection.sheets.smooth_surface import MIN_POINTS, SmoothSurface


def test_a_surface_follows_a_bent_sheet_and_no_wrong_points():
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    x, y = (grid - 2.5).T
    seen = np.stack([40.0 * x * (1 - 0.01 * (x**2 + y**2)), 35.0 * y + 0.5 * x * y], axis=1)
    wrong = seen.copy()
    wrong[[7, 20]] += [[9.0, -4.0], [-6.0, 8.0]]
    surface = SmoothSurface.of(grid, wrong)
    assert len(grid) >= MIN_POINTS
    assert np.abs(surface.at(grid) - seen).max() < 0.2
    assert surface.at(grid.reshape(5, 6, 2)).shape == (5, 6, 2)
