"""Rendered scenes as people photograph them: the pictures agree with their truth."""

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import IMAGE_SIZE

from trisquare import simulate
from trisquare.detection.boards.find import find_lattices
from trisquare.detection.grey import grey_bytes
from trisquare.measurement.boards import Board
from trisquare_scenes.photo_like import KINDS, SHOWN, real_picture

DRAWN = {}


def case_of(kind):
    """One picture of a kind, cached: rendering boards takes a second or two."""
    if kind not in DRAWN:
        rng = np.random.default_rng([81, KINDS.index(kind)])
        DRAWN[kind] = real_picture(rng, kind, (640, 480))
    return DRAWN[kind]


def boards(case):
    for number, target in enumerate(case.scene.targets):
        if target.kind == "chessboard":
            yield number, target


@pytest.mark.parametrize(
    "kind", first_quick(["touching boards", "cut by the border", "partly hidden"])
)
def test_crossings_in_sight_are_where_the_truth_has_them(kind):
    case = case_of(kind)
    grey = case.picture if case.picture.ndim == 2 else cv2.cvtColor(case.picture, 6)
    for number, target in boards(case):
        crossings = case.scene.image_points(number, target.board_corners())
        shown = crossings[case.in_sight(crossings)]
        assert len(shown) >= 9
        end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.01)
        start = shown.astype(np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(grey, start, (3, 3), (-1, -1), end)
        # Cells of ten pixels, noise and JPEG: single saddles scatter, their median does not.
        assert np.hypot(*np.median(found[:, 0] - shown, axis=0)) < 0.15


def test_boards_of_a_corner_are_perpendicular_and_share_their_folds():
    targets = case_of("touching boards").scene.targets
    normals = np.array([target.rotation[:, 2] for target in targets])
    np.testing.assert_allclose(normals @ normals.T, np.eye(3), atol=1e-12)
    outlines = [target.to_camera(target.outlines()[0]) for target in targets]
    for i, outline in enumerate(outlines):
        for other in outlines[:i]:
            gaps = np.linalg.norm(outline[:, None] - other[None], axis=2)
            assert (gaps < 1e-9).sum() == 2  # the two ends of one fold


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cut by the border", "partly hidden"])
def test_part_of_the_crossings_is_out_of_sight(kind):
    case = case_of(kind)
    crossings = np.concatenate(
        [case.scene.image_points(n, target.board_corners()) for n, target in boards(case)]
    )
    shown = case.in_sight(crossings)
    assert SHOWN[0] <= shown.mean() <= SHOWN[1]
    inside = ((crossings > 2) & (crossings < [637, 477])).all(axis=1)
    assert (inside == shown).all() == (kind == "cut by the border")


def test_what_is_out_of_sight_tells_nothing():
    """Hiding half of a scene's edges raises the bound; hiding one plane leaves it undetermined."""
    scene = simulate.random_scene(np.random.default_rng(82))
    whole = simulate.cramer_rao_bound(scene, 0.1)
    thinned = simulate.cramer_rao_bound(
        scene, 0.1, in_sight=lambda points: np.arange(len(points)) % 2 == 0
    )
    assert thinned["fx"] / whole["fx"] == pytest.approx(np.sqrt(2.0), rel=0.01)
    with pytest.raises(ValueError, match="does not"):
        simulate.cramer_rao_bound(
            scene, 0.1, in_sight=lambda points: points[:, 0] > 0.45 * IMAGE_SIZE[0]
        )


def test_a_rim_of_paper_is_as_wide_as_asked():
    camera = simulate.TrueCamera(500.0, 500.0, 99.5, 99.5, image_size=(200, 200))
    board = simulate.Target(
        np.eye(3), [0.0, 0.0, 25.0], "chessboard", inner_corners=(3, 3), rim=0.5
    )
    ground = np.zeros((200, 200), np.uint8)
    rng = np.random.default_rng(83)
    picture = simulate.render_into(
        ground, simulate.Scene(camera, (board,)), rng, noise=0.0, tone="linear"
    )
    # Cells of 20 px: the board spans 80 px, its paper 100.
    paper = np.flatnonzero(picture[52] > picture[52, 100] / 2)
    assert (paper[0], paper[-1]) == (50, 149)
    assert picture[65, 65] < 60 < 180 < picture[65, 85]


@pytest.mark.slow
def test_the_same_seed_draws_the_same_picture():
    case = case_of("tags")
    rng = np.random.default_rng([81, KINDS.index("tags")])
    again = real_picture(rng, "tags", (640, 480))
    np.testing.assert_array_equal(again.picture, case.picture)
    assert again.bound() == case.bound()
    # The ideal picture has neither the sensor's noise nor JPEG's errors, which are small.
    grey = again.picture if again.picture.ndim == 2 else cv2.cvtColor(again.picture, 6)
    wrong = np.std(grey - again.ideal)
    assert 0.5 * case.settings["noise"] < wrong < 3.0 * case.settings["noise"] + 10.0


@pytest.mark.parametrize("kind", first_quick(["tags", "among rectangles"]))
def test_scenes_without_plain_boards_are_three_planes_to_calibrate_from(kind):
    case = case_of(kind)
    assert len(case.scene.targets) == 3
    assert all(target.printed is None for target in case.scene.targets)
    assert 0.0 < case.bound()["fx"] < 0.02 * case.scene.camera.fx


@pytest.mark.slow
def test_small_charuco_boards_are_found_whole_and_their_markers_rims_measured():
    # Print beside crossings hides some of them; blur hides the outer ones of the farthest boards.
    boards, whole = 0, 0
    for index in range(8):
        case = real_picture(np.random.default_rng([100, index]), "charuco box")
        grey = grey_bytes(case.picture)
        found = find_lattices(grey)
        boards += len(case.scene.targets)
        for number, target in enumerate(case.scene.targets):
            true = case.scene.image_points(number, target.board_corners())
            gaps = [
                np.linalg.norm(own.crossings[own.present][:, None] - true, axis=2).min(axis=0)
                for own in found
            ]
            whole += min((gap.max() for gap in gaps), default=np.inf) < 2.0
        true_rim = 0.5 * (1.0 - case.scene.targets[0].inner)
        for lattice in found:
            rims = Board.of(lattice, grey).rims
            assert rims is not None
            assert abs(rims.max() - true_rim) < 0.05 * true_rim
    assert whole >= 0.95 * boards
