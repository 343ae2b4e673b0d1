"""Camera calibration with lens distortion from a single photograph of three squares.

>>> import trisquare as ts
>>> result = ts.calibrate("photo.jpg")  # doctest: +SKIP
>>> result.camera.K, result.camera.distortion, result.std["fx"]  # doctest: +SKIP
"""

from trisquare._core import __version__
from trisquare.calibrate import calibrate, calibrate_edges
from trisquare.camera import Camera
from trisquare.coherence import Coherence
from trisquare.comparison import Comparison, compare
from trisquare.detect import detect
from trisquare.edges import PlaneEdges
from trisquare.errors import (
    ConvergenceError,
    DegenerateGeometryError,
    DetectionError,
    ImageError,
    InternalError,
    LensModelError,
    NotEnoughDataError,
    NotEnoughPlanesError,
    TrisquareError,
)
from trisquare.locating import locate
from trisquare.measure import Measurement
from trisquare.model_alternative import ModelAlternative
from trisquare.pose_uncertainty import PoseUncertainty
from trisquare.predict import PlannedSquare, Prediction, predict
from trisquare.projection import ProjectionMap
from trisquare.rejected import Rejected
from trisquare.result import Calibration, Plane
from trisquare.sighting import Sighting
from trisquare.steps import (
    Straightening,
    camera_matrix_from_homographies,
    fit_distortion,
    homography_from_lines,
    pose_from_homography,
)
from trisquare.target import PrintedTarget, printed_target
from trisquare.top_view import TopView, rectify
from trisquare.undistortion import Undistorter

__all__ = [
    "Calibration",
    "Camera",
    "Coherence",
    "Comparison",
    "ConvergenceError",
    "DegenerateGeometryError",
    "DetectionError",
    "ImageError",
    "InternalError",
    "LensModelError",
    "Measurement",
    "ModelAlternative",
    "NotEnoughDataError",
    "NotEnoughPlanesError",
    "Plane",
    "PlaneEdges",
    "PlannedSquare",
    "PoseUncertainty",
    "Prediction",
    "PrintedTarget",
    "ProjectionMap",
    "Rejected",
    "Sighting",
    "Straightening",
    "TopView",
    "TrisquareError",
    "Undistorter",
    "__version__",
    "calibrate",
    "calibrate_edges",
    "camera_matrix_from_homographies",
    "compare",
    "detect",
    "fit_distortion",
    "homography_from_lines",
    "locate",
    "pose_from_homography",
    "predict",
    "printed_target",
    "rectify",
]
