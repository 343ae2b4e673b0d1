"""Reading cameras from files of any format, and writing them."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from trisquare._support.arrays import size_of_image, string
from trisquare._support.paths import File, naming, shown
from trisquare._support.writing import write_text
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import Camera
from trisquare.errors import LensModelError
from trisquare.formats import native_json
from trisquare.formats.approximation import ANY_BROWN, Lens, nearest
from trisquare.formats.base import Cameras, Format, ImageSize
from trisquare.formats.document import Document
from trisquare.formats.registry import format_called, format_of_document, format_of_name

MAX_NAMES = 5


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """A camera from a file.

    Parameters
    ----------
    camera : Camera
        The camera.
    format : str
        The format of the file.
    name : str
        Name of the camera in the file, ``"camera"`` if it has none.
    approximation : Approximation or None
        The approximation, if `Camera` does not have the model of the file's lens.
    """

    camera: Camera
    format: str
    name: str
    approximation: Approximation | None = None


def load_camera(
    path: File,
    format: str | None = None,
    *,
    name: str | None = None,
    image_size: tuple[int, int] | None = None,
    approximate: bool = False,
) -> Loaded:
    """Read a camera; see `Camera.load`."""
    known = None if format is None else format_called(format)
    size = None if image_size is None else size_of_image(image_size)
    return camera_of_document(
        Document.read(path), path, known, name=name, size=size, approximate=approximate
    )


def camera_of_document(
    document: Document,
    path: File,
    known: Format | None = None,
    *,
    name: str | None = None,
    size: ImageSize | None = None,
    approximate: bool = False,
) -> Loaded:
    """Read a camera from a document, as `Camera.load`; `path` is used in messages."""
    with naming(path):
        found = format_of_document(document) if known is None else known
        try:
            chosen, lens = _chosen(found.read(document, size), name, path)
        except ArithmeticError as error:
            raise ValueError("contains numbers that are too large or too small") from error
        if size is not None and lens.image_size != size:
            raise ValueError(f"its pictures have {lens.image_size} pixels, not {size}")
        if isinstance(lens, Camera):
            return Loaded(lens, found.name, chosen)
    try:
        stand_in = nearest(lens, ANY_BROWN)
    except ValueError as error:
        raise LensModelError(f"{shown(path)}: {lens.title}: {error}") from error
    camera = stand_in.lens
    if not approximate:
        raise LensModelError(
            f"{shown(path)}: {lens.title} is not a lens model of trisquare; the nearest "
            f"is {stand_in}: read that one with approximate=True (trisquare convert --approximate)",
            stand_in.lens,
            stand_in.rms,
            stand_in.worst,
        )
    assert isinstance(camera, Camera)
    return Loaded(camera, found.name, chosen, stand_in)


def _chosen(cameras: Cameras, name: str | None, path: File) -> tuple[str, Lens]:
    if name is not None:
        if string(name, "name") not in cameras:
            raise ValueError(f"there is no camera {name!r}, but {_listed(cameras)}")
        return name, cameras[name]()
    if len(cameras) > 1:
        advice = f"there are {len(cameras)} cameras, {_listed(cameras)}: choose one with name="
        if isinstance(path, str | os.PathLike):
            advice += f", or take one out: {_extraction(path, next(iter(cameras)))}"
        raise ValueError(advice)
    ((only, read),) = cameras.items()
    return only, read()


def _extraction(path: File, name: str) -> str:
    """Return the command that extracts one of several cameras: no other has ``--camera``."""
    words = ["trisquare", "convert", shown(path), "one.json", "--camera", name]
    return shlex.join(words)


def _listed(cameras: Cameras) -> str:
    shown = list(cameras)[:MAX_NAMES]
    return ", ".join(shown) + (
        f" and {len(cameras) - MAX_NAMES} more" if len(cameras) > MAX_NAMES else ""
    )


def save_camera(
    camera: Camera,
    path: File,
    format: str | None = None,
    *,
    approximate: bool = False,
) -> Approximation | None:
    """Write a camera; see `Camera.save`."""
    known = _format_to_write(path, format)
    suffix = Path(path).suffix.lower() if isinstance(path, str | os.PathLike) else ""
    text, approximation = written(camera, known, suffix, approximate)
    write_text(path, text)
    return approximation


def is_own(path: File, format: str | None) -> bool:
    """Return whether `save_camera` would write trisquare's own JSON, which may also have results.

    Raises
    ------
    TypeError, ValueError
        If the format is unknown, or is None and the name implies none.
    """
    return _format_to_write(path, format) is native_json.FORMAT


def _format_to_write(path: File, format: str | None) -> Format:
    if format is not None:
        return format_called(format)
    if not isinstance(path, str | os.PathLike):
        return native_json.FORMAT
    return format_of_name(Path(path).name)


def written(
    camera: Camera, known: Format, suffix: str, approximate: bool
) -> tuple[str, Approximation | None]:
    """Return a file's text, and the approximation of the camera in it, if any.

    Raises
    ------
    LensModelError
        If the format has no model for the camera and `approximate` is not set, or there is no
        approximation.
    """
    for family in known.families:
        lens = family.exactly(camera)
        if lens is not None:
            return known.write(lens, suffix), None
    fitted = [family for family in known.families if family.is_polynomial]
    families = [family for family in fitted if family.is_of(camera)]
    most_general = (families or fitted)[-1]
    skew = f", skew {camera.skew:.3g} px" if camera.skew else ""
    cannot = f"{known.title} cannot store this camera (model {camera.model}{skew})"
    try:
        stand_in = nearest(camera, most_general)
    except ValueError as error:
        raise LensModelError(f"{cannot}: {error}") from error
    if not approximate:
        raise LensModelError(
            f"{cannot}; the nearest camera that it can store is {stand_in}: write that one with "
            "approximate=True (trisquare convert --approximate)",
            stand_in.lens,
            stand_in.rms,
            stand_in.worst,
        )
    return known.write(stand_in.lens, suffix), stand_in
