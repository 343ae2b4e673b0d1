"""Error messages of commands."""

import json

PREFIX = "trisquare: error: "


def error_text(err, *, as_json=False):
    """The text of the one line on standard error; a JSON object where `as_json`."""
    assert err.endswith("\n")
    assert err.count("\n") == 1
    if as_json:
        members = json.loads(err)
        assert members["format"] == "trisquare-error/1"
        return members["error"]["text"]
    assert err.startswith(PREFIX)
    return err.removeprefix(PREFIX)
