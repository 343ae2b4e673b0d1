"""The known dictionaries of tags, by name."""

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
"""Number of codes in each dictionary, by OpenCV's name without the leading ``DICT_``."""

DICTIONARIES = tuple(SIZES)
APRILTAG = tuple(name for name in DICTIONARIES if name.startswith("APRILTAG"))
ARUCO = tuple(name for name in DICTIONARIES if name not in APRILTAG)

WIDE_BORDERED = "APRILTAG_36H11"
"""Usual family of Kalibr's AprilTags, whose border it prints twice as wide."""

LARGEST = tuple(name for name in DICTIONARIES if not name.endswith(("_50", "_100", "_250")))
"""Dictionaries, without those that are the beginning of another one."""


@dataclass(frozen=True, slots=True)
class TagSearch:
    """Dictionaries in which to look tags up, and whether they are known to be present."""

    names: tuple[str, ...]
    stated: bool = False


def dictionary_name(text: str) -> str:
    """Return the name in `DICTIONARIES` for a text such as ``dict_6x6_250`` or ``36h11``.

    Raises
    ------
    ValueError
        If there is none.
    """
    wanted = text.upper().removeprefix("DICT_")
    for name in (wanted, f"APRILTAG_{wanted.removeprefix('TAG')}", f"ARUCO_{wanted}"):
        if name in SIZES:
            return name
    raise unknown("dictionary", text, DICTIONARIES, f"among {', '.join(DICTIONARIES)}")
