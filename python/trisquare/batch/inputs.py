"""Jobs from the user's arguments: photographs, folders, patterns and manifests."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from trisquare._support.natural_order import natural_order
from trisquare._support.paths import naming_failure, shown
from trisquare._support.worded_errors import worded
from trisquare.batch.jobs import Job, faulty_job
from trisquare.batch.manifest import MANIFESTS, manifest_jobs
from trisquare.images.drawn_mark import is_drawn
from trisquare.images.sources import PICTURE_SUFFIXES, VIDEO_SUFFIXES

FIELD = re.compile(r"\\\{(\w+)\\\}|(\\\*)|(\\\?)")


def find_jobs(
    inputs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    camera: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> Iterator[Job]:
    """Find the cameras to be calibrated.

    Parameters
    ----------
    inputs : path, or iterable of path
        A photograph is a camera of its own, and so is each photograph directly in a folder that is
        given; a folder below a given one is a camera with all its photographs, named by its path.
        With the option ``frames`` the videos of folders are included. Patterns such as
        ``line?/*.jpg`` are replaced by the matching paths. Each record of a manifest, ``.csv`` or
        ``.jsonl``, is a camera.
    camera : str, optional
        Pattern that groups the photographs by their names instead, such as ``{serial}_*.jpg``:
        photographs with the same text in place of the braces are of one camera. A pattern with a
        slash is compared with the end of the path, below the given folder.
    options : mapping, optional
        Arguments of `calibrate` for all jobs; a manifest's own take precedence.

    Yields
    ------
    Job
        In the order of the inputs, within folders by name, with numbers in numerical order:
        ``2.jpg`` comes before ``10.jpg``. An error in one item is a job with a `fault`.

    Raises
    ------
    FileNotFoundError
        If an input does not exist.
    ValueError
        If `camera` is not a pattern, or no photograph matches it; if a manifest has wrong columns.

    Examples
    --------
    >>> [job.name for job in ts.find_jobs(["photo.jpg"], options={"model": "radial1"})]
    ['photo']
    """
    shared = dict(options or {})
    named = [inputs] if isinstance(inputs, str | os.PathLike) else inputs
    paths = [path for given in named for path in _matching(os.fspath(given))]
    if camera is not None:
        yield from _grouped(paths, camera_pattern(camera), camera, shared)
        return
    for path in paths:
        if is_manifest(path):
            yield from manifest_jobs(path, shared)
        elif os.path.isdir(path):
            yield from _folder_jobs(path, shared)
        else:
            yield Job(Path(path).stem, (path,), shared, path)


def is_manifest(path: str) -> bool:
    """Return whether a path is that of a manifest."""
    return Path(path).suffix.lower() in MANIFESTS


def camera_pattern(text: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern such as ``{serial}_*.jpg``.

    Raises
    ------
    ValueError
        If nothing is in braces, or a name in braces occurs twice.
    """

    def regular(found: re.Match[str]) -> str:
        return f"(?P<{found[1]}>[^/]+?)" if found[1] else "[^/]*" if found[2] else "[^/]"

    try:
        pattern = re.compile(FIELD.sub(regular, re.escape(text)), re.DOTALL)
    except re.error as error:
        raise ValueError(f"{text!r} is not a valid pattern for cameras: {error}") from error
    if not pattern.groups:
        raise ValueError(
            f"{text!r} has no part in braces that names the camera, as in {{serial}}_*.jpg"
        )
    return pattern


def _matching(given: str) -> list[str]:
    try:
        with naming_failure(given):
            mode = os.stat(given).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return _of_pattern(given)
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise ValueError(f"{given}: a batch's workers cannot read a pipe or device: name a file")
    return [given]


def _of_pattern(given: str) -> list[str]:
    import glob  # needed only for patterns

    matching = glob.glob(given, recursive=True) if glob.has_magic(given) else []
    if not matching:
        text = f"{shown(given)}: there is no such file or folder"
        raise worded(FileNotFoundError, text, given, errno.ENOENT)
    photographs = [path for path in matching if not is_drawn(path)]
    return sorted(photographs or matching, key=natural_order)


def _photographs(
    folder: str, options: Mapping[str, Any], unread: list[OSError] | None = None
) -> Iterator[tuple[str, list[str]]]:
    """Yield a folder and those below it, each with the photographs directly in it.

    Videos are included only if the options ask for frames: else they would fail. Pictures that
    trisquare drew on are not included. Errors of folders that cannot be read are added to `unread`.
    """
    failed = None if unread is None else unread.append
    suffixes = PICTURE_SUFFIXES
    if options.get("frames") is not None:
        suffixes |= VIDEO_SUFFIXES
    for path, folders, files in os.walk(folder, onerror=failed):
        folders[:] = (name for name in folders if not name.startswith("."))
        folders.sort(key=natural_order)
        shown = (name for name in files if not name.startswith("."))
        names = sorted(shown, key=natural_order)
        pictures = [name for name in names if Path(name).suffix.lower() in suffixes]
        paths = (os.path.join(path, name) for name in pictures)
        yield path, [path for path in paths if not is_drawn(path)]


def _folder_jobs(folder: str, options: Mapping[str, Any]) -> Iterator[Job]:
    is_empty = True
    unread: list[OSError] = []
    for path, pictures in _photographs(folder, options, unread):
        if not pictures:
            continue
        is_empty = False
        if path == folder:
            yield from (
                Job(Path(picture).stem, (picture,), options, picture) for picture in pictures
            )
        else:
            name = Path(path).relative_to(folder).as_posix()
            yield Job(name, tuple(pictures), options, path)
    for error in unread:
        yield faulty_job(error.filename, error.strerror or str(error), error.filename)
    if is_empty and not unread:
        text = "there is no photograph in this folder"
        if any(videos for _, videos in _photographs(folder, {**options, "frames": 1})):
            text += ", but there are videos: --frames 10 (frames=10) calibrates with frames of them"
        yield faulty_job(folder, text, folder)


def _grouped(
    paths: Iterable[str], pattern: re.Pattern[str], text: str, options: Mapping[str, Any]
) -> Iterator[Job]:
    cameras: dict[tuple[str, ...], list[str]] = {}
    ungrouped = 0
    for path in paths:
        if is_manifest(path):
            raise ValueError(
                f"{path}: a manifest names the cameras itself: leave out the pattern {text!r}"
            )
        whole = os.path.isdir(path)
        pictures = (
            (picture for _, found in _photographs(path, options) for picture in found)
            if whole
            else [path]
        )
        for picture in pictures:
            path_text = (
                Path(picture).relative_to(path).as_posix() if whole else Path(picture).as_posix()
            )
            found = pattern.fullmatch("/".join(path_text.split("/")[-1 - text.count("/") :]))
            if found is None:
                ungrouped += 1
            else:
                cameras.setdefault(found.groups(), []).append(picture)
    if not cameras:
        raise ValueError(f"none of {ungrouped} photographs has a name that matches {text!r}")
    names = Counter("_".join(groups) for groups in cameras)
    for groups, pictures in cameras.items():
        name = "_".join(groups)
        if names[name] > 1:  # different groups give the same joined name
            name = "_".join(f"({part})" for part in groups)
        yield Job(name, tuple(pictures), options, text)
    if ungrouped:
        yield faulty_job(
            text, f"{ungrouped} photographs have names that do not match this pattern", text
        )
