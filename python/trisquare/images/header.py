"""The size that a picture's header states, read before anything is decoded."""

from __future__ import annotations

import io


def stated_size(encoded: bytes) -> tuple[int, int] | None:
    """Return width and height by the header of an encoded picture.

    Parameters
    ----------
    encoded : bytes
        A file's content: JPEG, PNG, TIFF, WebP, BMP, GIF, JPEG 2000, AVIF or Netpbm.

    Returns
    -------
    (int, int) or None
        In pixels, as stored; None for other formats and for damaged headers, which OpenCV judges.
    """
    if encoded[:1].isspace() or encoded.startswith((b"<", b"\xef\xbb\xbf")):
        return None  # text, such as SVG: no picture here, and nothing to be parsed
    import imagesize  # loaded where a file is read

    try:
        width, height = imagesize.get(io.BytesIO(encoded), exif_rotation=False)
    except Exception:  # whatever a damaged header leads to
        return None
    return (int(width), int(height)) if min(width, height) > 0 else None
