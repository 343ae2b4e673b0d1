"""Photographs are read whole or refused; files are written whole or not at all."""

import os
import signal
import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest

from trisquare._support.writing import check_writable, write_atomically
from trisquare.errors import ImageError
from trisquare.images.encoding import encode_image
from trisquare.images.reading import read_image

RNG = np.random.default_rng(8)
GREY = cv2.GaussianBlur(RNG.integers(0, 255, (60, 80), dtype=np.uint8), (0, 0), 2)
COLOUR = np.dstack([GREY, 255 - GREY, GREY // 2])


def png_with_text(image):
    """A PNG with a metadata chunk; there is no IEND before the end of the chunk."""
    encoded = encode_image(image, "a.png")
    chunk = b"tEXtcomment\0IEND"
    body = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return encoded[:33] + body + encoded[33:]


def jpeg_with_thumbnail(image):
    """A JPEG with a complete smaller JPEG, end mark included, in its header, as cameras write."""
    encoded = encode_image(image, "a.jpg")
    thumbnail = encode_image(image[::4, ::4], "a.jpg")
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    return encoded[:2] + segment + encoded[2:]


@pytest.mark.parametrize("image", [GREY, COLOUR, GREY.astype(np.uint16) * 257])
def test_lossless_pictures_come_as_they_are(tmp_path, image):
    path = tmp_path / "photo.png"
    path.write_bytes(encode_image(image, path))
    read = read_image(path)
    assert read.dtype == image.dtype
    np.testing.assert_array_equal(read, image)
    np.testing.assert_array_equal(read_image(str(path)), image)


def test_an_orientation_tag_is_ignored(tmp_path):
    tiff = b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 0x0112, 3, 1, 6, 0, 0)
    segment = b"\xff\xe1" + struct.pack(">H", len(tiff) + 8) + b"Exif\0\0" + tiff
    plain = encode_image(GREY, "a.jpg")
    path = tmp_path / "turned.jpg"
    path.write_bytes(plain[:2] + segment + plain[2:])
    assert cv2.imread(str(path), cv2.IMREAD_GRAYSCALE).shape == (80, 60)
    assert read_image(path).shape == (60, 80)


@pytest.mark.parametrize(
    "encoded",
    [
        encode_image(COLOUR, "a.png"),
        png_with_text(GREY),
        encode_image(COLOUR, "a.jpg"),
        jpeg_with_thumbnail(COLOUR),
        cv2.imencode(".jpg", COLOUR, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes(),
        cv2.imencode(".jpg", COLOUR, [cv2.IMWRITE_JPEG_RST_INTERVAL, 2])[1].tobytes(),
    ],
    ids=["png", "png-text", "jpeg", "jpeg-thumbnail", "jpeg-progressive", "jpeg-restarts"],
)
def test_truncation_anywhere_is_noticed(tmp_path, encoded):
    path = tmp_path / "photo"
    path.write_bytes(encoded)
    assert read_image(path).shape[:2] == GREY.shape
    path.write_bytes(encoded + b"appended by the camera")
    assert read_image(path).shape[:2] == GREY.shape
    for length in {*range(0, len(encoded), 37), len(encoded) - 1}:
        path.write_bytes(encoded[:length])
        with pytest.raises(ImageError, match="photo: "):
            read_image(path)


def test_a_damaged_png_is_noticed(tmp_path):
    encoded = bytearray(encode_image(GREY, "a.png"))
    encoded[len(encoded) // 2] ^= 1
    (tmp_path / "photo.png").write_bytes(encoded)
    with pytest.raises(ImageError, match="checksum"):
        read_image(tmp_path / "photo.png")


@pytest.mark.parametrize(
    "content", [None, b"", b"no picture", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"]
)
def test_what_is_no_picture_is_an_image_error(tmp_path, content):
    path = tmp_path / "photo.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ImageError, match=r"photo\.png: "):
        read_image(path)
    with pytest.raises(ImageError, match=r"directory"):
        read_image(tmp_path)


def test_writing_replaces_whole_files_and_keeps_their_mode(tmp_path):
    old, new, link = tmp_path / "old", tmp_path / "new", tmp_path / "link"
    old.write_bytes(b"before")
    old.chmod(0o640)
    link.symlink_to(old)
    write_atomically({link: b"after", new: b"fresh"})
    assert (old.read_bytes(), new.read_bytes()) == (b"after", b"fresh")
    assert link.is_symlink()
    assert old.stat().st_mode & 0o777 == 0o640
    umask = os.umask(0)
    os.umask(umask)
    assert new.stat().st_mode & 0o777 == 0o666 & ~umask
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "new", "old"]


def test_one_impossible_file_leaves_all_untouched(tmp_path):
    old = tmp_path / "old"
    old.write_bytes(b"before")
    with pytest.raises(OSError, match="no folder"):
        write_atomically({old: b"after", tmp_path / "missing" / "file": b"x"})
    assert old.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_a_failing_disk_leaves_all_untouched(tmp_path, monkeypatch):
    old = tmp_path / "old"
    old.write_bytes(b"before")

    def fail(_):
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write_atomically({old: b"after"})
    assert old.read_bytes() == b"before"
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


def test_what_is_no_place_for_a_file_is_known_beforehand(tmp_path):
    check_writable(tmp_path / "file")
    assert not list(tmp_path.iterdir())
    with pytest.raises(OSError, match="not a file"):
        check_writable(tmp_path)
    with pytest.raises(OSError, match="not a file"):
        check_writable(os.devnull)
    with pytest.raises(FileNotFoundError):
        check_writable(tmp_path / "missing" / "file")


TERMINATED = """
import sys, time
from trisquare._support.writing import making_folder, write_in_turn

def content(path):
    path.write_bytes(b"half")
    print("begun", flush=True)
    time.sleep(60)

with making_folder("made"):
    write_in_turn([("old", b"after"), ("made/new.mp4", content)])
"""


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("times", [1, 2])
def test_a_program_that_is_terminated_leaves_nothing_half_written(tmp_path, times):
    (tmp_path / "old").write_bytes(b"before")
    with subprocess.Popen(
        [sys.executable, "-c", TERMINATED], cwd=tmp_path, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"begun\n"
        for _ in range(times):
            process.terminate()
        assert process.wait() == -signal.SIGTERM
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert (tmp_path / "old").read_bytes() == b"before"
