"""Errors and advice about unknown names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from inspect import signature
from types import MappingProxyType
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

NO_OTHERS: Mapping[str, str] = MappingProxyType({})

LONGEST_NAME = 100
"""Maximum number of characters shown of a name, which may come from a file."""


def unknown(
    what: str,
    value: str,
    known: Iterable[str],
    choose: str | None = None,
    other_names: Mapping[str, str] = NO_OTHERS,
) -> TypeError | ValueError:
    """Return the error for an unknown name, with the nearest known name and all known names.

    It is a TypeError for a value that is not a string.

    Parameters
    ----------
    what : str
        What the name stands for.
    value : str
        The name that was given.
    known : iterable of str
        The known names.
    choose : str, optional
        Description of the choices, if they are more than the known names.
    other_names : mapping, optional
        Known names by their names in other programs.
    """
    if not isinstance(value, str):
        return TypeError(f"a {what} must be a name, not {type(value).__name__}")
    if len(value) > LONGEST_NAME:
        value = f"{value[:LONGEST_NAME]}..."
    names = list(known)
    suggestion = other_names.get(value.lower()) or nearest_name(value, names)
    hint = "" if suggestion is None else f"did you mean {suggestion!r}? "
    choices = f"one of {', '.join(names)}" if choose is None else choose
    return ValueError(f"unknown {what} {value!r}: {hint}choose {choices}")


def nearest_name(value: str, known: Iterable[str]) -> str | None:
    """Return the name that was probably meant, ignoring case; None if none is near."""
    from difflib import get_close_matches  # needed only after a mistake

    by_lower = {name.lower(): name for name in known}
    found = get_close_matches(value.lower(), by_lower, n=1)
    return by_lower[found[0]] if found else None


def advising(
    positional: str, keywords: Mapping[str, str] = NO_OTHERS
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that adds advice to the error of a call with wrong arguments.

    Parameters
    ----------
    positional : str
        Advice if there are too few or too many positional arguments.
    keywords : mapping of str to str
        Advice by the name of an argument that the function does not have.
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def called(*arguments: P.args, **given: P.kwargs) -> T:
            try:
                return function(*arguments, **given)
            except TypeError as error:
                own = error.__traceback__
                if own is None or own.tb_next is not None:  # the error is from inside the function
                    raise
                names = signature(function).parameters
                foreign = next((name for name in given if name not in names), None)
                advice = positional if foreign is None else keywords.get(foreign)
                if advice is None:
                    raise
                raise TypeError(f"{error}: {advice}") from None

        return called

    return decorate
