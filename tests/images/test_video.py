"""Videos: their frames, refusals, and their sound."""

import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from memory import growth
from quick import first_quick
from videos import (
    moving,
    read_frames,
    stamped,
    turned_clockwise,
    with_larger_frames,
    write_frames,
)

import trisquare.images.video
from trisquare.errors import ImageError, MissingImageError
from trisquare.images.limits import PictureLimits
from trisquare.images.video import Video, add_sound, check_video_name, is_video, write_video

FRAMES = moving(20)
SUFFIXES = (".mp4", ".mov", ".avi")


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("rate", [25.0, 29.97])
def test_frames_keep_number_order_and_rate(tmp_path, suffix, rate):
    path = tmp_path / f"clip{suffix}"
    assert write_video(path, FRAMES, rate) == len(FRAMES)
    with Video(path) as video:
        assert (video.size, video.stated_frames, video.turn) == ((160, 120), len(FRAMES), 0)
        assert video.rate == pytest.approx(rate, rel=1e-6)
        found = list(video.frames())
    assert len(found) == len(FRAMES)
    for index, frame in enumerate(found):
        apart = [np.abs(frame.astype(int) - other).mean() for other in FRAMES]
        assert np.argmin(apart) == index


def test_what_is_a_video(tmp_path):
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    picture = tmp_path / "picture.mp4"
    picture.write_bytes(cv2.imencode(".png", FRAMES[0])[1].tobytes())
    assert is_video(path)
    assert not any(map(is_video, (picture, tmp_path, tmp_path / "gone.mp4", os.devnull)))


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_frames_are_turned_clockwise(tmp_path, turn):
    write_video(tmp_path / "turned.avi", FRAMES[:3], 10, turn)
    write_video(tmp_path / "stored.avi", [np.rot90(each, -turn // 90) for each in FRAMES[:3]], 10)
    turned, stored = (read_frames(tmp_path / f"{name}.avi") for name in ("turned", "stored"))
    np.testing.assert_array_equal(turned, stored)


def test_frames_are_read_as_they_are_stored(tmp_path):
    upright, stored = tmp_path / "upright.mp4", tmp_path / "stored.mp4"
    write_frames(stored, FRAMES)
    upright.write_bytes(turned_clockwise(stored.read_bytes()))
    with Video(upright) as video:
        assert (video.turn, video.size) == (90, (160, 120))
        found = list(video.frames())
    np.testing.assert_array_equal(found, read_frames(stored))
    shown = [np.rot90(frame, -1) for frame in found]
    np.testing.assert_array_equal(shown, read_frames(upright))


def test_an_odd_column_and_row_are_left_out(tmp_path):
    path = tmp_path / "odd.mp4"
    write_video(path, [frame[:-1, :-1] for frame in FRAMES], 10)
    assert read_frames(path)[0].shape == (118, 158, 3)


@pytest.mark.parametrize("kept", [0.5, 0.9])
@pytest.mark.parametrize("suffix", [".avi", ".mp4"])
def test_a_truncated_video_is_refused(tmp_path, suffix, kept):
    """An MP4 file ends with the positions of its frames; an AVI file states their number."""
    path = tmp_path / f"clip{suffix}"
    write_frames(path, moving(50))
    encoded = path.read_bytes()
    path.write_bytes(encoded[: int(kept * len(encoded))])
    said = "truncated: .. of 50 frames" if suffix == ".avi" else "not a readable video"
    with pytest.raises(ImageError, match=rf"clip\{suffix}: {said}"), Video(path) as video:
        list(video.frames())


def test_a_video_without_frames_is_refused(tmp_path):
    path = tmp_path / "empty.avi"
    encoder = cv2.VideoWriter.fourcc(*"MJPG")
    cv2.VideoWriter(str(path), encoder, 10, (64, 48)).release()
    with pytest.raises(ImageError, match=r"empty\.avi: .*without frames"), Video(path) as video:
        list(video.frames())


def test_what_is_no_video_is_refused(tmp_path):
    with pytest.raises(MissingImageError, match=r"gone\.mp4: No such file"):
        Video(tmp_path / "gone.mp4")
    for content in (b"", b"text", cv2.imencode(".png", FRAMES[0])[1].tobytes()):
        (tmp_path / "other.mp4").write_bytes(content)
        with pytest.raises(ImageError, match="not a readable video"):
            Video(tmp_path / "other.mp4")


@pytest.mark.parametrize(
    "playlist",
    [
        "#EXTM3U\n#EXTINF:9,\nclip.avi\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile 'clip.avi'\n",
        "v=0\nm=video 5004 RTP/AVP 96\nc=IN IP4 127.0.0.1\n",
    ],
)
def test_what_names_other_videos_is_not_opened(tmp_path, monkeypatch, playlist):
    """FFmpeg would read the files and addresses in the list."""
    write_frames(tmp_path / "clip.avi", FRAMES)
    path = tmp_path / "list.mp4"
    path.write_text(playlist)
    monkeypatch.setattr(cv2, "VideoCapture", None)
    with pytest.raises(ImageError, match=r"list\.mp4: not a readable video"):
        Video(path)


def test_a_reader_that_gives_up_is_told(tmp_path, monkeypatch):
    """OpenCV's reader stops at chunks of an AVI file that are larger than it allows."""
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)

    with Video(path) as video:
        frames = video.frames()
        for _ in range(3):
            next(frames)

        def gives_up():
            raise cv2.error("Assertion failed")

        monkeypatch.setattr(video, "_capture", SimpleNamespace(read=gives_up, release=list))
        with pytest.raises(ImageError, match=r"clip\.avi: damaged after 3 frames"):
            next(frames)


def test_frames_of_too_many_pixels_are_refused(tmp_path):
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    with pytest.raises(ImageError, match="160 x 120 pixels, more than the 19199"):
        Video(path, PictureLimits(max_pixels=160 * 120 - 1))


def test_frames_that_ffmpeg_may_not_allocate_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    monkeypatch.setattr(trisquare.images.video, "MAX_ALLOCATION", 160 * 120 * 3)
    with Video(path) as video:
        assert len(list(video.frames())) == len(FRAMES)
    monkeypatch.setattr(trisquare.images.video, "MAX_ALLOCATION", 160 * 120 * 3 - 1)
    with pytest.raises(ImageError, match=r"clip\.avi: has frames of 160 x 120 pixels, more than"):
        Video(path)


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's account of memory")
def test_a_header_that_states_a_long_text_costs_nothing(tmp_path):
    """A text of an AVI file with a stated length of 1.9 GB, measured in a process of its own."""
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    file = bytearray(path.read_bytes())
    for length, stated in (
        (file.index(b"INFO") - 4, 2_000_000_000),
        (file.index(b"ISFT") + 4, 1_900_000_000),
    ):
        file[length : length + 4] = stated.to_bytes(4, "little")
    path.write_bytes(file)
    kilobytes, _ = growth("with Video(sys.argv[1]): pass", path)
    assert kilobytes < 200_000


@pytest.mark.parametrize(("each", "is_read"), [(0.005, True), (0.5, False)])
def test_frames_that_take_as_long_as_far_larger_ones_are_refused(
    tmp_path, monkeypatch, each, is_read
):
    """A frame may have a size of its own, which OpenCV decodes and scales to that of the first."""
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    clock = SimpleNamespace(now=0.0)

    def clocks():
        clock.now += each
        return clock.now, clock.now

    monkeypatch.setattr(trisquare.images.video, "_clocks", clocks)
    with Video(path) as video:
        if is_read:
            assert len(list(video.frames())) == len(FRAMES)
        else:
            with pytest.raises(ImageError, match=r"clip\.avi: .* 7 frames of 160 x 120 .* 3\.5 s"):
                list(video.frames())


@pytest.mark.slow
def test_frames_that_hide_larger_ones_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "clip.flv"
    write_frames(path, moving(6, (64, 48)))
    path.write_bytes(with_larger_frames(path.read_bytes(), (4000, 3000), 10_000))
    monkeypatch.setattr(trisquare.images.video, "MAX_SECONDS_MORE", 0.5)
    with Video(path) as video, pytest.raises(ImageError, match=r"64 x 48 pixels .* far larger"):
        list(map(np.shape, video.frames()))


def test_what_waits_for_others_is_no_decoding(tmp_path, monkeypatch):
    path = tmp_path / "clip.avi"
    write_frames(path, FRAMES)
    ticks = iter(range(1000))
    monkeypatch.setattr(trisquare.images.video, "_clocks", lambda: (0.0, 10.0 * next(ticks)))
    with Video(path) as video:
        assert len(list(video.frames())) == len(FRAMES)


@pytest.mark.parametrize(
    ("times", "off"),
    [([0, 100, 200, 300, 400], 0.0), ([0, 100, 150, 700, 800], 0.4), ([0] * 5, 0.0)],
)
def test_frames_that_come_unevenly_are_noticed(tmp_path, times, off):
    path = tmp_path / "clip.flv"
    write_frames(path, FRAMES[:5])
    path.write_bytes(stamped(path.read_bytes(), times))
    with Video(path) as video:
        assert video.rate == pytest.approx(10.0)
        assert len(list(video.frames())) == 5
        assert video.unevenness == pytest.approx(off, abs=0.01)


@pytest.mark.parametrize("name", ["clip", "clip.webm", "clip.png", "clip.mp4.txt"])
def test_other_extensions_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match=r"videos are written as \.mp4"):
        check_video_name(name)
    with pytest.raises(ValueError, match=r"videos are written as \.mp4"):
        write_video(tmp_path / name, FRAMES, 10)


def test_bad_arguments_are_refused(tmp_path):
    for rate in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="frames per second"):
            write_video(tmp_path / "clip.mp4", FRAMES, rate)
    with pytest.raises(ValueError, match="at least one frame"):
        write_video(tmp_path / "clip.mp4", [], 10)


FULL_DISK = """
import resource, signal, sys
from videos import moving
from trisquare._support.writing import write_in_turn
from trisquare.images.video import write_video

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
frames = moving(100)
write_in_turn([(sys.argv[1], lambda path: write_video(path, frames, 10))])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of a process")
@pytest.mark.parametrize("name", ["clip.mp4", "clip.mov", "clip.avi"])
@pytest.mark.parametrize("left", first_quick([0.3, 0.0, 0.999]))
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, name, left):
    write_video(tmp_path / name, moving(100), 10)
    most = int(left * (tmp_path / name).stat().st_size)
    (tmp_path / name).write_bytes(b"before")
    helpers = os.path.join(os.path.dirname(os.path.dirname(__file__)), "helpers")
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, tmp_path / name, str(most)],
        env={**os.environ, "PYTHONPATH": helpers},
        capture_output=True,
        text=True,
    )
    assert f"OSError: {tmp_path / name}: cannot be written: " in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"before"


def test_without_ffmpeg_the_sound_is_said_to_be_missing(tmp_path, monkeypatch):
    path = tmp_path / "clip.mp4"
    write_frames(path, FRAMES)
    before = path.read_bytes()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "ffmpeg, which would copy it, is not on the PATH" in add_sound(path, path)
    assert path.read_bytes() == before


@pytest.mark.skipif(sys.platform == "win32", reason="needs a script as a program")
@pytest.mark.parametrize("fails", [True, False])
def test_what_ffmpeg_is_asked_for_and_says(tmp_path, monkeypatch, fails):
    """It is replaced by a script that writes its arguments to a file."""
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"silent")
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    answer = "echo 'no such codec' >&2; exit 1" if fails else ""
    program.write_text(
        f"#!/bin/sh\necho \"$@\" > '{tmp_path}/asked'\n"
        f'for last; do true; done\necho half > "${{last#file:}}"\n{answer}\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    remark = add_sound(path, "a source.mp4")
    asked = (tmp_path / "asked").read_text()
    assert f"-i file:{path} -i file:{os.path.realpath('a source.mp4')} " in asked
    assert "-c copy" in asked
    assert sorted(each.name for each in tmp_path.iterdir()) == ["asked", "bin", "clip.mp4"]
    if fails:
        assert remark == "its sound is left out: ffmpeg cannot copy it (no such codec)"
        assert path.read_bytes() == b"silent"
    else:
        assert remark is None
        assert path.read_bytes() == b"half\n"


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not on the PATH")
def test_sound_is_copied_as_it_is_coded(tmp_path):
    silent, source = tmp_path / "silent.mp4", tmp_path / "source.mp4"
    write_frames(silent, FRAMES)
    tone = ("-f", "lavfi", "-i", "sine=duration=2")
    ffmpeg = ("ffmpeg", "-nostdin", "-v", "error")
    subprocess.run([*ffmpeg, "-i", silent, *tone, "-c:v", "copy", source], check=True)
    before = read_frames(silent)
    assert add_sound(silent, source) is None

    def sound(path):
        wanted = ("-map", "0:a", "-c", "copy", "-f", "md5", "-")
        return subprocess.run([*ffmpeg, "-i", path, *wanted], check=True, capture_output=True)

    assert sound(silent).stdout == sound(source).stdout
    np.testing.assert_array_equal(read_frames(silent), before)
