"""The page in a browser: by pointer, finger and keys, with files and with a camera."""

import json
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

pytest.importorskip("starlette", reason="needs the extra serve")

from accessibility import serious_findings
from browser import CHROMIUM, Browser
from scenes import squares
from videos import write_frames

import trisquare as ts
from trisquare import simulate

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no chromium (Debian: apt-get install chromium)"
)

SIZE = (640, 480)
CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
SCENE = squares(11, image_size=SIZE)
PIXELS = simulate.render(SCENE, np.random.default_rng(12))
TRUTH = [SCENE.image_points(plane, CORNERS) for plane in range(3)]

# Expressions that the tests evaluate.
SHOWN = "!document.getElementById('{}').hidden"
TEXT = "document.getElementById('{}').textContent"
POINT = """(([x, y]) => {{
  const box = document.getElementById('drawing').getBoundingClientRect();
  return [box.x + (x + 0.5) / {width} * box.width, box.y + (y + 0.5) / {height} * box.height];
}})({point})"""
DRAWN = """[...document.querySelectorAll('#drawing .corner .dot')]
  .map(dot => [+dot.getAttribute('cx'), +dot.getAttribute('cy')])"""
LIST = "[...document.querySelectorAll('#squares label')].map(label => label.textContent.trim())"

# Every text, its colour, and that of its background, as numbers to 255.
COLOURS = """[...document.querySelectorAll('p, h1, h2, h3, label, button, th, td, li, dd, summary')]
  .filter(node => node.checkVisibility() && node.textContent.trim() && !node.closest('.unseen'))
  .map(node => {
    const numbers = (text) => text.match(/[\\d.]+/g).map(Number);
    const ground = (of) => getComputedStyle(of).backgroundColor;
    let behind = node;
    while (behind.parentElement && numbers(ground(behind))[3] === 0) behind = behind.parentElement;
    return [node.textContent, numbers(getComputedStyle(node).color), numbers(ground(behind))];
  })"""


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photographs") / "photo.png"
    cv2.imwrite(str(path), PIXELS)
    return path


@pytest.fixture(scope="module")
def address():
    command = [sys.executable, "-m", "trisquare", "serve", "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        told = ""
        while not told.endswith("}\n"):
            told += server.stdout.readline()
        yield json.loads(told)["address"]
        server.terminate()


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A camera at rest in front of the squares, as Y4M: a second of grey pictures."""
    path = tmp_path_factory.mktemp("film") / "film.y4m"
    width, height = SIZE
    frame = b"FRAME\n" + PIXELS.tobytes() + bytes([128]) * (width * height // 2)
    path.write_bytes(f"YUV4MPEG2 W{width} H{height} F10:1 Ip A1:1 C420jpeg\n".encode() + 10 * frame)
    return path


@pytest.fixture(scope="module")
def browser(address, film):
    arguments = (
        "--use-fake-device-for-media-stream",
        "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-video-capture={film}",
    )
    with Browser(*arguments, origin=address.split("/?")[0]) as browser:
        yield browser


@pytest.fixture
def page(browser, address):
    """The page, newly loaded; checked at the end to have no complaints."""
    browser.complaints.clear()
    browser.screen(1200)
    browser.colour_scheme("light")
    browser.open(address)
    browser.wait_for("document.querySelectorAll('#format option').length")
    yield browser
    assert browser.complaints == []


def press(page, name):
    """Click a button at its position."""
    page.evaluate(f"document.getElementById({name!r}).scrollIntoView({{block: 'center'}})")
    box = page.evaluate(
        f"(({{x, y, width, height}}) => [x + width / 2, y + height / 2])"
        f"(document.getElementById({name!r}).getBoundingClientRect())"
    )
    page.click(*box)


def at(page, point):
    """Position of a point of the photograph on the screen."""
    page.evaluate("document.getElementById('drawing').scrollIntoView({block: 'center'})")
    width, height = SIZE
    return page.evaluate(POINT.format(width=width, height=height, point=list(map(float, point))))


def opened(page, *photos):
    page.choose_files("#files", *photos)
    page.wait_for(f"document.querySelectorAll('#pictures li').length === {len(photos)}")
    page.wait_for(TEXT.format("expected"))


def drawn(page):
    return np.array(page.evaluate(DRAWN)).reshape(-1, 4, 2)


def gap(corners, truth):
    """The largest distance of a true corner from the nearest drawn one."""
    apart = np.hypot(*(np.asarray(truth)[:, None] - np.asarray(corners)).T)
    return apart.min(axis=0).max()


def calibrated(page):
    press(page, "calibrate")
    page.wait_for(SHOWN.format("results"))
    page.wait_for("document.getElementById('undistorted').naturalWidth")
    assert page.evaluate(TEXT.format("problem")) == ""
    return {
        name: (float(value), std)
        for name, value, std in page.evaluate(
            "[...document.querySelectorAll('#parameters tr')]"
            ".map(row => [...row.children].map(cell => cell.textContent))"
        )
    }


def test_a_photograph_is_calibrated(page, photo):
    opened(page, photo)
    assert len(drawn(page)) == 3
    assert "fx" in page.evaluate(TEXT.format("expected"))
    numbers = calibrated(page)
    own = ts.calibrate(PIXELS)
    assert list(numbers) == list(own.parameters)
    assert numbers["fx"][0] == pytest.approx(own.camera.fx, abs=own.std["fx"] / 5)
    assert float(numbers["fx"][1]) == pytest.approx(own.std["fx"], rel=0.06)
    for name in ("overlay", "undistorted"):
        page.wait_for(f"document.getElementById('{name}').naturalWidth === 640")


@pytest.mark.slow
def test_a_corner_that_is_dragged_snaps_and_undo_brings_it_back(page, photo):
    opened(page, photo)
    before = drawn(page)
    x, y = before[0][0]
    page.drag(at(page, (x, y)), at(page, (x + 4, y - 3)))
    page.wait_for(f"{LIST}[0].endsWith('measured')")
    after = drawn(page)
    assert min(gap(after[0], corners) for corners in TRUTH) < 0.5
    assert page.evaluate(SHOWN.format("magnifier")) is False
    page.press_key("z", ctrl=True)
    np.testing.assert_array_equal(drawn(page), before)
    page.press_key("z", ctrl=True, shift=True)
    assert not np.array_equal(drawn(page), before)
    assert calibrated(page)["fx"][0] == pytest.approx(ts.calibrate(PIXELS).camera.fx, rel=0.01)


@pytest.mark.slow
def test_keys_move_a_corner_and_delete_a_square(page, photo):
    opened(page, photo)
    before = drawn(page)
    page.evaluate("document.querySelector('#drawing .corner').focus()")
    page.press_key("ArrowRight")
    page.press_key("ArrowDown", shift=True)
    np.testing.assert_allclose(drawn(page)[0][0] - before[0][0], [1.0, 10.0], atol=0.02)
    assert page.evaluate(SHOWN.format("magnifier")) is True
    label = page.evaluate("document.activeElement.getAttribute('aria-label')")
    assert label.startswith("Square 1, corner 1: ")
    page.press_key("Tab")  # the edges are measured when the corner loses the focus
    page.wait_for(f"/measured|cannot/.test({LIST}[0])")
    page.evaluate("document.querySelector('#drawing .corner').focus()")
    page.press_key("Delete")
    assert len(drawn(page)) == 2
    page.wait_for(f"{TEXT.format('expected')}.includes('one more')")
    press(page, "undo")
    assert len(drawn(page)) == 3


@pytest.mark.slow
def test_where_finding_fails_squares_are_drawn_by_clicks(page, photo):
    opened(page, photo)
    while len(drawn(page)):
        page.evaluate("document.querySelector('#drawing .corner').focus()")
        page.press_key("Delete")
    for truth in TRUTH:
        press(page, "draw")
        for point in truth[[0, 2, 1, 3]] + 2.5:  # in any order
            page.click(*at(page, point))
    page.wait_for(f"{LIST}.length === 3 && {LIST}.every(text => text.endsWith('measured'))")
    for corners, truth in zip(drawn(page), TRUTH, strict=True):
        assert gap(corners, truth) < 0.5
    own = ts.calibrate(PIXELS)
    assert calibrated(page)["fx"][0] == pytest.approx(own.camera.fx, abs=own.std["fx"])


@pytest.mark.slow
def test_what_has_no_edges_says_so_and_escape_leaves_drawing(page, photo):
    opened(page, photo)
    press(page, "draw")
    for point in ((5, 5), (45, 5), (45, 45), (5, 45)):
        page.click(*at(page, point))
    page.wait_for(f"{LIST}[3].endsWith('cannot be measured')")
    reason = page.evaluate("document.querySelector('#squares .reason').textContent")
    assert reason.startswith("no edge within")
    press(page, "draw")
    page.click(*at(page, (100, 100)))
    page.press_key("Escape")
    assert page.evaluate("document.getElementById('draw').getAttribute('aria-pressed')") == "false"
    assert len(drawn(page)) == 4


@pytest.mark.slow
def test_a_square_is_added_by_keys_and_a_search_forgets_it(page, photo):
    opened(page, photo)
    page.evaluate("document.getElementById('add').focus()")
    page.press_key("Enter")
    focus = "document.activeElement.getAttribute('aria-label')"
    assert page.evaluate(focus).startswith("Square 4, corner 1: ")
    page.evaluate("document.getElementById('find').focus()")
    page.press_key("Enter")
    page.wait_for(f"{LIST}.length === 3")
    press(page, "undo")
    assert len(drawn(page)) == 4


@pytest.mark.slow
def test_a_rejected_square_is_not_used(page, photo):
    opened(page, photo)
    for number, missing in enumerate(("one more", "two more")):
        page.evaluate(f"document.querySelectorAll('#squares input')[{number}].focus()")
        page.press_key(" ")
        page.wait_for(f"{TEXT.format('expected')}.includes({missing!r})")
    press(page, "calibrate")
    page.wait_for(SHOWN.format("problem"))
    assert "plane" in page.evaluate(TEXT.format("problem"))
    page.forget_refusals()
    page.evaluate("document.querySelectorAll('#squares input')[0].focus()")
    page.press_key(" ")
    assert len(calibrated(page)) == 6


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    path = tmp_path_factory.mktemp("boards") / "board.png"
    rng = np.random.default_rng(3)
    scene = simulate.chessboard_scene(rng, SCENE.camera)
    cv2.imwrite(str(path), simulate.render(scene, rng))
    return path


@pytest.mark.slow
def test_a_board_is_not_edited_and_is_said_to_be_left_out(page, photo, board):
    """Four corners are only a part of a board: as a square, it would give a wrong camera."""
    opened(page, board, photo)
    assert len(drawn(page)) == 3
    assert page.evaluate(SHOWN.format("left-out")) is False
    page.evaluate("document.querySelector('#pictures button').click()")
    page.wait_for(f"{LIST}.length === 1 && {LIST}[0] === 'Chessboard 1, found'")
    assert len(drawn(page)) == 0
    page.wait_for(f"{TEXT.format('expected')}.startsWith('A chessboard is found.')")
    page.evaluate("document.querySelectorAll('#pictures button')[2].click()")
    page.evaluate("document.querySelector('#squares input').click()")
    assert "the chessboard of board.png" in page.evaluate(TEXT.format("left-out"))
    for number in (1, 2):
        page.evaluate(f"document.querySelectorAll('#squares input')[{number}].click()")
    press(page, "calibrate")
    page.wait_for(SHOWN.format("problem"))
    assert page.evaluate(TEXT.format("problem")).startswith("No square is used")
    for _ in range(3):
        press(page, "undo")
    assert page.evaluate(SHOWN.format("left-out")) is False
    pooled = calibrated(page)
    assert float(pooled["fx"][1]) < ts.calibrate(PIXELS).std["fx"]


@pytest.mark.slow
def test_outlines_are_saved_for_the_command_and_loaded_again(page, photo, tmp_path):
    page.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    opened(page, photo)
    before = drawn(page)
    press(page, "save-outlines")
    path = tmp_path / "outlines.json"
    saved = awaited(path)
    own = ts.calibrate(photo, outlines=path)
    assert len(own.planes) == 3
    assert json.loads(saved)["pictures"][0]["file"] == "photo.png"
    page.evaluate("document.querySelector('#drawing .corner').focus()")
    page.press_key("Delete")
    page.choose_files("#load-outlines", path)
    page.wait_for(f"{LIST}.length === 3 && {LIST}.every(text => text.endsWith('measured'))")
    np.testing.assert_allclose(drawn(page)[:, 0].mean(), before[:, 0].mean(), atol=300)
    for corners in drawn(page):
        assert min(gap(corners, truth) for truth in TRUTH) < 0.5


OUTLINES = {"format": "trisquare-outlines/1"}
SQUARE = {"corners": [[100, 100], [200, 100], [200, 200], [100, 200]]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x89PNG", "not JSON"),
        (None, "not of the format"),
        ({"squares": [SQUARE]}, "not of the format"),
        (OUTLINES, "no list of squares for a picture"),
        ({**OUTLINES, "pictures": [None]}, "no list of squares for a picture"),
        ({**OUTLINES, "squares": [None]}, "does not have four corners"),
        ({**OUTLINES, "squares": [{"sides": 3}]}, "does not have four corners"),
        ({**OUTLINES, "squares": [{"corners": [[1, 2], [3, 4]]}]}, "does not have four corners"),
        ({**OUTLINES, "file": "other.png", "squares": [SQUARE]}, "other.png"),
        ({**OUTLINES, "pictures": [{"index": 7, "squares": [SQUARE]}]}, "picture 7"),
        ({**OUTLINES, "width": 64, "squares": [SQUARE]}, "but photo.png has 640 x 480"),
    ],
)
def test_outlines_that_are_none_of_these_photographs_change_nothing(
    page, photo, tmp_path, content, said
):
    opened(page, photo)
    before = drawn(page)
    path = tmp_path / "outlines.json"
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    page.choose_files("#load-outlines", path)
    page.wait_for(SHOWN.format("problem"))
    problem = page.evaluate(TEXT.format("problem"))
    assert problem.startswith("outlines.json: ")
    assert said in problem
    np.testing.assert_array_equal(drawn(page), before)
    assert page.evaluate("document.getElementById('undo').disabled") is True


@pytest.mark.slow
def test_outlines_without_a_name_are_of_the_photograph_that_is_shown(page, photo, tmp_path):
    other = tmp_path / "again.png"
    cv2.imwrite(str(other), PIXELS)
    opened(page, photo, other)
    path = tmp_path / "outlines.json"
    path.write_text(json.dumps({**OUTLINES, "squares": [{"corners": TRUTH[0].tolist()}]}))
    page.choose_files("#load-outlines", path)
    page.wait_for(f"{LIST}.length === 1 && {LIST}[0].endsWith('measured')")
    page.evaluate("document.querySelector('#pictures button').click()")
    assert len(drawn(page)) == 3


def awaited(path):
    """Return the text of a file that a browser writes."""
    end = time.monotonic() + 30
    while not path.exists():
        assert time.monotonic() < end, path
        time.sleep(0.05)
    return path.read_text()


@pytest.mark.slow
def test_results_are_saved_in_every_format_and_compared(page, photo, tmp_path):
    page.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    opened(page, photo)
    calibrated(page)
    press(page, "save-result")
    own = ts.Calibration.from_json(awaited(tmp_path / "camera.json"))
    assert own.camera.image_size == SIZE
    press(page, "save-report")
    assert "photo.png" in awaited(tmp_path / "report.html")
    for name, file in (("ros", "camera_info.yaml"), ("colmap", "cameras.txt")):
        page.evaluate(f"document.getElementById('format').value = {name!r}")
        press(page, "save-camera")
        awaited(tmp_path / file)
        assert ts.Camera.load(tmp_path / file).fx == pytest.approx(own.camera.fx)
    page.choose_files("#earlier", tmp_path / "camera.json")
    verdict = page.wait_for(TEXT.format("comparison"))
    assert verdict.startswith("The same within their uncertainty")


@pytest.mark.slow
def test_several_photographs_are_pooled_and_one_is_taken_out(page, photo, tmp_path):
    other = tmp_path / "again.png"
    cv2.imwrite(str(other), simulate.render(SCENE, np.random.default_rng(13)))
    opened(page, photo, other)
    pooled = calibrated(page)
    assert float(pooled["fx"][1]) < ts.calibrate(PIXELS).std["fx"]
    page.evaluate("document.querySelectorAll('#pictures button')[3].click()")
    assert page.evaluate("document.querySelectorAll('#pictures li').length") == 1
    assert page.evaluate(SHOWN.format("results")) is False


@pytest.mark.slow
def test_a_file_that_is_no_picture_is_told(page, tmp_path):
    path = tmp_path / "broken.png"
    path.write_bytes(b"no picture")
    page.choose_files("#files", path)
    page.wait_for(SHOWN.format("problem"))
    assert page.evaluate(TEXT.format("problem")).startswith("broken.png")
    assert page.evaluate("document.getElementById('problem').getAttribute('role')") == "alert"
    page.forget_refusals()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["large.png", "large.mp4"])
def test_what_is_too_large_is_not_even_sent(page, tmp_path, name):
    with open(tmp_path / name, "wb") as file:
        file.truncate(250_000_000)
    page.choose_files("#files", tmp_path / name)
    page.wait_for(SHOWN.format("problem"))
    told = f"{name}: 250 MB are more than the 200 MB that can be sent at a time."
    assert page.evaluate(TEXT.format("problem")) == told


@pytest.mark.slow
def test_frames_of_a_video_are_photographs_and_every_problem_stays_told(page, photo, tmp_path):
    broken, damaged, clip = (tmp_path / name for name in ("a.png", "b.mp4", "clip.mp4"))
    broken.write_bytes(b"no picture")
    damaged.write_bytes(b"no video")
    scenes = [squares(seed, SCENE.camera, image_size=SIZE) for seed in (11, 12, 13)]
    rng = np.random.default_rng(14)
    write_frames(clip, [simulate.render(scene, rng) for scene in scenes])
    page.choose_files("#files", broken, clip, damaged, photo)
    page.wait_for("document.querySelectorAll('#pictures li').length === 4")
    names = "[...document.querySelectorAll('#pictures [aria-current]')].map(one => one.textContent)"
    frames = [f"clip-frame-{number}.png" for number in range(3)]
    assert page.evaluate(names) == [*frames, "photo.png"]
    problems = page.evaluate(TEXT.format("problem")).split("\n")
    assert [problem.split(":")[0] for problem in problems] == ["a.png", "b.mp4"]
    for place in ("0", "document.body.scrollHeight"):  # visible from both ends of the page
        top, bottom = page.evaluate(
            f"scrollTo(0, {place}), (({{top, bottom}}) => [top, innerHeight - bottom])"
            "(document.getElementById('problem').getBoundingClientRect())"
        )
        assert min(top, bottom) >= 0
    press(page, "close-problem")
    assert page.evaluate(SHOWN.format("problem")) is False
    assert page.evaluate("document.getElementById('close-problem').checkVisibility()") is False
    page.forget_refusals(2)
    own = ts.calibrate([clip, photo], frames=10)
    assert calibrated(page)["fx"][0] == pytest.approx(own.camera.fx, abs=own.std["fx"] / 5)


@pytest.mark.slow
@pytest.mark.parametrize("is_whole", [True, False])
def test_names_of_files_are_text_on_the_page(page, photo, tmp_path, is_whole):
    """Not elements: in the texts about a picture, in an error and in labels."""
    name = "<img src=x onerror=document.title='run'>&lt;b>.png"
    path = tmp_path / name
    path.write_bytes(photo.read_bytes() if is_whole else b"no picture")
    before = page.evaluate("document.querySelectorAll('img, b').length")
    if is_whole:
        opened(page, path)
        assert page.evaluate("document.querySelector('#pictures button').textContent") == name
    else:
        page.choose_files("#files", path)
        page.wait_for(SHOWN.format("problem"))
        page.forget_refusals()
    assert page.evaluate("document.querySelectorAll('img, b').length") == before
    assert page.evaluate("document.title") != "run"


@pytest.mark.slow
def test_the_camera_guides_and_takes_the_picture_by_itself(page):
    press(page, "open-camera")
    page.wait_for("document.querySelectorAll('#live .measured').length === 3")
    page.wait_for("document.getElementById('bar-fx').value > 0")
    assert page.evaluate(TEXT.format("text-cx")).startswith("\u00b1")
    assert page.evaluate(TEXT.format("advice"))
    page.wait_for("document.querySelectorAll('#pictures li').length === 1")
    page.wait_for(TEXT.format("expected"))
    assert page.evaluate(SHOWN.format("camera")) is False
    assert len(drawn(page)) == 3
    assert calibrated(page)["fx"][0] == pytest.approx(ts.calibrate(PIXELS).camera.fx, rel=0.05)


@pytest.mark.slow
def test_the_button_takes_the_picture_and_closing_ends_the_camera(page):
    page.evaluate("document.getElementById('by-itself').checked = false")
    press(page, "open-camera")
    page.wait_for("document.querySelectorAll('#live .measured').length === 3")
    press(page, "close-camera")
    assert page.evaluate(SHOWN.format("camera")) is False
    assert page.evaluate("document.getElementById('video').srcObject") is None
    press(page, "open-camera")
    page.wait_for("document.getElementById('video').videoWidth === 640")
    press(page, "take")
    page.wait_for("document.querySelectorAll('#pictures li').length === 1")
    page.wait_for(TEXT.format("expected"))


@pytest.mark.slow
def test_a_camera_that_the_browser_refuses_is_told(page):
    page.evaluate(
        "navigator.mediaDevices.getUserMedia = () => "
        "Promise.reject(new DOMException('no', 'NotAllowedError'))"
    )
    press(page, "open-camera")
    page.wait_for(SHOWN.format("problem"))
    assert "Allow it" in page.evaluate(TEXT.format("problem"))


@pytest.mark.slow
def test_a_finger_drags_a_corner_on_a_phone(page, photo):
    page.screen(390, 844, phone=True)
    opened(page, photo)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    before = drawn(page)
    x, y = at(page, before[0][0])
    page.drag_finger(x, x + 8, y)
    page.wait_for(f"/measured|cannot/.test({LIST}[0])")
    calibrated(page)
    assert page.evaluate("document.documentElement.scrollWidth") == 390


@pytest.mark.slow
def test_the_page_is_usable_by_keys_alone(page, photo):
    """Every control is reached by Tab, has a name, and shows that it has the focus."""
    opened(page, photo)
    named = page.evaluate(
        "[...document.querySelectorAll('button, input, select, [tabindex=\"0\"]')]"
        ".filter(node => node.checkVisibility())"
        ".map(node => node.getAttribute('aria-label') || node.labels?.[0]?.textContent"
        " || node.textContent)"
    )
    assert len(named) > 20
    assert all(name.strip() for name in named)
    page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(len(named) + 5):
        page.press_key("Tab")
        reached.add(
            page.evaluate("document.activeElement.id || document.activeElement.classList[0]")
        )
    assert {"files", "open-camera", "draw", "corner", "calibrate"} <= reached


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_can_be_read(page, photo, scheme):
    """The contrast of 4.5 to 1 that WCAG 2 requires for text (level AA)."""
    page.colour_scheme(scheme)
    opened(page, photo)
    calibrated(page)
    page.evaluate("document.getElementById('problem').hidden = false")
    page.evaluate("document.getElementById('problem').textContent = 'a problem'")
    found = page.evaluate(COLOURS)
    assert len(found) > 40
    for text, ink, ground in found:
        low, high = sorted([luminance(ink), luminance(ground)])
        assert (high + 0.05) / (low + 0.05) >= 4.5, text


def luminance(rgb):
    scaled = [c / 255 for c in rgb[:3]]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in scaled]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (390, "dark")])
def test_axe_finds_nothing_serious(page, photo, width, scheme):
    """As opened, with squares to correct, and with results."""
    page.screen(width, phone=width < 500)
    page.colour_scheme(scheme)
    assert serious_findings(page) == []
    opened(page, photo)
    assert serious_findings(page) == []
    calibrated(page)
    assert serious_findings(page) == []
