"""The nearest lens of a file format's model, and its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import trisquare._core as _core
from trisquare.camera.approximation import Approximation
from trisquare.camera.camera import (
    Camera,
    CoreCamera,
    camera_for_core,
    camera_matrix,
    camera_parameters,
)
from trisquare.camera.lens_models import BROWN, COEFFICIENTS, FISHEYE, RATIONAL, THIN_PRISM
from trisquare.formats.other_lenses import ForeignLens, simplest_camera

Lens: TypeAlias = "Camera | ForeignLens"


@dataclass(frozen=True, slots=True)
class Family:
    """The lenses of one model of a file format.

    Lenses of this class are cameras of one of `Camera`'s models with some parameters constrained.

    Parameters
    ----------
    title : str
        The model's name in the format, and its coefficients.
    free : tuple of str
        The model's coefficients, by the core's names; here some of `all_coefficients`.
    square : bool
        Whether it has one focal length only.
    all_coefficients : tuple of str
        Coefficients of the camera's model, in OpenCV's order.
    skewed : bool
        Whether it may have a skew.
    """

    title: str
    free: tuple[str, ...]
    square: bool = False
    all_coefficients: tuple[str, ...] = BROWN
    skewed: bool = False

    @property
    def is_polynomial(self) -> bool:
        """Whether the nearest of these lenses to another one can be computed."""
        return self.all_coefficients not in (RATIONAL, THIN_PRISM)

    def is_of(self, camera: Camera) -> bool:
        """Return whether the camera's model has `all_coefficients`."""
        return COEFFICIENTS[camera.model] == self.all_coefficients

    def exactly(self, camera: Camera) -> Any:
        """Return the camera as a lens of the family: here, itself; None if it is not one."""
        if not self.is_of(camera):
            return None
        values = camera_parameters(camera)
        missing = any(values[name] for name in self.all_coefficients if name not in self.free)
        missing |= self.is_unlike(camera)
        return None if missing else camera

    def is_unlike(self, camera: Camera) -> bool:
        """Return whether the camera's K is impossible for these lenses."""
        return (self.square and camera.fx != camera.fy) or (not self.skewed and camera.skew != 0)

    def lens(
        self,
        focal: Sequence[float],
        centre: Sequence[float],
        coefficients: Sequence[float],
        image_size: tuple[int, int],
    ) -> Any:
        """Return the lens with these parameters: here, a camera."""
        named = dict(zip(self.free, coefficients, strict=True))
        return simplest_camera(camera_matrix(*focal, *centre), named, image_size)


ANY_BROWN = Family("brown (k1, k2, p1, p2, k3)", BROWN)
ANY_FISHEYE = Family("fisheye (k1, k2, k3, k4)", FISHEYE, all_coefficients=FISHEYE)
ANY_RATIONAL = Family("rational (k1 to k6, p1, p2)", RATIONAL, all_coefficients=RATIONAL)
ANY_PRISM = Family("thin prism", THIN_PRISM, all_coefficients=THIN_PRISM)
ANY_CAMERA = (ANY_FISHEYE, ANY_RATIONAL, ANY_PRISM, ANY_BROWN)
"""Families of all `Camera` without skew."""


def nearest(lens: Lens, family: Family) -> Approximation:
    """Fit a lens of a family to another lens over its picture, by least squares in pixels.

    Both lenses have the same axis: no rotation is fitted, so that poses remain valid.

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
