"""Report on a calibration: one HTML file that opens anywhere, offline, and can be printed.

Its text is laid out by Jinja and its plots are drawn by matplotlib: the extra `trisquare[report]`.
"""

from __future__ import annotations

from collections.abc import Sequence

from trisquare._support.writing import PathLike, check_writable, write_atomically
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import ImageSource
from trisquare.images.sources import sources_of
from trisquare.results.calibration import Calibration

__all__ = ["check_extra", "report_page", "write_report"]


def write_report(
    calibration: Calibration,
    path: PathLike,
    image: ImageSource | Sequence[ImageSource] = (),
    *,
    command: str | None = None,
) -> None:
    """Write a calibration as one self-contained HTML file.

    Parameters
    ----------
    calibration : Calibration
        The calibration to report.
    path : str or path
        The file; it is written completely or not at all.
    image : path, bytes, binary file, PIL.Image.Image or ndarray, or several of them
        The photographs, in the order they were given to `calibrate`; without them the page has
        only plots and tables. The residuals are those of the calibration.
    command : str, optional
        A command line that repeats the calibration, shown on the page.

    Raises
    ------
    ImportError
        If Jinja or matplotlib is not installed.
    ImageError
        If a photograph cannot be read completely.
    OSError
        If the file cannot be written.
    TypeError, ValueError
        For bad arguments, or if a photograph is not of the camera's size.

    Examples
    --------
    >>> ts.write_report(result, "report.html", "photo.jpg")
    """
    check_writable(path)
    write_atomically({path: report_page(calibration, image, command=command)})


def report_page(
    calibration: Calibration,
    image: ImageSource | Sequence[ImageSource] | Photographs = (),
    *,
    command: str | None = None,
) -> bytes:
    """Return the page that `write_report` writes, in UTF-8; it depends only on the arguments.

    Photographs that are already loaded may be given as `Photographs`.

    Examples
    --------
    >>> from trisquare.report import report_page
    >>> report_page(result)[:15]
    b'<!DOCTYPE html>'
    """
    check_extra()
    if not isinstance(calibration, Calibration):
        raise TypeError(f"calibration must be a Calibration, not {type(calibration).__name__}")
    from trisquare.report.page import page_of  # requires the extra

    photographs = image if isinstance(image, Photographs) else Photographs(sources_of(image))
    return page_of(calibration, photographs, command)


def check_extra() -> None:
    """Raise ImportError, with what to install, unless a report can be written."""
    try:
        import jinja2  # noqa: F401
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "a report needs jinja2 and matplotlib: pip install 'trisquare[report]'"
        ) from error
