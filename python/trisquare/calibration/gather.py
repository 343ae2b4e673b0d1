"""Collection of what the photographs of a calibration show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import compress
from typing import TYPE_CHECKING

import trisquare._core as _core
from trisquare._support.arrays import FloatArray
from trisquare._support.log import LOG
from trisquare._support.terminal_text import printable
from trisquare._support.threads import in_order
from trisquare.calibration.measured_photograph import (
    MeasuredPhotograph,
    SearchSettings,
    measured_photograph,
)
from trisquare.calibration.repeated_views import repeated_views
from trisquare.edges import PlaneEdges, changed_edges
from trisquare.errors import ImageError
from trisquare.images.faults import PictureFaults
from trisquare.images.photographs import Photographs
from trisquare.images.tone import PictureTone
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.rejected import Rejected

if TYPE_CHECKING:  # the import loads OpenCV, which is delayed until a picture is searched
    from trisquare.measurement.find import Search

MAX_EXPLAINED = 4
"""Maximum number of pictures whose rejected shapes a failure reports, those with the fewest
targets: with a hundred pictures, reporting all of them would double the time."""

ACTION_CODES = {"orientation_ignored"}
"""Remarks on photographs that require an action: a picture loaded turned has another camera."""

LEAVE_OUT = "to calibrate without it, name the others, or move it out of the folder"


@dataclass(slots=True)
class Gathered:
    """What was found and measured in the photographs so far.

    Attributes
    ----------
    image_size : (int, int)
        Width and height of every photograph that is used, in pixels.
    names : list of str
        Names of all photographs.
    sizes : list of (int, int)
        Width and height of all photographs, in pixels.
    figures : list of PlaneEdges
        Measured figures, each with the index of its photograph and the number of its plane, which
        is counted over all photographs.
    lines : list of PlaneEdges
        Lines of the scene, each with the index of its photograph.
    quads : dict of int to ndarray, shape (4, 2)
        Four points that enclose each plane, by the plane's number.
    rejected : list of Rejected
    warnings : list of CalibrationWarning
    pictures : list of KeptPixels
        The pixels of every photograph near the outlines that were measured.
    tones : list of PictureTone
        Tone curves of all photographs.
    faults : list of PictureFaults
        Faults of all photographs.
    searches : dict of int to Search
        Searches of the photographs whose rejected shapes may be asked for.
    """

    image_size: tuple[int, int] = (0, 0)
    figures: list[PlaneEdges] = field(default_factory=list)
    lines: list[PlaneEdges] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    sizes: list[tuple[int, int]] = field(default_factory=list)
    quads: dict[int, FloatArray] = field(default_factory=dict)
    rejected: list[Rejected] = field(default_factory=list)
    warnings: list[CalibrationWarning] = field(default_factory=list)
    pictures: list[_core.KeptPixels] = field(default_factory=list)
    tones: list[PictureTone] = field(default_factory=list)
    faults: list[PictureFaults] = field(default_factory=list)
    searches: dict[int, Search] = field(default_factory=dict)

    def add(self, photograph: MeasuredPhotograph) -> None:
        """Add what was measured in the next photograph, and its warnings."""
        measured, annotated, index = photograph.measured, photograph.annotated, len(self.names)
        self.names.append(photograph.name)
        self.sizes.append(photograph.size)
        self.searches[index] = measured.search
        self.pictures.append(measured.pixels)
        self.tones.append(measured.tone)
        self.faults.append(measured.faults)
        self.rejected += [replace(candidate, image=index) for candidate in measured.rejected]
        self.warnings += [
            CalibrationWarning(text, code, "medium" if code in ACTION_CODES else "low")
            for code, text in photograph.remarks
        ]
        if annotated is not None:
            self.warnings += [
                CalibrationWarning(f"{photograph.name}: {candidate.reason}", "outline_rejected")
                for candidate in measured.rejected
            ]
        if photograph.missing_reason:
            self.warnings.append(
                CalibrationWarning(
                    f"{photograph.name}: {photograph.missing_reason}", "nothing_found"
                )
            )
        for figure in measured.figures:
            plane = None if figure.plane is None else figure.plane + len(self.quads)
            self.figures.append(changed_edges(figure, image=index, plane=plane))
        self.lines += [changed_edges(line, image=index) for line in photograph.lines]
        self.quads.update(enumerate(measured.quads, len(self.quads)))

    def leave_out_other_sizes(self) -> None:
        """Leave out the photographs that differ in size from most.

        Raises
        ------
        ValueError
            If no size is shared by most photographs.
        """
        counts = Counter(self.sizes).most_common()
        self.image_size, count = counts[0]
        odd_index = next((i for i, size in enumerate(self.sizes) if size != self.sizes[0]), None)
        if odd_index is not None and 2 * count <= len(self.sizes):
            first = self.sizes[0]
            turned = " (one seems to be turned)" if first == self.sizes[odd_index][::-1] else ""
            raise ValueError(
                f"{self._described(odd_index)}, but {self.names[0]} is {first[0]} x {first[1]}: "
                f"all pictures of one camera must have the same size{turned}"
            )
        is_kept = [size == self.image_size for size in self.sizes]
        for index in [i for i, has_size in enumerate(is_kept) if not has_size]:
            text = f"{self._described(index)}, unlike {count} others: it is left out"
            self.warnings.append(CalibrationWarning(text, "other_size"))
            self.searches.pop(index, None)
        self.figures = [figure for figure in self.figures if is_kept[figure.image]]
        self.lines = [line for line in self.lines if is_kept[line.image]]
        self.rejected = [candidate for candidate in self.rejected if is_kept[candidate.image]]
        self.pictures = list(compress(self.pictures, is_kept))
        self.tones = list(compress(self.tones, is_kept))
        self.faults = list(compress(self.faults, is_kept))

    def leave_out_repeated_views(self) -> None:
        """Leave out figures and lines of photographs that repeat another, with the same noise."""
        repeated = repeated_views(self.figures)
        for index, twin in repeated.items():
            shown = f"{self.names[index]} shows the same as {self.names[twin]}, with the same noise"
            text = f"{shown}: it is counted once"
            self.warnings.append(CalibrationWarning(text, "repeated_picture", "low"))
        self.figures = [figure for figure in self.figures if figure.image not in repeated]
        self.lines = [line for line in self.lines if line.image not in repeated]

    @property
    def edges(self) -> list[PlaneEdges]:
        """The figures, followed by the lines: the order and numbering of the core's input."""
        return [*self.figures, *self.lines]

    @property
    def images(self) -> list[int]:
        """Indices of the photographs that are used."""
        return [i for i, size in enumerate(self.sizes) if size == self.image_size]

    def _described(self, index: int) -> str:
        width, height = self.sizes[index]
        return f"{self.names[index]} is {width} x {height} pixels"

    def forget_richest_search(self) -> None:
        """Forget the search of the photograph with the most targets, the last one of several."""
        if len(self.searches) > MAX_EXPLAINED:
            counts = {index: len(search.targets) for index, search in self.searches.items()}
            del self.searches[max(counts, key=lambda index: (counts[index], index))]


@contextmanager
def _leave_out_advised(count: int) -> Iterator[None]:
    """Add advice to the error of one of several pictures: how to calibrate without it."""
    try:
        yield
    except ImageError as error:
        if count > 1:
            error.args = (f"{error}; {LEAVE_OUT}",)
        raise


def gather(
    photographs: Photographs,
    search_settings: SearchSettings,
    progress: Callable[[int, int], None] | None,
    *,
    threads: int,
    explain_all: bool,
) -> Gathered:
    """Find and measure the targets of several photographs, in `threads` threads.

    `explain_all` is whether the rejected shapes of every photograph may be asked for; `progress` is
    as in `calibrate`.

    Raises
    ------
    ImageError
        If a file cannot be read completely.
    TypeError, ValueError
        For bad arguments, and if no size is shared by most photographs.
    """
    gathered = Gathered()
    measure = partial(
        measured_photograph, search_settings=search_settings, is_alone=len(photographs) == 1
    )
    tasks = (partial(measure, load) for load in photographs.loaders())
    with _leave_out_advised(len(photographs)), closing(in_order(tasks, threads)) as results:
        for measured_count, photograph in enumerate(results, 1):
            gathered.add(photograph)
            count = len(photograph.measured.figures)
            name = printable(photograph.name)
            LOG.info(
                "%s: %d figures measured; %d of %d", name, count, measured_count, len(photographs)
            )
            if not explain_all:
                gathered.forget_richest_search()
            if progress is not None:
                progress(measured_count, len(photographs))
    gathered.leave_out_other_sizes()
    gathered.leave_out_repeated_views()
    if search_settings.lines and not gathered.lines:
        text = "no long edges beside the targets: no lines of the scene are used"
        gathered.warnings.append(CalibrationWarning(text, "no_lines", "low"))
    return gathered
