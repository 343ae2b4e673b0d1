"""The page of the experiments, its plots, and the script that writes them."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CHECKOUT = Path(__file__).parents[2]
DOCS = CHECKOUT / "docs"
LARGEST = 60_000  # maximum size of a plot in bytes


@pytest.fixture
def experiments(monkeypatch):
    """Import the modules of the script in the same way."""
    pytest.importorskip("matplotlib")
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(CHECKOUT / "benchmarks"))
    from experiments import estimators, page, plots, printed_corner, results, run

    yield {
        module.__name__.partition(".")[2]: module
        for module in (estimators, page, plots, printed_corner, results, run)
    }
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("accuracy", "experiments", "harness", "real", "run"):
            del sys.modules[name]


def test_the_page_has_the_numbers_of_the_results(experiments):
    found = experiments["results"].read()
    assert (DOCS / "experiments.md").read_text("utf-8") == experiments["page"].text(found)


def test_no_line_of_the_page_is_a_comment(experiments):
    """In MyST, a line that begins with a per cent sign is a comment and is not shown."""
    lines = experiments["page"].text(experiments["results"].read()).splitlines()
    assert [line for line in lines if line.startswith("%")] == []


@pytest.mark.slow
def test_the_plots_are_drawn_from_the_results(experiments):
    found = experiments["results"].read()
    for name, svg in experiments["plots"].drawn(found).items():
        assert (DOCS / "experiments" / f"{name}.svg").read_text("utf-8") == svg


def test_the_plots_are_small_and_follow_the_scheme():
    page = (DOCS / "experiments.md").read_text("utf-8")
    shown = re.findall(r"!\[[^\]]+\]\((experiments/\w+\.svg)\)", page)
    assert len(shown) == 8
    assert {DOCS / name for name in shown} == set((DOCS / "experiments").glob("*.svg"))
    for name in shown:
        svg = (DOCS / name).read_text("utf-8")
        assert len(svg.encode()) < LARGEST, name
        assert "<text" in svg
        assert "prefers-color-scheme: dark" in svg
        # Every colour is from the palette.
        assert not re.findall(r"#[0-9a-f]{6}", svg.partition("</style>")[2]), name


def with_another_number(experiments):
    """The results with one changed number, which one plot shows."""
    found = experiments["results"].read()
    found["sweeps"]["tilt"][-1]["edges"]["cx"]["rms"] *= 1.5
    return found


def test_a_change_of_a_number_is_seen(experiments):
    found = with_another_number(experiments)
    assert experiments["page"].text(found) != (DOCS / "experiments.md").read_text("utf-8")


@pytest.mark.slow
def test_a_change_of_a_number_is_drawn(experiments):
    found = with_another_number(experiments)
    changed = [
        name
        for name, svg in experiments["plots"].drawn(found).items()
        if (DOCS / "experiments" / f"{name}.svg").read_text("utf-8") != svg
    ]
    assert changed == ["tilt"]


def without_photographs(experiments):
    """The results without photographs."""
    found = experiments["results"].read()
    found["gallery"], found["lengths"]["real"] = [], {}
    return found


def test_what_is_absent_is_said(experiments):
    found = without_photographs(experiments)
    page = experiments["page"].text(found)
    assert "gallery.svg" not in page
    assert page.count("their photographs were not there") == 1
    assert "Left out: the photographs were not there." in page


@pytest.mark.slow
def test_plots_are_drawn_without_what_is_absent(experiments):
    assert experiments["plots"].drawn(without_photographs(experiments))


def test_errors_are_summed_up(experiments):
    results = experiments["results"]
    errors = [[3.0, 0.0, 1.0, 2.0, -0.02], None, [-4.0, 0.0, 1.0, 2.0, 0.02]]
    found = results.summary(errors, [1.0, 1.0, 1.0, 1.0, 0.01])
    assert (found["scenes"], found["answered"]) == (3, 2)
    assert found["fx"] == {"rms": pytest.approx(12.5**0.5), "low": 3.0, "high": 4.0}
    assert found["k1"] == {"rms": 2.0, "low": 2.0, "high": 2.0}
    assert results.summary([None], [1.0] * 5) == {"scenes": 1, "answered": 0}
    assert not experiments["plots"].is_shown(found)
    assert experiments["plots"].is_shown({"scenes": 10, "answered": 9})


def test_intervals_hold_the_truth(experiments):
    """The bootstrap's interval of an rms, over draws with a known rms."""
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(200):
        found = experiments["results"].rms_of_scenes(rng.standard_normal(100) ** 2)
        held += found["low"] < 1.0 < found["high"]
    assert 180 <= held < 200


def test_a_refusal_is_no_error(experiments):
    import trisquare as ts

    estimators = experiments["estimators"]
    truth = experiments["run"].sweeps.true_camera(np.random.default_rng(0), 60.4)

    def refuse():
        raise ts.DegenerateGeometryError("parallel")

    assert estimators.error_of(refuse, truth) is None
    given = estimators.error_of(
        lambda: (truth.K + np.diag([1.0, 2.0, 0.0]), truth.distortion), truth
    )
    assert given == pytest.approx([1.0, 2.0, 0.0, 0.0, 0.0])


def test_unknown_options_are_refused(experiments, capsys):
    with pytest.raises(SystemExit) as ended:
        experiments["run"].main(["--fast"])
    assert ended.value.code == 2
    assert "--fast" in capsys.readouterr().err


@pytest.mark.slow
def test_a_quick_run_writes_page_plots_and_numbers(tmp_path, experiments):
    subprocess.run(
        [sys.executable, "-m", "experiments.run", "--quick", "--into", str(tmp_path)],
        cwd=CHECKOUT / "benchmarks",
        env={**os.environ, "PYTHONPATH": "."},
        check=True,
        stdout=subprocess.DEVNULL,
    )
    found = json.loads((tmp_path / "experiments" / "results.json").read_text("utf-8"))
    assert (tmp_path / "experiments.md").read_text("utf-8") == experiments["page"].text(found)
    committed = experiments["results"].read()
    assert found.keys() == committed.keys()
    assert found["sweeps"].keys() == committed["sweeps"].keys()
    written = {path.name for path in (tmp_path / "experiments").glob("*.svg")}
    shown = {f"{name}.svg" for name in experiments["plots"].drawn(found)}
    assert written == shown | ({"gallery.svg"} if found["gallery"] else set())
    # Two scenes of the usual kind, from edge points with a noise of 0.01 px.
    usual = found["sweeps"]["noise"][0]["edges"]
    assert usual["answered"] == usual["scenes"] == 2
    assert 0.0 < experiments["page"].pixel_rms(usual) < 1.0
