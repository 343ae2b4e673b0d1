"""Graphical page in the browser, and the API behind it: the extra `trisquare[serve]`.

Everything stays on the machine: pictures are kept in a folder of their own during a request.
"""

from __future__ import annotations

__all__ = ["check_extra"]


def check_extra() -> None:
    """Raise ImportError, with what to install, unless the page can be served."""
    try:
        import python_multipart  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "the page needs starlette, uvicorn and python-multipart: pip install 'trisquare[serve]'"
        ) from error
