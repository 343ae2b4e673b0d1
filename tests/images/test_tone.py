"""Pictures with an unknown tone curve."""

import json
import pickle
import re

import cv2
import numpy as np
import pytest
from scenes import IMAGE_SIZE, assert_within, squares

import trisquare as ts
from trisquare import simulate
from trisquare.cli.app import main
from trisquare.images.tone import PictureTone, shift_text

SRGB_GAMMA = float(np.log(0.18) / np.log(1.055 * 0.18 ** (1 / 2.4) - 0.055))
SCENE = squares(91)


def photo(tone, **options):
    return simulate.render(SCENE, np.random.default_rng(92), tone=tone, **options)


@pytest.mark.parametrize(("tone", "gamma"), [(1.0, 1.0), (1.8, 1.8), ("srgb", SRGB_GAMMA)])
def test_the_curve_and_the_camera_are_found_together(tone, gamma):
    picture = photo(tone)
    result = ts.calibrate(picture, tone="auto")
    known = ts.calibrate(picture, tone=tone)
    assert_within(result, SCENE, 4)
    assert abs(result.tone - gamma) < 4 * result.tone_std
    assert result.tone_std < 0.1
    assert (result.stage, result.warnings) == ("pixels", ())
    assert known.std["fx"] < result.std["fx"] < 1.3 * known.std["fx"]
    assert known.tone_std is None


def test_edges_alone_account_for_the_curve():
    picture = photo(2.6)
    edges = ts.detect(picture, tone="auto")
    result = ts.calibrate_edges(edges, IMAGE_SIZE)
    assert_within(result, SCENE, 4)
    bare = [ts.PlaneEdges(figure.lines, figure.points, figure.std) for figure in edges]
    assert result.std["fx"] > ts.calibrate_edges(bare, IMAGE_SIZE).std["fx"]
    wrong = ts.calibrate_edges(ts.detect(picture, tone="linear"), IMAGE_SIZE)
    error = abs(wrong.camera.fx - SCENE.camera.fx)
    assert error > 4 * abs(result.camera.fx - SCENE.camera.fx)


def test_where_no_curve_fits_the_edges_share_one_shift():
    picture = photo("srgb", noise=1.0, blur=1.0).astype(np.float64)
    sharpened = picture + 0.8 * (picture - cv2.GaussianBlur(picture, (0, 0), 1.0))
    sharpened = np.clip(np.rint(sharpened), 0, 255).astype(np.uint8)
    result = ts.calibrate(sharpened, tone="auto")
    (told,) = (each for each in result.warnings if each.code == "no_tone_curve")
    assert_within(result, SCENE, 5)
    known = ts.calibrate(sharpened, tone="srgb")
    grown = max(result.std[name] / known.std[name] for name in result.parameters)
    (factor,) = re.findall(r"up to ([\d.]+) times as large", told)
    assert float(factor) == pytest.approx(grown, rel=0.3)
    assert "no tone curve" in ts.diagnose(result)["fx"].limits


@pytest.mark.slow
def test_what_jpeg_does_to_profiles_is_in_the_standard_deviations():
    # The curve that fits compressed profiles best moves edges by more than its own std implies.
    camera = simulate.TrueCamera(1500, 1500, 1005, 745, (0.08, -0.15, 0, 0, 0), (2000, 1500))
    errors = []
    for seed in range(8):
        rng = np.random.default_rng([93, seed])
        scene = simulate.corner_scene(rng, camera=camera)
        picture = simulate.render(scene, rng, tone="srgb", clutter=12, colour=True, jpeg_quality=92)
        result = ts.calibrate(picture)
        assert result.tone_std is not None
        errors.append((result.camera.distortion[0] - 0.08) / result.std["k1"])
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def contrasted(picture):
    """The picture with a contrast curve that is not a gamma."""
    level = np.arange(256) / 255.0
    curve = 255.0 * (level - np.sin(2.0 * np.pi * level) / (4.0 * np.pi))
    return np.rint(curve).astype(np.uint8)[picture]


def test_boards_need_no_tone_curve_wherever_the_light_falls():
    """Along their lines the dark side alternates, and with it the shift that no curve describes."""
    rng = np.random.default_rng(95)
    camera = simulate.random_camera(rng)
    scenes = [simulate.chessboard_scene(rng, camera) for _ in range(4)]
    pictures = [simulate.render(own, rng, tone="srgb", shading=0.4) for own in scenes]
    plain, result = ts.calibrate(pictures), ts.calibrate([contrasted(own) for own in pictures])
    assert result.std["fx"] < 3.0 * plain.std["fx"]
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(camera, name)
        assert abs(error) < 4.0 * result.std[name], name


def beside_a_square(board, rng):
    """The scene of one board, with a square in the corner of the picture farthest from it."""
    camera, (target,) = board.camera, board.targets
    width, height = camera.image_size
    outline = camera.project(target.to_camera(target.outlines()[0]))
    places = [(x * width, y * height) for x in (0.1, 0.9) for y in (0.1, 0.9)]
    x, y = max(places, key=lambda place: np.hypot(*(outline - place).T).min())
    ray = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
    square = simulate.Target(
        simulate.tilted(35, rng.uniform(0, 360), 0), 10 * camera.fx / height * ray
    )
    return simulate.Scene(camera, (target, square))


def test_a_square_beside_a_board_does_not_make_its_lines_uncertain():
    """The light shifts the edges of the square, but not those of the board."""
    rng = np.random.default_rng([95, 1])
    camera = simulate.random_camera(rng)
    scenes = [beside_a_square(simulate.chessboard_scene(rng, camera), rng) for _ in range(4)]
    pictures = [simulate.render(own, rng, tone="srgb", shading=0.4) for own in scenes]
    plain, result = ts.calibrate(pictures), ts.calibrate([contrasted(own) for own in pictures])
    assert "no_tone_curve" in {warning.code for warning in result.warnings}
    assert result.std["fx"] < 3.0 * plain.std["fx"]
    assert abs(result.camera.fx - camera.fx) < 4.0 * result.std["fx"]


def test_pictures_of_one_camera_have_a_tone_each():
    other = squares(93, camera=SCENE.camera)
    second = simulate.render(other, np.random.default_rng(94), tone=1.4)
    result = ts.calibrate([photo(1.8), second], tone="auto")
    assert_within(result, SCENE, 4)
    assert 1.4 < result.tone < 1.8


def test_results_with_an_estimated_tone_are_kept_exactly():
    result = ts.calibrate(photo(1.8), tone="auto")
    for copy in (ts.Calibration.from_json(result.to_json()), pickle.loads(pickle.dumps(result))):
        assert (copy.tone, copy.tone_std) == (result.tone, result.tone_std)
    members = json.loads(result.to_json())
    del members["tone_std"]  # as written by earlier versions
    assert ts.Calibration.from_json(json.dumps(members)).tone_std is None


def test_drift_is_kept_exactly_and_checked():
    figure = ts.detect(photo(1.8), tone="auto")[0]
    assert [drift.shape for drift in figure.drift] == [points.shape for points in figure.points]
    for copy in (ts.PlaneEdges.from_json(figure.to_json()), pickle.loads(pickle.dumps(figure))):
        np.testing.assert_array_equal(np.concatenate(copy.drift), np.concatenate(figure.drift))
    known = ts.detect(photo(1.8), tone=1.8)[0]
    assert known.drift is None
    assert "drift" not in json.loads(known.to_json())
    for bad in ([np.zeros((3, 2))] * 4, [np.full(p.shape, np.nan) for p in figure.points]):
        with pytest.raises(ValueError, match="drift"):
            ts.PlaneEdges(figure.lines, figure.points, drift=bad)


def test_the_command_estimates_the_tone(tmp_path, capsys):
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), photo(1.8))
    with pytest.raises(SystemExit) as done:
        main(["calibrate", str(path), "--tone", "auto", "--json"])
    assert done.value.code == 0
    members = json.loads(capsys.readouterr().out)
    assert abs(members["tone"] - 1.8) < 4 * members["tone_std"]


def test_the_same_picture_gives_the_same_bits():
    picture = photo(2.2)
    first, again = (ts.calibrate(picture, tone="auto").to_json() for _ in range(2))
    assert first == again


def test_estimating_the_curve_moves_no_side_by_itself():
    picture = photo("srgb")
    known = ts.detect(picture, tone="srgb")
    estimated = ts.detect(picture, tone="auto")
    shifts, stds = [], []
    for one, other in zip(known, estimated, strict=True):
        for before, after, std in zip(one.points, other.points, one.std, strict=True):
            along = before[-1] - before[0]
            normal = np.array([-along[1], along[0]]) / np.hypot(*along)
            # A few samples may differ, beside an object that only one curve accepts.
            shifts.append(np.mean(after @ normal) - np.mean(before @ normal))
            stds.append(np.mean(std) / np.sqrt(len(std)))
    # There is one common shift to the dark; the rest of a side's shift is shared by its samples.
    assert np.std(shifts) < 0.5 * np.mean(stds)


def test_a_shift_that_is_not_told_from_zero_is_said_to_be_none():
    tones = {
        index: PictureTone("srgb", "srgb", shift=shift)
        for index, shift in enumerate([(0.0, 1.0874), (-0.02, 0.031), (0.1234, 0.0312), None])
    }
    text = shift_text(tones, [f"{index}.png" for index in tones])
    assert text is not None
    assert text.endswith("(0.png: 0 +- 1.1 px; 1.png: 0 +- 0.031 px; 2.png: 0.123 +- 0.031 px)")
    assert shift_text({3: tones[3]}, ["3.png"] * 4) is None


def test_a_tone_curve_that_costs_next_to_nothing_is_not_told():
    tones = {0: PictureTone("srgb", "srgb", shift=(0.0, 0.02))}
    assert shift_text(tones, ["a.png"], 1.1) is None
    text = shift_text(tones, ["a.png"], 3.14)
    assert text is not None
    assert "up to 3.1 times as large" in text


@pytest.mark.parametrize("seed", [15, 23, 28])
def test_an_estimated_shift_leaves_the_lens_one_that_sees_all_of_the_picture(seed):
    """Far from the targets the distortion is free; the step that freed the shift folded it."""
    rng = np.random.default_rng([17, seed])
    camera = simulate.TrueCamera(1080, 1078, 655, 468, (-0.25, 0.08, 7e-4, -5e-4, 0), (1280, 960))
    scene = simulate.random_scene(rng, camera=camera)
    edges = []
    for sides in simulate.edge_points(scene, rng, noise=0.03):
        middle = np.mean([side.mean(axis=0) for side in sides], axis=0)
        inward = [_towards(middle, side) for side in sides]
        shifted = [side + 0.075 * own + [310, 240] for side, own in zip(sides, inward, strict=True)]
        square = ts.PlaneEdges.square(shifted, std=0.03)
        drift = tuple(
            np.tile(0.05 * own, (len(side), 1)) for side, own in zip(sides, inward, strict=True)
        )
        edges.append(ts.PlaneEdges(square.lines, square.points, square.std, drift=drift))
    result = ts.calibrate_edges(edges, (1900, 1440), model="brown")
    assert np.isfinite(result.camera.unproject([[0, 0], [1899, 0], [1899, 1439], [0, 1439]])).all()
    assert abs(result.camera.fx - camera.fx) < 4 * result.std["fx"]


def _towards(middle, side):
    """Return the unit normal of a side that points towards `middle`."""
    x, y = side[-1] - side[0]
    normal = np.array([-y, x]) / np.hypot(x, y)
    return normal * np.sign(normal @ (middle - side.mean(axis=0)))
