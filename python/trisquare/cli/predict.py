"""`trisquare predict`: precision of a photograph, before it is taken."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
from rich.console import RenderableType

from trisquare._support.arrays import size_of_image
from trisquare._support.json_members import JsonFields
from trisquare._support.number_text import decimals_shown
from trisquare._support.paths import naming, read_text
from trisquare._support.rotations import tilt_degrees
from trisquare.analysis.plan import PlannedSquare
from trisquare.analysis.predict import Prediction, predict
from trisquare.camera.camera import Camera, camera_parameters, centred_pinhole, named_numbers
from trisquare.camera.lens_models import MODELS, checked_model
from trisquare.camera.settings import FIXABLE
from trisquare.cli.console import answer, new_table
from trisquare.cli.framework import reading
from trisquare.cli.input_files import camera_alone
from trisquare.cli.options import FREE, JSON, QUIET, argument, listed_names, option, parse_size

PLAN_FORMAT = "trisquare-plan/1"
PREDICTION_FORMAT = "trisquare-prediction/1"

EXAMPLES = (
    "trisquare predict --size 4000x3000 --focal 3200",
    "trisquare predict --camera camera.json --sigma 0.05 --model radial1",
    "trisquare predict plan.json --frame 0.6 --json",
)

# The default plan: three squares over the picture, as the documentation's page "Taking the
# photograph" recommends. Centres as fractions of the picture's longer and shorter side, directions
# in degrees; sides as fractions of the shorter one, of which the first that fits is used.
DEFAULT_SQUARES = ((0.23, 0.30, 0.0), (0.77, 0.30, 120.0), (0.50, 0.72, 240.0))
DEFAULT_TILT = 35.0
DEFAULT_SIDES = (0.36, 0.33, 0.30, 0.27, 0.24, 0.21, 0.18)
SQUARE_FIELDS = ("centre x", "centre y", "side", "tilt", "direction", "spin")


def predict_command(
    plan: Path | None = argument(None, "[PLAN]", "A plan as JSON; options override it."),
    size: str | None = option(None, "WxH", "Size of the picture in pixels, such as 1280x960."),
    focal: str | None = option(None, "PX", "Guess of the focal length; by default the width."),
    camera: Path | None = option(
        None, "FILE", "A camera, as convert reads it, instead of --size and --focal."
    ),
    square: list[str] | None = option(
        None,
        "X,Y,SIDE,TILT,DIRECTION[,SPIN]",
        "A square: its centre and side in pixels, or in % of the picture's width, height and "
        "height (25%,30%,35%,35,0); its tilt, the direction of the axis it is tilted about, and "
        "its spin in degrees. Repeatable; by default three that fill the picture.",
    ),
    frame: float | None = option(
        None, "PART", "Make all squares frames, with a hole of this part of their side."
    ),
    sigma: float | None = option(
        None,
        "PX",
        "Standard deviation of an edge sample, pixels. By default that of targets printed on "
        "paper, which are not quite flat: 2, and more in pictures wider than 1920; 0.02 for "
        "straight edges in a sharp picture, as rendered ones are.",
    ),
    spacing: float = option(1.0, "PX", "Edge length per sample, pixels."),
    model: str | None = option(
        None,
        "MODEL",
        "Lens model: one of the camera's own family, such as none, radial1, radial2, radial3 or "
        "brown.",
        offer=MODELS,
    ),
    fix: list[str] | None = option(
        None,
        "WHAT",
        "Parameters that will be fixed at the camera's values: aspect, principal_point, focal or "
        "distortion; repeatable, or with commas.",
        offer=FIXABLE,
    ),
    free: list[str] | None = FREE,
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Predict the standard deviations that a planned photograph will have."""
    if camera is not None and (size is not None or focal is not None):
        raise ValueError("--camera states the size and focal length: leave out --size and --focal")
    pixels = None if focal is None else _pixels(focal)
    if frame is not None and not 0.0 < frame < 1.0:
        raise ValueError(f"--frame must be between 0 and 1, not {frame:g}")
    stated = None if size is None else parse_size(size)
    known = None if camera is None else camera_alone(camera)
    written = None if plan is None else read_plan(plan)
    with nullcontext() if plan is None else naming(plan):
        guess = _pinhole(written, stated, pixels) if known is None else known
    planned = _planned_squares(square, plan, written, guess, frame)
    prediction = predict(
        guess,
        planned,
        sigma,
        spacing=spacing,
        model=None if model is None else checked_model(model),
        fix=listed_names(fix),
        free=listed_names(free),
    )
    answer(json, quiet, _members(prediction, planned), _report(prediction, planned))


def read_plan(plan: Path) -> JsonFields:
    """Return the members of a plan's file."""
    with reading():
        text = read_text(plan)
    with naming(plan):
        return JsonFields.parse(text, PLAN_FORMAT)


def _pixels(focal: str) -> float:
    """Return the focal length, which must be stated in pixels."""
    try:
        pixels = float(focal)
    except ValueError as error:
        raise ValueError(
            f"--focal must be a number of pixels, not {focal}: it is the focal length in mm, times "
            "the picture's width, over the sensor's width in mm"
        ) from error
    if not 0.0 < pixels < np.inf:
        raise ValueError(f"--focal must be positive, not {focal}")
    return pixels


def _pinhole(
    written: JsonFields | None, size: tuple[int, int] | None, focal: float | None
) -> Camera:
    """Return a pinhole with a size and a focal length; values that are None come from the plan."""
    if size is not None:
        width, height = size
    elif written is not None:
        width, height = size_of_image(written.integers("image_size"))
    else:
        raise ValueError("give the size of the picture (--size 1280x960), a --camera or a PLAN")
    if focal is None:
        focal = float(width) if written is None else written.number_or("focal", width)
    return centred_pinhole(focal, (width, height))


def _planned_squares(
    texts: list[str] | None,
    plan: Path | None,
    written: JsonFields | None,
    camera: Camera,
    frame: float | None,
) -> list[PlannedSquare]:
    """Return the squares of the options, or else those of the plan, or else the default ones."""
    if texts:
        return [_square(text, camera, frame) for text in texts]
    if plan is None or written is None:
        return _default_squares(camera, frame)
    with naming(plan):
        return [planned_square(fields, camera, frame) for fields in written.objects("squares")]


def _default_squares(camera: Camera, frame: float | None) -> list[PlannedSquare]:
    """Plan three squares as large as fit into the picture, in landscape or portrait format."""
    size = np.array(camera.image_size)
    order = [0, 1] if size[0] >= size[1] else [1, 0]
    planned = []
    for part in DEFAULT_SIDES:
        planned = [
            PlannedSquare.at(
                camera,
                tuple(((size - 1) * np.array(centre)[order]).tolist()),
                part * float(size.min()),
                tilt=DEFAULT_TILT,
                direction=direction,
                inner=frame,
            )
            for *centre, direction in DEFAULT_SQUARES
        ]
        if all(_is_in_picture(square, camera) for square in planned):
            break
    return planned


def _is_in_picture(planned: PlannedSquare, camera: Camera) -> bool:
    along = np.linspace(-0.5, 0.5, 9)
    across = np.full_like(along, 0.5)
    sides = [(along, across), (along, -across), (across, along), (-across, along)]
    outline = np.hstack([np.stack([x, y, np.zeros_like(x)]) for x, y in sides]).T
    try:
        pixels = camera.project(outline @ planned.rotation.T + planned.translation)
    except ValueError:  # outside the valid radius of the lens
        return False
    return bool((pixels >= 0.0).all() and (pixels <= np.array(camera.image_size) - 1.0).all())


def _square(text: str, camera: Camera, frame: float | None) -> PlannedSquare:
    """Parse X,Y,SIDE,TILT,DIRECTION[,SPIN]; the first three may be in per cent."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) not in (len(SQUARE_FIELDS) - 1, len(SQUARE_FIELDS)):
        raise ValueError(f"a square is written X,Y,SIDE,TILT,DIRECTION[,SPIN], not {text!r}")
    width, height = camera.image_size
    wholes = (width - 1.0, height - 1.0, float(height))
    numbers = []
    for index, (name, part) in enumerate(zip(SQUARE_FIELDS, parts, strict=False)):
        try:
            if index < len(wholes) and part.endswith("%"):
                numbers.append(float(part[:-1]) / 100.0 * wholes[index])
            else:
                numbers.append(float(part))
        except ValueError as error:
            raise ValueError(f"the {name} of the square {text!r} is not a number") from error
    x, y, side, tilt, direction, *spin = numbers
    return PlannedSquare.at(
        camera, (x, y), side, tilt=tilt, direction=direction, spin=sum(spin), inner=frame
    )


def planned_square(members: JsonFields, camera: Camera, frame: float | None) -> PlannedSquare:
    """Return a square of a plan; `frame` overrides the plan's hole."""
    x, y = members.array("centre", (2,)).tolist()
    inner = members.number_or("inner", 0.0) if frame is None else frame
    return PlannedSquare.at(
        camera,
        (x, y),
        members.number("side"),
        tilt=members.number("tilt"),
        direction=members.number("direction"),
        spin=members.number_or("spin", 0.0),
        inner=inner or None,
    )


def _members(prediction: Prediction, planned: list[PlannedSquare]) -> dict[str, object]:
    return {
        "format": PREDICTION_FORMAT,
        "image_size": list(prediction.camera.image_size),
        "sigma": prediction.sigma,
        "spacing": prediction.spacing,
        "camera": named_numbers(prediction.camera),
        "std": dict(prediction.std),
        "parameters": list(prediction.parameters),
        "covariance": prediction.covariance.tolist(),
        "squares": [
            {
                "rotation": square.rotation.tolist(),
                "translation": square.translation.tolist(),
                "inner": square.inner,
            }
            for square in planned
        ],
    }


def _report(prediction: Prediction, planned: list[PlannedSquare]) -> list[RenderableType]:
    table = new_table("parameter", right=("assumed", "predicted std"))
    values = camera_parameters(prediction.camera)
    for name, std in prediction.std.items():
        table.add_row(name, f"{values[name]:.6g}", f"{std:.{decimals_shown(std)}f}")
    width, height = prediction.camera.image_size
    tilts = ", ".join(f"{tilt_degrees(square.rotation):.0f}" for square in planned)
    summary = (
        f"{width} x {height}, {len(planned)} squares tilted by {tilts} degrees, "
        f"edges sampled every {prediction.spacing:g} px, each sample known to "
        f"{prediction.sigma:.3g} px (--sigma)"
    )
    return [table, summary]
