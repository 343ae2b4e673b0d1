"""Lengths, angles and areas on planes: against the truth, and against their own stds."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import IMAGE_SIZE, camera_of, edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.images.orientation import with_orientation
from trisquare_scenes.broken_assumptions import bent

# A triangle on the first plane, in sides; it is within the picture of scene 5.
TRIANGLE = np.array([[-0.5, -0.5], [-0.2, 0.8], [0.2, 0.6]])
AREA = 0.5 * abs(np.linalg.det(TRIANGLE[1:] - TRIANGLE[0]))


def seen(scene, points, target=0):
    """Pixels of points on a target of a scene."""
    pose = scene.targets[target]
    return camera_of(scene).project(points @ pose.rotation[:, :2].T + pose.translation)


@pytest.fixture(scope="module")
def scene():
    return squares(5)


@pytest.fixture(scope="module")
def result(scene):
    return ts.calibrate_edges(edges_of(scene, noise=0.1, seed=1), IMAGE_SIZE)


@pytest.fixture(scope="module")
def exact(scene):
    return ts.calibrate_edges(edges_of(scene), IMAGE_SIZE)


@pytest.mark.parametrize(("order", "area"), [((0, 1, 2, 3), 1.0), ((0, 2, 1, 3), None)])
def test_only_a_polygon_has_an_area(order, area):
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[list(order)]
    found = ts.Measurement(corners, np.zeros((8, 8)))
    assert found.area == area
    assert found.area_std == (None if area is None else 0.0)


def test_lengths_angles_and_areas_are_those_of_the_plane(scene, exact):
    found = ts.measure(exact.planes[0], seen(scene, TRIANGLE), exact, side=50)
    assert np.allclose(found.lengths, 50 * np.hypot([0.3, 0.4], [1.3, 0.2]), rtol=1e-7)
    sides = TRIANGLE[0] - TRIANGLE[1], TRIANGLE[2] - TRIANGLE[1]
    cosine = sides[0] @ sides[1] / np.prod(np.linalg.norm(sides, axis=1))
    assert found.angles == pytest.approx([np.degrees(np.arccos(cosine))], abs=1e-5)
    assert found.area == pytest.approx(50**2 * AREA, rel=1e-7)


@pytest.mark.slow
def test_standard_deviations_are_the_scatter_of_repeated_measurements(scene):
    """Camera, pose and points have errors; 150 draws determine a scatter to 6 %, 20 % is over 3."""
    rng, draws, point_std = np.random.default_rng(3), 150, 0.05
    true_pixels = seen(scene, TRIANGLE)
    truth = [*np.linalg.norm(np.diff(TRIANGLE, axis=0), axis=1), AREA]
    errors = []
    for seed in range(draws):
        result = ts.calibrate_edges(edges_of(scene, 0.1, seed, spacing=8.0), IMAGE_SIZE)
        pixels = true_pixels + rng.normal(0, point_std, true_pixels.shape)
        found = ts.measure(result.planes[0], pixels, result, point_std=point_std)
        std = [*found.lengths_std, found.area_std]
        errors.append((np.array([*found.lengths, found.area]) - truth) / std)
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(np.abs(scatter - 1) < 0.2), scatter


@pytest.mark.slow
def test_with_the_pixels_exact_pose_and_camera_alone_scatter_the_lengths(scene):
    """The same without noise of the points, up to one side from the square's centre."""
    errors = []
    far = np.array([[-0.4, 0.9], [0.3, 0.4]])
    for seed in range(150):
        result = ts.calibrate_edges(edges_of(scene, 0.1, seed, spacing=8.0), IMAGE_SIZE)
        found = ts.measure(result.planes[0], seen(scene, far), result, point_std=0)
        errors.append((found.lengths[0] - np.linalg.norm(far[1] - far[0])) / found.lengths_std[0])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.2)


def test_what_is_in_line_has_an_angle_and_an_area_that_are_not_certain():
    """At 0 and 180 degrees the angle has no derivative, but it scatters as elsewhere."""
    std = 1e-3
    covariance = std**2 * np.eye(6)
    straight = ts.Measurement([[0, 0], [1, 0], [2, 0]], covariance)
    assert (straight.angles, straight.area) == (180, 0)
    # The middle's y turns both arms, those of the ends one each: 1, 1, and 2 radians per unit.
    assert straight.angles_std == pytest.approx(np.degrees(std) * np.sqrt(6), rel=1e-6)
    assert straight.area_std == pytest.approx(std * 0.5 * np.sqrt(6), rel=1e-6)
    back = ts.Measurement([[1, 0], [0, 0], [2, 0]], covariance)
    assert back.angles == 0
    assert back.angles_std == pytest.approx(np.degrees(std) * np.sqrt(1.5), rel=1e-6)


def test_a_camera_without_uncertainty_adds_none(scene, result):
    pixels = seen(scene, TRIANGLE)
    of_all = ts.measure(result.planes[0], pixels, result, point_std=0)
    of_pose = ts.measure(result.planes[0], pixels, result.camera, point_std=0)
    assert np.array_equal(of_all.lengths, of_pose.lengths)
    assert np.all(of_pose.lengths_std < of_all.lengths_std)


def test_bad_points_are_refused(scene, result):
    plane = result.planes[0]
    with pytest.raises(ValueError, match=r"point 2, \(-5, 3\), is outside the picture of 1280 x"):
        ts.measure(plane, [[5, 3], [-5, 3]], result)
    with pytest.raises(ValueError, match="two points"):
        ts.measure(plane, [[5, 3]], result)
    with pytest.raises(ValueError, match=r"NaN|finite"):
        ts.measure(plane, [[5, 3], [np.nan, 3]], result)
    with pytest.raises(ValueError, match="side must be positive"):
        ts.measure(plane, seen(scene, TRIANGLE), result, side=0)
    with pytest.raises(ValueError, match="side must be positive and less"):
        ts.measure(plane, seen(scene, TRIANGLE), result, side=1e200)
    with pytest.raises(ValueError, match="point_std must be less"):
        ts.measure(plane, seen(scene, TRIANGLE), result, point_std=1e200)
    with pytest.raises(ValueError, match="points 2 and 3 are the same"):
        ts.measure(plane, [[5, 3], [9, 3], [9, 3]], result)
    with pytest.raises(TypeError, match="camera must be"):
        ts.measure(plane, seen(scene, TRIANGLE), "camera.json")
    with pytest.raises(ValueError, match="calibrate again"):
        ts.measure(replace(plane, uncertainty=None), seen(scene, TRIANGLE), result)


def test_beyond_the_horizon_nothing_is_measured():
    camera = ts.Camera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], np.zeros(5), IMAGE_SIZE)
    steep = cv2.Rodrigues(np.radians([80.0, 0, 0]))[0]
    zeros = ts.PoseUncertainty(np.zeros((6, 6)), np.zeros((6, 9)))
    plane = ts.Plane("square", 0, np.zeros((4, 2)), steep, [0, 1, 5], 0.0, 100, zeros)
    upright = steep[:, 2] / steep[2, 2]
    horizon = 479.5 - 900 / upright[1]
    below, above = [640, horizon + 40], [640, horizon - 40]
    assert np.all(ts.measure(plane, [below, [600, horizon + 60]], camera).lengths > 0)
    for number, order in ((2, [below, above]), (1, [above, below])):
        with pytest.raises(ValueError, match=rf"^point {number}, .* beyond the plane's horizon"):
            ts.measure(plane, order, camera)
    seen_to = replace(camera, distortion=[-0.3, 0, 0, 0, 0], valid_radius=0.5)
    for number, order in ((2, [below, [1279, 0]]), (1, [[0, 0], below])):
        with pytest.raises(
            ValueError, match=rf"^point {number}, .* beyond the lens's valid radius"
        ):
            ts.measure(plane, order, seen_to)


def test_results_keep_the_poses_uncertainty_and_older_ones_have_none(result):
    again = ts.Calibration.from_json(result.to_json())
    for plane, before in zip(again.planes, result.planes, strict=True):
        assert np.array_equal(plane.uncertainty.by_camera, before.uncertainty.by_camera)
        assert np.array_equal(plane.uncertainty.given_camera, before.uncertainty.given_camera)
    members = json.loads(result.to_json())
    for plane in members["planes"]:
        del plane["pose_uncertainty"]
    assert ts.Calibration.from_json(json.dumps(members)).planes[0].uncertainty is None


def test_what_the_sides_of_a_plane_are_bent_by_is_expected_of_points(scene, result):
    plane = result.planes[0]
    assert plane.uncertainty.side_error is None
    curved = replace(plane, uncertainty=replace(plane.uncertainty, side_error=0.4))
    pixels = seen(scene, TRIANGLE)
    found = ts.measure(curved, pixels, result, point_std=0.3)
    same = ts.measure(plane, pixels, result, point_std=0.5)
    np.testing.assert_allclose(found.lengths_std, same.lengths_std)
    again = ts.Calibration.from_json(replace(result, planes=(curved, *result.planes[1:])).to_json())
    assert again.planes[0].uncertainty.side_error == 0.4


def test_lengths_hold_what_an_estimated_tone_curve_leaves_open():
    deviations = []
    for seed in range(8):
        rng = np.random.default_rng([79, seed])
        scene = simulate.random_scene(rng)
        picture = simulate.render(scene, rng, noise=1.0, tone="srgb")
        found = ts.calibrate(picture)
        for plane in found.planes:
            middle = plane.corners.mean(axis=0)
            own = [seen(scene, np.zeros((1, 2)), index)[0] for index in range(3)]
            target = int(np.argmin(np.linalg.norm(own - middle, axis=1)))
            pixels = seen(scene, TRIANGLE, target)
            measured = ts.measure(plane, pixels, found, point_std=0)
            truth = np.linalg.norm(np.diff(TRIANGLE, axis=0), axis=1)
            deviations.extend((measured.lengths - truth) / measured.lengths_std)
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6
    assert np.mean(np.abs(deviations) < 1.96) > 0.85


@pytest.mark.slow
def test_lengths_on_bent_sheets_are_known_as_well_as_they_say():
    deviations = []
    for seed in range(12):
        rng = np.random.default_rng([78, seed])
        flat = simulate.random_scene(rng)
        targets = tuple(
            bent(target, curvature=rng.uniform(0.01, 0.06), direction=rng.uniform(0, np.pi))
            for target in flat.targets
        )
        curved = simulate.Scene(flat.camera, targets)
        found = ts.calibrate(simulate.render(curved, rng, noise=2.0, blur=0.8, tone="srgb"))
        for plane in found.planes:
            middles = [
                flat.camera.project(target.to_camera(np.zeros((1, 2))))[0] for target in targets
            ]
            away = np.linalg.norm(middles - plane.corners.mean(axis=0), axis=1)
            target = targets[int(np.argmin(away))]
            for _ in range(6):
                ends = rng.uniform(-0.5, 0.5, (2, 2))
                pixels = flat.camera.project(target.to_camera(ends))
                pixels += 0.1 * rng.standard_normal((2, 2))
                measured = ts.measure(plane, pixels, found, point_std=0.1)
                truth = np.linalg.norm(ends[1] - ends[0])
                deviations.append((measured.lengths[0] - truth) / measured.lengths_std[0])
    assert np.mean(np.abs(deviations) < 1.96) > 0.88


@pytest.fixture(scope="module")
def photograph(scene):
    return simulate.render(scene, np.random.default_rng(2), tone="srgb")


def test_located_planes_are_those_of_the_calibration(photograph):
    result = ts.calibrate(photograph, tone="srgb")
    for plane, before in zip(ts.locate(photograph, result), result.planes, strict=True):
        assert np.allclose(plane.translation, before.translation, atol=1e-4)
        assert np.allclose(plane.rotation, before.rotation, atol=1e-4)
        ratio = np.diag(plane.uncertainty.given_camera) / np.diag(before.uncertainty.given_camera)
        assert np.all((ratio > 0.5) & (ratio < 2))


def test_located_planes_are_metric_if_a_side_is_stated(photograph):
    result = ts.calibrate(photograph, tone="srgb")
    (plane, *_), (bare, *_) = (ts.locate(photograph, result, side=own) for own in ("84mm", None))
    assert (plane.side, bare.side) == (0.084, None)
    assert np.allclose(plane.tvec, 0.084 * bare.tvec, rtol=1e-9)


def test_one_square_is_enough_for_a_known_camera(scene):
    alone = replace(scene, targets=scene.targets[:1])
    picture = simulate.render(alone, np.random.default_rng(4), tone="srgb")
    (plane,) = ts.locate(picture, camera_of(scene))
    found = ts.measure(plane, seen(scene, TRIANGLE), camera_of(scene), point_std=0)
    errors = found.lengths - np.linalg.norm(np.diff(TRIANGLE, axis=0), axis=1)
    assert np.all(np.abs(errors) < 4 * found.lengths_std)
    with pytest.raises(TypeError, match="camera must be"):
        ts.locate(picture, camera_of(scene).K)


def test_a_camera_that_took_another_picture_is_told(
    run, files, photograph, scene, tmp_path, caplog
):
    photo, camera = files
    result = ts.Calibration.load(camera)
    straight, pinhole = tmp_path / "straight.png", tmp_path / "pinhole.json"
    cv2.imwrite(str(straight), ts.undistort(photograph, result.camera))
    result.camera.undistorted().save(pinhole)
    points = ("600,400", "700,450")
    for picture, taken_by in ((photo, camera), (straight, pinhole)):
        code, _, err = run("measure", picture, "--camera", taken_by, *points)
        assert (code, "from where this camera would show them" in err) == (0, False)
    code, _, err = run("measure", straight, "--camera", camera, "--plane", 0, *points)
    assert code == 0
    # Another tone curve displaces edges by more than their noise, but the camera is the same.
    frames = simulate.random_scene(np.random.default_rng(5), camera=scene.camera, kind="frame")
    linear = simulate.render(frames, np.random.default_rng(2), tone="linear")
    assert max(plane.rms for plane in ts.locate(linear, result)) > 0.02
    assert caplog.text == ""
    pattern = (
        r"warning: plane 0: the edges of the square lie ([\d.]+) px \(rms\) from where .*, (\d+) "
        r"times"
    )
    found = re.search(pattern, err)
    assert found, err
    planes = ts.locate(straight, result)
    assert float(found[1]) == pytest.approx(planes[0].rms, rel=0.05)
    assert int(found[2]) > 10
    assert {record.levelname for record in caplog.records} == {"WARNING"}
    assert "plane 0: the edges of the square lie" in caplog.text


def test_the_view_from_above_is_to_scale(photograph, scene):
    result = ts.calibrate(photograph)
    view = ts.rectify(photograph, result.planes[0], result.camera, resolution=200, margin=0.2)
    side = 200
    assert view.resolution == side
    dark = cv2.GaussianBlur(view.image, (5, 5), 0) < 0.5 * view.image.mean() + 40
    # A square with a side of one unit, edges along the axes, its centre at the plane's origin.
    middle = np.rint(-np.array(view.origin) * side).astype(int)
    row, column = dark[middle[1]], dark[:, middle[0]]
    assert abs(int(row.sum()) - side) <= 2
    assert abs(int(column.sum()) - side) <= 2
    assert abs(np.flatnonzero(row).mean() - middle[0]) <= 1.5
    with pytest.raises(ValueError, match="resolution"):
        ts.rectify(photograph, result.planes[0], result.camera, resolution=1e6)
    with pytest.raises(ValueError, match="pixels"):
        ts.rectify(photograph[:100], result.planes[0], result.camera)
    with pytest.raises(ValueError, match="cannot be shown"):
        ts.rectify(photograph, result.planes[0], result, margin=1e308)
    point = replace(result.planes[0], corners=np.full((4, 2), 300.0))
    with pytest.raises(ValueError, match="cannot be shown"):
        ts.rectify(photograph, point, result)
    with pytest.raises(TypeError, match="plane must be"):
        ts.rectify(photograph, 0, result)
    with pytest.raises(TypeError, match="camera must be"):
        ts.rectify(photograph, result.planes[0], result.camera.K)


def test_a_view_from_above_is_black_beyond_the_photograph_and_keeps_its_type(photograph):
    result = ts.calibrate(photograph)
    for plane in result.planes:
        white = np.full((*photograph.shape, 3), 65535, np.uint16)
        view = ts.rectify(white, plane, result, resolution=10, margin=40)
        assert view.image.dtype == np.uint16
        assert set(np.unique(view.image)) >= {0, 65535}
        # The photograph covers one connected piece of the plane, even if the plane extends behind
        # the camera.
        pieces, _ = cv2.connectedComponents((view.image[..., 0] > 0).astype(np.uint8))
        assert pieces == 2


@pytest.fixture(scope="module")
def files(photograph, tmp_path_factory):
    folder = tmp_path_factory.mktemp("measure")
    cv2.imwrite(str(folder / "photo.png"), photograph)
    (folder / "camera.json").write_text(ts.calibrate(photograph).to_json())
    return folder / "photo.png", folder / "camera.json"


def as_points(pixels):
    return [f"{x},{y}" for x, y in pixels]


def test_command_measures_and_draws(run, files, scene, tmp_path):
    photo, camera = files
    points = as_points(seen(scene, TRIANGLE))
    options = ("--camera", camera, "--side", "50mm", "--plane", 0)
    code, printed, _ = run("measure", photo, *options, *points, "--rectify", tmp_path / "top.png")
    assert code == 0
    assert "mm^2" in printed
    assert cv2.imread(str(tmp_path / "top.png")).shape[0] > 100
    members = json.loads(run("measure", photo, *options, *points, "--json")[1])
    assert members["unit"] == "mm"
    truth = 50 * np.linalg.norm(np.diff(TRIANGLE, axis=0), axis=1)
    errors = np.array(members["lengths"]) - truth
    # The points are exact, although a click's uncertainty is stated.
    assert np.all(np.abs(errors) < members["lengths_std"])


def test_command_says_how_much_of_the_uncertainty_is_that_of_the_points(run, files, scene):
    photo, camera = files
    points = as_points(seen(scene, TRIANGLE))
    options = ("--camera", camera, "--plane", 0)
    variances, printed = [], []
    for std in (0, 0.01):
        words = ("measure", photo, *options, "--point-std", std, *points)
        variances.append(np.sum(np.square(json.loads(run(*words, "--json")[1])["lengths_std"])))
        printed.append(run(*words)[1])
    assert "the points" not in printed[0]
    share = 1 - variances[0] / variances[1]
    assert 0.1 < share < 0.99
    assert f"0.01 px (--point-std), make up {100 * share:.0f} % of the variance" in printed[1]


def test_command_takes_the_side_that_the_calibration_states(run, files, scene, tmp_path):
    photo, camera = files
    points = as_points(seen(scene, TRIANGLE))
    in_sides = run("measure", photo, "--camera", camera, *points)
    assert in_sides[0] == 0
    assert in_sides[1].splitlines()[0].endswith(" (in sides; say --side)")
    for side, unit, number in (("28mm", "mm", 28.0), ("2.8m", "m", 2.8), ("28cm", "mm", 280.0)):
        stated = tmp_path / "stated.json"
        ts.calibrate(photo, side=side).save(stated)
        code, printed, _ = run("measure", photo, "--camera", stated, *points)
        heading, *lines = printed.splitlines()
        assert code == 0
        assert heading.endswith(f", side {number:g} {unit} as calibrated")
        assert [line.split()[-1] for line in lines[:-1]] == [unit] * 2 + ["degrees", f"{unit}^2"]
        found = json.loads(run("measure", photo, "--camera", stated, *points, "--json")[1])
        given = run("measure", photo, "--camera", camera, "--side", side, *points, "--json")
        assert (found["unit"], found["side"]) == (unit, pytest.approx(number))
        scale = number / json.loads(given[1])["side"]
        assert found["lengths"] == pytest.approx(
            np.multiply(json.loads(given[1])["lengths"], scale)
        )
    given = run("measure", photo, "--camera", stated, "--side", "2in", *points)[1]
    assert "calibrated" not in given
    assert " in^2" in given


def told(members):
    """The lines of the warnings in a command's JSON."""
    pairs = zip(members["warnings"], members["warning_codes"], strict=True)
    return [f"warning: {text} [{code}]" for text, code in pairs]


def test_command_warns_of_a_side_that_contradicts_the_calibration(run, files, scene, tmp_path):
    photo, _ = files
    ts.calibrate(photo, side="84mm").save(tmp_path / "stated.json")
    points = as_points(seen(scene, TRIANGLE))
    options = ("--camera", tmp_path / "stated.json", *points)
    code, out, err = run("measure", photo, *options, "--side", "50mm")
    assert code == 0
    assert " mm" in out
    assert err == (
        "warning: --side 50 mm is used, where the calibration states 84 mm: right if this is "
        "another square [side_differs]\n"
    )
    assert run("measure", photo, *options, "--side", "8.4cm")[2] == ""


def test_command_takes_the_plane_that_all_points_are_within(run, files, scene):
    photo, camera = files
    for target in range(3):
        points = as_points(seen(scene, 0.4 * TRIANGLE, target=target))
        given = run("measure", photo, "--camera", camera, "--json", *points)
        members = json.loads(given[1])
        corners = np.float32(members["corners"])
        for text in points:
            place = tuple(float(number) for number in text.split(","))
            assert cv2.pointPolygonTest(corners, place, False) > 0
        assert members["warnings"] == []
    # For points in two squares, no square contains both, and the third square none.
    apart = [seen(scene, 0.4 * TRIANGLE, target=target)[0] for target in (2, 1)]
    given = run("measure", photo, "--camera", camera, "--json", *as_points(apart))
    corners = np.float32(json.loads(given[1])["corners"])
    assert sum(cv2.pointPolygonTest(corners, tuple(point), False) > 0 for point in apart) == 1


def test_command_takes_the_plane_that_the_points_are_nearest_to(run, files, scene):
    """The points are at the ends of a side, 0.02 sides outside the square's corners."""
    photo, camera = files
    side = np.array([[-0.52, -0.52], [0.52, -0.52]])
    for target in range(3):
        points = as_points(seen(scene, side, target=target))
        members = json.loads(run("measure", photo, "--camera", camera, "--json", *points)[1])
        assert members["lengths"] == pytest.approx([1.04], rel=1e-3)
        assert members["extrapolation"] == pytest.approx(1.04, rel=1e-3)
        assert members["warnings"] == []


def test_command_warns_where_two_planes_are_nearly_as_near(run, files, scene):
    photo, camera = files
    near, far = (seen(scene, np.zeros((1, 2)), target=target)[0] for target in (0, 1))
    between = as_points([0.5 * (near + far), 0.5 * (near + far) + [10, 0]])
    code, printed, err = run("measure", photo, "--camera", camera, *between)
    assert code == 0
    plane = int(re.match(r"on plane (\d), ", printed)[1])
    of_plane = [
        json.loads(run("measure", photo, "--camera", camera, "--json", "--plane", i, *between)[1])
        for i in range(3)
    ]
    reaches = [each["extrapolation"] for each in of_plane]
    assert plane == np.argmin(reaches)
    named = re.search(r"plane \d is the nearest, .*: say (.*) \[plane_unclear\]\n", err)[1].split(
        " or "
    )
    near = [i for i in np.argsort(reaches) if reaches[i] <= 2 * reaches[plane]]
    assert named == [f"--plane {i}" for i in near]
    assert len(named) > 1
    for given in of_plane:
        assert not any("nearly as near" in warning for warning in given["warnings"])


def test_command_says_that_rectangles_have_to_be_named_again(run, files, scene, tmp_path):
    photo, camera = files
    known = ts.Calibration.load(camera)
    planes = [replace(plane, kind="rectangle") for plane in known.planes]
    replace(known, planes=planes).save(tmp_path / "sheets.json")
    points = as_points(seen(scene, TRIANGLE))
    code, _, err = run("measure", photo, "--camera", tmp_path / "sheets.json", *points)
    assert code == 0
    assert err == (
        "warning: plane 0 is taken for a square, where the calibration's planes are rectangles: "
        "if it is one of them, name it as there, such as --targets a4 [shape_differs]\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--plane", 9, "5,5", "9,9"], "there is no plane 9 in the photograph, but 0: a square"),
        (["--side", "5 parsecs", "5,5", "9,9"], "unknown unit 'parsecs'"),
        (["--side", "-5mm", "5,5", "9,9"], "a length must be positive"),
        (
            ["--side", "84", "5,5", "9,9"],
            "--side needs a unit (one of um, mm, cm, m, km, in, ft), such as 84mm",
        ),
        (["5;5", "9,9"], "a point is written X,Y"),
        (["5,5"], "two points or more"),
        ([], "two points or more"),
        (["5,5", "5000,9"], "outside the picture"),
    ],
)
def test_command_refuses_and_writes_nothing(run, files, tmp_path, arguments, message):
    photo, camera = files
    out = tmp_path / "top.png"
    rectify = ["--rectify", out] if arguments else []
    code, printed, said = run("measure", photo, "--camera", camera, *arguments, *rectify)
    assert (code, printed) == (2, "")
    assert message in said
    assert not out.exists()


def test_command_says_that_points_are_those_of_the_stored_picture(run, files, scene, tmp_path):
    """A viewer shows the picture turned, with its pixels elsewhere."""
    photo, camera = files
    tagged = tmp_path / "tagged.png"
    tagged.write_bytes(with_orientation(photo.read_bytes(), 6))
    points = as_points(seen(scene, TRIANGLE))
    code, out, err = run("measure", tagged, "--camera", camera, *points)
    assert (code, out) == run("measure", photo, "--camera", camera, *points)[:2]
    warning = next(line for line in err.splitlines() if "orientation" in line)
    assert warning == (
        f"warning: {tagged}: its orientation tag (turned clockwise by 90 degrees) is ignored; the "
        "points refer to the picture as it is stored, 1280 x 960 pixels [orientation_ignored]"
    )
    (ignored,) = ts.calibrate(tagged).warnings
    assert (ignored.code, ignored.severity) == ("orientation_ignored", "medium")
    members = json.loads(run("measure", tagged, "--camera", camera, *points, "--json")[1])
    assert warning in told(members)
    outside = ("--camera", camera, "700,100", "700,1100")
    code, _, err = run("measure", tagged, *outside)
    assert code == 2
    assert "point 2, (700, 1100), is outside the picture of 1280 x 960" in err
    assert "orientation tag (turned clockwise by 90 degrees) is ignored" in err
    assert "orientation" not in run("measure", photo, *outside)[2]


def test_a_view_from_above_of_few_pixels_is_told(run, files, tmp_path):
    photo, camera = files
    above = tmp_path / "above.png"
    options = ("--camera", camera, "--rectify", above, "--resolution", 5)
    code, _, err = run("measure", photo, *options)
    assert code == 0
    width, height = cv2.imread(str(above)).shape[1::-1]
    assert err.splitlines() == [
        f"warning: {above}: is {width} x {height} pixels only: --resolution is in pixels per side "
        "of the square, as no side is known (--side) [small_view]"
    ]
    assert run("measure", photo, *options, "--side", "84mm")[2] == ""


def test_a_measurement_shows_as_many_digits_as_are_known(scene, result):
    found = ts.measure(result.planes[0], seen(scene, TRIANGLE[:2]), result, side=50)
    length, std = re.search(r"lengths ([\d.]+) \+- ([\d.]+)>", repr(found)).groups()
    assert len(length.partition(".")[2]) == len(std.partition(".")[2])
    assert float(length) == pytest.approx(found.lengths[0], abs=float(std))
    for side, unit in (("50mm", "m"), (None, "sides")):
        other = ts.measure(result.planes[0], seen(scene, TRIANGLE[:2]), result, side=side)
        assert other.unit == unit
        assert repr(other).endswith(f" {unit}>")
    for wrong in (0, None):
        with pytest.raises(TypeError, match=r"such as result.planes\[0\], not"):
            ts.measure(wrong, TRIANGLE, result)


def test_the_extrapolation_is_by_the_distance_of_the_corners(scene, exact):
    """Corners of a unit square are 0.71 sides from its centre."""
    plane = exact.planes[0]
    for reach in (0.2, 0.5, 0.8):
        points = seen(scene, np.array([[0.0, 0.0], [0.0, reach]]))
        found = ts.measure(plane, points, exact, side=50)
        assert found.extrapolation == pytest.approx(reach / np.sqrt(0.5), rel=1e-6)
    elsewhere = replace(plane, corners=np.zeros((4, 2)))
    assert ts.measure(elsewhere, points, exact).extrapolation is None
    with pytest.raises(ValueError, match="extrapolation"):
        ts.Measurement([[0, 0], [1, 0]], np.zeros((4, 4)), -1.0)


def test_command_warns_of_points_that_may_not_be_on_the_plane(run, files, scene):
    photo, camera, *_ = files
    inside, beside = seen(scene, np.zeros((1, 2)))[0], seen(scene, np.zeros((1, 2)), target=1)[0]
    points = ["{:.1f},{:.1f}".format(*point) for point in (inside, beside)]
    code, out, err = run("measure", photo, "--camera", camera, *points)
    assert code == 0
    assert "warning" not in out
    first, *more = err.splitlines()
    assert first.startswith(
        f"warning: point 2, ({beside[0]:.1f}, {beside[1]:.1f}), is within plane"
    )
    assert first.endswith("if it is not [point_on_other_plane]")
    members = json.loads(run("measure", photo, "--camera", camera, *points, "--json")[1])
    assert told(members) == [first, *more]
    assert more == [
        "warning: extrapolation: the farthest point is "
        f"{members['extrapolation']:.1f} times as far from the middle of the square as its "
        "corners; the lengths are right if the plane is flat up to there and the point is on it "
        "[lengths_extrapolated]"
    ]
