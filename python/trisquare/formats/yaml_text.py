"""YAML as calibration files use it: plain data, read without trust."""

from __future__ import annotations

import re
from typing import Any

import yaml

MOST_CHARACTERS = 1 << 20
"""The parser in Python, which alone survives hostile nesting, reads a million in a second, and in
half a minute where they are all digits and commas; calibrations of a hundred views have half."""

OPENCV_TAG = "tag:yaml.org,2002:opencv-"
OPENCV_HEADER = re.compile(r"\A%YAML[: ]1\.0[^\n]*\n")


class _PlainLoader(yaml.SafeLoader):
    """Reads plain data; refuses aliases, with which a small file unfolds into a large one."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("it holds an alias (*name), which camera files do without")
        return super().compose_node(parent, index)


def _opencv_value(loader: yaml.SafeLoader, tag: str, node: Any) -> Any:
    """Read a matrix as the mapping that it is written as, and whatever else OpenCV tags."""
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_PlainLoader.add_multi_constructor(OPENCV_TAG, _opencv_value)
# YAML 1.2 and the libraries in C++ write numbers such as 1e-05, which YAML 1.1 took for text.
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+\Z"), list("-+0123456789")
)


def parse_yaml(text: str) -> Any:
    """Parse one document.

    Raises
    ------
    ValueError
        If it is not YAML, too long, or nested too deeply; if it holds aliases or tags other than
        OpenCV's.
    """
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"the YAML text is longer than {MOST_CHARACTERS} characters")
    # OpenCV's header is none that YAML knows.
    plain = OPENCV_HEADER.sub("", text)
    try:
        return yaml.load(plain, _PlainLoader)
    except RecursionError as error:
        raise ValueError("the YAML text is nested too deeply") from error
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {error}") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # What the parser's own converters stumble over: numbers and dates that are none.
        raise ValueError(f"not YAML that can be read: {error}") from error
