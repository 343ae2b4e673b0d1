"""The nearest lens of a family that a file format can hold, and how far off it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import trisquare._core as _core
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import Camera, CoreCamera, camera_for_core, camera_parameters
from trisquare.formats.other_lenses import ForeignLens, camera_of

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3")

Lens: TypeAlias = "Camera | ForeignLens"


class Family(Protocol):
    """The lenses that one model of a file format can say."""

    @property
    def title(self) -> str:
        """The model's name in the format, and its coefficients."""

    @property
    def free(self) -> tuple[str, ...]:
        """The coefficients it has, by the core's names."""

    @property
    def square(self) -> bool:
        """Whether it has one focal length only."""

    def exactly(self, camera: Camera) -> object | None:
        """Return the camera as the family has it, None if it has not."""

    def lens(
        self,
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        image_size: tuple[int, int],
    ) -> object:
        """Return the lens of these parameters."""


@dataclass(frozen=True, slots=True)
class BrownFamily:
    """Cameras of `Camera`'s own model with some of its numbers tied.

    Parameters
    ----------
    title : str
        The model's name in the format, and its coefficients.
    free : tuple of str
        The coefficients it has, of ``k1 k2 p1 p2 k3``; the others are zero.
    square : bool
        Whether it has one focal length only.
    """

    title: str
    free: tuple[str, ...]
    square: bool = False

    def exactly(self, camera: Camera) -> Camera | None:
        """Return the camera itself if all that it has is free."""
        values = camera_parameters(camera)
        missing = any(values[name] for name in COEFFICIENTS if name not in self.free)
        return None if missing or (self.square and camera.fx != camera.fy) else camera

    def lens(
        self,
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        image_size: tuple[int, int],
    ) -> Camera:
        """Return the camera."""
        named = dict(zip(self.free, coefficients, strict=True))
        return camera_of(focal, centre, named, image_size)


ANY_CAMERA = BrownFamily("brown (k1, k2, p1, p2, k3)", COEFFICIENTS)
"""All that a `Camera` can be."""


def nearest(lens: Lens, family: Family) -> Approximation:
    """Fit a family's lens to another one over its picture, by least squares of pixels.

    Both keep the same axis: no rotation is fitted, so that poses stay what they were.

    Raises
    ------
    ValueError
        If less than half the picture has directions ahead of the camera, or the nearest lens
        folds back within it.
    """
    if isinstance(lens, Camera):
        given: CoreCamera | tuple[list[float], str, Sequence[float]] = camera_for_core(lens)
    else:
        (fx, _, cx), (_, fy, cy), _ = lens.K.tolist()
        given = ([fx, fy, cx, cy], lens.model, lens.coefficients)
    (fx, fy, cx, cy), coefficients, rms, worst, covered = _core.nearest_lens(
        given, lens.image_size, family.title, family.square, " ".join(family.free)
    )
    found = family.lens((fx, fy), (cx, cy), coefficients, lens.image_size)
    return Approximation(found, family.title, rms, worst, covered)
