"""Description of the API in OpenAPI."""

from __future__ import annotations

from typing import Any

from trisquare._core import __version__
from trisquare.batch.limits import JobLimits
from trisquare.formats.registry import FORMAT_NAMES
from trisquare.serve.limits import MAX_PICTURES
from trisquare.serve.tasks import FILES, TASKS

POINTS = {
    "type": "array",
    "items": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
}
NUMBER = {"type": "number"}
MAYBE_NUMBER = {"type": ["number", "null"]}
TEXT = {"type": "string"}
FLAG = {"type": "boolean"}
FILE = {"type": "string", "format": "binary"}
TEXTS = {"type": "array", "items": TEXT}
OUTLINES = {"type": "object", "description": "trisquare-outlines/1, or labelme's"}

OPTIONS: dict[str, dict[str, Any]] = {
    "method": {"enum": ["ml", "linear"]},
    "model": TEXT,
    "fix": TEXTS,
    "free": TEXTS,
    "tone": {"type": ["string", "number", "null"]},
    "targets": TEXT,
    "lines": FLAG,
    "outlines": OUTLINES,
    "guide": FLAG,
    "image_size": {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2},
    "camera": {"type": "object", "description": "trisquare/1 or trisquare-camera/1"},
    "focal": NUMBER,
    "sigma": NUMBER,
    "index": {"type": "integer", "minimum": 0},
    "balance": {"type": "number", "minimum": 0, "maximum": 1},
    "shown": FLAG,
    "approximate": FLAG,
    "frames": {"type": "integer", "minimum": 1, "maximum": MAX_PICTURES},
}


def _object(required: tuple[str, ...], **properties: Any) -> dict[str, Any]:
    return {"type": "object", "required": list(required), "properties": properties}


def _all(**properties: Any) -> dict[str, Any]:
    """Return an object in which all of these properties are required."""
    return _object(tuple(properties), **properties)


TARGET = _object(
    ("kind", "corners"),
    kind=TEXT,
    corners=POINTS,
    sides={"type": "array", "items": POINTS},
    inner=POINTS,
)
REJECTED = _object(
    ("kind", "image", "corners", "reason"),
    kind=TEXT,
    image=OPTIONS["index"],
    corners=POINTS,
    reason=TEXT,
    residual_px=MAYBE_NUMBER,
)
WARNING = _object(
    ("code", "severity", "text"), code=TEXT, severity=TEXT, plane=OPTIONS["index"], text=TEXT
)
GUIDANCE = _all(
    std={"type": ["object", "null"], "additionalProperties": NUMBER},
    focal=NUMBER,
    advice=TEXT,
    is_enough=FLAG,
)
ERROR = _all(
    error=_object(
        ("code", "text", "help"),
        code=TEXT,
        text=TEXT,
        help=TEXT,
        found={"type": "array", "items": {"type": "object"}},
        rejected={"type": "array", "items": REJECTED},
    )
)
ANSWERS: dict[str, dict[str, Any]] = {
    "find": _object(
        ("image_size", "found", "rejected"),
        image_size=OPTIONS["image_size"],
        found={"type": "array", "items": TARGET},
        rejected={"type": "array", "items": REJECTED},
        prediction=GUIDANCE,
    ),
    "calibrate": _all(
        result={"type": "object", "description": "trisquare/1, with edges and residuals"},
        parameters={
            "type": "array",
            "items": _all(name=TEXT, value=NUMBER, std=MAYBE_NUMBER),
        },
        warnings={"type": "array", "items": WARNING},
        diagnosis={
            "type": "object",
            "additionalProperties": _all(limits=TEXT, remedy=TEXT),
        },
    ),
    "predict": GUIDANCE,
    "compare": _all(
        verdict=TEXT,
        same={"type": ["boolean", "null"]},
        rms_px=NUMBER,
        worst_px=NUMBER,
        expected_rms_px=MAYBE_NUMBER,
        p_value=MAYBE_NUMBER,
    ),
}
"""Schemas of the routes that answer with JSON."""

STATUS = _all(
    version=TEXT,
    max_bytes={"type": "integer"},
    max_pixels={"type": "integer"},
    formats={"type": "array", "items": _all(name=TEXT, title=TEXT)},
    models=TEXTS,
    videos={"type": "array", "items": TEXT, "description": "endings of names"},
)

MEDIA: dict[str, tuple[str, ...]] = {
    "overlay": ("image/jpeg",),
    "undistort": ("image/png", "image/tiff", "image/jpeg"),
    "preview": ("image/jpeg",),
    "frames": ("multipart/form-data",),
    "report": ("text/html",),
    "convert": ("text/plain",),
}

SEVERAL = ("calibrate", "report")

SUMMARIES = {
    "find": "Find squares and other targets, or snap outlines that were drawn to edges.",
    "calibrate": "Calibrate a camera from its photographs.",
    "predict": "Predict the standard deviations, and the change that reduces them most.",
    "overlay": "Draw a result over its photograph.",
    "undistort": "Remove the lens distortion from a photograph.",
    "preview": "Return a photograph as a browser shows it.",
    "frames": "Choose sharp and different frames of a video; the answer is a form of pictures.",
    "report": "Write a result as one HTML page.",
    "convert": "Write a camera in another program's format.",
    "compare": "Compare two cameras by where they project.",
}

REFUSALS = {
    "400": "an argument or an option is wrong, or a file other than a picture is damaged",
    "401": "the token is missing or wrong",
    "405": "the address requires another method",
    "408": "the request does not arrive in time",
    "409": "the format has no model for the lens",
    "413": "the request is too large",
    "415": "a picture is unreadable, or beyond the limits",
    "422": "a picture does not determine the camera, or takes too much time or memory",
    "500": "trisquare has failed",
    "501": "an extra is not installed",
    "503": "too many requests at a time",
}


def api_schema(limits: JobLimits) -> dict[str, Any]:
    """Return the description of all routes, OpenAPI 3.1."""
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "trisquare",
            "version": __version__,
            "description": (
                f"A request has {limits.max_bytes} bytes at most, a picture {limits.max_pixels} "
                f"pixels; it computes for {limits.max_seconds:g} s at most."
            ),
        },
        "components": {
            "securitySchemes": {
                "parameter": {"type": "apiKey", "in": "query", "name": "token"},
                "header": {"type": "apiKey", "in": "header", "name": "X-Trisquare-Token"},
            }
        },
        "security": [{"parameter": []}, {"header": []}],
        "paths": {
            "/api/status": {"get": _status()},
            **{_path(name): {"post": _operation(name)} for name in TASKS},
        },
    }


def _status() -> dict[str, Any]:
    answer = {"application/json": {"schema": STATUS}}
    return {
        "operationId": "status",
        "summary": "Return the version, the limits, the formats and the models.",
        "responses": {"200": {"description": "done", "content": answer}, "401": _refusal("401")},
    }


def _refusal(status: str) -> dict[str, Any]:
    content = {"application/json": {"schema": ERROR}}
    return {"description": REFUSALS[status], "content": content}


def _path(name: str) -> str:
    return "/api/convert/{format}" if name == "convert" else f"/api/{name}"


def _operation(name: str) -> dict[str, Any]:
    known = [option for option in TASKS[name] if option != "format"]
    options = {
        "type": "object",
        "additionalProperties": False,
        "properties": {option: OPTIONS[option] for option in known},
    }
    content: dict[str, Any] = {}
    if FILES[name]:
        files: dict[str, Any] = {
            field: {"type": "array", "items": FILE}
            if field == "picture" and name in SEVERAL
            else FILE
            for field in FILES[name]
        }
        form = _object(FILES[name], **files, options=options)
        content["multipart/form-data"] = {"schema": form}
    else:
        content["application/json"] = {"schema": options}
    answer: dict[str, Any] = {media: {} for media in MEDIA.get(name, ())}
    if not answer:
        answer = {"application/json": {"schema": ANSWERS[name]}}
    operation: dict[str, Any] = {
        "operationId": name,
        "summary": SUMMARIES[name],
        "requestBody": {"required": True, "content": content},
        "responses": {
            "200": {"description": "done", "content": answer},
            **{status: _refusal(status) for status in REFUSALS},
        },
    }
    if name == "convert":
        operation["parameters"] = [
            {
                "name": "format",
                "in": "path",
                "required": True,
                "schema": {"enum": list(FORMAT_NAMES)},
            }
        ]
    return operation
