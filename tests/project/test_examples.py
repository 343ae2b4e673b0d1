"""Every function, class and method that a user calls has an example, and the examples run."""

import doctest
import inspect
import shutil
from importlib import resources

import numpy as np
import pytest

import trisquare as ts
from trisquare import report


def called():
    """What users call, by name: all that is public, with the methods of the classes."""
    found = {"trisquare": ts, "report.report_page": report.report_page}
    for name in set(ts.__all__) - {"__version__"}:
        public = getattr(ts, name)
        found[name] = public
        if isinstance(public, type):
            for method, value in vars(public).items():
                own = value.__func__ if isinstance(value, classmethod | staticmethod) else value
                if not method.startswith("_") and inspect.isfunction(own):
                    found[f"{name}.{method}"] = own
    return found


CALLED = called()


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """Calibrate the demo's photograph once for all examples."""
    photo = tmp_path_factory.mktemp("examples") / "photo.jpg"
    photo.write_bytes((resources.files("trisquare") / "data" / "demo.png").read_bytes())
    result = ts.calibrate(photo)
    return photo, {"ts": ts, "np": np, "result": result, "camera": result.camera}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CALLED))
def test_an_example_runs(name, names, tmp_path, monkeypatch):
    photo, given = names
    monkeypatch.chdir(tmp_path)
    shutil.copy(photo, "photo.jpg")
    finder = doctest.DocTestFinder(recurse=False)
    (example,) = finder.find(CALLED[name], name, globs=dict(given))
    assert example.examples, "no example"
    told = []
    doctest.DocTestRunner().run(example, out=told.append)
    assert not told, "".join(told)


def test_methods_are_among_them():
    assert {"Camera.load", "Calibration.to_json", "PlaneEdges.square"} < set(CALLED)
    assert len(CALLED) > 90


def test_a_wrong_example_is_told():
    example = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0)
    told = []
    doctest.DocTestRunner().run(example, out=told.append)
    assert told
