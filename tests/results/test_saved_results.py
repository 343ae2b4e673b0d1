"""Results saved in files, and compared."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import edges_of, squares
from shown import blocks, page

import trisquare as ts


def calibrated(**options):
    return ts.calibrate_edges(edges_of(squares(11)), (1280, 960), **options)


RESULT = calibrated()


def test_a_result_equals_what_its_json_holds():
    again = ts.Calibration.from_json(RESULT.to_json())
    assert again == RESULT
    assert hash(again) == hash(RESULT)
    assert again.camera == RESULT.camera
    assert {RESULT: 1}[again] == 1


def test_the_last_bit_tells_results_and_cameras_apart():
    K = RESULT.camera.K.copy()
    K[0, 0] = np.nextafter(K[0, 0], np.inf)
    camera = ts.Camera(K, RESULT.camera.distortion, RESULT.camera.image_size)
    assert camera != RESULT.camera
    assert replace(RESULT, camera=camera) != RESULT
    assert replace(RESULT, rms=2 * RESULT.rms) != RESULT
    assert RESULT.camera != RESULT


def test_the_members_of_a_result_are_its_json():
    assert json.dumps(RESULT.members()) == json.dumps(json.loads(RESULT.to_json()))


def test_deviations_that_contradict_the_covariance_are_refused():
    members = json.loads(RESULT.to_json())
    members["std"]["fx"] *= 1 + 1e-8  # rounded by another program
    ts.Calibration.from_json(json.dumps(members))
    members["std"]["cx"] = 55
    with pytest.raises(ValueError, match=r'"std\.cx" is 55, but "covariance" states'):
        ts.Calibration.from_json(json.dumps(members))


def test_a_result_is_saved_whole_as_json(tmp_path):
    path = tmp_path / "camera.json"
    assert RESULT.save(path) is None
    assert path.read_text() == RESULT.to_json()
    assert ts.Calibration.load(path) == RESULT


def test_a_name_of_another_format_holds_the_camera_alone(tmp_path):
    path = tmp_path / "camera.yaml"
    RESULT.save(path)
    np.testing.assert_array_equal(ts.Camera.load(path).K, RESULT.camera.K)
    with pytest.raises(ValueError, match=r"camera\.yaml: .*JSON.*`Camera\.load` reads"):
        ts.Calibration.load(path)


def test_a_camera_without_its_uncertainties_is_no_calibration(tmp_path):
    path = tmp_path / "camera.json"
    RESULT.camera.save(path)
    expected = r"\(a camera without its uncertainties\), but 'trisquare/1' is read here"
    with pytest.raises(ValueError, match=expected):
        ts.Calibration.load(path)


def test_a_long_format_is_cited_in_part():
    stated = "trisquare-edges/1" * 1000
    with pytest.raises(ValueError, match=r'"format" is \'trisquare-.*is read here') as refusal:
        ts.PlaneEdges.from_json(f'{{"format": "{stated}"}}')
    assert len(str(refusal.value)) < 200


def test_edges_need_their_lines_and_samples_alone():
    """The example of docs/formats.md."""
    examples = (content for _, content in blocks(page("formats.md"), "json"))
    (example,) = (content for content in examples if "trisquare-edges/1" in content)
    edges = ts.PlaneEdges.from_json(example)
    assert (edges.kind, edges.image, edges.plane, edges.std) == ("square", 0, None, None)
    made = ts.PlaneEdges.square(edges.points)
    np.testing.assert_allclose(made.lines, edges.lines, atol=1e-15)
    for std in (0.1, np.float64(0.1), [np.full(3, 0.1)] * 4):
        assert ts.PlaneEdges.square(edges.points, std).std[2].tolist() == [0.1] * 3
    with pytest.raises(ValueError, match="must be positive"):
        ts.PlaneEdges.square(edges.points, std=0)
    for missing in ("lines", "points"):
        members = json.loads(example)
        del members[missing]
        with pytest.raises(ValueError, match=f'"{missing}" is missing'):
            ts.PlaneEdges.from_json(json.dumps(members))


def test_corners_beyond_every_picture_are_refused():
    members = json.loads(RESULT.to_json())
    members["planes"][0]["corners"][2][1] = -1e155
    with pytest.raises(ValueError, match=r"^corners contains coordinates beyond 1e\+09 px$"):
        ts.Calibration.from_json(json.dumps(members))


def test_a_name_that_tells_no_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"'camera\.dat' determines no camera format"):
        RESULT.save(tmp_path / "camera.dat")
    assert not list(tmp_path.iterdir())


def test_a_missing_file_is_a_file_that_is_not_found(tmp_path):
    missing = tmp_path / "missing"
    for read in (ts.calibrate, ts.detect, ts.Calibration.load, ts.Camera.load):
        with pytest.raises(FileNotFoundError, match="missing: No such file"):
            read(missing)
    with pytest.raises(ts.ImageError):
        ts.calibrate(missing)


def test_the_package_shows_its_public_names():
    assert dir(ts) == sorted(ts.__all__)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 1.9, 2.4, 3.0, np.pi - 1e-9])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -2, 0.5), (-1, -1, -1)])
def test_rotation_vectors_are_opencv_s(axis, angle):
    vector = angle * np.array(axis) / np.linalg.norm(axis)
    plane = replace(RESULT.planes[0], rotation=cv2.Rodrigues(vector)[0])
    assert plane.rvec == pytest.approx(vector, abs=2e-8 if angle > 3 else 1e-12)
    np.testing.assert_allclose(cv2.Rodrigues(plane.rvec)[0], plane.rotation, atol=2e-8)


def test_poses_are_what_opencv_projects_with():
    plane, camera = RESULT.planes[1], RESULT.camera
    corners = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    found, _ = cv2.projectPoints(corners, plane.rvec, plane.tvec, camera.K, camera.distortion)
    seen = found.reshape(-1, 2)
    assert np.abs(seen[:, None] - plane.corners[None]).max(axis=2).min(axis=1).max() < 0.01
    metric = plane.cam_from_plane(side=84.0)
    points = np.column_stack([84.0 * corners, np.ones(4)]) @ metric.T
    np.testing.assert_allclose(camera.project(points[:, :3]), seen, atol=1e-6)
    np.testing.assert_array_equal(metric[3], [0, 0, 0, 1])
    for side in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="side"):
            plane.cam_from_plane(side)


def test_a_stated_side_makes_poses_and_lengths_metric():
    result = calibrated(side="84mm")
    plane, bare = result.planes[0], RESULT.planes[0]
    assert plane.side == pytest.approx(0.084)
    np.testing.assert_array_equal(plane.translation, bare.translation)
    np.testing.assert_allclose(plane.tvec, 0.084 * bare.translation)
    np.testing.assert_allclose(plane.cam_from_plane(), bare.cam_from_plane(side=0.084))
    np.testing.assert_array_equal(plane.cam_from_plane(side=1.0), bare.cam_from_plane())
    lengths = ts.measure(plane, plane.corners, result).lengths
    np.testing.assert_allclose(lengths, 0.084, rtol=1e-3)
    again = ts.Calibration.from_json(result.to_json())
    assert again == result
    assert again.planes[0].side == plane.side


@pytest.mark.parametrize(
    ("side", "metres"),
    [
        ("8.4 cm", 0.084),
        ("1in", 0.0254),
        (" 2 m ", 2.0),
        ("28µm", 28e-6),
        ("28 μm", 28e-6),
        (0.3, 0.3),
        ("1e3um", 1e-3),
    ],
)
def test_sides_are_texts_with_a_unit_or_metres(side, metres):
    result = calibrated(side=side)
    assert result.planes[2].side == pytest.approx(metres)
    assert "large_side" not in [warning.code for warning in result.warnings]


def test_a_number_that_is_hardly_one_of_metres_is_warned_of():
    result = calibrated(side=84)
    assert result.planes[0].side == 84.0
    (warning,) = [it for it in result.warnings if it.code == "large_side"]
    assert warning.severity == "medium"
    assert 'side=84 is 84 m, since a number is in metres: for millimetres write "84mm"' in warning
    for stated in ("84m", 9.9, None):
        assert "large_side" not in [it.code for it in calibrated(side=stated).warnings]


def test_a_side_is_written_alike_wherever_it_is_given():
    result = calibrated()
    plane = result.planes[0]
    np.testing.assert_array_equal(plane.cam_from_plane("84mm"), plane.cam_from_plane(0.084))
    lengths = ts.measure(plane, plane.corners, result, side="84mm").lengths
    np.testing.assert_allclose(lengths, 0.084, rtol=1e-3)
    in_mm = ts.printed_target("flat", side=120.0)
    for side in ("120mm", "12 cm", "0.12m"):
        assert ts.printed_target("flat", side=side).pages[0].frames[0].side == pytest.approx(120)
    assert ts.printed_target("flat", side="120mm") == in_mm
    for refused in (
        lambda: plane.cam_from_plane("84"),
        lambda: ts.measure(plane, plane.corners, result, side="84"),
        lambda: ts.printed_target("flat", side="84"),
    ):
        with pytest.raises(ValueError, match=r"side needs a unit \(one of um, .*\), such as 84mm"):
            refused()


@pytest.mark.parametrize(
    ("side", "text"),
    [
        ("84", r"side needs a unit \(one of um, mm, cm, m, km, in, ft\), such as 84mm"),
        ("84 mn", "unknown unit 'mn': did you mean 'm"),
        ("long", r"a length is written 50mm \(units: um, mm, cm, m, km, in, ft\), not 'long'"),
        ("-3mm", "a length must be positive"),
        (0.0, "side must be positive"),
        (np.nan, "side contains NaN"),
    ],
)
def test_a_side_that_is_no_length_is_named(side, text):
    with pytest.raises(ValueError, match=text):
        calibrated(side=side)
