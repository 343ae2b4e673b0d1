"""Names allowed in imports; import-linter checks the rows of the rooms."""

import ast
import pickle
import re
import subprocess
import sys
import typing
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

import pytest

import trisquare

ROOT = Path(trisquare.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))


def imports_of(path):
    """Yield every module that a file imports, with the imported names."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from ((node.module, alias.name) for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_file_imports_the_facade_or_what_another_keeps_to_itself(path):
    """import-linter takes the compiled `trisquare._core` for the façade, hence this test."""
    for module, name in imports_of(path):
        if module.startswith("trisquare"):
            assert module != "trisquare", f"{path}: imports through the façade"
            private = name is not None and name.startswith("_") and not name.startswith("__")
            assert not private, f"{path}: takes {name}, which is {module}'s own"


def test_type_checkers_read_the_names_that_are_loaded():
    stub = ast.parse((ROOT / "__init__.pyi").read_text("utf-8"))
    declared = {alias.asname: node.module for node in stub.body for alias in node.names}
    assert declared == trisquare._MODULES


def test_importing_the_package_loads_no_room_and_one_name_its_own():
    script = (
        "import sys, trisquare; rooms = [m for m in sys.modules if m.startswith('trisquare.')]\n"
        "assert not rooms and 'numpy' not in sys.modules, rooms\n"
        "trisquare.Camera\n"
        "assert 'trisquare.calibration' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        _ = trisquare.calibrat


def test_an_object_made_before_its_class_was_asked_for_is_pickled_by_the_package():
    script = (
        "import pickle, trisquare; edges = trisquare.PlaneEdges\n"
        "from trisquare.results.plane import Plane\n"
        "trisquare.calibrate_edges\n"
        "assert b'trisquare.results' not in pickle.dumps(Plane)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


CLASSES = [name for name in trisquare.__all__ if isinstance(getattr(trisquare, name), type)]


@pytest.mark.parametrize("name", CLASSES)
def test_public_classes_name_the_package_and_their_annotations_resolve(name):
    public = getattr(trisquare, name)
    assert public.__module__ == "trisquare"
    assert pickle.loads(pickle.dumps(public)) is public
    typing.get_type_hints(public)


def test_the_drawing_of_the_rooms_has_the_rows_that_the_checks_hold():
    root = ROOT.parents[1]
    drawing = ElementTree.parse(root / "docs" / "rooms.svg").iterfind(".//{*}text")
    drawn = {"python": defaultdict(list), "crate": defaultdict(list)}
    for text in drawing:
        if text.get("class") is None:
            side = "python" if float(text.get("x")) < 500.0 else "crate"
            drawn[side][float(text.get("y"))].append(text.text.removesuffix(".py"))
    in_python = [set(drawn["python"][y]) for y in sorted(drawn["python"])]
    in_crate = [set(drawn["crate"][y]) for y in sorted(drawn["crate"])]

    contracts = (root / "pyproject.toml").read_text("utf-8").split("layers = [", 2)[1]
    rows = re.findall(r'^ +"(.+)",$', contracts.split("]")[0], re.MULTILINE)
    held = [set(row.split(" | ")) for row in rows]
    assert in_python[:-1] == held
    assert in_python[-1] == {"_core: rust/trisquare-py (checks, converts)"}

    source = (root / "rust" / "trisquare" / "tests" / "layers.rs").read_text("utf-8")
    rows = re.findall(r"^    &\[(.+)\],$", source, re.MULTILINE)
    assert in_crate == [set(re.findall(r'"(\w+)"', row)) for row in rows]
