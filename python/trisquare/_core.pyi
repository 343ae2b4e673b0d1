"""The compiled core of trisquare."""

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol, TypeAlias, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Lattice",
    "Picture",
    "__version__",
    "calibrate",
    "camera_matrix_from_homographies",
    "can_unproject",
    "choose",
    "distort_pixels",
    "fill_undistortion_map",
    "find_lattices",
    "fit_distortion",
    "fit_side_cubics",
    "homography_from_lines",
    "invertible_radius",
    "largest_rectangle",
    "localise",
    "pose_from_homography",
    "predict",
    "project_points",
    "projection_covariance",
    "projection_jacobian",
    "square_lines",
    "straighten",
    "undistort_pixels",
    "undistorted_view",
    "unproject_pixels",
    "valid_pixel_radius",
]

__version__: Final[str]

_Camera: TypeAlias = tuple[Sequence[float], float]
"""fx, fy, cx, cy, k1, k2, k3, p1, p2, and the ideal radius up to which they are trusted."""

@type_check_only
class _Edges(Protocol):
    """The members of a `PlaneEdges` that the core reads."""

    @property
    def lines(self) -> NDArray[np.float64]: ...
    @property
    def points(self) -> Sequence[NDArray[np.float64]]: ...
    @property
    def std(self) -> Sequence[NDArray[np.float64]] | None: ...
    @property
    def drift(self) -> Sequence[NDArray[np.float64]] | None: ...
    @property
    def polarity(self) -> int | None: ...
    @property
    def plane(self) -> int | None: ...
    @property
    def image(self) -> int: ...
    @property
    def border(self) -> float | None: ...
    @property
    def freedom(self) -> str: ...

@final
class Picture:
    """Raw pixels of a photograph, in memory of their own."""

    def __new__(cls, pixels: NDArray[Any], /) -> Picture: ...
    @property
    def size(self) -> tuple[int, int]: ...

_Candidates: TypeAlias = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Pixels (column, row), shape (N, 2), and how strongly the grey levels are curved there, (N,)."""

@final
class Lattice:
    """Crossings of a chessboard's grid lines in rows and columns."""

    @property
    def crossings(self) -> NDArray[np.float64]: ...

@type_check_only
class ToneMembers(TypedDict):
    """An estimated tone curve."""

    gamma: float
    toe: float
    effective_gamma: float
    std: float
    sides: int
    misfit: float
    shift_std: float | None

@type_check_only
class ToneFitMembers(TypedDict):
    """What the fit to the pixels told of how a picture was coded."""

    effective_gamma: float
    std: float | None
    shift: tuple[float, float] | None

@type_check_only
class PoseUncertaintyMembers(TypedDict):
    """How well a pose is known."""

    given_camera: NDArray[np.float64]
    by_camera: NDArray[np.float64]

@type_check_only
class PlaneMembers(TypedDict):
    """One plane of a calibration."""

    figure: int
    image: int
    corners: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    rms: float
    samples: int
    uncertainty: PoseUncertaintyMembers | None

@type_check_only
class CoherenceMembers(TypedDict):
    """How far the residuals are from independent noise."""

    neighbours: float
    probability: float
    displacements: tuple[float, ...]
    contradiction: float

@type_check_only
class CalibrationMembers(TypedDict):
    """A calibration, member by member."""

    camera_matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    valid_radius: float
    parameters: list[str]
    covariance: NDArray[np.float64]
    std: dict[str, float]
    planes: list[PlaneMembers]
    rms: float
    noise_scale: float
    iterations: int
    warnings: list[str]
    stage: str
    model: str
    alternatives: list[tuple[str, float, float]]
    coherence: CoherenceMembers
    tones: list[ToneFitMembers]

def calibrate(
    figures: Sequence[_Edges],
    image_size: tuple[int, int],
    *,
    method: str,
    model: str,
    fixed: Sequence[str],
    initial: Sequence[float] | None,
    pictures: Sequence[Picture] | None,
    tones: Sequence[str | float | tuple[float, float, float | None]],
) -> CalibrationMembers: ...
def choose(
    figures: Sequence[_Edges],
    image_size: tuple[int, int],
    *,
    model: str,
    fixed: Sequence[str],
    initial: Sequence[float] | None,
) -> tuple[list[tuple[int, bool, float | None]], str | None]: ...

@type_check_only
class PredictionMembers(TypedDict):
    """A prediction, member by member."""

    parameters: list[str]
    covariance: NDArray[np.float64]
    std: dict[str, float]

def predict(
    camera: Sequence[float],
    image_size: tuple[int, int],
    planes: Sequence[tuple[NDArray[np.float64], Sequence[float], Sequence[NDArray[np.float64]]]],
    *,
    sigma: float,
    spacing: float,
    model: str,
    fixed: Sequence[str],
    judged: bool,
) -> PredictionMembers: ...
def find_lattices(
    photograph: NDArray[np.uint8],
    pictures: Sequence[tuple[NDArray[np.uint8], _Candidates]],
    candidates: Callable[[], _Candidates],
) -> list[Lattice]: ...
def fit_side_cubics(
    basis: NDArray[np.float64],
    offsets: NDArray[np.float64],
    used: NDArray[np.bool_],
    lengths: NDArray[np.float64],
    trimmed: bool,
) -> NDArray[np.float64]: ...
def localise(
    picture: Picture,
    spans: Sequence[
        tuple[NDArray[np.float64], float, tuple[int | None, int | None]]
        | tuple[NDArray[np.float64], float, tuple[int | None, int | None], tuple[float, float]]
        | tuple[
            NDArray[np.float64],
            float,
            tuple[int | None, int | None],
            Sequence[tuple[int | None, int]],
        ]
        | tuple[
            NDArray[np.float64],
            float,
            tuple[int | None, int | None],
            Sequence[tuple[int | None, int]],
            Sequence[float],
        ]
    ],
    tone: str | float | None,
) -> tuple[
    list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None] | str],
    ToneMembers | None,
]: ...
def square_lines(sides: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]: ...
def fit_distortion(
    curves: Sequence[NDArray[np.float64]],
    image_size: tuple[int, int],
    coefficients: int,
    centre: tuple[float, float] | None,
) -> tuple[NDArray[np.float64], tuple[float, float], float, float]: ...
def straighten(
    points: NDArray[np.float64],
    coefficients: Sequence[float],
    centre: tuple[float, float],
    radius: float,
) -> NDArray[np.float64]: ...
def homography_from_lines(
    plane_lines: NDArray[np.float64], image_lines: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def camera_matrix_from_homographies(
    homographies: Sequence[NDArray[np.float64]],
) -> NDArray[np.float64]: ...
def pose_from_homography(
    camera_matrix: NDArray[np.float64], homography: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def invertible_radius(k1: float, k2: float, p1: float, p2: float, k3: float) -> float: ...
def valid_pixel_radius(camera: _Camera) -> float: ...
def project_points(camera: _Camera, points: NDArray[np.float64]) -> NDArray[np.float64]: ...
def unproject_pixels(camera: _Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]: ...
def distort_pixels(camera: _Camera, ideal: NDArray[np.float64]) -> NDArray[np.float64]: ...
def undistort_pixels(camera: _Camera, observed: NDArray[np.float64]) -> NDArray[np.float64]: ...
def undistorted_view(
    camera: _Camera, image_size: tuple[int, int], balance: float
) -> tuple[float, float, float, float]: ...
def fill_undistortion_map(
    camera: _Camera,
    image_size: tuple[int, int],
    view: _Camera,
    whole: NDArray[np.int16],
    parts: NDArray[np.uint16],
    valid: NDArray[np.bool_],
) -> None: ...
def largest_rectangle(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]: ...
def can_unproject(camera: _Camera, pixels: NDArray[np.float64]) -> list[bool]: ...
def projection_covariance(
    camera: _Camera,
    parameters: Sequence[str],
    aspect_fixed: bool,
    covariance: NDArray[np.float64],
    pixels: NDArray[np.float64],
) -> NDArray[np.float64]: ...
def projection_jacobian(camera: _Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]: ...
