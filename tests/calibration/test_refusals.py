"""Geometry that does not determine the camera is refused, with a cause and effective remedies."""

import re
from dataclasses import replace

import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE, PLACES, assert_within, camera_of, edges_of, squares

import trisquare as ts
from trisquare import simulate

CAMERA = simulate.TrueCamera(
    1100.0, 1100.0, 651.0, 470.0, np.array([-0.2, 0.04, 0.0, 0.0, 0.0]), IMAGE_SIZE
)
LONG = simulate.TrueCamera(
    1500.0, 1503.0, 630.0, 485.0, np.array([0.08, 0.02, 0.0, 0.0, 0.0]), IMAGE_SIZE
)


def placed(tilts, directions, sides=(330, 290, 360), camera=CAMERA, spins=(10, 50, 75), at=PLACES):
    """Squares as placed on a table; sides in pixels."""
    planned = [
        ts.PlannedSquare.at(
            camera_of(simulate.Scene(camera, ())),
            np.multiply(place, IMAGE_SIZE),
            side,
            tilt=tilt,
            direction=direction,
            spin=spin,
        )
        for place, side, tilt, direction, spin in zip(
            at, sides, tilts, directions, spins, strict=False
        )
    ]
    targets = tuple(simulate.Target(p.rotation, p.translation) for p in planned)
    return simulate.Scene(camera, targets)


def refusal(scene, noise=0.1, seed=0, **options):
    with pytest.raises(ts.DegenerateGeometryError) as refused:
        ts.calibrate_edges(edges_of(scene, noise, seed), IMAGE_SIZE, **options)
    return str(refused.value)


@pytest.mark.parametrize("camera", [CAMERA, LONG], ids=["short", "long"])
@pytest.mark.parametrize("noise", first_quick([0.5, 1e-6, 0.05, 0.2]))
def test_parallel_squares_are_never_answered(camera, noise):
    for seed, (tilt, direction) in enumerate([(25, 20), (35, 80), (45, 130), (30, 200), (50, 310)]):
        scene = placed([tilt] * 3, [direction] * 3, camera=camera)
        message = refusal(scene, noise, seed)
        assert "parallel" in message
        assert re.search(r"(fx|fy|cx|cy) is not determined \(.*standard deviation", message)


@pytest.mark.parametrize("fix", ["principal_point", ["principal_point", "aspect"]])
def test_parallel_squares_answer_with_the_principal_point_held_at_the_truth(fix):
    for seed, (tilt, direction) in enumerate([(35, 40), (45, 130), (40, 220), (30, 310)]):
        scene = placed([tilt] * 3, [direction] * 3)
        edges = edges_of(scene, 0.2, seed)
        found = ts.calibrate_edges(edges, IMAGE_SIZE, fix=fix, initial=camera_of(scene))
        assert_within(found, scene, 4)


def test_parallel_tilts_about_the_pictures_own_axis_leave_the_aspect_open():
    """With the principal point held, one direction gives two equations, but here only one."""
    scene = placed([25] * 3, [0] * 3, camera=LONG)
    message = refusal(scene, 0.3, fix="principal_point", initial=camera_of(scene))
    assert message.startswith("all 3 planes are parallel")
    assert "; fix the aspect" in message
    fix = ["principal_point", "aspect"]
    edges = edges_of(scene, 0.3)
    assert_within(
        ts.calibrate_edges(edges, IMAGE_SIZE, fix=fix, initial=camera_of(scene)), scene, 4
    )


@pytest.mark.parametrize("scenes", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_sound_scenes_are_answered_whatever_the_noise(scenes):
    for seed in range(scenes):
        scene = squares(seed)
        for noise in (1e-6, 0.05, 0.5, 1.0):
            assert_within(ts.calibrate_edges(edges_of(scene, noise, seed), IMAGE_SIZE), scene, 5)


DIRECTIONS = (15, 135, 255)
CASES = {
    "parallel": (placed([35] * 3, [70] * 3), 0.1, {}, "all 3 planes are parallel within"),
    "nearly": (placed([30, 31, 32], [70, 71, 70]), 0.3, {}, "all 3 planes are parallel within"),
    "alike": (placed([2, 5, 4], [70, 60, 230]), 0.3, {}, "the planes are nearly parallel: "),
    "facing, held": (
        placed([2] * 3, DIRECTIONS),
        0.1,
        {"fix": "principal_point"},
        "all 3 planes face the camera",
    ),
    "one": (
        placed([1], [30], at=[(0.5, 0.5)]),
        0.1,
        {"fix": "principal_point"},
        "the plane faces the camera",
    ),
    "small": (
        placed([30] * 3, DIRECTIONS, sides=(60, 60, 60)),
        0.3,
        {},
        r"the targets are small \(the largest spans \d+ pixels\)",
    ),
    "huddled": (
        placed(
            [20] * 3, DIRECTIONS, sides=(190,) * 3, at=[(0.15, 0.15), (0.36, 0.15), (0.25, 0.42)]
        ),
        0.6,
        {},
        "the targets cover only",
    ),
    "two planes": (
        placed([35, 35], [70, 70], at=[(0.27, 0.5), (0.73, 0.5)]),
        0.1,
        {"fix": "aspect"},
        "all 2 planes are parallel",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_cause_is_named_and_remedies_work(name):
    scene, noise, options, cause = CASES[name]
    message = refusal(scene, noise, **options)
    print(message)
    assert re.match(cause, message)
    held = [options["fix"]] if "fix" in options else []
    tried = 0
    for words, fix in (
        ("; fix the aspect(,|$)", ["aspect"]),
        ("fix the principal point", ["principal_point"]),
        ("fix the aspect and the principal point", ["aspect", "principal_point"]),
    ):
        if re.search(words, message):
            tried += 1
            ts.calibrate_edges(edges_of(scene, noise), IMAGE_SIZE, fix=[*held, *fix])
    larger = re.search(r"at least ([\d.]+) times larger", message)
    tilted = re.search(r"tilt them by at least (\d+)|by at least (\d+) degrees, each", message)
    if larger or tilted:
        tried += 1
        better = improved(
            scene, larger and float(larger[1]), tilted and float(max(tilted.groups("")))
        )
        ts.calibrate_edges(edges_of(better, noise), IMAGE_SIZE, **options)
    assert tried > 0, message


@pytest.mark.parametrize("seed", first_quick(range(4)))
def test_the_limit_is_told_as_a_part_where_the_focal_length_is_any(seed):
    """With squares that face the camera, a limit in pixels was arbitrary, or zero."""
    message = refusal(placed([0] * 3, [0] * 3), 0.05, seed)
    limit = re.search(r"standard deviation more than 1000 % of .*, at most (\S+) % is acc", message)
    assert limit[1] == "4.0"


USUAL_OFFSETS = np.array([(0.0, 0.0), (0.015, 0.0), (-0.01, 0.01), (-0.005, -0.015)])
"""Offsets of the principal point from the image centre, as fractions of the width."""


def is_answered(scene, fix, camera):
    try:
        ts.calibrate_edges(edges_of(scene, 0.1), IMAGE_SIZE, fix=fix, initial=camera)
    except ts.DegenerateGeometryError:
        return False
    return True


@pytest.mark.parametrize(
    ("tilt", "direction", "offset", "advised"),
    [
        (2.0, 290, -15.0, [["aspect", "principal_point"]]),
        (2.0, 200, -8.0, []),
        pytest.param(2.0, 40, 12.0, [], marks=pytest.mark.slow),
        pytest.param(1.0, 290, -15.0, [], marks=pytest.mark.slow),
    ],
)
def test_a_principal_point_is_advised_only_where_any_usual_one_helps(
    tilt, direction, offset, advised
):
    camera = simulate.TrueCamera(1150.0, 1150.0, 639.5 + offset, 479.5, np.zeros(5), IMAGE_SIZE)
    scene = placed([tilt] * 3, [direction] * 3, camera=camera)
    message = refusal(scene, 0.1)
    fixes = {
        "or fix the principal point": ["principal_point"],
        "or fix the aspect and the principal point": ["aspect", "principal_point"],
    }
    assert [fix for words, fix in fixes.items() if words in message] == advised
    usual = [replace(camera, cx=639.5 + x, cy=479.5 + y) for x, y in USUAL_OFFSETS * IMAGE_SIZE[0]]
    for fix in fixes.values():
        answers = [
            is_answered(scene, fix, camera_of(simulate.Scene(own, ()))) for own in (camera, *usual)
        ]
        assert all(answers) == (fix in advised)


def improved(scene, factor, tilt):
    """The scene as advised by the message: squares at the same positions, larger and tilted."""
    count = len(scene.targets)
    step = 90.0 if count == 2 else 360.0 / count
    targets = []
    for number, target in enumerate(scene.targets):
        spin = np.degrees(np.arctan2(target.rotation[1, 0], target.rotation[0, 0]))
        rotation = target.rotation
        if tilt:
            rotation = simulate.tilted(tilt, 25.0 + step * number, spin)
        targets.append(simulate.Target(rotation, target.translation / (factor or 1.0)))
    return simulate.Scene(scene.camera, tuple(targets))


def test_linear_method_says_the_same():
    message = refusal(CASES["parallel"][0], method="linear")
    assert message.startswith("all 3 planes are parallel")
