"""`trisquare compare`: how far apart two cameras project."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare._support.writing import write_atomically
from trisquare.analysis.comparison import Comparison, compare, two_digits
from trisquare.camera.camera_of import camera_of
from trisquare.cli.console import answer
from trisquare.cli.framework import UnreadableInputError
from trisquare.cli.input_files import of_size, read_camera
from trisquare.cli.options import JSON, QUIET, argument, flag, option
from trisquare.cli.pictures_drawn import check_outputs
from trisquare.drawing.difference_map import draw_comparison
from trisquare.images.drawn_mark import encode_drawn

ASSUMED = (
    "photographs of their own for each camera, and flat targets: on printed paper, repeated "
    "calibrations differ by up to twice their stated standard deviations; to choose a lens model, "
    "use --model auto"
)

EXAMPLES = (
    "trisquare compare today.json last_month.json",
    "trisquare compare camera.json camera_info.yaml --map difference.png",
    "trisquare compare full.json half.json --rescale --json",
    "trisquare compare today.json last_month.json --json --grid",
)


def compare_command(
    first: Path = argument(
        ..., "A", "The first camera file; differences are in pixels of its pictures."
    ),
    second: Path = argument(..., "B", "The second camera file."),
    map_file: Path | None = option(None, "FILE", "Draw the differences over the picture.", "--map"),
    rescale: bool = flag(
        "Scale B to the pictures of A, if only the resolution differs.", "--rescale"
    ),
    grid: bool = flag("With --json, also the differences on a grid over the picture.", "--grid"),
    json: bool = JSON,
    quiet: bool = QUIET,
) -> None:
    """Compare two cameras: how far apart they project, and whether uncertainties explain it.

    The rotation between the two cameras that fits best is taken out first: a camera matrix cannot
    tell it from a turn of the camera.

    p says how often two calibrations of one camera differ at least so much, if each has photographs
    of its own. Paper that is not flat makes p too small: see "How far to trust it" in
    docs/how-exact.md.

    The exit code does not depend on how far apart they are; with --json, p_value is p.
    """
    for path in (first, second):
        if path.is_dir():
            raise UnreadableInputError(
                f"{path}: a folder, where a camera file is needed. 'Compare two nights', in the "
                "documentation of batch, has the loop for two folders"
            )
    if grid and not json:
        raise ValueError("--grid is for --json; --map FILE draws the differences")
    check_outputs([first, second], [map_file])
    first_camera = read_camera(first)
    lens = camera_of(first_camera)
    both = f"{second}, compared with {first}"
    second_camera = of_size(read_camera(second), lens.image_size, rescale, both)
    comparison = compare(first_camera, second_camera)
    if map_file is not None:
        write_atomically({map_file: encode_drawn(draw_comparison(comparison), map_file)})
    written = [] if map_file is None else [f"wrote {map_file}"]
    members = comparison.members() | (_grid_members(comparison) if grid else {})
    answer(json, quiet, members, [*_lines(comparison), *written])


def _grid_members(comparison: Comparison) -> dict[str, Any]:
    return {
        "x": comparison.x.tolist(),
        "y": comparison.y.tolist(),
        "distance_px": _finite_or_none(comparison.distance),
        "std_px": None if comparison.std is None else _finite_or_none(comparison.std),
    }


def _finite_or_none(grid: FloatArray) -> list[list[float | None]]:
    """Return the values on a grid, None in place of infinity, which JSON does not have."""
    return [[value if np.isfinite(value) else None for value in row] for row in grid.tolist()]


def _lines(comparison: Comparison) -> Iterator[str]:
    yield comparison.verdict
    if comparison.same is False:
        yield f"p assumes {ASSUMED}"
    yield f"rotation between them: {two_digits(comparison.angle)} degrees (taken out)"
    if comparison.coverage < 1:
        yield f"compared over {100 * comparison.coverage:.0f} % of the picture"
