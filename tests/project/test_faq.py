"""Every code of an error or a warning has a section, and every section is about a code."""

import ast
import json
import os
import pickle
import re
from errno import EACCES, EISDIR, ENOENT, ENOMEM, ENOSPC
from pathlib import Path
from typing import get_args, get_type_hints

import cv2
import pytest
from shown import CHECKOUT, page

import trisquare as ts
from trisquare import errors
from trisquare._support.writing import check_writable, writing
from trisquare.calibration.fault_warnings import _ADVICE
from trisquare.cli.app import EXIT_CODES
from trisquare.errors import HTTP_STATUSES, code_members, error_members, help_of, http_status
from trisquare.results.calibration_warning import SEVERITIES
from trisquare.results.partial_detection import PartialDetection

PACKAGE = Path(ts.__file__).parent
SECTION = re.compile(r"^### `(\w+)`\n\n(.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)


def trees(*rooms):
    for room in rooms:
        for path in PACKAGE.glob(f"{room}/**/*.py"):
            yield ast.parse(path.read_text("utf-8"))


def text_of(node):
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def warning_codes():
    """The codes in the crate, and those in the package's calls and remarks."""
    crate = CHECKOUT / "rust" / "trisquare" / "src" / "result" / "warning.rs"
    codes = set(re.findall(r"=> \"(\w+)\"", crate.read_text("utf-8").split("fn code")[1]))
    codes |= set(_ADVICE)
    for tree in trees("calibration", "cli", "images", "results"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "CalibrationWarning":
                codes |= {text_of(argument) for argument in node.args[1:2]}
            elif isinstance(node, ast.Subscript) and getattr(node.value, "id", "") == "remarks":
                codes.add(text_of(node.slice))
    return {*codes, ts.CalibrationWarning("a text").code} - {None}


def error_codes(*rooms):
    """The classes of errors, and the names used in given rooms."""
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    own = {kind.__name__ for kind in kinds if issubclass(kind, Exception)}
    own -= {errors.WordedOSError.__name__}  # its errors have the names of the system's
    given = {
        text
        for tree in trees(*rooms)
        for node in ast.walk(tree)
        if (text := text_of(node)) and re.fullmatch(r"[A-Z]\w+(Error|Interrupt)", text)
    }
    return own | given


def test_every_code_has_its_section_and_every_section_its_code():
    assert {"planes_vary", "overexposed", "other_size", "repeated_picture"} < warning_codes()
    codes = error_codes("cli", "batch", "serve") | {kind.__name__ for kind in EXIT_CODES}
    assert {"TrisquareError", "TimeLimitError", "UsageError", "OSError"} < codes
    sections = [name for name, _ in SECTION.findall(page("faq.md"))]
    assert sorted(sections) == sorted(warning_codes() | codes)


def test_every_section_says_what_why_and_what_to_do():
    for name, text in SECTION.findall(page("faq.md")):
        assert re.findall(r"^- (\w+): \S", text, re.MULTILINE) == ["Means", "Why", "Do"], name


def test_warnings_that_come_together_name_each_other():
    texts = dict(SECTION.findall(page("faq.md")))
    assert "](#overexposed)" in texts["planes_contradict"]
    assert "](#planes_contradict)" in texts["overexposed"]


def test_help_names_the_section():
    """In Sphinx's form: lower case, and hyphens for underscores."""
    warning = ts.CalibrationWarning("a text", "lens_beyond_model", "high")
    assert warning.help == help_of("lens_beyond_model") == "faq.html#lens-beyond-model"
    assert ts.MissingImageError("x").help == "faq.html#missingimageerror"
    assert ts.LensModelError("x", None, 0.0, 0.0).help == "faq.html#lensmodelerror"


def test_the_http_statuses_are_those_of_services():
    rows = re.findall(r"^\| (\d{3}) \| .* \| (.+) \|$", page("faq.md"), re.MULTILINE)
    said = {code: int(status) for status, codes in rows for code in re.findall(r"`(\w+)`", codes)}
    assert said == dict(HTTP_STATUSES)
    assert error_codes("batch", "serve") <= set(said)
    sections = [name for name, _ in SECTION.findall(page("faq.md"))]
    assert set(said) <= set(sections)


def opencv_error(text, code):
    """As raised by OpenCV; errors of C++ have no code."""
    error = cv2.error(text)
    if code is not None:
        error.code = code
    return error


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (ts.MissingImageError("a.png:\n missing"), "MissingImageError", "a.png: missing"),
        (ts.LensModelError("a lens", None, 0.0, 0.0), "LensModelError", "a lens"),
        (UnicodeError("bad"), "ValueError", "bad"),
        (FileNotFoundError("gone"), "OSError", "gone"),
        (MemoryError(), "MemoryError", "not enough memory"),
        (MemoryError("a.png"), "MemoryError", "not enough memory: a.png"),
        (OSError(ENOMEM, "all taken"), "MemoryError", "not enough memory: [Errno 12] all taken"),
        (opencv_error("x", -4), "MemoryError", "not enough memory: x"),
        (opencv_error("std::bad_alloc", None), "MemoryError", "not enough memory: std::bad_alloc"),
        (opencv_error("size.width > 0", -215), "InternalError", "error: size.width > 0"),
        (IndexError("5"), "InternalError", "IndexError: 5"),
        (ts.InternalError("a panic"), "InternalError", "a panic"),
    ],
)
def test_every_error_is_told_in_one_shape(error, code, text):
    assert ts.error_members(error) == code_members(code, text)
    assert error_members(error)["help"] == help_of(code)
    assert http_status(code) == HTTP_STATUSES[code]


@pytest.mark.parametrize(
    ("call", "path", "kind", "number", "text"),
    [
        (ts.calibrate, "no.jpg", ts.MissingImageError, ENOENT, "No such file or directory"),
        (ts.read_image, "no.jpg", ts.MissingImageError, ENOENT, "No such file or directory"),
        (ts.Camera.load, "no.json", FileNotFoundError, ENOENT, "No such file or directory"),
        (ts.Camera.load, ".", IsADirectoryError, EISDIR, "Is a directory"),
        (check_writable, "no/x.json", FileNotFoundError, ENOENT, "there is no folder"),
        (check_writable, ".", OSError, EISDIR, "is not a file"),
    ],
)
def test_an_error_of_the_system_has_its_members(
    tmp_path, monkeypatch, call, path, kind, number, text
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kind) as info:
        call(path)
    for error in (info.value, pickle.loads(pickle.dumps(info.value))):
        assert isinstance(error, kind)
        assert type(error).__name__ == kind.__name__
        assert (error.errno, error.filename, error.strerror) == (number, path, os.strerror(number))
        assert str(error).startswith(f"{path}: {text}")


@pytest.mark.parametrize(("number", "kind"), [(ENOSPC, OSError), (EACCES, PermissionError)])
def test_an_error_while_writing_has_the_members_of_the_system(number, kind):
    with pytest.raises(kind) as info, writing("x.json"), writing(".x.json.tmp"):
        raise OSError(number, os.strerror(number), ".x.json.tmp")
    error = info.value
    assert (error.errno, error.filename) == (number, ".x.json.tmp")
    assert str(error) == f".x.json.tmp: cannot be written: {os.strerror(number)}"


def test_an_error_tells_the_shapes_that_it_knows():
    corners = [[1.0, 2.0], [9.0, 2.0], [9.0, 8.0], [1.0, 8.0]]
    error = ts.DetectionError("nothing")
    error.found = (PartialDetection("frame", 0, corners),)
    error.rejected = (ts.Rejected("square", 1, corners, "too small"),)
    members = json.loads(json.dumps(error_members(error)))
    assert members == {
        **code_members("DetectionError", "nothing"),
        "found": [{"kind": "frame", "image": 0, "corners": corners}],
        "rejected": [{"kind": "square", "image": 1, "corners": corners, "reason": "too small"}],
    }


def test_an_unknown_code_is_a_fault_of_the_service():
    assert ts.http_status("SomeError") == 500


def test_errors_of_the_command_line_are_the_client_s():
    assert ts.http_status("UsageError") == ts.http_status("UnreadableInputError") == 400


def test_a_missing_file_other_than_a_picture_is_the_service_s(tmp_path):
    with pytest.raises(FileNotFoundError) as missing:
        ts.Calibration.load(tmp_path / "gone.json")
    code = ts.error_members(missing.value)["code"]
    assert (code, ts.http_status(code)) == ("OSError", 500)


def test_every_severity_has_its_part():
    headings = re.findall(r"^## Warnings of (\w+) severity$", page("faq.md"), re.MULTILINE)
    assert headings == list(SEVERITIES)
    assert get_args(get_type_hints(ts.CalibrationWarning)["severity"]) == SEVERITIES


def test_the_exit_codes_are_those_of_the_command():
    codes = {int(code) for code in re.findall(r"^\| (\d+) \| [^|]+ \|$", page("faq.md"), re.M)}
    assert codes == {0, 1, 6, 70, 130} | set(EXIT_CODES.values())


def test_the_names_of_the_crate_are_those_of_the_crate():
    source = (CHECKOUT / "rust" / "trisquare" / "src").joinpath
    arms = (
        source("result", "warning.rs").read_text("utf-8").split("fn code")[1].split("}\n    }")[0]
    )
    code_of = {
        variant: code
        for variants, code in re.findall(r"^ +(Self::.+?) => \"(\w+)\"", arms, re.MULTILINE)
        for variant in re.findall(r"Self::(\w+)", variants)
    }
    assert code_of["PlanesVary"] == "planes_vary"
    rows = re.findall(r"^\| `(\w+)`.* \| (.+) \|$", page("faq.md"), re.MULTILINE)
    said = {variant: code for code, text in rows for variant in re.findall(r"Warning::(\w+)", text)}
    camel = {v: c for v, c in code_of.items() if v == c.title().replace("_", "")}
    shared = [code for code in camel.values() if list(code_of.values()).count(code) > 1]
    assert said == {v: c for v, c in code_of.items() if v not in camel or c in shared}
    kinds = source("error.rs").read_text("utf-8").split("pub enum ErrorKind {")[1].split("\n}")[0]
    kinds = set(re.findall(r"^    (\w+),", kinds, re.MULTILINE))
    assert kinds == set(re.findall(r"`ErrorKind::(\w+)`", page("faq.md"))) != set()
