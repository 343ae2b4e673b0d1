"""The published wheel and source distribution, used outside the checkout.

`make` compiles them in less time than releases take; their files and metadata are the same.
"""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from filelock import FileLock

from trisquare.results.calibration import Calibration

CHECKOUT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow  # because it compiles the core


def run(*command, folder, **environment):
    """Run a command that must succeed; its output is shown if it does not."""
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def only(folder, pattern):
    (path,) = folder.glob(pattern)
    return path


def building():
    """Let only one of pytest's processes build in the checkout's target folder at a time."""
    return FileLock(CHECKOUT / "target" / "wheel.lock")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    maturin = (sys.executable, "-m", "maturin")
    with building():
        run(*maturin, "build", "--profile", "quick", "--out", folder, folder=CHECKOUT)
    return only(folder, "*.whl")


@pytest.fixture(scope="module")
def wheel_from_sdist(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sdist")
    run(sys.executable, "-m", "maturin", "sdist", "--out", folder, folder=CHECKOUT)
    # The checkout's target folder has the compiled dependencies, which need not be compiled again.
    with building():
        run(
            *(sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation"),
            *("--config-settings", "build-args=--profile=quick"),
            *("--wheel-dir", folder, only(folder, "*.tar.gz")),
            folder=folder,
            CARGO_TARGET_DIR=str(CHECKOUT / "target"),
            PATH=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        )
    return only(folder, "*.whl")


def names_in(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if "sboms" not in name}


def test_the_wheel_serves_every_python_from_3_10(wheel):
    assert "-cp310-abi3-" in wheel.name


def test_the_wheel_holds_types_data_and_licences(wheel):
    names = names_in(wheel)
    report = [f"report/report.{kind}" for kind in ("html.j2", "css", "js")]
    for name in (
        "_core.pyi",
        "py.typed",
        "data/demo.png",
        "data/demo.json",
        "batch/summary.html.j2",
        *(f"serve/static/{name}" for name in ("index.html", "style.css", "main.js", "editor.js")),
        *report,
    ):
        assert f"trisquare/{name}" in names
    for licence in ("LICENSE-MIT", "LICENSE-APACHE"):
        assert any(name.endswith(f".dist-info/licenses/{licence}") for name in names)
    folders = {name.split("/")[0] for name in names}
    assert {folder for folder in folders if not folder.endswith(".dist-info")} == {"trisquare"}


def test_the_source_distribution_builds_the_same_wheel(wheel, wheel_from_sdist):
    # pip leaves the tag for every Linux (manylinux) to the publisher.
    assert wheel_from_sdist.name.rsplit("-", 1)[0] == wheel.name.rsplit("-", 1)[0]
    assert names_in(wheel_from_sdist) == names_in(wheel)


def test_the_demo_runs_where_only_the_wheel_is_installed(wheel, tmp_path):
    environment, elsewhere = tmp_path / "environment", tmp_path / "elsewhere"
    venv.create(environment, with_pip=True)
    elsewhere.mkdir()
    scripts = environment / ("Scripts" if os.name == "nt" else "bin")
    run(scripts / "python", "-m", "pip", "install", "--quiet", wheel, folder=elsewhere)
    out = run(scripts / "trisquare", "demo", folder=elsewhere, PYTHONPATH="")
    assert "fx" in out
    written = elsewhere / "demo-output" / "camera.json"
    assert Calibration.from_json(written.read_text()).planes
    where = run(
        *(scripts / "python", "-c", "import trisquare; print(trisquare.__file__)"),
        folder=elsewhere,
        PYTHONPATH="",
    )
    assert Path(where.strip()).is_relative_to(environment)
