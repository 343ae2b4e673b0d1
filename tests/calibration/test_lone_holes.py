"""A frame with a covered outer outline: its hole is a square with another side."""

import cv2
import numpy as np
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.sheet_check import check_sheet
from trisquare.report.content import distance_unit, plane_texts

SIDE = 0.2


def with_covered_corner(seed):
    """Frames, with a finger over a corner of the outer outline of the last one."""
    rng = np.random.default_rng([91, seed])
    scene = simulate.random_scene(rng, kind="frame")
    picture = simulate.render(scene, rng, tone="srgb")
    outer, inner = (
        scene.image_points(2, outline)[:1].ravel() for outline in scene.targets[2].outlines()
    )
    place = outer - 0.2 * (inner - outer)
    return scene, cv2.circle(picture, tuple(int(v) for v in place), 18, 120, cv2.FILLED)


@pytest.fixture(scope="module")
def covered():
    scene, picture = with_covered_corner(0)
    return scene, ts.calibrate(picture, side=SIDE)


def test_a_stated_side_is_not_that_of_a_hole(covered):
    scene, result = covered
    kinds = [plane.kind for plane in result.planes]
    assert sorted(kinds) == ["frame", "frame", "square"]
    hole = kinds.index("square")
    assert [plane.side for plane in result.planes if plane.kind == "frame"] == [SIDE, SIDE]
    assert result.planes[hole].side is None
    (warning,) = [it for it in result.warnings if it.code == "side_unknown"]
    assert (warning.plane, warning.severity) == (hole, "medium")
    assert warning.startswith(f"plane {hole} shows the hole of a frame")
    assert abs(result.camera.fx - scene.camera.K[0, 0]) < 4 * result.std["fx"]


def test_its_distance_names_its_own_unit(covered):
    _, result = covered
    assert distance_unit(result.planes) == "m"
    texts = {plane.kind: plane_texts(plane, "m")[0] for plane in result.planes}
    assert texts["square"].endswith(" sides")
    assert float(texts["frame"]) > 0
    alone = [plane for plane in result.planes if plane.side is None]
    assert distance_unit(alone) == "sides"


def test_without_a_stated_side_there_is_nothing_to_warn_of():
    _, picture = with_covered_corner(1)
    result = ts.calibrate(picture)
    assert {plane.kind for plane in result.planes} == {"frame", "square"}
    assert "side_unknown" not in [warning.code for warning in result.warnings]


def test_light_squares_without_frames_have_the_stated_side():
    rng = np.random.default_rng([91, 2])
    picture = simulate.render(simulate.random_scene(rng), rng, tone="srgb")
    result = ts.calibrate(255 - picture, side=SIDE)
    assert [plane.side for plane in result.planes] == [SIDE] * 3


def test_the_bow_of_a_sheet_is_of_its_hole_where_that_is_measured(covered):
    _, result = covered
    check = check_sheet(result, "flat", side="200mm", page="A3")
    sides = {it.faces[0]: it.limit for it in check.findings if it.check == "flat"}
    hole = next(i for i, plane in enumerate(result.planes) if plane.kind == "square")
    others = [limit for face, limit in sides.items() if face != hole]
    np.testing.assert_allclose(sides[hole], 0.6 * np.array(others))


def test_lengths_on_a_hole_are_not_in_units_of_the_frame(covered, run, tmp_path, caplog):
    _, picture = with_covered_corner(0)
    _, result = covered
    cv2.imwrite(str(tmp_path / "photo.png"), picture)
    result.save(tmp_path / "camera.json")
    hole = next(i for i, plane in enumerate(result.planes) if plane.side is None)
    ends = [",".join(f"{value:.1f}" for value in corner) for corner in result.planes[hole].corners]
    camera = ("--camera", tmp_path / "camera.json")
    code, out, err = run("measure", tmp_path / "photo.png", *camera, *ends[:2])
    assert code == 0
    assert "(in sides; say --side)" in out
    assert "length 1 to 2: 1.00" in out
    assert f"plane {hole} shows the hole of a frame" in err
    code, out, err = run("measure", tmp_path / "photo.png", *camera, "--side", "50mm", *ends[:2])
    assert code == 0
    assert "its side is that of the hole" in err
    ts.locate(picture, result)
    assert f"plane {hole} shows the hole of a frame" in caplog.text
