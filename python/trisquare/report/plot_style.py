"""How plots look: vectors whose colours the page gives, so that they follow light and dark."""

from __future__ import annotations

import io
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOT_WIDTH, PLOT_HEIGHT = 4.8, 3.5
"""Inches: at the 72 points of SVG about as wide as a phone, where its 10-point text can be read."""

SERIES = 6
"""Colours that are told apart; planes beyond take them again, and are numbered."""

# matplotlib writes colours as such numbers, and the page replaces them by its own. No colour that
# is meant as a colour is so nearly black.
INK, FAINT, GRID, GROUND = "#000001", "#000002", "#000003", "#000004"
PAGE_COLOURS = {
    INK: "var(--ink)",
    FAINT: "var(--faint)",
    GRID: "var(--line)",
    GROUND: "var(--ground)",
    **{f"#0000{number + 16:02x}": f"var(--plane-{number})" for number in range(SERIES)},
}

SETTINGS = {
    "svg.fonttype": "none",  # text stays text: small, found by a search, in the page's font
    "font.size": 10.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.use_mathtext": False,
    "figure.facecolor": "none",
    "figure.constrained_layout.use": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}

_settings_lock = threading.Lock()


def plane_colour(plane: int) -> str:
    """Return the colour of a plane, by its number."""
    return f"#0000{plane % SERIES + 16:02x}"


@contextmanager
def plotting() -> Iterator[None]:
    """Draw and save plots within: nobody's own settings of matplotlib matter.

    They belong to the process, so that one thread at a time draws a report.
    """
    import matplotlib.style

    with _settings_lock, matplotlib.style.context(["default", SETTINGS]):
        yield


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as an ``svg`` element for a page; within `plotting`.

    Parameters
    ----------
    figure : Figure
    name : str
        Begins the element's ids, lest two plots of a page share any.
    """
    import matplotlib

    stream = io.StringIO()
    # The hash gives clip paths and markers their ids: the same plot, the same bytes.
    with matplotlib.rc_context({"svg.hashsalt": name}):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(stream, format="svg", metadata=nothing)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    # Its one style sheet would hold for the whole page, which has the same rules for plots.
    text = re.sub(r"<style.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'^<svg([^>]*?) width="[^"]*"', r"<svg\1", text)
    text = re.sub(r'^<svg([^>]*?) height="[^"]*"', r'<svg\1 aria-hidden="true"', text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace('href="#', f'href="#{name}-').replace("url(#", f"url(#{name}-")
    # No font is named: the page's is used.
    text = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font-size: \1", text)
    text = re.sub(r"font-family: [^;\"]*(; )?", "", text)
    return re.sub("#0000[0-9a-f]{2}", lambda found: PAGE_COLOURS.get(found[0], found[0]), text)
