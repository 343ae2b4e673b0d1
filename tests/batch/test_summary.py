"""The summary of a fleet: spread, outliers, photographs to take again, tables, page."""

import csv
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from batches import record_of

import trisquare as ts
from trisquare.batch.fleet import Distribution, Fleet, most_by_chance, verdict
from trisquare.batch.page import MAX_SHOWN, summary_page
from trisquare.batch.requirements import Requirement, WarningRequirement
from trisquare.batch.summary import columns, rows, write_csv, write_parquet

CHECKOUT = Path(__file__).parents[2]
STD = 0.5


def camera(name, fx=1000.0, std=STD, **more):
    job = ts.Job(name, (f"{name}.png",))
    values = {"fx": fx, "k1": -0.1, "k2": 0.0}
    return record_of(job, values=values, std={"fx": std, "k1": 0.001}, **more)


def failed(name, code="DetectionError", text="nothing found"):
    return {
        "name": name,
        "status": "failed",
        "photographs": [f"{name}.png"],
        "error": {"code": code, "text": text},
    }


def fleet_of(count, spread, seed=0, std=STD):
    rng = np.random.default_rng(seed)
    values = 1000.0 + rng.normal(0.0, np.hypot(spread, std), count)
    return [camera(f"c{number}", fx) for number, fx in enumerate(values.tolist())]


@pytest.mark.parametrize("spread", [0.0, 3.0])
def test_the_spread_is_the_cameras_own(spread):
    """The part explained by the stated uncertainty is removed; a tenth of outliers is tolerated."""
    cameras = fleet_of(4000, spread)
    cameras[::10] = [camera(f"x{number}", 3000.0) for number in range(400)]
    own = Fleet.of(cameras).distributions["radial1, 1280 x 960", "fx"]
    assert len(own.values) == 4000
    assert own.median_std == STD
    assert abs(own.median - 1000.0) < 0.15 * np.hypot(spread, STD) + 0.05
    # The median absolute deviation grows by the tenth that is on one side.
    assert own.spread == pytest.approx(spread, rel=0.25, abs=0.35)


def test_outliers_are_those_beyond_spread_and_own_uncertainty():
    cameras = [*fleet_of(200, 2.0), camera("far", 1012.0), camera("vague", 1012.0, 5.0)]
    fleet = Fleet.of(cameras)
    told = {own["name"]: fleet.outlying(own) for own in cameras}
    assert told["vague"] == []
    (text,) = told["far"]
    assert text.startswith("fx 1012 is +")
    assert sum(bool(texts) for texts in told.values()) <= 3
    uncertain = {own["name"]: fleet.uncertain(own) for own in cameras}
    assert [name for name, texts in uncertain.items() if texts] == ["vague"]
    assert uncertain["vague"] == ["the std of fx is 5, but the median is 0.5"]


def test_the_docs_name_all_columns_of_the_table():
    described = (CHECKOUT / "docs" / "batch.md").read_text("utf-8")
    shown = columns(Fleet.of(fleet_of(10, 0.0)))
    parameters = [name for name in shown if name.removeprefix("std_") in ("fx", "k1")]
    assert parameters == ["fx", "std_fx", "k1", "std_k1"]
    for name in sorted({*shown} - {"k1", "std_k1"}):
        assert re.search(rf"^\|.*`{name}`.* \|$", described, re.MULTILINE), name


def test_few_cameras_have_no_outliers():
    cameras = [camera(f"c{number}") for number in range(6)] + [camera("far", 2000.0)]
    assert not any(Fleet.of(cameras).outlying(own) for own in cameras)


def test_cameras_of_other_kinds_are_not_compared():
    wide = [
        camera(f"w{number}", 500.0 + number, image_size=[640, 480], model="brown")
        for number in range(10)
    ]
    cameras = fleet_of(10, 1.0) + wide
    fleet = Fleet.of(cameras)
    assert {kind for kind, _ in fleet.distributions} == {"radial1, 1280 x 960", "brown, 640 x 480"}
    assert not any(fleet.outlying(own) for own in wide)


def test_cameras_that_are_alike_have_no_spread():
    own = Distribution.of("", "fx", np.full(20, 7.0), np.zeros(20))
    assert own.spread == 0.0
    assert own.deviation(7.0, 0.0) == own.deviation(8.0, 0.0) == 0.0
    assert own.deviation(8.0, 0.5) == 2.0


TOGETHER = (
    "too few targets: show three squares tilted in different directions, or group the photographs "
    "of each camera"
)


@pytest.mark.parametrize(
    ("record", "status", "retake"),
    [
        (camera("a"), "passed", None),
        (camera("a", 1020.0), "beyond limits", None),
        (failed("a"), "failed", "no target was found"),
        (failed("a", "NotEnoughPlanesError"), "failed", TOGETHER),
        (failed("a", "ValueError", "unknown option"), "failed", None),
        (
            camera("a", warnings=[{"code": "x", "severity": "high", "text": "blurred"}]),
            "passed",
            "blurred",
        ),
        (
            camera("a", warnings=[{"code": "x", "severity": "low", "text": "grey"}]),
            "passed",
            None,
        ),
    ],
)
def test_verdicts(record, status, retake):
    found = verdict(record, Fleet.of([record]), [Requirement("fx", 990.0, 1010.0)])
    assert found.status == status
    assert bool(found.violations) == (status == "beyond limits")
    assert bool(found.failure) == (status == "failed")
    if retake is None:
        assert not found.retake
    else:
        (text,) = found.retake
        assert text.startswith(retake)


@pytest.mark.parametrize("text", ["the planes are parallel: tilt", "the distortion turns back"])
def test_what_degenerates_is_left_to_the_error_to_say(text):
    """One class of error has several causes, and advice on one is wrong for the others."""
    record = failed("a", "DegenerateGeometryError", text)
    (retake,) = verdict(record, Fleet.of([record]), []).retake
    cure = "the photographs do not determine the camera"
    assert retake == f"{cure} (DegenerateGeometryError: {text})"


CAMERAS = [*fleet_of(20, 1.0), camera("far", 1100.0), failed("<b>bad</b>"), failed("o\udcff")]
LIMITS = [Requirement("fx", None, 1050.0)]


def test_the_table_holds_every_number(tmp_path):
    fleet = Fleet.of(CAMERAS)
    shown = columns(fleet)
    counts = write_csv(tmp_path / "summary.csv", rows(CAMERAS, fleet, LIMITS), shown)
    assert (counts.total, counts.passed, counts.beyond_limits, counts.failed) == (23, 20, 1, 2)
    assert (counts.retake, counts.outlying, counts.all_passed) == (2, 1, False)
    with (tmp_path / "summary.csv").open(newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    assert [own["name"] for own in read][-3:] == ["far", "<b>bad</b>", "o\\udcff"]
    for own, record in zip(read, CAMERAS, strict=True):
        assert own["photographs"].startswith(record["photographs"][0][:1])
        if record["status"] == "done":
            assert float(own["fx"]) == record["values"]["fx"]
            assert float(own["std_fx"]) == record["std"]["fx"]
            assert "k2" not in own  # not estimated for any camera
    assert read[-3]["status"] == "beyond limits"
    assert read[-3]["beyond_limits"] == "fx 1100 is above 1050"
    assert read[-2]["error"] == "DetectionError"
    assert {own["limits"] for own in read} == {"fx <= 1050"}
    assert {own["format"] for own in read} == {"trisquare-batch-table/1"}
    write_parquet(tmp_path / "summary.parquet", rows(CAMERAS, fleet, LIMITS), shown)
    table = pyarrow.parquet.read_table(tmp_path / "summary.parquet").to_pylist()
    assert list(table[0]) == shown
    assert [own["name"] for own in table] == [own["name"] for own in read]
    assert [own["fx"] for own in table[:21]] == [own["values"]["fx"] for own in CAMERAS[:21]]
    assert table[-1]["fx"] is None
    assert table[0]["photographs"] == ["c0.png"]


def test_no_text_of_the_table_is_a_formula(tmp_path):
    path = tmp_path / "summary.csv"
    for start in "=+-@\t\r":
        name = f"{start}cmd()"
        row = {"name": name, "status": "passed", "photographs": [f"{name}.jpg"], "fx": -1.5}
        write_csv(path, [row], list(row))
        written = path.read_bytes().decode().replace('"', "")  # some versions quote a return
        assert written.endswith(f"\n'{name},passed,'{name}.jpg,-1.5\n")


def test_a_table_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "summary.csv"
    path.write_text("old")

    def broken():
        yield from rows(CAMERAS[:1], Fleet(), [])
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match=r"summary\.csv: cannot be written: No space"):
        write_csv(path, broken(), ["name"])
    assert path.read_text() == "old"
    assert [own.name for own in tmp_path.iterdir()] == ["summary.csv"]


def test_the_page_says_what_matters():
    fleet = Fleet.of(CAMERAS)
    counts = count(CAMERAS, fleet)
    page = summary_page(rows(CAMERAS, fleet, LIMITS), fleet, counts, LIMITS).decode()
    assert "Calibration of 23 cameras" in page
    assert "20 passed, 1 beyond the limits, 2 failed." in " ".join(page.split())
    assert "&lt;b&gt;bad&lt;/b&gt;" in page
    assert "<b>bad" not in page
    assert "no target was found" in page
    assert "fx 1100 is above 1050" in page
    assert page.count("<svg") == 2  # fx and k1
    assert "<script" not in page
    assert "http" not in page.replace("http-equiv", "")
    again = summary_page(rows(CAMERAS, fleet, LIMITS), fleet, counts, LIMITS)
    assert again.decode() == page


def count(cameras, fleet):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        return write_csv(f"{folder}/x.csv", rows(cameras, fleet, LIMITS), ["name"])


def test_the_page_has_the_limits_and_those_that_passed_with_a_high_warning():
    warnings = [
        {"code": "x", "severity": severity, "text": "blurred"} for severity in ("low", "high")
    ]
    cameras = [camera("a"), camera("b", warnings=warnings), camera("c", 2000.0, warnings=warnings)]
    fleet = Fleet.of(cameras)
    limits = [*LIMITS, Requirement("std.fx", None, 0.5, " %"), WarningRequirement("high")]
    page = summary_page(rows(cameras, fleet, limits), fleet, count(cameras, fleet), limits)
    text = " ".join(page.decode().split())
    assert "2 passed (1 with a warning of high severity), 1 beyond the limits" in text
    assert '<td class="number">0.5 %</td>' in text
    assert '<td class="number">high</td>' in text
    assert [own.get("severity") for own in rows(cameras, fleet, limits)] == ["", "high", "high"]


def test_the_page_of_a_thousand_failures_can_be_opened():
    cameras = [failed(f"c{number}") for number in range(1000)]
    fleet = Fleet.of(cameras)
    page = summary_page(rows(cameras, fleet, []), fleet, count(cameras, fleet), []).decode()
    assert page.count("<tr>") == MAX_SHOWN + 1
    assert f"{1000 - MAX_SHOWN} more are in summary.csv" in page


def test_the_page_tells_mistakes_apart_from_photographs_to_take_again():
    cameras = [failed("gloomy"), failed("typed", "ValueError", "unknown option")]
    fleet = Fleet.of(cameras)
    page = summary_page(rows(cameras, fleet, []), fleet, count(cameras, fleet), []).decode()
    mistakes, again = page.split("Photographs to take again")
    assert "Photographs of 1 should be taken again" in page
    assert ("typed" in mistakes, "typed" in again, "gloomy" in mistakes) == (True, False, False)


@pytest.mark.parametrize(("cameras", "stated"), [(10, 7.7), (100, 4.4), (1000, 4.5)])
def test_one_fleet_in_twenty_without_an_odd_camera_has_one_by_chance(cameras, stated):
    """As stated in docs/batch.md, for six normally distributed parameters."""
    rng = np.random.default_rng(5)
    allowed = most_by_chance(cameras, 6)
    assert allowed == pytest.approx(stated, abs=0.05)

    def has_one():
        fleets = [
            Distribution.of("kind", "fx", rng.normal(size=cameras), np.full(cameras, 0.1))
            for _ in range(6)
        ]
        return any(
            abs(own.deviation(value, 0.1)) > allowed for own in fleets for value in own.values
        )

    part = np.mean([has_one() for _ in range(400)])
    print(f"{cameras} cameras: {100 * part:.0f} %")
    assert 0.01 < part < 0.09


@pytest.mark.parametrize("spread", [0.0, 0.5, 1.0, 5.0])
@pytest.mark.parametrize("cameras", [13, 100])
def test_a_camera_that_is_known_better_than_others_is_not_odd_for_it(cameras, spread):
    """Where cameras differ by less than most stds, their spread may be estimated as zero."""
    rng = np.random.default_rng(7)
    allowed = most_by_chance(cameras, 6)

    def has_one():
        for _ in range(6):
            stds = np.exp(rng.normal(0.0, 1.0, cameras))
            values = rng.normal(size=cameras) * np.hypot(spread, stds)
            own = Distribution.of("kind", "fx", values, stds)
            if any(abs(own.deviation(*one)) > allowed for one in zip(values, stds, strict=True)):
                return True
        return False

    assert np.mean([has_one() for _ in range(100)]) < 0.1
