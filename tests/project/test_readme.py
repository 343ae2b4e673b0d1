"""The README shows what works."""

import re
from importlib import resources

import pytest
from shown import CHECKOUT, blocks, page, run_page

import trisquare as ts

README = page("README.md")
MAX_LINES = 150


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder with only the demo's photograph."""
    photo = (resources.files("trisquare") / "data" / "demo.png").read_bytes()
    (tmp_path / "photo.jpg").write_bytes(photo)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_all_of_it_runs_in_order(folder, capsys):
    names = run_page("README.md", capsys)
    assert f"{names['result']}\n" in capsys.readouterr().out
    assert ts.Calibration.load("camera.json") == names["result"]
    assert names["K"].shape == (3, 3)
    assert names["distortion"].shape == (5,)
    for name in ("camera_info.yaml", "report.html", "straight.png", "target.pdf"):
        assert (folder / name).stat().st_size > 100


def test_the_commands_are_targets_of_the_makefile():
    makefile = (CHECKOUT / "Makefile").read_text("utf-8")
    ((_, commands),) = blocks(README, "sh")
    targets = re.findall(r"^make (\w+)", commands, re.MULTILINE)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_it_is_short():
    assert len(README.splitlines()) <= MAX_LINES


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (CHECKOUT / target).is_file(), target
