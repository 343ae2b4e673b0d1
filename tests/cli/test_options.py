"""Advice in messages, as options of the command line."""

import pytest

from trisquare.cli.options import as_options


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ('With fix="aspect", fx is 1', "With --fix aspect, fx is 1"),
        ('lines=True needs method="ml"', "--lines needs --method ml"),
        ("fix it at a known value (initial=)", "fix it at a known value (--initial)"),
        ("free= names it", "--free names it"),
        (
            'model="auto" takes none; say model= otherwise',
            "--model auto takes none; say --model otherwise",
        ),
        (
            "state the length with side=, or in metres (side=)",
            "state the length with --side, or in metres (--side)",
        ),
        ("f = 3, side=84 is 84 m", "f = 3, side=84 is 84 m"),
    ],
)
def test_keywords_are_written_as_options(message, expected):
    assert as_options(message) == expected
