"""YAML as calibration files use it: plain data, read without trust."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import yaml

MAX_CHARACTERS = 1 << 20
"""Of a text; calibrations of a hundred views have half."""

MAX_VALUES = 100_000
"""Keys, numbers and texts; calibrations of a hundred views have a third. They are read in a second,
and take 50 MB."""

MAX_LEVELS = 32
"""Of nesting, of which camera files have six. Parsers take time by the product with the length."""

MAX_DIGITS = 400
"""Of a number: all that Python writes of the largest float are 309."""

OPENCV_TAG = "tag:yaml.org,2002:opencv-"
OPENCV_HEADER = re.compile(r"\A%YAML[: ]1\.0[^\n]*\n")


# The parser in C is ten times faster. It would not survive hostile nesting, but that is refused.
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _PlainLoader(_Loader):  # type: ignore[misc]
    """Reads plain data, with numbers of so many digits."""


def _number(construct: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Let a constructor refuse long numbers: those to the base of 60 take a quadratic time."""

    def constructed(loader: Any, node: Any) -> Any:
        if len(node.value) > MAX_DIGITS:
            raise ValueError(f"a number of more than {MAX_DIGITS} digits")
        return construct(loader, node)

    return constructed


def _opencv_value(loader: yaml.SafeLoader, tag: str, node: Any) -> Any:
    """Read a matrix as the mapping that it is written as, and whatever else OpenCV tags."""
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_PlainLoader.add_multi_constructor(OPENCV_TAG, _opencv_value)
_PlainLoader.add_constructor("tag:yaml.org,2002:int", _number(yaml.SafeLoader.construct_yaml_int))
_PlainLoader.add_constructor(
    "tag:yaml.org,2002:float", _number(yaml.SafeLoader.construct_yaml_float)
)
# YAML 1.2 and the libraries in C++ write numbers such as 1e-05, which YAML 1.1 took for text.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+\Z"), list("-+0123456789")
)


class _LimitError(ValueError):
    """A text is beyond a limit."""


def parse_yaml(text: str) -> Any:
    """Parse one document.

    Raises
    ------
    ValueError
        If it is not YAML, or beyond the limits above; if it holds aliases or tags other than
        OpenCV's.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"the YAML text is longer than {MAX_CHARACTERS} characters")
    # OpenCV's header is none that YAML knows.
    plain = OPENCV_HEADER.sub("", text)
    try:
        _check_events(yaml.parse(plain, _PlainLoader))
        return yaml.load(plain, _PlainLoader)
    except _LimitError:
        raise
    except yaml.YAMLError as error:
        lines = (line.strip() for line in str(error).splitlines())
        raise ValueError(f"not YAML: {'; '.join(lines)}") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # What the parser's own converters stumble over: numbers and dates that are none.
        raise ValueError(f"not YAML that can be read: {error}") from error


def _check_events(events: Iterable[Any]) -> None:
    """Raise ValueError at the first event that is beyond a limit; no more is parsed then."""
    values = levels = 0
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            levels += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            levels -= 1
        elif isinstance(event, yaml.AliasEvent):
            # With these, a small file unfolds into a large one.
            raise yaml.YAMLError("it holds an alias (*name), which camera files do without")
        values += isinstance(event, yaml.NodeEvent)
        if levels > MAX_LEVELS:
            raise _LimitError(f"the YAML text is nested more than {MAX_LEVELS} levels deep")
        if values > MAX_VALUES:
            raise _LimitError(f"the YAML text has more than {MAX_VALUES} values")
