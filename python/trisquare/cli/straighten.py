"""`trisquare straighten`: a photograph without distortion, by its own straight lines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from trisquare._support.number_text import with_its_std
from trisquare._support.paths import naming
from trisquare._support.writing import PathLike, write_atomically
from trisquare.camera.camera import Camera
from trisquare.camera.lens_models import is_fisheye
from trisquare.cli.camera_file import camera_content, camera_format
from trisquare.cli.console import answer, coded_lines, texts_and_codes
from trisquare.cli.options import BALANCE, JSON, QUIET, argument, option
from trisquare.cli.pictures_drawn import check_depth, check_outputs
from trisquare.drawing.straight_lines import draw_straight_lines
from trisquare.images.drawn_mark import encode_drawn
from trisquare.images.encoding import encode_turned
from trisquare.images.reading import read_photograph
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.straightening.straighten import Straightened, straighten
from trisquare.undistortion.undistort import INTERPOLATIONS, checked_interpolation

STRAIGHTENING_FORMAT = "trisquare-straightening/1"

SHORTEST = 0.1
"""Minimum focal length over the picture's longer side: below it, a fisheye would see more than a
full turn."""

EXAMPLES = (
    "trisquare straighten photo.jpg -o straight.jpg",
    "trisquare straighten photo.jpg -o straight.png --overlay lines.png --balance 1",
    "trisquare straighten photo.jpg -o straight.png --save-camera camera.json --focal 1100",
)


def straighten_command(
    photo: Path = argument(..., "PHOTO", "A photograph with long straight edges."),
    output: Path = option(..., "FILE", "Write the picture to this file.", "--output", "-o"),
    overlay: Path | None = option(
        None, "FILE", "Draw the lines used (green) and the edges rejected (red) to this file."
    ),
    balance: float = BALANCE,
    interpolation: str = option(
        "linear", "HOW", "linear, nearest, cubic or lanczos.", offer=INTERPOLATIONS
    ),
    save_camera: Path | None = option(
        None,
        "FILE",
        "Write the camera of the photograph to this file, in the format of its name, as convert "
        "does; for undistort and others. It is a pinhole with k1 to k3 "
        "or a fisheye, whichever is nearer. Needs --focal.",
    ),
    focal: float | None = option(
        None,
        "PX",
        "Focal length, in pixels, of the written camera: straight lines do not determine it.",
    ),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Remove the lens distortion from a photograph by its straight lines, without a target."""
    check_outputs([photo], [output, overlay], [save_camera])
    _check_camera_options(save_camera, focal)
    resampling = checked_interpolation(interpolation)
    picture, tag = read_photograph(photo)
    check_depth(picture, output)
    _check_focal(focal, max(picture.shape[:2]))
    with naming(photo):
        found = straighten(picture)
        straight = found.undistort(picture, balance, interpolation=resampling)
    encoded, missed = encode_turned(straight, output, tag)
    warnings = [] if missed is None else [CalibrationWarning(missed, "orientation_lost")]
    files: dict[PathLike, bytes] = {output: encoded}
    if overlay is not None:
        drawn = draw_straight_lines(picture, found.used, found.rejected, f"rms {found.rms:.2f} px")
        files[overlay] = encode_drawn(drawn, overlay)
    camera = None if focal is None else found.camera.camera(focal)
    if save_camera is not None and camera is not None:
        files[save_camera] = camera_content(camera, save_camera)
    write_atomically(files)
    members = {
        "format": STRAIGHTENING_FORMAT,
        "photo": str(photo),
        "output": str(output),
        **_members(found),
        "camera_file": None if save_camera is None else str(save_camera),
        **texts_and_codes(warnings),
    }
    lines = [*_lines(found), *_written_lines(files, save_camera, camera)]
    answer(json, quiet, members, lines, coded_lines(warnings))


def _check_camera_options(save_camera: Path | None, focal: float | None) -> None:
    """Check that a camera is written with a focal length, in a known format."""
    if (save_camera is None) != (focal is None):
        raise ValueError(
            "--save-camera and --focal go together: straight lines do not determine the focal "
            "length, which is in pixels"
        )
    if save_camera is not None:
        camera_format(save_camera)


def _check_focal(focal: float | None, longer_side: int) -> None:
    """Refuse a focal length that is probably in millimetres."""
    if focal is not None and focal < SHORTEST * longer_side:
        raise ValueError(
            f"--focal {focal:g} is in pixels: no lens has so few for a picture of "
            f"{longer_side} (divide millimetres by the size of a pixel)"
        )


def _members(found: Straightened) -> dict[str, Any]:
    camera = found.camera
    return {
        "image_size": list(camera.image_size),
        "family": camera.family,
        "coefficients": camera.coefficients.tolist(),
        "centre": camera.centre.tolist(),
        "radius": camera.radius,
        "covariance": camera.covariance.tolist(),
        "focal_length": None,
        "centre_held": found.centre_held,
        "used": len(found.used),
        "rejected": len(found.rejected),
        "rms": found.rms,
    }


def _lines(found: Straightened) -> Iterator[str]:
    """Yield lines on the lines used and on the lens."""
    camera = found.camera
    yield (
        f"{len(found.used)} straight lines, rms {found.rms:.2g} px; "
        f"{len(found.rejected)} edges rejected"
    )
    std = camera.std
    values = (*camera.coefficients.tolist(), *camera.centre.tolist())
    texts = [with_its_std(value, std[name]) for name, value in zip(std, values, strict=True)]
    numbers = [
        f"{name} {text} +- {std_text}" for name, (text, std_text) in zip(std, texts, strict=True)
    ]
    yield f"{camera.family} model, in half diagonals: {', '.join(numbers[:-2])}"
    if found.centre_held:
        (x, y), known = camera.centre.tolist(), " and ".join(std_text for _, std_text in texts[-2:])
        yield (
            f"centre of distortion, px: cx {x:.6g}, cy {y:.6g}, fixed at the picture's centre: the "
            f"lines determine it only to {known} px"
        )
    else:
        yield f"centre of distortion, px: {', '.join(numbers[-2:])}"
    map_ = camera.displacement_map()
    largest = (map_.displacement**2).sum(axis=1).argmax()
    moved, std_text = with_its_std(
        *(float((each[largest] ** 2).sum()) ** 0.5 for each in (map_.displacement, map_.std))
    )
    yield f"largest displacement {moved} +- {std_text} px"


def _written_lines(
    files: Iterable[PathLike], save_camera: Path | None, camera: Camera | None
) -> Iterator[str]:
    """Yield a line for each file, with the model of the camera, if one is written."""
    if camera is None:
        option = "--save-camera FILE --focal PX"
        yield f"focal length: unknown, straight lines do not determine it ({option})"
    for path in files:
        if camera is None or path != save_camera:
            yield f"wrote {path}"
        else:
            use = " (of OpenCV: cv2.fisheye)" if is_fisheye(camera.model) else ""
            yield f"wrote {path}, a camera of the model {camera.model}{use}"
