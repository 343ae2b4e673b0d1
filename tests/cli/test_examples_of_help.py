"""The examples in the help of every command run, with files of the names in them."""

import glob
import json
import shlex
import shutil
from importlib import resources

import cv2
import numpy as np
import pytest
from shown import blocks, page
from videos import write_frames

import trisquare as ts
from trisquare import simulate
from trisquare.cli.framework import SUMMARIES, load_command

pytestmark = pytest.mark.slow

# Commands that never end, or need a cluster.
ELSEWHERE = ("trisquare serve", "--dask")
EXAMPLES = [
    example
    for name in SUMMARIES
    for example in load_command(name).examples
    if not any(part in example for part in ELSEWHERE)
]


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Make every file named in an example."""
    folder = tmp_path_factory.mktemp("given")
    demo = (resources.files("trisquare") / "data" / "demo.png").read_bytes()
    photo = cv2.imdecode(np.frombuffer(demo, np.uint8), cv2.IMREAD_COLOR)
    result = ts.calibrate(photo)
    camera = result.camera
    width, height = camera.image_size

    for place in ("line", "fleet", "archive"):
        (folder / place).mkdir()
    for name in ("photo.jpg", "one.jpg", "line/l1.jpg", "fleet/a_1.jpg", "fleet/b_1.jpg"):
        cv2.imwrite(str(folder / name), photo, [cv2.IMWRITE_JPEG_QUALITY, 97])
    cv2.imwrite(str(folder / "wide.png"), photo)
    write_frames(folder / "clip.mp4", [photo] * 12)
    cv2.imwrite(str(folder / "frame-1.png"), photo)
    cv2.imwrite(str(folder / "small.png"), cv2.resize(photo, (width // 2, height // 2)))
    truth = simulate.TrueCamera(
        camera.fx, camera.fy, camera.cx, camera.cy, camera.distortion, (width, height)
    )
    rng = np.random.default_rng(5)
    for name in ("two.jpg", "three.jpg", "later.jpg"):
        scene = simulate.random_scene(rng, camera=truth, kind="frame")
        cv2.imwrite(str(folder / name), simulate.render(scene, rng))
    corner = simulate.render(simulate.corner_scene(rng), rng)
    cv2.imwrite(str(folder / "corner.jpg"), corner, [cv2.IMWRITE_JPEG_QUALITY, 95])
    square = simulate.TrueCamera(900, 900, 639.5, 479.5, image_size=(1280, 960))
    board = simulate.chessboard_scene(rng, square)
    cv2.imwrite(str(folder / "board.png"), simulate.render(board, rng))

    for name in ("camera.json", "today.json", "last_month.json", "full.json"):
        result.save(folder / name)
    camera.rescaled((width // 2, height // 2)).save(folder / "half.json")
    camera.save(folder / "camera_info.yaml")
    camera.save(folder / "camchain.yaml", approximate=True)
    chain = (folder / "camchain.yaml").read_text()
    (folder / "camchain.yaml").write_text(chain + chain.replace("cam0", "cam1"))
    (folder / "cameras.csv").write_text("name,photographs\nleft,one.jpg;two.jpg\nright,three.jpg\n")
    ((_, limits),) = blocks(page("batch.md"), "toml")
    (folder / "limits.toml").write_text(limits)
    (plan,) = [text for _, text in blocks(page("formats.md"), "json") if "plan" in text]
    (folder / "plan.json").write_text(plan)
    return folder


@pytest.mark.parametrize("example", EXAMPLES)
def test_an_example_of_the_help_runs(example, given, tmp_path, monkeypatch, run):
    folder = tmp_path / "work"
    shutil.copytree(given, folder)
    monkeypatch.chdir(folder)
    words = []
    for word in shlex.split(example)[1:]:  # split as by a shell, where nothing is quoted
        is_pattern = "*" in word and f"'{word}'" not in example
        words += sorted(glob.glob(word)) if is_pattern else [word]
    code, out, err = run(*words)
    assert code == 0, err
    if "--json" in words:
        assert json.loads(out)["format"].startswith("trisquare")
