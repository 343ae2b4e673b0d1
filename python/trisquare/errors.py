"""Exceptions that trisquare raises; a failure is never returned as a number.

Wrong arguments are plain `ValueError` and `TypeError`. Errors that depend on the content of the
photograph are a `TrisquareError`, so that one ``except`` catches every refusal.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from trisquare._support.worded_errors import WordedOSError

HELP_PAGE = "faq.html"
"""Page of the documentation with a section for each code."""

HTTP_STATUSES: Mapping[str, int] = MappingProxyType(
    {
        "ValueError": 400,
        "TypeError": 400,
        "UsageError": 400,
        "UnreadableInputError": 400,
        "TokenError": 401,
        "NotFoundError": 404,
        "MethodError": 405,
        "LensModelError": 409,
        "TooLargeError": 413,
        "ImageError": 415,
        "MissingImageError": 415,
        "TrisquareError": 422,
        "DetectionError": 422,
        "NotEnoughPlanesError": 422,
        "NotEnoughDataError": 422,
        "DegenerateGeometryError": 422,
        "ConvergenceError": 422,
        "TimeLimitError": 422,
        "MemoryError": 422,
        "AbandonedError": 499,
        "InternalError": 500,
        "OSError": 500,
        "WorkerDiedError": 500,
        "ImportError": 501,
        "BusyError": 503,
    }
)
"""HTTP status of a service's answer, by the code of the error."""

FAULT = 500
"""HTTP status for any other code."""

OPENCV_NO_MEMORY = -4
"""OpenCV's code for lack of memory, whose name differs between versions."""


def help_of(code: str) -> str:
    """Return the place in the documentation that explains a code, relative to its folder.

    Parameters
    ----------
    code : str
        The class of an error, or the code of a warning.
    """
    return f"{HELP_PAGE}#{code.lower().replace('_', '-')}"


def http_status(code: str) -> int:
    """Return the HTTP status for an error.

    Parameters
    ----------
    code : str
        Code of the error, as in `error_members` and in the records of `calibrate_many`.

    Returns
    -------
    int
        500 for a code that is unknown.

    Examples
    --------
    >>> ts.http_status("ValueError"), ts.http_status("ImageError"), ts.http_status("DetectionError")
    (400, 415, 422)
    """
    return HTTP_STATUSES.get(code, FAULT)


def error_members(error: BaseException) -> dict[str, Any]:
    """Return an error as a JSON object, in the form of all JSON of trisquare.

    Returns
    -------
    dict
        ``code``, the name of its class, or of the nearest base that the documentation explains;
        ``text``, one line; ``help``, the place in the documentation. An exception that the
        documentation does not explain is an ``InternalError``, except for lack of memory, which
        OpenCV and the system report in other ways. A `TrisquareError` may also have ``found`` and
        ``rejected``, the targets and the shapes that were not used, each with ``kind``, ``image``
        and ``corners``, the latter also with ``reason``.

    Examples
    --------
    >>> try:
    ...     ts.calibrate("no-such-photo.jpg")
    ... except (ts.TrisquareError, ValueError) as error:
    ...     print(ts.error_members(error)["code"])
    MissingImageError
    """
    bases = (kind.__name__ for kind in type(error).__mro__)
    code = next((name for name in bases if name in HTTP_STATUSES), InternalError.__name__)
    text = str(error) or type(error).__name__
    if lacks_memory(error):
        code, text = MemoryError.__name__, f"not enough memory: {error}".removesuffix(": ")
    if code == InternalError.__name__ and not isinstance(error, InternalError):
        text = f"{type(error).__name__}: {text}"
    members = code_members(code, text)
    if isinstance(error, TrisquareError):
        shapes = {"found": error.found, "rejected": error.rejected}
        members |= {
            key: [candidate.members() for candidate in candidates]
            for key, candidates in shapes.items()
            if candidates
        }
    return members


def lacks_memory(error: BaseException) -> bool:
    """Return whether an error reports lack of memory, from Python, OpenCV or the system.

    OpenCV passes on C++ exceptions as text without a code.
    """
    kind = type(error)
    if (kind.__module__, kind.__name__) == ("cv2", "error"):
        return getattr(error, "code", None) == OPENCV_NO_MEMORY or "bad_alloc" in str(error)
    return isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM


def code_members(code: str, text: str) -> dict[str, Any]:
    """Return an error with a code and a text, in the form of all JSON of trisquare."""
    return {"code": code, "text": " ".join(text.split()), "help": help_of(code)}


class TrisquareError(Exception):
    """Base class of every error that trisquare itself raises.

    Attributes
    ----------
    found : tuple of PartialDetection
        The targets that were found in the pictures before `calibrate` failed, one for each plane.
    rejected : tuple of Rejected
        What was found in them but not used, with the reason.

    Examples
    --------
    >>> try:
    ...     ts.calibrate("no-such-photo.jpg")
    ... except ts.TrisquareError as error:
    ...     print(type(error).__name__, error.help)
    MissingImageError faq.html#missingimageerror
    """

    found: tuple[Any, ...] = ()
    rejected: tuple[Any, ...] = ()

    @property
    def help(self) -> str:
        """Place in the documentation that explains it, relative to the folder of the pages."""
        return help_of(type(self).__name__)


class ImageError(TrisquareError):
    """The picture is missing, unreadable, incomplete or too large, or an extra package is missing.

    Raised before the picture is searched. Check the path, or copy the file again: a truncated
    picture is refused although many viewers show its upper part.

    Examples
    --------
    >>> with open("broken.jpg", "wb") as file:
    ...     _ = file.write(b"no picture")
    >>> try:
    ...     ts.calibrate("broken.jpg")
    ... except ts.ImageError as error:
    ...     print(error)
    broken.jpg: not a readable picture
    """


class MissingImageError(ImageError, WordedOSError, FileNotFoundError):
    """The picture's file does not exist; also a `FileNotFoundError`, as for every missing file.

    Examples
    --------
    >>> try:
    ...     ts.calibrate("no-such-photo.jpg")
    ... except FileNotFoundError as error:
    ...     print(error)
    no-such-photo.jpg: No such file or directory
    """

    def __init__(
        self,
        text: str,
        filename: str | os.PathLike[str] | None = None,
        number: int | None = errno.ENOENT,
        strerror: str | None = None,
    ) -> None:
        super().__init__(text, filename, number, strerror)


class DetectionError(TrisquareError):
    """No target was found in the picture.

    The squares may be too small, too blurred, cut by the border or too low in contrast. Give
    `targets=` if the picture shows a chessboard, or measure the edges by other means and call
    `calibrate_edges`.

    Examples
    --------
    >>> try:
    ...     ts.calibrate(np.full((480, 640), 128, np.uint8))
    ... except ts.DetectionError as error:
    ...     print(type(error).__name__)
    DetectionError
    """


class NotEnoughPlanesError(TrisquareError):
    """There are too few planes to estimate the free parameters.

    Three tilted squares are usually needed. With two, fix some parameters with `fix=`; or give
    several pictures of the same camera.

    Examples
    --------
    >>> try:
    ...     ts.calibrate_edges([], image_size=(1280, 960))
    ... except ts.NotEnoughPlanesError as error:
    ...     print(str(error).partition(":")[0])
    0 planes given, but the free parameters of the camera (fx, fy, cx, cy) need 2
    """


class NotEnoughDataError(TrisquareError):
    """There are too few lines, samples or degrees of freedom.

    A plane needs four lines and a line two distinct points; there must be more samples in total
    than unknowns. Measure more of each side, or free fewer parameters.

    Examples
    --------
    >>> try:
    ...     ts.fit_distortion([[[0, 0], [1, 1]]], (1280, 960))
    ... except ts.NotEnoughDataError as error:
    ...     print(error)
    2 samples cannot determine 4 unknowns: measure more points per side
    """


class DegenerateGeometryError(TrisquareError):
    """The planes do not determine the camera.

    Their directions are too similar, as for parallel squares or a fronto-parallel view. Tilt the
    squares 25 degrees or more in different directions, or fix the principal point at a known value
    with ``fix="principal_point", initial=camera``. Or the lens model has more coefficients than the
    edges determine: its polynomial turns back inside the picture, and a model with fewer
    coefficients is needed. Or the lens is a fisheye; the message states this.

    Examples
    --------
    >>> parallel = [np.diag([900, 900, 1]) @ [[1, 0, x], [0, 1, 0], [0, 0, 3]] for x in (0, 1, 2)]
    >>> try:
    ...     ts.camera_matrix_from_homographies(parallel)
    ... except ts.DegenerateGeometryError as error:
    ...     print(type(error).__name__)
    DegenerateGeometryError
    """


class ConvergenceError(TrisquareError):
    """The refinement found no minimum within its bounded number of steps.

    Usually the edges are not those of squares, or one of them has a gross error. Look at the
    detected outlines (``--debug-image``), and remove the target that does not fit.

    Examples
    --------
    >>> try:
    ...     result = ts.calibrate("photo.jpg")
    ... except ts.ConvergenceError as error:
    ...     print(error.found)  # what to look at
    """


class InternalError(TrisquareError):
    """Trisquare failed inside its core: a defect that no input should cause.

    Report it with the input; the message states the place in the code. The call has had no effect,
    and later calls are not affected.

    Examples
    --------
    >>> try:
    ...     result = ts.calibrate("photo.jpg")
    ... except ts.InternalError as error:
    ...     print(f"please report this: {error}")
    """


class LensModelError(ValueError):
    """A file format has no model for a camera's lens, or trisquare has none for a file's lens.

    It depends only on the arguments, and is therefore a ValueError, not a `TrisquareError`. Choose
    another format, or ask for the nearest lens with ``approximate=True``
    (``trisquare convert --approximate``).

    Attributes
    ----------
    nearest : object
        The nearest available lens; a `Camera` for most formats. None if there is no approximation,
        so that ``approximate=True`` fails too.
    rms, worst : float
        The error of that lens over the picture, pixels; infinite without one.

    Examples
    --------
    >>> try:
    ...     camera.save("panorama.pto")
    ... except ts.LensModelError as error:
    ...     print(error.rms < error.worst)
    True
    """

    def __init__(
        self,
        message: str,
        nearest: object = None,
        rms: float = math.inf,
        worst: float = math.inf,
    ) -> None:
        super().__init__(message)
        self.nearest = nearest
        self.rms = rms
        self.worst = worst

    @property
    def help(self) -> str:
        """The place in the documentation that explains it, relative to the folder of its pages."""
        return help_of(type(self).__name__)

    def __reduce__(self) -> tuple[Any, ...]:
        return LensModelError, (str(self), self.nearest, self.rms, self.worst)
