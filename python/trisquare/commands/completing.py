"""What the shell offers for an option's value."""

from __future__ import annotations

from collections.abc import Callable, Iterable


def completing(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what tells the shell which of these names go on from what is typed already."""
    known = tuple(names)

    def names_from(incomplete: str) -> list[str]:
        return [name for name in known if name.startswith(incomplete)]

    return names_from
