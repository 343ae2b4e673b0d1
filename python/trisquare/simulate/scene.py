"""The truth of a scene: a camera, the flat targets in front of it, and their exact images.

Pure numpy, sharing no code with the Rust core, so that it is an independent check of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import FloatArray, real_array

Array: TypeAlias = FloatArray

# Newton on the distortion converges quadratically; 1e-13 is the rounding error of a normalised
# coordinate near 1, and a radius inside the monotonic range needs under 20 steps.
UNDISTORT_TOLERANCE = 1e-13
UNDISTORT_STEPS = 50
# Number of chords over which the arc length of a side's image is summed: for a bend of 20 px it is
# exact to 1e-4 of itself, and the error only moves the samples along their own edge.
ARC_CHORDS = 200


@dataclass(frozen=True, slots=True, eq=False)
class TrueCamera:
    """A pinhole camera with Brown distortion, in OpenCV's conventions.

    Parameters
    ----------
    fx, fy, cx, cy : float
        Focal lengths and principal point, pixels.
    distortion : array_like, shape (5,)
        ``k1, k2, p1, p2, k3``, from ideal to observed normalised coordinates.
    image_size : tuple of int
        Width and height, pixels.
    skew : float
        ``K[0, 1]``, pixels.
    """

    COEFFICIENTS: ClassVar[tuple[str, ...]] = ("k1", "k2", "p1", "p2", "k3")
    """Names of the distortion coefficients."""

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    image_size: tuple[int, int] = (1280, 960)
    skew: float = 0.0

    def __post_init__(self) -> None:
        shape = (len(self.COEFFICIENTS),)
        object.__setattr__(self, "distortion", real_array(self.distortion, "distortion", shape))

    @property
    def K(self) -> Array:  # noqa: N802 (the field's name)
        """Camera matrix, shape (3, 3)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def pixels(self, observed: Array) -> Array:
        """Map observed normalised coordinates to pixels, shape (N, 2)."""
        pixels = observed * [self.fx, self.fy] + [self.cx, self.cy]
        pixels[..., 0] += self.skew * observed[..., 1]
        return pixels

    def observed(self, pixels: npt.ArrayLike) -> Array:
        """Map pixels to observed normalised coordinates, shape (N, 2)."""
        observed = (np.asarray(pixels, dtype=np.float64) - [self.cx, self.cy]) / [self.fx, self.fy]
        observed[..., 0] -= self.skew / self.fx * observed[..., 1]
        return observed

    def distort(self, normalised: Array) -> Array:
        """Map ideal to observed normalised coordinates, shape (N, 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = normalised[..., 0], normalised[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def project(self, points: Array) -> Array:
        """Project points of the camera frame, shape (N, 3), to pixels, shape (N, 2)."""
        return self.pixels(self.distort(points[..., :2] / points[..., 2:]))

    def undistort(self, pixels: npt.ArrayLike) -> Array:
        """Map pixels to ideal normalised coordinates, shape (N, 2), by Newton's method.

        Raises
        ------
        ValueError
            If a pixel lies where the distortion cannot be inverted.
        """
        observed = self.observed(pixels)
        ideal = observed.copy()
        for _ in range(UNDISTORT_STEPS):
            error = observed - self.distort(ideal)
            xx, xy, yy = self._distortion_jacobian(ideal)
            determinant = xx * yy - xy * xy
            step = np.stack(
                [yy * error[..., 0] - xy * error[..., 1], xx * error[..., 1] - xy * error[..., 0]],
                axis=-1,
            )
            step /= np.where(determinant > 0.0, determinant, np.inf)[..., None]
            ideal += step
            if np.all(np.abs(step) < UNDISTORT_TOLERANCE) and np.all(determinant > 0.0):
                return ideal
        raise ValueError("a pixel lies beyond the radius where the distortion can be inverted")

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """Return directions ``(x, y, 1)`` of pixels, shape (N, 2), as shape (N, 3).

        Raises
        ------
        ValueError
            If a pixel lies where the distortion cannot be inverted.
        """
        ideal = self.undistort(pixels)
        return np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)

    def sees(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which points of the camera frame, shape (N, 3), are seen, shape (N,).

        These are in front, where the radial distortion grows all the way from the axis.
        """
        k1, k2, _, _, k3 = self.distortion
        ahead = points[:, 2] > 0.0
        ideal = points[:, :2] / np.where(ahead, points[:, 2], 1.0)[:, None]
        r2 = np.linspace(0.0, 1.0, 50)[:, None] * np.sum(ideal**2, axis=1)
        slope = 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3))
        return np.asarray(ahead & np.all(slope > 0.0, axis=0))

    def _distortion_jacobian(self, ideal: Array) -> tuple[Array, Array, Array]:
        """Return entries xx, xy (= yx) and yy of the derivative of `distort`."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
        xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        return xx, xy, yy

    def is_monotonic(self, slack: float = 1.1) -> bool:
        """Return whether the radial distortion grows `slack` times beyond the farthest corner."""
        k1, k2, _, _, k3 = self.distortion
        width, height = self.image_size
        far_x = max(self.cx, width - 1 - self.cx) / self.fx
        far_y = max(self.cy, height - 1 - self.cy) / self.fy
        wanted = slack * np.hypot(far_x, far_y)
        ideal = np.linspace(0.0, 4.0 * wanted, 2000)
        observed = ideal * (1.0 + ideal**2 * (k1 + ideal**2 * (k2 + ideal**2 * k3)))
        falls = np.flatnonzero(np.diff(observed) <= 0.0)
        peak = observed[falls[0]] if falls.size else observed[-1]
        return bool(peak > wanted)


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A flat figure in front of the camera.

    The plane's unit is the side of the square (of one cell for a chessboard), the figure is
    centred at the origin and Z points away from the camera. Corners of a square are numbered
    (-1/2, -1/2), (1/2, -1/2), (1/2, 1/2), (-1/2, 1/2), clockwise on the screen; side i runs
    from corner i to corner i + 1.

    Parameters
    ----------
    rotation, translation : array_like, shapes (3, 3) and (3,)
        ``cam_from_plane``.
    kind : {"square", "frame", "chessboard"}
        Solid square, square with a square hole, or chessboard.
    dark : bool
        Dark figure on light ground, or the reverse.
    inner : float
        Side of a frame's hole, in units of its outer side.
    inner_corners : tuple of int
        Columns and rows of a chessboard's inner corners.
    printed : array_like, shape (4, 2), optional
        Corners of the outline if it is not an exact square, plane units.
    rim : float, optional
        Width of the paper beyond the figure on every side, plane units; 0 for a board that is cut
        along its cells. If it is not given, `render` draws a random one if there is to be paper.
    """

    rotation: Array
    translation: Array
    kind: Literal["square", "frame", "chessboard"] = "square"
    dark: bool = True
    inner: float = 0.6
    inner_corners: tuple[int, int] = (9, 6)
    printed: Array | None = None
    rim: float | None = None

    def __post_init__(self) -> None:
        shapes = {"rotation": (3, 3), "translation": (3,), "printed": (4, 2)}
        for name, shape in shapes.items():
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, real_array(value, name, shape))
        if self.rotation[:, 2] @ self.translation <= 0.0:
            raise ValueError(
                "the target is seen from behind: its Z must point away from the camera"
            )

    def to_camera(self, plane_points: npt.ArrayLike) -> Array:
        """Map plane points, shape (N, 2), into the camera frame, shape (N, 3)."""
        points = np.asarray(plane_points, dtype=np.float64)
        return points @ self.rotation[:, :2].T + self.translation

    @property
    def is_board(self) -> bool:
        """Whether it has cells in rows and columns."""
        return self.kind == "chessboard"

    @property
    def extent(self) -> tuple[float, float]:
        """Half width and half height of the whole figure, plane units."""
        if not self.is_board:
            half_width, half_height = np.abs(self.outlines()[0]).max(axis=0).tolist()
            return half_width, half_height
        columns, rows = self.inner_corners
        return 0.5 * (columns + 1), 0.5 * (rows + 1)

    def outlines(self) -> list[Array]:
        """Return the outer and, for a frame, inner square: corners, plane units, each (4, 2)."""
        outer = rectangle(0.5, 0.5) if self.printed is None else np.array(self.printed)
        if self.is_board:
            outer = rectangle(*self.extent)
        return [outer, self.inner * outer] if self.kind == "frame" else [outer]

    def figure(self) -> Iterator[tuple[float, list[Side]]]:
        """Yield the signs and the sides of convex quadrilaterals whose sum is the figure."""
        if self.is_board:
            for centre in self.cells(0):
                yield 1.0, sides_of(centre + rectangle(0.5, 0.5))
            return
        yield from zip((1.0, -1.0), self.outline_sides(), strict=False)

    def sides(self) -> list[Side]:
        """Return the outlines' sides; for a chessboard its inner corners' rows, then columns."""
        if not self.is_board:
            return [side for sides in self.outline_sides() for side in sides]
        columns, rows = self.inner_corners
        corners = self.board_corners().reshape(rows, columns, 2)
        lines = (*corners, *corners.swapaxes(0, 1))
        return [Side(line[0], line[-1]) for line in lines]

    def outline_sides(self) -> list[list[Side]]:
        """Return the sides of each of `outlines`."""
        return [sides_of(outline) for outline in self.outlines()]

    def cells(self, colour: int) -> Iterator[Array]:
        """Yield the middles of a board's dark (0) or light (1) cells, row by row, in cells."""
        columns, rows = self.inner_corners
        for row in range(rows + 1):
            for column in range((row + colour) % 2, columns + 1, 2):
                yield np.array([column - 0.5 * columns, row - 0.5 * rows])

    def board_corners(self) -> Array:
        """Return a chessboard's inner corners, row by row, plane units, (columns * rows, 2)."""
        columns, rows = self.inner_corners
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        return np.asarray(grid - [0.5 * (columns - 1), 0.5 * (rows - 1)])


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The truth of one picture: the camera and the targets it sees."""

    camera: TrueCamera
    targets: tuple[Target, ...]

    def image_points(self, target: int, plane_points: npt.ArrayLike) -> Array:
        """Project points of one target's plane, shape (N, 2), to pixels, shape (N, 2)."""
        return self.camera.project(self.targets[target].to_camera(plane_points))


def rectangle(half_width: float, half_height: float) -> Array:
    """Return corners of a centred rectangle, clockwise on the screen from (-, -), (4, 2)."""
    return np.array(
        [
            [-half_width, -half_height],
            [half_width, -half_height],
            [half_width, half_height],
            [-half_width, half_height],
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """A side of a figure, from corner to corner in plane units."""

    start: Array
    end: Array

    def points(self, fraction: Array) -> Array:
        """Return points at fractions of the chord, shape (N, 2)."""
        points: Array = self.start + fraction[:, None] * (self.end - self.start)
        return points


def sides_of(corners: Array) -> list[Side]:
    """Return the sides of a quadrilateral, corners (4, 2) clockwise on the screen."""
    return [Side(*ends) for ends in zip(corners, np.roll(corners, -1, axis=0), strict=True)]


class SideSamples(NamedTuple):
    """Points spread evenly over the image of one side of a figure."""

    plane: Array  # plane units, shape (N, 2)
    image: Array  # pixels, shape (N, 2)
    normal: Array  # inward unit normals in the image, shape (N, 2)
    length: float  # of the side's image, pixels


def sample_sides(camera: TrueCamera, target: Target, spacing: float) -> list[SideSamples]:
    """Sample a figure's sides, or a board's grid lines, `spacing` pixels apart.

    Each side is cut into equal pieces and sampled in their middles; a grid line runs between the
    outermost crossings.
    """
    return [_sample_side(camera, target, side, spacing) for side in target.sides()]


def _sample_side(camera: TrueCamera, target: Target, side: Side, spacing: float) -> SideSamples:
    """Sample one side at equal arc lengths of its image."""

    def seen(fraction: Array) -> Array:
        return camera.project(target.to_camera(side.points(fraction)))

    fraction = np.linspace(0.0, 1.0, ARC_CHORDS + 1)
    arc = np.append(0.0, np.cumsum(np.hypot(*np.diff(seen(fraction), axis=0).T)))
    count = max(int(arc[-1] / spacing), 1)
    at = np.interp((np.arange(count) + 0.5) / count * arc[-1], arc, fraction)
    ahead, behind = seen(at + 1e-4), seen(at - 1e-4)
    tangent = (ahead - behind) / np.hypot(*(ahead - behind).T)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    return SideSamples(side.points(at), seen(at), normal, float(arc[-1]))
