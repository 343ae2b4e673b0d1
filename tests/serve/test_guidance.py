"""Guidance before a photograph is taken, compared with the photograph's results."""

import numpy as np
import pytest
from quick import first_quick
from scenes import squares

import trisquare as ts
from trisquare import simulate
from trisquare.camera.camera import Camera, centred_pinhole
from trisquare.errors import ConvergenceError
from trisquare.serve import guidance
from trisquare.serve.guidance import OutlinedSquare, guide

SIZE = (1280, 960)
CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def outlined(scene, rng=None, noise=0.0):
    """The squares of a scene as found by a search: along their curved sides."""
    found = []
    for plane in range(len(scene.targets)):
        following = np.roll(CORNERS, -1, axis=0)
        shares = np.linspace(0.0, 1.0, 9)[:, None]
        sides = [
            scene.image_points(plane, a + shares * (b - a))
            for a, b in zip(CORNERS, following, strict=True)
        ]
        if rng is not None:
            sides = [side + rng.normal(0.0, noise, side.shape) for side in sides]
        found.append(OutlinedSquare(np.array([side[0] for side in sides]), None, sides))
    return found


def standing(camera, *squares):
    """Outlines of planned squares: centre, side, tilt and direction of each."""
    found = []
    for centre, side, tilt, direction in squares:
        plan = ts.PlannedSquare.at(camera, centre, side, tilt=tilt, direction=direction)
        corners = np.column_stack([CORNERS, np.zeros(4)]) @ plan.rotation.T + plan.translation
        found.append(OutlinedSquare(camera.project(corners)))
    return found


@pytest.mark.parametrize("seed", first_quick(range(12), 3))
def test_the_prediction_is_what_the_photograph_then_tells(seed):
    """Within a factor of two, from outlines that are half a pixel off; the noise is unknown."""
    rng = np.random.default_rng(seed)
    scene = squares(seed, image_size=SIZE)
    found = guide(outlined(scene, rng, 0.5), SIZE)
    lens = scene.camera
    truth = Camera([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]], lens.distortion, SIZE)
    stated = ts.predict(truth, scene.targets, 0.03, model="radial2").std
    for name in ("fx", "cx"):
        assert 0.5 < found.std[name] / stated[name] < 2.0
    assert found.focal == pytest.approx(lens.fx, rel=0.15)


def test_what_is_advised_does_help():
    """Two good squares and one that faces the camera: the advice is to tilt it, which helps."""
    camera = centred_pinhole(1100.0, SIZE)
    good = [((990, 300), 380, 38, 120), ((640, 690), 380, 38, 240)]
    found = guide(standing(camera, ((270, 290), 380, 3, 0), *good), SIZE, camera)
    assert found.advice.startswith(("Tilt the left square", "Good; better still: tilt the left"))
    edge = found.advice.split("move its ")[1].split(" edge")[0]
    direction = {"lower": 0.0, "left": 90.0, "upper": 180.0, "right": 270.0}[edge]
    better = guide(standing(camera, ((270, 290), 380, 15, direction), *good), SIZE, camera)
    assert better.std["fx"] * better.std["cx"] < 0.95 * found.std["fx"] * found.std["cx"]


def test_a_square_that_cannot_be_placed_gives_its_name_to_no_other(monkeypatch):
    camera = centred_pinhole(1100.0, SIZE)
    places = ((990, 300), 380, 38, 120), ((640, 690), 380, 38, 240), ((270, 290), 380, 3, 0)
    standing_there = standing(camera, *places)
    advice = guide(standing_there, SIZE, camera).advice
    assert "the left square" in advice
    place, tried = guidance.calibrate_edges, []

    def place_all_but_the_first(*arguments, **options):
        tried.append(arguments)
        if len(tried) == 1:
            raise ConvergenceError("it stands nowhere")
        return place(*arguments, **options)

    monkeypatch.setattr(guidance, "calibrate_edges", place_all_but_the_first)
    nowhere = standing(camera, ((1150, 800), 100, 30, 60))
    assert guide([*nowhere, *standing_there], SIZE, camera).advice == advice


@pytest.mark.parametrize(
    ("direction", "edge"), [(0.0, "lower"), (90.0, "left"), (180.0, "upper"), (270.0, "right")]
)
def test_the_edge_that_is_named_is_the_one_that_moves_away(direction, edge):
    from trisquare.serve.guidance import TILT_EDGES

    plan = ts.PlannedSquare.at(
        centred_pinhole(1000.0, SIZE), (640, 480), 200, tilt=20, direction=direction
    )
    middles = {"upper": (0, -0.5), "lower": (0, 0.5), "left": (-0.5, 0), "right": (0.5, 0)}
    depth = {name: (plan.rotation @ [*at, 0.0])[2] for name, at in middles.items()}
    assert max(depth, key=depth.get) == edge == TILT_EDGES[direction]


def test_squares_that_face_the_camera_determine_nothing():
    camera = centred_pinhole(1000.0, SIZE)
    places = [((300, 300), 250, 0, 0), ((950, 300), 250, 0, 0), ((640, 700), 250, 0, 0)]
    found = guide(standing(camera, *places), SIZE, camera)
    assert found.std is None
    assert not found.is_enough
    assert "ilt" in found.advice


@pytest.mark.parametrize("count", [0, 1, 2])
def test_more_squares_are_asked_for(count):
    found = guide(outlined(squares(3, image_size=SIZE))[:count], SIZE)
    assert found.std is None
    assert ["three squares", "two more", "one more"][count] in found.advice


def test_a_known_camera_is_taken_and_scaled():
    scene = squares(4, image_size=SIZE)
    camera = centred_pinhole(scene.camera.fx / 2, (640, 480))
    found = guide(outlined(scene), SIZE, camera)
    assert found.focal == pytest.approx(scene.camera.fx, rel=1e-9)


def test_a_known_fisheye_is_guided_too():
    """Squares with bent sides, which no pinhole explains."""
    camera = Camera([[380, 0, 640], [0, 380, 480], [0, 0, 1]], [0.02, 0, 0, 0], SIZE, "fisheye")
    places = [((350, 300), 260, 35, 100), ((930, 330), 260, 35, 220), ((640, 740), 260, 35, 340)]
    plans = [
        ts.PlannedSquare.at(camera, centre, side, tilt=tilt, direction=direction)
        for centre, side, tilt, direction in places
    ]
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    outlines = []
    for plan in plans:
        ends = zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)
        flat = [np.pad(a + shares * (b - a), ((0, 0), (0, 1))) for a, b in ends]
        sides = [camera.project(side @ plan.rotation.T + plan.translation) for side in flat]
        outlines.append(OutlinedSquare(np.array([side[0] for side in sides]), None, sides))
    found = guide(outlines, SIZE, camera)
    stated = ts.predict(camera, plans, guidance.SIGMA).std
    assert found.std == pytest.approx(stated, rel=0.05)


def test_outlines_that_no_squares_have_are_no_failure():
    """A live picture may briefly show any outlines."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        quads = []
        for _ in range(3):
            centre = rng.uniform(300, 700, 2)
            angles = np.sort(rng.uniform(0, 2 * np.pi, 4))
            around = np.column_stack([np.cos(angles), np.sin(angles)])
            quads.append(centre + rng.uniform(20, 200) * around)
        found = guide([OutlinedSquare(quad) for quad in quads], SIZE)
        assert found.advice.endswith(".")


def test_frames_are_known_better_than_solid_squares():
    scene = squares(5, image_size=SIZE)
    solid = outlined(scene)
    framed = [
        one._replace(inner=scene.image_points(plane, 0.6 * CORNERS))
        for plane, one in enumerate(solid)
    ]
    assert guide(framed, SIZE).std["fx"] < 0.95 * guide(solid, SIZE).std["fx"]


def test_the_simulated_scenes_are_in_the_picture():
    for plane in range(3):
        points = squares(5, image_size=SIZE).image_points(plane, CORNERS)
        assert (points > 0).all()
        assert (points < SIZE).all()
    assert isinstance(squares(5, image_size=SIZE), simulate.Scene)
