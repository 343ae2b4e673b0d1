"""XML as camera files use it, read without trust."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any
from xml.parsers import expat


def parse_xml(text: str) -> ElementTree.Element:
    """Parse a text; nothing outside it is fetched.

    Raises
    ------
    ValueError
        If it is not XML, or declares entities, with which a small file unfolds into a large one.
    """
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate("utf-8")
    parser.EntityDeclHandler = _refuse_entity
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.encode("utf-8", "replace"), True)
        return builder.close()
    except expat.ExpatError as error:
        raise ValueError(f"not XML: {error}") from error


def _refuse_entity(*_: Any) -> None:
    raise ValueError("the XML text declares entities, which camera files do without")
