"""Parsing of YAML from untrusted calibration files: plain data only."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import yaml

MAX_CHARACTERS = 1 << 20
"""Maximum length of a text; calibrations of a hundred views have half of it."""

MAX_VALUES = 100_000
"""Maximum number of keys, numbers and texts; calibrations of a hundred views have a third of it. As
many are read in a second, and take 50 MB."""

MAX_LEVELS = 32
"""Maximum depth of nesting; camera files have six levels. The time of parsers is proportional to
its product with the length."""

MAX_DIGITS = 400
"""Maximum number of digits; the largest float has 309 when written in full."""

OPENCV_TAG = "tag:yaml.org,2002:opencv-"
OPENCV_HEADER = re.compile(r"\A%YAML[: ]1\.0[^\n]*\n")


# The parser in C is ten times faster. Deep nesting would crash it, but is refused.
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _PlainLoader(_Loader):  # type: ignore[misc]
    """Loader of plain data, which limits the number of digits."""


def _number(construct: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Make a constructor refuse long numbers: those to base 60 take quadratic time."""

    def constructed(loader: Any, node: Any) -> Any:
        if len(node.value) > MAX_DIGITS:
            raise ValueError(f"a number of more than {MAX_DIGITS} digits")
        return construct(loader, node)

    return constructed


def _opencv_value(loader: yaml.SafeLoader, tag: str, node: Any) -> Any:
    """Read a matrix as a mapping, and other values that OpenCV tags as what they are."""
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
# YAML 1.2 and libraries in C++ write numbers such as 1e-05, which YAML 1.1 reads as text.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+\Z"), list("-+0123456789")
)


class _LimitError(ValueError):
    """A text exceeds a limit."""


def parse_yaml(text: str) -> Any:
    """Parse one document.

    Raises
    ------
    ValueError
        If it is not YAML, or exceeds the limits above; if it has aliases, or tags other than
        OpenCV's.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"the YAML text is longer than {MAX_CHARACTERS} characters")
    # OpenCV's header is not valid YAML.
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
        # Errors of the parser's own converters, for invalid numbers and dates.
        raise ValueError(f"not YAML that can be read: {error}") from error


def _check_events(events: Iterable[Any]) -> None:
    """Raise ValueError at the first event that exceeds a limit, before more is parsed."""
    values = levels = 0
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            levels += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            levels -= 1
        elif isinstance(event, yaml.AliasEvent):
            # By aliases, a small file may expand to a large one.
            raise yaml.YAMLError("it contains an alias (*name), which is not read")
        values += isinstance(event, yaml.NodeEvent)
        if levels > MAX_LEVELS:
            raise _LimitError(f"the YAML text is nested more than {MAX_LEVELS} levels deep")
        if values > MAX_VALUES:
            raise _LimitError(f"the YAML text has more than {MAX_VALUES} values")
