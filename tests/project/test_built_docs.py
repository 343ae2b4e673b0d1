"""The documentation as a browser shows it, with the notebook's outputs."""

import re
import subprocess
import sys

import pytest
from accessibility import serious_findings
from browser import CHROMIUM, Browser
from shown import DOCS

from trisquare.errors import help_of

pytest.importorskip("furo", reason="needs the extra docs")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None, reason="there is no chromium (Debian: apt-get install chromium)"
    ),
]

MAIN_PAGES = (
    *("index", "start", "tutorial", "notebook", "photograph", "targets", "faq", "how-exact"),
    *("formats", "glossary", "migration", "method", "api/index", "api/camera"),
    "_generated/commands",
)
SCREENS = ((1200, "light"), (390, "dark"))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-d", folder / "doctrees"]
    subprocess.run([*command, DOCS, folder / "html"], check=True)
    return folder / "html"


@pytest.fixture(scope="module")
def browser():
    with Browser() as browser:
        yield browser


@pytest.mark.parametrize("name", MAIN_PAGES)
def test_axe_finds_nothing_serious(browser, site, name):
    for width, scheme in SCREENS:
        browser.screen(width, phone=width < 500)
        browser.colour_scheme(scheme)
        browser.open(site / f"{name}.html")
        assert serious_findings(browser) == []
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.complaints == []


def test_a_reader_of_the_notebook_sees_what_its_cells_give(site):
    text = (site / "notebook.html").read_text("utf-8")
    outputs = re.findall(r'<div class="output .*?</div>\n', text, re.DOTALL)
    assert any(re.search(r"fx [+-]\d\.\d+ px, [+-]\d\.\d standard", it) for it in outputs)
    pictures = re.findall(r"<img[^>]*>", text.split("<article")[1])
    assert [re.search(r'alt="(.*?)"', it)[1].split()[0] for it in pictures] == [
        *("The", "Residuals", "Standard", "The")
    ]


def test_a_page_with_a_fault_is_found(browser, tmp_path):
    page = tmp_path / "page.html"
    page.write_text("<!doctype html><html lang=en><title>t</title><main><img src=x.png></main>")
    browser.open(page)
    assert [rule for rule, *_ in serious_findings(browser)] == ["image-alt"]
    browser.complaints.clear()


def test_help_leads_to_its_section(site):
    """`help` links to the section of every code on the page."""
    codes = re.findall(r"^### `(\w+)`$", (DOCS / "faq.md").read_text("utf-8"), re.MULTILINE)
    assert len(codes) > 40
    anchors = re.findall(r'<section id="([^"]+)"', (site / "faq.html").read_text("utf-8"))
    assert [code for code in codes if help_of(code).partition("#")[2] not in anchors] == []
