"""The distortion of a picture from any straight lines that it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trisquare._support.arrays import (
    FloatArray,
    RebuiltByConstructor,
    not_negative,
    real_array,
    sequence,
)
from trisquare.errors import DegenerateGeometryError, NotEnoughDataError
from trisquare.images.pixels import Image, ImageSource, picture_size
from trisquare.images.reading import load_picture
from trisquare.straightening.camera import UnscaledCamera
from trisquare.straightening.fit import (
    Fit,
    Problem,
    fit_lens,
    refit_held_centre,
    refit_third_coefficient,
)
from trisquare.straightening.uncertainty import uncertainty
from trisquare.undistortion.undistort import Interpolation

KNOWN_CENTRE_STD, UNKNOWN_CENTRE_STD = 0.01, 0.05
"""Standard deviations of the centre, half diagonals: up to the first it is free, above the second
it is held in the picture's middle. In between `CLEARLY_OFF` decides."""
CLEARLY_OFF = 3.0
"""Distance from the picture's middle, in standard deviations, above which the centre is free in
between. A third coefficient is free if it is as far from zero."""

STRAIGHT = 0.5
"""Maximum RMS of a line that counts as straight, working pixels."""

LONG = 0.15
"""Minimum length of a long line, half diagonals; shorter ones hardly bend."""

MIN_LINES = 5
"""Minimum number of long lines: two determine the coefficients, two the centre, and one shows
whether they agree."""

MIN_STRAIGHT = 0.6
"""Minimum fraction of the long edges' length that is images of straight lines: there may be a lens
under which half of a picture's circles are straight."""
CLEARLY_STRAIGHT = 0.8
"""Fraction above which that is not chance. Below it, `MIN_STRAIGHT_HELD` is required, too."""
MIN_STRAIGHT_HELD = 0.65
"""The same minimum with the centre held: a true lens's centre is near the picture's middle, that of
a chance one is anywhere."""

JUDGED_RADIUS = 0.85
"""Radius at which the displacement must be known, half diagonals: near the corners."""
MAX_STD = 0.01
"""Maximum standard deviation of the displacement there, half diagonals."""


@dataclass(frozen=True, slots=True, eq=False)
class Straightened(RebuiltByConstructor):
    """The distortion of a picture, from its straight lines.

    Parameters
    ----------
    camera : UnscaledCamera
        The distortion with its covariance; straight lines do not determine the focal length.
    used : tuple of ndarray, shape (N_i, 2)
        Points on the images of straight lines, one array per line, pixels.
    rejected : tuple of ndarray, shape (N_i, 2)
        Points on arcs that are not such images, pixels.
    rms : float
        Root mean square distance of the used points to their lines, pixels.
    centre_held : bool
        Whether the centre of distortion is held in the picture's middle, because the lines do not
        determine it. Its standard deviation is then that of lenses in general, a weak prior's.

    Examples
    --------
    >>> found = ts.straighten("photo.jpg")
    >>> found.rms < 0.5, found.centre_held
    (True, False)
    """

    camera: UnscaledCamera
    used: tuple[FloatArray, ...]
    rejected: tuple[FloatArray, ...]
    rms: float
    centre_held: bool

    def __post_init__(self) -> None:
        for name in ("used", "rejected"):
            lines = sequence(getattr(self, name), name, "arrays, one per line")
            checked = tuple(real_array(line, f"each of {name}", (None, 2)) for line in lines)
            object.__setattr__(self, name, checked)
        object.__setattr__(self, "rms", not_negative(self.rms, "rms"))

    def undistort(
        self, image: ImageSource, balance: float = 0.0, *, interpolation: Interpolation = "linear"
    ) -> Image:
        """Return a picture of the same camera with its straight lines straight.

        Parameters
        ----------
        image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
            A picture of the camera's size.
        balance : float
            From 0, no black border, to 1, the whole photograph.
        interpolation : {"linear", "nearest", "cubic", "lanczos"}
            See `Undistorter.undistort`.

        Returns
        -------
        ndarray, shape (H, W) or (H, W, 3)
            Of the same type and size; black outside the photograph.

        Raises
        ------
        ImageError
            If a file is not a complete picture.
        TypeError, ValueError
            If an argument is wrong, or the picture of another size.

        Examples
        --------
        >>> ts.straighten("photo.jpg").undistort("photo.jpg").shape
        (960, 1280)
        """
        from trisquare.straightening.view import undistort_picture  # which loads OpenCV

        return undistort_picture(image, self.camera, balance, interpolation)

    def __repr__(self) -> str:
        return (
            f"<Straightened by {len(self.used)} lines ({len(self.rejected)} rejected): rms "
            f"{self.rms:.3g} px, {self.camera!r}>"
        )


def straighten(image: ImageSource) -> Straightened:
    """Find the lens distortion from the straight lines of a picture, without any target.

    Edges are followed to a fraction of a pixel and cut into arcs. The distortion is the one under
    which most long arcs are straight; arcs that one line explains are joined. Residuals are
    measured in the distorted picture, and lines are weighted by their straightness: curved edges
    are rejected. Most straight edges of the scene must be longer and straighter than curved ones.

    Parameters
    ----------
    image : path, bytes, binary file, PIL.Image.Image or ndarray, shape (H, W[, 3 or 4])
        Grey or BGR, as the lens imaged it: not cropped off centre.

    Returns
    -------
    Straightened
        The distortion as a camera without focal length, the lines used and rejected.

    Raises
    ------
    ImageError
        If a file is not a complete picture.
    NotEnoughDataError
        If there are too few long edges.
    DegenerateGeometryError
        If the lines do not determine the distortion (they are too central or run through the
        centre), or most long edges are curved.
    TypeError, ValueError
        If an array is not a picture.

    Notes
    -----
    F. Devernay & O. Faugeras, "Straight lines have to be straight", Machine Vision and
    Applications 13 (2001) 14-24; A. Fitzgibbon, CVPR 2001.

    Examples
    --------
    >>> found = ts.straighten("photo.jpg")
    >>> len(found.used) > 20, found.camera.family
    (True, 'polynomial')
    """
    from trisquare.straightening.edges import find_arcs  # which loads OpenCV

    picture = load_picture(image)
    size = picture_size(picture)
    arcs = find_arcs(picture)
    radius = 0.5 * float(np.hypot(*size))
    middle = 0.5 * (np.array(size, dtype=np.float64) - 1)
    problem = Problem(arcs.curves, middle, radius, arcs.pixel)
    lengths = _spans(arcs.curves) / radius
    if len(lengths) < MIN_LINES:
        _check_count(lengths, "edges")
    fit = fit_lens(problem)
    _check_count(_seen_lengths(fit, lengths), "edges")
    _check_curves(problem, fit)
    free_problem, free_fit = refit_third_coefficient(problem, fit)
    lens_uncertainty = uncertainty(free_problem, free_fit)
    third_coefficient, third_std = (
        free_fit.lens.radial.coefficients[2],
        np.sqrt(lens_uncertainty.covariance[2, 2]),
    )
    is_third_free = abs(third_coefficient) > CLEARLY_OFF * third_std
    if is_third_free:
        problem, fit = free_problem, free_fit
    else:
        # A held parameter is not known: the covariance is that with it free.
        lens_uncertainty = uncertainty(free_problem, fit)
    centre_offsets = np.abs(fit.lens.centre - middle) / lens_uncertainty.centre_std
    std = float(lens_uncertainty.centre_std.max()) / radius
    centre_held = std > (
        UNKNOWN_CENTRE_STD if centre_offsets.max() > CLEARLY_OFF else KNOWN_CENTRE_STD
    )
    if centre_held:
        fit = refit_held_centre(problem, fit)
        lens_uncertainty = uncertainty(free_problem, fit)
    radial = fit.lens.radial
    coefficients = radial.coefficients * [1, 1, is_third_free]
    camera = UnscaledCamera(
        size, radial.family, coefficients, fit.lens.centre, lens_uncertainty.covariance
    )
    lines = fit.lines()
    is_used = are_straight(problem, fit)
    used = tuple(line for line, is_line_used in zip(lines, is_used, strict=True) if is_line_used)
    rejected = tuple(
        line for line, is_line_used in zip(lines, is_used, strict=True) if not is_line_used
    )
    _check_count(_seen_lengths(fit, lengths)[is_used], "straight lines")
    _check_precision(camera)
    squares = fit.straightness.residuals[fit.straightness.bundle.per_point(is_used)] ** 2
    return Straightened(camera, used, rejected, float(np.sqrt(squares.mean())), centre_held)


def are_straight(problem: Problem, fit: Fit) -> npt.NDArray[np.bool_]:
    """Return which lines of a fit are straight under its lens."""
    return np.asarray(fit.straightness.rms <= STRAIGHT * problem.pixel)


def _spans(lines: tuple[FloatArray, ...] | list[FloatArray]) -> FloatArray:
    """Return the distances between the lines' ends."""
    return np.array([np.linalg.norm(line[-1] - line[0]) for line in lines])


def _seen_lengths(fit: Fit, lengths: FloatArray) -> FloatArray:
    """Return the length of each line without its gaps, from those of its arcs.

    Arcs that lie in a row by chance, as in leaves, are short, and their gaps are long.
    """
    return np.array([lengths[group].sum() for group in fit.groups])


def _check_count(lengths: FloatArray, kind: str) -> None:
    long_count = int((lengths >= LONG).sum())
    if long_count < MIN_LINES:
        raise NotEnoughDataError(
            f"{long_count} long {kind} in the picture, but {MIN_LINES} are needed, each at "
            f"least {LONG:.0%} of half the diagonal long, and curved no more than a lens curves a "
            "straight line: take a picture with long straight edges, also near its border"
        )


def _check_curves(problem: Problem, fit: Fit) -> None:
    """Refuse a picture of curved edges, even if some of them are straight under some lens."""
    straight_share, min_share = _straight_share(problem, fit), MIN_STRAIGHT
    if min_share <= straight_share < CLEARLY_STRAIGHT:
        min_share = MIN_STRAIGHT_HELD
        straight_share = _straight_share(problem, refit_held_centre(problem, fit))
    if straight_share < min_share:
        raise DegenerateGeometryError(
            f"only {straight_share:.0%} of the long edges can be images of straight lines at once: "
            "too many are curved, or not sharp; take a picture whose edges are straight"
        )


def _straight_share(problem: Problem, fit: Fit) -> float:
    """Return the fraction of the long edges' length that is straight."""
    lengths = _spans(fit.lines()) / problem.radius
    lengths = np.where(lengths >= LONG, lengths, 0.0)
    return float(lengths[are_straight(problem, fit)].sum() / max(lengths.sum(), 1e-12))


def _check_precision(camera: UnscaledCamera) -> None:
    """Refuse a distortion that is not known near the corners."""
    square = np.array([JUDGED_RADIUS**2])
    divisor, _, by_coefficients = camera.radial.divisor(square)
    slope = by_coefficients[0] * JUDGED_RADIUS / divisor[0]
    std = float(np.sqrt(slope @ camera.covariance[:-2, :-2] @ slope))
    if std > MAX_STD:
        raise DegenerateGeometryError(
            "the lines determine the distortion near the corners only to "
            f"{std * camera.radius:.1f} px: they are too central, too short, or run through the "
            "centre; take a picture with straight edges along its border"
        )
