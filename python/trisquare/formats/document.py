"""A file that may contain a camera: its text, raw and parsed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath

from trisquare._support.json_members import JsonFields, parse_json
from trisquare._support.paths import File, read_bytes, shown
from trisquare.formats.yaml_text import parse_yaml

MAX_BYTES = 64 << 20
"""Maximum size of a file; only a list of ten thousand pictures comes near."""

BINARY_FILES = {
    "cameras.bin": ", which COLMAP makes of it: colmap model_converter --input_path FOLDER "
    "--output_path FOLDER --output_type TXT"
}
"""Names of binary files of other programs, and how to convert them to text."""


@dataclass(frozen=True)
class Document:
    """The text of a file, and the file's name.

    Parameters
    ----------
    text : str
        The whole text.
    name : str
        The last part of its path, in small letters; empty if there is none.
    """

    text: str
    name: str = ""

    @classmethod
    def read(cls, path: File) -> Document:
        """Read a file, up to the maximum size of a camera file.

        Raises
        ------
        OSError
            If it cannot be read.
        ValueError
            If it is too large, or not text.
        """
        named = shown(path)
        content = read_bytes(path, MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise ValueError(f"{named}: larger than {MAX_BYTES >> 20} MB, which no camera file is")
        name = PurePath(path).name.lower() if isinstance(path, str | os.PathLike) else ""
        not_text = f"{named}: not a text file{BINARY_FILES.get(name, ', as camera files are')}"
        if b"\0" in content:
            raise ValueError(not_text)
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise ValueError(not_text) from error
        return cls(text, name)

    @property
    def suffix(self) -> str:
        """The name's extension, with its dot."""
        return PurePath(self.name).suffix

    def starts_with(self, text: str) -> bool:
        """Return whether the text starts with `text`, after white space."""
        return self.text[:4096].lstrip("\ufeff \t\r\n").startswith(text)

    @cached_property
    def json(self) -> JsonFields:
        """The text as a JSON object.

        Raises
        ------
        ValueError
            If it is not a JSON object.
        """
        return JsonFields(parse_json(self.text))

    @cached_property
    def yaml(self) -> JsonFields:
        """The text as a YAML mapping.

        Raises
        ------
        ValueError
            If it is not a YAML mapping.
        """
        parsed = parse_yaml(self.text)
        if not isinstance(parsed, dict):
            raise ValueError("the YAML text must be a mapping")
        return JsonFields(parsed)
