"""Every function, class and method for users has an example."""

import doctest
import inspect
import re

import pytest

import trisquare as ts
from trisquare import report


def called():
    """Everything that users call, by name: all that is public, with the methods of the classes."""
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


@pytest.mark.parametrize("name", sorted(CALLED))
def test_there_is_an_example(name):
    """The examples are run by `test_fresh_interpreter.py`."""
    assert doctest.DocTestParser().get_examples(CALLED[name].__doc__)


def test_methods_are_among_them():
    assert {"Camera.load", "Calibration.to_json", "PlaneEdges.square"} < set(CALLED)
    assert len(CALLED) > 90


def test_the_methods_that_are_named_exist():
    named = [
        (name, *found)
        for name, public in CALLED.items()
        for found in re.findall(r"`([A-Z]\w+)\.(\w+)", public.__doc__)
        if found[0] in ts.__all__
    ]
    assert len(named) > 5
    for name, kind, member in named:
        known = getattr(ts, kind)
        assert member in {*dir(known), *known.__annotations__}, f"{kind}.{member} in {name}"
