"""Camera calibration with lens distortion from a single photograph of three squares.

>>> import trisquare as ts
>>> result = ts.calibrate("photo.jpg")
>>> K, distortion, std_fx = result.camera.K, result.camera.distortion, result.std["fx"]

Names are loaded on first access (PEP 562), so that a program loads only what it uses.
"""

import sys as _sys
from importlib import import_module as _import_module
from typing import get_type_hints as _get_type_hints

# The public names, which `__init__.pyi` repeats for type checkers.
_NAMES_OF_MODULES = {
    "_core": ("__version__",),
    "analysis.comparison": ("Comparison", "compare"),
    "analysis.diagnosis": ("Diagnosis", "diagnose"),
    "analysis.measure": ("Measurement", "measure"),
    "analysis.plane_angle": ("PlaneAngle", "plane_angle"),
    "analysis.predict": ("PlannedSquare", "Prediction", "predict"),
    "analysis.rectify": ("TopView", "rectify"),
    "batch.inputs": ("find_jobs",),
    "batch.jobs": ("Job",),
    "batch.run": ("JobResult", "calibrate_many"),
    "calibration.calibrate": ("calibrate", "calibrate_edges"),
    "calibration.linear_steps": (
        "Straightening",
        "camera_matrix_from_homographies",
        "fit_distortion",
        "homography_from_lines",
        "pose_from_homography",
    ),
    "calibration.locate": ("locate",),
    "camera.camera": ("Camera",),
    "camera.panorama": ("Panorama",),
    "camera.projection_uncertainty": ("ProjectionMap",),
    "drawing.overlay": ("draw_overlay",),
    "edges": ("PlaneEdges",),
    "errors": (
        "ConvergenceError",
        "DegenerateGeometryError",
        "DetectionError",
        "ImageError",
        "InternalError",
        "LensModelError",
        "MissingImageError",
        "NotEnoughDataError",
        "NotEnoughPlanesError",
        "TrisquareError",
        "error_members",
        "http_status",
    ),
    "formats": ("Approximation",),
    "images.reading": ("read_image",),
    "measurement.detect": ("detect",),
    "printing.target": ("PrintedTarget", "printed_target"),
    "report": ("write_report",),
    "results.calibration": ("Calibration",),
    "results.calibration_warning": ("CalibrationWarning",),
    "results.model_alternative": ("ModelAlternative",),
    "results.partial_detection": ("PartialDetection",),
    "results.plane": ("Plane",),
    "results.pose_uncertainty": ("PoseUncertainty",),
    "results.rejected": ("Rejected",),
    "results.residual_correlation": ("ResidualCorrelation",),
    "results.residuals": ("FigureResiduals",),
    "results.scene_line": ("SceneLine",),
    "straightening.camera": ("DisplacementMap", "UnscaledCamera"),
    "straightening.straighten": ("Straightened", "straighten"),
    "undistortion.undistort": ("Undistorter", "undistort"),
}
_MODULES = {
    name: f"trisquare.{room}" for room, names in _NAMES_OF_MODULES.items() for name in names
}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'trisquare' has no attribute {name!r}")
    _import_module(_MODULES[name])
    _publish_loaded()
    return globals()[name]


def __dir__() -> list[str]:
    """List only the public names; rooms can be imported by their own names."""
    return __all__


def _publish_loaded() -> None:
    """Bind every public name whose module has been loaded, by whatever import.

    Pickles and reprs then name the package, not the room in which a class is defined; annotations
    are resolved first, with the names of that room.
    """
    for name, module in _MODULES.items():
        if name in globals() or module not in _sys.modules:
            continue
        public = getattr(_import_module(module), name)  # waits if another thread is loading it
        if isinstance(public, type):
            public.__annotations__ = _get_type_hints(public)
            public.__module__ = __name__
        globals()[name] = public
