"""`trisquare target --check`: lines, JSON, exit codes and refusals."""

import dataclasses
import json
from importlib import resources

import cv2
import numpy as np
import pytest
from command_errors import error_text

import trisquare as ts
from trisquare import simulate
from trisquare.analysis import sheet_check
from trisquare.cli import target_check
from trisquare_scenes.spoilt_corner import folded_off

(PAGE,) = ts.printed_target("corner").pages


@pytest.fixture(scope="module")
def photographs():
    """A good sheet; one folded to 80 degrees; one with two hidden faces; none."""
    rng = np.random.default_rng(9301)
    scene = simulate.corner_scene(rng, page=PAGE)
    wrong = folded_off(scene, PAGE, 1, 10.0)
    shown = {name: simulate.render(it, rng) for name, it in (("good", scene), ("folded", wrong))}
    shown["hidden"] = shown["good"].copy()
    for face in (1, 2):
        corners = scene.image_points(face, scene.targets[face].outlines()[0])
        (x, y), radius = cv2.minEnclosingCircle(corners.astype(np.float32))
        cv2.circle(shown["hidden"], (round(x), round(y)), round(0.7 * radius), 90, -1)
    shown["none"] = np.clip(128 + 20 * rng.standard_normal((480, 640)), 0, 255).astype(np.uint8)
    return {name: cv2.imencode(".png", it)[1].tobytes() for name, it in shown.items()}


@pytest.fixture(scope="module")
def calibrated():
    """Calibrate as the command does, but only once for each of `photographs`."""
    known = {}

    def calibrate(photo, **options):
        if photo.name not in known:
            known[photo.name] = ts.calibrate(photo, **options)
        return known[photo.name]

    return calibrate


@pytest.fixture
def folder(tmp_path, monkeypatch, photographs, calibrated):
    for name, content in photographs.items():
        (tmp_path / f"{name}.png").write_bytes(content)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(target_check, "calibrate", calibrated)
    return tmp_path


def test_a_good_sheet(run, folder):
    before = sorted(folder.iterdir())
    code, out, err = run("target", "--check", "good.png", "--ruler", "9.95cm")
    assert (code, err) == (0, "")
    first, *findings, last = out.splitlines()
    assert first.startswith("corner, side 84 mm; face 0 around (")
    assert [line.split()[:2] for line in findings] == [
        *[["folded", "ok"]] * 3,
        *[["flat", "ok"]] * 3,
        ["stretched", "ok"],
        ["size", "ok"],
    ]
    assert "83.580 +- 0.084 mm" in findings[-1]
    assert last == "the sheet: ok"
    assert sorted(folder.iterdir()) == before  # no PDF is written
    assert run("target", "--check", "good.png")[1].endswith("ok, but not all could be checked\n")


def test_a_sheet_of_which_nothing_is_told_is_not_ok(run, folder, monkeypatch):
    """No finding is certain at this number of standard deviations."""
    monkeypatch.setattr(sheet_check, "VERDICT_STDS", 1e9)
    code, out, _ = run("target", "--check", "good.png")
    assert code == 0
    assert out.count("cannot tell  ") == 8
    assert out.endswith("the sheet: cannot tell\n")


def test_a_sheet_is_not_called_ok_beside_a_high_warning(run, folder, monkeypatch, calibrated):
    doubt = ts.CalibrationWarning("the targets are not flat", "planes_contradict", "high")

    def doubted(photo, **settings):
        found = calibrated(photo, **settings)
        return dataclasses.replace(found, warnings=(doubt, *found.warnings))

    monkeypatch.setattr(target_check, "calibrate", doubted)
    code, out, err = run("target", "--check", "good.png")
    assert (code, out.endswith("the sheet: cannot tell\n")) == (0, True)
    assert "planes_contradict" in err


def test_a_sheet_that_is_folded_wrongly(run, folder):
    code, out, err = run("target", "--check", "folded.png")
    assert code == 6
    # The face that leans inward hides part of another's frame, as the calibration's warning says.
    assert all(line.startswith("warning (") for line in err.splitlines())
    (wrong,) = (line for line in out.splitlines() if line.split()[1:3] == ["not", "ok"])
    assert "meet at 80.0" in wrong or "meet at 79.9" in wrong
    assert wrong.lstrip().startswith("folded")
    assert "fold along the dashed lines" in wrong
    assert "measure the printed ruler" in out
    assert out.endswith("the sheet: not ok\n")
    assert run("target", "--check", "folded.png", "-q") == (6, "", "")


def test_flat_sheets_that_are_taken_for_the_corner(run, tmp_path):
    demo = tmp_path / "demo.png"
    demo.write_bytes((resources.files("trisquare") / "data" / "demo.png").read_bytes())
    code, out, _ = run("target", "--check", demo)
    assert (code, out.count("For the three flat sheets give --kind flat")) == (6, 3)
    assert "folded" not in run("target", "--check", demo, "--kind", "flat")[1]


def test_json_tells_the_same(run, folder):
    code, out, err = run("target", "--check", "folded.png", "--json")
    assert (code, err) == (6, "")
    members = json.loads(out)
    assert members["format"] == "trisquare-target-check/1"
    assert (members["verdict"], members["kind"], members["page"]) == ("not ok", "corner", "A4")
    assert (members["side_mm"], members["true_side_mm"]) == (84.0, None)
    assert [face["plane"] for face in members["faces"]] == [0, 1, 2]
    (wrong,) = (own for own in members["findings"] if own["verdict"] == "not ok")
    assert (wrong["check"], wrong["unit"], wrong["limit"]) == ("folded", "degrees", 2.0)
    assert wrong["value"] == pytest.approx(80.0, abs=5 * wrong["std"])
    assert wrong["text"]
    assert wrong["advice"]
    assert {own["code"] for own in members["warnings"]} == {"side_rejected", "side_partly_hidden"}
    code, out, _ = run("target", "--check", "good.png", "--json", "--page", "letter")
    assert (code, json.loads(out)["side_mm"], json.loads(out)["verdict"]) == (0, 87, "cannot tell")


@pytest.mark.parametrize(
    ("arguments", "exit_code", "words"),
    [
        (
            ("--check", "hidden.png"),
            3,
            "all three figures of the sheet must be",
        ),
        (("--check", "none.png"), 3, "no square"),
        (("--check", "good.png", "--kind", "boards"), 3, "3 chessboards"),
        (("--check", "missing.png"), 5, "missing.png"),
        (("--check", "good.png", "-o", "target.pdf"), 2, "--output"),
        (("--check", "good.png", "--page", "A9"), 2, "A4, A3, Letter"),
        (("--check", "good.png", "--kind", "cube"), 2, "kind"),
        (("--check", "good.png", "--side", "300"), 2, "too small"),
        (("--check", "good.png", "--ruler", "99.5"), 2, "unit"),
        (("--check", "good.png", "--ruler", "-1mm"), 2, "length"),
        (("--ruler", "99.5mm"), 2, "--check"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
@pytest.mark.parametrize("as_json", [False, True])
def test_what_cannot_be_checked_is_refused(run, folder, arguments, exit_code, words, as_json):
    before = sorted(folder.iterdir())
    code, out, err = run("target", *arguments, *(["--json"] if as_json else []))
    assert (code, out) == (exit_code, ""), err
    assert words in error_text(err, as_json=as_json)
    assert sorted(folder.iterdir()) == before
