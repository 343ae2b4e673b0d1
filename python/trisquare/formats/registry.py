"""All formats, and how the format of a file is recognised."""

from __future__ import annotations

from trisquare._support.suggestions import unknown
from trisquare.formats import (
    colmap,
    hugin,
    kalibr,
    lensfun,
    metashape,
    mrcal,
    native_json,
    nerfstudio,
    opencv,
    ros,
)
from trisquare.formats.base import Format
from trisquare.formats.document import Document

# In the order in which they are tried: formats with stricter tests first.
FORMATS = (
    native_json.FORMAT,
    opencv.FORMAT,
    ros.FORMAT,
    kalibr.FORMAT,
    mrcal.FORMAT,
    nerfstudio.FORMAT,
    hugin.FORMAT,
    lensfun.FORMAT,
    metashape.FORMAT,
    colmap.FORMAT,
)
FORMAT_NAMES = tuple(known.name for known in FORMATS)
ENDINGS = sorted({ending for known in FORMATS for ending in known.file_names})
"""Endings of file names that imply a format."""


def format_called(name: str) -> Format:
    """Return the format with a name.

    Raises
    ------
    TypeError, ValueError
        If there is no such format.
    """
    if not isinstance(name, str):
        raise TypeError(f"format must be a string, not {type(name).__name__}")
    for known in FORMATS:
        if known.name == name.lower():
            return known
    raise unknown("format", name, FORMAT_NAMES)


def format_of_document(document: Document) -> Format:
    """Return the format that a text looks like or, failing that, that its file's name implies.

    Raises
    ------
    ValueError
        If neither is a known format.
    """
    for known in FORMATS:
        if known.recognises(document):
            return known
    # The error of the format's own reader is the most specific one.
    promised = _format_by_name(document.name)
    if promised is None:
        if not document.text.strip():
            raise ValueError("the file is empty")
        raise ValueError(
            f"not a camera file of a known format ({', '.join(FORMAT_NAMES)}); if it is one of "
            "these, state which: format=, or trisquare convert --from, whose output every command "
            "reads"
        )
    return promised


def format_of_name(
    name: str, remedy: str = f"state it with format= (--to), one of {', '.join(FORMAT_NAMES)}"
) -> Format:
    """Return the format in which to write a file of this name.

    ``transforms.json``, ``camchain.yaml`` and the like are their programs' own; a plain ``.json``
    is trisquare's, a plain ``.yaml`` or ``.xml`` OpenCV's. `remedy` is the advice in the error,
    for callers where only the name decides.

    Raises
    ------
    ValueError
        If the name implies no format.
    """
    promised = _format_by_name(name)
    if promised is None:
        raise ValueError(f"the extension of {name!r} determines no camera format: {remedy}")
    return promised


def _format_by_name(name: str) -> Format | None:
    """Return the format with the longest ending that fits, which is the most specific one."""
    fitting = [
        (len(ending), known)
        for known in FORMATS
        for ending in known.file_names
        if name.lower().endswith(ending)
    ]
    return max(fitting, key=lambda pair: pair[0])[1] if fitting else None
