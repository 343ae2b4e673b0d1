"""The captions of the table of contents as headings of a level, which readers of screens need."""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx

HEADING = 'class="caption" role="heading"'
PARTS = ("body", "furo_navigation_tree", "toc")
"""Parts of a page that may have such captions."""

AFTER_THE_THEME = 900
"""Handlers of a higher priority number run later; the theme has the default of 500."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Change each page when its parts are ready."""
    app.connect("html-page-context", _with_levels, priority=AFTER_THE_THEME)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _with_levels(
    app: Sphinx, page: str, template: str, context: dict[str, Any], document: Any
) -> None:
    for part in PARTS:
        if HEADING in context.get(part, ""):
            context[part] = context[part].replace(HEADING, f'{HEADING} aria-level="2"')
