"""A stand-in for a calibration, to measure the overhead of a batch."""

from __future__ import annotations

from typing import Any

ANSWER = "{" + 9_000 * " " + "}\n"
"""A text of the length of a calibration's JSON."""


def stub(job: Any, limits: object) -> tuple[dict[str, Any], str]:
    """Return at once, as for a calibrated camera."""
    numbers = dict.fromkeys(("fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2"), 1.0)
    record = {
        "name": job.name,
        "status": "done",
        "photographs": list(job.photographs),
        "file": f"cameras/{job.file_name}",
        "software": "0",
        "image_size": [1280, 960],
        "model": "radial2",
        "values": numbers,
        "std": numbers,
        "rms_px": 0.02,
        "noise_scale": 1.0,
        "planes": 3,
        "warnings": [],
    }
    return record, ANSWER
