"""Jobs from photographs, folders, patterns and manifests, and their faults."""

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import trisquare as ts
from trisquare.batch.jobs import LONGEST_FILE_NAME, safe_file_name
from trisquare.batch.manifest import MAX_FAULTS, manifest_jobs

HEAD = "name,photographs\n"


def touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


def found(folder, *inputs, **options):
    """Names and photographs of the jobs, relative to the folder, or the fault of a job with one."""
    jobs = ts.find_jobs([folder / own for own in inputs], **options)
    return {
        job.name.replace(f"{folder}{os.sep}", ""): job.fault
        or [Path(own).relative_to(folder).as_posix() for own in job.photographs]
        for job in jobs
    }


def test_a_folder_that_may_not_be_read_is_told(tmp_path, monkeypatch):
    touch(tmp_path, "in/ok/p.jpg", "in/locked/p.jpg")
    scandir = os.scandir

    def some(path):
        if str(path).endswith("locked"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", some)
    assert found(tmp_path, "in") == {"ok": ["in/ok/p.jpg"], "in/locked": "Permission denied"}


@pytest.mark.parametrize("name", ["m.csv", "m.jsonl"])
def test_a_manifest_that_is_not_utf8_is_told_once(tmp_path, name):
    (tmp_path / name).write_bytes("name,photographs\ncaméra,p.jpg\n".encode("latin-1"))
    (fault,) = found(tmp_path, name).values()
    assert "not UTF-8" in fault


def test_a_manifest_may_begin_with_a_byte_order_mark(tmp_path):
    touch(tmp_path, "p.jpg")
    record = json.dumps({"name": "a", "photographs": "p.jpg"})
    (tmp_path / "m.jsonl").write_text(record, encoding="utf-8-sig")
    assert found(tmp_path, "m.jsonl") == {"a": ["p.jpg"]}


def test_cameras_whose_parts_join_to_one_name_stay_two(tmp_path):
    touch(tmp_path, "in/a_b/c_1.jpg", "in/a_b/c_2.jpg", "in/a/b_c_1.jpg", "in/d/e_1.jpg")
    assert found(tmp_path, "in", camera="{site}/{serial}_?.jpg") == {
        "(a_b)_(c)": ["in/a_b/c_1.jpg", "in/a_b/c_2.jpg"],
        "(a)_(b_c)": ["in/a/b_c_1.jpg"],
        "d_e": ["in/d/e_1.jpg"],
    }


def test_photographs_and_folders(tmp_path):
    touch(tmp_path, "in/b.JPG", "in/a.png", "in/notes.txt", "in/._a.png", "in/.hidden/x.png")
    touch(tmp_path, "in/left/2.tif", "in/left/1.tif", "in/site/deep/1.bmp", "alone.webp")
    assert found(tmp_path, "alone.webp", "in") == {
        "alone": ["alone.webp"],
        "a": ["in/a.png"],
        "b": ["in/b.JPG"],
        "left": ["in/left/1.tif", "in/left/2.tif"],
        "site/deep": ["in/site/deep/1.bmp"],
    }
    assert list(found(tmp_path, "in/*.png")) == ["a"]
    assert list(found(tmp_path, "in/**/1.*")) == ["1"]


def test_one_input_needs_no_list(tmp_path):
    touch(tmp_path, "a.png")
    for one in (tmp_path / "a.png", str(tmp_path / "a.png")):
        assert [job.name for job in ts.find_jobs(one)] == ["a"]


def test_videos_in_folders_count_where_frames_are_asked_for(tmp_path):
    touch(tmp_path, "in/clip.MP4", "in/a.png", "in/left/2.avi", "in/left/1.png", "in/notes.txt")
    still = {"a": ["in/a.png"], "left": ["in/left/1.png"]}
    assert found(tmp_path, "in") == still
    assert found(tmp_path, "in", options={"frames": 10}) == {
        "a": ["in/a.png"],
        "clip": ["in/clip.MP4"],
        "left": ["in/left/1.png", "in/left/2.avi"],
    }
    grouped = {"a": ["in/a.png"], "clip": ["in/clip.MP4"]}
    by_name = found(tmp_path, "in", camera="{name}.*", options={"frames": 10})
    assert {name: by_name[name] for name in grouped} == grouped


def test_numbers_in_names_are_numbers(tmp_path):
    touch(tmp_path, *(f"in/c{n}/{n}.png" for n in (10, 9, 1)), "in/c9/11.png", "in/c9/2.png")
    assert list(found(tmp_path, "in/*/*.png")) == ["1", "2", "9", "11", "10"]
    assert list(found(tmp_path, "in").items()) == [
        ("c1", ["in/c1/1.png"]),
        ("c9", ["in/c9/2.png", "in/c9/9.png", "in/c9/11.png"]),
        ("c10", ["in/c10/10.png"]),
    ]


def test_a_folder_without_pictures_is_named_and_the_rest_goes_on(tmp_path):
    touch(tmp_path, "empty/notes.txt", "full/a.png", "clips/b/c.mp4")
    told = found(tmp_path, "empty", "full", "clips")
    assert "--frames" in told.pop("clips")
    assert told == {"empty": "there is no photograph in this folder", "a": ["full/a.png"]}


def test_a_column_of_any_length_is_named_in_short(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text(f"name,photographs,{'mode ' * 20_000}\n")
    with pytest.raises(ValueError, match=r"cameras\.csv: unknown column 'mode mode ") as error:
        list(manifest_jobs(str(path), {}))
    assert len(str(error.value)) < 600


@pytest.mark.parametrize("name", ["missing.png", "missing*.png", "missing/"])
def test_what_is_not_there_is_an_error(tmp_path, name):
    with pytest.raises(FileNotFoundError, match="missing"):
        found(tmp_path, name)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("{serial}_*.jpg", {"A1": ["in/A1_1.jpg", "in/A1_2_x.jpg"], "B(2": ["in/s/B(2_1.jpg"]}),
        ("{a}_{b}.jpg", {"A1_1": ["in/A1_1.jpg"], "A1_2_x": ["in/A1_2_x.jpg"]}),
        ("{camera}/*.jpg", {"s": ["in/s/B(2_1.jpg"]}),
        ("?1_{n}.jpg", {"1": ["in/A1_1.jpg"], "2_x": ["in/A1_2_x.jpg"]}),
    ],
)
def test_cameras_by_a_pattern(tmp_path, pattern, expected):
    touch(tmp_path, "in/A1_1.jpg", "in/A1_2_x.jpg", "in/s/B(2_1.jpg", "in/other.jpg")
    jobs = found(tmp_path, "in", camera=pattern)
    fault = jobs.pop(pattern)
    assert "photographs have names that do not match this pattern" in fault
    assert {name: jobs[name] for name in expected} == expected


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("*.jpg", "has no part in braces that names the camera"),
        ("{a}_{a}.jpg", "is not a valid pattern"),
        ("{1a}.jpg", "is not a valid pattern"),
        ("{serial}_*.tif", "none of 1 photographs has a name that matches"),
    ],
)
def test_wrong_patterns(tmp_path, pattern, message):
    touch(tmp_path, "in/A_1.jpg")
    with pytest.raises(ValueError, match=message):
        found(tmp_path, "in", camera=pattern)


def json_lines(path, *records):
    path.write_text(
        "".join(f"{own if isinstance(own, str) else json.dumps(own)}\n" for own in records)
    )
    return list(ts.find_jobs([path], options={"model": "brown"}))


def test_a_manifest_of_json_lines(tmp_path):
    touch(tmp_path, "layout.json")
    jobs = json_lines(
        tmp_path / "cameras.jsonl",
        {"name": "a", "photographs": ["1.png", "/far/2.png"], "model": "radial1", "fix": None},
        "",
        {"name": "b", "photographs": "3.png", "targets": "layout.json", "tone": 2.2},
    )
    assert [own.name for own in jobs] == ["a", "b"]
    assert jobs[0].photographs == (str(tmp_path / "1.png"), "/far/2.png")
    assert jobs[0].options == {"model": "radial1"}
    assert jobs[1].options == {
        "model": "brown",
        "targets": str(tmp_path / "layout.json"),
        "tone": 2.2,
    }
    assert jobs[1].origin.endswith("cameras.jsonl:3")


def test_a_manifest_as_csv(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text(
        "name,photographs,model,fix,parallel,lines,tone\r\n"
        '"a, first",1.png;2.png,,aspect;focal,0-1;0-2,true,srgb\n'
        "b,3.png,brown,,,,2.2\n",
        encoding="utf-8-sig",
    )
    first, second = ts.find_jobs([path])
    assert first.name == "a, first"
    assert [Path(own).name for own in first.photographs] == ["1.png", "2.png"]
    assert first.options == {
        "fix": ["aspect", "focal"],
        "parallel": [[0, 1], [0, 2]],
        "lines": True,
        "tone": "srgb",
    }
    assert second.options == {"model": "brown", "tone": 2.2}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            '{"name": ',
            "not JSON: Expecting value (column 9)",
        ),  # without "line 1", which would not be the file's line
        ("[" * 100_000, "too deeply"),
        ("[1]", "must be an object"),
        ('{"photographs": ["a.png"]}', '"name" is missing'),
        ('{"name": "x"}', '"photographs" is missing'),
        ('{"name": "x", "photographs": []}', "has no photograph"),
        ('{"name": "x", "photographs": [1]}', "a file or a list of files"),
        ('{"name": " ", "photographs": "a.png"}', "must not be empty"),
        ('{"name": 7, "photographs": "a.png"}', "must be a string"),
        ('{"name": "x", "photographs": "a.png", "modle": "brown"}', "did you mean 'model'"),
        ('{"name": "x", "photographs": "a.png", "threads": 8}', "unknown option 'threads'"),
        ('{"name": "x", "photographs": "a.png", "tone": NaN}', "NaN"),
    ],
)
def test_a_wrong_line_of_json_is_named_and_the_rest_goes_on(tmp_path, wrong, message):
    good = {"name": "c{}", "photographs": "a.png"}
    records = [{**good, "name": f"c{number}"} for number in range(1, 61)]
    records[56] = wrong
    jobs = json_lines(tmp_path / "cameras.jsonl", *records)
    faults = [own for own in jobs if own.fault is not None]
    assert len(jobs) == 60
    assert [own.name for own in faults] == [f"{tmp_path / 'cameras.jsonl'}:57"]
    assert message in faults[0].fault


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("a", "1 cells, but 4 columns"),
        ("a,1.png,brown,true,more", "5 cells"),
        ("a,1.png,brown,maybe", "lines must be true or false"),
        (",1.png,brown,true", '"name" is missing'),
        ("a,;,brown,true", "has no photograph"),
        ('a,"1.png"x,brown,true', "expected after"),
    ],
)
def test_a_wrong_line_of_csv_is_named_and_the_rest_goes_on(tmp_path, wrong, message):
    path = tmp_path / "cameras.csv"
    good = [f"c{number},1.png,," for number in range(2, 61)]
    good[55] = wrong
    path.write_text("\n".join(["name,photographs,model,lines", *good]))
    jobs = list(ts.find_jobs([path]))
    faults = [own for own in jobs if own.fault is not None]
    assert len(jobs) == 59
    assert [own.name for own in faults] == [f"{path}:57"]
    assert message in faults[0].fault


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("", "no column 'name'"),
        ("name,model", "no column 'photographs'"),
        ("name,photographs,modl", "did you mean 'model'"),
        ("name,photographs,name", "two columns have one name"),
    ],
)
def test_wrong_columns_are_an_error(tmp_path, head, message):
    path = tmp_path / "cameras.csv"
    path.write_text(f"{head}\na,b,c\n")
    with pytest.raises(ValueError, match=message):
        list(ts.find_jobs([path]))


@pytest.mark.parametrize("name", ["cameras.jsonl", "cameras.csv"])
def test_manifests_of_nothing_and_of_no_text(tmp_path, name):
    path = tmp_path / name
    head = b"" if name.endswith("l") else b"name,photographs\n"
    path.write_bytes(head)
    (job,) = ts.find_jobs([path])
    assert "contains no record" in job.fault
    path.write_bytes(head + b"\xff\xfe\xff" * 9)
    jobs = list(ts.find_jobs([path]))
    assert any("not UTF-8" in own.fault for own in jobs)
    with pytest.raises(ValueError, match="names the cameras itself"):
        list(ts.find_jobs([path], camera="{a}.png"))


def test_a_manifest_is_read_as_it_is_needed(tmp_path):
    path = tmp_path / "cameras.jsonl"
    with path.open("w") as file:
        for number in range(100_000):
            file.write(f'{{"name": "c{number}", "photographs": "{number}.png"}}\n')
    jobs = ts.find_jobs([path])
    assert next(jobs).name == "c0"
    path.write_text("")  # only a buffer is read ahead, not the file
    assert sum(1 for _ in jobs) < 10_000


@pytest.mark.parametrize(
    ("name", "head", "wrong", "right"),
    [
        ("c.jsonl", "", "1\n", '{"name": "a", "photographs": "b"}\n'),
        ("c.csv", HEAD, "a\n", "a,b\n"),
    ],
)
def test_a_manifest_is_not_read_beyond_ten_thousand_wrong_records(
    tmp_path, name, head, wrong, right
):
    path = tmp_path / name
    path.write_text(head + wrong * MAX_FAULTS + right)
    jobs = list(ts.find_jobs([path]))
    assert [len(jobs), jobs[-1].name, jobs[-1].fault] == [MAX_FAULTS + 1, "a", None]
    path.write_text(head + wrong * (MAX_FAULTS + 1) + right)
    *before, last = ts.find_jobs([path])
    assert len(before) == MAX_FAULTS
    assert last.origin == f"{path}:{MAX_FAULTS + 1 + bool(head)}"
    assert last.fault.startswith(
        f"{MAX_FAULTS} earlier records are wrong: the rest of the file is not read"
    )


@pytest.mark.parametrize(
    ("name", "file_name"),
    [
        ("cam 1", "cam 1"),
        ("../x", "%2E.%2Fx"),
        ("/etc/passwd", "%2Fetc%2Fpasswd"),
        ("a\\b:c*", "a%5Cb%3Ac%2A"),
        ("a%2Fb", "a%252Fb"),
        ("\x1b[31mred\n\0", "%1B[31mred%0A%00"),
        ("con", "%63on"),
        ("NUL.txt", "%4EUL.txt"),
        ("end.", "end%2E"),
        ("größe-カメラ", "größe-カメラ"),
        ("\udcff", "%ED%B3%BF"),
        (".hidden", "%2Ehidden"),
    ],
)
def test_names_are_made_safe(name, file_name):
    assert safe_file_name(name) == file_name


@given(st.text(min_size=1), st.text(min_size=1))
def test_every_name_has_a_file_of_its_own(one, other):
    files = [safe_file_name(name) for name in (one, other)]
    assert (files[0] == files[1]) == (one == other)
    for file in files:
        assert Path(file).name == file
        assert not file.startswith(".")
        assert len(os.fsencode(file)) <= LONGEST_FILE_NAME
        assert file.isprintable()


def test_names_that_some_file_systems_confuse_are_one():
    def identity(name):
        return ts.Job(name, ("a.png",)).identity

    assert identity("Cam") == identity("cAM")
    assert identity("u\u0308") == identity("\u00fc")
    assert identity("a" * 300) != identity("a" * 301)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((7, ("a.png",)), TypeError),
        (("", ("a.png",)), ValueError),
        (("a", ()), ValueError),
        (("a", 7), TypeError),
        (("a", (7,)), TypeError),
        (("a", ("a.png",), {"image": "b.png"}), ValueError),
    ],
)
def test_wrong_jobs_are_refused(arguments, error):
    with pytest.raises(error):
        ts.Job(*arguments)
