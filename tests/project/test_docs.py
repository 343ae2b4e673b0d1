"""The documentation shows what works."""

import json
import re
import subprocess
import sys
from importlib import resources
from itertools import combinations
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from shown import CHECKOUT, DOCS, PAGES, assert_same_text, blocks, page, run_line, run_page

import trisquare as ts
from trisquare import simulate
from trisquare.camera.lens_models import COEFFICIENTS
from trisquare.cli.app import main
from trisquare.detection.annotations.formats import annotated_pictures
from trisquare.detection.sheets.layout import parse_layout
from trisquare.formats.registry import FORMATS

LONG = ("batch.md", "report.md", "start.md")
"""Pages whose commands take seconds."""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Make the files of a reader: two photographs of one camera, a video, a calibration.

    Also the limits for production from the page on batches.
    """
    folder = tmp_path_factory.mktemp("given")
    demo = (resources.files("trisquare") / "data" / "demo.png").read_bytes()
    photo = cv2.imdecode(np.frombuffer(demo, np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(folder / "photo.jpg"), photo, [cv2.IMWRITE_JPEG_QUALITY, 95])
    found = ts.calibrate(folder / "photo.jpg")
    (folder / "camera.json").write_text(found.to_json())
    (limits,) = [content for _, content in blocks(page("batch.md"), "toml")]
    (folder / "limits.toml").write_text(limits)
    lens = found.camera
    camera = simulate.TrueCamera(
        lens.fx, lens.fy, lens.cx, lens.cy, lens.distortion, lens.image_size
    )
    rng = np.random.default_rng(5)
    later = simulate.render(simulate.random_scene(rng, camera=camera, kind="frame"), rng)
    cv2.imwrite(str(folder / "later.jpg"), later, [cv2.IMWRITE_JPEG_QUALITY, 95])
    corner = simulate.render(simulate.corner_scene(rng), rng)
    cv2.imwrite(str(folder / "corner.jpg"), corner, [cv2.IMWRITE_JPEG_QUALITY, 95])
    fourcc = cv2.VideoWriter.fourcc(*"mp4v")
    video = cv2.VideoWriter(str(folder / "video.mp4"), fourcc, 25.0, lens.image_size)
    for _ in range(3):
        video.write(photo)
    video.release()
    return folder


@pytest.fixture
def folder(given, tmp_path, monkeypatch):
    """Work in a copy of the reader's files."""
    for path in given.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in LONG else ())
        for name in PAGES
        if name != "tutorial.md"
    ],
)
def test_what_a_page_shows_runs(name, folder, capsys):
    names = run_page(name, capsys)
    if name == "batch.md":  # its two nights are of one camera
        assert (names["changed"], names["found"].same) == ([], True)


def test_a_text_that_differs_is_told():
    assert_same_text("fx  902.424\n──\n", "fx 902.425")
    for other in ("fx 902.426", "fy 902.424", "fx 902.424 px"):
        with pytest.raises(AssertionError):
            assert_same_text("fx 902.424", other)


@pytest.mark.slow
def test_the_tutorial_leads_to_a_straight_video(folder, capsys):
    names = run_page("tutorial.md", capsys)
    assert (folder / "target.pdf").read_bytes().startswith(b"%PDF")
    video, straight = (
        cv2.VideoCapture(str(folder / f"{name}.mp4")) for name in ("video", "straight")
    )
    frames = 0
    while (seen := video.read())[0]:
        expected = names["undistorter"].undistort(seen[1])
        there_is_one, frame = straight.read()
        assert there_is_one
        # The video is compressed; the distorted frame differs from it by more than ten levels.
        assert np.abs(frame.astype(float) - expected).mean() < 3
        frames += 1
    assert frames == 12
    assert not straight.read()[0]
    # Points of straight.png are at the squares found in it: resampling costs 0.2 px at a corner.
    located = ts.locate("straight.png", names["pinhole"])
    off = np.linalg.norm(names["straight_corners"] - [it.corners for it in located], axis=2)
    assert off.max(axis=1).min() < 0.5
    # Both photographs are by one camera.
    assert ts.compare(names["result"], names["later"]).same


@pytest.mark.slow
def test_the_python_of_the_tutorial_needs_none_of_its_commands(folder, capsys):
    assert "later" in run_page("tutorial.md", capsys, ["python"])


def test_the_outlines_calibrate(folder):
    outlines, several = [
        json.loads(content)
        for _, content in blocks(page("formats.md"), "json")
        if "outlines" in content
    ]
    front, second = annotated_pictures(several)
    assert (front.name, len(front.targets), second.index) == ("front.jpg", 2, 1)
    drawn = ts.calibrate("photo.jpg", outlines=outlines)
    assert drawn.camera.fx == pytest.approx(902.4, abs=1)


def test_the_outlines_of_the_photograph_calibrate_it(folder):
    text = page("targets.md")
    ((_, outlines),) = blocks(text, "json")
    Path("squares.json").write_text(outlines)
    (command,) = re.findall(r"`(trisquare calibrate .* --outline squares\.json)`", text)
    run_line(f"{command} -o outlined.json")
    assert ts.Calibration.load("outlined.json").camera.fx == pytest.approx(902.4, abs=1)
    corners = [np.array(square["corners"]) for square in json.loads(outlines)["squares"]]
    found = [plane.corners for plane in ts.Calibration.load("camera.json").planes]
    off = np.linalg.norm(np.subtract(corners, found), axis=2)
    assert 2 < off.max() <= 5  # as stated on the page


def test_the_camera_is_read(folder):
    texts = [text for _, text in blocks(page("formats.md"), "json") if "trisquare-camera" in text]
    (text,) = texts
    Path("own.json").write_text(text)
    assert ts.Camera.load("own.json").model == "radial2"


def test_the_plan_is_predicted(folder):
    (plan,) = [content for _, content in blocks(page("formats.md"), "json") if "plan" in content]
    Path("plan.json").write_text(plan)
    run_line("trisquare predict plan.json")


def test_both_manifests_name_the_same_cameras(folder):
    (lines,) = [content for _, content in blocks(page("batch.md"), "json")]
    (table,) = [text for _, text in blocks(page("batch.md"), "text") if "photographs" in text]
    for name, text in (("cameras.jsonl", lines), ("cameras.csv", table)):
        Path(name).write_text(text)
        left, right = ts.find_jobs([name])
        assert (left.name, right.name) == ("left", "right")
        assert [Path(photo).name for photo in left.photographs] == ["l1.jpg", "l2.jpg"]
        assert left.options["model"] == "brown"
        assert left.fault is None


def test_the_layout_is_read(folder):
    (text,) = [content for _, content in blocks(page("formats.md"), "json") if "sheets" in content]
    Path("layout.json").write_text(text)
    parse_layout("layout.json")


@pytest.mark.parametrize("name", ["rust.md", "start.md"])
def test_the_rust_lines_are_those_that_are_compiled(name):
    crate = (CHECKOUT / "rust" / "trisquare" / "README.md").read_text("utf-8")
    assert blocks(page(name), "rust") == blocks(crate, "rust") != []


def test_the_reference_has_every_public_name_once():
    pages = [path.read_text("utf-8") for path in sorted((DOCS / "api").glob("*.rst"))]
    named = [
        name
        for text in pages
        for name in re.findall(r"^\.\. auto(?:function|class|exception):: (\w+)$", text, re.M)
    ]
    assert sorted(named) == sorted(set(ts.__all__) - {"__version__"})


@pytest.mark.parametrize(
    ("name", "count"), [("README.md", 5), ("how-exact.md", 3), ("target.md", 16)]
)
def test_the_numbers_are_those_that_were_measured(name, count):
    sections = dict(
        re.findall(r"<!-- benchmark: (\S+) -->\n(.*?)(?=<!--|\Z)", page("measured.md"), re.DOTALL)
    )
    rows = re.findall(r"^\| .* \| (.+) \| `([\w.]+)` \|$", page(name), re.MULTILINE)
    assert len(rows) == count
    for number, benchmark in rows:
        cells = re.findall(r"^\| [^|]+ \| ([^|]+) \|", sections[benchmark], re.MULTILINE)
        assert any(re.match(rf"{re.escape(number)}(?![\d.])", cell) for cell in cells), number


PHOTOGRAPHS = CHECKOUT.parent / "shared" / "data"
ALL_PAIRS = {"orthogonal": [(0, 1), (0, 2), (1, 2)]}


@pytest.mark.slow
@pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason="needs the photographs")
@pytest.mark.parametrize(
    ("row", "photographs", "options"),
    [
        ("wooden corner of three boards, left", "ortho-corner/left_calib.jpg", {}),
        ("wooden corner of three boards, right", "ortho-corner/right_calib.jpg", {}),
        ("left, `--orthogonal` of all three pairs", "ortho-corner/left_calib.jpg", ALL_PAIRS),
        ("right, `--orthogonal` of all three pairs", "ortho-corner/right_calib.jpg", ALL_PAIRS),
        ("13 of a chessboard", "opencv-chess", {}),
    ],
)
def test_the_numbers_of_photographs_are_those_of_today(row, photographs, options):
    (shown,) = re.findall(
        rf"^\| {re.escape(row)}.* \| fx ([\d.]+) \+- ([\d.]+) \|$",
        page("how-exact.md"),
        re.MULTILINE,
    )
    found = ts.calibrate(PHOTOGRAPHS / photographs, **options)
    decimals = len(shown[0].partition(".")[2])
    assert shown == (f"{found.camera.fx:.{decimals}f}", f"{found.std['fx']:.{decimals}f}")
    if "corner" in row:
        off = [
            abs(90.0 - ts.plane_angle(one, other, found).degrees)
            for one, other in combinations(found.planes, 2)
        ]
        (said,) = re.findall(
            r"planes of the corner are at right angles to within ([\d.]+)", page("how-exact.md")
        )
        assert max(off) < float(said) + 0.05


def table_rows(text, heading):
    """The cells of the table with the given heading, without the heading."""
    (table,) = re.findall(rf"^\| {re.escape(heading)}.*\n\|[ -|]*\n((?:\|.*\n)+)", text, re.M)
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in table.splitlines()]


LENSES = {
    "none, k1": ("radial1", {"k1": -0.1}),
    "k2": ("radial2", {"k1": -0.1, "k2": 0.02}),
    "k3": ("radial3", {"k1": -0.1, "k2": 0.02, "k3": 0.003}),
    "p1, p2": ("brown", {"k1": -0.1, "p1": 0.001, "p2": 0.002}),
    "fisheyes": ("fisheye", {"k1": -0.1, "k2": 0.02, "k3": 0.003, "k4": 0.001}),
    "rational": ("rational", {"k1": -0.1, "k4": 0.001, "k6": 0.001}),
    "prisms": ("thin_prism", {"k1": -0.1, "k4": 0.001, "s1": 0.001, "s4": 0.001}),
    "`fx` ≠ `fy`": ("none", {}),
    "skew": ("none", {}),
}
"""A camera for each column of the table of lenses: its model and its nonzero coefficients."""


def camera_of_column(column):
    model, named = LENSES[column]
    fy = 905.0 if "fy" in column else 900.0
    skew = 1.5 if column == "skew" else 0.0
    K = np.array([[900.0, skew, 641.3], [0.0, fy, 477.7], [0.0, 0.0, 1.0]])
    distortion = [named.get(name, 0.0) for name in COEFFICIENTS[model]]
    return ts.Camera(K, distortion, (1280, 960), model)


def test_the_table_of_formats_is_that_of_the_code():
    text = page("formats.md")
    rows = {row[1].strip("`"): row for row in table_rows(text, "format | `--from`")}
    assert set(rows) == set(ts.formats.FORMAT_NAMES)
    for known in FORMATS:
        title, _, endings, origin, _ = rows[known.name]
        assert tuple(ending.strip("`") for ending in endings.split(", ")) == known.file_names
        assert (origin == "corner") == (known.name in ("colmap", "nerfstudio"))
        name, anchor = re.fullmatch(r"\[(.*)\]\(#(.*)\)", title).groups()
        assert name.lower() == anchor
        assert f"\n### {name}\n" in text


def test_the_table_of_lenses_is_what_the_formats_hold(tmp_path):
    text = page("formats.md")
    (heading,) = re.findall(r"^\| format \| none.*", text, re.M)
    columns = [cell.strip() for cell in heading.strip("|").split(" | ")][1:]
    assert columns == list(LENSES)
    rows = table_rows(text, "format | none")
    assert len(rows) == len(FORMATS)
    for title, *cells in rows:
        name = title.lower()
        path = tmp_path / name
        for column, cell in zip(columns, cells, strict=True):
            camera = camera_of_column(column)
            try:
                camera.save(path, name)
            except ts.LensModelError:
                assert cell == "no", (title, column)
                continue
            assert cell == "yes", (title, column)
            size = camera.image_size if name == "lensfun" else None
            read = ts.Camera.load(path, name, image_size=size)
            np.testing.assert_allclose(read.K, camera.K, rtol=1e-13)
            np.testing.assert_allclose(read.distortion, camera.distortion, rtol=1e-13)
            assert read.model == camera.model or not any(camera.distortion)


def test_the_modules_of_all_formats_are_in_the_reference():
    reference = page("api/file-formats.rst")
    for name in ts.formats.FORMAT_NAMES:
        module = "native_json" if name == "trisquare" else name
        assert f"automodule:: trisquare.formats.{module}\n" in reference


def test_what_is_read_needs_no_build():
    """A page on a forge does not show what Sphinx inserts from a module."""
    for path in DOCS.glob("*.md"):
        assert "automodule" not in path.read_text("utf-8"), path


def test_every_option_of_every_command_is_described(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(DOCS / "_extensions"))
    from commands_page import commands_page

    described = commands_page()
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", described, re.DOTALL | re.MULTILINE))
    shown = {path.stem for path in Path(ts.__file__).parent.glob("cli/*.py")}
    assert {"calibrate", "convert", "measure"} <= set(sections) <= shown
    for name, section in sections.items():
        with pytest.raises(SystemExit):
            main([name, "--help"])
        options = set(re.findall(r"--[a-z][a-z-]+", capsys.readouterr().out))
        assert len(options) > 1
        assert options <= set(re.findall(r"--[a-z][a-z-]+", section)), name


@pytest.fixture
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(str(CHECKOUT / "benchmarks"))
    import run
    from harness import results_page

    yield results_page, run.BENCHMARKS
    for name in ("results_page", "results_file", "rows"):
        sys.modules.pop(f"harness.{name}", None)
    for name in ("harness", "run"):
        sys.modules.pop(name, None)


def test_the_measured_rows_are_of_benchmarks_that_there_are(benchmarks):
    results_page, names = benchmarks
    measured = list(results_page.read())
    assert measured == [name for name in names if name in measured] != []


def test_a_benchmark_replaces_its_own_rows_and_no_others(benchmarks, tmp_path):
    from harness.rows import Row

    results_page, _ = benchmarks
    path = tmp_path / "measured.md"
    order = ("accuracy.exactness", "finding.tags", "accuracy.tone")
    exactness, tags, tone = order
    for name, value in ((tone, "1"), (exactness, "2"), (tags, "3"), (exactness, "4")):
        results_page.update(name, [Row("error", value, "5", True)], order, "today", path)
    sections = results_page.read(path)
    assert list(sections) == list(order)
    for name, value in ((exactness, "4"), (tags, "3"), (tone, "1")):
        assert f"| error | {value} | 5 | yes |\n" in sections[name]
        assert sections[name].endswith(f"*`benchmarks/{name.replace('.', '/')}.py`, today*\n")
    results_page.update(tone, [], order[1:], "today", path)
    assert list(results_page.read(path)) == [tags, tone]
    assert f"trisquare {ts.__version__}" in results_page.conditions()


def test_a_benchmark_that_cannot_be_measured_keeps_its_rows(benchmarks, monkeypatch, capsys):
    import run
    from harness import results_file, rows

    results_page, _ = benchmarks
    name = "real.printed_edges"
    module = ModuleType(name, "Printed edges.")

    def measure():
        raise rows.NotMeasurableError("no data")

    module.measure = measure
    for variable in run.THREAD_LIMITS:
        monkeypatch.setenv(variable, "1")  # restored afterwards
    monkeypatch.setitem(sys.modules, name, module)
    files = (results_page.PAGE, results_file.FILE)
    before = [file.read_bytes() for file in files]
    assert run.main(["printed_edges"]) == run.main([name]) == 1
    assert [file.read_bytes() for file in files] == before
    said = capsys.readouterr()
    assert f"{name} cannot be measured here, its rows are kept: no data" in said.err
    assert "| measurement |" not in said.out


@pytest.mark.parametrize(("word", "code"), [("--help", 0), ("printed_edge", 2)])
def test_the_benchmarks_are_named_by_the_help_and_by_errors(benchmarks, capsys, word, code):
    import run

    with pytest.raises(SystemExit) as ended:
        run.main([word])
    assert ended.value.code == code
    said = capsys.readouterr()
    assert "real.printed_edges" in said.out + said.err


def test_the_results_are_those_of_the_page(benchmarks):
    from harness import results_file

    results_page, _ = benchmarks
    records = json.loads(results_file.FILE.read_text(encoding="utf-8"))
    assert {record["benchmark"] for record in records} == set(results_page.read())
    for name, section in results_page.read().items():
        own = [record for record in records if record["benchmark"] == name]
        assert [f"| {record['name']} |" in section for record in own] == [True] * len(own)
        assert section.count("\n| ") - 2 == len(own)


@pytest.mark.parametrize(
    ("measured", "value", "unit"),
    [
        ("2.9e-11", 2.9e-11, ""),
        ("95.2 % (94.6 %)", 95.2, "%"),
        ("22.7 ms / 32.8 ms = 0.69", 0.69, ""),
        ("1/28 (without robust loss: 1/12)", 1 / 28, ""),
        ("16.8 (20.9 ms)", 16.8, ""),
        ("-0.05", -0.05, ""),
        ("+0.02 MB", 0.02, "MB"),
        ("3107 of 3120 (99.6%)", 3107.0, ""),
        ("median 0.0058 %", "median 0.0058 %", ""),
    ],
)
def test_a_row_has_its_number(benchmarks, measured, value, unit):
    from harness.results_file import record
    from harness.rows import Row

    found = record("speed.threads", Row("throughput", measured, ">= 1.6", False), "abc1234")
    assert found == {
        **{"benchmark": "speed.threads", "name": "throughput", "value": value, "unit": unit},
        **{"target": ">= 1.6", "met": False, "commit": "abc1234"},
    }


def test_what_changed_in_the_results_is_told(benchmarks, tmp_path):
    from harness import results_file
    from harness.rows import Row

    order, file = ("speed.threads", "accuracy.tone"), tmp_path / "results.json"

    def write(name, *rows):
        results_file.update(name, [Row(*row) for row in rows], order, "abc", file)

    assert list(results_file.changes(file)) == ["no results.json is committed"]
    time, ratio, gone = (
        ("time", "10.0 ms", "<= 12", True),
        ("ratio", "1.9", "", None),
        ("x", "1", "", None),
    )
    write("accuracy.tone", ("error", "0 px", "0", True))
    write("speed.threads", time, ratio, ratio, gone)
    for words in (("init", "-q"), ("add", "."), ("commit", "-qm", "results")):
        names = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        subprocess.run(["git", *names, *words], cwd=tmp_path, check=True)
    assert list(results_file.changes(file)) == []
    write("speed.threads", ("time", "13.0 ms", "<= 12", False), ratio, ("ratio", "1.95", "", None))
    write("accuracy.tone", ("error", "2 px", "0", True), ("new", "3", "", None))
    assert sorted(results_file.changes(file)) == [
        "accuracy.tone: error: 0.0 -> 2.0 px, 0 met",
        "accuracy.tone: new: new",
        "speed.threads: time: 10.0 -> 13.0 ms (+30 %), <= 12 met -> NOT MET",
        "speed.threads: x: gone",
    ]
