"""The damage of `make fuzz`, on a few files."""

import json
import random
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from damage import MAX_BYTES, damaged

FUZZ = Path(__file__).parents[2] / "fuzz"

TEXT = json.dumps({"format": "a/1", "squares": [{"corners": [[1, 2], [3, 4.5]], "name": "b"}] * 2})
FILES = {
    "a.json": TEXT,
    "a.yaml": "a: [1, 2]\nb: c\n",
    "a.xml": "<a><b c='1'>2</b></a>\n",
    "a.png": "x" * 500,
}


@pytest.mark.parametrize("name", FILES)
def test_a_case_is_always_the_same_and_never_too_large(name):
    whole = FILES[name].encode()
    first, again = (
        [damaged(whole, name, random.Random(f"{seed}")) for seed in range(count)]
        for count in (300, 50)
    )
    assert first[:50] == again
    assert max(map(len, first)) <= MAX_BYTES
    assert sum(file == whole for file in first) < 30


def test_texts_are_damaged_in_what_they_say():
    """About half of many are still JSON, with other values, types and keys."""
    parsed = []
    for seed in range(300):
        with suppress(ValueError, RecursionError):
            parsed.append(json.loads(damaged(TEXT.encode(), "a.json", random.Random(seed))))
    assert 60 < len(parsed) < 240
    whole = json.loads(TEXT)
    assert sum(members == whole for members in parsed) < 30
    assert any(isinstance(members, dict) and "squares" not in members for members in parsed)
    assert any("Infinity" in json.dumps(members) for members in parsed)


@pytest.mark.slow
def test_readers_are_run(tmp_path):
    """They run in processes of their own; undamaged files are read first."""
    names = ("limits/", "layout/", "picture/a.png", "frames/a.avi")
    done = subprocess.run(
        [sys.executable, str(FUZZ / "readers.py"), "--cases", "40", *names],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for name in names:
        assert re.search(rf"^\| {name}\S* \| 40 \| 0\.\d+ \| \d+ \|", done.stdout, re.MULTILINE)
