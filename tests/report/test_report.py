"""The report: true numbers, true drawings, and nothing that could run or be fetched."""

import base64
import json
import re
import shlex
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from html.parser import HTMLParser
from importlib import resources

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from scenes import edges_of, squares

import trisquare as ts
from trisquare.analysis.residuals import MeasuredSide, measured_sides
from trisquare.camera.camera import camera_parameters
from trisquare.camera.lens_models import COEFFICIENTS
from trisquare.camera.projection_uncertainty import ProjectionMap
from trisquare.images.reading import read_image
from trisquare.report import report_page, write_report
from trisquare.report.content import summary
from trisquare.report.layers import picture_layers
from trisquare.report.lens import lens_equations, radial_displacement
from trisquare.report.pictures import LARGEST_SHOWN, shown_pixels
from trisquare.report.plot_style import inline_svg, plotting
from trisquare.report.plots import (
    displacement_by_radius,
    residuals_by_radius,
    residuals_by_side,
    uncertainty_map,
)
from trisquare.report.scene import scene_of
from trisquare.results.rejected import Rejected

DEMO = resources.files("trisquare") / "data" / "demo.png"
HOSTILE = "<img src=x onerror=alert(1)>\"'&<script>alert(2)</script>"


class Page(HTMLParser):
    """The elements of a page, its visible text, and its references to other files."""

    def __init__(self, content):
        super().__init__()
        self.tags, self.references, self.handlers, self.text = [], [], [], ""
        self._hidden = False
        self.feed(content.decode("utf-8"))

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self._hidden = tag in ("style", "script")
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "action", "srcset"):
                self.references.append(value)
            if name.startswith("on"):
                self.handlers.append(name)

    def handle_endtag(self, tag):
        self._hidden = False
        self.text += "\n"

    def handle_data(self, data):
        if not self._hidden:
            self.text += data


@pytest.fixture(scope="module")
def demo():
    with resources.as_file(DEMO) as path:
        return ts.calibrate(path)


@pytest.fixture(scope="module")
def page(demo):
    with resources.as_file(DEMO) as path:
        return report_page(demo, path, command="trisquare calibrate demo.png")


@pytest.fixture(scope="module")
def scene():
    return squares(5)


@pytest.fixture(scope="module")
def edges(scene):
    return edges_of(scene, noise=0.05)


@pytest.fixture(scope="module")
def calibration(scene, edges):
    return ts.calibrate_edges(edges, scene.camera.image_size)


def test_the_page_holds_every_number_and_the_result_itself(demo, page):
    text = Page(page).text
    for name, std in demo.std.items():
        value = camera_parameters(demo.camera)[name]
        row = re.search(rf"\b{name}\s+(?:(px)\s+)?(-?[\d.]+)\s+([\d.]+)", text)
        assert (row[1] == "px") == (name in ("fx", "fy", "cx", "cy"))
        assert float(row[2]) == pytest.approx(value, abs=0.06 * std)
        assert float(row[3]) == pytest.approx(std, rel=0.06)
    assert "trisquare calibrate demo.png" in text
    assert f"NumPy {np.__version__}" in text
    uri = next(r for r in Page(page).references if r.startswith("data:application/json"))
    written = ts.Calibration.from_json(base64.b64decode(uri.split(",")[1]).decode())
    assert written.to_json() == demo.to_json()


def test_the_numbers_can_be_copied_with_all_digits(demo, page):
    (copied,) = re.findall('<pre class="copied">(.*?)</pre>', page.decode(), re.DOTALL)
    found = {}
    exec(copied, found)
    np.testing.assert_array_equal(found["K"], demo.camera.K)
    np.testing.assert_array_equal(found["distortion"], demo.camera.distortion)


COEFFICIENTS_OF_A_LENS = dict(
    zip(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
        (-0.2, 0.05, 0.003, -0.002, 0.01, 0.02, 0.03, -0.01, 0.001, 0.002, -0.003, 0.004),
        strict=True,
    )
)


@pytest.mark.parametrize("skew", [0.0, 2.0])
@pytest.mark.parametrize(
    ("model", "free"),
    [
        ("none", ""),
        ("radial2", "k1 k2"),
        ("brown", "k1 k2 p1 p2 k3"),
        ("rational", "k1 k2 p1 p2 k3 k4 k5 k6"),
        ("brown_prism", "k1 k2 p1 p2 k3 s1 s2 s3 s4"),
        ("thin_prism", "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"),
        ("equidistant", ""),
        ("fisheye2", "k1 k2"),
        ("fisheye", "k1 k2 k3 k4"),
    ],
)
def test_the_equations_say_where_a_point_is_seen(model, free, skew):
    distortion = [
        COEFFICIENTS_OF_A_LENS[name] if name in free.split() else 0.0
        for name in COEFFICIENTS[model]
    ]
    K = [[900.0, skew, 651.0], [0, 890.0, 470.0], [0, 0, 1]]
    camera = ts.Camera(K, distortion, (1280, 960), model)
    named = {*free.split(), *(("skew",) if skew else ())}
    known = {**camera_parameters(camera), "X": 0.3, "Y": -0.2, "Z": 1.1}
    signs = str.maketrans({"√": "sqrt", "·": "*", "²": "**2", "⁴": "**4", "⁶": "**6", "⁸": "**8"})
    for equation in lens_equations(camera, named):
        name, formula = equation.split(" = ")
        value = eval(formula.translate(signs), {"sqrt": np.sqrt, "atan2": np.arctan2}, known)
        known |= {"r": np.sqrt(value)} if name == "r²" else {name: value}
    seen = camera.project([[0.3, -0.2, 1.1]])[0]
    np.testing.assert_allclose([known["u"], known["v"]], seen, rtol=1e-12)


@pytest.mark.parametrize("valid_radius", [None, 0.5])
@pytest.mark.parametrize("model", ["radial2", "brown", "fisheye2"])
def test_the_radial_displacement_is_that_of_the_coefficients(model, valid_radius):
    """Up to the farthest corner, or the valid radius; tangential coefficients are left out."""
    k1, k2 = -0.2, 0.05
    others = {"brown": [0.01, -0.02, 0.0], "radial2": [0, 0, 0], "fisheye2": [0, 0]}[model]
    K = [[900.0, 0, 651.0], [0, 890.0, 470.0], [0, 0, 1]]
    camera = ts.Camera(K, [k1, k2, *others], (1280, 960), model, valid_radius)
    observed, displacement = radial_displacement(camera)
    ideal = (observed - displacement) / 900
    expected = ideal * (1 + k1 * ideal**2 + k2 * ideal**4)
    np.testing.assert_allclose(observed / 900, expected, atol=1e-9)
    corner = np.hypot(651.5, 489.5)
    end = corner if valid_radius is None else 900 * 0.5 * (1 + k1 * 0.5**2 + k2 * 0.5**4)
    assert observed[0] == 0
    assert observed[-1] == pytest.approx(end, rel=0.01)
    assert displacement[-1] < 0  # barrel: towards the middle


def test_the_page_says_how_far_the_lens_can_be_undone(undrawn, calibration):
    for valid_radius, said in ((0.5, "within the picture"), (2.0, "beyond the picture")):
        camera = replace(calibration.camera, valid_radius=valid_radius)
        degrees = f"{np.degrees(np.arctan(valid_radius)):.1f} degrees from the axis"
        text = Page(report_page(replace(calibration, camera=camera))).text
        assert f"{camera.valid_radius_px:.0f} px from the principal point, {degrees}" in text
        assert said in text
        assert "(0, 0) is the centre of the top-left pixel" in text


def test_a_lens_without_distortion_has_no_curve():
    K = [[900.0, 0, 651.0], [0, 890.0, 470.0], [0, 0, 1]]
    assert displacement_by_radius(ts.Camera(K, np.zeros(5), (1280, 960), "none"), []) is None


FOCAL, EQUIVALENT, WIDTH, HEIGHT, RESOLUTION, UNIT = 0x920A, 0xA405, 0xA002, 0xA003, 0xA20E, 0xA210


@pytest.mark.parametrize("tags", [{EQUIVALENT: 31}, {RESOLUTION: IFDRational(2000), UNIT: 3}])
def test_the_focal_length_is_said_in_millimetres(undrawn, calibration, tmp_path, tags):
    """From the focal-plane resolution with a std, or from the film equivalent; for two lenses."""
    camera = calibration.camera
    width, height = camera.image_size
    exif, paths = Image.Exif(), []
    blank = Image.fromarray(np.zeros((height, width), np.uint8))
    for focal in (5.8, 5.8, 7.0):
        exif[0x8769] = {FOCAL: IFDRational(focal), WIDTH: width, HEIGHT: height, **tags}
        paths.append(tmp_path / f"{len(paths)}.png")
        blank.save(paths[-1], exif=exif)
    said = re.findall(r"In millimetres .*", Page(report_page(calibration, paths)).text)
    assert [re.search(r"Exif states ([\d.]+) mm", each)[1] for each in said] == ["5.8", "7"]
    if EQUIVALENT in tags:
        # 31 mm on a diagonal of 43.27 mm correspond to the lens's 5.8 mm on its sensor's diagonal.
        per_mm = np.hypot(width, height) / 43.2666 * 31 / 5.8
        found = re.search(r"is about ([\d.]+) mm;", said[0])[1]
        assert float(found) == pytest.approx(camera.fx / per_mm, rel=0.01)
        assert "rounded" in said[0]
    else:
        found, std = re.search(r"is ([\d.]+) mm \(std ([\d.]+)\);", said[0]).groups()
        assert float(found) == pytest.approx((camera.fx + camera.fy) / 400, abs=float(std))
        assert float(std) == pytest.approx(calibration.std["fx"] / 200, rel=0.06)


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the plots, which take most of a report's time, for tests of the text."""
    names = ("displacement", "by_side", "by_radius", "beyond_scale", "uncertainty")
    monkeypatch.setattr("trisquare.report.page._plots", lambda *_: dict.fromkeys(names))


@pytest.fixture(scope="module")
def bare_page(calibration):
    """The report without a photograph."""
    return report_page(calibration)


def test_without_exif_nothing_is_said_in_millimetres(demo, page):
    assert "millimetres" not in Page(page).text


def test_the_page_says_when_it_was_made(undrawn, calibration, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert "2023-11-14" in Page(report_page(calibration)).text


def test_the_page_needs_no_other_file_and_is_the_same_again(demo, page):
    found = Page(page)
    assert found.tags.count("img") == 2
    assert found.tags.count("script") == 1
    assert found.references
    assert all(re.match(r"data:|#", reference) for reference in found.references)
    with resources.as_file(DEMO) as path:
        assert report_page(demo, path, command="trisquare calibrate demo.png") == page
    ids = re.findall(r'\bid="([^"]*)"', page.decode())
    assert len(ids) == len(set(ids))


def test_pictures_are_the_photograph_and_what_undistort_makes_of_it(demo, page):
    with resources.as_file(DEMO) as path:
        photograph = read_image(path)
    uris = [r for r in Page(page).references if r.startswith("data:image/jpeg")]
    shown = [
        cv2.imdecode(np.frombuffer(base64.b64decode(uri.split(",")[1]), np.uint8), 0)
        for uri in uris
    ]
    grey = photograph if photograph.ndim == 2 else cv2.cvtColor(photograph, cv2.COLOR_BGR2GRAY)
    wanted = {"photograph": grey, "undistorted": ts.undistort(grey, demo.camera)}
    for picture in wanted.values():
        differences = [np.abs(other.astype(float) - picture).mean() for other in shown]
        assert min(differences) < 3.0 < max(differences)


def test_whatever_names_and_messages_hold_is_text(calibration, tmp_path):
    photograph = tmp_path / "<img src=x onerror=alert(1)>\"'&.png"
    width, height = calibration.camera.image_size
    cv2.imwrite(str(photograph), np.zeros((height, width), np.uint8))
    corners = calibration.planes[0].corners
    hostile = replace(
        calibration,
        warnings=(HOSTILE,),
        software=HOSTILE,
        stage=HOSTILE,
        tone="srgb",
        planes=tuple(replace(plane, kind=HOSTILE) for plane in calibration.planes),
        rejected=(Rejected(HOSTILE, 0, corners, HOSTILE),),
    )
    found = Page(report_page(hostile, photograph, command=HOSTILE))
    assert found.tags.count("img") == 2
    assert found.tags.count("script") == 1
    assert found.handlers == []
    assert found.text.count(HOSTILE) >= 9
    assert photograph.name in found.text


def test_a_name_that_is_no_text_can_be_told(undrawn, calibration, tmp_path):
    photograph = tmp_path / "caf\udce9.png"
    width, height = calibration.camera.image_size
    encoded = cv2.imencode(".png", np.zeros((height, width), np.uint8))[1]
    photograph.write_bytes(encoded.tobytes())
    assert rb"caf\udce9.png" in report_page(calibration, photograph)


def polylines(path):
    """The polylines of an SVG path."""
    return [
        np.array([[float(number) for number in point.split()] for point in line.split("L")])
        for line in path.split("M")[1:]
    ]


def bend(line):
    """The largest distance of a polyline from its chord."""
    chord = line[-1] - line[0]
    across = np.array([-chord[1], chord[0]]) / np.hypot(*chord)
    return np.abs((line - line[0]) @ across).max()


def test_sides_lie_on_the_samples_and_are_straight_once_undistorted(calibration, edges):
    layers = picture_layers(calibration, 0, None)
    assert len(layers.planes) == len(layers.undistorted_planes) == 3
    for plane, figure in zip(layers.planes, edges, strict=True):
        for line, samples in zip(polylines(plane.sides), figure.points, strict=True):
            gaps = [np.hypot(*(line - sample).T).min() for sample in samples]
            assert max(gaps) < np.hypot(*np.diff(line, axis=0).T).max()
    assert max(bend(line) for plane in layers.planes for line in polylines(plane.sides)) > 1.0
    for plane in layers.undistorted_planes:
        assert max(bend(line) for line in polylines(plane.sides)) < 0.15  # rounded to tenths


def test_needles_are_the_residuals_times_the_stated_exaggeration(calibration, edges):
    layers = picture_layers(calibration, 0, None)
    residuals = np.concatenate([side.residuals for side in measured_sides(calibration)])
    needles = np.array([n for plane in layers.planes for n in polylines(plane.needles)])
    lengths = np.hypot(*(needles[:, 1] - needles[:, 0]).T)
    np.testing.assert_allclose(lengths, layers.exaggeration * np.abs(residuals), atol=0.15)
    assert layers.rms == pytest.approx(calibration.rms, rel=0.02)


def test_many_residuals_are_thinned_and_the_page_says_so(calibration, scene):
    edges = edges_of(scene, noise=0.05, spacing=0.5)
    dense = ts.calibrate_edges(edges, calibration.camera.image_size)
    layers = picture_layers(dense, 0, None)
    assert layers.every > 1
    assert f"one in {layers.every} is drawn".encode() in report_page(dense)


def side(residual, plane, *, at, normal, count=20):
    """Samples around one position, all with one residual."""
    points = np.array(at, float) + np.linspace(-1.0, 1.0, count)[:, None] * [normal[1], -normal[0]]
    return MeasuredSide(
        points,
        np.full(count, residual),
        np.tile(np.array(normal, float), (count, 1)),
        plane,
    )


def test_the_plot_by_side_shows_each_sides_mean(calibration, edges):
    sides = list(measured_sides(calibration))
    sides[6] = replace(sides[6], residuals=sides[6].residuals + 0.7)
    with plotting():
        axes = residuals_by_side(sides).axes[0]
    drawn = np.asarray(axes.collections[1].get_offsets())
    np.testing.assert_allclose(drawn[:, 1], [s.residuals.mean() for s in sides])
    assert np.argmax(drawn[:, 1]) == 6
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0", "1", "2"]


def test_the_plot_by_radius_counts_outward_as_positive(calibration):
    """For either direction of the normals, and only for sides that run across the radius."""
    centre = np.array([calibration.camera.cx, calibration.camera.cy])
    sides = [
        side(+0.2, 0, at=np.add(centre, [300, 0]), normal=[1, 0]),
        side(-0.2, 0, at=np.add(centre, [300, 0]), normal=[-1, 0]),
        side(+0.1, 1, at=np.add(centre, [-100, 0]), normal=[1, 0]),
        side(9.0, 2, at=np.add(centre, [200, 0]), normal=[0, 1]),
    ]
    with plotting():
        figure, _ = residuals_by_radius(calibration, sides)
        assert residuals_by_radius(calibration, sides[3:]) is None
        assert residuals_by_radius(calibration, []) is None
    drawn = np.asarray(figure.axes[0].collections[0].get_offsets())
    outward = {round(radius, -1): value for radius, value in drawn.tolist()}
    assert outward == {300.0: pytest.approx(0.2), 100.0: pytest.approx(-0.1)}


def test_the_map_covers_the_picture_and_not_what_the_lens_does_not_reach(calibration):
    known = calibration.projection_map()
    with plotting():
        axes = uncertainty_map(calibration, known).axes[0]
    width, height = calibration.camera.image_size
    assert axes.get_xlim() == (-0.5, width - 0.5)
    assert axes.get_ylim() == (height - 0.5, -0.5)
    half = np.where(known.x > width / 2, np.inf, known.std)
    with plotting():
        axes = uncertainty_map(calibration, ProjectionMap(known.x, known.y, half)).axes[0]
    filled = [path.get_extents() for path in axes.collections[0].get_paths() if len(path)]
    assert 0.4 * width < max(box.xmax for box in filled) <= 0.55 * width


def test_the_part_that_the_lens_does_not_cover_is_that_of_all_pixels(calibration):
    """The map extends to the border, so that points beyond a corner have too much weight in it."""
    size = 300, 200
    K = np.array([[200.0, 0, 149.5], [0, 200, 99.5], [0, 0, 1]])
    camera = ts.Camera(K, [-0.3, 0, 0, 0, 0], size, "radial1")
    short = replace(calibration, camera=camera)
    said = " ".join(summary(short, short.projection_map()))
    x, y = np.meshgrid(*map(np.arange, size))
    beyond = np.hypot(x - 149.5, y - 99.5) > camera.valid_radius_px
    assert 0.05 < beyond.mean() < 0.3
    assert f"does not cover {100 * beyond.mean():.0f} % of the picture" in said


@pytest.mark.parametrize(
    "std", [np.zeros((4, 5)), np.full((4, 5), np.inf), np.ones((1, 5)), np.full((4, 5), 1e300)]
)
def test_no_map_is_drawn_of_nothing(calibration, std):
    rows, columns = std.shape
    known = ProjectionMap(np.arange(columns), np.arange(rows), std)
    with plotting():
        assert uncertainty_map(calibration, known) is None


@pytest.mark.parametrize("std", [np.full((4, 5), 0.3), np.geomspace(1e-9, 1e5, 20).reshape(4, 5)])
def test_every_other_map_is_drawn(calibration, std):
    known = ProjectionMap(np.arange(5), np.arange(4), std)
    with plotting():
        assert "<svg" in inline_svg(uncertainty_map(calibration, known), "map")


def test_the_scene_holds_where_camera_and_planes_stand(calibration):
    found = scene_of(calibration)
    assert [plane["number"] for plane in found["planes"]] == [0, 1, 2]
    for drawn, plane in zip(found["planes"], calibration.planes, strict=True):
        assert drawn["image"] == plane.image
        half = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 2
        np.testing.assert_allclose(
            drawn["corners"], half @ plane.rotation.T + plane.translation, atol=0.01
        )
    base, camera = np.array(found["camera"]), calibration.camera
    width, height = camera.image_size
    pixels = base @ camera.K.T
    expected = [
        [-0.5, -0.5],
        [width - 0.5, -0.5],
        [width - 0.5, height - 0.5],
        [-0.5, height - 0.5],
    ]
    np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:], expected, atol=0.1)


def test_planes_behind_the_camera_are_not_in_the_scene(undrawn, calibration):
    turned = [
        replace(plane, translation=plane.translation * [1, 1, -1]) for plane in calibration.planes
    ]
    some = scene_of(replace(calibration, planes=[turned[0], *calibration.planes[1:]]))
    assert [plane["number"] for plane in some["planes"]] == [1, 2]
    behind = replace(calibration, planes=turned)
    assert scene_of(behind) is None
    assert b"data-scene=" not in report_page(behind)


def test_photographs_can_be_chosen_where_there_are_several(undrawn, calibration):
    assert b"<select>" not in report_page(calibration)
    first, *others = calibration.planes
    two = replace(calibration, planes=[first, *(replace(plane, image=1) for plane in others)])
    assert re.findall('<option value="(.*?)">(.*?)</option>', report_page(two).decode()) == [
        ("", "all photographs"),
        ("0", "picture 0"),
        ("1", "picture 1"),
    ]


def test_a_report_without_pictures_or_edges(calibration, bare_page):
    text = Page(report_page(replace(calibration, edges=(), residuals=()))).text
    assert "no photograph was given" in text
    assert "There are no residuals" in text
    assert "There are no residuals" not in Page(bare_page).text


@pytest.mark.parametrize("size", [(1, 1), (1, 700), (3, 2)])
def test_a_report_of_a_tiny_camera(size):
    camera = ts.Camera([[5.0, 0, 0], [0, 5.0, 0], [0, 0, 1]], np.zeros(5), size)
    bare = ts.Calibration(
        camera=camera,
        std={},
        covariance=np.zeros((0, 0)),
        parameters=[],
        planes=[],
        rms=0.0,
        noise_scale=0.0,
        warnings=[],
        method="ml",
        tone="linear",
        fixed=[],
        stage="edges",
    )
    assert Page(report_page(bare, np.zeros(size[::-1], np.float32))).tags.count("img") == 2
    assert not ts.diagnose(bare)


def test_warnings_of_low_severity_are_not_in_the_box(calibration):
    severities = ("high", "medium", "low")
    told = [ts.CalibrationWarning(f"{one} one", "other", one) for one in severities]
    page = report_page(replace(calibration, warnings=told)).decode()
    box = re.search(r'<div class="warnings".*?</div>', page, re.DOTALL)[0]
    assert "high: high one [other]" in box
    assert "medium: medium one [other]" in box
    assert "low one" not in box
    assert "<li>low one [other]</li>" in page
    minor = report_page(replace(calibration, warnings=told[2:])).decode()
    assert 'class="warnings"' not in minor
    assert "There are no warnings" not in minor


def turned(plane):
    """The plane in another orientation than its samples show."""
    return replace(plane, rotation=np.roll(plane.rotation, 1, axis=1))


@pytest.mark.parametrize(
    "contort",
    [
        lambda c: replace(c, planes=[turned(plane) for plane in c.planes]),
        lambda c: replace(c, planes=[replace(p, corners=1e5 * p.corners) for p in c.planes]),
        lambda c: replace(c, camera=replace(c.camera, image_size=(3, 20000))),
        lambda c: replace(c, covariance=1e40 * c.covariance, rms=1e300),
    ],
    ids=["poses", "corners", "narrow", "uncertain"],
)
def test_a_result_that_makes_no_sense_makes_a_page_all_the_same(calibration, edges, contort):
    text = report_page(contort(calibration)).decode()
    assert text.endswith("</html>")
    assert not re.search(r"[ML >](nan|inf)\b", text)


def test_a_lens_that_reaches_nothing_is_not_undistorted(undrawn, calibration):
    size = calibration.camera.image_size
    far = ts.Camera([[900.0, 0, -5e4], [0, 900.0, -5e4], [0, 0, 1]], [-0.3, 0, 0, 0, 0], size)
    lost = replace(calibration, camera=far, planes=[], edges=(), residuals=())
    found = Page(report_page(lost, np.zeros(size[::-1], np.uint8)))
    assert found.tags.count("img") == 1
    assert "cannot be undistorted" in found.text


def test_correlations_are_those_of_the_covariance(demo):
    found = ts.diagnose(demo)
    matrix = np.array([[found[a].correlation.get(b, 1.0) for b in found] for a in found])
    spread = np.sqrt(np.diag(demo.covariance))
    np.testing.assert_allclose(matrix * np.outer(spread, spread), demo.covariance, rtol=1e-12)


def test_pictures_are_shown_in_eight_bits_and_no_larger_than_needed():
    deep = np.full((1000, 4000, 3), 32768, np.uint16)
    shown = shown_pixels(deep, linear=False)
    assert (shown.dtype, shown.shape) == (np.uint8, (400, LARGEST_SHOWN, 3))
    assert np.unique(shown).tolist() == [128]
    # Half the light is coded as 188 of 255 in sRGB.
    assert np.unique(shown_pixels(deep, linear=True)).tolist() == [188]
    assert np.unique(shown_pixels(np.full((2, 2), 0.5, np.float32), linear=True)).tolist() == [188]
    bright = np.array([[-1.0, 2.0]], np.float32)
    assert shown_pixels(bright, linear=True).tolist() == [[0, 255]]


def test_of_several_photographs_the_first_are_shown(undrawn, calibration):
    size = calibration.camera.image_size
    photographs = [np.zeros(size[::-1], np.uint8)] * 8
    page = report_page(calibration, photographs)
    text, content = Page(page).text, page.decode()
    assert "2 more photographs are not shown" in text
    # All except the first are collapsed, and the numbers precede them.
    assert [content.count(tag) for tag in ("<details open>", "<details>")] == [1, 5]
    assert content.index("<h2>The planes</h2>") < content.index("<details open>")
    assert "<details" not in report_page(calibration, photographs[:2]).decode()
    assert "picture 7" in text  # in the list of files


def test_refusals(calibration, tmp_path):
    with pytest.raises(TypeError, match="Calibration"):
        write_report("calibration", tmp_path / "x.html")
    with pytest.raises(ValueError, match="is it one of them"):
        write_report(calibration, tmp_path / "x.html", np.zeros((5, 7), np.uint8))
    with pytest.raises(ts.ImageError):
        write_report(calibration, tmp_path / "x.html", tmp_path / "no.png")
    with pytest.raises(OSError, match="no folder"):
        write_report(calibration, tmp_path / "no" / "x.html")
    assert list(tmp_path.iterdir()) == []


def test_nobodys_own_settings_matter(calibration, edges, page, demo):
    import matplotlib

    with matplotlib.rc_context(
        {"font.size": 30.0, "axes.facecolor": "red", "svg.fonttype": "path"}
    ):
        before = dict(matplotlib.rcParams)
        with resources.as_file(DEMO) as path:
            assert report_page(demo, path, command="trisquare calibrate demo.png") == page
        assert dict(matplotlib.rcParams) == before


def test_threads_do_not_disturb_each_other(calibration, bare_page):
    """matplotlib's settings are global to the process."""
    with ThreadPoolExecutor(2) as pool:
        pages = list(pool.map(lambda _: report_page(calibration), range(2)))
    assert pages == [bare_page] * 2


@pytest.mark.parametrize("module", ["jinja2", "matplotlib"])
def test_a_missing_extra_is_told_before_anything_is_computed(run, tmp_path, monkeypatch, module):
    def compute(*_arguments, **_options):
        raise AssertionError("computed in vain")

    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr("trisquare.cli.calibrate.calibrate_photographs", compute)
    photograph, report = tmp_path / "photo.png", tmp_path / "out.html"
    photograph.write_bytes(DEMO.read_bytes())
    code, out, err = run("calibrate", photograph, "--report", report)
    assert (code, out) == (2, "")
    assert "pip install 'trisquare[report]'" in err
    assert not report.exists()


def test_the_command_writes_a_report_that_says_how_to_repeat_it(undrawn, run, tmp_path):
    photograph, report = tmp_path / "a photo.png", tmp_path / "out.html"
    photograph.write_bytes(DEMO.read_bytes())
    options = ["--free", "skew", "--model", "brown", "--json"]
    code, out, _ = run("calibrate", photograph, "--report", report, *options)
    assert code == 0
    found = Page(report.read_bytes())
    (told,) = re.findall(r"^trisquare calibrate .*$", found.text, re.MULTILINE)
    assert "--method" not in told  # because it has the default value
    report.unlink()
    code, again, _ = run(*shlex.split(told)[1:])
    assert code == 0
    assert json.loads(again) == json.loads(out)
    assert Page(report.read_bytes()).text == found.text


def test_a_report_does_not_overwrite_what_else_is_named(run, tmp_path):
    photograph = tmp_path / "photo.png"
    photograph.write_bytes(DEMO.read_bytes())
    for taken, others in [(photograph, []), (tmp_path / "x", ["-o", tmp_path / "x"])]:
        code, _, err = run("calibrate", photograph, "--report", taken, *others)
        assert code == 2
        assert "overwrite" in err
    assert photograph.read_bytes() == DEMO.read_bytes()


def test_a_calibration_that_fails_leaves_no_report(run, tmp_path):
    photograph, report = tmp_path / "black.png", tmp_path / "out.html"
    cv2.imwrite(str(photograph), np.zeros((96, 128), np.uint8))
    assert run("calibrate", photograph, "--report", report)[0] == 3
    assert not report.exists()
