"""Formats of cameras and phones besides JPEG, and ways to pass pictures."""

import builtins
import io
import struct
import sys
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
from raw_files import LONG, SHORT, directory, dng
from scenes import assert_within

import trisquare as ts
from trisquare import simulate
from trisquare.cli.input_files import photographs_named
from trisquare.images.drawn_mark import encode_drawn
from trisquare.images.foreign import foreign_kind
from trisquare.images.reading import load_picture, read_image
from trisquare.images.sources import sources_of

SIZE = (640, 480)
SCENE = simulate.random_scene(np.random.default_rng(11), image_size=SIZE)
PHOTO = simulate.render(SCENE, np.random.default_rng(12))
COLOUR = np.dstack([PHOTO, 255 - PHOTO, PHOTO // 2])

VIDEOS = {
    "mp4": struct.pack(">I", 24) + b"ftypisom\0\0\2\0isomiso2",
    "mov": struct.pack(">I", 20) + b"ftypqt  \0\0\2\0qt  ",
    "avi": b"RIFF\x24\0\0\0AVI LIST",
    "mkv": b"\x1aE\xdf\xa3\x9fB\x86\x81\x01",
    "ts": (b"G" + bytes(187)) * 4,
}


def thumbnail_of_a_raw_file():
    """A TIFF that begins with a smaller version of a picture, as NEF and ARW do."""
    pixels = cv2.resize(PHOTO, (160, 120))
    entries = [
        *((254, LONG, [1]), (256, LONG, [160]), (257, LONG, [120]), (258, SHORT, [8])),
        *((259, SHORT, [1]), (262, SHORT, [1]), (273, LONG, [500]), (277, SHORT, [1])),
        *((278, LONG, [120]), (279, LONG, [pixels.size]), (330, LONG, [8])),
    ]
    start = b"II*\0" + struct.pack("<I", 8) + directory(entries)
    return start.ljust(500, b"\0") + pixels.tobytes()


@pytest.fixture
def without_extras(monkeypatch):
    real = builtins.__import__

    def imported(name, *rest):
        if name in ("pillow_heif", "rawpy"):
            raise ImportError(name)
        return real(name, *rest)

    for name in ("pillow_heif", "rawpy"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(builtins, "__import__", imported)


HEIC_START = struct.pack(">I", 24) + b"ftypheic\0\0\0\0mif1heic"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.heic", HEIC_START, "a HEIC picture, which needs pip install 'trisquare[heif]'"),
        ("a.dng", dng(np.zeros((4, 4), np.uint16)), "a raw picture, which needs pip install 'tri"),
        ("a.nef", thumbnail_of_a_raw_file(), "a raw picture"),
        ("a.raf", b"FUJIFILMCCD-RAW 0201", "a raw picture"),
        ("a.cr3", struct.pack(">I", 20) + b"ftypcrx \0\0\0\1crx ", "a raw picture"),
        *((f"a.{kind}", content, "a video, not a photograph") for kind, content in VIDEOS.items()),
    ],
)
def test_what_opencv_does_not_read_is_named(run, tmp_path, without_extras, name, content, said):
    path = tmp_path / name
    path.write_bytes(content)
    code, out, err = run("calibrate", path)
    assert (code, out, err.count("\n")) == (5, "", 1)
    assert f"{name}: {said}" in err
    assert ("ffmpeg -i" in err) == ("video" in said)


def test_pictures_that_opencv_reads_are_not_foreign():
    for suffix in (".jpg", ".png", ".tif", ".webp", ".bmp", ".avif", ".jp2"):
        encoded = cv2.imencode(suffix, PHOTO)[1].tobytes()
        assert foreign_kind(encoded, f"a{suffix}") is None
    assert foreign_kind(thumbnail_of_a_raw_file()) == "raw"
    assert foreign_kind(b"") is None
    assert foreign_kind(b"II*\0") is None


def test_a_heic_picture_is_read():
    pillow_heif = pytest.importorskip("pillow_heif")
    file = pillow_heif.from_bytes("RGB", SIZE, COLOUR[:, :, ::-1].tobytes())
    content = io.BytesIO()
    file.save(content, quality=-1)
    read = load_picture(content.getvalue())
    assert read.shape == COLOUR.shape
    assert np.abs(read.astype(int) - COLOUR).mean() < 3


@pytest.mark.parametrize("content", [HEIC_START, HEIC_START + bytes(500)])
def test_a_damaged_heic_picture_is_refused(content):
    pytest.importorskip("pillow_heif")
    with pytest.raises(ts.ImageError, match="not a readable HEIC picture"):
        load_picture(content)


def test_a_raw_picture_calibrates_as_the_sensor_recorded_it(tmp_path):
    """Its tag, which asks for a turn, is ignored; its values are linear."""
    pytest.importorskip("rawpy")
    path = tmp_path / "photo.dng"
    linear = simulate.render(SCENE, np.random.default_rng(3), tone="linear", noise=0.5)
    path.write_bytes(dng(linear.astype(np.uint16) * 200))
    result = ts.calibrate(path, tone="linear")
    assert result.camera.image_size == SIZE
    assert "turned anticlockwise by 90 degrees" in next(
        each for each in result.warnings if each.code == "orientation_ignored"
    )
    assert_within(result, SCENE, 5)


def test_a_damaged_raw_picture_is_refused():
    pytest.importorskip("rawpy")
    with pytest.raises(ts.ImageError, match="not a readable raw picture"):
        load_picture(dng(np.zeros((4, 4), np.uint16))[:270])


# Several pictures under one name.


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frames").mkdir()
    for name in ("b.png", "a.PNG"):
        (tmp_path / "frames" / name).write_bytes(cv2.imencode(".png", PHOTO)[1].tobytes())
    (tmp_path / "frames" / "notes.txt").write_text("not a picture")
    (tmp_path / "empty").mkdir()
    return tmp_path


@pytest.mark.parametrize("named", ["frames", "frames/*.[pP]*", "fram*/?.*[gG]"])
def test_folders_and_quoted_patterns_are_inputs(run, folder, named):
    code, _, err = run("calibrate", named, "--targets", "squares")
    assert code == 0
    assert "picture 1 (b.png) is the same picture as picture 0 (a.PNG)" in err
    result = ts.calibrate(named, targets="squares")
    assert {plane.image for plane in result.planes} == {0}
    (warning,) = (each for each in result.warnings if each.code == "repeated_picture")
    assert "(b.png)" in warning
    untold = [each for each in result.warnings if each.code == "no_tone_curve"]
    assert not any("picture 1" in each for each in untold)  # nothing was measured in it


@pytest.mark.parametrize("named", ["order", "order/*.png"])
def test_numbers_in_names_are_numbers(tmp_path, monkeypatch, named):
    monkeypatch.chdir(tmp_path)
    ordered = ["2.png", "10.png", "a01b3.png", "a1b3.png", "a1b9.png", "a1b20.png", "b.png"]
    Path("order").mkdir()
    for name in reversed(ordered):
        Path("order", name).touch()
    assert [Path(str(path)).name for path in sources_of(named)] == ordered


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_what_trisquare_has_drawn_on_is_no_picture_of_a_folder(tmp_path, suffix):
    photograph, overlay = tmp_path / "photo.png", tmp_path / f"overlay{suffix}"
    photograph.write_bytes(encoded())
    overlay.write_bytes(encode_drawn(PHOTO, overlay))
    assert sources_of(tmp_path) == sources_of(str(tmp_path / "*.*")) == [photograph]
    assert sources_of(overlay) == [overlay]
    assert read_image(overlay).shape == PHOTO.shape
    photograph.unlink()
    with pytest.raises(ts.ImageError, match="all its pictures were drawn on by trisquare"):
        sources_of(tmp_path)


def test_nor_of_a_pattern_that_the_shell_has_written_out(tmp_path):
    photograph, overlay = Path(tmp_path, "photo.png"), Path(tmp_path, "overlay.png")
    photograph.write_bytes(encoded())
    overlay.write_bytes(encode_drawn(PHOTO, overlay))
    assert photographs_named([overlay, photograph]) == [photograph]
    assert photographs_named([overlay]) == [overlay]


@pytest.mark.parametrize(
    ("named", "said"),
    [("empty", "empty: the folder contains no picture"), ("*.jpg", "*.jpg: no file matches")],
)
def test_folders_and_patterns_without_pictures_exit_5(run, folder, named, said):
    assert run("calibrate", named) == (5, "", f"trisquare: error: {said}\n")


def test_a_file_whose_name_looks_like_a_pattern_is_that_file(folder):
    Path("a[1].png").write_bytes(Path("frames/b.png").read_bytes())
    assert ts.calibrate("a[1].png", targets="squares").camera.image_size == SIZE


# Pictures without a file.


def encoded(suffix=".png", picture=PHOTO):
    return cv2.imencode(suffix, picture)[1].tobytes()


@pytest.mark.parametrize(
    "source",
    [
        encoded(),
        bytearray(encoded()),
        io.BytesIO(encoded()),
        PIL.Image.fromarray(PHOTO),
        [io.BytesIO(encoded())],
    ],
    ids=["bytes", "bytearray", "file", "Pillow", "list of a file"],
)
def test_pictures_may_be_handed_over_in_any_form(source):
    given = ts.calibrate(source, targets="squares")
    assert given.camera == ts.calibrate(PHOTO, targets="squares").camera


def test_alpha_is_dropped():
    with_alpha = np.dstack([COLOUR, np.full_like(PHOTO, 7)])
    np.testing.assert_array_equal(load_picture(with_alpha), COLOUR)
    with pytest.raises(ValueError, match=r"\(480, 640, 2\)"):
        load_picture(COLOUR[:, :, :2])


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "CMYK", "L", "LA", "1", "I;16", "F", "I"])
def test_images_of_pillow_have_the_pixels_that_they_show(mode):
    if mode in ("I;16", "I"):
        image = PIL.Image.fromarray(PHOTO.astype(np.uint16) * 256)
        image, expected = image.convert(mode), PHOTO.astype(np.uint16) * 256
    elif mode == "F":
        image, expected = PIL.Image.fromarray(PHOTO.astype(np.float32)), PHOTO.astype(np.float32)
    else:
        image = PIL.Image.fromarray(COLOUR[:, :, ::-1]).convert("RGB").convert(mode)
        grey = mode in ("L", "LA", "1")
        expected = np.asarray(image.convert("L" if grey else "RGB"))
        expected = expected if grey else expected[:, :, ::-1]
    read = load_picture(image)
    assert read.dtype == expected.dtype
    np.testing.assert_array_equal(read, expected)


def test_a_truncated_file_under_a_pillow_image_is_refused():
    image = PIL.Image.open(io.BytesIO(encoded(".jpg")[:-4000]))
    with pytest.raises(ts.ImageError, match="truncated"):
        load_picture(image)


@pytest.mark.parametrize("source", [None, 3, {"a": 1}.get, object()])
def test_what_is_no_picture_is_named(source):
    with pytest.raises(TypeError, match="a picture must be a path, an array, bytes"):
        ts.calibrate(source)


@pytest.mark.parametrize("bad", [b"hello", np.zeros((4, 4)), np.zeros((0, 9), np.uint8)])
def test_of_several_pictures_the_bad_one_is_numbered(bad):
    good = np.zeros((64, 64), np.uint8)
    with pytest.raises((ts.ImageError, TypeError, ValueError), match=r"^picture 1: "):
        ts.calibrate([good, bad, good])


def test_bytes_that_are_no_picture_are_named():
    for content in (b"", b"hello", encoded()[:-40]):
        with pytest.raises(ts.ImageError, match=r"^(picture 0: )?the encoded picture: "):
            ts.calibrate(content)
