"""Camera, Plane and Calibration: frozen, checked, exact through JSON and pickle."""

import copy
import json
import math
import pickle
from dataclasses import FrozenInstanceError, is_dataclass

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import trisquare as ts
from trisquare._core import __version__
from trisquare.calibration.known_camera import known_camera
from trisquare.results.calibration import Calibration, Camera
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.plane import Plane

K = [[900.5, 0, 640.25], [0, 905.125, 470], [0, 0, 1]]
DISTORTION = [-0.2, 0.05, 0, 0, 0]


def rotation(seed=1):
    axes = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return axes * np.sign(np.linalg.det(axes))


def plane(**change):
    arguments = {
        "kind": "square",
        "image": 0,
        "corners": [[10.1, 20], [110, 21], [111, 130], [9, 128]],
        "rotation": rotation(),
        "translation": [0.1, 0.2, 4.3],
        "rms": 0.0123,
        "samples": 400,
    }
    return Plane(**{**arguments, **change})


def calibration(**change):
    arguments = {
        "camera": Camera(K, DISTORTION, (1280, 960)),
        "std": {"fx": 0.1 + 0.2, "cx": 0.4, "cy": 0.5, "fy": 0.1 + 0.2},
        "covariance": np.diag([0.09, 0.16, 0.25]) + 1e-17,
        "parameters": ("fx", "cx", "cy"),
        "planes": (plane(), plane(kind="frame")),
        "rms": 0.011,
        "noise_scale": 1.02,
        "warnings": ("planes 0 and 1 are \u2018close\u2019",),
        "method": "ml",
        "tone": "srgb",
        "fixed": ("aspect", "distortion"),
        "stage": "pixels",
    }
    return Calibration(**{**arguments, **change})


def arrays_of(result):
    yield from (result.covariance, result.camera.K, result.camera.distortion)
    for each in result.planes:
        yield from (each.corners, each.rotation, each.translation)


@pytest.mark.parametrize("name", ["K", "fx", "no_such_name"])
def test_every_name_of_a_frozen_object_is_refused_alike(name):
    with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{name}'"):
        setattr(calibration().camera, name, 1.0)
    with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{name}'"):
        delattr(calibration().camera, name)


def test_so_does_every_public_class_of_them():
    kinds = [getattr(ts, name) for name in ts.__all__]
    frozen = [kind for kind in kinds if isinstance(kind, type) and is_dataclass(kind)]
    assert {ts.Camera, ts.Job, ts.PlaneEdges} < set(frozen)
    for kind in frozen:
        with pytest.raises(FrozenInstanceError):
            object.__new__(kind).no_such_name = 1


def test_arrays_are_frozen_float64_copies():
    source = np.array(K)
    camera = Camera(source, DISTORTION, (1280, 960))
    source[0, 0] = 1
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (900.5, 905.125, 640.25, 470)
    for array in arrays_of(calibration()):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(TypeError, match="read-only"):
        calibration().std["fx"] = 1
    with pytest.raises(TypeError, match="read-only"):
        calibration().std.update(fx=1)
    with pytest.raises(AttributeError, match="cannot assign"):
        CalibrationWarning("a text").severity = "low"
    with pytest.raises(AttributeError):
        calibration().rms = 1


def test_deviations_are_kept_as_any_dictionary_is():
    std = calibration().std
    pickled = pickle.loads(pickle.dumps(std))
    for again in (json.loads(json.dumps(std)), pickled, copy.deepcopy(std)):
        assert again == std == dict(std)
    with pytest.raises(TypeError, match="read-only"):
        pickled["fx"] = 1


@pytest.mark.parametrize("coefficients", [(0, 0, 0), (0.1, 0.02, 0), (-0.2, 0.05, 0.01)])
def test_a_monotonic_distortion_has_no_valid_radius(coefficients):
    k1, k2, k3 = coefficients
    assert Camera(K, [k1, k2, 0, 0, k3], (640, 480)).valid_radius is None


@given(k1=st.floats(-0.9, 0.5), k2=st.floats(-0.5, 0.5), k3=st.floats(-0.5, 0.5))
def test_the_valid_radius_is_where_the_distortion_turns(k1, k2, k3):
    def slope(radius):
        s = radius * radius
        return 1 + 3 * k1 * s + 5 * k2 * s**2 + 7 * k3 * s**3

    radius = Camera(K, [k1, k2, 0, 0, k3], (640, 480)).valid_radius
    assume(radius is None or radius < 1e3)
    within = np.linspace(0, 50 if radius is None else radius, 2001)[:-1]
    assert slope(within).min() > -1e-9
    if radius is not None:
        scale = 1 + abs(3 * k1) * radius**2 + abs(5 * k2) * radius**4 + abs(7 * k3) * radius**6
        assert abs(slope(radius)) < 1e-7 * scale


def test_a_given_valid_radius_is_kept():
    assert Camera(K, DISTORTION, (640, 480), valid_radius=0.75).valid_radius == 0.75
    assert Camera(K, [-0.3, 0, 0, 0, 0], (640, 480)).valid_radius == pytest.approx(0.9**-0.5)
    assert Camera(K, [-0.3, 0, 0, 0, 0], (640, 480), valid_radius=math.inf).valid_radius is None


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"K": np.eye(2)}, ValueError, "K must have shape"),
        ({"K": [[1, 0, 0], [0.1, 1, 0], [0, 0, 1]]}, ValueError, "K must be"),
        ({"K": np.diag([-1, 1, 1])}, ValueError, "positive"),
        ({"K": np.full((3, 3), np.nan)}, ValueError, "K contains NaN"),
        ({"K": np.full((3, 3), "1")}, TypeError, "K must contain real"),
        ({"distortion": [0, 0, 0, 0]}, ValueError, "distortion"),
        ({"distortion": [0, 0, 0, 0, np.inf]}, ValueError, "distortion"),
        ({"image_size": (640,)}, ValueError, "image_size"),
        ({"image_size": 640}, TypeError, "image_size"),
        ({"image_size": (640, 0)}, ValueError, "image_size"),
        ({"image_size": (640.0, 480)}, TypeError, "image_size"),
        ({"model": "fishy"}, ValueError, "model"),
        ({"valid_radius": -1}, ValueError, "valid_radius"),
        ({"valid_radius": math.nan}, ValueError, "valid_radius"),
    ],
)
def test_a_wrong_camera_is_refused(change, error, message):
    arguments = {"K": K, "distortion": DISTORTION, "image_size": (640, 480), **change}
    with pytest.raises(error, match=message):
        Camera(**arguments)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"rotation": -rotation()}, ValueError, "rotation"),
        ({"rotation": rotation() * 1.001}, ValueError, "rotation"),
        ({"rotation": rotation() * 1e200}, ValueError, "rotation"),
        ({"corners": np.zeros((3, 2))}, ValueError, "corners"),
        ({"translation": [0, 0, np.nan]}, ValueError, "translation"),
        ({"rms": -0.1}, ValueError, "rms"),
        ({"samples": 1.5}, TypeError, "samples"),
        ({"samples": -1}, ValueError, "samples"),
        ({"kind": 3}, TypeError, "kind"),
    ],
)
def test_a_wrong_plane_is_refused(change, error, message):
    with pytest.raises(error, match=message):
        plane(**change)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"camera": None}, TypeError, "camera"),
        ({"planes": [None]}, TypeError, "planes"),
        ({"covariance": np.eye(4)}, ValueError, "covariance"),
        ({"std": {"fx": 1.0, "cx": 1.0}}, ValueError, "cy"),
        ({"std": {"fx": math.nan, "cx": 1.0, "cy": 1.0}}, ValueError, "fx"),
        ({"parameters": "fx"}, TypeError, "parameters"),
        ({"parameters": ("fx", "cx", "fx")}, ValueError, "parameters has fx twice"),
        ({"rms": math.inf}, ValueError, "rms"),
        ({"warnings": "odd"}, TypeError, "warnings"),
        ({"method": None}, TypeError, "method"),
        ({"method": "zhang"}, ValueError, "unknown method 'zhang': choose one of ml, linear"),
        (
            {"fixed": ("aspct",)},
            ValueError,
            "unknown member of fixed 'aspct': did you mean 'aspect'",
        ),
        ({"tone": True}, TypeError, "tone"),
    ],
)
def test_a_wrong_calibration_is_refused(change, error, message):
    with pytest.raises(error, match=message):
        calibration(**change)


def assert_same(first, second):
    assert first.to_json() == second.to_json()
    for a, b in zip(arrays_of(first), arrays_of(second), strict=True):
        np.testing.assert_array_equal(a, b)
        assert not b.flags.writeable
    assert dict(first.std) == dict(second.std)
    for name in ("parameters", "rms", "noise_scale", "warnings", "method", "tone", "fixed"):
        assert getattr(first, name) == getattr(second, name)
    assert (first.stage, first.software) == (second.stage, second.software)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"tone": None},
        {"tone": 2.2},
        {"camera": Camera(K, [-0.3, 0.01, 1e-3, -1e-4, 0], (640, 480), "brown")},
        {"parameters": (), "std": {}, "covariance": np.empty((0, 0)), "planes": ()},
        {"software": "0.0.1"},
    ],
)
def test_json_and_pickle_are_exact(change):
    result = calibration(**change)
    assert_same(result, Calibration.from_json(result.to_json()))
    assert_same(result, pickle.loads(pickle.dumps(result)))
    assert_same(result, copy.deepcopy(result))


def test_planes_and_edges_are_equal_by_value():
    sides = [[[0, 0], [9, 0]], [[9, 0], [9, 9]], [[9, 9], [0, 9]], [[0, 9], [0, 0]]]
    for one, other in (
        (plane(), plane(rms=0.5)),
        (plane(), plane(rotation=rotation(2))),
        (ts.PlaneEdges.square(sides), ts.PlaneEdges.square(sides, polarity=1)),
        (ts.PlaneEdges.square(sides, 0.1), ts.PlaneEdges.square(sides, np.nextafter(0.1, 1))),
    ):
        for same in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
            assert same == one
            assert hash(same) == hash(one)
        assert one != other
        assert one != "another class"
        assert len({one, copy.deepcopy(one), other}) == 2


@given(values=st.lists(st.floats(1e-300, 1e300), min_size=4, max_size=4), seed=st.integers(0, 99))
def test_every_float_survives_json(values, seed):
    fx, fy, cx, rms = values
    camera = Camera([[fx, 0, cx], [0, fy, -cx], [0, 0, 1]], DISTORTION, (640, 480))
    result = calibration(camera=camera, rms=rms, planes=(plane(rotation=rotation(seed)),))
    assert_same(result, Calibration.from_json(result.to_json()))


def test_the_json_is_the_documented_format():
    members = json.loads(calibration().to_json())
    assert set(members) == {
        *("format", "software", "method", "stage", "tone", "fixed", "image_size", "camera"),
        *("std", "parameters", "covariance", "rms_px", "noise_scale", "planes", "warnings"),
    }
    assert members["format"] == "trisquare/1"
    assert members["software"] == __version__
    assert members["image_size"] == [1280, 960]
    assert members["camera"] == {
        **{"model": "radial2", "fx": 900.5, "fy": 905.125, "cx": 640.25, "cy": 470.0},
        **{"distortion": [-0.2, 0.05, 0.0, 0.0, 0.0], "valid_radius": None},
    }
    assert members["fixed"] == ["aspect", "distortion"]
    assert members["std"]["fy"] == members["std"]["fx"]
    assert set(members["planes"][0]) == {
        *("kind", "image", "corners", "rotation", "translation", "rms_px", "samples"),
    }


def test_keys_of_a_later_version_are_ignored():
    members = json.loads(calibration().to_json())
    members["later"] = members["camera"]["later"] = members["planes"][0]["later"] = {"a": [1]}
    assert_same(calibration(), Calibration.from_json(json.dumps(members)))


def paths_of(members, path=()):
    for key, value in members.items():
        yield (*path, key)
        if isinstance(value, dict) and key != "std":
            yield from paths_of(value, (*path, key))


MEMBERS = json.loads(calibration().to_json())
PATHS = [
    *paths_of(MEMBERS),
    *(("planes", 1, key) for key in MEMBERS["planes"][1]),
    ("std", "fx"),
]


def changed(path, change):
    members = copy.deepcopy(MEMBERS)
    parent = members
    for key in path[:-1]:
        parent = parent[key]
    change(parent, path[-1])
    return json.dumps(members)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: ".".join(map(str, path)))
def test_a_missing_or_wrong_member_is_named(path):
    key = path[-1]
    with pytest.raises(ValueError, match=key):
        Calibration.from_json(changed(path, lambda parent, name: parent.pop(name)))
    nullable = key in ("tone", "valid_radius")
    for wrong in (*(() if nullable else (None,)), {"a": "b"}, [[[1]]], True, math.nan, -math.inf):

        def replace(parent, name, wrong=wrong):
            parent[name] = wrong

        text = changed(path, replace)
        named = "NaN|Infinity" if isinstance(wrong, float) else key
        if wrong == {"a": "b"} and key == "std":
            named = "std.a"
        if wrong == {"a": "b"} and key == "camera":
            named = "camera.fx"
        with pytest.raises(ValueError, match=named):
            Calibration.from_json(text)


@pytest.mark.parametrize(("place", "value"), [((0, 1), 0.01), ((1, 1), -0.16), ((1, 2), math.pi)])
def test_a_matrix_that_is_no_covariance_is_refused(place, value):
    row, column = place

    def replace(parent, name):
        parent[name][row][column] = value

    with pytest.raises(ValueError, match='"covariance" must be symmetric and positive'):
        Calibration.from_json(changed(("covariance",), replace))


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "3", "null", '{"format": "trisquare/2"}', "[" * 9999]
)
def test_what_is_no_result_is_refused(text):
    with pytest.raises(ValueError, match=r"JSON|format|Expecting"):
        Calibration.from_json(text)


def test_overflowing_numbers_are_refused():
    text = calibration().to_json().replace('"rms_px": 0.011', '"rms_px": 1e999')
    with pytest.raises(ValueError, match="rms_px"):
        Calibration.from_json(text)


def test_repr_is_for_people():
    text = repr(calibration())
    assert text.splitlines() == [
        "Calibration of a 1280 x 960 camera (radial2, ml, from the pixels stage)",
        "  fx        900.50  std 0.30",
        "  fy        905.12  std 0.30",
        "  cx        640.25  std 0.40",
        "  cy        470.00  std 0.50",
        "  k1          -0.2  fixed",
        "  k2          0.05  fixed",
        "  rms 0.011 px over 2 planes, noise scale 1.02",
        "  warning (medium): planes 0 and 1 are \u2018close\u2019 [other]",
    ]
    assert "fx 900.5" in repr(calibration().camera)
    assert "400 samples" in repr(plane())


def test_warnings_keep_their_codes_and_older_files_are_read():
    warning = CalibrationWarning("plane 1 is odd", "plane_disagrees", "high", 1)
    result = calibration(warnings=(warning, "a plain text"))
    for again in (
        Calibration.from_json(result.to_json()),
        pickle.loads(pickle.dumps(result)),
    ):
        assert again.warnings == ("plane 1 is odd", "a plain text")
        codes = [(own.code, own.severity, own.plane) for own in again.warnings]
        assert codes == [("plane_disagrees", "high", 1), ("other", "medium", None)]
    members = json.loads(result.to_json())
    assert members["warnings"][0] == {
        "code": "plane_disagrees",
        "severity": "high",
        "plane": 1,
        "text": "plane 1 is odd",
    }
    members["warnings"] = ["of an older version"]
    assert Calibration.from_json(json.dumps(members)).warnings == ("of an older version",)
    with pytest.raises(ValueError, match="severity"):
        CalibrationWarning("x", "y", "enormous")


def test_files_of_windows_editors_and_damaged_ones(tmp_path):
    """They begin with a byte order mark; a file that is no calibration has its own error."""
    path, result = tmp_path / "camera.json", calibration()
    path.write_text(result.to_json(), "utf-8-sig")
    assert Calibration.load(path) == result
    assert known_camera(path) == result
    for text, reason in (("", "not JSON"), ("[" * 10**6, "nested"), ("[1]", "must be an object")):
        path.write_text(text)
        with pytest.raises(ValueError, match=reason):
            Calibration.load(path)
