"""The tone curve of a picture, stated or estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import trisquare._core as _core
from trisquare._support.number_text import plus_minus, with_its_std

MIN_CONTRADICTION = 4.0
"""Standard deviations of the effective gamma above which the profiles contradict a stated curve."""

NOTABLE_GROWTH = 1.2
"""Growth of a standard deviation from which a misfit of all tone curves is reported."""

CONTRADICTED_BY_EDGES = (
    "the edge profiles contradict the tone curve that was stated or assumed, which displaces the "
    "edges"
)
"""Message about a stated tone curve if the fit to the pixels does not give a more exact one."""

CoreTone: TypeAlias = "str | float | tuple[float, float, bool, float]"


@dataclass(frozen=True, slots=True)
class PictureTone:
    """A tone curve that was stated, or one that was estimated, with its accuracy.

    Parameters
    ----------
    curve : str, float or (float, float, bool, float)
        As the core takes it: a name, a gamma, or for an estimated curve gamma, toe, whether it is
        to be estimated further, and the standard deviation of the remaining shift, in pixels.
    value : str or float
        As results report it; for an estimated curve the pure gamma that codes mid-grey equally.
    std : float or None
        One standard deviation of an estimated gamma.
    shift : (float, float), optional
        If no curve fits: shift of all edges toward the dark, and its standard deviation, in pixels.
    contradicting : float, optional
        Gamma according to the edges' profiles, if they contradict a stated curve.
    """

    curve: CoreTone
    value: str | float
    std: float | None = None
    shift: tuple[float, float] | None = None
    contradicting: float | None = None

    @classmethod
    def known(cls, tone: str | float, estimate: _core.ToneEstimate) -> PictureTone:
        """Return a stated curve, with the gamma of the profiles if that contradicts it."""
        is_contradicted = estimate.contradiction > MIN_CONTRADICTION
        return cls(tone, tone, contradicting=estimate.effective_gamma if is_contradicted else None)

    @classmethod
    def estimated(cls, estimate: _core.ToneEstimate) -> PictureTone:
        """Return the curve estimated from the profiles of a picture's edges."""
        shift_std = estimate.shift_std
        return cls(
            (estimate.gamma, estimate.toe, estimate.is_free, estimate.remaining_std),
            estimate.effective_gamma,
            estimate.std,
            None if shift_std is None else (0.0, shift_std),
        )

    def refined(self, fit: _core.ToneFit) -> PictureTone:
        """Return this tone with the results of the fit to the pixels."""
        std = self.std if fit.std is None else fit.std
        shift = None if self.shift is None else fit.shift
        return replace(self, value=fit.effective_gamma, std=std, shift=shift)

    def of_board(self) -> PictureTone:
        """Return this tone for a board, whose own zigzag gives every shift, which is removed."""
        if not isinstance(self.curve, tuple):
            return self
        return replace(self, curve=(*self.curve[:2], True, 0.0), shift=None)


def contradicting_pictures(tones: Mapping[int, PictureTone], names: Sequence[str]) -> str:
    """Name the pictures, by index, whose profiles contradict the stated tone curve, if any.

    `names` are the names of all pictures in messages.
    """
    return "; ".join(
        f"{names[index]}: a gamma of about {tone.contradicting:.1f}"
        for index, tone in tones.items()
        if tone.contradicting is not None
    )


def contradiction_text(contradicting: str, contradiction: str = CONTRADICTED_BY_EDGES) -> str:
    """Describe the contradiction to a stated tone curve, in which pictures, and the remedy."""
    return f'{contradiction}: use tone="auto", which estimates it ({contradicting})'


def shift_text(
    tones: Mapping[int, PictureTone], names: Sequence[str], growth: float | None = None
) -> str | None:
    """Name the pictures, by index, whose profiles fit no tone curve, if any and if it matters.

    `names` is as in `contradicting_pictures`; `growth` is the maximum factor by which it increases
    a standard deviation, None if the pixels were not fitted.
    """
    shifts = [
        f"{names[index]}: {_shift_size(*tone.shift)}"
        for index, tone in tones.items()
        if tone.shift is not None
    ]
    if not shifts or (growth is not None and growth < NOTABLE_GROWTH):
        return None
    growth_text = ""
    if growth is not None:
        growth_text = f", which makes standard deviations up to {growth:.1f} times as large"
    return (
        "the edge profiles fit no tone curve (is the picture sharpened or compressed, or does a "
        "shadow cross the targets?): all edges of a picture may be shifted toward their dark side "
        f"by a common distance{growth_text}. "
        'State the curve if you know it, as with tone="srgb"; phones have curves of their own. '
        f"Estimated shift ({'; '.join(shifts)})"
    )


def _shift_size(shift: float, std: float) -> str:
    """Write a shift in pixels; as zero if it is less than its standard deviation."""
    if abs(shift) < std:
        return f"0 +- {with_its_std(0.0, std)[1]} px"
    return f"{plus_minus(shift, std)} px"


def pooled(tones: Sequence[PictureTone]) -> tuple[str | float | None, float | None]:
    """Return one tone and its standard deviation for pictures of one camera.

    Estimates are weighted by their inverse variances; stated curves are all alike. Both are None
    without any picture.
    """
    stds = [tone.std for tone in tones if tone.std is not None]
    if not stds:
        return (tones[0].value if tones else None), None
    weights = [1.0 / (std * std) for std in stds]
    values = [float(tone.value) for tone in tones if tone.std is not None]
    mean = sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)
    return mean, sum(weights) ** -0.5
