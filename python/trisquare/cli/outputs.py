"""Output files of a command: the failure of one does not prevent the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from trisquare._support.writing import PathLike, write_atomically


@dataclass
class Outputs:
    """Outputs that were written, and failures of the others.

    Attributes
    ----------
    written : list of path
    failures : list of Exception
        One failure for each failed attempt.
    """

    written: list[PathLike] = field(default_factory=list)
    failures: list[Exception] = field(default_factory=list)

    def write(self, contents: Callable[[], Mapping[PathLike, bytes]]) -> None:
        """Create and write files; a failure is raised later, when the others are written."""
        try:
            created = contents()
            write_atomically(created)
        except Exception as error:
            self.failures.append(error)
        else:
            self.written.extend(created)

    def raise_first_failure(self) -> None:
        """Raise the first failure; to be called once the answer is printed."""
        if self.failures:
            raise self.failures[0]
