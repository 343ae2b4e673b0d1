"""One camera of a batch: its name, its photographs and its options."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from trisquare._core import __version__
from trisquare._support.arrays import Frozen, strings
from trisquare._support.suggestions import unknown
from trisquare._support.writing import PathLike
from trisquare.camera.camera import Camera

OPTIONS = (
    *("method", "model", "fix", "free", "initial", "orthogonal", "parallel"),
    *("tone", "targets", "outlines", "lines", "side", "frames"),
)
"""Arguments of `calibrate` that a job may have."""

FILE_OPTIONS = ("initial", "outlines", "targets")
"""Options that may name a file."""

LONGEST_FILE_NAME = 200
"""Maximum length of a file's name, bytes: file systems allow 255, and temporary files have longer
names."""

KEPT_IN_FILE_NAMES = frozenset(" -_.,+@()[]#=")
RESERVED = {
    "con",
    "prn",
    "aux",
    "nul",
    *(f"{port}{n}" for port in ("com", "lpt") for n in "123456789"),
}
"""Names that Windows keeps for devices."""


@dataclass(frozen=True, slots=True, init=False)
class Job(Frozen):
    """One camera and its photographs.

    Parameters
    ----------
    name : str
        Name of the camera, unique in the batch.
    photographs : iterable of str or path
        One or more files; videos as well, with the option ``frames``. Stored as a tuple of str.
    options : mapping of str to object
        Arguments of `calibrate` by their names: ``method``, ``model``, ``fix``, ``free``,
        ``initial`` (a `Calibration`, a `Camera`, or a camera file), ``orthogonal``, ``parallel``,
        ``tone``, ``targets``, ``outlines`` (a file, or its content), ``lines``, ``side`` and
        ``frames`` (of each video among the photographs; without videos it has no effect).
    origin : str
        Where it was read, for messages.
    fault : str, optional
        Why it cannot be calibrated: an error in what was read.

    Raises
    ------
    TypeError, ValueError
        If the name is empty, there is no photograph, or an option is unknown. The options' values
        are checked when the job is done.

    Examples
    --------
    >>> job = ts.Job("left", ("l1.jpg", "l2.jpg"), {"model": "brown"})
    >>> job.name, job.photographs
    ('left', ('l1.jpg', 'l2.jpg'))
    """

    name: str
    photographs: tuple[str, ...]
    options: Mapping[str, Any]
    origin: str
    fault: str | None

    def __init__(
        self,
        name: str,
        photographs: PathLike | Iterable[PathLike],
        options: Mapping[str, Any] | None = None,
        origin: str = "",
        fault: str | None = None,
    ) -> None:
        if not isinstance(name, str):
            raise TypeError(f"a job's name must be a string, not {type(name).__name__}")
        if not name.strip():
            raise ValueError("a job's name must not be empty")
        given = (photographs,) if isinstance(photographs, str | os.PathLike) else photographs
        if isinstance(photographs, bytes | bytearray) or not isinstance(given, Iterable):
            raise TypeError(
                "a job's photographs are paths, which its own process opens (write bytes to a "
                f"file), not {type(photographs).__name__}"
            )
        paths = strings([os.fspath(path) for path in given], "photographs")
        if fault is None and not paths:
            raise ValueError(f"the job {name!r} has no photograph")
        for option in options or {}:
            if option not in OPTIONS:
                raise unknown("option", option, OPTIONS)
        values = (name, paths, dict(options or {}), origin, fault)
        for member, value in zip(fields(self), values, strict=True):
            object.__setattr__(self, member.name, value)

    @property
    def key(self) -> str:
        """Digest of all that the result depends on: files count by name, size and time.

        The version of trisquare is included, so that all results of a folder are of one version.
        """
        options = {name: _plain(value) for name, value in self.options.items()}
        named = [
            options[name]
            for name in FILE_OPTIONS
            if isinstance(options.get(name), str) and os.path.exists(options[name])
        ]
        files = [_stamp(path) for path in (*self.photographs, *named)]
        content = [__version__, self.name, files, options, self.fault]
        text = json.dumps(content, sort_keys=True, default=repr)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def file_name(self) -> str:
        """Name of the camera's result file."""
        return f"{safe_file_name(self.name)}.json"

    @property
    def identity(self) -> str:
        """Text that is equal for names whose files are the same on some file systems."""
        # Interned, so that several containers with it share the memory.
        return sys.intern(unicodedata.normalize("NFC", self.file_name).casefold())


def faulty_job(name: str, fault: str, origin: str = "") -> Job:
    """Return a job that only records an error."""
    return Job(name, (), {}, origin, fault)


def safe_file_name(name: str) -> str:
    """Return a name for a file: characters that file names cannot have are escaped as in URLs.

    Letters and digits of any script are kept. ``../x`` becomes ``%2E.%2Fx``.
    """
    text = "".join(letter if _is_plain(letter) else _escaped(letter) for letter in name)
    if text[0] in ". " or text.split(".")[0].casefold() in RESERVED:
        text = _escaped(text[0]) + text[1:]
    if text[-1] in ". ":
        text = text[:-1] + _escaped(text[-1])
    if len(os.fsencode(text)) > LONGEST_FILE_NAME:
        digest = hashlib.sha256(os.fsencode(text)).hexdigest()[:16]
        short = os.fsencode(text)[: LONGEST_FILE_NAME - 20].decode("utf-8", "ignore")
        text = f"{short}~{digest}"
    return text


def _is_plain(letter: str) -> bool:
    return unicodedata.category(letter)[0] in "LMN" or letter in KEPT_IN_FILE_NAMES


def _escaped(letter: str) -> str:
    return "".join(f"%{byte:02X}" for byte in letter.encode("utf-8", "surrogatepass"))


def _stamp(path: str) -> list[Any]:
    """Return the name, the size and the time of the last change of a file."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):  # ValueError: the name has a NUL
        return [Path(path).name, None, None]
    return [Path(path).name, found.st_size, found.st_mtime_ns]


def _plain(value: Any) -> Any:
    """Return an option's value in a form for JSON."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    camera = getattr(value, "camera", value)  # of a calibration
    if isinstance(camera, Camera):
        return [camera.model, camera.image_size, camera.K.tolist(), camera.distortion.tolist()]
    return value
