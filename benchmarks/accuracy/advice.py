"""Print the table of the advice in docs/photograph.md: `benchmarks/accuracy/advice.py`.

Predicted standard deviations for one ordinary camera, with one property changed at a time.
"""

from __future__ import annotations

import numpy as np

import trisquare as ts
from trisquare.analysis.plan import PlannedSquare

SIGMA = 0.02  # pixels per pixel of edge: noise 2 of contrast 175, blur 0.7 px
WIDTH, HEIGHT = 1280, 960
FOCAL = 1100.0  # pixels
NAMES = ("fx", "cx", "k1")

TILTS = (10, 15, 20, 25, 35, 45, 55)  # degrees
SIZES = (10, 15, 20, 25, 30, 36, 42)  # per cent of the height
SPREADS = (40, 60, 80, 100)  # per cent of the usual distance from the centre
COUNTS = (2, 3, 4, 5, 6)

TILT, SIZE = 35.0, 0.36
# Centres of the squares by their number, as fractions of the picture.
PLACES = {
    2: ((0.27, 0.5), (0.73, 0.5)),
    3: ((0.23, 0.3), (0.77, 0.3), (0.5, 0.72)),
    4: ((0.23, 0.27), (0.77, 0.27), (0.77, 0.73), (0.23, 0.73)),
    5: ((0.18, 0.25), (0.82, 0.25), (0.82, 0.75), (0.18, 0.75), (0.5, 0.5)),
    6: ((0.18, 0.27), (0.5, 0.27), (0.82, 0.27), (0.82, 0.73), (0.5, 0.73), (0.18, 0.73)),
}
# Tilt directions over which a row is averaged, so that the table holds for any tilt directions.
PHASES = np.arange(0.0, 120.0, 10.0)


def main() -> None:
    """Print the table as Markdown."""
    print(f"Three squares of {SIZE:.0%} of the height, tilted {TILT:g} degrees, unless stated.")
    print("| change | std fx px | std cx px | std k1 |\n| --- | --- | --- | --- |")
    for tilt in TILTS:
        _row(f"tilt {tilt} degrees", tilt=tilt)
    for size in SIZES:
        _row(f"side {size} % of the height", size=size / 100)
    for spread in SPREADS:
        _row(f"side 25 %, {spread} % as far from the centre", size=0.25, spread=spread / 100)
    for count in COUNTS:
        _row(f"{count} squares, side 25 %", count=count, size=0.25)
    _row("frames instead of squares", inner=0.6)
    _row("the aspect fixed", fix=("aspect",))
    _row("frames, the aspect fixed", inner=0.6, fix=("aspect",))
    _row("two squares, the aspect fixed", count=2, fix=("aspect",))


def _row(name: str, **change: object) -> None:
    found = []
    for phase in PHASES:
        try:
            std = _std(phase, **change)  # type: ignore[arg-type]
        except ts.DegenerateGeometryError:
            continue
        except ValueError:
            continue  # does not fit into the picture with that tilt direction
        found.append([std[key] for key in NAMES])
    if len(found) < len(PHASES) / 2:
        print(f"| {name} | refused | | |")
        return
    fx, cx, k1 = np.sqrt(np.mean(np.square(found), axis=0))
    print(f"| {name} | {fx:.2f} | {cx:.2f} | {k1:.5f} |")


def _std(
    phase: float,
    *,
    tilt: float = TILT,
    size: float = SIZE,
    spread: float = 1.0,
    count: int = 3,
    inner: float | None = None,
    fix: tuple[str, ...] = (),
) -> dict[str, float]:
    K = [[FOCAL, 0.0, 0.5 * (WIDTH - 1)], [0.0, FOCAL, 0.5 * (HEIGHT - 1)], [0.0, 0.0, 1.0]]
    camera = ts.Camera(np.array(K), np.array([-0.15, 0.03, 0, 0, 0]), (WIDTH, HEIGHT))
    # Two squares tilt in directions 90 degrees apart, more squares in directions all round.
    step = 90.0 if count == 2 else 360.0 / count
    squares = []
    for number, place in enumerate(PLACES[count]):
        centre = 0.5 + spread * (np.array(place) - 0.5)
        squares.append(
            PlannedSquare.at(
                camera,
                tuple(centre * [WIDTH, HEIGHT]),
                size * HEIGHT,
                tilt=tilt,
                direction=phase + step * number,
                spin=20.0 + 35.0 * number,
                inner=inner,
            )
        )
    return dict(ts.predict(camera, squares, SIGMA, fix=fix).std)


if __name__ == "__main__":
    main()
