"""Prediction of a camera's standard deviations from a photograph still to be taken."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from trisquare._support.arrays import (
    FloatArray,
    ReadOnlyDict,
    RebuiltByConstructor,
    not_negative,
    real_array,
    real_number,
    sequence,
    strings,
)
from trisquare.analysis.plan import PlannedSquare, StandingPlane, posed, predicted
from trisquare.camera.camera import Camera, camera_parameters
from trisquare.camera.camera_of import camera_of
from trisquare.camera.lens_models import (
    BROWN,
    COEFFICIENTS,
    MODELS,
    LensModel,
    checked_model,
    is_fisheye,
)
from trisquare.camera.settings import checked_fix, checked_free
from trisquare.results.calibration import Calibration

__all__ = ["PlannedSquare", "Prediction", "predict"]


PRINTED_SIGMA = 2.0
"""Standard deviation of an edge sample per pixel of edge, pixels. In 38 photographs of boards
printed on paper (OpenCV's chessboard, a wooden corner, a ChArUco cube) the residuals' rms, times
the square root of the edge's length per independent sample, is 1.5 to 3.8, median 2.1; with
640 x 480 pixels 3.3, with 1920 x 1080 1.8."""

WIDEST_MEASURED = 1920
"""Largest width of these photographs, pixels."""


def printed_sigma(image_size: tuple[int, int]) -> float:
    """Return the standard deviation of a pixel of edge of targets printed on paper.

    In larger pictures than those measured, the paper's bend is larger in pixels by the ratio of the
    sizes, over parts of an edge that are longer by the same ratio: the standard deviation of a
    pixel grows as this ratio to the power of 1.5, so that the standard deviations of the parameters
    remain the same fraction of the focal length.
    """
    return PRINTED_SIGMA * math.pow(max(1.0, max(image_size) / WIDEST_MEASURED), 1.5)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction(RebuiltByConstructor):
    """Predicted standard deviations for a planned photograph.

    Parameters
    ----------
    camera : Camera
        The camera of the prediction.
    std : mapping of str to float
        One standard deviation of each free parameter, by name; with a fixed aspect ratio,
        ``std["fy"]`` is ``std["fx"]`` times ``fy / fx``, although ``fy`` is not among
        `parameters`.
    covariance : array_like, shape (n, n)
        Covariance of the free parameters, in the order of `parameters`.
    parameters : sequence of str
        Names of the free parameters: of ``fx fy cx cy`` and the model's coefficients, these
        sorted by name: ``k1 k2 k3 p1 p2``; then ``skew`` if it is to be free.
    sigma, spacing : float
        Standard deviation of one edge sample, and the length of edge per sample, pixels.

    Examples
    --------
    >>> prediction = ts.predict(camera, result.planes, sigma=0.02)
    >>> prediction.parameters
    ('fx', 'fy', 'cx', 'cy', 'k1', 'k2')
    """

    camera: Camera
    std: Mapping[str, float]
    covariance: FloatArray
    parameters: tuple[str, ...]
    sigma: float
    spacing: float

    def __post_init__(self) -> None:
        parameters = strings(self.parameters, "parameters")
        size = len(parameters)
        std = {name: not_negative(value, f"std[{name!r}]") for name, value in self.std.items()}
        object.__setattr__(self, "std", ReadOnlyDict(std))
        object.__setattr__(
            self, "covariance", real_array(self.covariance, "covariance", (size,) * 2)
        )
        object.__setattr__(self, "parameters", parameters)

    def __repr__(self) -> str:
        width, height = self.camera.image_size
        values = camera_parameters(self.camera)
        lines = [
            f"Prediction for a {width} x {height} camera ({self.camera.model}), "
            f"edges sampled every {self.spacing:g} px, each sample known to {self.sigma:.3g} px"
        ]
        lines += [
            f"  {name}  std {std:8.2g}  of {values[name]:.6g}" for name, std in self.std.items()
        ]
        return "\n".join(lines)


def _has(camera_model: str, model: str) -> bool:
    """Return whether a lens of the model `camera_model` has all coefficients of another model."""
    if is_fisheye(camera_model) or is_fisheye(model):
        return is_fisheye(camera_model) and is_fisheye(model)
    return COEFFICIENTS[model] in (BROWN, COEFFICIENTS[camera_model])


def predict(
    camera: Calibration | Camera,
    planes: Iterable[StandingPlane],
    sigma: float | None = None,
    *,
    spacing: float = 1.0,
    model: LensModel | None = None,
    fix: str | Iterable[str] = (),
    free: str | Iterable[str] = (),
) -> Prediction:
    """Predict the uncertainty of a camera calibrated from squares that are to be photographed.

    It is the Cramer-Rao bound of all samples along the squares' edges, from the normal equations,
    the covariance and the tests of a calibration: a plan is refused if its photograph would be.

    Parameters
    ----------
    camera : Calibration or Camera
        An estimate of the camera: the standard deviations depend on it only weakly.
    planes : iterable of PlannedSquare, Plane or simulate.Target
        Poses of the squares: squares, tags and frames, no boards. Squares of several photographs
        are added as if the errors of all were independent.
    sigma : float, optional
        Standard deviation of one edge sample across its edge, pixels. By default 2, the value for
        targets printed on paper: they are not quite flat, so that the errors of neighbouring
        samples are correlated. It is larger in pictures wider than 1920 pixels (11 for 6000):
        paper bends by more of the smaller pixels, which therefore do not improve the result. For
        straight edges of flat objects it is 0.01 to 0.03 in sharp pictures; `simulate.pixel_sigma`
        gives it for known noise, contrast and blur. The tone curve is taken as known: if it is
        estimated (the default of `calibrate`) the standard deviation of a rendered picture's `fx`
        is some per cent larger, and with a fisheye up to 2.4 times.
    spacing : float
        Pixels of edge per sample.
    model : str, optional
        The distortion coefficients to be estimated, by one of the models of the camera's
        family (see `Camera`); by default the camera's own.
    fix : names among "aspect", "principal_point", "focal", "distortion"
        What is to be fixed, at the camera's values.
    free : "skew", optional
        What is to be estimated although it is otherwise fixed.

    Returns
    -------
    Prediction

    Raises
    ------
    ValueError
        If a square is not completely in the picture (the message gives its number), if a plane is
        of another kind, or for other bad arguments.
    NotEnoughPlanesError, DegenerateGeometryError
        If the squares would not determine the camera; the message gives the reason and a remedy.

    Examples
    --------
    >>> planned = [
    ...     ts.PlannedSquare.at(camera, centre, 350, tilt=35, direction=direction)
    ...     for centre, direction in (((290, 290), 0), ((980, 290), 120), ((640, 690), 240))
    ... ]
    >>> prediction = ts.predict(camera, planned)
    >>> round(prediction.std["fx"], 1)
    5.9
    """
    camera = camera_of(camera)
    if model is not None:
        model = checked_model(model)
    kin = [name for name in MODELS if _has(camera.model, name)]
    if model is not None and model not in kin:
        raise ValueError(
            f"{model!r} is no lens model of this camera's family ({', '.join(kin)}): give a "
            "camera of that model's family, camera= (--camera)"
        )
    noise = printed_sigma(camera.image_size) if sigma is None else real_number(sigma, "sigma")
    distance = real_number(spacing, "spacing")
    found = predicted(
        camera,
        map(posed, sequence(planes, "planes", "PlannedSquare, Plane or Target")),
        checked_fix(fix),
        sigma=noise,
        spacing=distance,
        model=model,
        judged=True,
        free=checked_free(free),
    )
    return Prediction(
        camera=camera,
        std=found.std,
        covariance=found.covariance,
        parameters=tuple(found.parameters),
        sigma=noise,
        spacing=distance,
    )
