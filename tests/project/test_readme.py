"""What the README shows is what works."""

import re
from importlib import resources
from pathlib import Path

import trisquare as ts

CHECKOUT = Path(__file__).parents[2]
README = (CHECKOUT / "README.md").read_text("utf-8")
# Its documentation tests compile the crate's README.
CRATE_README = (CHECKOUT / "rust" / "trisquare" / "README.md").read_text("utf-8")


def blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def test_the_python_lines_run(tmp_path, monkeypatch, capsys):
    photo = (resources.files("trisquare") / "data" / "demo.png").read_bytes()
    (tmp_path / "photo.jpg").write_bytes(photo)
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in blocks(README, "python"):
        exec(code, names)
    result = ts.Calibration.from_json((tmp_path / "camera.json").read_text())
    printed = capsys.readouterr().out
    assert printed.startswith(f"{result}\n")
    assert "the same within their uncertainty" in printed
    assert names["K"].shape == (3, 3)
    assert names["distortion"].shape == (5,)


def test_the_rust_lines_are_those_that_are_compiled():
    assert blocks(README, "rust") == blocks(CRATE_README, "rust") != []


def test_the_commands_are_targets_of_the_makefile():
    makefile = (CHECKOUT / "Makefile").read_text("utf-8")
    (commands,) = blocks(README, "sh")
    targets = re.findall(r"^make (\w+)", commands, re.MULTILINE)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_the_commands_shown_are_there(run):
    (shown,) = blocks(README, "bash")
    commands = re.findall(r"^trisquare (\w+)", shown, re.MULTILINE)
    options = re.findall(r"--\w+", shown)
    for command in commands:
        code, printed, _ = run(command, "--help")
        assert code == 0
        options = [option for option in options if option not in printed]
    assert not options


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (CHECKOUT / target).is_file(), target
