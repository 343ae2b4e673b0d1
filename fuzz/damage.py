"""Faults of files, in their bytes and in the content of texts."""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import PurePath
from typing import Any

import yaml

MAX_BYTES = 1_000_000
"""Maximum size of a damaged file."""

MAX_YAML = 10_000
"""Maximum number of characters that are parsed as YAML, which is slow."""

NUMBER = re.compile(rb"\d+(\.\d+)?")
EXTREMES = (b"0", b"-1", b"1e308", b"1e999", b"9" * 400, b"1" * 30, b"nan", b"0x7f", b"1:1:1:1")
TOKENS = (
    *(b"[", b"]", b"{", b"}", b'"', b"'", b",", b":", b"\n", b"\t", b"<", b">", b"&a", b"*a"),
    *(b"- ", b"? ", b"!!python/object:os.system", b"<<: *a", b"<!DOCTYPE a [<!ENTITY b 'c'>]>"),
    *(b"&b;", b"\x00", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xef\xbb\xbf", b"null", b"true"),
)
VALUES = (
    *(None, True, False, 0, -1, 3, 0.5, 2**31, 2**63, 10**30, 1e-320, 1e308, -1e308),
    *(float("nan"), float("inf"), "", "1", "nan", "\x1b[31m\n", "\ud800", [], {}, [[]], [None]),
)
"""Values of other types and sizes than expected."""

VALUE = re.compile(r'<(\w+)\b[^<>]*>[^<>]*</\1>|<[^<>]*>|"[^"\n]*"|[^\s,:=\[\]{}<>"]+')
"""A value in a text of any format: an element without child elements, a tag, a string, a word or a
number."""

MEMBER = re.compile(r'"[^"\n]*": *(?:"[^"\n]*"|[^\[\]{},]+)')
TEXTS = (".json", ".jsonl", ".yaml", ".xml", ".txt", ".toml", ".csv", ".pto", ".cameramodel")
NESTINGS = (("[", "]"), ('{"a":', "}"), ("<a>", "</a>"), ("- ", ""), ("(", ")"))


def damaged(whole: bytes, name: str, rng: random.Random) -> bytes:
    """Return a file with faults; half of the texts are damaged in their content."""
    if PurePath(name).suffix not in TEXTS or rng.random() < 0.5:
        return _damaged_bytes(whole, rng)
    text = whole.decode()
    for _ in range(rng.randint(1, 3)):
        with suppress(RecursionError):  # a text that is nested too deeply stays unchanged
            text = rng.choice((_other_tree, _other_tree, _other_value, _other_lines))(text, rng)
    return text.encode("utf-8", "surrogatepass")[:MAX_BYTES]


def _damaged_bytes(whole: bytes, rng: random.Random) -> bytes:
    """Return a file with one to four faults."""
    file = bytearray(whole)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(file) + 1)
        end = min(len(file), at + int(2 ** rng.uniform(0, 10)))
        fault = rng.randrange(8)
        if fault == 0:
            file[at : at + 1] = bytes([rng.randrange(256)])
        elif fault == 1:
            file[at:end] = rng.randbytes(end - at)
        elif fault == 2:
            del file[at:end]
        elif fault == 3:
            file[at:at] = file[at:end] * int(2 ** rng.uniform(0, 12))
        elif fault == 4:
            del file[at:]
        elif fault == 5:
            number = NUMBER.search(file, at)
            if number:
                file[slice(*number.span())] = rng.choice(EXTREMES)
        elif fault == 6:
            file[at:at] = rng.choice(TOKENS) * int(2 ** rng.uniform(0, rng.choice((1, 14))))
        else:
            other = rng.randrange(len(file) + 1)
            file[other : other + end - at] = file[at:end]
        del file[MAX_BYTES:]
    return bytes(file)


def _other_tree(text: str, rng: random.Random) -> str:
    """Change a JSON or YAML text, or a line of JSON Lines, at one node of its tree."""
    before, after = "", ""
    try:
        is_yaml = text.startswith(("image", "cam")) and len(text) < MAX_YAML
        tree = yaml.safe_load(text) if is_yaml else json.loads(text)
    except (ValueError, RecursionError, yaml.YAMLError):
        lines = text.split("\n")
        at = rng.randrange(len(lines))
        before, after = ("".join(f"{each}\n" for each in part) for part in (lines[:at], lines[at:]))
        try:
            tree = json.loads(lines[at])
        except (ValueError, RecursionError):
            return _other_value(text, rng)
        after = after[len(lines[at]) :]
    places = list(_places(tree))
    if not places:
        return text
    parent, key = rng.choice(places)
    fault = rng.randrange(7)
    if fault == 0:
        parent[key] = rng.choice(VALUES)
    elif fault == 1:
        del parent[key]
    elif fault == 2:
        other, its_key = rng.choice(places)
        parent[key] = copy.deepcopy(other[its_key])
    elif fault == 3:
        parent[key] = [parent[key]] * _times(parent[key], rng)
    elif fault == 4:
        parent[key] = str(parent[key]) * _times(parent[key], rng)
    elif fault == 5 and isinstance(parent, dict):
        for number in range(_times(parent[key], rng)):
            parent[f"{key}{number}"] = parent[key]
    elif isinstance(parent[key], int | float):
        with suppress(OverflowError):  # an integer of many digits
            parent[key] *= rng.choice((-1, 0, 1e-9, 1e9, 1e300))
    return before + json.dumps(tree)[:MAX_BYTES] + after


def _times(value: Any, rng: random.Random) -> int:
    """Return a number of repetitions of a value that keeps the file small."""
    return int(2 ** rng.uniform(0, 14)) // (1 + len(str(value)) // 50)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every list or object of a tree with each of its indices or keys."""
    waiting = [tree]
    while waiting:
        parent = waiting.pop()
        if isinstance(parent, dict | list):
            keys = parent if isinstance(parent, dict) else range(len(parent))
            yield from ((parent, key) for key in keys)
            waiting += [parent[key] for key in keys]


def _other_value(text: str, rng: random.Random) -> str:
    """Change a value of a text of any format, nest it, or repeat its key with another value."""
    found = list((MEMBER if rng.random() < 0.2 else VALUE).finditer(text))
    if not found:
        return text
    match = rng.choice(found)
    value, fault = match[0], rng.randrange(6)
    if fault == 0:
        value = rng.choice(EXTREMES).decode()
    elif fault == 1:
        value = rng.choice(found)[0]
    elif fault == 2:
        value = ""
    elif fault == 3:
        value = rng.choice((" ", ", ", "\n")).join([value] * _times(value, rng))
    elif fault == 4:
        opening, closing = rng.choice(NESTINGS)
        depth = int(2 ** rng.uniform(0, 17))
        value = opening * depth + value + closing * depth
    else:
        value = value[:-1] + value[-1] * int(2 ** rng.uniform(0, 18))
    return (text[: match.start()] + value + text[match.end() :])[:MAX_BYTES]


def _other_lines(text: str, rng: random.Random) -> str:
    """Drop, repeat or move lines of a text."""
    lines = text.splitlines(keepends=True)
    start = rng.randrange(len(lines) + 1)
    moved = lines[start : start + int(2 ** rng.uniform(0, 4))]
    if rng.random() < 0.5:
        del lines[start : start + len(moved)]
    at = rng.randrange(len(lines) + 1)
    lines[at:at] = moved * (1 + _times("".join(moved), rng))
    return "".join(lines)[:MAX_BYTES]
