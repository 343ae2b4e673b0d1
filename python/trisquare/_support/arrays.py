"""Checked, read-only values for the results and inputs of trisquare."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import FrozenInstanceError, fields
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt

T = TypeVar("T")
FloatArray: TypeAlias = npt.NDArray[np.float64]

NORMAL_MEDIAN = 0.6745
"""Median of the absolute values of normal draws, in standard deviations."""

# No picture is nearly as large; float64 resolves 1e-7 px at this size, and squares of far larger
# numbers overflow.
LARGEST_SIDE = 10**9
# Largest integer of the compiled core.
LARGEST_INDEX = 2**63 - 1


def real_array(
    value: Any, name: str, shape: tuple[int | None, ...], advice: str = ""
) -> FloatArray:
    """Copy `value` into a finite, read-only float64 array of the given shape.

    Parameters
    ----------
    value : array_like of real numbers
        Lists and arrays of any integer or floating type are accepted.
    name : str
        Name of the value, with which errors begin.
    shape : tuple of int or None
        The required shape; None means any length. The middle axis of points in OpenCV's shape
        (N, 1, D) is removed.
    advice : str
        End of the error about values that are not finite.

    Returns
    -------
    ndarray of float64
        C-contiguous, owning its memory, not writeable.

    Raises
    ------
    TypeError
        If the elements are not real numbers (strings, complex numbers, booleans, objects).
    ValueError
        If the shape differs, rows have different lengths, or a value is NaN or infinite.
    """
    given = value if isinstance(value, np.ndarray) else _of_leaves(value, name)
    if np.ma.is_masked(given):
        raise ValueError(f"{name} contains masked values: leave them out")
    if given.dtype.kind not in "iuf":
        raise TypeError(f"{name} must contain real numbers, not {given.dtype}")
    if len(shape) == 2 and given.ndim == 3 and given.shape[1] == 1:
        given = given[:, 0]
    if given.shape != shape and not _fits(given.shape, shape):
        wanted_text = ", ".join("N" if length is None else str(length) for length in shape)
        raise ValueError(f"{name} must have shape ({wanted_text}), not {given.shape}")
    array = np.array(given, dtype=np.float64, order="C")
    # The sum of squares is finite only if all values are, and takes less than half of the time.
    if not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
        first = np.argwhere(~np.isfinite(array))[0].tolist()
        place = f", the first at {first}" if first else ""
        raise ValueError(f"{name} contains NaN or infinite values{place}{advice}")
    array.flags.writeable = False
    return array


def pixel_array(
    value: Any, name: str, shape: tuple[int | None, ...], advice: str = ""
) -> FloatArray:
    """Check pixel coordinates as `real_array`; those outside every picture are a ValueError too."""
    array = real_array(value, name, shape, advice)
    if max(array.max(initial=-np.inf), -array.min(initial=np.inf)) > LARGEST_SIDE:
        raise ValueError(f"{name} contains coordinates beyond {LARGEST_SIDE:g} px")
    return array


def _fits(found: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    """Return whether a shape is the required one, in which None means any length."""
    if len(found) != len(shape):
        return False
    for wanted, length in zip(shape, found, strict=True):  # faster than all() of a generator
        if wanted is not None and wanted != length:
            return False
    return True


def real_number(value: Any, name: str) -> float:
    """Return `value` as a finite float, or raise TypeError or ValueError naming it."""
    if type(value) is float and math.isfinite(value):  # the usual case, ten times as fast
        return value
    return float(real_array(value, name, ()))


def whole_number(value: Any, name: str) -> int:
    """Return `value` as an int, or raise TypeError naming it; a bool is refused."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be a whole number, not {value!r}")
    return int(value)


def _of_leaves(value: Any, name: str) -> npt.NDArray[Any]:
    """Return nested lists as an array of numbers.

    It is converted by way of an array of objects: in an array of strings, the longest one would
    determine the memory of every element.
    """
    leaves = np.asarray(value, dtype=object)
    kinds = set(map(type, leaves.ravel()))
    if not kinds.isdisjoint((list, tuple, np.ndarray)):
        raise ValueError(f"{name} is ragged: its rows have different lengths")
    for kind in kinds:
        if kind is bool or not issubclass(kind, int | float | np.integer | np.floating):
            raise TypeError(f"{name} must contain real numbers, not {kind.__name__}")
    try:
        return leaves.astype(np.float64)
    except OverflowError as error:
        raise ValueError(f"{name} contains a number that is too large") from error


def size_of_image(value: Any) -> tuple[int, int]:
    """Return ``(width, height)`` as ints if a picture may have that size.

    Raises
    ------
    TypeError
        If it is not a pair, or not of whole numbers.
    ValueError
        If there are not two numbers, or one is not from 1 to `LARGEST_SIDE`.
    """
    try:
        width, height = value
    except (TypeError, ValueError) as error:
        raise type(error)("image_size must be (width, height)") from error
    size = (whole_number(width, "image_size[0]"), whole_number(height, "image_size[1]"))
    if min(size) < 1 or max(size) > LARGEST_SIDE:
        raise ValueError(
            f"image_size must be positive and at most {LARGEST_SIDE}, not {size!s:.60}"
        )
    return size


def not_negative(value: Any, name: str) -> float:
    """Return `value` as a finite float that is at least zero."""
    number = real_number(value, name)
    if number < 0:
        raise ValueError(f"{name} must not be negative, but is {number}")
    return number


def index_number(value: Any, name: str) -> int:
    """Return `value` as an int that is at least zero."""
    number = whole_number(value, name)
    if not 0 <= number <= LARGEST_INDEX:
        raise ValueError(f"{name} must be from 0 to {LARGEST_INDEX}, not {number}")
    return number


def string(value: Any, name: str) -> str:
    """Return `value` if it is a str, or raise TypeError naming it."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, not {type(value).__name__}")
    return value


def sequence(values: Any, name: str, content: str) -> list[Any]:
    """Return the values of an iterable as a list, or raise TypeError naming it and its content."""
    if isinstance(values, str) or not hasattr(values, "__iter__"):
        raise TypeError(f"{name} must be a sequence of {content}, not {type(values).__name__}")
    return list(values)


def callable_or_none(value: Any, name: str) -> None:
    """Raise TypeError naming a value that is neither None nor can be called."""
    if value is not None and not callable(value):
        raise TypeError(f"{name} must be callable, not {type(value).__name__}")


def strings(values: Any, name: str) -> tuple[str, ...]:
    """Return a sequence of str as a tuple; a single str, a sequence of letters, is refused."""
    values = sequence(values, name, "strings")
    return tuple(string(value, f"each of {name}") for value in values)


def instances(values: Iterable[Any], kind: type[T], name: str) -> tuple[T, ...]:
    """Return values as a tuple if all are of one class, else raise TypeError."""
    checked = tuple(sequence(values, name, kind.__name__))
    if not all(isinstance(value, kind) for value in checked):
        raise TypeError(f"{name} must all be of the class {kind.__name__}")
    return checked


class Frozen:
    """Base of frozen dataclasses with slots that refuse every assignment with FrozenInstanceError.

    With `dataclass` alone, assigning to a name that is not a field, such as a property, is a
    TypeError about ``super``: slots require a second class, and the refusal refers to the first.
    """

    __slots__ = ()

    other_names: ClassVar[Mapping[str, str]] = {}
    """Names that users may expect but the class does not have, and their equivalents."""

    if not TYPE_CHECKING:  # type checkers would take every name for an attribute

        def __getattr__(self, name: str) -> NoReturn:
            suggestion = self.other_names.get(name)
            hint = "" if suggestion is None else f": did you mean {suggestion!r}?"
            text = f"{type(self).__name__!r} object has no attribute {name!r}{hint}"
            raise AttributeError(text, name=name, obj=self)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__setattr__" in vars(cls):  # set by `dataclass`
            for name, refusal in (("__setattr__", _no_assignment), ("__delattr__", _no_deletion)):
                setattr(cls, name, refusal)


def _no_assignment(self: Any, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _no_deletion(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


class ReadOnlyDict(dict[str, float]):
    """Read-only numbers by name; JSON and pickle treat them as a dictionary."""

    __slots__ = ()

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(
            "these values are read-only: dict(values) returns a copy that can be changed"
        )

    __setitem__ = __delitem__ = clear = pop = popitem = setdefault = update = _refuse
    __ior__ = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (dict(self),)


class ComparedByValue(Frozen):
    """Base of frozen dataclasses that are equal if all their fields are, arrays to the last bit."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        """Return whether all fields are the same, arrays to the last bit."""
        if type(other) is not type(self):
            return NotImplemented
        return self is other or _value(self) == _value(other)

    def __hash__(self) -> int:
        return hash(_value(self))


def _value(value: Any) -> Any:
    """Return a value that can be hashed and compared."""
    if isinstance(value, ComparedByValue):
        return tuple(_value(getattr(value, each.name)) for each in fields(cast("Any", value)))
    if isinstance(value, tuple):
        return tuple(map(_value, value))
    return (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


class RebuiltByConstructor(Frozen):
    """Base of frozen dataclasses that pickle through their constructors.

    NumPy's own pickling loses the read-only flag of arrays; the constructor sets it.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        members: Any = self
        return type(self), tuple(getattr(self, member.name) for member in fields(members))
