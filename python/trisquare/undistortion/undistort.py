"""Pictures without their lens's distortion."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypeAlias

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.suggestions import unknown
from trisquare.camera.camera import Camera, camera_for_core
from trisquare.camera.camera_of import camera_of
from trisquare.camera.lens_models import is_fisheye
from trisquare.camera.panorama import Panorama, view_for_core
from trisquare.images.pixels import LARGEST_RESAMPLED, Image, ImageSource, picture_size
from trisquare.images.reading import load_picture
from trisquare.results.calibration import Calibration

if TYPE_CHECKING:
    from collections.abc import Callable

Interpolation: TypeAlias = Literal["linear", "nearest", "cubic", "lanczos"]

INTERPOLATIONS: Mapping[Interpolation, tuple[str, str]] = {
    "nearest": ("INTER_NEAREST", "BORDER_CONSTANT"),
    "linear": ("INTER_LINEAR", "BORDER_CONSTANT"),
    # These use pixels beyond the next ones: black ones outside would darken the border.
    "cubic": ("INTER_CUBIC", "BORDER_REPLICATE"),
    "lanczos": ("INTER_LANCZOS4", "BORDER_REPLICATE"),
}
"""OpenCV's names of the method, and of the values that it takes outside the picture."""


def checked_interpolation(name: str) -> Interpolation:
    """Return a name of `INTERPOLATIONS` if it is known.

    Raises
    ------
    ValueError
        If there is no interpolation of this name.
    """
    known = next((member for member in INTERPOLATIONS if member == name), None)
    if known is None:
        raise unknown("interpolation", str(name), INTERPOLATIONS)
    return known


PART_BITS = 5
"""Number of binary digits of a pixel to which OpenCV rounds the positions of resampling."""


class Undistorter:
    """Removes the distortion from any number of a camera's pictures.

    The source position of every pixel is computed once; a frame of a video then costs no more than
    OpenCV's ``remap``. An object may be used by several threads at once.

    Parameters
    ----------
    camera : Calibration or Camera
        The camera of the pictures.
    balance : float
        From 0, where the new picture shows nothing but the photograph (no black border), to 1,
        where it shows all of the photograph; see `Camera.undistorted`.
    new_camera : Camera or Panorama, optional
        The pinhole or panorama of the new pictures, of any size, instead of the pinhole that
        `balance` gives.

    Raises
    ------
    TypeError, ValueError
        If an argument is not a camera or not a number from 0 to 1, `new_camera` has a distortion
        or a skew, a picture is larger than 32766 pixels, or none of it can be undistorted.

    Examples
    --------
    >>> undistorter = ts.Undistorter(camera, balance=1)  # shows all of the photograph
    >>> undistorter.new_camera.fx < camera.fx, bool(undistorter.valid_mask.all())
    (True, False)
    """

    def __init__(
        self,
        camera: Calibration | Camera,
        balance: float = 0.0,
        *,
        new_camera: Camera | Panorama | None = None,
    ) -> None:
        camera = camera_of(camera)
        _check_view(camera, "camera", Camera)
        if new_camera is None:
            new_camera = camera.undistorted(balance)
        _check_view(new_camera, "new_camera", Camera, Panorama)
        if isinstance(new_camera, Camera) and (
            is_fisheye(new_camera.model) or new_camera.distortion.any() or new_camera.skew
        ):
            flaw = "skew" if new_camera.skew else "distortion"
            raise ValueError(f"new_camera must be a pinhole, but it has a {flaw}")
        self._camera, self._new_camera = camera, new_camera
        width, height = new_camera.image_size
        self._whole = np.empty((height, width, 2), np.int16)
        self._parts = np.empty((height, width), np.uint16)
        self._valid = np.empty((height, width), np.bool_)
        _core.fill_undistortion_map(
            camera_for_core(camera),
            camera.image_size,
            view_for_core(new_camera),
            self._whole,
            self._parts,
            self._valid,
        )
        self._valid.flags.writeable = False

    @property
    def camera(self) -> Camera:
        """The camera of the pictures."""
        return self._camera

    @property
    def new_camera(self) -> Camera | Panorama:
        """The pinhole or panorama of the pictures that `undistort` returns."""
        return self._new_camera

    @property
    def valid_mask(self) -> npt.NDArray[np.bool_]:
        """Which pixels of the new picture show the photograph, shape (H, W); others are black."""
        return self._valid

    @cached_property
    def valid_rectangle(self) -> tuple[int, int, int, int]:
        """The largest rectangle without a black pixel.

        It is ``(x, y, width, height)``, for ``picture[y : y + height, x : x + width]``; all zeros
        if no part of the photograph is visible.
        """
        return _core.largest_rectangle(self._valid)

    def undistort(self, image: ImageSource, *, interpolation: Interpolation = "linear") -> Image:
        """Return a picture as seen by `new_camera`.

        OpenCV resamples at positions rounded to 1/32 pixel in x and in y, so that a grey level is
        that of a position up to 0.022 pixels away (0.013 rms); ``"nearest"`` takes whole pixels.
        `Camera.undistort_points` does not round points that are measured in the photograph.

        Parameters
        ----------
        image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
            A picture of the camera's size.
        interpolation : {"linear", "nearest", "cubic", "lanczos"}
            ``"linear"`` gives the result of ``cv2.undistort``; ``"nearest"`` is for labels, which
            must not be mixed; the others are sharper, and may overshoot at edges.

        Returns
        -------
        ndarray, shape (H', W') or (H', W', 3)
            Same type as the picture, size of `new_camera`. Black where `valid_mask` is not set,
            with a linear transition one pixel wide.

        Raises
        ------
        ImageError
            If a file is not a complete picture.
        TypeError, ValueError
            If an array is not a picture, the picture is of another size, or there is no such
            interpolation.

        Examples
        --------
        >>> undistorter = ts.Undistorter(camera)
        >>> frames = [np.zeros((960, 1280, 3), np.uint8)] * 2  # stand for a video's
        >>> [undistorter.undistort(frame).shape for frame in frames]
        [(960, 1280, 3), (960, 1280, 3)]
        """
        interpolation = checked_interpolation(interpolation)
        picture = load_picture(image)
        if picture_size(picture) != self._camera.image_size:
            _refuse_size(picture_size(picture), self._camera)
        import cv2  # loaded when the first picture is undistorted

        nearest = interpolation == "nearest"
        method, border = INTERPOLATIONS[interpolation]
        undistorted = cv2.remap(
            np.ascontiguousarray(picture),
            self._nearest if nearest else self._whole,
            None if nearest else self._parts,  # type: ignore[arg-type]  # the stubs want an array
            getattr(cv2, method),
            borderMode=getattr(cv2, border),
        )
        if border == "BORDER_REPLICATE":
            undistorted[~self._valid] = 0
        return undistorted

    @cached_property
    def _nearest(self) -> npt.NDArray[np.int16]:
        """The map rounded to whole pixels: for this method OpenCV ignores the fractions."""
        half, max_part = 1 << (PART_BITS - 1), (1 << PART_BITS) - 1
        parts = np.stack([self._parts & max_part, self._parts >> PART_BITS], axis=-1)
        return self._whole + (parts >= half)

    def __reduce__(self) -> tuple[Callable[..., Undistorter], tuple[Any, ...]]:
        return partial(type(self), new_camera=self._new_camera), (self._camera,)

    def __repr__(self) -> str:
        return f"<Undistorter from {self._camera!r} to {self._new_camera!r}>"


def _check_view(view: Any, name: str, *types: type[Camera | Panorama]) -> None:
    if not isinstance(view, types):
        type_names = " or ".join(f"a {kind.__name__}" for kind in types)
        raise TypeError(f"{name} must be {type_names}, not {type(view).__name__}")
    if max(view.image_size) > LARGEST_RESAMPLED:
        raise ValueError(
            f"{name}: pictures of more than {LARGEST_RESAMPLED} pixels a side cannot be resampled"
        )


def _refuse_size(found: tuple[int, int], camera: Camera) -> NoReturn:
    camera.rescaled(found)  # raises an error with advice for another aspect ratio
    width, height = camera.image_size
    raise ValueError(
        f"the picture has {found[0]} x {found[1]} pixels, but the camera's pictures have {width} "
        f"x {height}: if it was scaled, and not cropped, scale the camera to it (rescale=True, "
        "--rescale)"
    )


def undistort(
    image: ImageSource,
    camera: Calibration | Camera,
    balance: float = 0.0,
    *,
    new_camera: Camera | Panorama | None = None,
    rescale: bool = False,
    interpolation: Interpolation = "linear",
) -> Image:
    """Return a picture without its distortion.

    For many pictures create one `Undistorter`: most of the computation does not depend on the
    picture.

    Parameters
    ----------
    image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
        A picture of the camera, grey or BGR.
    camera : Calibration or Camera
        The camera that took it.
    balance : float
        From 0, no black border, to 1, all of the photograph visible.
    new_camera : Camera or Panorama, optional
        The pinhole or panorama of the new picture, instead of ``camera.undistorted(balance)``.
    rescale : bool
        Whether a picture of another size is taken as scaled, by the rule of `Camera.rescaled`,
        before or after it was taken. Otherwise such a picture is an error.
    interpolation : {"linear", "nearest", "cubic", "lanczos"}
        See `Undistorter.undistort`.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, 3)
        Same type as the picture; black outside the photograph.

    Raises
    ------
    ImageError
        If a file is not a complete picture.
    TypeError, ValueError
        If an array is not a picture, the picture's size is not the camera's (nor, with
        `rescale`, its shape), or another argument is wrong.

    Examples
    --------
    >>> ts.undistort("photo.jpg", camera).shape
    (960, 1280)
    """
    taken_by = camera_of(camera)
    if isinstance(balance, str | os.PathLike):
        raise TypeError(
            f"balance must be a number, not {type(balance).__name__}: undistort returns the "
            "picture, cv2.imwrite writes it"
        )
    picture = load_picture(image)
    if rescale:
        taken_by = taken_by.rescaled(picture_size(picture))
    undistorter = Undistorter(taken_by, balance, new_camera=new_camera)
    return undistorter.undistort(picture, interpolation=interpolation)
