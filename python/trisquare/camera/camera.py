"""The camera: a pinhole with lens distortion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

import trisquare._core as _core
from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    real_array,
    real_number,
    size_of_image,
)
from trisquare._support.paths import File
from trisquare.camera.approximation import Approximation
from trisquare.camera.file_formats import registered_files
from trisquare.camera.lens_models import (
    COEFFICIENTS,
    OPENCV_LENGTHS,
    LensModel,
    checked_model,
    opencv_distortion,
)

# A camera for the compiled core: its model, its parameters in the order of reports, and its valid
# radius.
CoreCamera: TypeAlias = "tuple[str, Sequence[float], float]"

# Default of `model`: the coefficients determine it. It is Any, since every camera's model is a str.
_BY_COEFFICIENTS: Any = None
# The simplest model that is chosen by the coefficients.
USUAL_MODEL: LensModel = "radial2"
# Numbers of coefficients that determine the model; four may be a pinhole's or a fisheye's.
OPENCV_COUNTS = tuple(length for length in OPENCV_LENGTHS if length != 4)
FOUR_COEFFICIENTS_HINT = (
    "append a 0 for k3 to OpenCV's k1, k2, p1, p2; the coefficients of a fisheye need "
    'model="fisheye"'
)

OPENCV_NAMES = {
    **dict.fromkeys(("cameraMatrix", "camera_matrix", "mtx"), "K"),
    **dict.fromkeys(("distCoeffs", "dist_coeffs", "dist"), "distortion"),
}
"""Names of a camera's attributes in OpenCV and its tutorials."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera(RebuiltByConstructor):
    """A camera: a pinhole with lens distortion, or a fisheye.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`` in pixels; ``(0, 0)`` is the centre of the
        top-left pixel. The skew of nearly every camera is 0; OpenCV takes it as 0.
    distortion : array_like, shape (5,), (4,), (8,) or (12,)
        In OpenCV's order: ``(k1, k2, p1, p2, k3)``, from ideal to observed normalised points, as
        `cv2.projectPoints` takes it; for a fisheye ``(k1, k2, k3, k4)``, as `cv2.fisheye` takes it
        (Kannala & Brandt, IEEE PAMI 28 (2006) 1335-1340). For "rational" ``(k1, k2, p1, p2, k3,
        k4, k5, k6)``, for "brown_prism" and "thin_prism" the same with ``(s1, s2, s3, s4)``, as
        `cv2.projectPoints` takes them (OpenCV's documentation of calib3d). Arrays of the shapes
        ``(1, N)`` and ``(N, 1)``, as OpenCV returns them, are accepted too.
    image_size : (int, int)
        Width and height in pixels.
    model : {"none", "radial1", "radial2", "radial3", "brown", "equidistant", "fisheye1", \
"fisheye2", "fisheye", "rational", "brown_prism", "thin_prism"}, optional
        Which coefficients may differ from zero. By default determined by the coefficients, 5, 8, 12
        or 14 in OpenCV's order: "radial2", or the simplest pinhole model with all that are not
        zero; `distortion` is then that model's. "equidistant" is a fisheye without coefficients,
        "fisheye1" and "fisheye2" have ``k1``, and ``k1, k2``; "brown_prism" has no ``k4, k5, k6``.
    valid_radius : float, optional
        Radius up to which the distortion is monotonic, hence invertible: the ideal normalised
        radius (tangent of the angle from the axis), for a fisheye the angle itself, in radians;
        None if there is no limit. Computed unless given; a smaller one may be given. Every map
        raises ValueError beyond it.

    Raises
    ------
    TypeError, ValueError
        If a value has the wrong type or shape, is not finite, or is not possible for a camera.

    Examples
    --------
    >>> K = np.array([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]])
    >>> camera = ts.Camera(K, np.array([-0.28, 0.08, 0, 0, 0]), (1280, 960))
    >>> camera.fx, camera.image_size
    (900.0, (1280, 960))
    >>> ts.Camera(K, np.array([[-0.28, 0.08, 0.001, 0, 0]]), (1280, 960)).model
    'brown'
    """

    # No annotation, which would add it to `__dataclass_fields__`.
    other_names = MappingProxyType(
        OPENCV_NAMES | {"width": "image_size[0]", "height": "image_size[1]", "focal_length": "fx"}
    )

    K: FloatArray
    distortion: FloatArray
    image_size: tuple[int, int]
    model: LensModel = _BY_COEFFICIENTS
    valid_radius: float | None = None

    if TYPE_CHECKING:  # the constructor accepts more types than the attributes have

        def __init__(
            self,
            K: npt.NDArray[Any] | Sequence[Sequence[float]],
            distortion: npt.ArrayLike,
            image_size: Sequence[int],
            model: LensModel | None = None,
            valid_radius: float | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        K = real_array(self.K, "K", (3, 3))
        fixed_entries = (K[1, 0], K[2, 0], K[2, 1], K[2, 2])
        if fixed_entries != (0, 0, 0, 1) or K[0, 0] <= 0 or K[1, 1] <= 0:
            raise ValueError(
                "K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with positive fx, fy"
            )
        model, distortion = _model_and_distortion(self.model, self.distortion)
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "image_size", size_of_image(self.image_size))
        radius = self.valid_radius
        if radius is None:
            radius = _core.valid_radius(camera_for_core(self))
        elif radius != math.inf:
            radius = real_number(radius, "valid_radius")
            if radius <= 0:
                raise ValueError(f"valid_radius must be positive, not {radius}")
        object.__setattr__(self, "valid_radius", None if radius == math.inf else radius)
        if not _core.valid_pixel_radius(camera_for_core(self)) > 0:
            raise ValueError(
                f"distortion {self.distortion.tolist()} cannot be inverted anywhere: its valid "
                "radius is 0 px"
            )

    @property
    def fx(self) -> float:
        """Focal length along x, in pixels."""
        return float(self.K[0, 0])

    @property
    def fy(self) -> float:
        """Focal length along y, in pixels."""
        return float(self.K[1, 1])

    @property
    def cx(self) -> float:
        """Principal point's x, in pixels."""
        return float(self.K[0, 2])

    @property
    def cy(self) -> float:
        """Principal point's y, in pixels."""
        return float(self.K[1, 2])

    @property
    def skew(self) -> float:
        """Displacement of a pixel to the right per unit of the observed point's y, in pixels."""
        return float(self.K[0, 1])

    @property
    def valid_radius_px(self) -> float | None:
        """Distance from the principal point within which every pixel can be undistorted, pixels.

        It is measured in the photograph; None if there is no limit.
        """
        radius = _core.valid_pixel_radius(camera_for_core(self))
        return None if radius == math.inf else radius

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Project points of the camera's frame to pixels.

        Parameters
        ----------
        points : array_like, shape (N, 3)
            ``(X, Y, Z)``, Z ahead of the camera, in any unit. A fisheye may see points beside and
            behind the camera as well.

        Returns
        -------
        ndarray, shape (N, 2)
            Pixels; they may lie outside the picture.

        Raises
        ------
        ValueError
            If a point lies behind the camera or beyond the valid radius; the message gives the
            number of such points and the index of the first.

        Examples
        --------
        >>> camera.project([[0, 0, 1], [0.1, 0.2, 2]]).round(1).tolist()
        [[651.6, 470.2], [696.6, 559.9]]
        """
        return _core.project_points(camera_for_core(self), real_array(points, "points", (None, 3)))

    def can_project(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return which points of the camera's frame `project` accepts.

        Parameters
        ----------
        points : array_like, shape (N, 3)
            As in `project`.

        Returns
        -------
        ndarray of bool, shape (N,)
            Whether a point is within the valid radius and, unless the lens is a fisheye, ahead of
            the camera.

        Examples
        --------
        >>> camera.can_project([[0, 0, 1], [0, 0, -1]]).tolist()
        [True, False]
        """
        given = real_array(points, "points", (None, 3))
        return np.array(_core.can_project(camera_for_core(self), given), dtype=bool)

    def unproject(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return the unit rays, in the camera's frame, of pixels.

        Parameters
        ----------
        pixels : array_like, shape (N, 2)
            Pixels of the photograph.

        Returns
        -------
        ndarray, shape (N, 3)

        Raises
        ------
        ValueError
            If a pixel lies beyond the valid radius; the message gives the number of such pixels
            and the index of the first.

        Examples
        --------
        >>> camera.unproject([[camera.cx, camera.cy]]).round(9).tolist()
        [[0.0, 0.0, 1.0]]
        """
        return _core.unproject_pixels(
            camera_for_core(self), real_array(pixels, "pixels", (None, 2))
        )

    def distort_points(self, ideal: npt.ArrayLike) -> FloatArray:
        """Distort pixels of a pinhole with the same K.

        Parameters
        ----------
        ideal : array_like, shape (N, 2)
            Pixels of the pinhole.

        Returns
        -------
        ndarray, shape (N, 2)
            Pixels of the photograph.

        Raises
        ------
        ValueError
            If a point lies beyond the valid radius; the message gives the number of such points
            and the index of the first.

        Examples
        --------
        >>> ideal = camera.undistort_points([[100, 80]])
        >>> camera.distort_points(ideal).round(6).tolist()
        [[100.0, 80.0]]
        """
        return _core.distort_pixels(camera_for_core(self), real_array(ideal, "ideal", (None, 2)))

    def undistort_points(self, observed: npt.ArrayLike) -> FloatArray:
        """Return the pixels of a pinhole with the same K that show the same as observed pixels.

        The inverse of `distort_points`, to rounding.

        Parameters
        ----------
        observed : array_like, shape (N, 2)
            Pixels of the photograph.

        Returns
        -------
        ndarray, shape (N, 2)
            Ideal pixels.

        Raises
        ------
        ValueError
            If a pixel lies beyond the valid radius, or shows a direction of 90 degrees or more from
            the axis, which a pinhole cannot see; the message gives the number of such pixels and
            the index of the first.

        Examples
        --------
        >>> camera.undistort_points([[120, 80], [640, 480]]).round().tolist()
        [[5.0, -4.0], [640.0, 480.0]]
        """
        return _core.undistort_pixels(
            camera_for_core(self), real_array(observed, "observed", (None, 2))
        )

    def undistorted(self, balance: float = 0.0, *, field: float | None = None) -> Camera:
        """Return a pinhole that shows this camera's pictures without distortion.

        Its pictures have the same size, and its pixels the same shape (``fy / fx``) without skew;
        its focal length and principal point are chosen. For a lens of more than 120 degrees a
        `Panorama` is better.

        Parameters
        ----------
        balance : float
            0: every pixel of the new picture lies in the photograph, with the widest view for which
            this is so (for a fisheye, along its axis). 1: every pixel of the photograph
            within the valid radius and 80 degrees from the axis lies in the new picture. In
            between, the camera matrix changes linearly.
        field : float, optional
            Width of the view, degrees, in place of `balance`; the camera's axis is then in the
            centre.

        Returns
        -------
        Camera
            Without distortion or skew.

        Raises
        ------
        TypeError, ValueError
            If `balance` is not from 0 to 1, `field` is not above 0 and at most 160, both are given,
            or no part of the picture lies within the valid radius.

        Examples
        --------
        >>> pinhole = camera.undistorted(balance=1)
        >>> pinhole.distortion.tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0]
        """
        if field is not None:
            if balance:
                raise ValueError("give balance or field, not both")
            width, height = self.image_size
            fx = 0.5 * width / math.tan(0.5 * math.radians(field_of_view(field, 160.0)))
            fy, cx, cy = fx * self.fy / self.fx, 0.5 * (width - 1), 0.5 * (height - 1)
        else:
            fx, fy, cx, cy = _core.undistorted_view(
                camera_for_core(self), self.image_size, real_number(balance, "balance")
            )
        return Camera(camera_matrix(fx, fy, cx, cy), np.zeros(5), self.image_size, "none")

    def rescaled(self, image_size: Sequence[int]) -> Camera:
        """Return the camera of this camera's pictures scaled to another size.

        With ``(0, 0)`` at the centre of the top-left pixel, the picture's own corner is at
        ``(-1/2, -1/2)`` and stays there: ``fx' = s fx``, ``skew' = s skew``,
        ``cx' = s (cx + 1/2) - 1/2``, likewise for y, where ``s`` is the ratio of the widths for x
        and of the heights for y. The distortion and the valid radius are unchanged.

        Parameters
        ----------
        image_size : (int, int)
            Width and height of the scaled pictures.

        Raises
        ------
        TypeError, ValueError
            If it is not a size, or has another aspect ratio: the ratios may differ only by the
            rounding to whole pixels. Cropped or turned pictures are not scaled ones.

        Examples
        --------
        >>> half = camera.rescaled((640, 480))
        >>> round(half.fx / camera.fx, 9), round(half.cx - ((camera.cx + 0.5) / 2 - 0.5), 9)
        (0.5, 0.0)
        """
        size = size_of_image(image_size)
        # Under one common scale, each side may have been rounded up or down.
        sides = list(zip(self.image_size, size, strict=True))
        if max((new - 1) / old for old, new in sides) >= min((new + 1) / old for old, new in sides):
            size_text, new_size_text = ("{} x {}".format(*each) for each in (self.image_size, size))
            raise ValueError(
                f"pictures of {new_size_text} have another aspect ratio than the camera's, "
                f"{size_text}: {self._instead_of(size)}"
            )
        K = np.array(self.K)
        for axis, (old, new) in enumerate(sides):
            K[axis, :2] *= new / old
            K[axis, 2] = (K[axis, 2] + 0.5) * (new / old) - 0.5
        valid_radius = math.inf if self.valid_radius is None else self.valid_radius
        return Camera(K, self.distortion, size, self.model, valid_radius)

    def _instead_of(self, size: tuple[int, int]) -> str:
        """Return advice about pictures of another aspect ratio."""
        width, height = size
        if (height, width) == self.image_size:
            return (
                "the pictures seem to be turned: use the files as the camera wrote them "
                "(cv2.imread needs cv2.IMREAD_IGNORE_ORIENTATION), or turn the pictures back by "
                "90 degrees"
            )
        return (
            "they are not scaled pictures of this camera; calibrate the camera in the mode that "
            "records them (of a video: trisquare calibrate video.mp4 --frames 10)"
        )

    def save(
        self, path: File, format: str | None = None, *, approximate: bool = False
    ) -> Approximation | None:
        """Write the camera in a format of trisquare or of another program.

        Parameters
        ----------
        path : str, path or open file
            The file; a named file is written completely or left untouched.
        format : str, optional
            One of `trisquare.formats.FORMAT_NAMES`; by default by the file's name: trisquare's own
            for ``.json`` (and open files), OpenCV's for ``.yaml`` and ``.xml``, the programs' own
            for ``transforms.json``, ``cameras.txt``, ``.cameramodel`` and the like.
        approximate : bool
            Whether to write the nearest lens of the format if it has no model for this one.

        Returns
        -------
        Approximation or None
            The lens that was written in place of this one, and its error; None if the file
            describes the camera exactly. Only trisquare's own format keeps a valid radius that was
            narrowed by hand.

        Raises
        ------
        LensModelError
            A ValueError, if the format has no model for the camera; the message describes the
            nearest lens of the format, with the error in pixels.
        ValueError
            If the format is unknown.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> camera.save("camera_info.yaml")  # ROS's format, by the name
        >>> camera.save("calibration.xml", format="opencv")
        """
        return registered_files().save(self, path, format, approximate=approximate)

    @classmethod
    def load(
        cls,
        path: File,
        format: str | None = None,
        *,
        name: str | None = None,
        image_size: tuple[int, int] | None = None,
        approximate: bool = False,
    ) -> Camera:
        """Read a camera that trisquare or another program wrote.

        Parameters
        ----------
        path : str, path or open file
            The file, text or binary. The JSON of a `Calibration` is read as its camera.
        format : str, optional
            One of `trisquare.formats.FORMAT_NAMES`; by default recognised by the content.
        name : str, optional
            Camera to read from a file with several: Kalibr's ``"cam1"``, COLMAP's ``"3"``.
        image_size : (int, int), optional
            Width and height, for files that do not state them.
        approximate : bool
            Whether to return the nearest camera for a lens whose model `Camera` does not have.

        Raises
        ------
        LensModelError
            A ValueError, if `Camera` does not have the lens's model; the message describes the
            nearest camera, with the error in pixels.
        ValueError
            If it is not a camera file, damaged, or of a newer version; the message names the key.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> camera.save("camera_info.yaml")
        >>> ts.Camera.load("camera_info.yaml") == camera
        True
        """
        return (
            registered_files()
            .load(path, format, name=name, image_size=image_size, approximate=approximate)
            .camera
        )

    def to_json(self) -> str:
        """Return the camera as JSON text that `from_json` reads back exactly.

        Examples
        --------
        >>> ts.Camera.from_json(camera.to_json()) == camera
        True
        """
        return registered_files().to_json(self)

    @classmethod
    def from_json(cls, text: str) -> Camera:
        """Read the JSON that `to_json` wrote, or the camera of a `Calibration`'s JSON.

        Raises
        ------
        ValueError
            As `load`, if the text is not such JSON.

        Examples
        --------
        >>> ts.Camera.from_json(result.to_json()) == result.camera
        True
        """
        return registered_files().from_json(text)

    def __eq__(self, other: object) -> bool:
        """Return whether all numbers are the same, to the last bit."""
        if not isinstance(other, Camera):
            return NotImplemented
        return self._compared() == other._compared()

    def __hash__(self) -> int:
        return hash(self._compared())

    def _compared(self) -> tuple[object, ...]:
        numbers = (*self.K.ravel().tolist(), *self.distortion.tolist())
        return numbers, self.image_size, self.model, self.valid_radius

    def __repr__(self) -> str:
        width, height = self.image_size
        numbers = zip(COEFFICIENTS[self.model], self.distortion.tolist(), strict=True)
        return (
            f"<Camera {width} x {height}, {self.model}: fx {self.fx:.6g}, fy {self.fy:.6g}, "
            f"cx {self.cx:.6g}, cy {self.cy:.6g}, "
            f"{f'skew {self.skew:.6g}, ' if self.skew else ''}"
            f"{', '.join(f'{name} {value:.5g}' for name, value in numbers)}>"
        )


def _model_and_distortion(model: str | None, distortion: Any) -> tuple[str, FloatArray]:
    """Return a camera's model, by default determined by the coefficients, and its distortion.

    Raises
    ------
    TypeError, ValueError
        If no model, or not the given one, has these coefficients.
    """
    if model is not None:
        model = checked_model(model)
    if isinstance(distortion, np.ndarray) and distortion.ndim == 2 and 1 in distortion.shape:
        distortion = distortion.ravel()  # OpenCV's shape, ...
    elif isinstance(distortion, list) and len(distortion) == 1 and isinstance(distortion[0], list):
        (distortion,) = distortion  # ... and that of its tolist()
    values = real_array(distortion, "distortion", (None,))
    if model is None:
        return _opencv_model(values)
    names = COEFFICIENTS[model]
    if len(values) != len(names):
        advice = (
            FOUR_COEFFICIENTS_HINT
            if len(values) == 4
            else "without model= the number of coefficients determines the model"
        )
        raise ValueError(
            f"distortion must have shape ({len(names)}), not {values.shape}: model={model!r} has "
            f"{', '.join(names)}; {advice}"
        )
    return model, values


def _opencv_model(values: FloatArray) -> tuple[str, FloatArray]:
    """Return the model that OpenCV's coefficients determine, and its distortion."""
    if len(values) not in OPENCV_COUNTS:
        advice = f": {FOUR_COEFFICIENTS_HINT}" if len(values) == 4 else ""
        raise ValueError(
            f"distortion must have {', '.join(map(str, OPENCV_COUNTS))} coefficients without "
            f"model=, not {len(values)}{advice}"
        )
    lens = opencv_distortion(values.tolist(), USUAL_MODEL)
    if lens is None:
        raise ValueError(
            f"distortion tilts the sensor (tx, ty {values[-2:].tolist()}), which no lens model of "
            "trisquare describes: from a file, Camera.load(path, approximate=True) reads the "
            "nearest lens"
        )
    return lens[0], real_array(lens[1], "distortion", (None,))


def camera_parameters(camera: Camera) -> dict[str, float]:
    """Return all parameters of the camera by name, in the order of reports."""
    names = COEFFICIENTS[camera.model]
    numbers = dict(zip(names, camera.distortion.tolist(), strict=True))
    intrinsics = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
    return intrinsics | {name: numbers[name] for name in sorted(names)} | {"skew": camera.skew}


def named_numbers(camera: Camera) -> dict[str, float]:
    """Return the camera's parameters as files have them, without a skew of zero."""
    numbers = camera_parameters(camera)
    return numbers if camera.skew else {n: v for n, v in numbers.items() if n != "skew"}


def field_of_view(field: float, most: float) -> float:
    """Return a field of view if it is valid, else raise TypeError or ValueError."""
    field = real_number(field, "field")
    if not 0.0 < field <= most:
        raise ValueError(f"field must be above 0 and at most {most:g} degrees, not {field:g}")
    return field


def camera_matrix(fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> FloatArray:
    """Return K, ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]``."""
    return np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def centred_pinhole(focal: float, image_size: tuple[int, int]) -> Camera:
    """Return a camera without distortion whose principal point is the centre of its pictures."""
    width, height = image_size
    K = camera_matrix(focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))
    return Camera(K, np.zeros(5), (width, height))


def camera_for_core(camera: Camera) -> CoreCamera:
    """Return a camera in the form that the compiled core accepts."""
    radius = math.inf if camera.valid_radius is None else camera.valid_radius
    return camera.model, list(camera_parameters(camera).values()), radius
