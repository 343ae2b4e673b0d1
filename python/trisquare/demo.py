"""The bundled example: a rendered photograph of three squares whose camera is known."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from trisquare.calibrate import calibrate
from trisquare.camera import Camera, camera_from_members
from trisquare.detect import detect
from trisquare.files import encode_image, read_image, write_atomically, writing
from trisquare.json_fields import JsonFields
from trisquare.overlay import draw_overlay
from trisquare.result import Calibration

TRUTH_FORMAT = "trisquare-demo/1"


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """What the example gave.

    Parameters
    ----------
    calibration : Calibration
        The estimate from the photograph alone.
    truth : Camera
        The camera that the photograph was rendered with.
    written : tuple of Path
        The camera file and the overlay.
    """

    calibration: Calibration
    truth: Camera
    written: tuple[Path, Path]


def run_demo(folder: Path) -> Demo:
    """Calibrate the bundled photograph and write ``camera.json`` and ``overlay.png``.

    Parameters
    ----------
    folder : Path
        Where to write; made if it is missing.

    Raises
    ------
    OSError
        If the folder cannot be made or written to.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    data = resources.files("trisquare") / "data"
    truth = JsonFields.parse((data / "demo.json").read_text("utf-8"), TRUTH_FORMAT)
    with resources.as_file(data / "demo.png") as photograph:
        image = read_image(photograph)
    calibration = calibrate(image)
    overlay = draw_overlay(image, calibration, detect(image))
    camera_path, overlay_path = folder / "camera.json", folder / "overlay.png"
    write_atomically(
        {
            camera_path: calibration.to_json().encode(),
            overlay_path: encode_image(overlay, overlay_path),
        }
    )
    return Demo(
        calibration=calibration,
        truth=camera_from_members(truth.object("camera"), truth.integers("image_size")),
        written=(camera_path, overlay_path),
    )
