"""What imports may name; in which row a room stands is checked by import-linter."""

import ast
import pickle
import typing
from pathlib import Path

import pytest

import trisquare

ROOT = Path(trisquare.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))


def imports_of(path):
    """Every module that a file names in an import, with the names that it takes of it."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from ((node.module, alias.name) for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_file_imports_the_facade_or_what_another_keeps_to_itself(path):
    """import-linter takes the compiled `trisquare._core` for the façade: so this looks itself."""
    for module, name in imports_of(path):
        if module.startswith("trisquare"):
            assert module != "trisquare", f"{path}: imports through the façade"
            private = name is not None and name.startswith("_") and not name.startswith("__")
            assert not private, f"{path}: takes {name}, which is {module}'s own"


CLASSES = [name for name in trisquare.__all__ if isinstance(getattr(trisquare, name), type)]


@pytest.mark.parametrize("name", CLASSES)
def test_public_classes_name_the_package_and_their_annotations_resolve(name):
    public = getattr(trisquare, name)
    assert public.__module__ == "trisquare"
    assert pickle.loads(pickle.dumps(public)) is public
    typing.get_type_hints(public)
