"""Limits for production: how they are read, refused, and met or not."""

import pytest
from batches import record_of

import trisquare as ts
from trisquare.batch.requirements import read_requirements

RECORD = record_of(ts.Job("a", ("a.png",)))  # fx 1000 +- 0.5, k1 -0.1 +- 0.001

HAS_NO_CX = "std.cx: the model radial1 does not have this parameter, or it is fixed"


def violations(tmp_path, text, record=RECORD):
    path = tmp_path / "limits.toml"
    path.write_text(text)
    found = [own.violation(record) for own in read_requirements(path)]
    return [own for own in found if own is not None]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('[fx]\nnominal = 1005\nwithin = "1 %"', []),
        ('[fx]\nnominal = 1005\nwithin = "0.4%"', ["fx 1000 is below 1000.98"]),
        ("[fx]\nnominal = 990\nwithin = 9", ["fx 1000 is above 999"]),
        ('[k1]\nnominal = -0.1\nwithin = "1 %"', []),
        ("[std.fx]\nmost = 0.5", []),
        ("[std]\nfx = { most = 0.4 }", ["std.fx 0.5 is above 0.4"]),
        (
            "[rms_px]\nmost = 0.01\n[planes]\nleast = 4",
            ["rms_px 0.02 is above", "planes 3"],
        ),
        ("[noise_scale]\nleast = 0.5\nmost = 2", []),
        ("[k3]\nmost = 1", ["k3: the model radial1 does not have this parameter"]),
        ("[std.cx]\nmost = 1", [HAS_NO_CX]),
        ('[std.fx]\nmost = "0.05 %"', []),
        ('[std.fx]\nmost = "0.04 %"', ["std.fx 0.05 % is above 0.04 %"]),
        ('[std.k1]\nleast = "1.1 %"', ["std.k1 1 % is below 1.1 %"]),
        ('[std.cx]\nmost = "1 %"', [HAS_NO_CX]),
        ('[warnings]\nmost = "none"', []),
    ],
)
def test_cameras_pass_or_not(tmp_path, text, expected):
    found = violations(tmp_path, text)
    assert len(found) == len(expected)
    for own, beginning in zip(found, expected, strict=True):
        assert own.startswith(beginning)


@pytest.mark.parametrize(
    ("most", "expected"),
    [
        ("high", []),
        ("medium", ["warnings: glare is high, above medium"]),
        ("low", ["warnings: glare is high, bent is medium, above low"]),
    ],
)
def test_warnings_may_be_so_severe(tmp_path, most, expected):
    warnings = [
        {"code": code, "severity": severity, "text": ""}
        for code, severity in (("glare", "high"), ("bent", "medium"), ("bent", "medium"))
    ]
    record = RECORD | {"warnings": warnings}
    assert violations(tmp_path, f'[warnings]\nmost = "{most}"', record) == expected


def test_limits_are_named_in_one_line(tmp_path):
    path = tmp_path / "limits.toml"
    path.write_text(
        '[fx]\nnominal = 1000\nwithin = "1 %"\n[planes]\nleast = 3\n[std.fx]\nmost = "0.5 %"\n'
        '[warnings]\nmost = "low"\n'
    )
    assert [str(own) for own in read_requirements(path)] == [
        "990 <= fx <= 1010",
        "planes >= 3",
        "std.fx <= 0.5 %",
        "warnings <= low",
    ]


def test_a_parameter_of_zero_is_known_to_no_part_of_it(tmp_path):
    record = RECORD | {"values": {"fx": 1000.0, "k1": 0.0}}
    found = violations(tmp_path, '[std.k1]\nmost = "1 %"', record)
    assert found == ["std.k1 inf % is above 1 %"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[f_x]\nmost = 1", "unknown parameter 'f_x': did you mean 'fx'"),
        ("[std.fz]\nmost = 1", "unknown parameter 'fz'"),
        ("[fx]\nmots = 1", r"\[fx\] unknown key 'mots': did you mean 'most'"),
        ("[fx]\nnominal = 1", "needs both nominal and within"),
        ("[fx]\nwithin = 1", "needs both nominal and within"),
        ("[fx]\nnominal = 1\nwithin = 1\nmost = 2", "not both"),
        ('[fx]\nnominal = 1\nwithin = "1"', 'as "1 %"'),
        ("[fx]\nnominal = 1\nwithin = -1", "not be negative"),
        ("[fx]\nmost = nan", "NaN"),
        ('[fx]\nmost = "1"', "real numbers"),
        ("[fx]\nmost = true", "real numbers"),
        ("[fx]\nleast = 2\nmost = 1", "least is above most"),
        ('[std.fx]\nleast = 1\nmost = "1 %"', r"\[std\.fx\] least must be in per cent"),
        ('[std.fx]\nmost = "1"', "as \"1 %\", not '1'"),
        ('[warnings]\nmost = "hihg"', "unknown severity 'hihg': did you mean 'high'"),
        ("[warnings]\nmost = 1", "unknown severity '1'"),
        ('[warnings]\nleast = "low"', r"\[warnings\] unknown key 'least'"),
        ("[warnings]", "must be a table with most"),
        ("fx = 1", "must be a table"),
        ("[fx]", "must be a table"),
        ("std = 1", "unknown parameter 'std'"),
        ("", "the file contains no limit"),
        (f"a = {'[' * 5000}", "nested too deeply"),
        (f"a{'.a' * 500_000} = 1", "may have at most 10000 characters"),
        ("[fx", "Expected"),
    ],
)
def test_wrong_files_are_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as caught:
        violations(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "limits.toml"))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(OSError, match=r"limits\.toml"):
        read_requirements(tmp_path / "limits.toml")
