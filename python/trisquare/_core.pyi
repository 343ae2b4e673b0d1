"""The compiled core of trisquare."""

from collections.abc import Sequence
from typing import Any, Final, Protocol, TypeAlias, final, type_check_only

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FigureResiduals",
    "KeptPixels",
    "Lattice",
    "Outcome",
    "Picture",
    "PictureFaults",
    "Prediction",
    "ResidualCorrelation",
    "SideSamples",
    "Solution",
    "SolutionWarning",
    "SolvedPlane",
    "ToneEstimate",
    "ToneFit",
    "Verdict",
    "__version__",
    "angle_between_planes",
    "calibrate",
    "camera_matrix_from_homographies",
    "can_project",
    "can_unproject",
    "compare_projections",
    "distort_pixels",
    "family_lines",
    "fill_undistortion_map",
    "find_arcs",
    "find_four_cornered",
    "find_four_sided",
    "find_lattices",
    "fit_distortion",
    "fit_sides",
    "homography_from_lines",
    "is_covariance",
    "largest_rectangle",
    "localise",
    "nearest_lens",
    "points_on_plane",
    "points_on_plane_with_covariance",
    "pose_from_homography",
    "predict",
    "project_points",
    "projection_covariance",
    "provoke_panic",
    "rectangle_lines",
    "remove_edge_shift",
    "straighten",
    "undistort_pixels",
    "undistorted_view",
    "unproject_pixels",
    "valid_pixel_radius",
    "valid_radius",
    "view_directions",
    "view_pixels",
]

__version__: Final[str]

_Camera: TypeAlias = tuple[str, Sequence[float], float]
"""A camera: its model, the lens's parameters in the order of reports, and its valid radius."""

_View: TypeAlias = tuple[str, float, float, float, float]
"""A view of an undistorted picture: its projection, fx, fy, cx and cy."""

_AnyLens: TypeAlias = _Camera | tuple[Sequence[float], str, Sequence[float]]
"""A camera, or fx, fy, cx, cy, the name of the model of a distortion, and its coefficients."""

_UncertainCamera: TypeAlias = tuple[_Camera, Sequence[str], bool, NDArray[np.float64]]
"""A camera, its free parameters, whether fy depends on fx, and the parameters' covariance."""

_Pose: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Rotation and translation."""

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

@type_check_only
class _Span(Protocol):
    """The members of a `SideSpan`."""

    @property
    def path(self) -> NDArray[np.float64]: ...
    @property
    def polarity(self) -> float: ...
    @property
    def bounds(self) -> tuple[int | None, int | None]: ...
    @property
    def margins(self) -> tuple[float, float]: ...
    @property
    def crossings(self) -> Sequence[tuple[int | None, int]]: ...
    @property
    def rims(self) -> Sequence[float]: ...
    @property
    def tags(self) -> Sequence[Sequence[Sequence[bool]]]: ...
    @property
    def tag_border(self) -> float: ...
    @property
    def is_beside_others(self) -> bool: ...
    @property
    def far_edge(self) -> int | None: ...

@final
class Picture:
    """Raw pixels of a photograph, as a copy."""

    def __new__(cls, pixels: NDArray[Any], /) -> Picture: ...
    def near(self, figures: Sequence[_Edges], blur: float) -> KeptPixels: ...

@final
class KeptPixels:
    """The pixels of a picture near the outlines that were measured in it."""

@final
class Lattice:
    """Crossings of a chessboard's grid lines in rows and columns."""

    @property
    def crossings(self) -> NDArray[np.float64]: ...

@final
class SideSamples:
    """The samples of one side."""

    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def std(self) -> NDArray[np.float64]: ...
    @property
    def blur(self) -> float: ...
    @property
    def drift(self) -> NDArray[np.float64] | None: ...

@final
class PictureFaults:
    """Faults of a picture as a whole."""

    @property
    def clipped(self) -> float: ...
    @property
    def has_two_levels(self) -> bool: ...
    @property
    def row_shift(self) -> tuple[float, float] | None: ...
    @property
    def colour_shift(self) -> tuple[float, float] | None: ...
    @property
    def is_green(self) -> bool: ...
    @property
    def motion(self) -> tuple[float, float] | None: ...
    @property
    def blur(self) -> float: ...
    @property
    def pattern(self) -> float | None: ...
    @property
    def side_error(self) -> float: ...
    @property
    def line_error(self) -> float: ...
    def mended(self, picture: Picture) -> Picture | None: ...

@final
class ToneEstimate:
    """An estimated tone curve."""

    @property
    def gamma(self) -> float: ...
    @property
    def toe(self) -> float: ...
    @property
    def effective_gamma(self) -> float: ...
    @property
    def std(self) -> float: ...
    @property
    def is_free(self) -> bool: ...
    @property
    def remaining_std(self) -> float: ...
    @property
    def shift_std(self) -> float | None: ...
    @property
    def contradiction(self) -> float: ...

@final
class ToneFit:
    """Tone curve of a picture as estimated by the fit to the pixels."""

    @property
    def effective_gamma(self) -> float: ...
    @property
    def std(self) -> float | None: ...
    @property
    def shift(self) -> tuple[float, float] | None: ...

@final
class SolvedPlane:
    """One plane of a calibration."""

    @property
    def figure(self) -> int: ...
    @property
    def image(self) -> int: ...
    @property
    def corners(self) -> NDArray[np.float64]: ...
    @property
    def rotation(self) -> NDArray[np.float64]: ...
    @property
    def translation(self) -> NDArray[np.float64]: ...
    @property
    def rms(self) -> float: ...
    @property
    def samples(self) -> int: ...
    @property
    def uncertainty(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None: ...
    @property
    def aspect(self) -> tuple[float, float] | None: ...
    @property
    def radii(self) -> list[tuple[float, float]]: ...

@final
class FigureResiduals:
    """Distances of the samples of a figure from the images of its lines, line by line."""

    @property
    def plane(self) -> int: ...
    @property
    def distances(self) -> list[NDArray[np.float64]]: ...
    @property
    def normals(self) -> list[NDArray[np.float64]]: ...

@final
class SolutionWarning:
    """A possible error of a calibration, and the plane or the picture that it is about."""

    @property
    def text(self) -> str: ...
    @property
    def code(self) -> str: ...
    @property
    def severity(self) -> str: ...
    @property
    def plane(self) -> int | None: ...
    @property
    def picture(self) -> int | None: ...

@final
class ResidualCorrelation:
    """Departure of the residuals from independent noise."""

    @property
    def neighbours(self) -> float: ...
    @property
    def probability(self) -> float: ...
    @property
    def displacements(self) -> list[float]: ...
    @property
    def contradiction(self) -> float: ...

@final
class Solution:
    """A calibrated camera with its uncertainty, and the poses of the planes."""

    @property
    def camera_matrix(self) -> NDArray[np.float64]: ...
    @property
    def distortion(self) -> NDArray[np.float64]: ...
    @property
    def valid_radius(self) -> float: ...
    @property
    def model(self) -> str: ...
    @property
    def parameters(self) -> list[str]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def std(self) -> dict[str, float]: ...
    @property
    def planes(self) -> list[SolvedPlane]: ...
    @property
    def lines(self) -> list[tuple[int, float | None, bool]]: ...
    @property
    def residuals(self) -> list[FigureResiduals]: ...
    @property
    def rms(self) -> float: ...
    @property
    def noise_scale(self) -> float: ...
    @property
    def warnings(self) -> list[SolutionWarning]: ...
    @property
    def stage(self) -> str: ...
    @property
    def alternatives(self) -> list[tuple[str, float, float]]: ...
    @property
    def correlation(self) -> ResidualCorrelation: ...
    @property
    def tones(self) -> list[ToneFit]: ...
    @property
    def tone_growth(self) -> float | None: ...

@final
class Verdict:
    """Decision on a candidate plane."""

    @property
    def figure(self) -> int: ...
    @property
    def kept(self) -> bool: ...
    @property
    def residual(self) -> float | None: ...

@final
class Outcome:
    """The figures that are kept, and the calibration from them or the reason for its failure."""

    @property
    def verdicts(self) -> list[Verdict]: ...
    @property
    def doubt(self) -> str | None: ...
    def solution(self) -> Solution: ...

def calibrate(
    figures: Sequence[_Edges],
    image_size: tuple[int, int],
    *,
    choosing: bool,
    method: str,
    model: str,
    fixed: Sequence[str],
    initial: _Camera | None,
    pictures: Sequence[KeptPixels] | None,
    tones: Sequence[str | float | tuple[float, float, bool, float]],
    threads: int = ...,
    side_errors: Sequence[tuple[float, float]] = ...,
    orthogonal: Sequence[tuple[int, int]] = ...,
    parallel: Sequence[tuple[int, int]] = ...,
    free: Sequence[str] = ...,
) -> Outcome: ...

@final
class Prediction:
    """Predicted uncertainty of a camera."""

    @property
    def parameters(self) -> list[str]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def std(self) -> dict[str, float]: ...

def predict(
    camera: _Camera,
    image_size: tuple[int, int],
    planes: Sequence[tuple[NDArray[np.float64], Sequence[float], Sequence[NDArray[np.float64]]]],
    *,
    sigma: float,
    spacing: float,
    model: str,
    fixed: Sequence[str],
    judged: bool,
    free: Sequence[str] = ...,
) -> Prediction: ...
def find_arcs(
    picture: NDArray[np.float32],
    weak: float,
    strong: float,
    tolerance: float,
    shortest: int,
    smallest_radius: float,
) -> list[NDArray[np.float64]]: ...
def find_four_cornered(mask: NDArray[np.uint8], least_side: int) -> NDArray[np.int32]: ...
def find_four_sided(
    picture: NDArray[np.uint8], levels: Sequence[int], least_side: float, margin: int
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.bool_]]: ...
def find_lattices(
    photograph: NDArray[np.uint8],
    pictures: Sequence[NDArray[np.uint8]],
) -> tuple[list[Lattice], int]: ...
def fit_sides(
    picture: NDArray[np.uint8],
    rough: NDArray[np.float64],
    is_dark: NDArray[np.bool_],
    least_inliers: float,
    least_inliers_hidden: float,
    most_cosine: float,
) -> tuple[NDArray[np.uintp], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]: ...
def localise(
    picture: Picture, spans: Sequence[_Span], tone: str | float | None
) -> tuple[list[SideSamples | str], ToneEstimate, PictureFaults]: ...
def remove_edge_shift(
    lines: Sequence[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp], float]],
) -> tuple[list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]], float]: ...
def rectangle_lines(sides: Sequence[NDArray[np.float64]], aspect: float) -> NDArray[np.float64]: ...
def family_lines(
    along_x: Sequence[NDArray[np.float64]], along_y: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]: ...
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
def provoke_panic(threads: int = 1) -> None: ...
def valid_radius(camera: _Camera) -> float: ...
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
    view: _View,
    whole: NDArray[np.int16],
    parts: NDArray[np.uint16],
    valid: NDArray[np.bool_],
) -> None: ...
def view_directions(view: _View, pixels: NDArray[np.float64]) -> NDArray[np.float64]: ...
def view_pixels(view: _View, directions: NDArray[np.float64]) -> NDArray[np.float64]: ...
def largest_rectangle(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]: ...
def can_project(camera: _Camera, points: NDArray[np.float64]) -> list[bool]: ...
def can_unproject(camera: _Camera, pixels: NDArray[np.float64]) -> list[bool]: ...
def is_covariance(matrix: NDArray[np.float64]) -> bool: ...
def projection_covariance(
    camera: _UncertainCamera, pixels: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def nearest_lens(
    lens: _AnyLens, image_size: tuple[int, int], name: str, square_pixels: bool, terms: str
) -> tuple[tuple[float, float, float, float], list[float], float, float, float]: ...
def compare_projections(
    first: _UncertainCamera, second: _UncertainCamera, pixels: NDArray[np.float64]
) -> tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    tuple[NDArray[np.float64], float, int, float] | None,
]: ...
def angle_between_planes(
    camera: _UncertainCamera,
    rotations: Sequence[NDArray[np.float64]],
    uncertainties: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[float, float]: ...
def points_on_plane(
    camera: _Camera, pose: _Pose, pixels: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def points_on_plane_with_covariance(
    camera: _UncertainCamera,
    pose: _Pose,
    uncertainty: tuple[NDArray[np.float64], NDArray[np.float64]],
    pixels: NDArray[np.float64],
    pixel_std: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
