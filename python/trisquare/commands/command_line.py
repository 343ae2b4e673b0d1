"""The command line that a command was given, to be given again."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Any

import typer


def command_line(context: typer.Context) -> str:
    """Return a command line, quoted for a shell, that does the same again.

    Its own words are not kept: options stand before arguments and at their long names, those at
    their defaults are left out.
    """
    options: list[str] = []
    arguments: list[str] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        texts = _texts(value)
        if parameter.param_type_name == "argument":
            arguments += texts
        elif value != parameter.get_default(context) and value is not False and value is not None:
            # Of several names (--output, -o) the longest says what it is.
            name = max(parameter.opts, key=len)
            options += [name] if value is True else [w for text in texts for w in (name, text)]
    return shlex.join([*context.command_path.split(), *options, *arguments])


def _texts(value: Any) -> list[str]:
    values = value if isinstance(value, list | tuple) else [value]
    return [os.fspath(v) if isinstance(v, Path) else str(v) for v in values]
