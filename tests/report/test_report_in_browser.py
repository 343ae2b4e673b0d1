"""The report as a browser shows it: nothing complains, everything loads, the slider moves."""

import re
import shutil
import subprocess
from dataclasses import replace
from importlib import resources

import cv2
import numpy as np
import pytest
from accessibility import serious_findings
from browser import CHROMIUM, Browser

import trisquare as ts
from trisquare.results.rejected import Rejected

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no chromium (Debian: apt-get install chromium)"
)

HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script><svg onload=alert(3)>"

# What is measured of the slider's picture, in pixels of the page.
STAGE = "document.querySelector('.stage').getBoundingClientRect()"
BOX = f"(({{x, y, width, height}}) => [x, y, width, height])({STAGE})"
CLIP = "getComputedStyle(document.querySelector('.photograph')).clipPath"


def visible_part(browser):
    """Per cent of the photograph, from its left, that is not cut off."""
    right = re.fullmatch(r"inset\(0px ([\d.]+)%? 0px 0px\)|inset\(0px\)", browser.evaluate(CLIP))
    return 100.0 - float(right[1] or 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two reports: of the demo, and of one whose every text would like to be a script."""
    folder = tmp_path_factory.mktemp("reports")
    photograph = folder / "photo.png"
    photograph.write_bytes((resources.files("trisquare") / "data" / "demo.png").read_bytes())
    demo = ts.calibrate(photograph)
    ts.write_report(demo, folder / "demo.html", photograph)
    hostile = replace(
        demo,
        warnings=(HOSTILE,),
        planes=[replace(plane, kind=HOSTILE) for plane in demo.planes],
        rejected=(Rejected(HOSTILE, 0, demo.planes[0].corners, HOSTILE),),
    )
    named = folder / "<img src=x onerror=alert(4)>.png"
    shutil.copy(photograph, named)
    ts.write_report(hostile, folder / "hostile.html", named)
    return folder


@pytest.fixture(scope="module")
def browser():
    with Browser() as browser:
        yield browser


@pytest.fixture
def demo(browser, folder):
    browser.screen(1200)
    browser.colour_scheme("light")
    browser.media("")
    browser.open(folder / "demo.html")
    return browser


def picture_of(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).astype(float)


@pytest.mark.parametrize("name", ["demo.html", "hostile.html"])
def test_everything_loads_and_nothing_complains(browser, folder, name):
    browser.open(folder / name)
    images = browser.evaluate("[...document.images].map(i => i.complete && i.naturalWidth)")
    assert images == [1280, 1280]
    assert browser.evaluate("document.querySelectorAll('.plot svg').length") == 4
    assert browser.complaints == []
    assert "Page.javascriptDialogOpening" not in browser.events


def test_a_script_that_is_not_the_pages_own_does_not_run(demo, folder):
    """What escaping might ever miss, the page's policy stops."""
    own = (folder / "demo.html").read_text()
    injected = folder / "injected.html"
    injected.write_text(own.replace("<main>", "<main><script>document.title = 'run'</script>"))
    demo.open(injected)
    assert demo.evaluate("document.title").startswith("Calibration from photo.png")
    assert "Content Security Policy" in str(demo.complaints)
    demo.complaints.clear()


def box_in_view(browser):
    """Where the first photograph is, once the numbers above it are scrolled away."""
    browser.evaluate('document.querySelector(".stage").scrollIntoView({behavior: "instant"})')
    return browser.evaluate(BOX)


def test_the_slider_moves_by_pointer_and_by_key(demo):
    """And what it uncovers is the other picture."""
    x, y, width, height = (round(number) for number in box_in_view(demo))
    top = y + round(demo.evaluate("window.scrollY"))  # on the page
    assert visible_part(demo) == 50.0
    shots = {}
    for part in (0.9, 0.1):
        demo.click(x + part * width, y + 0.5 * height)
        assert visible_part(demo) == pytest.approx(100 * part, abs=1.0)
        shots[part] = picture_of(demo.screenshot())[top : top + height, x : x + width]
    between = slice(round(0.2 * width), round(0.8 * width))
    assert np.abs(shots[0.9] - shots[0.1])[:, between].mean() > 5.0
    outside = slice(round(0.95 * width), None)
    assert np.abs(shots[0.9] - shots[0.1])[:, outside].max() < 1.0
    demo.press_key("End")
    assert visible_part(demo) == 100.0
    demo.press_key("Home")
    assert visible_part(demo) == 0.0


def test_the_slider_follows_a_finger(demo):
    demo.screen(390, 844, phone=True)
    x, y, width, height = box_in_view(demo)
    demo.drag_finger(x + 0.5 * width, x + 0.8 * width, y + 0.4 * height)
    assert visible_part(demo) == pytest.approx(80.0, abs=2.0)


def luminance(rgb):
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


# Colours as numbers from 0 to 1: every text's, and that of what it stands on.
CONTRASTS = """(() => {
  const numbers = (colour) => {
    const canvas = new OffscreenCanvas(1, 1).getContext("2d");
    canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data].map(c => c / 255);
  };
  const behind = (node) => {
    for (; node; node = node.parentElement) {
      const ground = numbers(getComputedStyle(node).backgroundColor);
      if (ground[3] == 1) return ground.slice(0, 3);
    }
  };
  const texts = "p, h1, h2, h3, th, td, dd, figcaption, pre, li, a, .chip, .plot text";
  return [...document.querySelectorAll(texts)]
    .filter(node => !node.closest("svg") || !node.getAttribute("style").includes("#ffffff"))
    .filter(node => !node.closest(".correlations td"))
    .map(node => {
      const style = getComputedStyle(node);
      const ink = node.closest("svg") ? style.fill : style.color;
      return [node.textContent, numbers(ink).slice(0, 3), behind(node)];
    });
})()"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_can_be_read_in_light_and_dark(demo, folder, scheme):
    """By the contrast of 4.5 to 1 that WCAG 2 asks of text (level AA), in plots too."""
    demo.open(folder / "hostile.html")  # which has a warning and a candidate that was not used
    demo.colour_scheme(scheme)
    found = demo.evaluate(CONTRASTS)
    assert len(found) > 60
    for text, ink, ground in found:
        low, high = sorted([luminance(ink), luminance(ground)])
        assert (high + 0.05) / (low + 0.05) >= 4.5, text
    paper = luminance(found[0][2])
    assert paper > 0.9 if scheme == "light" else paper < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (390, "dark")])
@pytest.mark.parametrize("name", ["demo.html", "hostile.html"])
def test_axe_finds_nothing_serious(demo, folder, name, width, scheme):
    demo.screen(width, phone=width < 500)
    demo.colour_scheme(scheme)
    demo.open(folder / name)
    assert serious_findings(demo) == []


def test_a_phone_shows_it_without_scrolling_sideways(demo, folder):
    demo.open(folder / "hostile.html")
    demo.screen(390, 844, phone=True)
    assert demo.evaluate("document.documentElement.scrollWidth") == 390
    sizes = demo.evaluate(
        "[...document.querySelectorAll('.plot text')].map(t => t.getBoundingClientRect())"
        ".map(box => Math.min(box.width, box.height)).filter(size => size > 0)"
    )
    assert min(sizes) > 5.0  # a one-digit number is narrower than it is high
    heights = demo.evaluate(
        "[...document.querySelectorAll('.plot text')].map(t => "
        "parseFloat(getComputedStyle(t).fontSize) * t.getScreenCTM().a).filter(size => size > 0)"
    )
    assert min(heights) > 8.5
    x, _, width, height = demo.evaluate(BOX)
    assert x >= 0
    assert x + width <= 390
    assert width / height == pytest.approx(1280 / 960, rel=0.01)


def test_on_paper_both_pictures_stand_side_by_side_on_white(demo):
    demo.colour_scheme("dark")
    demo.media("print")
    boxes = demo.evaluate(
        "['.photograph', '.undistorted'].map(s => document.querySelector(s))"
        ".map(n => n.getBoundingClientRect()).map(({x, y, width}) => [x, y, width])"
    )
    (left, top, width), (right, same_top, same_width) = boxes
    assert left + width <= right
    assert top == same_top
    assert width == pytest.approx(same_width, abs=0.1)
    assert demo.evaluate(CLIP) == "none"
    hidden = "['.divider', '.stage input'].map(s => getComputedStyle(document.querySelector(s)))"
    assert demo.evaluate(f"{hidden}.map(style => style.display)") == ["none", "none"]
    ground = demo.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == "rgb(255, 255, 255)"


@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="there is no pdftoppm (poppler-utils)")
def test_the_printed_pages_show_pictures_and_plots(demo, tmp_path):
    (tmp_path / "report.pdf").write_bytes(demo.pdf())
    command = ["pdftoppm", "-r", "40", "-png", "report.pdf", "page"]
    subprocess.run(command, cwd=tmp_path, check=True)
    pages = [cv2.imread(str(path)) for path in sorted(tmp_path.glob("page*.png"))]
    assert 3 <= len(pages) <= 6
    # White paper; dark photographs on the first page; the map's colours on a later one.
    assert all(np.median(page) == 255 for page in pages)
    assert (pages[0].max(axis=2) < 100).mean() > 0.08
    assert max((np.ptp(page.astype(int), axis=2) > 60).mean() for page in pages[1:]) > 0.03
