"""Tasks of the processes behind the routes, and the options of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

CALIBRATION_OPTIONS = ("method", "model", "fix", "free", "tone", "targets", "lines")

TASKS: Mapping[str, Sequence[str]] = {
    "find": ("targets", "outlines", "guide"),
    "calibrate": (*CALIBRATION_OPTIONS, "outlines"),
    "predict": ("image_size", "outlines", "camera", "focal", "sigma"),
    "overlay": ("index",),
    "undistort": ("balance", "shown"),
    "preview": (),
    "frames": ("frames",),
    "report": (),
    "convert": ("format", "approximate"),
    "compare": (),
}
"""Options of each task."""

FILES: Mapping[str, tuple[str, ...]] = {
    "find": ("picture",),
    "calibrate": ("picture",),
    "predict": (),
    "overlay": ("picture", "result"),
    "undistort": ("picture", "camera"),
    "preview": ("picture",),
    "frames": ("picture",),
    "report": ("picture", "result"),
    "convert": ("camera",),
    "compare": ("first", "second"),
}
"""Files that a request must include; `picture` may be repeated in tasks for several."""

CONTENT = "answer.bin"
"""File in the task's folder with the answer, if the answer is a file."""


@dataclass(frozen=True, slots=True)
class Task:
    """A request.

    Attributes
    ----------
    name : str
        One of `TASKS`.
    photographs : tuple of str
        Names of files in the folder.
    options : mapping of str to object
        From JSON, unchecked.
    files : mapping of str to str
        Names of other files, by their form fields.
    """

    name: str
    photographs: tuple[str, ...]
    options: Mapping[str, Any]
    files: Mapping[str, str]
