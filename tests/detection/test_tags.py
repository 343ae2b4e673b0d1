"""Tags, found by their codes, and sheets of markers with a known layout."""

import json
import pickle
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.detection.candidates import Lattice
from trisquare.detection.kinds import TargetKinds
from trisquare.detection.sampling import straight_sides
from trisquare.detection.sheets.layout import parse_layout
from trisquare.detection.tags.codes import dictionary, opencv_dictionary
from trisquare.detection.tags.decode import decode_tags
from trisquare.detection.tags.families import DICTIONARIES, SIZES, TagSearch, dictionary_name
from trisquare.measurement.boards import Board
from trisquare.measurement.find import search
from trisquare.simulate.cramer_rao import cramer_rao_bound, pixel_sigma
from trisquare_scenes.tagged import MarkedTarget, charuco_box_scene, tag_scene

CUBE = Path(__file__).resolve().parents[3] / "shared" / "data" / "charuco-cube"


@pytest.fixture(scope="module")
def tagged():
    """Three tags, their numbers and a picture of them."""
    rng = np.random.default_rng(20)
    scene, numbers = tag_scene(rng, "6X6_250", sides=(110.0, 250.0))
    return scene, numbers, simulate.render(scene, rng, noise=2.0, blur=0.8, jpeg_quality=85)


@pytest.fixture(scope="module")
def box():
    """A box's corner with three ChArUco boards of 4 x 4 squares, and a picture of it."""
    rng = np.random.default_rng(21)
    scene = charuco_box_scene(rng, squares=4, name="4X4_1000")
    return scene, simulate.render(scene, rng, noise=2.0, blur=0.8)


def tags_in(picture, targets="auto"):
    return [target.outline for target in search(picture, TargetKinds.parse(targets)).targets]


def test_tags_are_found_with_their_numbers_and_corners(tagged):
    scene, numbers, picture = tagged
    found = {outline.tag.number: outline for outline in tags_in(picture)}
    assert sorted(found) == sorted(numbers)
    for target, number in zip(scene.targets, numbers, strict=True):
        unit = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        corners = scene.camera.project(target.to_camera(unit))
        # The first corner is the top left one of the code, however the tag is turned.
        assert np.abs(found[number].outer.corners - corners).max() < 1.5


@pytest.mark.parametrize("name", first_quick(["6X6_250", "4X4_50", "APRILTAG_36H11"]))
def test_tags_far_away_are_read(name):
    """Their sides are 8 to 20 pixels of the halved picture: too short for a fit there."""
    rng = np.random.default_rng([24, len(name)])
    scene, numbers = tag_scene(rng, name, sides=(28.0, 45.0))
    picture = simulate.render(scene, rng, noise=2.5, blur=0.8, jpeg_quality=85)
    found = tags_in(picture)
    assert sorted(outline.tag.number for outline in found if outline.tag) == sorted(numbers)
    # Neither their sheets nor their cells are taken for squares.
    assert len(found) == len(numbers)


def test_three_tags_calibrate_a_camera(tagged):
    scene, _, picture = tagged
    result = ts.calibrate(picture, tone="linear")
    assert [plane.kind for plane in result.planes] == ["tag"] * 3
    assert abs(result.camera.fx - scene.camera.fx) < 4.0 * result.std["fx"]
    assert abs(result.camera.cy - scene.camera.cy) < 4.0 * result.std["cy"]
    bound = cramer_rao_bound(scene, pixel_sigma(2.0, 175.0, 0.8))
    assert result.std["fx"] < 2.0 * bound["fx"]


def test_a_tag_is_no_square_and_a_square_no_tag(tagged):
    _, _, picture = tagged
    assert tags_in(picture, "squares") == []
    rng = np.random.default_rng(3)
    plain = simulate.render(simulate.random_scene(rng), rng)
    assert [outline.tag for outline in tags_in(plain)] == [None] * 3
    with pytest.raises(ts.DetectionError, match="no tag"):
        ts.detect(plain, targets="tags")


def test_the_family_that_was_asked_for_is_the_one_found(tagged):
    _, numbers, picture = tagged
    assert len(tags_in(picture, "aruco")) == len(tags_in(picture, "tags:6x6_250")) == 3
    assert tags_in(picture, "apriltag") == []
    assert tags_in(picture, "tags:36h11") == []
    # The first hundred codes of a dictionary are those of its shorter version.
    few = [outline.tag.number for outline in tags_in(picture, "tags:6X6_100")]
    assert sorted(few) == sorted(number for number in numbers if number < 100)


@pytest.mark.parametrize("name", DICTIONARIES)
def test_codes_are_opencv_s(name):
    book = dictionary(name)
    assert len(book.codes) == SIZES[name]
    assert dictionary_name(f"dict_{name.lower()}") == name
    number, cells = 7, book.side + 2
    drawn = cv2.aruco.generateImageMarker(opencv_dictionary(name), number, 10 * cells)
    for turns in range(4):
        grey = np.pad(np.rot90(drawn, turns), 10, constant_values=255)
        far = 10.0 * cells + 9.5
        corners = np.array([[[9.5, 9.5], [far, 9.5], [far, far], [9.5, far]]])
        (tag,) = decode_tags(
            np.ascontiguousarray(grey),
            straight_sides(corners),
            np.array([255.0]),
            TagSearch((name,), True),
        )
        assert tag == (name, number, turns)


def test_many_quads_are_read_with_little_memory():
    """A window front has thousands of them: 3,000 used to take 300 MB, and now take 40."""
    grey = np.full((400, 400), 230, np.uint8)
    grey[100:300, 100:300] = np.random.default_rng(3).integers(0, 60, (200, 200))
    corners = np.tile(
        [[[100.0, 100.0], [300.0, 100.0], [300.0, 300.0], [100.0, 300.0]]], (3000, 1, 1)
    )
    tracemalloc.start()
    try:
        tags = decode_tags(
            grey, straight_sides(corners), np.full(3000, 180.0), TagSearch(DICTIONARIES)
        )
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert tags == [None] * 3000
    assert peak < 80e6


def test_texture_in_dark_squares_is_no_tag():
    rng = np.random.default_rng(8)
    corners = np.array([[[10.0, 10.0], [90.0, 12.0], [88.0, 92.0], [9.0, 90.0]]])
    for _ in range(50):
        blotches = cv2.GaussianBlur(rng.standard_normal((100, 100)), (0, 0), rng.uniform(1.0, 9.0))
        grey = np.where(blotches > 0.0, 200, 20).astype(np.uint8)
        grey[8:20] = grey[80:95] = grey[:, 8:20] = grey[:, 80:95] = 20
        assert decode_tags(
            grey, straight_sides(corners), np.array([180.0]), TagSearch(DICTIONARIES)
        ) == [None]


@pytest.mark.parametrize(("cols", "rows"), [(5, 7), (6, 4), (9, 8)])
def test_layouts_are_opencv_s(cols, rows):
    book = opencv_dictionary("5X5_1000")
    board = cv2.aruco.CharucoBoard((cols, rows), 1.0, 0.7, book)
    for arrangement in parse_layout(f"charuco:{cols}x{rows}:0.7").sheets[0].arrangements:
        board.setLegacyPattern(not arrangement.dark_corner)
        own = arrangement.corners + np.array([0.5 * cols, 0.5 * rows])
        np.testing.assert_allclose(own, np.array(board.getObjPoints())[..., :2], atol=1e-6)
    grid = cv2.aruco.GridBoard((cols, rows), 1.0, 0.3, book)
    own = parse_layout(f"aruco:{cols}x{rows}:0.3").sheets[0].arrangements[0].corners
    theirs = np.array(grid.getObjPoints())[..., :2]
    np.testing.assert_allclose(own - own[0, 0], theirs - theirs[0, 0], atol=1e-6)


@pytest.mark.slow
def test_a_charuco_box_calibrates_a_camera(box):
    scene, picture = box
    result = ts.calibrate(picture, targets="charuco:4x4:0.75:4X4_1000", tone="linear")
    assert len(result.planes) == 3
    normals = np.array([plane.rotation[:, 2] for plane in result.planes])
    assert np.degrees(np.arccos(np.abs(normals @ normals.T - np.eye(3)).max())) > 88.0
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(scene.camera, name)
        assert abs(error) < 4.0 * result.std[name]
    assert result.std["fx"] < 0.02 * scene.camera.fx


def test_the_layout_of_a_sheet_under_a_tone_curve_costs_nothing():
    """Its markers used to be moved by the tone curve's smaller shift of the grid lines."""
    rng = np.random.default_rng(1)
    scene = charuco_box_scene(rng, squares=5, name="4X4_1000")
    picture = simulate.render(scene, rng, tone="srgb", noise=1.0)
    stated = ts.calibrate(picture, targets="charuco:5x5:0.75:4X4_1000")
    assert stated.std["fx"] < 1.1 * ts.calibrate(picture).std["fx"]
    assert abs(stated.camera.fx - scene.camera.fx) < 4.0 * stated.std["fx"]


def test_boards_of_a_layout_are_told_apart_by_their_numbers(box):
    _, picture = box
    edges = ts.detect(picture, targets="charuco:4x4:0.75", tone="linear")
    assert {figure.kind for figure in edges} == {"charuco"}
    for plane in range(3):
        figures = [figure for figure in edges if figure.plane == plane]
        grid, *markers = [len(figure.lines) for figure in figures]
        # Markers are measured where they are clear of the grid lines.
        assert grid == 6
        assert set(markers) <= {4}
        assert len(markers) <= 8
        assert misfit(figures) < 0.3


def test_the_white_round_markers_is_measured(box):
    """In cells of 25 pixels and more, to a few hundredths of a pixel; none in a plain board."""
    scene, picture = box
    plain = [replace(target, codes=np.zeros((0, 1, 1), bool)) for target in scene.targets]
    empty = simulate.render(replace(scene, targets=tuple(plain)), np.random.default_rng(1))
    for number, target in enumerate(scene.targets):
        grid = scene.image_points(number, target.board_corners()).reshape(3, 3, 2)
        lattice = Lattice(grid, np.ones((3, 3), bool))
        rims = Board.of(lattice, picture).rims
        assert rims.shape == (4, 4)
        np.testing.assert_allclose(rims[rims > 0.0], 0.125, atol=0.005)
        assert np.count_nonzero(rims) == 8
        assert Board.of(lattice, empty).rims is None


def test_a_tag_s_edges_say_how_wide_its_border_is(tagged):
    edges = ts.detect(tagged[2], tone="linear")
    assert [figure.border for figure in edges] == [1.0 / 8.0] * 3
    again = ts.PlaneEdges.from_json(edges[0].to_json())
    assert again.border == pickle.loads(pickle.dumps(edges[0])).border == 1.0 / 8.0
    assert "border" not in replace(edges[0], border=None).to_json()
    with pytest.raises(ValueError, match="border"):
        replace(edges[0], border=0.0)


def test_markers_of_known_places_bear_witness_together():
    """Their common plane is far more certain than that of one small marker, in any order."""
    rng = np.random.default_rng(6)
    box = charuco_box_scene(rng, squares=4, name="4X4_1000")
    arrangement = parse_layout("aruco:3x3:0.4").sheets[0].arrangements[0]
    together, apart, targets = [], [], []
    for face in box.targets:
        for index, code in enumerate(dictionary("4X4_1000").codes[:9]):
            place = face.to_camera(arrangement.corners[index].mean(axis=0)[None])[0]
            targets.append(MarkedTarget(face.rotation, place, codes=code[None]))
    scene = simulate.Scene(box.camera, tuple(targets))
    points = simulate.edge_points(scene, rng, noise=0.05)
    for index, sides in enumerate(points):
        plane, place = divmod(index, 9)
        alone = ts.PlaneEdges.square(sides)
        middle = arrangement.corners[place].mean(axis=0)
        lines = alone.lines - np.outer(alone.lines[:, :2] @ middle, [0.0, 0.0, 1.0])
        apart.append(alone)
        together.append(ts.PlaneEdges(lines, sides, plane=plane, freedom="fixed"))
    size = scene.camera.image_size
    single, joint = (ts.calibrate_edges(edges, size) for edges in (apart, together))
    assert len(joint.planes) == 3
    assert abs(joint.camera.fx - scene.camera.fx) < 4.0 * joint.std["fx"]
    assert joint.std["fx"] < 0.5 * single.std["fx"]


def misfit(figures):
    """Root mean square distance of a plane's samples from its lines, without distortion."""
    lines = np.concatenate([figure.lines for figure in figures])
    points = [side for figure in figures for side in figure.points]
    ends = [(side[0], side[-1]) for side in points]
    seen = np.array([np.cross([*a, 1.0], [*b, 1.0]) for a, b in ends])
    homography = ts.homography_from_lines(lines, seen / np.hypot(seen[:, 0], seen[:, 1])[:, None])
    mapped = lines @ np.linalg.inv(homography)
    mapped /= np.hypot(mapped[:, 0], mapped[:, 1])[:, None]
    off = [side @ line[:2] + line[2] for side, line in zip(points, mapped, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


@pytest.mark.parametrize(
    ("targets", "why"),
    first_quick(
        [
            ("charuco:4x6:0.75:4X4_1000", "are not where"),
            ("charuco:4x4:0.5:4X4_1000", "times as large"),
            ("charuco:4x4:0.75:7X7_1000", "no sheet"),
            ("charuco:7x5:0.75:4X4_1000", "are not where"),
            ("aruco:4x2:0.2:4X4_1000", "are not where"),
        ],
        2,
    ),
)
def test_a_wrong_layout_is_refused_and_says_why(box, targets, why):
    with pytest.raises(ts.DetectionError, match=why):
        ts.calibrate(box[1], targets=targets)


def grid_picture(columns, rows, *, gap, name, from_bottom=False, turns=0, border=1):
    """A tilted grid of markers, drawn by OpenCV and warped."""
    cell = 80
    pitch = round(cell * (1 + gap))
    sheet = np.full((rows * pitch + 60, columns * pitch + 60), 230, np.uint8)
    book = opencv_dictionary(name)
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        row = rows - 1 - row if from_bottom else row
        marker = cv2.aruco.generateImageMarker(book, number, cell, borderBits=border)
        y, x = 40 + row * pitch, 40 + column * pitch
        sheet[y : y + cell, x : x + cell] = np.clip(np.rot90(marker, turns), 20, 230)
    height, width = sheet.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = np.array([[90, 60], [700, 110], [640, 560], [60, 500]], np.float32)
    view = cv2.getPerspectiveTransform(corners, seen)
    fine = cv2.GaussianBlur(sheet, (0, 0), 0.8)
    return cv2.warpPerspective(fine, view, (800, 620), borderValue=230, flags=cv2.INTER_AREA)


@pytest.mark.parametrize(
    ("targets", "drawn"),
    [
        ("aruco:4x3:0.25:5X5_100", {"gap": 0.25, "name": "5X5_100"}),
        ("aruco:4x3:0.25", {"gap": 0.25, "name": "5X5_100", "turns": 1}),
        ("apriltag:4x3:0.3", {"gap": 0.3, "name": "APRILTAG_36H11", "from_bottom": True}),
        (
            "apriltag:4x3:0.3:36h11",
            {"gap": 0.3, "name": "APRILTAG_36H11", "from_bottom": True, "turns": 2, "border": 2},
        ),
    ],
)
def test_grids_of_markers_lie_on_one_plane(targets, drawn):
    picture = grid_picture(4, 3, **drawn)
    edges = ts.detect(picture, targets=targets, tone="linear")
    assert len(edges) == 12
    assert {figure.plane for figure in edges} == {0}
    assert {figure.freedom for figure in edges} == {"fixed"}
    assert misfit(edges) < 0.05


@pytest.mark.parametrize("tone", ["srgb", 1.6, "auto"])
def test_a_wrong_tone_or_ink_that_spreads_does_not_bend_a_sheet(tone):
    """The picture is linear; taken as sRGB, all its markers' edges are half a pixel off."""
    picture = grid_picture(4, 3, gap=0.25, name="5X5_100")
    edges = ts.detect(picture, targets="aruco:4x3:0.25:5X5_100", tone=tone)
    assert misfit(edges) < 0.05
    grown = cv2.erode(picture, np.ones((3, 3), np.uint8))
    assert misfit(ts.detect(grown, targets="aruco:4x3:0.25:5X5_100", tone="linear")) < 0.1


def test_a_layout_may_come_from_a_file(tmp_path):
    picture = grid_picture(2, 2, gap=0.5, name="6X6_250")
    square = np.array([[0, 0], [40, 0], [40, 40], [0, 40]])
    markers = {
        str(2 * y + x): (square + np.array([60 * x, 60 * y])).tolist()
        for y in (0, 1)
        for x in (0, 1)
    }
    path = tmp_path / "layout.json"
    path.write_text(json.dumps({"dictionary": "6X6_250", "markers": markers}))
    edges = ts.detect(picture, targets=str(path), tone="linear")
    assert len(edges) == 4
    assert misfit(edges) < 0.05
    # Two sheets, one of them faulty: the other is still used.
    wrong = {"2": markers["2"], "3": (square + np.array([140, 60])).tolist()}
    left = {number: markers[number] for number in "01"}
    sheets = [{"name": "a", "markers": left}, {"name": "b", "markers": wrong}]
    path.write_text(json.dumps({"sheets": sheets}))
    assert len(ts.detect(picture, targets=str(path), tone="linear")) == 2


def test_no_marker_is_on_two_sheets_of_many(tmp_path):
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    sheets = [{"markers": {str(number): square}} for number in (5, 6, 7, 8)]
    path = tmp_path / "layout.json"
    path.write_text(json.dumps({"sheets": sheets}))
    assert len(parse_layout(str(path)).sheets) == 4
    for number in (5, 8):
        path.write_text(json.dumps({"sheets": [*sheets, {"markers": {str(number): square}}]}))
        with pytest.raises(ValueError, match=rf"layout\.json: marker {number} is on two sheets"):
            parse_layout(str(path))


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        '{"markers": {}}',
        '{"sheets": []}',
        '{"sheets": [3]}',
        '{"markers": {"x": [[0, 0], [1, 0], [1, 1], [0, 1]]}}',
        '{"markers": {"1": [[0, 0], [1, 0], [1, 1]]}}',
        '{"markers": {"1": [[0, 0], [0, 1], [1, 1], [1, 0]]}}',
        '{"markers": {"1": [[0, 0], [2, 0], [2, 1], [0, 1]]}}',
        '{"markers": {"1": [[0, 0], [1, 0], [1, NaN], [0, 1]]}}',
        '{"dictionary": "9X9", "markers": {"1": [[0, 0], [1, 0], [1, 1], [0, 1]]}}',
        '{"dictionary": 3, "markers": {"1": [[0, 0], [1, 0], [1, 1], [0, 1]]}}',
        '{"markers": {"1": [[0, 0], [1e308, 0], [1e308, 1e308], [0, 1e308]]}}',
        '{"markers": {"1": [[0, 0], [1, 0], [1, "a"], [0, 1]]}}',
        f'{{"markers": {{"{"7" * 10_000}": [[0, 0], [1, 0], [1, 1], [0, 1]]}}}}',
        f'{{"markers": {{"1": [[0, 0], [1, 0], [1, {10**400}], [0, 1]]}}}}',
    ],
)
def test_a_bad_layout_file_is_refused(tmp_path, content):
    path = tmp_path / "layout.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"layout\.json") as error:
        ts.detect(np.zeros((40, 40), np.uint8), targets=str(path))
    assert len(str(error.value)) < 600


@pytest.mark.parametrize(
    ("targets", "named"),
    [
        ("charuco:10x10", "RATIO"),
        ("charuco:0x10:0.7", "from 3 to 100"),
        ("charuco:10x10:1.5", "from 0.1 to 0.99"),
        ("charuco:10x10:0", "from 0.1"),
        ("charuco:10x10:.", "RATIO"),
        ("charuco:10x10:nan", "RATIO"),
        ("charuco:-3x10:0.7", "RATIO"),
        ("charuco:9999x9999:0.7", "to 100"),
        ("charuco:10x10:0.7:9X9_50", "choose among"),
        ("charuco:20x20:0.7:6X6_100", "needs 200"),
        ("charuco:100x100:0.7", "needs 5000"),
        ("aruco:5x0:0.3", "from 1"),
        ("aruco:5x5:0.3:0.3", "RATIO"),
        ("aprilgrid:6x6", "aprilgrid:COLSxROWS:GAP"),
        ("aprilgrid:30x30:0.3", "needs 900"),
        ("aprilgrid:6x6:0.05", "give from 0.1 to 1"),
        ("apriltag:6x6:99999", "gap"),
        ("tags:", "choose among"),
        ("tags:nonsense", "choose among"),
    ],
)
def test_nonsense_layouts_are_refused_by_name(targets, named):
    with pytest.raises(ValueError, match=named):
        ts.detect(np.zeros((40, 40), np.uint8), targets=targets)


@pytest.mark.slow
def test_command_takes_a_board(run, tmp_path, box):
    photo = tmp_path / "box.png"
    cv2.imwrite(str(photo), box[1])
    common = ("calibrate", photo, "--tone", "linear", "--json")
    code, printed, _ = run(*common, "--board", "charuco:4x4:0.75:4X4_1000")
    assert code == 0
    assert len(ts.Calibration.from_json(printed).planes) == 3
    for arguments, exit_code, named in (
        (("--board", "charuco:4x4"), 2, "RATIO"),
        (("--board", "chessboard:9x6"), 2, "--targets chessboard:9x6"),
        (("--board", str(tmp_path / "absent.json")), 5, "absent.json"),
        (("--board", "charuco:4x4:0.75", "--targets", "tags"), 2, "one of them"),
    ):
        code, printed, error = run(*common, *arguments)
        assert code == exit_code
        assert printed == ""
        assert named in error


@pytest.mark.parametrize("targets", ["tags", "charuco:5x5:0.7", "apriltag:6x6:0.3:36h11"])
@pytest.mark.parametrize("shape", [(1, 1), (31, 400), (300, 300)])
def test_pictures_of_nothing_show_no_tags(targets, shape):
    rng = np.random.default_rng(1)
    for picture in (np.zeros(shape, np.uint8), rng.integers(0, 256, shape, np.uint8)):
        with pytest.raises(ts.DetectionError):
            ts.detect(picture, targets=targets)


@pytest.mark.skipif(not CUBE.is_dir(), reason="there is no ../shared/data/charuco-cube")
@pytest.mark.slow
def test_a_real_charuco_cube():
    """The reference is 5145 +- 13, from 24 pictures by Zhang's method."""
    photograph = str(CUBE / "cam0" / "8.jpg")
    result = ts.calibrate(photograph, targets="charuco:10x10:0.75:6X6_1000")
    assert len(result.planes) == 3
    assert abs(result.camera.fx - 5145.0) < 3.0 * result.std["fx"] < 0.15 * 5145.0
    assert abs(result.camera.fy - 5145.0) < 3.0 * result.std["fy"]
