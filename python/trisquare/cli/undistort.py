"""`trisquare undistort`: photographs without their lens's distortion."""

from __future__ import annotations

import json as json_text
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from trisquare._support.paths import naming
from trisquare._support.suggestions import unknown
from trisquare._support.writing import write_in_turn
from trisquare.camera.camera import Camera
from trisquare.camera.members import camera_members
from trisquare.cli.console import JsonOption, QuietOption, check_printing, progress_bar
from trisquare.cli.input_files import camera_alone
from trisquare.cli.options import completing
from trisquare.cli.pictures_drawn import check_outputs, numbered_paths
from trisquare.images.encoding import encode_image
from trisquare.images.pixels import Image, picture_size
from trisquare.images.reading import read_image
from trisquare.undistortion.undistort import INTERPOLATIONS, Undistorter

UNDISTORTION_FORMAT = "trisquare-undistortion/1"

EXAMPLES = (
    "trisquare undistort photo.jpg --camera camera.json -o straight.jpg",
    "trisquare undistort frame-*.png --camera camera.json -o straight/ --balance 0.5",
    "trisquare undistort small.png --camera camera.json -o straight.png --rescale",
)

DEEP_FORMATS = {
    "uint16": (".png", ".tif", ".tiff", ".jp2", ".pgm", ".ppm", ".pnm", ".pxm"),
    "float32": (".tif", ".tiff"),
}
"""Formats that keep such pixels; OpenCV would cut them down to 8 bits in any other."""


def undistort_command(
    photos: Annotated[
        list[Path],
        typer.Argument(metavar="PHOTO", help="One photograph, or several of the same camera."),
    ],
    camera: Annotated[
        Path, typer.Option(metavar="FILE", help="The camera, in any format that convert reads.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help=(
                "Write the picture to this file. With several photographs, FILE.png becomes "
                "FILE-1.png, FILE-2.png, ...; in a folder, each keeps its own name."
            ),
        ),
    ],
    balance: Annotated[
        float,
        typer.Option(metavar="0..1", help="From 0 (no black border) to 1 (all of the photograph)."),
    ] = 0.0,
    rescale: Annotated[
        bool,
        typer.Option(
            "--rescale",
            help=(
                "Scale the camera to photographs of another resolution but the same aspect "
                "ratio: fx' = s fx, cx' = s (cx + 1/2) - 1/2."
            ),
        ),
    ] = False,
    interpolation: Annotated[
        str,
        typer.Option(
            metavar="HOW",
            autocompletion=completing(INTERPOLATIONS),
            help="linear, nearest, cubic or lanczos.",
        ),
    ] = "linear",
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Remove the lens distortion from photographs; none is written unless all can be."""
    check_printing(json, quiet)
    if output.is_dir():
        paths = [output / photo.name for photo in photos]
    else:
        paths = numbered_paths(output, len(photos))
    check_outputs([*photos, camera], None, paths)
    if interpolation not in INTERPOLATIONS:  # not to be said of the first photograph
        raise unknown("interpolation", interpolation, INTERPOLATIONS)
    lens = camera_alone(camera)
    work = _Work(lens, balance, rescale, interpolation)
    with progress_bar("undistorting", quiet) as progress:
        write_in_turn(work.all_undistorted(photos, paths, progress))
    if json:
        members = {"format": UNDISTORTION_FORMAT, "balance": balance, "pictures": work.members}
        print(json_text.dumps(members, indent=2, allow_nan=False))
    elif not quiet:
        for line in work.lines():
            print(line)


class _Work:
    """Undistorts one photograph after the other, and remembers what became of each."""

    def __init__(self, camera: Camera, balance: float, rescale: bool, interpolation: str) -> None:
        self._rescale, self._interpolation, self._balance = rescale, interpolation, balance
        # Whatever is wrong with camera or balance shall not wait for a photograph.
        self._camera, self._undistorter = camera, Undistorter(camera, balance)
        self.members: list[dict[str, Any]] = []

    def all_undistorted(
        self,
        photos: Sequence[Path],
        paths: Sequence[Path],
        progress: Callable[[int, int], None] | None,
    ) -> Iterator[tuple[Path, bytes]]:
        """Undistort one photograph when the one before has been taken care of."""
        for done, (photo, path) in enumerate(zip(photos, paths, strict=True)):
            if progress is not None:
                progress(done, len(photos))
            yield path, self.undistorted(photo, path)

    def undistorted(self, photo: Path, path: Path) -> bytes:
        """Return the content of the file at `path`."""
        picture = read_image(photo)
        _check_depth(picture, path)
        with naming(photo):
            self._prepare(picture)
            undistorted = self._undistorter.undistort(picture, interpolation=self._interpolation)
        new_camera = self._undistorter.new_camera
        self.members.append(
            {
                "photo": str(photo),
                "output": str(path),
                "image_size": list(new_camera.image_size),
                "camera": camera_members(new_camera),
                "valid_rectangle": list(self._undistorter.valid_rectangle),
            }
        )
        return encode_image(undistorted, path)

    def _prepare(self, picture: Image) -> None:
        """Make another map if the photograph is of another size than the one before."""
        size = picture_size(picture)
        if self._rescale and size != self._undistorter.camera.image_size:
            self._undistorter = Undistorter(self._camera.rescaled(size), self._balance)

    def lines(self) -> Iterator[str]:
        """Say what was written, and of which camera, once for those that have the same."""
        before = None
        for member in self.members:
            camera = member["camera"]
            if camera != before:
                width, height = member["image_size"]
                x, y, valid_width, valid_height = member["valid_rectangle"]
                numbers = ", ".join(f"{name} {camera[name]:.6g}" for name in ("fx", "fy"))
                centre = ", ".join(f"{name} {camera[name]:.6g}" for name in ("cx", "cy"))
                yield f"new camera, without distortion: {width} x {height}, {numbers}, {centre}"
                yield (
                    f"no black pixel in the rectangle from ({x}, {y}) of "
                    f"{valid_width} x {valid_height}"
                )
            before = camera
            yield f"wrote {member['output']}"


def _check_depth(picture: Image, path: Path) -> None:
    """Refuse a format that would lose what the photograph's pixels hold."""
    formats = DEEP_FORMATS.get(str(picture.dtype))
    if formats is not None and path.suffix.lower() not in formats:
        raise ValueError(
            f"{path}: this format does not hold {picture.dtype} pixels; choose among "
            f"{', '.join(formats)}"
        )
