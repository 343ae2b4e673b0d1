"""The JSON Schema of `trisquare/1`: results satisfy it, it has all their keys, and it refuses."""

import json
from importlib import resources

import jsonschema
import numpy as np
import pytest
from scenes import edges_of, squares
from shown import DOCS

import trisquare as ts
from trisquare.simulate import random_scene
from trisquare_scenes.circles import circle_edges

SCHEMA = json.loads((DOCS / "trisquare-1.schema.json").read_text("utf-8"))
SIZE = (1280, 960)


def closed(schema):
    """The schema without additional keys, which readers otherwise ignore."""
    if isinstance(schema, list):
        return [closed(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    within = {key: closed(value) for key, value in schema.items()}
    return within | ({"additionalProperties": False} if "required" in schema else {})


def faults(members, schema=SCHEMA):
    """The places where an object violates the schema."""
    validator = jsonschema.Draft202012Validator(schema)
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(members)]


@pytest.fixture(scope="module")
def photograph():
    with resources.as_file(resources.files("trisquare") / "data" / "demo.png") as path:
        result = ts.calibrate([path, path], side="84mm", lines=True)
    return json.loads(result.to_json(edges=True))


def of_edges():
    """Results of many kinds, from edges alone."""
    edges = edges_of(squares(11), 0.1)
    yield ts.calibrate_edges(edges, SIZE)
    yield ts.calibrate_edges(edges, SIZE, method="linear")
    yield ts.calibrate_edges(edges, SIZE, model="auto")
    yield ts.calibrate_edges(edges, SIZE, model="fisheye", fix=["aspect", "principal_point"])
    yield ts.calibrate_edges(edges, SIZE, model="thin_prism", free="skew")
    rng = np.random.default_rng(3)
    scene = random_scene(rng, count=3)
    circles = circle_edges(scene, rng, (0.5, 0.25), noise=0.05)
    yield ts.calibrate_edges([ts.PlaneEdges.circles(own, None) for own in circles], SIZE)


def test_it_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_a_photograph_s_result_obeys_it(photograph):
    assert {"lines", "pictures", "edges", "residuals", "tone_std"} < set(photograph)
    assert photograph["planes"][0]["side_m"] == 0.084
    assert faults(photograph, closed(SCHEMA)) == []


def test_results_of_all_kinds_obey_it():
    keys = set()
    for result in of_edges():
        members = json.loads(result.to_json(edges=True))
        assert faults(members, closed(SCHEMA)) == []
        keys |= set(members).union(*members["planes"])
    assert {"alternatives", "radii", "pose_uncertainty"} < keys


def test_what_candidates_and_warnings_have_obeys_it(photograph):
    result = ts.Calibration.from_json(json.dumps(photograph))
    corners = result.planes[0].corners
    told = ts.CalibrationWarning("a text", "side_rejected", "low", plane=1)
    rejected = ts.Rejected("square", 0, corners, "too small", 1.5)
    members = json.loads(result.to_json())
    members["rejected"] = [rejected.members()]
    members["warnings"] += [{"code": told.code, "severity": "low", "plane": 1, "text": told.text}]
    assert faults(members, closed(SCHEMA)) == []
    assert faults(members | {"warnings": ["of an older version"], "new key": 1}) == []


@pytest.mark.parametrize("key", SCHEMA["required"])
def test_a_missing_key_is_a_fault(photograph, key):
    assert faults({name: value for name, value in photograph.items() if name != key})


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ("format", "trisquare/2"),
        ("image_size", [1280.5, 960]),
        ("image_size", [1280]),
        ("method", "best"),
        ("std", {"fx": -1.0}),
        ("std", {"fx": None}),
        ("covariance", [1.0, 2.0]),
        ("camera", {"fx": 900.0}),
        ("planes", [{"kind": "square"}]),
        ("warnings", [{"code": "other"}]),
        ("rms_px", None),
    ],
)
def test_a_wrong_value_is_a_fault(photograph, key, wrong):
    assert faults(photograph) == []
    assert any(f"$.{key}" in fault for fault in faults(photograph | {key: wrong}))
