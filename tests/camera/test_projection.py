"""The uncertainty of projections: against differences, and against repeated measurements."""

import numpy as np
import pytest
from scenes import IMAGE_SIZE, camera_of, edges_of, squares

import trisquare as ts
from trisquare.camera.camera import camera_parameters

POINTS = np.array([[640.0, 480.0], [60.0, 50.0], [1240.0, 470.0], [900.0, 900.0]])


@pytest.fixture(scope="module")
def result():
    return ts.calibrate_edges(edges_of(squares(5), noise=0.2, seed=1), IMAGE_SIZE)


def moved(camera, changes):
    """The camera with some parameters changed."""
    p = camera_parameters(camera) | changes
    K = [[p["fx"], 0, p["cx"]], [0, p["fy"], p["cy"]], [0, 0, 1]]
    return ts.Camera(K, [p[n] for n in ("k1", "k2", "p1", "p2", "k3")], IMAGE_SIZE, "brown")


@pytest.mark.parametrize(
    "options",
    [{}, {"fix": "aspect"}, {"model": "brown"}, {"model": "none", "fix": "principal_point"}],
)
def test_covariance_is_that_of_the_parameters_carried_over(options):
    edges = edges_of(squares(5), noise=0.2, seed=1)
    result = ts.calibrate_edges(edges, IMAGE_SIZE, **options)
    camera, held = result.camera, camera_parameters(result.camera)
    rays = camera.unproject(POINTS)
    columns = []
    for name in result.parameters:
        h = 1e-3 * result.std[name]
        there = []
        for sign in (1, -1):
            changes = {name: held[name] + sign * h}
            if name == "fx" and options.get("fix") == "aspect":
                changes["fy"] = held["fy"] / held["fx"] * changes["fx"]
            there.append(moved(camera, changes).project(rays))
        columns.append((there[0] - there[1]) / (2 * h))
    jacobian = np.stack(columns, axis=-1)
    expected = jacobian @ result.covariance @ jacobian.transpose(0, 2, 1)
    found = result.projection_covariance(POINTS)
    # Central differences of pixels near 1e3 with steps near 1e-4 px: six digits.
    assert np.allclose(found, expected, rtol=1e-5, atol=1e-6 * expected.max())
    std = np.sqrt(np.trace(expected, axis1=1, axis2=2))
    assert np.allclose(result.projection_std(POINTS), std, rtol=1e-5)


@pytest.mark.slow
def test_std_is_the_scatter_of_repeated_measurements():
    """150 draws determine a root mean square of two coordinates to 6 %; 20 % is over 3 of that."""
    scene, draws = squares(8), 150
    truth = ts.Camera(scene.camera.K, scene.camera.distortion, IMAGE_SIZE, "brown")
    rays = truth.unproject(POINTS)
    displacements, stated = [], []
    for seed in range(draws):
        result = ts.calibrate_edges(edges_of(scene, 0.2, seed, spacing=8.0), IMAGE_SIZE)
        displacements.append(result.camera.project(rays) - POINTS)
        stated.append(result.projection_std(POINTS))
    scatter = np.sqrt((np.array(displacements) ** 2).sum(axis=2).mean(axis=0))
    predicted = np.sqrt((np.array(stated) ** 2).mean(axis=0))
    assert np.all(np.abs(predicted / scatter - 1) < 0.2), predicted / scatter


def test_map_covers_the_picture(result):
    chart = result.projection_map(step=200, rotation="held")
    assert (chart.x[0], chart.x[-1], chart.y[0], chart.y[-1]) == (0, 1279, 0, 959)
    assert chart.std.shape == (len(chart.y), len(chart.x)) == (6, 8)
    assert np.diff(chart.x).max() <= 200
    assert np.diff(chart.y).max() <= 200
    corner = result.projection_std([[chart.x[3], chart.y[2]]])[0]
    assert chart.std[2, 3] == corner > 0
    assert not chart.std.flags.writeable
    assert "8 x 6" in repr(chart)
    assert result.projection_map().std.shape == (24 + 1, 32 + 1)


def test_a_rotation_of_the_camera_is_taken_out(result):
    """A shift of the principal point is nearly a rotation; the remainder cannot be larger."""
    held, fitted = (
        result.projection_map(step=80, rotation=rotation).std for rotation in ("held", "fitted")
    )
    assert np.array_equal(result.projection_map(step=80).std, fitted)
    assert np.mean(fitted**2) < 0.8 * np.mean(held**2)
    members = {name: getattr(result, name) for name in ts.Calibration.__dataclass_fields__}
    shifting = np.zeros((len(result.parameters),) * 2)
    index = result.parameters.index("cx")
    shifting[index, index] = 1.0
    # For a pinhole of f 1100 px, the remainder of a shift is of the order of (r / f)^2 of it.
    plain = ts.Camera(result.camera.K, np.zeros(5), IMAGE_SIZE)
    shifted = ts.Calibration(**members | {"camera": plain, "covariance": shifting})
    assert shifted.projection_map(rotation="held").std == pytest.approx(1.0)
    assert shifted.projection_map().std.max() < 0.5
    assert np.sqrt(np.mean(shifted.projection_map().std ** 2)) < 0.1
    with pytest.raises(ValueError, match="rotation"):
        result.projection_map(rotation="free")


def test_the_scatter_after_the_best_rotation_is_the_map():
    """`compare` removes the best rotation; 30 draws determine the mean square to some 20 %."""
    scene, ratios = squares(4), []
    truth = camera_of(scene)
    for seed in range(30):
        result = ts.calibrate_edges(edges_of(scene, 0.2, seed, spacing=16.0), IMAGE_SIZE)
        found = ts.compare(result, truth)
        ratios.append(found.rms**2 / np.mean(result.projection_map().std ** 2))
    assert 0.5 < np.mean(ratios) < 1.7, np.mean(ratios)


def test_nothing_is_known_beyond_the_valid_radius(result):
    camera = ts.Camera(result.camera.K, result.camera.distortion, IMAGE_SIZE, valid_radius=0.3)
    members = {name: getattr(result, name) for name in ts.Calibration.__dataclass_fields__}
    narrow = ts.Calibration(**members | {"camera": camera})
    std = narrow.projection_map(step=40).std
    assert np.isinf(std[0, 0])
    assert np.isfinite(std[12, 16])
    with pytest.raises(ValueError, match=r"the point of index 1"):
        narrow.projection_std([[640, 480], [0, 0]])


def test_projections_survive_json(result):
    again = ts.Calibration.from_json(result.to_json())
    assert np.array_equal(again.projection_std(POINTS), result.projection_std(POINTS))


@pytest.mark.parametrize("step", [0, -3, np.nan, np.inf])
def test_steps_that_are_none_are_refused(result, step):
    with pytest.raises(ValueError, match="step"):
        result.projection_map(step=step)
