"""Boards that are bent or stretched: what rows and columns share is no part of the lens."""

import numpy as np
import pytest
from quick import first_quick
from scenes import edges_of, errors_in_std, squares

import trisquare as ts
from trisquare.calibration.gather import Gathered
from trisquare.calibration.solve import solve
from trisquare.camera.settings import Settings
from trisquare_scenes.picture_faults import with_relief

SIZE = (1600, 1200)
CELLS = 8
NOISE = 0.1


def boards(rng, camera, height, stretch=0.0):
    """Return grid lines of three boards of unit cells.

    They bulge by `height` in half their extent, and their ratios of width to height differ from 1
    by `stretch` (rms).
    """
    edges = []
    for direction in (0.2, 2.3, 4.4):
        tilt, angle = rng.uniform(0.6, 0.8), direction + rng.uniform(-0.2, 0.2)
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        cross = np.cross(np.eye(3), axis)
        rotation = np.eye(3) - np.sin(tilt) * cross + (1.0 - np.cos(tilt)) * cross @ cross
        middle = np.array([6.0 * np.cos(angle + 1.0), 4.0 * np.sin(angle + 1.0), 26.0])
        half = CELLS / 2
        bulge = rng.normal(0.0, 1.0, 3) * height * half
        ratio = 1.0 + stretch * rng.normal() if stretch else 1.0

        def seen(x, y, bulge=bulge, ratio=ratio, rotation=rotation, middle=middle, half=half):
            a, b = x / half, y / half
            z = bulge @ np.array([1.5 * a * a - 0.5, a * b, 1.5 * b * b - 0.5])
            return camera.project(np.stack([ratio * x, y, z], axis=1) @ rotation.T + middle)

        lines, points = [], []
        along = np.linspace(-half, half, 60)
        for offset in np.arange(-half, half + 1.0):
            fixed = np.full_like(along, offset)
            lines += [(0.0, 1.0, -offset), (1.0, 0.0, -offset)]
            points += [seen(along, fixed), seen(fixed, along)]
        points = [p + rng.normal(0.0, NOISE, p.shape) for p in points]
        edges.append(ts.PlaneEdges(np.array(lines), points))
    return edges


@pytest.mark.parametrize("seeds", first_quick([1, 8]))
@pytest.mark.parametrize(
    ("height", "worst"), first_quick([(0.004, 3.0), (0.0, 1.0), (0.012, 12.0)])
)
def test_bent_boards_give_the_camera(height, worst, seeds):
    """Under the assumption of flat boards, the errors are 20 and 60 pixels."""
    camera = ts.Camera([[1600, 0, 810], [0, 1600, 590], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], SIZE)
    errors, stated = [], []
    for seed in range(seeds):
        result = ts.calibrate_edges(boards(np.random.default_rng(seed), camera, height), SIZE)
        errors.append([result.camera.fx - 1600, result.camera.fy - 1600])
        stated.append([result.std["fx"], result.std["fy"]])
    errors, stated = np.array(errors), np.array(stated)
    assert np.sqrt(np.mean(errors**2)) < worst
    if height < 0.01:  # above, terms of second order in the heights are not small
        assert np.sqrt(np.mean((errors / stated) ** 2)) < 2.0


def test_stretched_boards_give_the_camera_and_are_named():
    """Taken as exact, they displace fx by 9 px (rms of 40 sets), and half of them by over 4 std.

    Three boards determine little more than the camera. If their stretches agree with some camera by
    chance, they are not noticed.
    """
    camera = ts.Camera([[1600, 0, 810], [0, 1600, 590], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], SIZE)
    errors, stated, noticed = [], [], 0
    for seed in range(12):
        edges = boards(np.random.default_rng(seed), camera, 0.0, stretch=0.005)
        result = ts.calibrate_edges(edges, SIZE)
        codes = [warning.code for warning in result.warnings]
        noticed += codes[:1] == ["plane_stretched"]
        assert "lens_beyond_model" not in codes
        errors.append(
            result.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]] - camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        )
        stated.append([result.std[name] for name in ("fx", "fy", "cx", "cy")])
    errors, sigmas = np.array(errors), np.abs(np.divide(errors, stated))
    assert noticed >= 10
    assert np.sqrt(np.mean(errors[:, 0] ** 2)) < 5.0
    assert np.median(sigmas) < 1.0
    assert np.sum(sigmas.max(axis=1) > 4.0) <= 2


def oblong(rng, camera, place):
    """Return the edges of a rectangle of 1.04 to 1 that is given as a square."""
    corners = np.array([[-0.52, -0.5], [0.52, -0.5], [0.52, 0.5], [-0.52, 0.5]])
    angle = rng.uniform(0.0, 2.0 * np.pi)
    slope = 0.6 * np.array([np.cos(angle), np.sin(angle)])
    part = np.linspace(0.02, 0.98, 60)[:, None]
    sides = []
    for first, last in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        points = first + part * (last - first)
        middle = np.array([*place, 8.0])
        seen = camera.project(np.column_stack([points, points @ slope]) + middle)
        sides.append(seen + rng.normal(0.0, NOISE, seen.shape))
    return ts.PlaneEdges.square(sides)


@pytest.mark.parametrize("seed", first_quick([0, 1, 2]))
def test_beside_bent_boards_no_square_is_trusted(seed):
    """The squares agree with boards assumed flat, which have similar errors."""
    rng = np.random.default_rng(seed)
    camera = ts.Camera([[1600, 0, 810], [0, 1600, 590], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], SIZE)
    bent = boards(rng, camera, 0.01)
    figures = [*bent, *(oblong(rng, camera, place) for place in ((-3.0, 0.0), (3.0, -1.0)))]
    settings = Settings.check("ml", "radial2", (), None, (), (), ())
    gathered = Gathered(SIZE, figures)
    outcome = solve(figures, gathered, settings, choosing=True)
    assert [verdict.kept for verdict in outcome.verdicts] == [True] * 3 + [False] * 2
    assert abs(outcome.solution().camera_matrix[0, 0] - 1600) < 20


def test_frames_on_sheets_that_rise_are_as_exact_as_stated():
    """Including terms of second order in the heights, which are a hundredth of the side."""
    scene = with_relief(squares(3, kind="frame"), np.random.default_rng(3), 0.01)
    result = ts.calibrate_edges(edges_of(scene, noise=0.02), scene.camera.image_size)
    assert "its sheet rises by" in " ".join(result.warnings)
    errors = list(errors_in_std(result, scene).values())
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
