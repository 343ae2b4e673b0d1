"""Views on a cylinder and on a sphere, and views of a chosen field."""

import pickle

import cv2
import numpy as np
import pytest

import trisquare as ts
from trisquare import Camera, Panorama, Undistorter

SIZE = (640, 480)
FISHEYE = Camera([[190, 0, 325], [0, 188, 236], [0, 0, 1]], [0.03, -0.01, 0, 0], SIZE, "fisheye")
MILD = Camera([[500, 0, 325], [0, 505, 236], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], SIZE, "radial2")
# Smooth, so that positions rounded to 1/32 px hardly change a grey level.
X, Y = np.meshgrid(np.arange(640.0), np.arange(480.0))
PICTURE = (128 + 60 * np.sin(X / 30) + 60 * np.cos(Y / 25)).astype(np.float32)
PROJECTIONS = ("equirectangular", "cylinder")
views = pytest.mark.parametrize("projection", PROJECTIONS)


@pytest.mark.parametrize("camera", [FISHEYE, MILD], ids=["fisheye", "radial2"])
@views
def test_every_pixel_shows_what_the_camera_saw_along_its_ray(camera, projection):
    undistorter = Undistorter(camera, new_camera=Panorama.of(camera, projection))
    view = undistorter.new_camera
    width, height = view.image_size
    assert undistorter.undistort(PICTURE).shape == (height, width)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = view.unproject(np.column_stack([x.ravel(), y.ravel()]))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    seen = np.full((len(rays), 2), -10.0)
    can = camera.can_project(rays)
    seen[can] = camera.project(rays[can])
    expected = cv2.remap(
        PICTURE, *seen.reshape(height, width, 2).transpose(2, 0, 1).astype(np.float32), 1
    )
    valid = undistorter.valid_mask
    assert valid.mean() > 0.7
    found = undistorter.undistort(PICTURE)
    assert np.abs(found - expected)[valid].max() < 0.2
    inside = ((seen >= 0) & (seen <= np.array(SIZE) - 1)).all(axis=1).reshape(height, width)
    assert (inside == valid).mean() > 0.9999


@views
def test_the_row_and_the_column_through_the_axis_are_there(projection):
    view = Panorama.of(FISHEYE, projection)
    ends = np.array([[0.0, FISHEYE.cy], [639.0, FISHEYE.cy], [FISHEYE.cx, 0.0]])
    seen = view.project(FISHEYE.unproject(ends))
    assert seen[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert view.image_size[0] - 1 <= seen[1, 0] + 1e-9 < view.image_size[0]
    if projection == "equirectangular":
        assert seen[2, 1] == pytest.approx(0.0, abs=1e-9)
    else:  # the column covers up to 72 degrees from the axis, of which a cylinder shows 60
        assert view.cy == pytest.approx(view.focal * np.tan(np.pi / 3))
    np.testing.assert_allclose(view.project([[0, 0, 2.0]]), [[view.cx, view.cy]])


def test_upright_lines_are_straight_on_a_cylinder():
    view = Panorama.of(FISHEYE, "cylinder")
    line = np.column_stack([np.full(9, -3.0), np.linspace(-2, 2, 9), np.full(9, 0.5)])
    assert np.ptp(view.project(line)[:, 0]) < 1e-10


@views
def test_the_field_is_the_width_chosen(projection):
    view = Panorama.of(FISHEYE, projection, field=120)
    left, right = view.unproject([[0, view.cy], [2 * view.cx, view.cy]])
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(120, abs=1e-9)
    assert view.image_size[0] == pytest.approx(np.radians(120) * FISHEYE.fx, abs=1)


def test_a_pinhole_of_a_chosen_field():
    view = FISHEYE.undistorted(field=100)
    assert view.image_size == SIZE
    assert np.degrees(2 * np.arctan(0.5 * SIZE[0] / view.fx)) == pytest.approx(100)
    assert view.fy / view.fx == pytest.approx(FISHEYE.fy / FISHEYE.fx)
    axis = view.unproject([[319.5, 239.5]])
    np.testing.assert_allclose(axis, [[0, 0, 1]], atol=1e-12)


def test_beside_and_behind_the_camera():
    view = Panorama("equirectangular", 100.0, 320.0, 160.0, (641, 321))
    pixels = view.project([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(pixels[0], [320 + 50 * np.pi, 160])
    assert abs(pixels[1, 0] - 320) == pytest.approx(100 * np.pi)
    assert pixels[2, 1] == pytest.approx(160 + 50 * np.pi)
    cylinder = Panorama("cylinder", 100.0, 320.0, 160.0, (641, 321))
    assert np.isnan(cylinder.project([[0, 1, 0]])).all()


def test_a_panorama_can_be_pickled():
    view = Panorama.of(FISHEYE, "cylinder")
    again = pickle.loads(pickle.dumps(view))
    assert again == view
    assert hash(again) == hash(view)
    assert again != Panorama.of(FISHEYE)
    assert (again.focal, again.cx, again.cy) == (view.focal, view.cx, view.cy)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Panorama.of(FISHEYE, "sphere"), "unknown projection 'sphere'"),
        (lambda: Panorama.of(FISHEYE, field=0), "field must be above 0 and at most 360"),
        (lambda: Panorama.of(FISHEYE, field=float("nan")), "field"),
        (lambda: FISHEYE.undistorted(field=170), "at most 160 degrees, not 170"),
        (lambda: FISHEYE.undistorted(0.5, field=100), "balance or field, not both"),
        (lambda: Panorama("cylinder", -1.0, 0.0, 0.0, (10, 10)), "focal must be positive"),
        (
            lambda: Undistorter(
                FISHEYE, new_camera=Panorama("cylinder", 9.0, 0.0, 0.0, (40000, 9))
            ),
            "cannot be resampled",
        ),
    ],
)
def test_bad_views_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_what_is_no_view_is_refused():
    with pytest.raises(TypeError, match="new_camera must be a Camera or a Panorama, not str"):
        Undistorter(FISHEYE, new_camera="wide")
    with pytest.raises(TypeError, match="camera must be a Calibration or a Camera, not str"):
        Panorama.of("wide")


def test_undistort_takes_a_panorama():
    view = Panorama.of(FISHEYE, "cylinder", 90)
    np.testing.assert_array_equal(
        ts.undistort(PICTURE, FISHEYE, new_camera=view),
        Undistorter(FISHEYE, new_camera=view).undistort(PICTURE),
    )
