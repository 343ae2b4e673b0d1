"""The input of a calibration: measured edges of plane figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from functools import partial
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, cast, get_args

import numpy as np
import numpy.typing as npt

from trisquare._core import family_lines, rectangle_lines
from trisquare._support.arrays import (
    ComparedByValue,
    FloatArray,
    index_number,
    pixel_array,
    real_array,
    real_number,
    sequence,
    string,
    whole_number,
)
from trisquare._support.json_members import JsonFields, dump_members
from trisquare.errors import NotEnoughDataError

Freedom: TypeAlias = Literal["auto", "fixed", "size", "similarity", "aspect", "offsets", "line"]

EDGES_FORMAT = "trisquare-edges/1"

# Blurs are some pixels at most, and a tone curve displaces an edge by no more than its blur.
MAX_DRIFT = 10.0

# The image of a circle, an ellipse, has five parameters.
MIN_CIRCLE_SAMPLES = 5

LEAVE_OUT = ": leave out the samples that were not measured"
"""Advice about samples that are NaN or infinite."""

# Two samples are always on a straight line.
MIN_SCENE_LINE_SAMPLES = 3

# Tolerance within which a normal counts as a unit normal: dividing by a norm that differs from 1
# only by rounding would change the digits on every trip through JSON or pickle.
UNIT_NORM_SLACK = 4 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True, eq=False)
class PlaneEdges(ComparedByValue):
    """The edges of one plane figure: model lines or circles, and the samples along each.

    Parameters
    ----------
    lines : array_like, shape (L, 3), L >= 4
        The figure's lines ``(a, b, c)`` in its own coordinates, ``a x + b y + c = 0``; stored with
        ``a^2 + b^2 = 1``. Circles have none, shape (0, 3).
    points : sequence of L array_like, shape (N_i, 2), N_i >= 2
        Samples ``(x, y)`` on the image of each line, or circle (N_i >= 5), in pixels of the
        photograph.
    std : float or sequence of L array_like, shape (N_i,), optional
        One standard deviation of each sample across its line, in pixels, or one number for all.
        Only ratios matter for the estimate; without them all samples have the same weight.
    polarity : {+1, -1}, optional
        +1 if the figure's inside is dark, -1 if it is light, None if unknown.
    plane : int, optional
        Figures of one picture with equal `plane` lie on one physical plane; a figure with None has
        a plane of its own.
    image : int
        Index of the picture in which the figure was measured.
    kind : str
        Name of the figure in results.
    freedom : {"auto", "fixed", "size", "similarity", "aspect", "offsets", "line"}
        Unknowns of a *further* figure on a shared plane; the plane's first figure defines the
        plane's coordinates, and for it only "aspect", "offsets" and "line" have a meaning.

        - ``"fixed"``: none, its lines are given in the plane's coordinates (0 unknowns);
        - ``"size"``: its size about the common centre (1 unknown), as of a frame's second outline;
        - ``"similarity"``: size, rotation and position (4 unknowns);
        - ``"auto"``: ``"size"`` if it is concentric with the plane's first figure, else
          ``"similarity"``;
        - ``"aspect"``, for the only figure on its plane: its extent along X, as of a rectangle of
          unknown aspect (1 unknown, in the result's `Plane.aspect`);
        - ``"offsets"``, for the only figure on its plane: the positions of all lines, which run
          along X or along Y, as from `families`;
        - ``"line"``: everything; the one line is anywhere in space and on no plane, as from `line`.
    drift : sequence of L array_like, shape (N_i, 2), optional
        Displacement of each sample, in pixels, by one standard deviation of an error that all
        samples of a picture share: that of an estimated tone curve.
    border : float, optional
        Width of the plain border within a square's outline, in units of its coordinates; further
        inside is other content, such as the bits of a tag. None if it is unknown.
    radii : sequence of (float or None), optional
        Radii of circles about the origin, for a figure of circles instead of lines, see `circles`.
        Radii that are None are estimated; the first one must be known.

    Raises
    ------
    TypeError
        If something is not a number, or not of the type stated above.
    ValueError
        For wrong shapes or lengths, NaN or infinity, a line without direction, ``std <= 0``.
    NotEnoughDataError
        For fewer than four lines, a line with fewer than two distinct points, a line of the scene
        with fewer than three, or a circle with fewer than five points.

    Examples
    --------
    >>> unit_square = [[0, 1, 0.5], [-1, 0, 0.5], [0, -1, 0.5], [1, 0, 0.5]]
    >>> t = np.linspace(0, 1, 20)[:, None]
    >>> corners = np.array([[210, 95], [430, 120], [405, 330], [190, 300]], float)
    >>> sides = [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    >>> edges = ts.PlaneEdges(unit_square, sides)
    >>> edges.kind, len(edges.points)
    ('square', 4)
    """

    lines: FloatArray
    points: tuple[FloatArray, ...]
    std: tuple[FloatArray, ...] | None = None
    _: KW_ONLY
    polarity: int | None = None
    plane: int | None = None
    image: int = 0
    kind: str = "square"
    freedom: Freedom = "auto"
    drift: tuple[FloatArray, ...] | None = None
    border: float | None = None
    radii: tuple[float | None, ...] | None = None

    if TYPE_CHECKING:  # the constructor accepts more types than the attributes have

        def __init__(
            self,
            lines: npt.ArrayLike,
            points: Sequence[npt.ArrayLike],
            std: Sequence[npt.ArrayLike] | float | None = None,
            *,
            polarity: int | None = None,
            plane: int | None = None,
            image: int = 0,
            kind: str = "square",
            freedom: Freedom = "auto",
            drift: Sequence[npt.ArrayLike] | None = None,
            border: float | None = None,
            radii: Sequence[float | None] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        if self.radii is None:
            lines = _unit_normal_lines(self.lines, 1 if self.freedom == "line" else 4)
            points = _samples_of_lines(self.points, len(lines))
        else:
            lines = real_array(self.lines, "lines", (0, 3))
            object.__setattr__(self, "radii", _checked_radii(self.radii))
            points = _samples_of_circles(self.points, len(self.radii))
        std = None if self.std is None else _deviations_of_lines(self.std, points)
        object.__setattr__(self, "lines", lines)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "std", std)
        if self.drift is not None:
            object.__setattr__(self, "drift", _drift_of_lines(self.drift, points))
        if self.border is not None:
            border = real_number(self.border, "border")
            if border <= 0.0:
                raise ValueError(f"border must be positive, not {border:g}")
            object.__setattr__(self, "border", border)
        if self.polarity is not None:
            polarity = whole_number(self.polarity, "polarity")
            if polarity not in (1, -1):
                raise ValueError(f"polarity must be +1, -1 or None, not {polarity}")
            object.__setattr__(self, "polarity", polarity)
        if self.plane is not None:
            object.__setattr__(self, "plane", whole_number(self.plane, "plane"))
        object.__setattr__(self, "image", index_number(self.image, "image"))
        string(self.kind, "kind")
        if string(self.freedom, "freedom") not in get_args(Freedom):
            raise ValueError(
                f"freedom must be one of {get_args(Freedom)}, not {self.freedom!r:.60}"
            )
        if self.radii is not None and self.freedom in ("aspect", "line"):
            raise ValueError(f'freedom must not be "{self.freedom}" for circles')
        if self.freedom == "line":
            _check_line(self.points, self.plane)

    @classmethod
    def square(
        cls,
        sides: Sequence[Any],
        std: Sequence[Any] | float | None = None,
        *,
        polarity: int | None = None,
        plane: int | None = None,
        image: int = 0,
        kind: str = "square",
        freedom: Freedom = "auto",
    ) -> PlaneEdges:
        """Create the edges of a square from the samples of its four sides.

        The square has unit side and is centred at the origin, X runs along side 0 from corner 0
        to corner 1, and Z points away from the camera; corner ``i`` is where the sides ``i - 1``
        and ``i`` meet.

        Parameters
        ----------
        sides : sequence of four array_like, shape (N_i, 2)
            Samples of the sides in order round the square, in either direction; the samples of one
            side may be in any order.
        std, polarity, plane, image, kind, freedom
            As in `PlaneEdges`.

        Raises
        ------
        ValueError
            Also if the sides are not in order round one convex quadrilateral.

        Examples
        --------
        >>> t = np.linspace(0, 1, 20)[:, None]
        >>> corners = np.array([[210, 95], [430, 120], [405, 330], [190, 300]], float)
        >>> sides = [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
        >>> ts.PlaneEdges.square(sides, polarity=1).polarity
        1
        """
        return cls.rectangle(
            sides,
            1.0,
            std,
            polarity=polarity,
            plane=plane,
            image=image,
            kind=kind,
            freedom=freedom,
        )

    @classmethod
    def rectangle(
        cls,
        sides: Sequence[Any],
        aspect: float | None,
        std: Sequence[Any] | float | None = None,
        *,
        polarity: int | None = None,
        plane: int | None = None,
        image: int = 0,
        kind: str = "rectangle",
        freedom: Freedom = "auto",
    ) -> PlaneEdges:
        """Create the edges of a rectangle from the samples of its four sides.

        As `square`, but the unit is the shorter side or, if the aspect is unknown, side 1.

        Parameters
        ----------
        sides, std, polarity, plane, image, kind, freedom
            As in `square`.
        aspect : float or None
            Length of side 0 over that of side 1; None if it is to be estimated, which leaves one
            equation for the camera instead of two.

        Raises
        ------
        ValueError
            Also if the aspect is not positive.

        Examples
        --------
        >>> t = np.linspace(0, 1, 20)[:, None]
        >>> corners = np.array([[210, 95], [430, 120], [405, 330], [190, 300]], float)
        >>> sides = [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
        >>> ts.PlaneEdges.rectangle(sides, aspect=1.5).kind
        'rectangle'
        """
        if aspect is None:
            aspect, freedom = 1.0, "aspect"
        aspect = real_number(aspect, "aspect")
        if aspect <= 0.0:
            raise ValueError(f"aspect must be positive, not {aspect:g}")
        sides = sequence(sides, "sides", "four arrays")
        if len(sides) < 4:
            raise NotEnoughDataError(f"a {kind} needs its 4 sides, not {len(sides)}")
        if len(sides) == 8:
            raise ValueError(
                f"a {kind} has 4 sides, not 8: a frame is two squares on one plane, "
                "square(sides[:4], plane=0) and square(sides[4:], plane=0)"
            )
        points = _samples_of_lines(sides, 4)
        return cls(
            rectangle_lines(points, aspect),
            points,
            cast("Any", std),
            polarity=polarity,
            plane=plane,
            image=image,
            kind=kind,
            freedom=freedom,
        )

    @classmethod
    def families(
        cls,
        along_x: Sequence[Any],
        along_y: Sequence[Any],
        std: Sequence[Any] | float | None = None,
        *,
        polarity: int | None = None,
        plane: int | None = None,
        image: int = 0,
        kind: str = "facade",
    ) -> PlaneEdges:
        """Create the edges of two families of parallel lines, at right angles on one plane.

        An example is a facade, if nothing is known about the lines' positions: they are estimated,
        and one equation for the camera remains, as for a `rectangle` of unknown aspect. The
        outermost two lines of each family form a rectangle: the plane's origin is its centre, its
        extent along Y is the unit, and `Plane.aspect` its extent along X. X points from the
        outermost line of `along_y` that is given first to the other one, and Z away from the
        camera.

        Parameters
        ----------
        along_x, along_y : sequence of 2 or more array_like, shape (N_i, 2)
            Samples of the lines of each family.
        std : float or sequence of array_like, shape (N_i,), optional
            As in `PlaneEdges`, for the lines of `along_x`, then for those of `along_y`.
        polarity, plane, image, kind
            As in `PlaneEdges`.

        Raises
        ------
        ValueError
            Also if two lines of a family cross between their samples' ends.
        NotEnoughDataError
            Also if a family has fewer than two lines.

        Examples
        --------
        >>> t = np.linspace(0, 1, 20)[:, None]
        >>> along_x = [[100, y] + t * [500, 20] for y in (100, 200, 300)]
        >>> along_y = [[x, 80] + t * [10, 300] for x in (150, 350, 550)]
        >>> len(ts.PlaneEdges.families(along_x, along_y).points)
        6
        """
        along_x = sequence(along_x, "along_x", "arrays, one per line")
        along_y = sequence(along_y, "along_y", "arrays, one per line")
        points = _samples_of_lines([*along_x, *along_y], len(along_x) + len(along_y))
        return cls(
            family_lines(points[: len(along_x)], points[len(along_x) :]),
            points,
            cast("Any", std),
            polarity=polarity,
            plane=plane,
            image=image,
            kind=kind,
            freedom="offsets",
        )

    @classmethod
    def circles(
        cls,
        points: Sequence[Any],
        radii: Sequence[float | None] | None = None,
        std: Sequence[Any] | float | None = None,
        *,
        polarity: int | None = None,
        plane: int | None = None,
        image: int = 0,
        kind: str = "circles",
        freedom: Freedom = "auto",
    ) -> PlaneEdges:
        """Create the edges of concentric circles from the samples of each.

        The origin is their centre and Z points away from the camera; the direction of X is
        arbitrary. The image of a circle has five parameters, and so has the pose of a circle whose
        radius is the unit: one circle alone gives no equation for the camera, and is refused. A
        second one about the same centre adds five numbers, and one unknown if its radius is
        unknown; two of the remaining numbers are equations for the camera, as for a square, and the
        others (three, or two) must hold for any camera.

        On the plane of an earlier figure in the list (of equal `plane`) one circle is enough: its
        size and position are three unknowns, and two equations remain. Two single circles of one
        plane are also enough, side by side or about one centre: of ten numbers, the pose takes
        five, the second circle's size and position three, and two remain for the camera.

        Parameters
        ----------
        points : sequence of array_like, shape (N_i, 2), N_i >= 5
            Samples of each circle, in any order.
        radii : sequence of (float or None), optional
            Their radii, in any unit, which is then the plane's. By default the first circle's
            radius is the unit and the others are estimated, as are radii that are None, which the
            first must not be; the result has them as `Plane.radii`.
        std, polarity, plane, image, kind, freedom
            As in `PlaneEdges`.

        Raises
        ------
        ValueError
            Also if radii are not positive, or equal, or the first is None.

        Examples
        --------
        >>> t = np.linspace(0, 6.2, 60)
        >>> ring = np.column_stack([np.cos(t), 0.8 * np.sin(t)])
        >>> rings = [ring * radius + [400, 300] for radius in (50, 100)]
        >>> ts.PlaneEdges.circles(rings, radii=[1, 2]).radii
        (1.0, 2.0)
        """
        circles = sequence(points, "points", "arrays, one per circle")
        if radii is None:
            radii = (1.0, *[None] * (len(circles) - 1))
        return cls(
            np.empty((0, 3)),
            tuple(circles),
            cast("Any", std),
            polarity=polarity,
            plane=plane,
            image=image,
            kind=kind,
            freedom=freedom,
            radii=cast("Any", radii),
        )

    @classmethod
    def line(cls, points: Any, std: Any = None, *, image: int = 0) -> PlaneEdges:
        """Create the edge of a straight line at an unknown position in space.

        Its image does not constrain the camera matrix, but its straightness constrains the lens's
        distortion and its centre. `calibrate_edges` uses it in addition to squares, if it is
        consistent with them; the result has it in `Calibration.lines`.

        Parameters
        ----------
        points : array_like, shape (N, 2), N >= 3
            Samples of its image, in any order, pixels.
        std : float or array_like, shape (N,), optional
            As in `PlaneEdges`.
        image : int
            As in `PlaneEdges`.

        Raises
        ------
        NotEnoughDataError
            If there are fewer than three points.
        TypeError, ValueError
            As in `PlaneEdges`.

        Examples
        --------
        >>> points = [[100, 20.1], [300, 21.4], [500, 22.0], [700, 22.1]]
        >>> ts.PlaneEdges.line(points).freedom
        'line'
        """
        return cls(
            np.array([[0.0, 1.0, 0.0]]),
            (points,),
            cast("Any", std if std is None or isinstance(std, Real) else (std,)),
            image=image,
            kind="line",
            freedom="line",
        )

    def __reduce__(self) -> tuple[Any, ...]:
        rebuild = partial(
            type(self),
            polarity=self.polarity,
            plane=self.plane,
            image=self.image,
            kind=self.kind,
            freedom=self.freedom,
            drift=self.drift,
            border=self.border,
            radii=self.radii,
        )
        return rebuild, (self.lines, self.points, self.std)

    def __repr__(self) -> str:
        counts = ", ".join(str(len(points)) for points in self.points)
        inside = {1: "dark inside, ", -1: "light inside, "}.get(self.polarity or 0, "")
        plane = "" if self.plane is None else f"plane {self.plane}, "
        curves = "lines" if self.radii is None else "circles"
        return (
            f"<PlaneEdges {self.kind}: {len(self.points)} {curves} with {counts} samples, "
            f"{inside}{plane}image {self.image}>"
        )

    def to_json(self) -> str:
        """Return the edges as JSON text that `from_json` reads back exactly.

        Examples
        --------
        >>> import json
        >>> (first, *others) = ts.detect("photo.jpg")
        >>> json.loads(first.to_json())["format"]
        'trisquare-edges/1'
        """
        return dump_members({"format": EDGES_FORMAT, **edges_members(self)})

    @classmethod
    def from_json(cls, text: str) -> PlaneEdges:
        """Read the JSON that `to_json` wrote, or text of that format from elsewhere.

        Only `format`, `lines` and `points` are required: other members that are missing or null
        have the defaults of `PlaneEdges`.

        Raises
        ------
        ValueError
            If the text is not JSON, or a key, which is named, is missing or of the wrong type.
        NotEnoughDataError
            As in `PlaneEdges`.

        Examples
        --------
        >>> (first, *others) = ts.detect("photo.jpg")
        >>> ts.PlaneEdges.from_json(first.to_json()).kind
        'frame'
        """
        return edges_from_members(JsonFields.parse(text, EDGES_FORMAT))


def edges_members(edges: PlaneEdges) -> dict[str, Any]:
    """Return the members of the JSON format."""
    return {
        "kind": edges.kind,
        "image": edges.image,
        "plane": edges.plane,
        "polarity": edges.polarity,
        "freedom": edges.freedom,
        "lines": edges.lines.tolist(),
        "points": [points.tolist() for points in edges.points],
        "std": None if edges.std is None else [std.tolist() for std in edges.std],
        **({} if edges.drift is None else {"drift": [drift.tolist() for drift in edges.drift]}),
        **({} if edges.border is None else {"border": edges.border}),
        **({} if edges.radii is None else {"radii": list(edges.radii)}),
    }


def edges_from_members(members: JsonFields) -> PlaneEdges:
    """Read the members of the JSON format; missing ones have the defaults of `PlaneEdges`."""
    read = {
        "std": lambda key: members.arrays(key, (None,)),
        "polarity": members.integer,
        "plane": members.integer,
        "image": members.integer,
        "kind": members.text,
        "freedom": members.text,
        "drift": lambda key: members.arrays(key, (None, 2)),
        "border": members.number,
        "radii": members.numbers_or_null,
    }
    given: dict[str, Any] = {key: value(key) for key, value in read.items() if members.has(key)}
    return PlaneEdges(
        members.array("lines", (None, 3)), members.arrays("points", (None, 2)), **given
    )


_DEFAULTS = {field.name: field.default for field in fields(PlaneEdges)}


def unchecked_edges(**members: Any) -> PlaneEdges:
    """Create edges from members that are known to be valid, without checking or copying.

    For edges that the core measured or that were checked before. The arrays are made read-only.
    """
    edges = object.__new__(PlaneEdges)
    for name, default in _DEFAULTS.items():
        object.__setattr__(edges, name, members.pop(name, default))
    if members:
        raise TypeError(f"PlaneEdges has no {', '.join(members)}")
    edges.lines.flags.writeable = False
    for arrays in (edges.points, edges.std or (), edges.drift or ()):
        for array in arrays:
            array.flags.writeable = False
    return edges


def changed_edges(edges: PlaneEdges, **changes: Any) -> PlaneEdges:
    """Return edges with some members changed, unchecked as in `unchecked_edges`."""
    members = {name: getattr(edges, name) for name in _DEFAULTS}
    return unchecked_edges(**{**members, **changes})


def _check_line(points: tuple[FloatArray, ...], plane: int | None) -> None:
    """Check that a figure is a valid line of the scene."""
    if len(points) != 1 or plane is not None:
        raise ValueError('freedom "line" takes the points of one line, and plane=None')
    if len(points[0]) < MIN_SCENE_LINE_SAMPLES:
        raise NotEnoughDataError(
            f"points[0] contains {len(points[0])} points: a line of the scene needs at "
            f"least {MIN_SCENE_LINE_SAMPLES}, for two are always straight"
        )


def _unit_normal_lines(lines: Any, least: int) -> FloatArray:
    given = real_array(lines, "lines", (None, 3))
    if len(given) < least:
        requirement = "a line" if least == 1 else f"at least {least} lines, not {len(given)}"
        raise NotEnoughDataError(f"a figure needs {requirement}")
    norms = np.hypot(given[:, 0], given[:, 1])
    if not (norms > 0).all():
        raise ValueError(f"line {int(np.argmin(norms))} has no direction: a and b are both zero")
    norms[np.abs(norms - 1) <= UNIT_NORM_SLACK] = 1.0
    with np.errstate(over="ignore"):  # an infinite offset is refused below
        unit = given / norms[:, None]
    return real_array(unit, "lines", (None, 3))


def _sequence(values: Any, name: str, count: int) -> list[Any]:
    arrays = sequence(values, name, "arrays, one per line")
    if len(arrays) != count:
        raise ValueError(f"{name} must contain {count} arrays, one per line, not {len(arrays)}")
    return arrays


def _samples_of_lines(points: Any, count: int) -> tuple[FloatArray, ...]:
    samples = []
    for index, given in enumerate(_sequence(points, "points", count)):
        name = f"points[{index}]"
        if hasattr(given, "__len__") and len(given) == 0:
            raise NotEnoughDataError(f"{name} is empty: a line needs at least 2 points")
        array = pixel_array(given, name, (None, 2), LEAVE_OUT)
        low, high = array.min(axis=0, initial=np.inf), array.max(axis=0, initial=-np.inf)
        if not (low < high).any():
            raise NotEnoughDataError(
                f"{name} contains only one distinct point: a line needs at least 2"
            )
        samples.append(array)
    return tuple(samples)


def _checked_radii(radii: Any) -> tuple[float | None, ...]:
    given = [
        None if radius is None else real_number(radius, "radii")
        for radius in sequence(radii, "radii", "numbers")
    ]
    if not given:
        raise NotEnoughDataError("circles need one radius or more")
    known = [radius for radius in given if radius is not None]
    if given[0] is None:
        raise ValueError("radii[0] must be known: it is the unit of length, and may be 1")
    if min(known) <= 0.0 or len(set(known)) < len(known):
        raise ValueError(f"radii must be positive and different, not {known}")
    return tuple(given)


def _samples_of_circles(points: Any, count: int) -> tuple[FloatArray, ...]:
    samples = _samples_of_lines(points, count)
    for index, array in enumerate(samples):
        if len(array) < MIN_CIRCLE_SAMPLES:
            raise NotEnoughDataError(
                f"points[{index}] contains {len(array)} points: a circle needs at "
                f"least {MIN_CIRCLE_SAMPLES}"
            )
    return samples


def _deviations_of_lines(std: Any, points: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    if isinstance(std, Real):
        std = [np.full(len(side), real_number(std, "std")) for side in points]
    deviations = []
    for index, given in enumerate(_sequence(std, "std", len(points))):
        array = real_array(given, f"std[{index}]", (len(points[index]),))
        if not (array > 0).all():
            raise ValueError(f"std[{index}] must be positive")
        deviations.append(array)
    return tuple(deviations)


def _drift_of_lines(drift: Any, points: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    displacements = []
    for index, given in enumerate(_sequence(drift, "drift", len(points))):
        array = real_array(given, f"drift[{index}]", (len(points[index]), 2))
        if not (np.abs(array) <= MAX_DRIFT).all():
            raise ValueError(f"drift[{index}] contains displacements beyond {MAX_DRIFT:g} px")
        displacements.append(array)
    return tuple(displacements)
