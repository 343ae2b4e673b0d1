"""Damaged scenes have the stated damage, their squares are found, and the damage is named."""

import re
from functools import cache

import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare.detection.squares.find import find_squares
from trisquare.simulate.pixel_coverage import quadrilateral_coverage
from trisquare.simulate.scene import Target, TrueCamera, sample_sides
from trisquare_scenes.damage import (
    BOW_RANGE,
    HIDDEN_RANGE,
    KINDS,
    MIN_HIDDEN,
    RECTANGLE_RATIO,
    TRAPEZIUM_RANGE,
    CurledTarget,
    damaged_scene,
)
from trisquare_scenes.occluders import Overlay, polygon_mask, spot_mask

SMALL = (640, 480)
HIDING = ("finger", "glare", "torn", "stain")


@cache
def draw(kind, index, image_size=SMALL):
    rng = np.random.default_rng([31, KINDS.index(kind), index])
    picture, scene, damage = damaged_scene(rng, kind, image_size)
    picture.flags.writeable = False
    return picture, scene, damage


def test_a_polygon_covers_its_area_and_a_spot_ends_where_it_says():
    triangle = np.array([[20.3, 10.1], [70.8, 30.2], [35.5, 60.9]])
    (a, b), (c, d) = triangle[1:] - triangle[0]
    mask = polygon_mask(triangle, (100, 80), 1.0)
    # OpenCV fills the pixels that the outline touches: half of an eighth of a pixel on all sides.
    perimeter = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1).sum()
    area = 0.5 * abs(a * d - b * c)
    assert area < mask.sum() < area + perimeter / 8.0
    assert mask.max() == pytest.approx(1.0, abs=1e-6)
    spot = spot_mask(np.array([40.0, 30.0]), np.array([1.0, 0.0]), (10.0, 5.0), (100, 80))
    assert spot[30, 40] == 1.0
    assert spot[30, 50] == pytest.approx(np.exp(-1.0))
    assert spot[35, 40] == pytest.approx(np.exp(-1.0))


def test_an_overlay_hides_dims_or_brightens():
    canvas = np.full((4, 5, 1), 0.5)
    canvas[1, 2] = 0.9
    mask = np.zeros((4, 5))
    mask[0, 0] = 1.0
    values = [
        Overlay(mask, opacity, own)(canvas)[0, 0, 0]
        for opacity, own in [(1.0, (2, 1)), (0.4, np.zeros(1)), (0.0, np.ones(1))]
    ]
    assert values == pytest.approx([0.9, 0.3, 1.5])


def test_a_bow_adds_the_area_under_its_parabola():
    camera = TrueCamera(500.0, 500.0, 150.0, 120.0, image_size=(300, 240))
    targets = [
        CurledTarget(np.eye(3), np.array([0.0, 0.0, 5.0]), bows=np.array([0.0, bow, 0.0, 0.0]))
        for bow in (0.0, 0.02, -0.02)
    ]
    areas = [quadrilateral_coverage(camera, target, target.sides(), 0.8) for target in targets]
    straight, outward, inward = (patch.coverage.sum() for patch in areas)
    # Two thirds of 100 px times 2 px.
    assert outward - straight == pytest.approx(400.0 / 3.0, rel=1e-3)
    assert straight - inward == pytest.approx(400.0 / 3.0, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_what_it_says(kind):
    _, scene, damage = draw(kind, 0)
    target = scene.targets[damage.plane]
    if kind in HIDING:
        own = [share for *place, share in damage.hidden if place == [damage.plane, 0, damage.side]]
        assert own == [damage.extent]
        assert MIN_HIDDEN <= damage.extent <= HIDDEN_RANGE[1]
        assert {plane for plane, *_ in damage.hidden} == {damage.plane}
    elif kind == "curl":
        bent, flat = (
            sample_sides(scene.camera, shape, 1.0)[damage.side]
            for shape in (target, Target(target.rotation, target.translation, target.kind))
        )
        middle = len(flat.image) // 2
        across = (bent.image[len(bent.image) // 2] - flat.image[middle]) @ flat.normal[middle]
        assert abs(across) == pytest.approx(damage.extent, rel=0.02)
        assert BOW_RANGE[0] <= damage.extent <= BOW_RANGE[1]
    else:
        outline = target.outlines()[0]
        lengths = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)
        rectangular = np.allclose(lengths[:2], lengths[2:])
        departure = lengths.max() / lengths.min() - 1.0 if rectangular else 1.0 - lengths.min()
        assert damage.extent == pytest.approx(departure, abs=1e-9)
        if rectangular:
            assert damage.extent == pytest.approx(RECTANGLE_RATIO - 1.0)
        else:
            assert TRAPEZIUM_RANGE[0] <= damage.extent <= TRAPEZIUM_RANGE[1]
        if kind != "false_of_three":
            assert rectangular == (kind == "rectangle")
    assert len(scene.targets) in ((4, 5) if kind in ("rectangle", "trapezium") else (3,))


def test_an_unknown_damage_is_refused():
    with pytest.raises(ValueError, match="unknown damage 'rust'"):
        damaged_scene(np.random.default_rng(0), "rust")


@pytest.mark.parametrize("kind", HIDING)
@pytest.mark.parametrize("index", first_quick(range(4)))
def test_squares_with_a_hidden_stretch_are_found(kind, index):
    picture, scene, _ = draw(kind, index)
    found = find_squares(picture)
    assert len(found) == len(scene.targets)
    for number, target in enumerate(scene.targets):
        corners = scene.image_points(number, target.outlines()[0])
        gaps = [
            np.abs(np.roll(square.outer.corners, turn, axis=0) - corners).max()
            for square in found
            for turn in range(4)
        ]
        assert min(gaps) < 3.0


@pytest.mark.parametrize("kind", first_quick(HIDING, 2))
def test_a_hidden_stretch_is_named_and_does_no_harm(kind):
    picture, scene, damage = draw(kind, 1, (1280, 960))
    result = ts.calibrate(picture)
    truth = scene.camera
    for name in ("fx", "fy", "cx", "cy"):
        estimate = getattr(result.camera, name)
        assert abs(estimate - getattr(truth, name)) < 4.0 * result.std[name]
    centre = scene.image_points(damage.plane, np.zeros((1, 2)))[0]
    middles = [plane.corners.mean(axis=0) for plane in result.planes]
    plane = int(np.linalg.norm(middles - centre, axis=1).argmin())
    corners = result.planes[plane].corners
    hidden = sample_sides(truth, scene.targets[damage.plane], 4.0)[damage.side].image.mean(axis=0)
    sides = 0.5 * (corners + np.roll(corners, -1, axis=0))
    side = int(np.linalg.norm(sides - hidden, axis=1).argmin())
    named = rf"plane {plane}: (\d+) % of side {side}\b"
    parts = [int(match[1]) for text in result.warnings if (match := re.match(named, text))]
    # The omitted part includes the hidden part, and a stretch at either end.
    assert len(parts) >= 1
    assert 50.0 * damage.extent < parts[0] < 100.0 * damage.extent + 20.0
