"""The page of all commands, from what they say of themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer

from trisquare.cli.app import app

TITLE = "The command"

PYTHON_TYPE = re.compile(r" <[^>]*>$")
"""What follows an argument's name; the text says it better."""

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


def commands_page() -> str:
    """Return the page as Markdown: arguments, options and examples of every command."""
    group = typer.main.get_command(app)
    context = group.make_context("trisquare", ["--help"], resilient_parsing=True)
    lines = [f"# {TITLE}", "", *_described(group, context)]
    for name in group.list_commands(context):
        # Not looked up in the group, which may load a command only when it is to run.
        command = group.resolve_command(context, [name])[1]
        own = command.make_context(name, [], parent=context, resilient_parsing=True)
        lines += ["", f"## {name}", "", *_described(command, own)]
    return "\n".join(lines) + "\n"


def _described(command: Any, context: Any) -> Iterator[str]:
    yield "\n\n".join(_prose(paragraph) for paragraph in command.help.split("\n\n"))
    yield ""
    yield "```text"
    yield f"{context.command_path} {' '.join(command.collect_usage_pieces(context))}"
    yield "```"
    records = [
        record
        for parameter in command.get_params(context)
        if (record := parameter.get_help_record(context)) is not None
    ]
    for names, text in records:
        yield ""
        yield f"`{PYTHON_TYPE.sub('', names)}`"
        yield f": {_prose(text)}"
    examples = getattr(command, "examples", ())
    if examples:
        yield ""
        yield "```sh"
        yield from examples
        yield "```"


def _prose(text: str | None) -> str:
    """Keep a help from being taken for Markdown, and its options from being set in type."""
    escaped = re.sub(r"([\\`*_<\[])", r"\\\1", " ".join((text or "").split()))
    return OPTION.sub(r"`\g<0>`", escaped)
