"""Answers to natural mistakes."""

import inspect
import typing

import numpy as np
import pytest

import trisquare as ts
from trisquare.camera.lens_models import COEFFICIENTS, MODELS

MEASURED = ts.Measurement(np.zeros((2, 2)), np.eye(4))


@pytest.fixture(scope="module")
def result():
    lens = ts.Camera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], np.zeros(5), (1280, 960))
    plane = ts.Plane("square", 0, np.zeros((4, 2)), np.eye(3), [0, 0, 3], 0.01, 100)
    told = ((), "ml", None, (), "edges")
    return ts.Calibration(lens, {}, np.zeros((0, 0)), (), (plane,), 0.01, 1.0, *told)


def test_a_name_of_another_class_is_answered_with_the_own_one(result):
    with pytest.raises(AttributeError, match="no attribute 'picture': did you mean 'image'"):
        _ = result.planes[0].picture
    with pytest.raises(AttributeError, match=r"'tilt': did you mean 'np\.degrees\("):
        _ = result.planes[0].tilt
    with pytest.raises(AttributeError, match=r"'fx': did you mean 'camera\.fx'"):
        _ = result.fx
    with pytest.raises(AttributeError, match=r"'distCoeffs': did you mean 'camera\.distortion'"):
        _ = result.distCoeffs
    with pytest.raises(AttributeError, match=r"'rvecs': did you mean 'planes\[0\]\.rvec'"):
        _ = result.rvecs
    with pytest.raises(AttributeError, match=r"'width': did you mean 'image_size\[0\]'"):
        _ = result.camera.width
    with pytest.raises(AttributeError, match=r"'warnings': did you mean 'extrapolation'"):
        _ = MEASURED.warnings
    with pytest.raises(AttributeError, match=r"no attribute 'nonsense'$"):
        _ = result.nonsense


@pytest.mark.parametrize("owner", ["result", "result.planes[0]", "result.camera", "MEASURED"])
def test_the_names_that_are_meant_are_there(owner, result):
    own = eval(owner)
    assert own.other_names
    for name, meant in own.other_names.items():
        assert not hasattr(own, name)
        # It fails without such an attribute; a formula names the plane itself.
        eval(meant if "plane." in meant else f"own.{meant}", {"np": np, "own": own, "plane": own})


@pytest.mark.parametrize(
    ("call", "advice"),
    [
        (lambda _: ts.calibrate("a.jpg", "b.jpg"), r"as one list, calibrate\(\[first, second\]\)"),
        (
            lambda _: ts.calibrate("a.jpg", max_seconds=20),
            r"'max_seconds': calibrate_many limits time and memory",
        ),
        (lambda _: ts.calibrate("a.jpg", nonsense=20), r"argument 'nonsense'$"),
        (lambda it: ts.measure(it, [[1, 2], [3, 4]]), r"measure\(result\.planes\[0\], points"),
        (lambda it: ts.undistort("a.jpg", it, "out.png"), r"cv2\.imwrite"),
    ],
)
def test_a_wrong_call_is_answered_with_advice(call, advice, result):
    with pytest.raises(TypeError, match=advice):
        call(result)


def test_an_error_within_a_call_is_left_alone(result):
    with pytest.raises(TypeError, match=r"not int$"):
        ts.measure(0, [[1, 2], [3, 4]], result)


@pytest.mark.parametrize("name", ts.__all__)
def test_annotations_are_read_at_run_time(name):
    """Programs that make forms or command lines from functions do so."""
    public = getattr(ts, name)
    called = vars(public) if inspect.isclass(public) else {name: public}
    for own, one in called.items():
        function = getattr(one, "__func__", getattr(one, "fget", one))
        if inspect.isfunction(function) and (own == "__init__" or own[0] != "_"):
            typing.get_type_hints(function)


def test_the_names_of_models_are_the_same_for_type_checkers():
    assert list(MODELS) == list(COEFFICIENTS)
