"""Videos as inputs of commands: their outputs, calibrations and refusals."""

import json
import os
import shutil
import subprocess

import cv2
import numpy as np
import pytest
from command_errors import error_text
from scenes import camera_of, squares
from terminals import COMMAND, on_terminal
from videos import moving, read_frames, stamped, turned_clockwise, write_frames

import trisquare as ts
from trisquare import simulate
from trisquare.images.frame_choice import choose_frames
from trisquare.images.video import Video, write_video

SIZE = (640, 480)
SCENE = squares(61, image_size=SIZE)
CAMERA = camera_of(SCENE)
VIEWS = [
    simulate.render(scene, np.random.default_rng(seed), noise=1.0, tone="srgb")
    for seed, scene in enumerate((SCENE, *(squares(each, SCENE.camera) for each in (62, 63))))
]
FRAMES = moving(12, SIZE)


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    folder = tmp_path_factory.mktemp("given")
    CAMERA.save(folder / "camera.json")
    write_frames(folder / "clip.mp4", FRAMES, 29.97)
    cv2.imwrite(str(folder / "photo.png"), FRAMES[0])
    return folder


@pytest.fixture
def folder(given, tmp_path, monkeypatch):
    for path in given.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def views(folder):
    """Three views by one camera, in five frames each, of which one is sharp."""
    blurs = (2, 1.5, 0, 1.7, 2.2)
    frames = [cv2.GaussianBlur(v, (0, 0), b) if b else v for v in VIEWS for b in blurs]
    write_frames(folder / "views.avi", frames)
    return folder


def shown_as(folder, options):
    """The frames of the clip, undistorted one by one and encoded in the same way."""
    with Video(folder / "clip.mp4") as video:
        undistorter = ts.Undistorter(CAMERA, **options)
        straight = [undistorter.undistort(frame) for frame in video.frames()]
        write_video(folder / "expected.mp4", straight, video.rate)
    return read_frames(folder / "expected.mp4")


@pytest.mark.parametrize("balance", [0.0, 0.5])
def test_every_frame_is_undistorted(run, folder, balance):
    arguments = ("--camera", "camera.json", "-o", "out.mp4", "--balance", balance)
    code, out, _ = run("undistort", "clip.mp4", *arguments)
    assert (code, out.splitlines()[-1]) == (0, "wrote out.mp4")
    found = read_frames(folder / "out.mp4")
    assert len(found) == len(FRAMES)
    np.testing.assert_array_equal(found, shown_as(folder, {"balance": balance}))
    with Video(folder / "out.mp4") as video:
        assert video.rate == pytest.approx(29.97)


def test_json_says_what_was_written(run, folder):
    arguments = ("--camera", "camera.json", "-o", "made/", "--json")
    code, out, err = run("undistort", "clip.mp4", "photo.png", *arguments)
    assert (code, err) == (0, "")
    answer = json.loads(out)
    video, picture = answer["pictures"]
    assert (video["output"], video["frames"], video["turned"]) == ("made/clip.mp4", 12, 0)
    assert video["rate"] == pytest.approx(29.97)
    assert {**picture, "photo": "clip.mp4", "output": "made/clip.mp4"}.items() <= video.items()
    if shutil.which("ffmpeg") is None:
        (warning,) = answer["warnings"]
        assert warning.startswith("made/clip.mp4: its sound, if any, is left out")
    straight = cv2.imread(str(folder / "made" / "photo.png"))
    np.testing.assert_array_equal(straight, ts.undistort(FRAMES[0], CAMERA))


def test_a_turned_video_is_shown_upright_again(run, folder):
    path = folder / "clip.mp4"
    path.write_bytes(turned_clockwise(path.read_bytes()))
    code, _, err = run("undistort", "clip.mp4", "--camera", "camera.json", "-o", "out.avi")
    assert code == 0
    assert "out.avi: turned clockwise by 90 degrees" in err
    frame = read_frames(folder / "out.avi")[0]
    assert frame.shape == (640, 480, 3)
    expected = np.rot90(ts.undistort(FRAMES[0], CAMERA), -1)
    assert np.abs(frame.astype(int) - expected).mean() < 8  # from the coding


def test_frames_that_come_unevenly_are_told(run, folder):
    write_frames(folder / "even.flv", FRAMES[:5])
    times = [0, 100, 150, 700, 800]
    (folder / "uneven.flv").write_bytes(stamped((folder / "even.flv").read_bytes(), times))
    options = ("--camera", "camera.json", "-o", "out/", "--json")
    for name, off in (("even", 0.0), ("uneven", 0.4)):
        (folder / f"{name}.mp4").write_bytes((folder / f"{name}.flv").read_bytes())
        code, out, _ = run("undistort", f"{name}.mp4", *options)
        assert code == 0
        answer = json.loads(out)
        assert answer["pictures"][0]["unevenness_s"] == pytest.approx(off, abs=0.01)
        told = [each for each in answer["warnings"] if "unevenly" in each]
        assert len(told) == (off > 0)
        assert all(each.startswith("out/uneven.mp4: ") for each in told)


def test_the_camera_is_scaled_to_a_smaller_video(run, folder):
    write_frames(folder / "clip.mp4", moving(3, (320, 240)))
    arguments = ("undistort", "clip.mp4", "--camera", "camera.json", "-o", "out.mp4")
    code, _, err = run(*arguments)
    assert code == 2
    assert (
        "clip.mp4: the picture has 320 x 240 pixels, but the camera's pictures have 640 x 480"
        in err
    )
    assert not (folder / "out.mp4").exists()
    assert run(*arguments, "--rescale")[0] == 0
    assert read_frames(folder / "out.mp4")[0].shape == (240, 320, 3)


def test_a_bar_shows_how_much_of_the_video_is_done(folder):
    words = ("undistort", "clip.mp4", "--camera", "camera.json", "-o", "out.mp4")
    assert "undistorting" in on_terminal(words, "stderr", {**os.environ, "TERM": "xterm"})


@pytest.fixture(scope="module")
def damaged(given, tmp_path_factory):
    """Contents of videos that are cut or empty."""
    long, empty = (tmp_path_factory.mktemp("videos") / name for name in ("long.avi", "empty.avi"))
    write_frames(long, moving(60, SIZE, 1))
    cv2.VideoWriter(str(empty), cv2.VideoWriter.fourcc(*"MJPG"), 10, SIZE).release()
    whole, encoded = (given / "clip.mp4").read_bytes(), long.read_bytes()
    return {
        "cut.mp4": whole[: len(whole) // 2],
        "text.mp4": b"no video",
        "cut.avi": encoded[: len(encoded) // 2],
        **({"empty.avi": empty.read_bytes()} if empty.exists() else {}),
    }


@pytest.fixture
def faulty(folder, damaged):
    """The folder with faulty videos beside the intact one."""
    for name, content in damaged.items():
        (folder / name).write_bytes(content)
    return folder


UNDISTORT = "--camera camera.json -o"


@pytest.mark.parametrize(
    ("arguments", "exit_code", "said"),
    [
        (f"undistort cut.mp4 {UNDISTORT} out.mp4", 5, "cut.mp4: not a readable"),
        (f"undistort cut.avi {UNDISTORT} out.mp4", 5, "cut.avi: truncated: 31 of 60 frames"),
        (f"undistort empty.avi {UNDISTORT} out.mp4", 5, "empty.avi: "),
        (f"undistort clip.mp4 cut.avi {UNDISTORT} new/", 5, "cut.avi: truncated"),
        (f"undistort clip.mp4 {UNDISTORT} out.png", 2, "out.png: videos are written as .mp4"),
        (f"undistort clip.mp4 {UNDISTORT} out", 2, "out: videos are written as .mp4"),
        (
            f"undistort photo.png {UNDISTORT} out.mp4",
            2,
            "out.mp4: pictures cannot be written with the extension '.mp4': use .png, .jpg",
        ),
        (f"undistort gone.mp4 {UNDISTORT} out.mp4", 5, "gone.mp4: No such file or directory"),
        (f"undistort clip.mp4 {UNDISTORT} clip.mp4", 2, "overwrite"),
        (f"undistort clip.mp4 {UNDISTORT} missing/out.mp4", 2, "no folder"),
        (
            "calibrate clip.mp4",
            5,
            "clip.mp4: a video, not a photograph: calibrate and batch choose",
        ),
        ("calibrate clip.mp4 --frames 0", 2, "at least 1"),
        ("calibrate clip.mp4 --frames x", 2, "--frames"),
        ("calibrate photo.png --frames 3", 2, "no video is given"),
        ("calibrate gone.mp4 --frames 3", 5, "gone.mp4: No such file or directory"),
        ("calibrate cut.mp4 --frames 3", 5, "cut.mp4: not a readable video"),
        ("calibrate cut.avi --frames 3", 5, "cut.avi: truncated: 31 of 60 frames"),
        ("calibrate empty.avi --frames 3", 5, "empty.avi: "),
        ("calibrate text.mp4 --frames 3", 5, "text.mp4: not a readable picture"),
        (f"undistort text.mp4 {UNDISTORT} out.mp4", 5, "text.mp4: not a readable picture"),
        ("calibrate clip.mp4 --frames 3 --max-pixels 1000", 5, "more than the 1000"),
        ("calibrate clip.mp4 --frames 1", 3, "no"),
        ("measure clip.mp4 --camera camera.json 1,1 2,2", 5, "clip.mp4: a video"),
    ],
)
def test_what_is_wrong_is_one_line_and_writes_nothing(run, faulty, arguments, exit_code, said):
    before = {path.name: path.read_bytes() for path in faulty.iterdir()}
    code, out, err = run(*arguments.split())
    assert (code, out) == (exit_code, "")
    assert said in error_text(err, as_json=False)
    assert {path.name: path.read_bytes() for path in faulty.iterdir()} == before


@pytest.mark.parametrize("name", ["cut.mp4", "cut.avi"])
def test_ffmpeg_adds_no_lines_of_its_own(faulty, name):
    unset = {k: v for k, v in os.environ.items() if k != "OPENCV_FFMPEG_LOGLEVEL"}
    words = ("undistort", name, "--camera", "camera.json", "-o", "out.mp4")
    done = subprocess.run([*COMMAND, *words], env=unset, capture_output=True, text=True)
    assert done.returncode == 5
    assert name in error_text(done.stderr)


def test_a_camera_is_calibrated_from_frames_of_a_video(run, views):
    arguments = ("calibrate", "views.avi", "--frames", 3, "-o", "found.json", "--overlay", "o.png")
    code, out, _ = run(*arguments)
    assert code == 0
    found = ts.Calibration.load(views / "found.json")
    frames = choose_frames("views.avi", 3)
    assert [frame.number for frame in frames] == [2, 7, 12]
    assert {plane.image for plane in found.planes} == {0, 1, 2}
    assert found.camera == ts.calibrate([frame.pixels for frame in frames]).camera
    assert found == ts.calibrate("views.avi", frames=3)
    assert abs(found.camera.fx / CAMERA.fx - 1) < 0.01
    assert [f"wrote o-{number}.png" in out for number in (1, 2, 3, 4)] == [True] * 3 + [False]


def test_a_video_with_fewer_frames_and_a_photograph(run, folder):
    """The video has 3 of the 5 frames: pictures are written only for these and the photograph."""
    cv2.imwrite("view.png", VIEWS[0])
    write_frames(folder / "views.avi", VIEWS)
    words = ("view.png", "views.avi", "--frames", 5, "--debug-image", "d.png", "--json")
    code, out, _ = run("calibrate", *words)
    assert code == 0
    assert len(list(folder.glob("d-*.png"))) == 4
    assert {plane["image"] for plane in json.loads(out)["planes"]} == {0, 1, 2, 3}


def test_videos_of_a_folder_are_taken_where_frames_are(run, folder):
    (folder / "session").mkdir()
    code, _, err = run("calibrate", "session", "--frames", 3)
    assert (code, "contains no picture" in err) == (5, True)
    write_frames(folder / "session" / "b.avi", VIEWS)
    found = ts.calibrate("session", frames=3)
    assert found.camera == ts.calibrate("session/b.avi", frames=3).camera
    code, _, err = run("calibrate", "session")
    told = "session: the folder contains no picture; name its video itself, as session/b.avi"
    assert (code, error_text(err).strip()) == (5, told)
    cv2.imwrite("session/a.png", VIEWS[0])
    assert {plane.image for plane in ts.calibrate("session", fix="aspect").planes} == {0}
    assert (
        run("calibrate", "session", "--frames", 3, "-o", "found.json", "--overlay", "o.png")[0] == 0
    )
    with_both = ts.Calibration.load(folder / "found.json")
    assert with_both == ts.calibrate(["session/a.png", "session/b.avi"], frames=3)
    assert len(list(folder.glob("o-*.png"))) == 4


def test_warnings_name_the_frame(views):
    write_frames(views / "more.avi", [*VIEWS, *FRAMES[:1]])
    found = ts.calibrate(["more.avi"], frames=4)
    (warning,) = [each for each in found.warnings if each.code == "nothing_found"]
    assert "picture 3 (frame 3 of more.avi)" in str(warning)
