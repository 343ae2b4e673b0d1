"""What is known of the tone curve of a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import trisquare._core as _core
from trisquare._support.number_text import plus_minus, with_its_std

CONTRADICTED = 4.0
"""Standard deviations of the effective gamma from which the profiles contradict a stated curve."""

NOTABLE_GROWTH = 1.2
"""Of a standard deviation, from which it is worth a word that no tone curve fits."""

CONTRADICTED_BY_EDGES = (
    "the edge profiles contradict the tone curve that was stated or assumed, which moves the edges"
)
"""Said of a stated tone curve where the fit to the pixels does not tell more."""

CoreTone: TypeAlias = "str | float | tuple[float, float, bool, float]"


@dataclass(frozen=True, slots=True)
class PictureTone:
    """A tone curve that was stated, or one that was estimated and how well.

    Parameters
    ----------
    curve : str, float or (float, float, bool, float)
        As the core takes it: a name, a gamma, or of an estimated curve gamma, toe, whether it is to
        be estimated further, and the standard deviation of the shift that it leaves, in pixels.
    value : str or float
        As results report it; of an estimated curve the pure gamma that codes mid-grey alike.
    std : float or None
        One standard deviation of an estimated gamma.
    shift : (float, float), optional
        Where no curve fits: how far all edges appear moved toward the dark, and one standard
        deviation of that, in pixels.
    contradicting : float, optional
        The gamma that the edges' profiles ask for, where they contradict a stated curve.
    """

    curve: CoreTone
    value: str | float
    std: float | None = None
    shift: tuple[float, float] | None = None
    contradicting: float | None = None

    @classmethod
    def known(cls, tone: str | float, estimate: _core.ToneEstimate) -> PictureTone:
        """Return a stated curve, which what the profiles tell may contradict."""
        contradicts = estimate.contradiction > CONTRADICTED
        return cls(tone, tone, contradicting=estimate.effective_gamma if contradicts else None)

    @classmethod
    def estimated(cls, estimate: _core.ToneEstimate) -> PictureTone:
        """Return what the profiles of a picture's edges have told."""
        shift_std = estimate.shift_std
        left = estimate.misfit_shift if shift_std is None else shift_std
        return cls(
            (estimate.gamma, estimate.toe, shift_std is None, left),
            estimate.effective_gamma,
            estimate.std,
            None if shift_std is None else (0.0, shift_std),
        )

    def refined(self, fit: _core.ToneFit) -> PictureTone:
        """Return the same with what the fit to the pixels has told."""
        std = self.std if fit.std is None else fit.std
        return replace(self, value=fit.effective_gamma, std=std, shift=fit.shift)

    def of_board(self) -> PictureTone:
        """Return the same for a board, whose own zigzag tells and takes away every shift."""
        if not isinstance(self.curve, tuple):
            return self
        return replace(self, curve=(*self.curve[:2], True, 0.0), shift=None)


def contradicting_pictures(tones: Mapping[int, PictureTone], names: Sequence[str]) -> str:
    """Say in which pictures, by index, the profiles contradict the stated tone curve, if in any.

    `names` is what messages call each of all pictures.
    """
    return "; ".join(
        f"{names[index]}: a gamma of about {tone.contradicting:.1f}"
        for index, tone in tones.items()
        if tone.contradicting is not None
    )


def contradiction_text(contradicting: str, told: str = CONTRADICTED_BY_EDGES) -> str:
    """Say what contradicts a stated tone curve, in which pictures, and what to do."""
    return f'{told}: use tone="auto", which estimates it ({contradicting})'


def shift_text(
    tones: Mapping[int, PictureTone], names: Sequence[str], growth: float | None = None
) -> str | None:
    """Say in which pictures, by index, the profiles fit no tone curve, if in any and if it matters.

    `names` is as in `contradicting_pictures`; `growth` is how many times as large it makes a
    standard deviation at most, None if the pixels were not fitted.
    """
    shifts = [
        f"{names[index]}: {_its_size(*tone.shift)}"
        for index, tone in tones.items()
        if tone.shift is not None
    ]
    if not shifts or (growth is not None and growth < NOTABLE_GROWTH):
        return None
    grown = ""
    if growth is not None:
        grown = f", which makes standard deviations up to {growth:.1f} times as large"
    return (
        "the edge profiles fit no tone curve (is the picture sharpened or compressed?): all edges "
        f"of a picture may be shifted toward their dark side by a common distance{grown}. State "
        'the curve if you know it, as with tone="srgb"; phones have curves of their own. '
        f"Estimated shift ({'; '.join(shifts)})"
    )


def _its_size(shift: float, std: float) -> str:
    """Write a shift in pixels; one that is not told from zero is no estimate."""
    if abs(shift) < std:
        return f"0 +- {with_its_std(0.0, std)[1]} px"
    return f"{plus_minus(shift, std)} px"


def pooled(tones: Sequence[PictureTone]) -> tuple[str | float | None, float | None]:
    """Return one tone and its standard deviation for pictures of one camera.

    Estimates are weighted by their certainty; stated curves are all alike. Without any picture
    there is none.
    """
    stds = [tone.std for tone in tones if tone.std is not None]
    if not stds:
        return (tones[0].value if tones else None), None
    weights = [1.0 / (std * std) for std in stds]
    values = [float(tone.value) for tone in tones if tone.std is not None]
    mean = sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)
    return mean, sum(weights) ** -0.5
