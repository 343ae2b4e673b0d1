"""Style of plots: vector graphics with the page's colours, which follow light and dark themes."""

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
"""Size of a plot, inches: at 72 points per inch in SVG about the width of a phone, on which its
10-point text is readable."""

SERIES = 6
"""Number of distinct colours; further planes repeat them, and all planes are numbered."""

# Placeholders of colours in matplotlib's output, which the page replaces by its own. No real colour
# is so nearly black.
INK, FAINT, GRID, GROUND = "#000001", "#000002", "#000003", "#000004"
PAGE_COLOURS = {
    INK: "var(--ink)",
    FAINT: "var(--faint)",
    GRID: "var(--line)",
    GROUND: "var(--ground)",
    **{f"#0000{number + 16:02x}": f"var(--plane-{number})" for number in range(SERIES)},
}

SETTINGS = {
    "svg.fonttype": "none",  # text is kept as text: small, searchable, in the page's font
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
    """Return the colour of a plane, given its number."""
    return f"#0000{plane % SERIES + 16:02x}"


@contextmanager
def plotting() -> Iterator[None]:
    """Set the style of plots that are drawn and saved within, whatever the user's settings are.

    matplotlib's settings belong to the process, so that only one thread at a time draws a report.
    """
    import matplotlib.style

    with _settings_lock, matplotlib.style.context(["default", SETTINGS]):
        yield


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as an ``svg`` element for a page; to be called within `plotting`.

    Parameters
    ----------
    figure : Figure
    name : str
        Prefix of the element's ids, so that no two plots of a page share any.
    """
    import matplotlib

    stream = io.StringIO()
    # The salt determines the ids of clip paths and markers: equal plots have equal bytes.
    with matplotlib.rc_context({"svg.hashsalt": name}):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(stream, format="svg", metadata=nothing)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    # Its style sheet would apply to the whole page, which has the same rules for plots.
    text = re.sub(r"<style.*?</style>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'^<svg([^>]*?) width="[^"]*"', r"<svg\1", text)
    text = re.sub(r'^<svg([^>]*?) height="[^"]*"', r'<svg\1 aria-hidden="true"', text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = text.replace('href="#', f'href="#{name}-').replace("url(#", f"url(#{name}-")
    # Without the names of fonts, the page's font is used.
    text = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font-size: \1", text)
    text = re.sub(r"font-family: [^;\"]*(; )?", "", text)
    return re.sub("#0000[0-9a-f]{2}", lambda found: PAGE_COLOURS.get(found[0], found[0]), text)
