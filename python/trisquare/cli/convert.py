"""`trisquare convert`: a camera from one program's file format to another's."""

from __future__ import annotations

import json as json_text
import os
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from trisquare._support.writing import check_writable
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import camera_parameters
from trisquare.cli.console import JsonOption, QuietOption, check_printing
from trisquare.cli.framework import reading
from trisquare.cli.options import completing, parse_size
from trisquare.formats.load_save import Loaded, load_camera, save_camera
from trisquare.formats.registry import FORMAT_NAMES, FORMATS, format_called, format_of_name

CONVERSION_FORMAT = "trisquare-conversion/1"

EXAMPLES = (
    "trisquare convert camera.json camera_info.yaml",
    "trisquare convert camchain.yaml camera.json --camera cam1",
    "trisquare convert camera.json cameras.txt --to colmap --approximate",
)

FORMATS_HELP = "; ".join(f"{known.name} is {known.title}" for known in FORMATS)


def convert_command(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="A camera, or trisquare's result, as a file.")
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="Where to write the camera.")],
    from_format: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="FORMAT",
            autocompletion=completing(FORMAT_NAMES),
            help=f"Format of IN; recognised by default. {FORMATS_HELP}.",
        ),
    ] = None,
    to_format: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            autocompletion=completing(FORMAT_NAMES),
            help=(
                "Format of OUT; by default the one its name stands for: trisquare for .json, "
                "opencv for .yaml and .xml, and the programs' own for camera_info.yaml, "
                "camchain.yaml, cameras.txt, transforms.json, .cameramodel and .pto."
            ),
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Which camera, if IN holds several: cam1, or COLMAP's id."
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Size of the picture, if IN does not state it."),
    ] = None,
    approximate: Annotated[
        bool,
        typer.Option(
            "--approximate",
            help="If the format has no model for the lens, use the nearest that it has.",
        ),
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Convert a camera from one program's file format to another's."""
    check_printing(json, quiet)
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
    approximation = save_camera(loaded.camera, target, known.name, approximate=approximate)
    if json:
        members = _members(loaded, known.name, approximation)
        print(json_text.dumps(members, indent=2, allow_nan=False))
    elif not quiet:
        _print_report(source, target, loaded, known.name, approximation)


def _members(
    loaded: Loaded, written_format: str, approximation: Approximation | None
) -> dict[str, object]:
    return {
        "format": CONVERSION_FORMAT,
        "from": loaded.format,
        "to": written_format,
        "name": loaded.name,
        "image_size": list(loaded.camera.image_size),
        "camera": {"model": loaded.camera.model, **camera_parameters(loaded.camera)},
        "read_approximation": _lost(loaded.approximation),
        "write_approximation": _lost(approximation),
    }


def _lost(approximation: Approximation | None) -> dict[str, object] | None:
    if approximation is None:
        return None
    return {
        "model": approximation.title,
        "rms_px": approximation.rms,
        "worst_px": approximation.worst,
    }


def _print_report(
    source: Path,
    target: Path,
    loaded: Loaded,
    written_format: str,
    approximation: Approximation | None,
) -> None:
    width, height = loaded.camera.image_size
    console = Console()
    line = f"{source} ({loaded.format}) -> {target} ({written_format})"
    console.print(Text(f"{line}: {width} x {height}, {loaded.camera.model}"), soft_wrap=True)
    for verb, lost in (("read", loaded.approximation), ("written", approximation)):
        if lost is not None:
            note = Text(f"{verb} as the nearest lens: {lost}", style="yellow")
            console.print(note, soft_wrap=True)
