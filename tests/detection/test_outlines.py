"""Squares and chessboards are found, and nothing else is taken for one."""

import json
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from quick import first_quick

from trisquare.detection.candidates import Outline, SquareOutline
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.squares.find import find_squares
from trisquare.measurement.find import search
from trisquare.simulate import Scene, chessboard_scene, photo_like, random_camera, random_scene
from trisquare.simulate import render as render_scene
from trisquare.simulate.render import render_into

PHOTOGRAPHS = Path(__file__).resolve().parents[3] / "shared" / "data"
CORNER_TOLERANCE = 3.0
SIDE_TOLERANCE = 1.6
"""Maximum distance of a side in pixels. The outlines are coarse by design, and a blur of linear
light moves an edge by up to a pixel in the coded picture; edge localisation searches wider than
this."""


def photographs() -> list[Path]:
    if not PHOTOGRAPHS.is_dir():
        pytest.skip("the photographs of shared/data are not beside this repository")
    return [
        *sorted((PHOTOGRAPHS / "opencv-chess").glob("*.jpg")),
        *sorted((PHOTOGRAPHS / "charuco-cube" / "cam0").glob("*.jpg")),
        *sorted((PHOTOGRAPHS / "ortho-corner").glob("*.jpg")),
    ]


def read(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def true_outlines(scene: Scene, target: int) -> list[np.ndarray]:
    """Dense closed outlines of a target, shape (4, 50, 2) each, clockwise on the screen."""
    share = np.linspace(0.0, 1.0, 50)[:, None]
    return [
        np.array(
            [
                scene.image_points(target, start + share * (end - start))
                for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True)
            ]
        )
        for corners in scene.targets[target].outlines()
    ]


def distances_to(points: np.ndarray, polyline: np.ndarray) -> np.ndarray:
    start, step = polyline[:-1], np.diff(polyline, axis=0)
    relative = points[:, None] - start
    share = np.clip((relative * step).sum(axis=2) / (step**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(relative - share[..., None] * step, axis=2).min(axis=1)


def rotation_between(outline: Outline, truth: np.ndarray) -> int:
    gaps = [np.abs(np.roll(truth[:, 0], k, axis=0) - outline.corners).max() for k in range(4)]
    return int(np.argmin(gaps))


def check_outline(outline: Outline, truth: np.ndarray, places: int) -> None:
    truth = np.roll(truth, places, axis=0)
    assert np.linalg.norm(outline.corners - truth[:, 0], axis=1).max() < CORNER_TOLERANCE
    closed = np.array(outline.sides)
    assert np.array_equal(closed[:, 0], outline.corners)
    assert np.allclose(closed[:, -1], np.roll(outline.corners, -1, axis=0), atol=1e-3)
    for side, true_side in zip(outline.sides, truth, strict=True):
        # Away from the corners: near a corner, the side of a point is not defined.
        assert distances_to(side[2:-2], true_side).max() < SIDE_TOLERANCE


def check_found(found: list[SquareOutline], scene: Scene) -> None:
    """Check for exactly the scene's targets, including polarity, kind and numbering."""
    assert len(found) == len(scene.targets)
    for index, target in enumerate(scene.targets):
        truths = true_outlines(scene, index)
        centre = truths[0][:, 0].mean(axis=0)
        square = min(found, key=lambda s: np.linalg.norm(s.outer.corners.mean(axis=0) - centre))
        places = rotation_between(square.outer, truths[0])
        check_outline(square.outer, truths[0], places)
        assert square.outer.dark_inside == target.dark
        assert (square.inner is not None) == (target.kind == "frame")
        if square.inner is not None:
            check_outline(square.inner, truths[1], places)
            assert square.inner.dark_inside != target.dark


def draw(picture: np.ndarray, corners: np.ndarray, level: int) -> None:
    cv2.fillPoly(picture, [np.rint(np.asarray(corners) * 16).astype(np.int32)], level, shift=4)


def upright(x: float, y: float, width: float, height: float | None = None) -> np.ndarray:
    height = width if height is None else height
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def photograph(picture: np.ndarray, seed: int = 0) -> np.ndarray:
    """Add blur and noise to an aliased drawing."""
    noise = np.random.default_rng(seed).normal(0.0, 2.0, picture.shape)
    blurred = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    return np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("kind", "dark", "contrast", "seed"),
    [
        # The quick draws are one of every other case. They have each kind with each ink and each
        # contrast, with no, some and much clutter in turn.
        pytest.param(
            *case,
            seed,
            marks=() if number in (0, 3, 5, 6) and seed == number % 3 else pytest.mark.slow,
        )
        for number, case in enumerate(product(["square", "frame"], [True, False], [60.0, 190.0]))
        for seed in range(3)
    ],
)
def test_squares_and_frames_of_either_polarity(kind, dark, contrast, seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, kind=kind, dark=dark)
    picture = render_scene(
        scene, rng, noise=4.0, blur=1.0, contrast=contrast, shading=0.4, clutter=30 * seed
    )
    check_found(find_squares(picture), scene)


@pytest.mark.parametrize("seed", first_quick(range(10)))
def test_photo_like_pictures(seed):
    picture, scene, _ = photo_like(np.random.default_rng(seed))
    check_found(find_squares(picture), scene)


@pytest.mark.parametrize("sagitta", [-0.04, 0.04])
def test_curved_sides_drawn_without_our_renderer(sagitta):
    share = np.linspace(0.0, 1.0, 60, endpoint=False)
    corners = np.array([[140.0, 120.0], [430.0, 150.0], [460.0, 420.0], [120.0, 400.0]])
    sides = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        chord = end - start
        bulge = 4.0 * sagitta * share * (1.0 - share)
        outward = np.array([chord[1], -chord[0]])
        sides.append(start + share[:, None] * chord + bulge[:, None] * outward)
    fine = np.full((8 * 560, 8 * 720), 210, np.uint8)
    draw(fine, 8.0 * np.concatenate(sides) + 3.5, 50)
    picture = cv2.resize(fine, (720, 560), interpolation=cv2.INTER_AREA)
    (square,) = find_squares(photograph(picture))
    outline = np.concatenate([*sides, corners[:1]])
    assert distances_to(np.concatenate(square.outer.sides), outline).max() < 0.5
    places = rotation_between(square.outer, corners[:, None])
    assert np.abs(square.outer.corners - np.roll(corners, places, axis=0)).max() < 0.5


def test_every_pixel_type_gives_the_same_outlines():
    rng = np.random.default_rng(5)
    scene = random_scene(rng, kind="frame")
    grey = render_scene(scene, rng)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    deep = 257 * grey.astype(np.uint16)
    for picture in (grey, colour, deep, grey / np.float32(255.0), deep[..., None].repeat(3, 2)):
        check_found(find_squares(picture), scene)


def test_large_pictures_are_searched_at_a_smaller_size_and_answered_in_full():
    rng = np.random.default_rng(6)
    scene = random_scene(rng, image_size=(2560, 1920))
    found = find_squares(render_scene(scene, rng))
    assert len(found) == 3
    for index in range(3):
        truth = true_outlines(scene, index)[0]
        gaps = [
            np.abs(np.roll(truth[:, 0], k, axis=0) - square.outer.corners).max()
            for k in range(4)
            for square in found
        ]
        assert min(gaps) < 2.0 * CORNER_TOLERANCE


@pytest.mark.parametrize("name", ["triangle", "disc", "rectangle", "kite", "bits", "corner", "cut"])
def test_other_shapes_are_no_squares(name):
    picture = np.full((480, 640), 200, np.uint8)
    if name == "triangle":
        draw(picture, [[200, 120], [420, 200], [230, 380]], 40)
    elif name == "disc":
        cv2.circle(picture, (320, 240), 110, 40, -1)
    elif name == "rectangle":
        draw(picture, upright(270, 190, 150, 90), 40)
    elif name == "kite":
        draw(picture, [[320, 100], [360, 180], [320, 400], [280, 180]], 40)
    elif name == "bits":
        draw(picture, upright(220, 140, 180), 40)
        for column, row in [(1, 1), (3, 1), (2, 2), (4, 3), (1, 4)]:
            draw(picture, upright(220 + 30 * column, 140 + 30 * row, 29), 200)
    elif name == "corner":
        draw(picture, upright(150, 90, 140), 40)
        draw(picture, upright(290, 230, 140), 40)
    elif name == "cut":
        draw(picture, upright(-40, 150, 180), 40)
    found = find_squares(photograph(picture))
    # Single bits of a marker are small squares; the marker itself is not found.
    sides = [np.linalg.norm(square.outer.corners[1] - square.outer.corners[0]) for square in found]
    assert [side for side in sides if side > 40.0] == []
    assert name == "bits" or found == []


def test_a_square_on_a_sheet_is_solid():
    picture = np.full((480, 640), 90, np.uint8)
    draw(picture, upright(180, 100, 260), 220)
    draw(picture, upright(240, 160, 140), 30)  # concentric, but the desk is not printed
    (square,) = find_squares(photograph(picture))
    assert square.inner is None
    assert square.outer.dark_inside
    ends = square.outer.corners
    assert np.abs([ends.min(axis=0) - [240, 160], ends.max(axis=0) - [380, 300]]).max() < 1.5


def test_a_hole_off_the_middle_makes_no_frame():
    for shift, framed in [(0, True), (25, False)]:
        picture = np.full((480, 640), 210, np.uint8)
        draw(picture, upright(200, 120, 220), 40)
        draw(picture, upright(255 + shift, 175, 110), 210)
        found = find_squares(photograph(picture))
        assert [square.inner is not None for square in found] == [framed]


def test_a_thin_ring_counts_as_its_inner_outline():
    picture = np.full((480, 640), 60, np.uint8)
    draw(picture, upright(200, 120, 220), 210)
    draw(picture, upright(222, 142, 176), 60)
    (square,) = find_squares(photograph(picture))
    assert square.inner is None
    assert square.outer.dark_inside


def test_small_squares_are_dropped_only_beside_three_large_ones():
    picture = np.full((600, 800), 210, np.uint8)
    draw(picture, upright(370, 270, 40), 40)
    assert len(find_squares(photograph(picture))) == 1
    for x, y in [(100, 80), (550, 80), (330, 380)]:
        draw(picture, upright(x, y, 150), 40)
    found = find_squares(photograph(picture))
    assert len(found) == 3
    assert min(cv2.contourArea(s.outer.corners.astype(np.float32)) for s in found) > 20_000


def test_corners_run_clockwise_on_the_screen():
    picture = np.full((480, 640), 210, np.uint8)
    draw(picture, upright(200, 120, 220), 40)
    draw(picture, upright(255, 175, 110), 210)
    (square,) = find_squares(photograph(picture))
    for outline in (square.outer, square.inner):
        x, y = outline.corners.T
        assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0.0


def boards_of(picture, cols, rows):
    found = search(picture, TargetKinds(board=(cols, rows))).found
    return [board.lattice for board in found]


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((0, 0), np.uint8),
        np.zeros((1, 1), np.uint8),
        np.zeros((1, 5000, 3), np.uint8),
        np.zeros((480, 640), np.uint8),
        np.full((480, 640, 3), 255, np.uint8),
        np.full((40, 40), 0.5, np.float32),
        np.full((60, 60), np.nan, np.float32),
        np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8),
    ],
    ids=["empty", "pixel", "line", "black", "white", "grey", "nan", "noise"],
)
def test_pictures_without_figures(picture):
    assert find_squares(picture) == []
    assert boards_of(picture, 9, 6) == []


@pytest.mark.slow
def test_cells_of_rendered_chessboards_are_no_squares():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene = chessboard_scene(rng, random_camera(rng))
        assert find_squares(render_scene(scene, rng)) == []


@pytest.mark.parametrize("step", first_quick([8, 1]))
def test_real_photographs_show_no_squares(step):
    found = {path.name: len(find_squares(read(path))) for path in photographs()[::step]}
    assert len(found) > 30 / step
    assert [name for name, count in found.items() if count] == []


@pytest.mark.parametrize("part", first_quick(range(15)))
def test_three_squares_laid_into_real_photographs(part):
    paths = photographs()
    for index in range(part, 30, 15):
        background = read(paths[index % len(paths)])
        rng = np.random.default_rng(index)
        scene = random_scene(
            rng,
            image_size=background.shape[1::-1],
            kind="frame" if index % 3 == 0 else "square",
            dark=bool(index % 2),
        )
        picture = render_into(
            background,
            scene,
            rng,
            contrast=rng.uniform(60.0, 200.0),
            blur=rng.uniform(0.5, 1.2),
            noise=rng.uniform(1.0, 4.0),
            jpeg_quality=85,
        )
        check_found(find_squares(picture), scene)


def test_chessboards_of_real_photographs():
    photographs()
    records = PHOTOGRAPHS / "opencv-chess" / "corners_left_cornerSubPix.json"
    boards = json.loads(records.read_text())
    assert len(boards) == 13
    for record in boards:
        (board,) = boards_of(read(PHOTOGRAPHS / "opencv-chess" / record["image"]), 9, 6)
        reference = np.array(record["corners_xy"]).reshape(6, 9, 2)
        gaps = [np.abs(board.crossings - r).max() for r in (reference, reference[::-1, ::-1])]
        assert min(gaps) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("cols", "rows", "seeds"), [(9, 6, range(10)), (8, 5, range(2, 3))])
def test_rendered_chessboards(cols, rows, seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        scene = chessboard_scene(rng, random_camera(rng), inner_corners=(cols, rows))
        (board,) = boards_of(render_scene(scene, rng), cols, rows)
        truth = scene.image_points(0, scene.targets[0].board_corners()).reshape(rows, cols, 2)
        gaps = [np.abs(board.crossings - t).max() for t in (truth, truth[::-1, ::-1])]
        assert min(gaps) < 0.3
