"""Calibrating: from pictures, or from edges measured elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trisquare import _core
from trisquare.camera import MODELS, Camera, camera_parameters
from trisquare.checked import FloatArray, size_of_image
from trisquare.choosing import choose
from trisquare.coherence import Coherence
from trisquare.edges import PlaneEdges
from trisquare.errors import DetectionError
from trisquare.model_alternative import ModelAlternative
from trisquare.photographs import photographs
from trisquare.picture_tone import PictureTone, pooled, shift_warnings
from trisquare.pictures import ImageSource, Outlines, Tone, checked_tone, picture_size, tone_of
from trisquare.rejected import Rejected
from trisquare.result import Calibration, Plane
from trisquare.targets import Targets, nothing_found
from trisquare.what_was_found import told_on_failure

# The model that stands for the choice among all of them by evidence.
AUTO = "auto"
METHODS = ("ml", "linear")
FIXABLE = ("aspect", "principal_point", "focal", "distortion")


def calibrate(
    image: ImageSource | Sequence[ImageSource],
    *,
    method: str = "ml",
    model: str = "radial2",
    fix: str | Iterable[str] = (),
    initial: Camera | None = None,
    tone: Tone = None,
    targets: str = "auto",
    outlines: Outlines | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Calibrate a camera from one photograph of three squares, or from several photographs.

    Of what looks like squares, the largest set is used that one camera sees as such; the others
    are in the result's ``rejected``, and a warning tells where the choice is uncertain.

    Parameters
    ----------
    image : path or ndarray, or a sequence of them
        uint8, uint16 or float32 of shape (H, W) or (H, W, 3) in BGR order. Several photographs
        must be of one camera and size; their planes are pooled. One in which nothing is found is
        named in `warnings` and left out, as is one that is given twice. A file's orientation tag
        is not obeyed: the result refers to the picture as it is stored, and says so.
    method : {"ml", "linear"}
        Joint maximum likelihood, or the three linear steps of Zhou et al. (2013) alone, whose
        stated standard deviations are those that maximum likelihood would have with residuals of
        that size: they leave out what the steps themselves lose.
    model : {"none", "radial1", "radial2", "radial3", "brown", "auto"}
        The distortion coefficients that are estimated. ``"auto"`` takes the model with the largest
        evidence, by the density ratio of Dickey (1971) from the richest fit; the rejected ones are
        in ``alternatives``, and what they would say stays, by their probabilities, in the
        covariance. It needs ``method="ml"`` and a free distortion.
    fix : names among "aspect", "principal_point", "focal", "distortion"
        Held at the values of `initial`, or else at aspect 1, the image centre, and zero.
    initial : Camera, optional
        Values for what is fixed; "focal" needs them.
    tone : {"auto", "srgb", "linear"} or float, optional
        How light was coded; a number is a gamma, and "auto" estimates the curve of each picture
        along with the camera. By default sRGB for 8-bit pictures, linear for others.
    targets : str
        See `detect`.
    outlines : path, mapping or sequence, optional
        Coarse outlines of the squares, drawn by hand, in place of a search: see `detect`. A file
        or its content may be for several photographs, by name or index.
    progress : callable, optional
        Called with (pictures done, pictures in all).

    Returns
    -------
    Calibration

    Raises
    ------
    ImageError
        If a file cannot be read whole, also if it is one of many: it is named.
    DetectionError
        If no picture shows a target.
    NotEnoughPlanesError, NotEnoughDataError, DegenerateGeometryError, ConvergenceError
        If the planes cannot answer; the message says why and what would help. These and
        `DetectionError` say what was found and what was not used, and hold it as their `found`
        and `rejected`.
    TypeError, ValueError
        For bad arguments.
    """
    # OpenCV is loaded where a picture is searched.
    from trisquare.drawings import Drawings
    from trisquare.measurement import measure

    settings = _Settings.check(method, model, fix, initial)
    wanted = Targets.parse(targets)
    checked = checked_tone(tone)
    sources: list[ImageSource] = [image]  # type: ignore[list-item]
    if isinstance(image, Sequence) and not isinstance(image, str):
        sources = list(image)
    if not sources:
        raise ValueError("no picture given")

    drawings = None if outlines is None else Drawings.read(outlines, sources)

    figures: list[PlaneEdges] = []
    pictures: list[_core.Picture] = []
    warnings: list[str] = []
    tones: list[PictureTone] = []
    rejected: list[Rejected] = []
    quads: dict[int, FloatArray] = {}
    curves: set[str | float] = set()
    size: tuple[int, int] | None = None
    for photograph in photographs(sources):
        picture, index = photograph.pixels, photograph.index
        size = picture_size(picture)
        curve = tone_of(picture, checked)
        curves.add(curve)
        core = _core.Picture(picture)
        drawn = None if drawings is None else drawings.on(index, size)
        if photograph.repeats:
            drawn = ()  # nothing is looked for either
        found, picture_tone, unused, corners = measure(picture, core, wanted, curve, drawn)
        tones.append(picture_tone)
        rejected += [replace(candidate, image=index) for candidate in unused]
        warnings += photograph.remarks
        if drawings is not None:
            warnings += [f"{photograph.name}: {candidate.reason}" for candidate in unused]
        if not found and not photograph.repeats:
            warnings.append(f"{photograph.name}: {_nothing(wanted, drawn)}")
        planes_before = len(quads)
        quads.update(enumerate(corners, planes_before))
        figures += [_placed(figure, index, planes_before) for figure in found]
        pictures.append(core)
        if progress is not None:
            progress(index + 1, len(sources))
    with told_on_failure(figures, rejected, sources, wanted):
        if not figures:
            nothing = nothing_found(wanted, rejected)
            raise DetectionError(nothing if drawings is None else "; ".join(warnings))
        if len(curves) > 1:
            raise ValueError("pictures of different depth need one stated tone curve")
        assert size is not None  # there is at least one picture
        # What was asked for by its layout or drawn by hand is vouched for.
        if wanted.squares and drawings is None:
            figures[:], others, choice = choose(
                figures,
                size,
                quads,
                model=settings.model,
                fixed=settings.fixed,
                initial=settings.initial_parameters(size),
            )
            rejected += others
            warnings += choice
        result = _solve(figures, size, settings, pictures, tones, warnings)
    return replace(result, rejected=tuple(rejected))


def calibrate_edges(
    edges: Sequence[PlaneEdges],
    image_size: tuple[int, int],
    *,
    method: str = "ml",
    model: str = "radial2",
    fix: str | Iterable[str] = (),
    initial: Camera | None = None,
) -> Calibration:
    """Calibrate a camera from measured edges alone, without a picture.

    Parameters
    ----------
    edges : sequence of PlaneEdges
        Figures on three or more planes; fewer planes if enough parameters are fixed.
    image_size : (int, int)
        Width and height in pixels.
    method, model, fix, initial
        As in `calibrate`.

    Returns
    -------
    Calibration

    Raises
    ------
    NotEnoughPlanesError, NotEnoughDataError, DegenerateGeometryError, ConvergenceError
        If the planes cannot answer; the message says why and what would help.
    TypeError, ValueError
        For bad arguments.
    """
    settings = _Settings.check(method, model, fix, initial)
    figures = list(edges)
    for figure in figures:
        if not isinstance(figure, PlaneEdges):
            raise TypeError(f"edges must be PlaneEdges, not {type(figure).__name__}")
    # Any whole number may name a plane; the core counts from zero.
    names = dict.fromkeys(figure.plane for figure in figures if figure.plane is not None)
    number = {name: count for count, name in enumerate(names)}
    counted = [
        figure if figure.plane is None else replace(figure, plane=number[figure.plane])
        for figure in figures
    ]
    return _solve(counted, size_of_image(image_size), settings, None, [], [])


@dataclass(frozen=True, slots=True)
class _Settings:
    """What to estimate and how, checked."""

    method: str
    model: str
    fixed: tuple[str, ...]
    initial: Camera | None

    @classmethod
    def check(
        cls, method: str, model: str, fix: str | Iterable[str], initial: Camera | None
    ) -> _Settings:
        for name, value, known in (
            ("method", method, METHODS),
            ("model", model, (*MODELS, AUTO)),
        ):
            if not isinstance(value, str):
                raise TypeError(f"{name} must be a string, not {type(value).__name__}")
            if value not in known:
                raise ValueError(f"unknown {name} {value!r}: choose one of {', '.join(known)}")
        names = [fix] if isinstance(fix, str) else list(fix)
        for name in names:
            if name not in FIXABLE:
                raise ValueError(f"cannot fix {name!r}: choose among {', '.join(FIXABLE)}")
        if initial is not None and not isinstance(initial, Camera):
            raise TypeError(f"initial must be a Camera, not {type(initial).__name__}")
        if "focal" in names and initial is None:
            raise ValueError("fixing the focal length needs an initial camera to hold it at")
        if model == AUTO and (method == "linear" or "distortion" in names):
            raise ValueError(
                'model="auto" compares maximum-likelihood fits with the distortion free: name a '
                "model for the linear method or a fixed distortion"
            )
        return cls(method, model, tuple(name for name in FIXABLE if name in names), initial)

    def initial_parameters(self, image_size: tuple[int, int]) -> list[float] | None:
        """Return the initial camera as the core takes it; it must be of the pictures' size."""
        if self.initial is None:
            return None
        if self.initial.image_size != image_size:
            raise ValueError(
                f"the initial camera is of size {self.initial.image_size}, the pictures of "
                f"{image_size}"
            )
        return list(camera_parameters(self.initial).values())


def _nothing(wanted: Targets, drawn: Sequence[object] | None) -> str:
    """Say what was looked for in a picture in vain."""
    if drawn is None:
        return nothing_found(wanted)
    return "none of the outlines is a square" if drawn else "nothing is drawn on it"


def _placed(figure: PlaneEdges, image: int, planes_before: int) -> PlaneEdges:
    plane = None if figure.plane is None else figure.plane + planes_before
    if (figure.image, figure.plane) == (image, plane):  # another copy would be checked anew
        return figure
    return replace(figure, image=image, plane=plane)


def _solve(
    figures: list[PlaneEdges],
    image_size: tuple[int, int],
    settings: _Settings,
    pictures: list[_core.Picture] | None,
    tones: list[PictureTone],
    warnings: list[str],
) -> Calibration:
    found = _core.calibrate(
        figures,
        image_size,
        method=settings.method,
        model=settings.model,
        fixed=settings.fixed,
        initial=settings.initial_parameters(image_size),
        pictures=pictures,
        tones=[tone.curve for tone in tones],
    )
    # The fit to the pixels knows more of the tone than the edges' profiles alone.
    if found["tones"]:
        tones = [tone.refined(fit) for tone, fit in zip(tones, found["tones"], strict=True)]
    tone, tone_std = pooled(tones)
    camera = Camera(
        found["camera_matrix"],
        found["distortion"],
        image_size,
        found["model"],
        valid_radius=found["valid_radius"],
    )
    planes = tuple(
        Plane(
            kind=figures[plane["figure"]].kind,
            image=plane["image"],
            corners=plane["corners"],
            rotation=plane["rotation"],
            translation=plane["translation"],
            rms=plane["rms"],
            samples=plane["samples"],
        )
        for plane in found["planes"]
    )
    return Calibration(
        camera=camera,
        std=found["std"],
        covariance=np.asarray(found["covariance"]),
        parameters=tuple(found["parameters"]),
        planes=planes,
        rms=found["rms"],
        noise_scale=found["noise_scale"],
        warnings=(*warnings, *found["warnings"], *shift_warnings(tones)),
        method=settings.method,
        tone=tone,
        fixed=settings.fixed,
        stage=found["stage"],
        alternatives=tuple(ModelAlternative(*other) for other in found["alternatives"]),
        coherence=Coherence(**found["coherence"]),
        tone_std=tone_std,
    )
