"""Parsing of XML from untrusted camera files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any
from xml.parsers import expat

from trisquare._support.arrays import real_number

MAX_LEVELS = 32
"""Maximum depth of nesting; no camera file has half as many levels."""


def parse_xml(text: str) -> ElementTree.Element:
    """Parse a text; no external entities are loaded.

    Raises
    ------
    ValueError
        If it is not XML, is nested too deeply, or declares entities, by which a small file may
        expand to a large one.
    """
    builder = ElementTree.TreeBuilder()
    levels = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal levels
        levels += 1
        if levels > MAX_LEVELS:
            raise ValueError(f"the XML text is nested more than {MAX_LEVELS} levels deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal levels
        levels -= 1
        builder.end(tag)

    parser = expat.ParserCreate("utf-8")
    parser.EntityDeclHandler = _refuse_entity
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.encode("utf-8", "replace"), True)
        return builder.close()
    except expat.ExpatError as error:
        raise ValueError(f"not XML: {error}") from error


def number_in(text: str | None, name: str) -> float:
    """Return the number that is the text of an element or attribute.

    Raises
    ------
    ValueError
        If it is missing (`text` is None), or is not a finite number.
    """
    if text is None:
        raise ValueError(f'"{name}" is missing')
    try:
        return real_number(float(text), name)
    except ValueError as error:
        raise ValueError(f'"{name}" must be a finite number, not {text!r}') from error


def _refuse_entity(*_: Any) -> None:
    raise ValueError("the XML text declares entities, which are not read")
