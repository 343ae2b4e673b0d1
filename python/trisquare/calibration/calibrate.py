"""Calibration from pictures, or from edges measured elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trisquare._support.arrays import callable_or_none, sequence, size_of_image
from trisquare._support.lengths import length_in
from trisquare._support.log import LOG
from trisquare._support.suggestions import advising
from trisquare._support.threads import thread_count
from trisquare.calibration.assemble import assemble
from trisquare.calibration.differing_pictures import differing_pictures
from trisquare.calibration.explain_failure import add_reasons, rejected_shapes
from trisquare.calibration.gather import Gathered, gather
from trisquare.calibration.measured_photograph import SearchSettings
from trisquare.calibration.missed_squares import has_few_squares, missed_squares
from trisquare.calibration.select import chosen_planes
from trisquare.calibration.solve import solve
from trisquare.camera.camera import Camera
from trisquare.camera.settings import AnyModel, Method, PlanePair, Settings
from trisquare.detection.kinds import TargetKinds, nothing_found
from trisquare.edges import PlaneEdges, changed_edges
from trisquare.errors import DetectionError, TrisquareError
from trisquare.images.frame_choice import with_frames
from trisquare.images.limits import PictureLimits
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import ImageSource, Outlines, Tone
from trisquare.images.sources import sources_of
from trisquare.results.calibration import Calibration
from trisquare.results.calibration_warning import CalibrationWarning
from trisquare.results.rejected import Rejected, is_reported

LARGE_SIDE = 10.0
"""Smallest side in metres, given as a plain number, for which a warning says that it may be in
millimetres."""

LIMIT_ADVICE = dict.fromkeys(
    ("max_seconds", "max_memory", "timeout"),
    "calibrate_many limits time and memory (max_seconds=, max_memory=), in separate processes",
)
"""Advice for arguments of `calibrate` that set limits, which need a separate process."""


@advising("give several photographs as one list, calibrate([first, second])", LIMIT_ADVICE)
def calibrate(
    image: ImageSource | Sequence[ImageSource],
    *,
    method: Method = "ml",
    model: AnyModel = "radial2",
    fix: str | Iterable[str] = (),
    free: str | Iterable[str] = (),
    initial: Calibration | Camera | None = None,
    orthogonal: Iterable[PlanePair] = (),
    parallel: Iterable[PlanePair] = (),
    tone: Tone = None,
    targets: str = "auto",
    outlines: Outlines | None = None,
    lines: bool = False,
    side: str | float | None = None,
    frames: int | None = None,
    threads: int | None = None,
    max_pixels: int | None = None,
    max_bytes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Calibrate a camera from one photograph of three squares, or from several photographs.

    Among the shapes that may be squares (or rectangles of a named shape), the largest set that is
    consistent with one camera is used. The others are in the result's ``rejected``. A warning is
    given if the choice is uncertain. If fewer than three squares are used, ``rejected`` also has
    the shapes that the picture's border cuts, and those with a side or an inside that cannot be
    measured, with the reason.

    Parameters
    ----------
    image : path, bytes, binary file, PIL.Image.Image or ndarray, or several of them
        Arrays are uint8, uint16 or float32 of shape (H, W), (H, W, 3) or (H, W, 4), grey, BGR or
        BGRA, whose alpha is dropped. A folder stands for the pictures in it, a pattern such as
        ``"frames/*.png"`` for the files that match, in the order of their names (``2.jpg`` before
        ``10.jpg``); pictures that trisquare drew on are skipped in both. Bytes are a file's
        content. Several photographs must be of one camera and size; their planes are pooled. A
        photograph that shows no target, or is given twice, is named in `warnings` and left out. A
        file's orientation tag is ignored, with a warning: the result refers to the picture as it
        is stored.
    method : {"ml", "linear"}
        Joint maximum likelihood, or only the three linear steps of Zhou et al. (2013). The standard
        deviations of the linear steps are those of maximum likelihood with residuals of the same
        size: they do not include the loss of precision in the steps themselves.
    model : {"none", "radial1", "radial2", "radial3", "brown", "equidistant", "fisheye1", \
"fisheye2", "fisheye", "rational", "brown_prism", "thin_prism", "auto"}
        The distortion coefficients that are estimated: see `Camera`. The fisheye models are for
        lenses that see more than about 90 degrees. Three squares seldom determine all
        coefficients beyond ``k1`` and ``k2``: a prior keeps ``k3``, ``p1`` and ``p2`` of "radial3"
        and "brown", and the further ones of the rational and the prism models, within the values
        that are usual for lenses (docs/method.md, "Which lens"); no other parameter has a prior.
        Prism and tangential terms together have the effect of another axis of the camera: with the
        prism models the principal point may have to be fixed. ``"auto"`` takes the model of "none"
        to "brown" with the largest evidence, by the density ratio of Dickey (1971) from the richest
        fit. It also tries a fisheye if, under these models, the samples of a side have correlated
        residuals or a wide field looks like a fisheye's, and takes it if it explains the edges
        clearly better by Schwarz's criterion (1978). The models not taken are in ``alternatives``;
        they add to the covariance according to their probabilities. It needs ``method="ml"`` and a
        free distortion.
    fix : names among "aspect", "principal_point", "focal", "distortion"
        One, several joined by commas, or a sequence: fixed at the values of `initial`, or else at
        aspect 1, the image centre, and zero. A fixed distortion has the model of `initial`; without
        `initial` the lens has no distortion, whatever `model` is.
    free : "skew", optional
        Parameter to estimate that is otherwise fixed at the value of `initial` or zero: the skew,
        ``K[0, 1]``. It needs ``method="ml"`` and, if nothing else is fixed, three planes.
    initial : Calibration or Camera, optional
        Values of the fixed parameters; "focal" needs them. They are also the start of the free
        parameters if the planes alone give no start.
    orthogonal, parallel : sequence of (int, int)
        Pairs of planes of one picture that are known to be at right angles to each other, or
        parallel, as walls and the faces of a box are: indices of ``planes`` of the result, whose
        order does not depend on these pairs. The estimated rotations meet the condition exactly. A
        warning is given if the edges contradict it.
    tone : {"auto", "srgb", "linear"} or float, optional
        Tone curve, from light to pixel value; a number is a gamma, and "auto" estimates the curve
        of each picture along with the camera. By default "auto" for 8 and 16 bits, also for floats
        that hold 8- or 16-bit values; linear for all other floats.
    targets : str
        See `detect`.
    outlines : path, mapping or sequence, optional
        Coarse outlines of the squares, drawn by hand, in place of a search: see `detect`. A file
        or its content may be for several photographs, by name or index.
    lines : bool
        Whether straight edges of the scene are used in the fit if they are consistent with the
        squares: their straightness determines the distortion and its centre, also in parts of the
        picture without squares. They are in the result's ``lines``, used or rejected. Needs
        ``method="ml"``.
    side : str or float, optional
        Length of the squares' sides (of a board: of a cell; of "a4" and the like: the shorter one,
        see `Plane`), such as ``"84mm"``, or in metres. The planes of the result then have it as
        `side`, and their poses are metric. All targets must be of this size. A number of 10 or more
        raises a warning: it is probably in millimetres.
    frames : int, optional
        Number of frames to take of each video among the paths and in the folders: sharp frames that
        differ from one another, each used as one photograph of the camera. They are kept in memory.
        Without `frames` a video is refused, and videos in folders are left out.
    threads : int, optional
        Number of threads in which several photographs are read, measured and fitted; each thread
        keeps one photograph in memory. By default the number of cores that this process may use.
        The result does not depend on it. OpenCV's own threads are set in OpenCV.
    max_pixels, max_bytes : int, optional
        Limits: a picture with more pixels is refused by its header, before it is decoded, and a
        larger file before it is read; by default ``TRISQUARE_MAX_PIXELS`` and
        ``TRISQUARE_MAX_BYTES`` of the environment, or 500 million and 2 GB.
    progress : callable, optional
        Called with (pictures measured, pictures in all); the fit follows the last picture, and its
        time grows with the number of planes.

    Returns
    -------
    Calibration

    Raises
    ------
    ImageError
        If a file, which the message names, cannot be read completely or has too many pixels or
        bytes, also if it is one of many.
    DetectionError
        If no picture shows a target.
    NotEnoughPlanesError, NotEnoughDataError, DegenerateGeometryError, ConvergenceError
        If the planes do not determine the camera; the message gives the reason and a remedy. These
        errors and `DetectionError` list what was found and what was rejected in the message and in
        their attributes `found` and `rejected`.
    TypeError, ValueError
        For bad arguments.

    Examples
    --------
    >>> result = ts.calibrate("photo.jpg")
    >>> print(f"fx {result.camera.fx:.1f} px, known to {result.std['fx']:.3f} px")
    fx 902.4 px, known to 0.077 px
    >>> held = ts.calibrate("photo.jpg", fix="aspect")
    >>> held.parameters
    ('fx', 'cx', 'cy', 'k1', 'k2')
    """
    limits = PictureLimits.stated(max_pixels, max_bytes)
    sources = sources_of(image, with_videos=frames is not None)
    return calibrate_photographs(
        Photographs(with_frames(sources, frames, limits), limits=limits),
        method=method,
        model=model,
        fix=fix,
        free=free,
        initial=initial,
        orthogonal=orthogonal,
        parallel=parallel,
        tone=tone,
        targets=targets,
        outlines=outlines,
        lines=lines,
        side=side,
        threads=threads,
        progress=progress,
    ).calibration


class Calibrated(NamedTuple):
    """A calibration, and the rejected shapes of its photographs, with the reasons."""

    calibration: Calibration
    rejected_shapes: Sequence[Rejected]


def calibrate_photographs(
    photographs: Photographs,
    *,
    method: str,
    model: str,
    fix: str | Iterable[str],
    free: str | Iterable[str],
    initial: Calibration | Camera | None,
    orthogonal: Iterable[PlanePair],
    parallel: Iterable[PlanePair],
    tone: Tone,
    targets: str,
    outlines: Outlines | None,
    lines: bool,
    side: str | float | None,
    threads: int | None,
    progress: Callable[[int, int], None] | None,
    explain: bool = False,
    explain_all: bool = False,
) -> Calibrated:
    """Calibrate as `calibrate` does, from photographs that the caller may go on using.

    With `explain`, the result includes the rejected shapes: of many photographs, those of the few
    with the fewest targets, as in an error; with `explain_all`, those of every photograph.
    """
    settings = Settings.check(method, model, fix, initial, free, orthogonal, parallel)
    kinds = TargetKinds.parse(targets)
    if not isinstance(lines, bool | np.bool_):
        raise TypeError(f"lines must be True or False, not {type(lines).__name__}")
    if lines and settings.method == "linear":
        raise ValueError('lines=True needs method="ml": the linear steps cannot use lines')
    length = length_in("m", side, "side")
    callable_or_none(progress, "progress")
    threads = thread_count(threads, len(photographs))
    is_camera_held = {"focal", "principal_point", "distortion"} <= set(settings.fixed)
    search_settings = SearchSettings.check(
        kinds,
        tone,
        outlines,
        photographs.sources,
        lines=lines,
        is_camera_held=is_camera_held,
        image_size=None if settings.initial is None else settings.initial.image_size,
    )
    gathered = gather(
        photographs, search_settings, progress, threads=threads, explain_all=explain_all
    )
    settings.check_image_size(gathered.image_size)
    by_hand = outlines is not None
    try:
        if not gathered.figures:
            raise _nothing_to_fit(kinds, gathered, by_hand)
        # Targets of named layouts and outlines drawn by hand are all used: there is no choice.
        choosing = (kinds.squares or kinds.has_rectangles_of_known_shape) and not by_hand
        edges = gathered.edges
        LOG.info("fitting a %s camera to %d figures", settings.model, len(gathered.figures))
        outcome = solve(edges, gathered, settings, choosing, threads)
        candidates = gathered.figures
        if outcome.verdicts:
            gathered.figures, dropped, remarks = chosen_planes(
                outcome, gathered.figures, gathered.quads
            )
            gathered.rejected += dropped
            gathered.warnings += remarks
        gathered.warnings += _side_warnings(side)
        solution = outcome.solution()
        # A cause comes before its consequences.
        gathered.warnings[:0] = differing_pictures(
            candidates, gathered, settings, choosing, solution
        )
        calibration = assemble(solution, gathered, settings, length, photographs.file_names)
    except TrisquareError as error:
        add_reasons(error, gathered)
        raise
    camera, planes = calibration.camera, calibration.planes
    LOG.info("%s camera of %d planes, rms %.3g px", camera.model, len(planes), calibration.rms)
    is_short = choosing and not is_camera_held and has_few_squares(calibration)
    shapes = rejected_shapes(gathered) if is_short or explain or explain_all else []
    if is_short:
        missed = missed_squares(calibration, shapes)
        calibration = replace(calibration, rejected=(*calibration.rejected, *missed))
        shapes = [shape for shape in shapes if shape not in missed]
    return Calibrated(calibration, shapes)


def _nothing_to_fit(kinds: TargetKinds, gathered: Gathered, by_hand: bool) -> DetectionError:
    if not by_hand:
        # Lack of contrast is the reason only if all searched pictures lack it.
        contrast_texts = [search.lack_of_contrast() for search in gathered.searches.values()]
        lack = contrast_texts[0] if contrast_texts and all(contrast_texts) else ""
        return DetectionError(nothing_found(kinds, gathered.image_size, lack=lack))
    # The reasons against the outlines are added to every error, with their positions.
    other_texts = [text for text in gathered.warnings if not is_reported(text, gathered.rejected)]
    return DetectionError("; ".join(other_texts))


def calibrate_edges(
    edges: Sequence[PlaneEdges],
    image_size: Sequence[int],
    *,
    method: Method = "ml",
    model: AnyModel = "radial2",
    fix: str | Iterable[str] = (),
    free: str | Iterable[str] = (),
    initial: Calibration | Camera | None = None,
    orthogonal: Iterable[PlanePair] = (),
    parallel: Iterable[PlanePair] = (),
    side: str | float | None = None,
) -> Calibration:
    """Calibrate a camera from measured edges alone, without a picture.

    Parameters
    ----------
    edges : sequence of PlaneEdges
        Figures on three or more planes; fewer planes if enough parameters are fixed. Lines of the
        scene (`PlaneEdges.line`) are used if they are consistent with the planes.
    image_size : (int, int)
        Width and height in pixels.
    method, model, fix, free, initial, orthogonal, parallel, side
        As in `calibrate`.

    Returns
    -------
    Calibration

    Raises
    ------
    NotEnoughPlanesError, NotEnoughDataError, DegenerateGeometryError, ConvergenceError
        If the planes do not determine the camera; the message gives the reason and a remedy.
    TypeError, ValueError
        For bad arguments.

    Examples
    --------
    >>> edges = ts.detect("photo.jpg")
    >>> result = ts.calibrate_edges(edges, image_size=(1280, 960))
    >>> round(result.camera.fx), result.stage
    (902, 'edges')
    """
    settings = Settings.check(method, model, fix, initial, free, orthogonal, parallel)
    length = length_in("m", side, "side")
    requirement = "edges must be a list of PlaneEdges, such as PlaneEdges.square(sides)"
    if isinstance(edges, PlaneEdges):
        raise TypeError(f"{requirement}, not a single PlaneEdges")
    figures = sequence(edges, "edges", "PlaneEdges")
    for figure in figures:
        if not isinstance(figure, PlaneEdges):
            raise TypeError(f"{requirement}, not of {type(figure).__name__}")
    # A plane may have any whole number as its name; the core counts planes from zero.
    names = dict.fromkeys(figure.plane for figure in figures if figure.plane is not None)
    plane_numbers = {name: count for count, name in enumerate(names)}
    renumbered = [
        figure if figure.plane is None else changed_edges(figure, plane=plane_numbers[figure.plane])
        for figure in figures
    ]
    gathered = Gathered(size_of_image(image_size), figures, warnings=_side_warnings(side))
    outcome = solve(renumbered, gathered, settings, choosing=False)
    return assemble(outcome.solution(), gathered, settings, length)


def _side_warnings(side: str | float | None) -> list[CalibrationWarning]:
    """Warn of a side given as a number that is too large for metres; a text states its unit."""
    if side is None or isinstance(side, str) or side < LARGE_SIDE:
        return []
    text = (
        f"side={side:g} is {side:g} m, since a number is in metres: for millimetres write "
        f'"{side:g}mm"'
    )
    return [CalibrationWarning(text, "large_side", "medium")]
