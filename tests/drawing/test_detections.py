"""Detections of a failed or requested search: found targets, their places, and the rejected."""

import io
import pickle
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from rich.console import Console, Group
from scenes import parallel_squares

import trisquare as ts
from trisquare import simulate
from trisquare.cli.tables import calibration_report
from trisquare.detection.candidates import Lattice
from trisquare.detection.kinds import TargetKinds
from trisquare.drawing.detections import FOUND_COLOUR, REJECTED_COLOUR, draw_detections
from trisquare.measurement.boards import Board
from trisquare.measurement.find import search
from trisquare.measurement.rejection_reasons import rejection_reasons

CAMERA = simulate.TrueCamera(700.0, 700.0, 319.5, 239.5, image_size=(640, 480))
UNIT_SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
ONE = simulate.random_scene(np.random.default_rng(71), camera=CAMERA, count=1)
TURNED = simulate.tilted(30.0, 20.0, 15.0)


def photograph(scene, seed=72, **settings):
    return simulate.render(scene, np.random.default_rng(seed), **settings)


def seen_at(pixel, side, rotation=TURNED, printed=None):
    """A square, or the shape `printed`, with its centre seen at a pixel."""
    centre = np.append(CAMERA.undistort(np.array([pixel], float))[0], 1.0) * CAMERA.fx / side
    return simulate.Target(rotation, centre, printed=printed)


def failure(picture, **options):
    with pytest.raises(ts.TrisquareError) as caught:
        ts.calibrate(picture, **options)
    return caught.value


def assert_at(place, corners, pixels=3.0):
    """Check a place's corners, starting from any of them."""
    gaps = [np.abs(np.roll(place.corners, k, axis=0) - corners).max() for k in range(4)]
    assert min(gaps) < pixels, (place, corners)


def test_one_square_is_said_to_be_found_and_where():
    error = failure(photograph(ONE))
    assert isinstance(error, ts.NotEnoughPlanesError)
    (found,) = error.found
    assert (found.kind, found.image) == ("square", 0)
    corners = ONE.image_points(0, UNIT_SQUARE)
    assert_at(found, corners)
    x, y = found.corners.mean(axis=0)
    assert f"found: a square around ({x:.0f}, {y:.0f})" in str(error)


def test_one_board_s_place_is_that_of_its_outer_crossings():
    scene = simulate.chessboard_scene(np.random.default_rng(73), CAMERA, (6, 5))
    error = failure(photograph(scene), targets="chessboard:6x5")
    crossings = scene.image_points(0, scene.targets[0].board_corners())[[0, 5, 29, 24]]
    assert_at(error.found[0], crossings)
    assert "found: a chessboard around" in str(error)


def test_parallel_squares_are_named_with_their_pictures():
    scene = parallel_squares(CAMERA, side=130.0)
    error = failure([photograph(scene), np.full((480, 640), 90, np.uint8)])
    assert isinstance(error, ts.DegenerateGeometryError)
    assert str(error).startswith("all 3 planes are parallel")
    assert "found: squares around" in str(error)
    assert "of picture 0" in str(error)
    assert [place.image for place in error.found] == [0, 0, 0]


@pytest.mark.parametrize("shape", [(1, 1), (480, 640), (480, 640, 3)])
def test_a_black_picture_has_nothing(shape):
    error = failure(np.zeros(shape, np.uint8))
    assert (type(error), error.found, error.rejected) == (ts.DetectionError, (), ())


def test_an_error_survives_pickling():
    error = failure(photograph(ONE, clutter=40))
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (type(error), str(error))
    for before, after in zip(
        error.found + error.rejected, again.found + again.rejected, strict=True
    ):
        np.testing.assert_array_equal(after.corners, before.corners)
        assert repr(after) == repr(before)
    assert len(again.found) == 1
    with pytest.raises(ValueError, match="read-only"):
        again.found[0].corners[0] = 0


def test_edges_without_a_picture_keep_the_plain_error():
    edges = ts.detect(photograph(ONE))
    with pytest.raises(ts.NotEnoughPlanesError) as caught:
        ts.calibrate_edges(edges, CAMERA.image_size)
    assert (caught.value.found, caught.value.rejected) == ((), ())


# Candidates that the search rejects, and the reasons.


def reasons(scene, **settings):
    picture = photograph(scene, **settings)
    return {
        tuple(np.rint(candidate.corners.mean(axis=0)).astype(int)): candidate.reason
        for candidate in rejection_reasons(search(picture, TargetKinds.parse("squares")))
    }


def reason_at(told, pixel):
    near = [r for place, r in told.items() if np.hypot(*np.subtract(place, pixel)) < 15.0]
    assert len(near) == 1, told
    return near[0]


def test_a_square_cut_by_the_border_is_told():
    scene = simulate.Scene(CAMERA, (seen_at((320, 240), 150.0), seen_at((640, 240), 150.0)))
    told = reasons(scene)
    assert len(told) == 1
    (((x, _), reason),) = told.items()
    assert x > 560
    assert "border" in reason


def test_a_long_rectangle_is_no_view_of_a_square():
    flat = simulate.tilted(5.0, 0.0, 10.0)
    thin = 0.4 * np.array([[-1.5, -0.6], [1.5, -0.6], [1.5, 0.6], [-1.5, 0.6]])
    scene = simulate.Scene(
        CAMERA, (seen_at((160, 240), 150.0), seen_at((460, 240), 150.0, flat, thin))
    )
    told = reasons(scene)
    assert len(told) == 1
    assert "no camera sees" in reason_at(told, (460, 240))


def test_what_lies_beside_a_square_is_told():
    scene = simulate.Scene(CAMERA, (seen_at((220, 240), 160.0, np.eye(3)),))
    picture = photograph(scene)
    dark, light = float(picture[240, 220]), float(picture[10, 10])
    picture[150:330, 300:420] = round(0.6 * dark + 0.4 * light)
    told = rejection_reasons(search(picture, TargetKinds.parse("squares")))
    beside = [c for c in told if np.abs(c.corners.mean(axis=0) - [220, 240]).max() < 10]
    assert [candidate.reason for candidate in beside] == [
        "something else touches its sides or corners, or a shadow crosses them"
    ]


def test_a_square_with_a_patterned_inside_is_told():
    scene = simulate.Scene(CAMERA, (seen_at((320, 240), 200.0, np.eye(3)),))
    picture = photograph(scene)
    cv2.circle(picture, (320, 240), 50, 200, -1)
    (candidate,) = rejection_reasons(search(picture, TargetKinds.parse("squares")))
    assert candidate.reason.startswith("its inside is neither")
    assert_at(candidate, scene.image_points(0, UNIT_SQUARE))


def test_found_squares_are_not_passed_over():
    scene = simulate.random_scene(np.random.default_rng(74), kind="frame")
    assert rejection_reasons(search(photograph(scene), TargetKinds.parse("squares"))) == []


@pytest.mark.parametrize("shape", [(1, 1), (3, 700), (40, 40), (480, 640)])
def test_noise_is_explained_without_harm(shape):
    noise = np.random.default_rng(75).integers(0, 256, shape).astype(np.uint8)
    for candidate in rejection_reasons(search(noise, TargetKinds.parse("auto"))):
        assert np.isfinite(candidate.corners).all()


def test_a_board_measured_in_one_direction_is_no_plane():
    """It would leave its homography undetermined, and with it the whole calibration."""
    y, x = np.mgrid[100:260:40, 100:260:40].astype(float)
    lattice = Lattice(np.stack([x, y], axis=2), np.ones((4, 4), bool))
    found = Board.of(lattice, np.zeros((400, 400), np.uint8))
    ends = [np.array([[105.0, place], [215.0, place]]) for place in y[:, 0]]
    rows = [SimpleNamespace(points=line, std=np.ones(2)) for line in ends]
    columns = [SimpleNamespace(points=line[:, ::-1].copy(), std=np.ones(2)) for line in ends]
    blurred = "too blurred"
    assert len(found.figures(rows + columns, 0)) == 1
    assert len(found.figures([*rows, blurred, blurred, *columns[2:]], 0)) == 1
    assert found.figures([*rows, *columns[:1], blurred, blurred, blurred], 0) == []


# Drawing.


def pixels_of(colour, drawn):
    return (np.abs(drawn.astype(int) - colour) < 40).all(axis=2)


def square_around(x, y, half):
    return 2 * half * UNIT_SQUARE + [x, y]


FOUND = ts.PartialDetection("square", 0, square_around(400, 300, 100))
REFUSED = ts.Rejected("square", 0, square_around(900, 700, 200), "its side 2 has no edge", 3.25)


def test_accepted_and_rejected_are_drawn_in_their_colours_where_they_are():
    drawn = draw_detections(np.full((960, 1280), 128, np.uint8), [FOUND], [REFUSED])
    assert (drawn.shape, drawn.dtype) == ((960, 1280, 3), np.uint8)
    for colour, place in ((FOUND_COLOUR, FOUND), (REJECTED_COLOUR, REFUSED)):
        has_colour = pixels_of(colour, drawn)
        for start, end in zip(place.corners, np.roll(place.corners, -1, axis=0), strict=True):
            for share in (0.25, 0.5, 0.75):
                x, y = np.rint(start + share * (end - start)).astype(int)
                assert has_colour[y - 2 : y + 3, x - 2 : x + 3].any()
    # The label of a found target is short, the reason of a rejected one is long.
    inside = pixels_of(REJECTED_COLOUR, drawn)[510:890, 710:1090]
    assert inside.sum() > 200


def test_a_plane_that_was_rejected_is_not_drawn_as_found():
    poses = {"rotation": np.eye(3), "translation": np.array([0.0, 0.0, 1.0])}
    plane = ts.Plane("square", 0, FOUND.corners, **poses, rms=2.0, samples=90, rejection="bent")
    drawn = draw_detections(np.full((960, 1280), 128, np.uint8), [plane], [])
    x, y = np.rint(plane.corners[:2].mean(axis=0)).astype(int)
    beside = drawn[y - 2 : y + 3, x - 2 : x + 3]
    assert pixels_of(REJECTED_COLOUR, beside).any()
    assert not pixels_of(FOUND_COLOUR, beside).any()


def test_other_pictures_findings_are_left_out():
    blank = np.full((960, 1280), 128, np.uint8)
    other = draw_detections(blank, [FOUND], [REFUSED], index=1)
    np.testing.assert_array_equal(other, draw_detections(blank, [], []))
    moved = [replace(place, image=1) for place in (FOUND, REFUSED)]
    np.testing.assert_array_equal(
        draw_detections(blank, moved[:1], moved[1:], index=1),
        draw_detections(blank, [FOUND], [REFUSED]),
    )


@pytest.mark.parametrize(
    ("dtype", "shape", "scale"),
    [
        (np.uint8, (1, 1), 8),
        (np.uint16, (480, 640, 3), 2),
        (np.float32, (3, 2000), 1),
        (np.uint8, (1300, 900), 1),
    ],
)
def test_any_picture_can_be_drawn_on(dtype, shape, scale):
    many = [replace(REFUSED, corners=REFUSED.corners + shift) for shift in (-1e6, 0, 40, 9e8)]
    drawn = draw_detections(np.zeros(shape, dtype), [FOUND], many)
    assert drawn.shape == (scale * shape[0], scale * shape[1], 3)


def test_labels_keep_off_each_other():
    """There is enough room for nine labels of two lines without overlap."""
    blank = np.full((800, 1200), 128, np.uint8)
    refused = [
        replace(REFUSED, corners=square_around(x, y, 40))
        for x in (200, 600, 1000)
        for y in (150, 400, 650)
    ]
    together = pixels_of(REJECTED_COLOUR, draw_detections(blank, [], refused))
    alone = sum(pixels_of(REJECTED_COLOUR, draw_detections(blank, [], [r])).sum() for r in refused)
    legend = pixels_of(REJECTED_COLOUR, draw_detections(blank, [], [])).sum()
    assert together.sum() > 0.97 * (alone - 9 * legend)


# The command.


def test_debug_image_is_written_on_success_and_on_failure(run, tmp_path):
    scene = simulate.random_scene(np.random.default_rng(76), camera=CAMERA)
    cases = {"three": (scene, 0, 3), "one": (ONE, 3, 1)}
    for name, (shown, exit_code, count) in cases.items():
        photo, debug, camera = (
            tmp_path / f"{name}{end}" for end in (".png", "-debug.png", ".json")
        )
        cv2.imwrite(str(photo), photograph(shown))
        code, _, err = run("calibrate", photo, "-o", camera, "--debug-image", debug)
        assert code == exit_code
        assert len(err.splitlines()) == (exit_code != 0)
        assert camera.exists() == (exit_code == 0)
        found = pixels_of(FOUND_COLOUR, cv2.imread(str(debug)))
        for number in range(count):
            for x, y in 2 * shown.image_points(number, UNIT_SQUARE) + 0.5:
                x, y = round(x), round(y)
                assert found[y - 12 : y + 13, x - 12 : x + 13].sum() > 20


def test_debug_images_of_several_photographs(run, tmp_path):
    photos = [tmp_path / "0.png", tmp_path / "1.png"]
    for photo, picture in zip(
        photos, (photograph(ONE), np.zeros((480, 640), np.uint8)), strict=True
    ):
        cv2.imwrite(str(photo), picture)
    code, _, err = run("calibrate", *photos, "--debug-image", tmp_path / "debug.png")
    assert code == 3
    assert "of picture 0" in err
    drawn = [cv2.imread(str(tmp_path / f"debug-{number}.png")) for number in (1, 2)]
    counts = [pixels_of(FOUND_COLOUR, picture).sum() for picture in drawn]
    assert counts[0] > counts[1] + 1000


@pytest.mark.parametrize("path", ["photo.png", "missing/debug.png", "debug.xyz", "overlay.png"])
def test_impossible_debug_images_are_refused_before_any_work(run, tmp_path, path):
    photo, overlay = tmp_path / "photo.png", tmp_path / "overlay.png"
    cv2.imwrite(str(photo), np.zeros((40, 40), np.uint8))
    before = photo.read_bytes()
    options = ("--overlay", overlay, "--debug-image", tmp_path / path)
    code, _, err = run("calibrate", photo, *options)
    assert (code, len(err.splitlines())) == (2, 1)
    assert {file.name for file in tmp_path.iterdir()} == {"photo.png"}
    assert photo.read_bytes() == before


def test_the_tables_name_what_was_not_used():
    result = ts.calibrate(photograph(simulate.random_scene(np.random.default_rng(77))))
    refused = [replace(REFUSED, image=number) for number in range(14)]
    with_refused = replace(result, rejected=refused)
    for calibration, count in ((result, 0), (with_refused, 14)):
        console = Console(width=200, record=True, file=io.StringIO())
        console.print(Group(*calibration_report(calibration)), soft_wrap=True)
        lines = [line for line in console.export_text().splitlines() if "not used" in line]
        assert len(lines) == min(count, 11)
    assert lines[0].strip() == (
        "not used: square around (900, 700) of picture 0: its side 2 has no edge, 3.25 px"
    )
    assert "4 more" in lines[-1]


def test_no_debug_image_of_what_is_no_picture(run, tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    code, _, err = run("calibrate", tmp_path / "text.png", "--debug-image", tmp_path / "debug.png")
    assert code == 5
    assert len(err.splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"text.png"}
