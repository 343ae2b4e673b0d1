"""Camera calibration with lens distortion from a single photograph of three squares.

>>> import trisquare as ts
>>> result = ts.calibrate("photo.jpg")
>>> K, distortion, std_fx = result.camera.K, result.camera.distortion, result.std["fx"]
"""

from typing import get_type_hints as _get_type_hints

from trisquare._core import __version__
from trisquare.analysis.comparison import Comparison, compare
from trisquare.analysis.diagnosis import Diagnosis, diagnose
from trisquare.analysis.measure import Measurement, measure
from trisquare.analysis.predict import PlannedSquare, Prediction, predict
from trisquare.analysis.rectify import TopView, rectify
from trisquare.batch.inputs import find_jobs
from trisquare.batch.jobs import Job
from trisquare.batch.run import JobResult, calibrate_many
from trisquare.calibration.calibrate import calibrate, calibrate_edges
from trisquare.calibration.linear_steps import (
    Straightening,
    camera_matrix_from_homographies,
    fit_distortion,
    homography_from_lines,
    pose_from_homography,
)
from trisquare.calibration.locate import locate
from trisquare.camera.camera import Camera
from trisquare.camera.panorama import Panorama
from trisquare.camera.projection_uncertainty import ProjectionMap
from trisquare.edges import PlaneEdges
from trisquare.errors import (
    ConvergenceError,
    DegenerateGeometryError,
    DetectionError,
    ImageError,
    InternalError,
    LensModelError,
    MissingImageError,
    NotEnoughDataError,
    NotEnoughPlanesError,
    TrisquareError,
)
from trisquare.formats import Approximation
from trisquare.measurement.detect import detect
from trisquare.printing.target import PrintedTarget, printed_target
from trisquare.report import write_report
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.model_alternative import ModelAlternative
from trisquare.results.partial_detection import PartialDetection
from trisquare.results.plane import Plane
from trisquare.results.pose_uncertainty import PoseUncertainty
from trisquare.results.rejected import Rejected
from trisquare.results.residual_correlation import ResidualCorrelation
from trisquare.results.scene_line import SceneLine
from trisquare.straightening.camera import DisplacementMap, UnscaledCamera
from trisquare.straightening.straighten import Straightened, straighten
from trisquare.undistortion.undistort import Undistorter, undistort

__all__ = [
    "Approximation",
    "Calibration",
    "CalibrationWarning",
    "Camera",
    "Comparison",
    "ConvergenceError",
    "DegenerateGeometryError",
    "DetectionError",
    "Diagnosis",
    "DisplacementMap",
    "ImageError",
    "InternalError",
    "Job",
    "JobResult",
    "LensModelError",
    "Measurement",
    "MissingImageError",
    "ModelAlternative",
    "NotEnoughDataError",
    "NotEnoughPlanesError",
    "Panorama",
    "PartialDetection",
    "Plane",
    "PlaneEdges",
    "PlannedSquare",
    "PoseUncertainty",
    "Prediction",
    "PrintedTarget",
    "ProjectionMap",
    "Rejected",
    "ResidualCorrelation",
    "SceneLine",
    "Straightened",
    "Straightening",
    "TopView",
    "TrisquareError",
    "Undistorter",
    "UnscaledCamera",
    "__version__",
    "calibrate",
    "calibrate_edges",
    "calibrate_many",
    "camera_matrix_from_homographies",
    "compare",
    "detect",
    "diagnose",
    "find_jobs",
    "fit_distortion",
    "homography_from_lines",
    "locate",
    "measure",
    "pose_from_homography",
    "predict",
    "printed_target",
    "rectify",
    "straighten",
    "undistort",
    "write_report",
]


def __dir__() -> list[str]:
    """Show the public names alone; rooms can be imported by their own names."""
    return sorted(__all__)


# Pickles and reprs name the package, not the room that a class is written in; annotations are
# resolved before, with the names of that room.
for _name in __all__:
    if isinstance(_public := globals()[_name], type):
        _public.__annotations__ = _get_type_hints(_public)
        _public.__module__ = __name__
del _name, _public, _get_type_hints
