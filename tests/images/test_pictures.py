"""From pictures to results: pixel types, views, colours, several pictures, chessboards."""

import re
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE, assert_within, squares

import trisquare as ts
from trisquare import simulate

SCENE = squares(31)
PHOTO = simulate.render(SCENE, np.random.default_rng(32))
SRGB_GAMMA = 2.2
RESULT = ts.calibrate(PHOTO, tone="linear")


def distances(points, scene):
    """Distances of pixels from the nearest true outline of a scene."""
    share = np.linspace(0, 1, 250)[:, None]
    nearest = np.full(len(points), np.inf)
    for number, target in enumerate(scene.targets):
        for outline in target.outlines():
            for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                curve = scene.image_points(number, start + share * (end - start))
                closest = np.argmin(((points[:, None] - curve[:-1]) ** 2).sum(axis=2), axis=1)
                along = np.diff(curve, axis=0)[closest]
                off = points - curve[closest]
                across = off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]
                nearest = np.minimum(nearest, np.abs(across) / np.hypot(*along.T))
    return nearest


# The quick cases have every figure in one tone, and every tone.
@pytest.mark.parametrize(
    ("kind", "dark", "tone"),
    [
        pytest.param(*figure, tone, marks=() if place == number % 3 else pytest.mark.slow)
        for number, figure in enumerate(product(["square", "frame"], [True, False]))
        for place, tone in enumerate(["srgb", "linear", 2.2])
    ],
)
def test_rendered_pictures_are_calibrated(kind, dark, tone):
    scene = squares(33, kind=kind, dark=dark)
    photo = simulate.render(scene, np.random.default_rng(34), tone=tone)
    result = ts.calibrate(photo, tone=tone)
    assert_within(result, scene, 4.5)
    assert [plane.kind for plane in result.planes] == [kind] * 3
    assert (result.tone, result.method) == (tone, "ml")
    assert result.stage in ("edges", "pixels")


@pytest.mark.parametrize("seed", first_quick([35, 36]))
def test_photo_like_pictures_are_calibrated_with_default_settings(seed):
    photo, scene, _ = simulate.photo_like(np.random.default_rng(seed))
    result = ts.calibrate(photo)
    assert_within(result, scene, 5)
    assert abs(result.tone - SRGB_GAMMA) < 4 * result.tone_std


def test_the_wrong_tone_curve_moves_the_answer():
    # Without an effect, `tone` would not be in the model: it is about a thousandth of fx.
    other = ts.calibrate(PHOTO, tone="srgb")
    assert abs(other.camera.fx - RESULT.camera.fx) > 3 * RESULT.std["fx"]


@pytest.mark.parametrize(("dark", "polarity"), [(True, 1), (False, -1)])
def test_detect_measures_the_sides_as_well_as_it_says(dark, polarity):
    scene = squares(37, kind="frame", dark=dark)
    photo = simulate.render(scene, np.random.default_rng(38))
    figures = ts.detect(photo, tone="linear")
    assert [figure.kind for figure in figures] == ["frame"] * 6
    assert [figure.freedom for figure in figures[1::2]] == ["size"] * 3
    # The ring is dark between its outlines, so the inner figure has the opposite polarity.
    assert [figure.polarity for figure in figures] == [polarity, -polarity] * 3
    assert len({figure.plane for figure in figures}) == 3
    points = np.vstack([side for figure in figures for side in figure.points])
    std = np.concatenate([side for figure in figures for side in figure.std])
    assert 0.9 < np.sqrt(np.mean((distances(points, scene) / std) ** 2)) < 1.1
    assert np.median(std) < 0.03


def test_the_edges_of_a_picture_are_enough():
    result = ts.calibrate_edges(ts.detect(PHOTO, tone="linear"), IMAGE_SIZE)
    assert result.stage == "edges"
    assert_within(result, SCENE, 4)
    # Both stages have the same noise, so that they differ by less than their errors.
    for name in ("fx", "fy", "cx", "cy"):
        difference = getattr(result.camera, name) - getattr(RESULT.camera, name)
        assert abs(difference) < 2 * result.std[name]


def test_a_path_is_as_good_as_its_picture(tmp_path):
    cv2.imwrite(str(tmp_path / "photo.png"), PHOTO)
    for path in (tmp_path / "photo.png", str(tmp_path / "photo.png")):
        assert ts.calibrate(path, tone="linear").to_json() == RESULT.to_json()


def views_of(photo):
    height, width = photo.shape
    padded = np.zeros((2 * height, 3 * width), photo.dtype)
    padded[::2, ::3] = photo
    writeable = photo.copy()
    writeable.flags.writeable = False
    return {
        "every second pixel": padded[::2, ::3],
        "column by column": np.asfortranarray(photo),
        "turned twice": np.ascontiguousarray(photo[::-1, ::-1])[::-1, ::-1],
        "read-only": writeable,
        "one channel": photo[:, :, None],
    }


@pytest.mark.parametrize("name", views_of(np.zeros((2, 2))))
def test_views_are_read_as_they_look(name):
    view = views_of(PHOTO)[name]
    before = view.copy()
    assert ts.calibrate(view, tone="linear").to_json() == RESULT.to_json()
    np.testing.assert_array_equal(view, before)


@pytest.mark.parametrize(
    "same",
    [
        PHOTO.astype(np.uint16) * 257,
        (PHOTO / 255).astype(np.float32),
        PHOTO.astype(np.float32),
        np.repeat(PHOTO[:, :, None], 3, axis=2),
        np.dstack([PHOTO.astype(np.uint16) * 257] * 3),
    ],
    ids=["uint16", "float32 to 1", "float32 to 255", "BGR", "BGR uint16"],
)
def test_every_kind_of_pixel_gives_the_same_answer(same):
    result = ts.calibrate(same, tone="linear")
    for name in ("fx", "fy", "cx", "cy"):
        difference = getattr(result.camera, name) - getattr(RESULT.camera, name)
        assert abs(difference) < 0.05 * RESULT.std[name]
        assert result.std[name] == pytest.approx(RESULT.std[name], rel=0.02)


def test_floats_are_linear_by_default():
    photo = simulate.render(SCENE, np.random.default_rng(39), dtype=np.float32)
    result = ts.calibrate(photo)
    assert result.tone == "linear"
    assert_within(result, SCENE, 4.5)


@pytest.mark.parametrize("seed", range(3))
def test_a_lens_that_darkens_the_corners_biases_nothing(seed):
    """By a quarter, as usual lenses do: a model of light linear along sides gave 0.1 % in fx."""
    rng = np.random.default_rng([77, seed])
    scene = simulate.random_scene(rng)
    light = simulate.render(scene, rng, noise=0.0, blur=1.2, dtype=np.float32)
    y, x = np.mgrid[: light.shape[0], : light.shape[1]] - np.reshape(light.shape, (2, 1, 1)) / 2
    light *= 1.0 - 0.25 * (x**2 + y**2) / (x**2 + y**2).max()
    photo = (light + rng.normal(0.0, 5e-4, light.shape)).astype(np.float32)
    result = ts.calibrate(photo)
    edges = ts.calibrate_edges(ts.detect(photo), result.camera.image_size)
    for found in (result, edges):
        assert abs(found.camera.fx / scene.camera.fx - 1.0) < 1e-4
        assert abs(found.camera.fx - scene.camera.fx) < 4.0 * found.std["fx"]


@pytest.mark.parametrize("whole", [255, 65535])
def test_floats_that_hold_integers_are_taken_as_these(whole):
    kind = np.uint8 if whole == 255 else np.uint16
    photo = simulate.render(SCENE, np.random.default_rng(39), dtype=kind, tone="srgb")
    expected = ts.calibrate(photo)
    for floats in (photo.astype(np.float32), (photo / whole).astype(np.float32)):
        assert ts.calibrate(floats) == expected
    figures = ts.detect(photo)[0], ts.detect((photo / whole).astype(np.float32))[0]
    np.testing.assert_array_equal(*(figure.points[0] for figure in figures))


@pytest.mark.parametrize("tone", [None, "srgb"])
def test_sixteen_bits_may_hold_fewer(tone):
    photo = simulate.render(SCENE, np.random.default_rng(39), tone="srgb")
    expected = ts.calibrate(photo, tone=tone)
    assert ts.calibrate(photo.astype(np.uint16), tone=tone) == expected
    for bits in (10, 12):
        deep = np.rint(photo / 255 * (2**bits - 1)).astype(np.uint16)
        result = ts.calibrate(deep, tone=tone)
        assert result.warnings == expected.warnings
        for name in ("fx", "fy", "cx", "cy"):
            difference = getattr(result.camera, name) - getattr(expected.camera, name)
            assert abs(difference) < expected.std[name]
            assert result.std[name] == pytest.approx(expected.std[name], rel=0.1)


@pytest.mark.parametrize(("tone", "gamma"), [("linear", 1.0), ("srgb", SRGB_GAMMA)])
def test_the_tone_of_sixteen_bits_is_estimated_by_default(tone, gamma):
    photo = simulate.render(SCENE, np.random.default_rng(39), dtype=np.uint16, tone=tone)
    result = ts.calibrate(photo)
    assert abs(result.tone - gamma) < 4 * result.tone_std
    assert result.warnings == ()
    assert_within(result, SCENE, 4.5)
    if tone == "srgb":
        wrong = ts.calibrate(photo, tone="linear")
        assert wrong.warnings[0].code == "tone_contradicted"


@pytest.mark.parametrize("gamma", [2.0, 2.6])
def test_a_stated_tone_that_the_pixels_contradict_is_named_with_its_consequence(gamma):
    """The edges' profiles alone do not distinguish these from sRGB."""
    photo = simulate.render(SCENE, np.random.default_rng(62), noise=2.0, tone=gamma)
    result = ts.calibrate(photo, tone="srgb")
    told = result.warnings[0]
    assert (told.code, told.severity) == ("tone_contradicted", "high")
    assert 'use tone="auto"' in told
    found, change = re.search(r"gamma of ([\d.]+) .* fx changes by ([-+][\d.]+);", told).groups()
    assert float(found) == pytest.approx(gamma, rel=0.06)
    estimated = ts.calibrate(photo)
    moved = estimated.camera.fx - result.camera.fx
    assert float(change) == pytest.approx(moved, rel=0.3)
    assert result.std["fx"] > 0.95 * abs(moved)
    assert_within(result, SCENE, 4.0)


def test_a_stated_tone_that_is_right_is_not_contradicted():
    photo = simulate.render(SCENE, np.random.default_rng(62), noise=2.0, tone="srgb")
    assert ts.calibrate(photo, tone="srgb").warnings == ()


def test_several_pictures_of_one_camera_pool_their_planes():
    scenes = [SCENE, squares(40, SCENE.camera)]
    photos = [PHOTO, simulate.render(scenes[1], np.random.default_rng(41))]
    seen = []
    result = ts.calibrate(photos, tone="linear", progress=lambda *done: seen.append(done))
    assert [plane.image for plane in result.planes] == [0, 0, 0, 1, 1, 1]
    assert seen == [(1, 2), (2, 2)]
    assert_within(result, SCENE, 4.5)
    assert all(result.std[name] < RESULT.std[name] for name in result.std)


def test_a_picture_without_squares_is_passed_over_and_named():
    blank = np.full_like(PHOTO, 200)
    result = ts.calibrate([blank, PHOTO], tone="linear")
    assert result.warnings[0].startswith("picture 0: the picture is nearly white")
    assert "no square, chessboard or tag found" in result.warnings[0]
    assert {plane.image for plane in result.planes} == {1}
    assert result.camera.fx == pytest.approx(RESULT.camera.fx, rel=1e-12)


def test_chessboards_are_calibrated():
    camera = SCENE.camera
    rng = np.random.default_rng(42)
    scenes = [simulate.chessboard_scene(rng, camera) for _ in range(3)]
    photos = [simulate.render(scene, rng) for scene in scenes]
    result = ts.calibrate(photos, tone="linear", targets="chessboard:9x6")
    assert [(plane.kind, plane.image) for plane in result.planes] == [
        ("chessboard", image) for image in range(3)
    ]
    assert_within(result, scenes[0], 4.5)


def test_the_paper_s_steps_alone_from_a_picture():
    result = ts.calibrate(PHOTO, tone="linear", method="linear")
    assert (result.method, result.stage) == ("linear", "linear")
    assert result.camera.fx == pytest.approx(SCENE.camera.fx, rel=0.05)


def test_threads_calibrate_pictures_side_by_side():
    with ThreadPoolExecutor(4) as pool:
        texts = pool.map(lambda _: ts.calibrate(PHOTO, tone="linear").to_json(), range(8))
        assert set(texts) == {RESULT.to_json()}
