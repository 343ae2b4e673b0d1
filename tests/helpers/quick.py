"""Which of several draws `make test` runs; `make test-all` runs all of them."""

import pytest


def first_quick(values, count=1):
    """Return the values as parameters; those after the first `count` are marked slow."""
    return [
        value if number < count else pytest.param(*as_tuple(value), marks=pytest.mark.slow)
        for number, value in enumerate(values)
    ]


def as_tuple(value):
    return value if isinstance(value, tuple) else (value,)
