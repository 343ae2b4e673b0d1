"""Outlines drawn by hand: the edges are measured near a coarse outline."""

import json
import re
import tracemalloc
from functools import cache
from itertools import combinations

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import squares

import trisquare as ts
from trisquare import simulate
from trisquare.detection.annotations import formats as drawing_formats
from trisquare.detection.annotations.load import Annotations
from trisquare.detection.annotations.outlines import AnnotatedOutline

SIZE = (800, 600)
SCENE = squares(31, image_size=SIZE)
FRAMES = squares(32, kind="frame", image_size=SIZE)
PHOTO = simulate.render(SCENE, np.random.default_rng(1), noise=2.0, tone="srgb")
FRAMED = simulate.render(FRAMES, np.random.default_rng(2), noise=2.0, tone="srgb")
HEIGHT, WIDTH = PHOTO.shape


@cache
def searched():
    """The result of a search in the photograph."""
    return ts.calibrate(PHOTO)


def drawn(scene, seed=0, off=5.0):
    """Corners of all outlines of each target, each displaced by up to `off` pixels."""
    rng = np.random.default_rng([seed, 7])
    targets = []
    for number, target in enumerate(scene.targets):
        outlines = []
        for outline in target.outlines():
            radius, angle = off * np.sqrt(rng.uniform(size=4)), rng.uniform(0, 2 * np.pi, 4)
            aside = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
            outlines.append((scene.image_points(number, outline) + aside).tolist())
        targets.append(outlines)
    return targets


def own_file(targets, **members):
    squares = [
        {"corners": outlines[0], **({"inner": {"corners": outlines[1]}} if outlines[1:] else {})}
        for outlines in targets
    ]
    return {"format": "trisquare-outlines/1", "squares": squares, **members}


def labelme_file(targets, name="photo.png", size=(WIDTH, HEIGHT)):
    shapes = [
        {"label": "square", "points": outline, "shape_type": "polygon", "group_id": group}
        for group, outlines in enumerate(targets)
        for outline in outlines
    ]
    return {
        **{"version": "5.4.1", "shapes": shapes, "imagePath": f"..\\photos\\{name}"},
        **{"imageWidth": size[0], "imageHeight": size[1]},
    }


def assert_same(result, reference, sigmas=0.1, of_std=0.05):
    """Check that both used the same edges: they differ by far less than by the pixels' noise."""
    assert len(result.planes) == len(reference.planes)
    for name in ("fx", "fy", "cx", "cy"):
        gap = getattr(result.camera, name) - getattr(reference.camera, name)
        assert abs(gap) < sigmas * reference.std[name], name
    assert result.std["fx"] == pytest.approx(reference.std["fx"], rel=of_std)


@pytest.mark.parametrize("seed", range(3))
def test_corners_within_five_pixels_find_the_edges_that_a_search_finds(seed):
    result = ts.calibrate(PHOTO, outlines=own_file(drawn(SCENE, seed)))
    assert_same(result, searched())
    assert result.rejected == ()


def test_a_frame_is_one_plane_of_two_outlines():
    result = ts.calibrate(FRAMED, outlines=own_file(drawn(FRAMES)))
    assert [plane.kind for plane in result.planes] == ["frame"] * 3
    assert_same(result, ts.calibrate(FRAMED))
    edges = ts.detect(FRAMED, outlines=own_file(drawn(FRAMES)))
    assert [figure.plane for figure in edges] == [0, 0, 1, 1, 2, 2]


def test_light_squares_on_a_dark_ground_need_no_hint():
    negative = 255 - PHOTO
    result = ts.calibrate(negative, outlines=own_file(drawn(SCENE)), tone="linear")
    assert_same(result, ts.calibrate(negative, tone="linear"))


@pytest.mark.parametrize("form", ["lists", "sides", "polygon", "labelme", "linestrips"])
def test_every_form_says_the_same(tmp_path, form):
    targets = drawn(SCENE, 4, off=3.0)
    corners = [np.array(outlines[0]) for outlines in targets]
    sides = [
        [np.linspace(quad[i], quad[(i + 1) % 4], 5)[:: (-1) ** i].tolist() for i in range(4)]
        for quad in corners
    ]
    polygons = [
        np.roll([p for i in range(4) for p in np.linspace(q[i], q[i - 3], 6)[:-1]], 7, axis=0)
        for q in corners
    ]
    outlines = {
        "lists": [corners[0][::-1], corners[1].tolist(), sides[2]],
        "sides": {"format": "trisquare-outlines/1", "squares": [{"sides": s} for s in sides]},
        "polygon": {
            "format": "trisquare-outlines/1",
            "pictures": [{"index": 0, "squares": [{"polygon": p.tolist()} for p in polygons]}],
        },
        "labelme": labelme_file(targets),
        "linestrips": {
            "shapes": [
                {"points": side, "shape_type": "linestrip", "group_id": group}
                for group, square in enumerate(sides)
                for side in square
            ]
        },
    }[form]
    source = tmp_path / "photo.png"
    cv2.imwrite(str(source), PHOTO)
    if isinstance(outlines, dict):
        path = tmp_path / "outlines.json"
        path.write_text(json.dumps(outlines))
        outlines = path
    assert_same(ts.calibrate(source, outlines=outlines), searched())


def test_a_side_that_the_lens_bends_is_found_from_its_corners_alone():
    camera = simulate.TrueCamera(
        fx=900.0, fy=900.0, cx=639.5, cy=479.5, distortion=(-0.3, 0.08, 0, 0, 0)
    )
    scene = squares(33, camera=camera)
    photo = simulate.render(scene, np.random.default_rng(3), noise=2.0, tone="srgb")
    # With a stated tone curve, because its fit depends on the pixels that are used.
    result = ts.calibrate(photo, outlines=own_file(drawn(scene)), tone="srgb")
    assert_same(result, ts.calibrate(photo, tone="srgb"))


def test_an_outline_without_an_edge_is_named_and_left_out():
    targets = drawn(SCENE)
    nowhere = [[[375, 12], [425, 12], [425, 62], [375, 62]]]
    result = ts.calibrate(PHOTO, outlines=own_file([*targets, nowhere]))
    assert len(result.planes) == 3
    (rejected,) = result.rejected
    np.testing.assert_array_equal(rejected.corners, nowhere[0])
    assert '"squares[3].corners": no edge within 8 px of its side' in rejected.reason
    assert any(rejected.reason in warning for warning in result.warnings)
    with pytest.raises(ts.DetectionError, match=r"squares\[0\].corners") as failed:
        ts.calibrate(PHOTO, outlines=own_file([nowhere]))
    # Reported once, without the candidates that a search would have rejected.
    (reason,) = [candidate.reason for candidate in failed.value.rejected]
    assert str(failed.value).count(reason) == 1
    with pytest.raises(ts.DetectionError, match=r"outlines\[0\]"):
        ts.detect(PHOTO, outlines=nowhere)


def test_nothing_else_is_searched():
    with pytest.raises(ts.NotEnoughPlanesError):
        ts.calibrate(PHOTO, outlines=own_file(drawn(SCENE)[:1]))


@pytest.mark.slow
@pytest.mark.parametrize("targets", first_quick(["a4", "rectangle"]))
def test_outlines_are_of_the_rectangles_that_are_sought(targets):
    """As squares, these sheets would give a focal length that is off by a third."""
    rng = np.random.default_rng(2)
    scene = simulate.random_scene(rng, image_size=SIZE, aspect=2.0**0.5)
    picture = simulate.render(scene, rng)
    outlines = [outlines[0] for outlines in drawn(scene)]
    options = {"targets": targets, "fix": "aspect"}
    result = ts.calibrate(picture, outlines=outlines, **options)
    assert [plane.kind for plane in result.planes] == ["rectangle"] * 3
    searched = ts.calibrate(picture, **options)
    for name in ("fx", "cx", "cy"):
        gap = getattr(result.camera, name) - getattr(searched.camera, name)
        assert abs(gap) < 0.2 * searched.std[name], name


def test_a_frame_is_no_sheet_of_paper():
    with pytest.raises(ts.TrisquareError, match="frame") as refused:
        ts.calibrate(FRAMED, targets="a4", outlines=own_file(drawn(FRAMES)))
    assert {one.kind for one in refused.value.rejected} == {"frame"}


@pytest.mark.parametrize("targets", ["chessboard:9x6", "charuco:10x10:0.75"])
def test_outlines_of_boards_are_refused(targets):
    """A board is no square: an outline around it would give a wrong camera."""
    with pytest.raises(ValueError, match="names a board"):
        ts.calibrate(PHOTO, targets=targets, outlines=own_file(drawn(SCENE)))
    with pytest.raises(ValueError, match="names a board"):
        ts.detect(PHOTO, targets=targets, outlines=own_file(drawn(SCENE)))


def test_several_pictures_are_told_apart_by_name_or_index(tmp_path):
    paths = [tmp_path / "a.png", tmp_path / "b.png", tmp_path / "c.png"]
    scene = squares(32, camera=SCENE.camera)
    other = simulate.render(scene, np.random.default_rng(4), noise=2.0, tone="srgb")
    blank = np.full_like(PHOTO, 128)
    for path, picture in zip(paths, (PHOTO, other, blank), strict=True):
        cv2.imwrite(str(path), picture)
    here, there = drawn(SCENE), drawn(scene)
    by_index = {
        "format": "trisquare-outlines/1",
        "pictures": [own_file(there, index=1), own_file(here, index=0)],
    }
    by_name = {
        "format": "trisquare-outlines/1",
        "pictures": [
            own_file(targets, file=name)
            for name, targets in (("b.png", there), ("a.png", here), ("z.png", here))
        ],
    }
    for outlines in (by_name, by_index):
        result = ts.calibrate(paths, outlines=outlines)
        assert [plane.image for plane in result.planes] == [0, 0, 0, 1, 1, 1]
        assert any("picture 2 (c.png): nothing is drawn" in text for text in result.warnings)
    by_hand = ts.calibrate(paths[:2], outlines=by_index, tone="srgb")
    assert_same(by_hand, ts.calibrate(paths[:2], tone="srgb"))


GOOD = drawn(SCENE)[0][0]


def with_square(**square):
    return {"format": "trisquare-outlines/1", "squares": [square]}


@pytest.mark.parametrize(
    ("outlines", "key"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "nested too deeply"),
        ("[1, 2]", "must be an object"),
        ("{}", "is not an outlines file"),
        ('{"format": "trisquare/1"}', '"format"'),
        ('{"format": "trisquare-outlines/1", "squares": 3}', '"squares" must be a list'),
        ('{"format": "trisquare-outlines/1", "squares": []}', "no outline"),
        (
            {"format": "trisquare-outlines/1", "pictures": [own_file([[GOOD]], index=-1)]},
            r'"pictures\[0\].index" must not be negative',
        ),
        (
            {"format": "trisquare-outlines/1", "pictures": [own_file([[GOOD]], index=1)]},
            r'"pictures\[0\].index" is 1, but there are 1 pictures',
        ),
        (with_square(), r'"squares\[0\].corners" is missing'),
        (with_square(corners=GOOD[:3]), r"squares\[0\].corners.* 3 points"),
        (with_square(polygon=GOOD[:3]), r"squares\[0\].polygon.* 3 points"),
        (with_square(corners=[*GOOD[:3], [1, "2"]]), r"squares\[0\].corners"),
        (with_square(corners=[*GOOD[:3], [1]]), r"squares\[0\].corners.*ragged"),
        ('{"format": "trisquare-outlines/1", "squares": [{"corners": [[NaN]]}]}', "NaN"),
        (with_square(corners=[*GOOD[:3], [1e308, 1e308]]), r"squares\[0\].corners"),
        (
            with_square(corners=[[-5, 10], [90, 10], [90, 90], [-5, 90]]),
            r"squares\[0\].corners.*\(-5, 10\).*outside",
        ),
        (with_square(corners=[GOOD[0], GOOD[2], GOOD[1], GOOD[3]]), "crosses itself"),
        (with_square(corners=[[9, 9]] * 4), r"squares\[0\].corners"),
        (with_square(corners=[[9, 9], [19, 9], [19, 19], [9, 19]]), "a side of 10.0 px"),
        (with_square(sides=[GOOD[:2]] * 3), r"squares\[0\].sides.* 3 sides"),
        (
            with_square(sides=[[GOOD[i], GOOD[i - 3]] for i in (0, 2, 1, 3)]),
            r"squares\[0\].sides.* apart",
        ),
        (with_square(corners=GOOD, inner={"corners": GOOD}), "one must lie inside the other"),
        (labelme_file([[GOOD]], size=(HEIGHT, WIDTH)), "orientation tag"),
        (labelme_file([[GOOD]], size=(640, 480)), "drawn on a picture of 640 x 480"),
        (
            {
                "format": "trisquare-outlines/1",
                "pictures": [
                    own_file([[GOOD]], index=0, width=width, height=height)
                    for width, height in ((WIDTH, HEIGHT), (4000, 3000))
                ],
            },
            f"drawn on at sizes of {WIDTH} x {HEIGHT} and 4000 x 3000",
        ),
        (labelme_file([[GOOD]], name="other.png"), r"nothing is drawn on photo.png"),
        (labelme_file([[GOOD, GOOD, GOOD]]), "third outline"),
        (
            {"shapes": [{"points": GOOD, "shape_type": "linestrip", "group_id": 7}]},
            '"group_id" 7 has 1 sides',
        ),
        ({"shapes": [{"points": GOOD, "shape_type": "circle"}]}, r"shapes\[0\].shape_type"),
        ({"shapes": [{"shape_type": "polygon"}]}, r'"shapes\[0\].points" is missing'),
    ],
)
def test_a_bad_file_is_one_line_that_names_the_key(run, tmp_path, outlines, key):
    photo, file = tmp_path / "photo.png", tmp_path / "drawn.json"
    cv2.imwrite(str(photo), PHOTO)
    file.write_text(outlines if isinstance(outlines, str) else json.dumps(outlines))
    code, out, err = run("calibrate", photo, "--outline", file)
    assert (code, out, err.count("\n")) == (2, "", 1)
    with pytest.raises(ValueError, match=key):
        ts.calibrate(photo, outlines=file)


@pytest.mark.parametrize("outlines", [3, 2.5, b"x", [], [[]], [None], [[GOOD, 3]], ["abcd"], {}])
def test_bad_arguments_are_refused(outlines):
    with pytest.raises((TypeError, ValueError)):
        ts.calibrate(PHOTO, outlines=outlines)


def test_the_squares_of_a_file_without_the_file_are_told_apart():
    with pytest.raises(TypeError, match=r"outlines\[0\] is a JSON object.*give that file's path"):
        ts.calibrate(PHOTO, outlines=[{"corners": GOOD}])


def test_a_missing_file_is_named(run, tmp_path):
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), PHOTO)
    code, _, err = run("calibrate", photo, "--outline", tmp_path / "none.json")
    assert code == 5
    assert "none.json: No such file" in err


def test_the_command_draws_what_it_measured(run, tmp_path):
    photo, file, over = (tmp_path / name for name in ("photo.png", "drawn.json", "over.png"))
    cv2.imwrite(str(photo), PHOTO)
    file.write_text(json.dumps(own_file(drawn(SCENE))))
    code, out, _ = run("calibrate", photo, "--outline", file, "--json", "--overlay", over)
    assert code == 0
    assert len(json.loads(out)["planes"]) == 3
    assert over.exists()


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (40, 40), (200, 150)])
@pytest.mark.parametrize("fill", ["black", "noise"])
def test_hostile_pictures_end_in_an_error_of_ours(size, fill):
    rng = np.random.default_rng(5)
    picture = np.zeros(size, np.uint8)
    if fill == "noise":
        picture = rng.integers(0, 256, size, dtype=np.uint8)
    height, width = size
    whole = [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]
    with pytest.raises((ts.TrisquareError, ValueError)):
        ts.calibrate(picture, outlines=[whole])


def test_a_traced_mask_has_its_corners_found():
    quad = np.array([[100, 120], [420, 90], [460, 400], [80, 380]])
    mask = np.zeros((500, 500), np.uint8)
    cv2.fillConvexPoly(mask, quad, 255)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corners = AnnotatedOutline.of_polygon(contours[0][:, 0], "mask").corners
    distances = np.linalg.norm(corners[:, None] - quad[None], axis=2)
    assert distances.min(axis=0).max() < 8
    assert sorted(distances.argmin(axis=1).tolist()) == [0, 1, 2, 3]


CORNERS = [[20, 20], [90, 20], [90, 90], [20, 90]]


def area_of(corners):
    x, y = np.transpose(corners)
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("seed", range(20))
def test_the_corners_of_a_polygon_enclose_the_largest_area(seed):
    """Compared with all sets of four of its points."""
    rng = np.random.default_rng(seed)
    square = np.array([[10, 10], [90, 12], [88, 95], [8, 90], [10, 10]]) + rng.normal(0, 4, (5, 2))
    square[4] = square[0]
    along = np.sort(rng.uniform(0, 4, 12))
    side = along.astype(int)
    part = (along - side)[:, None]
    polygon = square[side] * (1 - part) + square[side + 1] * part + rng.normal(0, 0.5, (12, 2))
    largest = max(area_of(polygon[list(four)]) for four in combinations(range(12), 4))
    try:
        corners = AnnotatedOutline.of_polygon(polygon, "polygon").corners
    except ValueError as error:
        assert re.search("crosses itself|has a side of", str(error))  # noqa: PT017
    else:
        assert area_of(corners) == pytest.approx(largest, rel=1e-12)


def test_squares_of_one_picture_are_joined_wherever_they_stand_in_the_file():
    squares = [{"corners": (np.array(CORNERS) + 100 * i).tolist()} for i in range(4)]
    pictures = [{"index": i % 2, "squares": [square]} for i, square in enumerate(squares)]
    members = {"format": "trisquare-outlines/1", "pictures": pictures}
    found = Annotations.read(members, ["a.jpg", "b.jpg", "c.jpg"])
    assert found.of_pictures[2] is None
    for index, picture in enumerate(found.of_pictures[:2]):
        expected = [squares[index]["corners"], squares[index + 2]["corners"]]
        assert [target.outer.corners.tolist() for target in picture.targets] == expected


def test_shapes_of_a_group_are_one_frame_in_any_order():
    def shape(corners, group):
        return {"points": corners, "shape_type": "polygon", "group_id": group}

    outer, inner = CORNERS, [[40, 40], [70, 40], [70, 70], [40, 70]]
    other = (np.array(CORNERS) + 200).tolist()
    shapes = [shape(inner, 2), shape(other, 1), shape(outer, 2)]
    (picture,) = Annotations.read({"shapes": shapes}, ["a.jpg"]).of_pictures
    first, second = picture.targets
    assert (first.inner, second.inner is None) == (None, False)
    assert first.outer.corners.tolist() == other
    with pytest.raises(ValueError, match=r'"shapes\[3\].points" is the third outline of one frame'):
        Annotations.read({"shapes": [*shapes, shape(outer, 2)]}, ["a.jpg"])


@pytest.mark.parametrize("place", ["corners", "polygon", "sides"])
def test_a_long_string_among_numbers_takes_no_memory(place):
    """NumPy would allocate the length of the longest string for each number."""
    points = [[number, "x" * 100_000 if number == 7 else 1] for number in range(500)]
    square = {place: 4 * [points] if place == "sides" else points}
    members = {"format": "trisquare-outlines/1", "squares": [square]}
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=f"{place}.* must contain real numbers, not str"):
            Annotations.read(members, ["a.jpg"])
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_the_documented_example_is_read():
    text = drawing_formats.__doc__
    example = json.loads(text[text.index("   {") : text.index("For a single")])
    first, second = drawing_formats.annotated_pictures(example)
    assert [target.kind for target in first.targets] == ["square", "square", "frame"]
    assert (first.name, second.index, len(second.targets)) == ("front.jpg", 1, 1)
