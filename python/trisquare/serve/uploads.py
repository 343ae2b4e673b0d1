"""Bodies of requests: photographs and other files are put into the folder, options are JSON."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import Request

from trisquare._support.suggestions import unknown
from trisquare.batch.jobs import safe_file_name
from trisquare.serve.limits import MAX_PICTURES

MAX_FIELDS = 10
LARGEST_FIELD = 1 << 20
"""Maximum size of the options, bytes: they are parsed in the server's event loop, and take ten
times as much memory."""

DEEPEST = 50
"""Maximum depth of nesting of options: more than any option has, and within Python's recursion
limit."""

CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Upload:
    """The names of the files in the request's folder, and the options."""

    photographs: tuple[str, ...]
    files: Mapping[str, str]
    options: dict[str, Any]


async def received(request: Request, folder: Path, known: Sequence[str]) -> Upload:
    """Read the body of a request: a form with files in the known fields, or JSON of options.

    Files keep their names, without folders, so that messages and outlines can refer to them.

    Raises
    ------
    ValueError
        If a field is unknown or given twice, or the options are not a JSON object.
    HTTPException
        If the form is damaged, or the options are too large.
    """
    fields = (*known, "options")
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        try:
            return Upload((), {}, _options(await _small_body(request)))
        except ValueError as error:
            if known:
                fields_named = ", ".join(fields)
                raise ValueError(
                    f"send multipart/form-data with the fields {fields_named}, not a body of "
                    "another kind"
                ) from error
            raise ValueError(f"send a JSON object: {error}") from error
    photographs: list[str] = []
    files: dict[str, str] = {}
    options: dict[str, Any] | None = None
    async with request.form(
        max_files=MAX_PICTURES + MAX_FIELDS, max_fields=MAX_FIELDS, max_part_size=LARGEST_FIELD
    ) as form:
        for field, value in form.multi_items():
            if field not in fields:
                raise unknown("field", field, fields)
            if field in files or (field == "options" and options is not None):
                raise ValueError(f"the field {field!r} is given twice")
            if field == "options":
                options = _options(value if isinstance(value, str) else await _small(value))
            elif not isinstance(value, UploadFile):
                raise ValueError(f"the field {field!r} must be a file")
            elif field == "picture":
                if len(photographs) == MAX_PICTURES:
                    raise ValueError(f"more than {MAX_PICTURES} pictures")
                photographs.append(await _kept(value, folder, photographs))
            else:
                files[field] = await _kept(value, folder, (*photographs, *files.values()), field)
    return Upload(tuple(photographs), files, options or {})


async def _small_body(request: Request) -> bytes:
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_FIELD:
            raise _too_large()
    return body


async def _small(upload: UploadFile) -> bytes:
    content = await upload.read(LARGEST_FIELD + 1)
    if len(content) > LARGEST_FIELD:
        raise _too_large()
    return content


def _too_large() -> HTTPException:
    return HTTPException(413, f"the options have more than {LARGEST_FIELD} bytes")


def _options(text: str | bytes) -> dict[str, Any]:
    try:
        options = json.loads(text or "{}")
    except UnicodeDecodeError:
        raise ValueError("the options are neither JSON nor text") from None
    except RecursionError as error:
        raise ValueError("the options are nested too deeply") from error
    except ValueError as error:
        raise ValueError(f"the options are not valid JSON: {error}") from error
    if not isinstance(options, dict):
        raise ValueError(f"the options must be a JSON object, not {type(options).__name__}")
    level: list[Any] = [options]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _members(outer)]
    if level:
        raise ValueError("the options are nested too deeply")
    return options


def _members(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _file_name(text: str) -> str:
    """Return a valid name for a file, which answers use; other characters are escaped."""
    return safe_file_name(text).replace("%25", "%")


async def _kept(upload: UploadFile, folder: Path, taken: Any, prefix: str = "") -> str:
    """Write a file into the folder and return its name."""
    given = os.path.basename((upload.filename or "picture").replace("\\", "/")).strip()
    name = _file_name(f"{prefix}-{given or 'file'}" if prefix else given or "picture")
    count = 1
    while name in taken:
        count += 1
        name = _file_name(f"{count}-{given}")
    with open(folder / name, "xb") as file:
        while chunk := await upload.read(CHUNK):
            file.write(chunk)
    return name
