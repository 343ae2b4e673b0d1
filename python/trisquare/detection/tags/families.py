"""The dictionaries of tags that are known, by name."""

from __future__ import annotations

from dataclasses import dataclass

from trisquare._support.suggestions import unknown

SIZES = {
    **{f"{n}X{n}_{size}": size for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36H12": 250,
    "APRILTAG_16H5": 30,
    "APRILTAG_25H9": 35,
    "APRILTAG_36H10": 2320,
    "APRILTAG_36H11": 587,
}
"""Codes in each dictionary, which is OpenCV's without the leading ``DICT_``."""

DICTIONARIES = tuple(SIZES)
APRILTAG = tuple(name for name in DICTIONARIES if name.startswith("APRILTAG"))
ARUCO = tuple(name for name in DICTIONARIES if name not in APRILTAG)

WIDE_BORDERED = "APRILTAG_36H11"
"""Kalibr prints the border of AprilTags, of which this is the usual family, twice as wide."""

LARGEST = tuple(name for name in DICTIONARIES if not name.endswith(("_50", "_100", "_250")))
"""Without those that are the beginning of another one."""


@dataclass(frozen=True, slots=True)
class TagSearch:
    """Which dictionaries to look tags up in, and whether those are known to be there."""

    names: tuple[str, ...]
    stated: bool = False


def dictionary_name(text: str) -> str:
    """Return the one of `DICTIONARIES` that a text such as ``dict_6x6_250`` or ``36h11`` means.

    Raises
    ------
    ValueError
        If it means none.
    """
    wanted = text.upper().removeprefix("DICT_")
    for name in (wanted, f"APRILTAG_{wanted.removeprefix('TAG')}", f"ARUCO_{wanted}"):
        if name in SIZES:
            return name
    raise unknown("dictionary", text, DICTIONARIES, f"among {', '.join(DICTIONARIES)}")
