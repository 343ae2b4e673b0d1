"""`trisquare convert`: a camera from one program's file format to another's."""

from __future__ import annotations

import os
from pathlib import Path

from rich.console import RenderableType

from trisquare._support.paths import naming
from trisquare._support.writing import check_writable
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import named_numbers
from trisquare.cli.console import answer, line_of
from trisquare.cli.framework import reading
from trisquare.cli.options import JSON, QUIET, argument, flag, option, parse_size
from trisquare.formats.load_save import load_camera, save_camera
from trisquare.formats.registry import FORMAT_NAMES, FORMATS, format_called, format_of_name

CONVERSION_FORMAT = "trisquare-conversion/1"

EXAMPLES = (
    "trisquare convert camera.json camera_info.yaml",
    "trisquare convert camchain.yaml camera.json --camera cam1",
    "trisquare convert camera.json cameras.txt --to colmap --approximate",
    "trisquare convert camera.json half.json --rescale 640x480",
)

FORMATS_HELP = "; ".join(f"{known.name} is {known.title}" for known in FORMATS)


def convert_command(
    source: Path = argument(..., "IN", "A camera, or trisquare's result, as a file."),
    target: Path = argument(..., "OUT", "Where to write the camera.", allows_dash=True),
    from_format: str | None = option(
        None,
        "FORMAT",
        f"Format of IN; recognised by default. {FORMATS_HELP}.",
        "--from",
        offer=FORMAT_NAMES,
    ),
    to_format: str | None = option(
        None,
        "FORMAT",
        "Format of OUT; by default the one its name stands for: trisquare for .json, opencv for "
        ".yaml and .xml, and the programs' own for camera_info.yaml, camchain.yaml, cameras.txt, "
        "transforms.json, lensfun.xml, metashape.xml, .cameramodel and .pto.",
        "--to",
        offer=FORMAT_NAMES,
    ),
    camera: str | None = option(
        None, "NAME", "Which camera, if IN contains several: cam1, or COLMAP's id."
    ),
    size: str | None = option(None, "WxH", "Size of the picture, if IN does not state it."),
    approximate: bool = flag(
        "If the format has no model for the lens, use the nearest that it has.", "--approximate"
    ),
    rescale: str | None = option(
        None,
        "WxH",
        "Scale the camera to pictures of this size, if only the resolution differs.",
        "--rescale",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Convert a camera from one program's file format to another's."""
    check_writable(target)
    if os.path.realpath(source) == os.path.realpath(target):
        raise ValueError(f"{target}: would overwrite the input")
    known = format_of_name(target.name) if to_format is None else format_called(to_format)
    with reading():
        loaded = load_camera(
            source,
            from_format,
            name=camera,
            image_size=None if size is None else parse_size(size),
            approximate=approximate,
        )
    written = loaded.camera
    if rescale is not None:
        rescaled_size = parse_size(rescale)
        with naming(source):
            written = written.rescaled(rescaled_size)
    approximation = save_camera(written, target, known.name, approximate=approximate)
    members = {
        "format": CONVERSION_FORMAT,
        "from": loaded.format,
        "to": known.name,
        "name": loaded.name,
        "image_size": list(written.image_size),
        "camera": {"model": written.model, **named_numbers(written)},
        "read_approximation": _lost(loaded.approximation),
        "write_approximation": _lost(approximation),
    }
    width, height = written.image_size
    parts: list[RenderableType] = [
        f"{source} ({loaded.format}) -> {target} ({known.name}): {width} x {height}, "
        f"{written.model}"
    ]
    for verb, lost in (("read", loaded.approximation), ("written", approximation)):
        if lost is not None:
            parts.append(line_of(f"{verb} as the nearest lens: {lost}", "yellow"))
    parts.append(f"wrote {target}")
    answer(json, quiet, members, parts)


def _lost(approximation: Approximation | None) -> dict[str, object] | None:
    if approximation is None:
        return None
    return {
        "model": approximation.title,
        "rms_px": approximation.rms,
        "worst_px": approximation.worst,
    }
