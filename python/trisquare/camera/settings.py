"""Settings of a calibration: what is estimated, and how."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from numbers import Integral
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

from trisquare._support.suggestions import nearest_name, unknown
from trisquare.camera.camera import Camera, CoreCamera, camera_for_core
from trisquare.camera.camera_of import HasCamera, camera_of
from trisquare.camera.lens_models import COEFFICIENTS, MODELS, LensModel

# Choice among "none" to "brown" and the fisheyes by evidence.
AUTO: Literal["auto"] = "auto"
AnyModel: TypeAlias = LensModel | Literal["auto"]
# Names of these models in other programs.
MODELS_ELSEWHERE = MappingProxyType({"pinhole": "none", "plumb_bob": "brown"})
Method: TypeAlias = Literal["ml", "linear"]
METHODS: tuple[Method, ...] = get_args(Method)
# Indices of two planes.
PlanePair = tuple[int, int]
FIXABLE = ("aspect", "principal_point", "focal", "distortion")
FREEABLE = ("skew",)  # fixed by default


@dataclass(frozen=True, slots=True)
class Settings:
    """Checked settings of what to estimate, and how."""

    method: str
    model: str
    fixed: tuple[str, ...]
    initial: Camera | None
    free: tuple[str, ...]
    orthogonal: tuple[PlanePair, ...]
    parallel: tuple[PlanePair, ...]

    @classmethod
    def check(
        cls,
        method: str,
        model: str,
        fix: str | Iterable[str],
        initial: HasCamera | Camera | None,
        free: str | Iterable[str],
        orthogonal: Iterable[PlanePair],
        parallel: Iterable[PlanePair],
    ) -> Settings:
        """Check the arguments of `calibrate` with these names.

        Raises
        ------
        TypeError, ValueError
            For any other value.
        """
        for name, value, known in (
            ("method", method, METHODS),
            ("model", model, (*MODELS, AUTO)),
        ):
            if not isinstance(value, str):
                raise TypeError(f"{name} must be a string, not {type(value).__name__}")
            if value not in known:
                raise unknown(name, value, known, other_names=MODELS_ELSEWHERE)
        names, freed = checked_fix(fix), checked_free(free)
        held = None if initial is None else camera_of(initial, "initial")
        if "focal" in names and held is None:
            raise ValueError("to fix the focal length, give its value by a camera: initial=")
        if model == AUTO and (method == "linear" or "distortion" in names):
            raise ValueError(
                'model="auto" needs method="ml" and a free distortion: otherwise name a model'
            )
        if held is not None and "distortion" in names and model not in _equivalent_models(held):
            raise ValueError(
                f"the distortion of a {held.model} lens cannot be fixed in a {model} lens: choose "
                f"model={held.model!r}"
            )
        if freed and method == "linear":
            raise ValueError(
                'free="skew" needs method="ml": the linear steps assume that it is zero'
            )
        pairs = checked_pairs("orthogonal", orthogonal), checked_pairs("parallel", parallel)
        return cls(method, model, names, held, freed, *pairs)

    def model_of(self, fitted: str) -> str:
        """Return the model of a result; with a fixed distortion, that of the initial camera.

        The model of the fit may lack coefficients that are fixed at values other than zero.
        """
        if self.initial is None or "distortion" not in self.fixed:
            return fitted
        return self.initial.model

    def check_image_size(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError if the initial camera is for pictures of another size."""
        if self.initial is not None and self.initial.image_size != image_size:
            camera_size, picture_size = (
                "{} x {}".format(*size) for size in (self.initial.image_size, image_size)
            )
            raise ValueError(
                f"the initial camera is for pictures of {camera_size}, these have {picture_size}: "
                "if only the resolution differs, scale it (Camera.rescaled; trisquare convert "
                f"--rescale {image_size[0]}x{image_size[1]})"
            )

    def initial_camera(self, image_size: tuple[int, int]) -> CoreCamera | None:
        """Return the initial camera in the core's form; it must be of the pictures' size."""
        self.check_image_size(image_size)
        return None if self.initial is None else camera_for_core(self.initial)


def _equivalent_models(camera: Camera) -> list[str]:
    """Return the models with the same coefficients as a camera's."""
    coefficients = COEFFICIENTS[camera.model]
    return [model for model, names in COEFFICIENTS.items() if names == coefficients]


def checked_fix(fix: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of what is fixed, each once and in the order of `FIXABLE`.

    Raises
    ------
    TypeError, ValueError
        If they are not names, or if one of them cannot be fixed.
    """
    return _checked_names("fix", fix, FIXABLE, FREEABLE, "it is fixed unless free= names it")


def checked_free(free: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of what is free, each once and in the order of `FREEABLE`.

    Raises
    ------
    TypeError, ValueError
        If they are not names, or if one of them cannot be free.
    """
    return _checked_names("free", free, FREEABLE, FIXABLE, "it is free unless fix= names it")


def _hint(name: str, known: Sequence[str]) -> str:
    """Return a hint at what was meant, if there is one."""
    coefficients = {coefficient for names in COEFFICIENTS.values() for coefficient in names}
    if name in coefficients:
        return "single coefficients cannot be fixed, model= states which ones the lens has; "
    if name in ("fx", "fy", "cx", "cy"):
        group = "focal" if name[0] == "f" else "principal_point"
        return f"{group!r} fixes {name}; "
    suggestion = nearest_name(name, known)
    return "" if suggestion is None else f"did you mean {suggestion!r}? "


def _checked_names(
    verb: str, given: str | Iterable[str], known: Sequence[str], others: Sequence[str], why: str
) -> tuple[str, ...]:
    if not isinstance(given, Iterable):
        raise TypeError(f"{verb} takes names, such as {known[0]!r}, not {type(given).__name__}")
    # Names joined by commas, as on the command line.
    names = [part.strip() for part in given.split(",")] if isinstance(given, str) else list(given)
    for name in names:
        if name in others:
            raise ValueError(f"cannot {verb} {name!r}: {why}")
        if name not in known:
            hint = _hint(name, known) if isinstance(name, str) else ""
            choices = f"choose {'among ' * (len(known) > 1)}{', '.join(known)}"
            raise ValueError(f"cannot {verb} {name!r}: {hint}{choices}")
    return tuple(name for name in known if name in names)


def checked_pairs(name: str, pairs: Iterable[PlanePair]) -> tuple[PlanePair, ...]:
    """Return pairs of two different planes' indices.

    Raises
    ------
    TypeError, ValueError
        If they are not pairs, or if one of them is not a pair of different indices.
    """
    if not isinstance(pairs, Iterable):
        raise TypeError(f"{name} takes pairs, as [(0, 1)], not {type(pairs).__name__}")
    checked = []
    for pair in pairs:
        planes = tuple(pair) if isinstance(pair, Sequence) and not isinstance(pair, str) else ()
        are_indices = all(isinstance(plane, Integral) and plane >= 0 for plane in planes)
        if not (are_indices and len(set(planes)) == len(planes) == 2):
            raise ValueError(
                f"{name} takes pairs of the indices of two planes, as [(0, 1)], not {pair!r}"
            )
        checked.append((int(planes[0]), int(planes[1])))
    return tuple(checked)
