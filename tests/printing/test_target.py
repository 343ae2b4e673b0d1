"""The printed target: its layout, its PDF as rendered for a printer, and the folded corner."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from quick import first_quick

import trisquare as ts
from trisquare import simulate
from trisquare.printing.target import PAGES
from trisquare.simulate.folded_corner import folded_frames
from trisquare.simulate.render import encode_tone
from trisquare.simulate.scene import TrueCamera

pytest.importorskip("reportlab", reason="reportlab is not installed: pip install reportlab")

UNIT_SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
DPI = 300
PER_MM = DPI / 25.4
WITHIN = 0.05  # mm, as the target promises


def rastered(pdf, folder, *, page=1, dpi=DPI):
    """One page in grey, as rendered by pdftoppm of Debian's poppler-utils."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("pdftoppm is not here: apt install poppler-utils")
    (folder / "target.pdf").write_bytes(pdf)
    options = ["-r", str(dpi), "-gray", "-f", str(page), "-l", str(page), "-singlefile"]
    subprocess.run(["pdftoppm", *options, "target.pdf", "page"], cwd=folder, check=True)
    return cv2.imread(str(folder / "page.pgm"), cv2.IMREAD_GRAYSCALE)


def edge_position(picture, start, end, side):
    """Position of an upright dark edge, in mm: `side` is 0 for one across x, 1 across y.

    The window from `start` to `end` (x, y; mm) contains one step; its white part gives the
    position.
    """
    (left, top), (right, bottom) = np.rint(np.array([start, end]) * PER_MM).astype(int)
    profile = picture[top:bottom, left:right].mean(axis=side) / 255.0
    low = (left, top)[side]
    white_first = profile[0] > profile[-1]
    assert {profile[0], profile[-1]} == {0.0, 1.0}
    white = profile.sum()
    return (low + (white if white_first else len(profile) - white)) / PER_MM


def measured_outline(picture, corners):
    """Left, right, top and bottom edge of an upright square, each measured near both ends."""
    (left, top), (right, bottom) = corners[0], corners[2]
    reach, bit = 2.0, 1.5
    found = []
    for x in (left, right):
        for y in (top + reach + bit, bottom - reach - bit):
            start, end = (x - reach, y - bit), (x + reach, y + bit)
            found.append(edge_position(picture, start, end, 0) - x)
    for y in (top, bottom):
        for x in (left + reach + bit, right - reach - bit):
            start, end = (x - bit, y - reach), (x + bit, y + reach)
            found.append(edge_position(picture, start, end, 1) - y)
    return np.array(found)


PRINTED = [
    ("corner", "A4", None, 84.0),
    ("corner", "A3", None, 119.0),
    ("corner", "letter", None, 87.0),
    ("corner", "A4", 40.3, 40.3),
    ("flat", "A4", None, 169.0),
    ("flat", "Letter", 123.4, 123.4),
]


@pytest.mark.parametrize(("kind", "page", "asked", "side"), PRINTED)
def test_squares_are_printed_where_and_as_large_as_stated(tmp_path, kind, page, asked, side):
    target = ts.printed_target(kind, page=page, side=asked)
    first = target.pages[0]
    picture = rastered(target.to_pdf(), tmp_path)
    assert np.abs(np.array(picture.shape[::-1]) - np.array(first.size) * PER_MM).max() <= 1.0
    for frame in first.frames:
        outer, hole = frame.outlines()
        assert np.ptp(outer, axis=0) == pytest.approx([side, side], abs=1e-9)
        assert np.ptp(hole, axis=0) == pytest.approx([0.6 * side, 0.6 * side], abs=1e-9)
        for corners in (outer, hole):
            assert np.abs(measured_outline(picture, corners)).max() < WITHIN
        # There is only paper around the frame.
        margin = 0.12 * side - 0.3  # except for a fold's line
        (left, top), (right, bottom) = np.rint(
            np.array([outer[0] - margin, outer[2] + margin]) * PER_MM
        ).astype(int)
        surrounding = picture[top:bottom, left:right].copy()
        inside = int((margin - 0.1) * PER_MM)
        surrounding[inside:-inside, inside:-inside] = 255
        assert surrounding.min() == 255
    # The check ruler, between the centres of its first and last marks.
    x, y = np.array(first.ruler) * PER_MM
    rows = picture[round(y - 4 * PER_MM) : round(y - 3 * PER_MM)].mean(axis=0)
    ends = []
    for at in (x, x + 100 * PER_MM):
        columns = np.arange(round(at) - 12, round(at) + 12)
        ink = 255.0 - rows[columns]
        assert ink.max() > 200
        ends.append((columns + 0.5) @ ink / ink.sum())
    assert np.diff(ends)[0] / PER_MM == pytest.approx(100.0, abs=WITHIN)


def test_three_flat_sheets_differ_only_in_their_number(tmp_path):
    target = ts.printed_target("flat")
    pages = [rastered(target.to_pdf(), tmp_path, page=page, dpi=72) for page in (1, 2, 3)]
    differing = [np.argwhere(pages[0] != other) for other in pages[1:]]
    for where in differing:
        assert len(where) > 0
        assert np.ptp(where, axis=0).max() < 15  # one digit
    info = subprocess.run(
        ["pdfinfo", "target.pdf"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert "Pages:           3" in info


@pytest.mark.parametrize("page", PAGES)
def test_a_board_is_what_it_says(page):
    """Half of the cells are dark, including the upper left one, and they touch only at corners."""
    target = ts.printed_target("boards", page=page)
    assert len(target.pages) == 1
    for board in target.pages[0].frames:
        cells = board.outlines()
        assert cells.shape == (board.cells**2 // 2, 4, 2)
        cell = board.side / board.cells
        low, high = (
            np.array(board.centre) - 0.5 * board.side,
            np.array(board.centre) + 0.5 * board.side,
        )
        np.testing.assert_allclose(cells.min(axis=(0, 1)), low)
        np.testing.assert_allclose(cells.max(axis=(0, 1)), high)
        np.testing.assert_allclose(cells[0], low + cell * np.array(UNIT_SQUARE), atol=1e-9)
        number = np.rint((cells[:, 0] - low) / cell).astype(int)
        np.testing.assert_allclose(low + cell * number, cells[:, 0], atol=1e-9)
        assert len(np.unique(number, axis=0)) == len(cells)
        assert not (number.sum(axis=1) % 2).any()
        # A white margin of one cell's width, or that of printers.
        margin = 0.5 * (target.pages[0].face - board.side)
        assert margin >= min(cell, 7.0)


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("side", [None, 10.0, 33.0, 60.0, 83.9])
@pytest.mark.parametrize("kind", ["both", "boards"])
def test_all_that_is_printed_is_on_the_paper(page, side, kind):
    from reportlab.pdfbase.pdfmetrics import stringWidth

    target = ts.printed_target(kind, page=page, side=side)
    width, height = PAGES[page]
    for sheet in target.pages:
        points = [point for line in (*sheet.folds, *sheet.cuts) for point in line]
        points += [point for line in sheet.drawing for point in line]
        points += [*sheet.tab, *np.concatenate([frame.outlines() for frame in sheet.frames])[0]]
        assert np.min(points) >= 0.0
        assert np.max(np.array(points) - [width, height]) <= 0.0
        ruler = np.array(sheet.ruler)
        assert 7.0 <= ruler[0] <= width - 107.0
        assert ruler[1] > max(frame.outlines()[..., 1].max() for frame in sheet.frames) + 10.0
        assert ruler[1] + 13.0 + 2 * 5.5 < height - 7.0
        for line in sheet.text:
            assert stringWidth(line, "Helvetica", 10.0) * 25.4 / 72 < width - 2 * 10.0
        assert len(sheet.text) == 3  # its title, and two lines of instructions


DRAWN = [
    (page, side, kind) for page in PAGES for side in (None, 33.0) for kind in ("corner", "boards")
]


@pytest.mark.parametrize(("page", "side", "kind"), DRAWN)
def test_the_drawing_shows_the_folded_corner_in_free_room(page, side, kind):
    (sheet,) = ts.printed_target(kind, page=page, side=side).pages
    lines = np.array(sheet.drawing)
    low, high = lines.min(axis=(0, 1)), lines.max(axis=(0, 1))
    assert np.max(high - low) == pytest.approx(21.0)
    assert low[1] >= sheet.apex[1] + sheet.face + 2.0  # below faces and tab
    assert low[0] >= sheet.ruler[0] + 100.0 + 10.0  # right of the ruler and its label
    assert high[1] <= sheet.ruler[1] + 13.0 - 10.0 * 25.4 / 72  # above the text
    assert high[0] <= PAGES[page][0] - 7.0
    # One camera sees the corners of the folded figures at their drawn positions.
    apart, drawn = [], []
    for number, (figure, (rotation, centre)) in enumerate(
        zip(sheet.frames, folded_frames(sheet), strict=True)
    ):
        half = 0.5 * figure.side
        points = np.array(box(-half, -half, half, half))
        apart.append(points @ rotation[:, :2].T + centre)
        per_face = len(lines) // 3
        own = lines[number * per_face + 4 : (number + 1) * per_face]
        ends = np.unique(own.reshape(-1, 2).round(9), axis=0)
        hull = cv2.approxPolyDP(cv2.convexHull(ends.astype(np.float32)), 0.1, closed=True)
        assert len(hull) == 4
        drawn.append(hull[:, 0])
    apart = np.concatenate(apart) / sheet.face
    drawn = np.concatenate(drawn).astype(float)
    diagonal = np.ones(3) / np.sqrt(3.0)
    right = np.cross([0.0, 1.0, 0.0], diagonal) / np.sqrt(2.0 / 3.0)
    depth = apart @ diagonal + 4.0
    seen = np.column_stack([apart @ right, apart @ np.cross(diagonal, right)]) / depth[:, None]
    seen -= 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    drawn -= 0.5 * (drawn.min(axis=0) + drawn.max(axis=0))
    seen *= np.ptp(drawn[:, 1]) / np.ptp(seen[:, 1])
    distance = np.linalg.norm(seen[:, None] - drawn, axis=2)
    assert distance.min(axis=0).max() < 1e-4
    assert distance.min(axis=1).max() < 1e-4


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("kind", ["corner", "boards"])
@pytest.mark.parametrize("dpi", first_quick([100, 200]))
def test_the_drawing_is_no_target(tmp_path, page, kind, dpi):
    target = ts.printed_target(kind, page=page)
    picture = rastered(target.to_pdf(), tmp_path, dpi=dpi)
    around = cv2.copyMakeBorder(picture, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=100)
    blurred = 30.0 + 0.75 * cv2.GaussianBlur(around, (0, 0), 0.8)
    noise = 2.0 * np.random.default_rng(7021).standard_normal(blurred.shape)
    figures = ts.detect(np.clip(blurred + noise, 0, 255).astype(np.uint8))
    if kind == "corner":  # unfolded boards may be taken for one
        assert len({figure.plane for figure in figures}) == 3
    faces = (target.pages[0].apex[1] + target.pages[0].face) * dpi / 25.4 + 40
    assert max(points[:, 1].max() for figure in figures for points in figure.points) < faces


def test_the_same_target_is_the_same_file(tmp_path):
    target = ts.printed_target("corner", page="Letter")
    target.save(tmp_path / "a.pdf")
    assert (tmp_path / "a.pdf").read_bytes() == target.to_pdf()
    assert target.to_pdf() == ts.printed_target("corner", page="Letter").to_pdf()
    assert target.to_pdf() != ts.printed_target("corner", page="A4").to_pdf()
    assert b"/PrintScaling /None" in target.to_pdf()


@pytest.mark.parametrize(
    ("arguments", "options", "error", "words"),
    [
        (("cube",), {}, ValueError, "corner, boards, flat, both"),
        ((), {"page": "A9"}, ValueError, "A4, A3, Letter"),
        ((), {"page": 4}, TypeError, "page"),
        (("corner",), {"side": 84.5}, ValueError, "84 mm"),
        (("flat",), {"side": 170.0}, ValueError, "169 mm"),
        (("boards",), {"side": 91.5}, ValueError, "three chessboards on A4 can be 91 mm"),
        ((), {"side": 90.0}, ValueError, "too small"),
        ((), {"side": 9.9}, ValueError, "at least 10 mm"),
        ((), {"side": -50.0}, ValueError, "side must be positive"),
        ((), {"side": np.nan}, ValueError, "side"),
        ((), {"side": "80"}, ValueError, "side needs a unit"),
        ((), {"side": True}, TypeError, "side"),
    ],
)
def test_impossible_targets_are_refused(arguments, options, error, words):
    with pytest.raises(error, match=words):
        ts.printed_target(*arguments, **options)


# The command.


def test_the_command_writes_and_reports(run, tmp_path):
    path = tmp_path / "target.pdf"
    code, out, err = run("target", "-o", path, "--page", "a3")
    assert (code, err) == (0, "")
    assert path.read_bytes() == ts.printed_target(page="A3").to_pdf()
    assert "A3" in out
    assert "side 119 mm" in out
    assert "side 239 mm" in out
    code, out, err = run("target", "-o", path, "--kind", "boards")
    assert (code, err) == (0, "")
    assert "a corner of three chessboards, side 91 mm, 18 x 18 cells" in out
    code, out, err = run("target", "-o", path, "--kind", "corner", "--side", "5cm", "-q")
    assert (code, out, err) == (0, "", "")
    assert path.read_bytes() == ts.printed_target("corner", side=50.0).to_pdf()


def test_the_command_tells_where_everything_stands(run, tmp_path):
    code, out, err = run("target", "-o", tmp_path / "t.pdf", "--kind", "corner", "--json")
    assert (code, err) == (0, "")
    members = json.loads(out)
    assert members["format"] == "trisquare-target/1"
    (page,) = members["pages"]
    assert page["size"] == [210.0, 297.0]
    assert [frame["centre"] for frame in page["frames"]] == [
        [52.5, 52.5],
        [157.5, 52.5],
        [52.5, 157.5],
    ]
    assert {frame["side"] for frame in page["frames"]} == {84.0}


@pytest.mark.parametrize(
    "arguments",
    [
        ("--page", "A9"),
        ("--kind", "cube"),
        ("--side", "200"),
        ("--side", "nan"),
        ("--side", "wide"),
        ("--kind", "corner", "--side", "100"),
        ("-o", "missing/target.pdf"),
        ("-o", "target.png"),
        ("-o", "folder.pdf"),
    ],
    ids=" ".join,
)
def test_what_cannot_be_written_leaves_nothing(run, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.pdf").mkdir()
    code, out, err = run("target", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("trisquare: error: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["folder.pdf"]


def test_a_refused_target_leaves_the_old_file(run, tmp_path):
    path = tmp_path / "target.pdf"
    path.write_bytes(b"old")
    assert run("target", "-o", path, "--side", "300")[0] == 2
    assert path.read_bytes() == b"old"


def test_without_reportlab_it_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "reportlab.pdfgen.canvas", None)
    code, out, err = run("target", "-o", tmp_path / "target.pdf")
    assert (code, out) == (2, "")
    assert "pip install 'trisquare[target]'" in err
    assert list(tmp_path.iterdir()) == []


# The folded corner.


def folded(page, face, point):
    """Position of a point of the sheet, in mm, after its face is folded."""
    frame, (rotation, translation) = page.frames[face], folded_frames(page)[face]
    on_plane = np.append(np.subtract(point, frame.centre), 0.0)
    return rotation @ on_plane + translation


def test_the_sheet_folds_into_a_corner():
    page = ts.printed_target("corner").pages[0]
    (top, apex), (left, _), (_, right) = page.folds
    for fold, faces in (((top, apex), (0, 1)), ((left, apex), (0, 2))):
        for point in fold:
            once, again = (folded(page, face, point) for face in faces)
            np.testing.assert_allclose(once, again, atol=1e-9)
    # The cut closes: the lower face's right edge coincides with the right face's lower edge.
    np.testing.assert_allclose(
        folded(page, 2, (apex[0], apex[1] + page.face)), folded(page, 1, right), atol=1e-9
    )
    np.testing.assert_allclose(folded(page, 1, apex), np.zeros(3), atol=1e-9)
    rotations = [rotation for rotation, _ in folded_frames(page)]
    normals = np.array([rotation[:, 2] for rotation in rotations])
    np.testing.assert_allclose(normals @ normals.T, np.eye(3), atol=1e-12)
    assert [round(np.linalg.det(rotation)) for rotation in rotations] == [1, 1, 1]
    # The print is inside: every frame is on the printed side of the others.
    for i, (_, translation) in enumerate(folded_frames(page)):
        others = np.delete(normals, i, axis=0)
        assert (others @ translation < 0.0).all()
    # The tab stays behind the face to which it is glued.
    outline = np.array(page.tab) - apex
    assert outline.min() >= 0.0
    assert outline.max() <= page.face
    with pytest.raises(ValueError, match="flat"):
        folded_frames(ts.printed_target("flat").pages[0])


def assert_calibrated(picture, truth, *, right_angles=False):
    """Check for three planes, and the camera within its stated errors, without options."""
    result = ts.calibrate(picture)
    assert len(result.planes) == 3
    for name in ("fx", "fy", "cx", "cy"):
        error = getattr(result.camera, name) - getattr(truth, name)
        assert abs(error) < 4.0 * result.std[name]
        assert result.std[name] < 0.5  # px, because a sound corner determines the camera well
    if right_angles:
        normals = np.array([plane.rotation[:, 2] for plane in result.planes])
        cosines = (normals @ normals.T)[np.triu_indices(3, 1)]
        assert np.degrees(np.abs(np.arcsin(cosines))).max() < 0.05


@pytest.mark.parametrize("seed", first_quick([7001, 7002]))
def test_the_folded_corner_calibrates(seed):
    rng = np.random.default_rng(seed)
    scene = simulate.corner_scene(rng)
    settings = {"tone": "srgb", "clutter": 40, "shading": 0.3, "colour": True}
    picture = simulate.render(scene, rng, **settings)
    assert_calibrated(picture, scene.camera, right_angles=True)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "size"), [(7005, (1280, 960)), (7006, (640, 480))])
def test_the_folded_boards_calibrate(seed, size):
    rng = np.random.default_rng(seed)
    (page,) = ts.printed_target("boards").pages
    scene = simulate.corner_scene(rng, page=page, image_size=size)
    settings = {"tone": "srgb", "clutter": 40, "shading": 0.3, "colour": True}
    picture = simulate.render(scene, rng, **settings)
    assert_calibrated(picture, scene.camera, right_angles=True)


def test_a_folded_board_is_counted_in_cells():
    (page,) = ts.printed_target("boards", side=60.0).pages
    scene = simulate.corner_scene(np.random.default_rng(0), page=page)
    for target, (_, centre) in zip(scene.targets, folded_frames(page), strict=True):
        assert target.extent == (9.0, 9.0)
        assert target.rim == pytest.approx(0.5 * (page.face / 60.0 - 1.0) * 18)
        # At the same distance from the first board as on the folded sheet.
        apart = np.linalg.norm(target.translation - scene.targets[0].translation) * 60.0 / 18.0
        assert apart == pytest.approx(np.linalg.norm(centre - folded_frames(page)[0][1]))


def test_the_corner_is_seen_from_near_its_diagonal():
    page = ts.printed_target("corner", page="Letter", side=60.0).pages[0]
    for seed in range(20):
        scene = simulate.corner_scene(np.random.default_rng(seed), page=page)
        normals = np.array([target.rotation[:, 2] for target in scene.targets])
        np.testing.assert_allclose(normals @ normals.T, np.eye(3), atol=1e-9)
        assert np.degrees(np.arccos(normals[:, 2])).max() < 54.8 + 15.0
        low, high = np.inf, -np.inf
        for number, target in enumerate(scene.targets):
            assert target.rim == pytest.approx(0.5 * (page.face / 60.0 - 1.0))
            pixels = scene.image_points(number, target.outlines()[0])
            low, high = np.minimum(low, pixels.min(axis=0)), np.maximum(high, pixels.max(axis=0))
        assert ((low > 0.0) & (high < [1279.0, 959.0])).all()
        assert (high - low)[1] > 0.75 * 960


# Pixel size of which every length of A4's corner is a multiple: pdftoppm places edges only to a
# quarter of a pixel, which would be an error of the sheet.
FINE_MM = 0.075
# Factor by which the picture is rendered finer, before averaging: as fine as the sheet, because its
# edges would otherwise be interpolated between pixels.
FINER = 6
CAMERA = TrueCamera(1105.0, 1101.0, 652.3, 471.8)


def photographed(papers, rng):
    """Photograph printed sheets: (raster, paper's outline mm, frame, its target in the scene)."""
    width, height = CAMERA.image_size
    light = np.full((FINER * height, FINER * width), 0.2, np.float32)
    # Maps between pixel centres: from a sheet's raster to mm, and to the finer picture.
    mm_of_raster = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1 / FINE_MM]]) * FINE_MM
    offset = 0.5 * (FINER - 1)
    finer_of_pixel = np.array([[FINER, 0, offset], [0, FINER, offset], [0, 0, 1]])
    for (sheet, paper, frame, target), lit in zip(papers, (1.0, 0.8, 0.6), strict=True):
        x, y = frame.centre
        plane_of_mm = np.array([[1, 0, -x], [0, 1, -y], [0, 0, frame.side]]) / frame.side
        pixel_of_plane = CAMERA.K @ np.column_stack([target.rotation[:, :2], target.translation])
        finer_of_mm = finer_of_pixel @ pixel_of_plane @ plane_of_mm
        at = cv2.perspectiveTransform(np.array(paper, float)[None], finer_of_mm).astype(int)
        mask = cv2.fillConvexPoly(np.zeros(light.shape, np.uint8), at, 1).astype(bool)
        printed = cv2.warpPerspective(sheet, finer_of_mm @ mm_of_raster, light.shape[::-1])
        light[mask] = lit * (0.04 + 0.7 * printed[mask] / 255.0)
    light = cv2.resize(light, (width, height), interpolation=cv2.INTER_AREA)
    light = cv2.GaussianBlur(light, (0, 0), 0.7)
    coded = 255.0 * encode_tone(light, "srgb") + 2.0 * rng.standard_normal(light.shape)
    return np.clip(np.rint(coded), 0, 255).astype(np.uint8)


def box(left, top, right, bottom):
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


@pytest.mark.slow
def test_a_photograph_of_the_folded_sheet_calibrates(tmp_path):
    """The actual PDF, with its folds and cuts, folded in front of a camera."""
    target = ts.printed_target("corner")
    (page,) = target.pages
    sheet = rastered(target.to_pdf(), tmp_path, dpi=25.4 / FINE_MM)
    rng = np.random.default_rng(7003)
    scene = simulate.corner_scene(rng, page=page, camera=CAMERA)
    (x, y), face = page.apex, page.face
    faces = [box(x - face, 0, x, y), box(x, 0, x + face, y), box(x - face, y, x, y + face)]
    papers = zip([sheet] * 3, faces, page.frames, scene.targets, strict=True)
    assert_calibrated(photographed(papers, rng), CAMERA, right_angles=True)


@pytest.mark.slow
def test_a_photograph_of_the_flat_sheets_calibrates(tmp_path):
    """The actual PDF, with its ruler and its text in the picture."""
    target = ts.printed_target("flat", side=150.0)
    rng = np.random.default_rng(7004)
    camera = ts.Camera(CAMERA.K, CAMERA.distortion, CAMERA.image_size)
    papers = []
    places = [((250, 250), 35.0, 90.0), ((1000, 260), 35.0, 210.0), ((640, 560), 35.0, 330.0)]
    for number, (at, tilt, direction) in enumerate(places):
        page = target.pages[number]
        sheet = rastered(target.to_pdf(), tmp_path, page=number + 1, dpi=25.4 / FINE_MM)
        square = ts.PlannedSquare.at(camera, at, 300.0, tilt=tilt, direction=direction)
        papers.append((sheet, box(0, 0, *page.size), page.frames[0], square))
    assert_calibrated(photographed(papers, rng), CAMERA)


def test_the_documentation_tells_the_sizes_and_its_lines_run(capsys):
    text = (Path(__file__).parents[2] / "docs" / "target.md").read_text("utf-8")
    for page in PAGES:
        corner, flat = (
            ts.printed_target(kind, page=page).pages[0].frames[0].side
            for kind in ("corner", "flat")
        )
        assert f"| {page} | {corner:g} mm | {flat:g} mm |" in text
    (code,) = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    exec(code, {})
    assert "4000 x 3000" in capsys.readouterr().out
