"""The README and the pages: their blocks of code, run as a reader would."""

import re
import shlex
from pathlib import Path

import pytest

from trisquare.cli.app import main

CHECKOUT = Path(__file__).parents[2]
DOCS = CHECKOUT / "docs"
PAGES = sorted(path.name for path in DOCS.glob("*.md"))

# Lines of a shell that no test runs: they fetch packages, never end, or need such a process.
ELSEWHERE = ("make ", "pip install ", "maturin ", "uvicorn ", "trisquare serve ", "curl ")
SHELLS = ("sh", "bash", "console")


def page(name):
    return (CHECKOUT / name if name == "README.md" else DOCS / name).read_text("utf-8")


def blocks(text, *languages):
    """Return (language, content) of the code blocks of some languages, in order."""
    wanted = "|".join(languages)
    return re.findall(rf"^```({wanted})\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def sessions(content):
    """Return (command, lines shown below it) for each command of a block of ``console``."""
    shown = []
    for line in content.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            shown.append((line[2:], []))
        else:
            shown[-1][1].append(line)
    return shown


def run_line(line):
    """Run a command as in a shell, and return whether a test can run it."""
    if line.startswith(ELSEWHERE):
        return False
    command, *arguments = shlex.split(line, comments=True)
    assert command == "trisquare", line
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0, line
    return True


def run_page(name, capsys, languages=(*SHELLS, "python")):
    """Run the commands and the Python of a page in order, and return its variables.

    The output shown in a ``console`` block must be what is printed.
    """
    names = {}
    for language, content in blocks(page(name), *languages):
        if language == "python":
            exec(compile(content, name, "exec"), names)
        elif language == "console":
            for line, shown in sessions(content):
                capsys.readouterr()
                if run_line(line):
                    assert_same_text(capsys.readouterr().out, "\n".join(shown))
        else:
            for line in content.splitlines():
                run_line(line)
    return names


def assert_same_text(printed, shown):
    """Check that a printed text is the one that is shown.

    Spaces and rules depend on the terminal; the last digit of a number may depend on the processor.
    """
    words, expected = (re.sub(r"─+", "", text).split() for text in (printed, shown))
    assert len(words) == len(expected), printed
    for word, own in zip(words, expected, strict=True):
        if re.fullmatch(r"-?\d+\.\d+", own):
            last_digit = 10.0 ** -len(own.partition(".")[2])
            assert abs(float(word) - float(own)) < 1.5 * last_digit, printed
        else:
            assert word == own, printed
