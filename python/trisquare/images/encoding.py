"""Encoding of pictures in the format of a file name's extension."""

from __future__ import annotations

from pathlib import Path

from trisquare._support.paths import shown
from trisquare._support.writing import PathLike
from trisquare.images.orientation import OrientationTag, with_orientation
from trisquare.images.pixels import Image


def check_picture_name(path: PathLike) -> None:
    """Raise ValueError if no picture format has the path's extension."""
    import cv2  # loaded where a picture is encoded

    suffix = Path(path).suffix
    # Only the extension: a name that is not UTF-8 crashes OpenCV.
    if not (suffix.isascii() and cv2.haveImageWriter(f"picture{suffix}")):
        raise ValueError(
            f"{shown(path)}: pictures cannot be written with the extension {suffix!r}: use .png, "
            ".jpg, .tif or .webp"
        )


def encode_turned(
    image: Image, path: PathLike, tag: OrientationTag | None
) -> tuple[bytes, str | None]:
    """Encode a picture made from one with an orientation tag, so that both are shown alike.

    Returns
    -------
    bytes
        As of `encode_image`, with the tag if the format keeps it.
    str or None
        A remark for the user if it does not.
    """
    encoded = encode_image(image, path)
    if tag is None:
        return encoded, None
    kept = with_orientation(encoded, tag.value)
    if kept is not None:
        return kept, None
    return encoded, (
        f"{shown(path)}: its format does not keep the photograph's orientation tag "
        f"({tag.turn}); JPEG and PNG do"
    )


def encode_image(image: Image, path: PathLike) -> bytes:
    """Encode a picture in the format that the path's extension names.

    Raises
    ------
    ValueError
        If no format has that extension.
    """
    import cv2  # loaded where a picture is encoded

    check_picture_name(path)
    encoded = cv2.imencode(Path(path).suffix, image)[1]
    return encoded.tobytes()
