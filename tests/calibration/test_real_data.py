"""Real photographs: `../shared/data` beside the repository, if it is there."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from quick import first_quick

import trisquare as ts

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY.parent / "shared" / "data"

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="there is no ../shared/data")

THREE_SQUARES_SIZE = (1024, 768)


@pytest.fixture(scope="module")
def three_squares():
    squares = json.loads((DATA / "three-squares" / "edges.json").read_text())["squares"]
    return [ts.PlaneEdges.square(sides) for sides in squares]


def test_three_real_squares_without_distortion(three_squares):
    """Reference: focal lengths and principal point of Hartley & Zisserman's example 8.18."""
    result = ts.calibrate_edges(three_squares, THREE_SQUARES_SIZE, model="none")
    assert result.camera.fx == pytest.approx(1108.3, rel=0.01)
    assert result.camera.fy == pytest.approx(1097.8, rel=0.01)
    assert result.camera.cx == pytest.approx(525.8, abs=6.0)
    assert result.camera.cy == pytest.approx(395.9, abs=6.0)
    normals = np.array([plane.rotation[:, 2] for plane in result.planes])
    cosines = (normals @ normals.T)[np.triu_indices(3, 1)]
    angles = sorted(np.degrees(np.arccos(cosines)))
    np.testing.assert_allclose(angles, [67.4, 92.2, 94.7], rtol=0, atol=2.5)


def test_three_real_squares_with_distortion(three_squares):
    result = ts.calibrate_edges(three_squares, THREE_SQUARES_SIZE, model="radial1")
    assert -0.15 < result.camera.distortion[0] < -0.05


@pytest.mark.slow
def test_command_on_thirteen_chessboard_photographs(run):
    """Another corner detector changes Zhang's f by 0.15 %; the reference is accurate to 0.4 %."""
    photographs = sorted((DATA / "opencv-chess").glob("left*.jpg"))
    assert len(photographs) == 13
    code, printed, _ = run("calibrate", *photographs, "--targets", "chessboard:9x6", "--json")
    assert code == 0
    result = ts.Calibration.from_json(printed)
    references = DATA / "opencv-chess" / "reference_left_cornerSubPix.json"
    zhang = json.loads(references.read_text())["k1k2_notan_fixk3"]
    assert len(result.planes) == 13
    assert result.camera.fx == pytest.approx(zhang["K"][0][0], rel=0.004)
    assert result.camera.fy == pytest.approx(zhang["K"][1][1], rel=0.004)
    k1 = zhang["dist_k1k2p1p2k3"][0]
    assert result.camera.distortion[0] == pytest.approx(k1, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right"])
def test_three_boards_in_a_corner(side):
    """The paper is not flat, by about a pixel, which the stated stds must include."""
    photograph = DATA / "ortho-corner" / f"{side}_calib.jpg"
    result = ts.calibrate(photograph)
    assert len(result.planes) == 3
    for name in ("fx", "fy"):
        value = getattr(result.camera, name)
        assert 0.94 * 1624 < value < 1.06 * 1650
        assert abs(value - 1637) < 3.0 * result.std[name] + 13.0
    assert any("have a common error" in text for text in result.warnings)
    normals = np.array([plane.rotation[:, 2] for plane in result.planes])
    angles = np.degrees(np.arccos((normals @ normals.T)[np.triu_indices(3, 1)]))
    np.testing.assert_allclose(angles, 90.0, rtol=0, atol=5.0)
    one_focal_length = ts.calibrate(photograph, fix="aspect")
    assert 0.97 * 1624 < one_focal_length.camera.fx < 1.03 * 1650
    by_evidence = ts.calibrate(photograph, model="auto")
    assert not any(warning.code == "lens_ends_in_picture" for warning in by_evidence.warnings)
    cornered = ts.calibrate(photograph, orthogonal=[(0, 1), (1, 2), (0, 2)])
    for name in ("fx", "fy"):
        assert abs(getattr(cornered.camera, name) - 1637) < 3.0 * cornered.std[name] + 13.0
        assert cornered.std[name] < 0.8 * result.std[name]
    assert cornered.camera.fy / cornered.camera.fx == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_three_boards_of_which_a_third_is_left_out_lead_to_no_wrong_optimum():
    """From the start by the conic alone, these lines led to focal lengths of 1707 and 2036 px."""
    edges = ts.detect(DATA / "ortho-corner" / "right_calib.jpg")
    boards = [board for board in edges if board.kind == "chessboard"]
    # Rows and columns left out of the left wall, the right wall and the floor.
    left_out = [({3, 4, 7}, {0, 1, 4}), ({3, 6, 7}, {2, 5}), ({0, 1, 5}, {0, 3})]
    some = []
    for board, (rows, columns) in zip(boards, left_out, strict=True):
        is_row = board.lines[:, 0] == 0.0
        offsets = -board.lines[:, 2]
        first = np.where(is_row, offsets[is_row].min(), offsets[~is_row].min())
        numbers = np.rint(offsets - first).astype(int)
        kept = [i for i, n in enumerate(numbers) if n not in (rows if is_row[i] else columns)]
        some.append(
            dataclasses.replace(
                board,
                lines=board.lines[kept],
                points=tuple(board.points[i] for i in kept),
                std=tuple(board.std[i] for i in kept),
            )
        )
    result = ts.calibrate_edges(some, (1600, 1200))
    for name in ("fx", "fy"):
        value = getattr(result.camera, name)
        assert 0.94 * 1624 < value < 1.06 * 1650
        assert abs(value - 1637) < 3.0 * result.std[name] + 13.0


@pytest.mark.slow
def test_three_faces_of_a_charuco_cube():
    result = ts.calibrate(DATA / "charuco-cube" / "cam0" / "7.jpg")
    assert abs(result.camera.fx - 5145) < 3.0 * result.std["fx"]
    assert abs(result.camera.fy - 5145) < 3.0 * result.std["fy"]
    assert result.std["fx"] < 0.03 * 5145


@pytest.mark.parametrize("number", first_quick([1, 0, *range(2, 8)]))
def test_squares_rendered_into_photographs_are_found_and_calibrated(number, inserted):
    """A part of the 50 pictures of `make bench`, with boards seen by another camera.

    Where a photograph shows three boards of its own, as many as squares, the boards may be chosen.
    """
    case = inserted(number)
    truth = case.scene.camera
    result = ts.calibrate(case.picture)
    squares = [plane for plane in result.planes if plane.kind != "chessboard"]
    if not squares:
        _assert_own_boards_outvote(result, truth)
        return
    assert len(squares) == 3
    for plane in result.planes:
        if plane.kind == "chessboard":
            index = result.planes.index(plane)
            assert any(f"plane {index} was rejected" in text for text in result.warnings)
    # JPEG's errors are neither independent nor normal, so that no bound in our own stds applies:
    # half a per cent distinguishes a calibrated camera from a wrong one.
    assert result.camera.fx == pytest.approx(truth.fx, rel=0.005)
    assert result.camera.fy == pytest.approx(truth.fy, rel=0.005)
    width = truth.image_size[0]
    assert result.camera.cx == pytest.approx(truth.cx, abs=0.005 * width)
    assert result.camera.cy == pytest.approx(truth.cy, abs=0.005 * width)


def _assert_own_boards_outvote(result, truth):
    """Check that the camera is that of the cube's three faces, with a warning of doubt."""
    assert len(result.planes) == len(result.rejected) == 3
    assert abs(result.camera.fx - 5145) < 3.0 * result.std["fx"]
    (doubt,) = (text for text in result.warnings if "another choice is nearly as good" in text)
    assert int(re.search(r"focal length of (\d+) px", doubt)[1]) == pytest.approx(
        truth.fx, rel=0.005
    )


@pytest.fixture(scope="module")
def inserted():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(REPOSITORY / "benchmarks"))
        from finding.inserted_squares import inserted_squares
    drawn, rest = [], inserted_squares(8)

    def case(number):
        while len(drawn) <= number:
            drawn.append(next(rest))
        return drawn[number]

    return case
