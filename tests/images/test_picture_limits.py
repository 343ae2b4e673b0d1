"""Pictures that are too large are refused by their header, before decoding."""

import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest
from memory import growth

import trisquare as ts
from trisquare.images.header import stated_size
from trisquare.images.limits import MAX_BYTES, MAX_PIXELS, PictureLimits, parse_amount
from trisquare.images.reading import read_image, read_photograph

PICTURE = np.dstack([np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)] * 3)
SUFFIXES = (".png", ".jpg", ".tif", ".webp", ".bmp", ".ppm", ".jp2", ".gif", ".avif")


def encoded(suffix):
    return cv2.imencode(suffix, PICTURE)[1].tobytes()


def png_bomb(width, height):
    """A small PNG of black pixels with the stated size."""

    def chunk(kind, content):
        checked = kind + content
        return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))

    packer = zlib.compressobj(9)
    row = bytes(1 + width // 8)
    pixels = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    head, end = chunk(b"IHDR", header), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", pixels) + end


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_header_says_the_size(suffix):
    assert stated_size(encoded(suffix)) == (64, 48)


def test_the_largest_that_a_header_holds_is_refused_by_the_limits(capfd):
    head = struct.pack(">4sIIBBBBB", b"IHDR", 2**31 - 1, 2**31 - 1, 8, 0, 0, 0, 0)
    with pytest.raises(ts.ImageError, match="2147483647 x 2147483647 pixels, more than"):
        ts.read_image(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + bytes(16))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_header_that_is_cut_or_damaged_says_nothing_or_a_size(suffix):
    whole = encoded(suffix)
    rng = np.random.default_rng(1)
    for end in range(0, min(len(whole), 200)):
        size = stated_size(whole[:end])
        # Numbers stored as text may lack digits.
        assert size is None or size == (64, 48) or (suffix == ".ppm" and size < (64, 48))
    for _ in range(300):
        damaged = bytearray(whole[:300])
        for place in rng.integers(0, len(damaged), 3):
            damaged[place] = rng.integers(256)
        size = stated_size(bytes(damaged))
        assert size is None or min(size) > 0


@pytest.mark.parametrize(
    "text", [b"", b"hello", b"\0" * 99, b"<svg width='9' height='9'/>", b" <svg"]
)
def test_what_is_no_picture_has_no_size(text):
    assert stated_size(text) is None


def test_a_first_picture_of_usual_files_loads_nothing_that_asks_servers():
    program = """
import sys
from trisquare.images.header import stated_size
assert all(stated_size(bytes.fromhex(each)) == (64, 48) for each in sys.argv[1:])
assert "urllib.request" not in sys.modules
"""
    usual = [encoded(suffix).hex() for suffix in (".png", ".jpg", ".tif")]
    subprocess.run([sys.executable, "-c", program, *usual], check=True)


def test_an_orientation_tag_does_not_turn_the_size(tmp_path):
    tag = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    plain = encoded(".jpg")
    turned = plain[:2] + b"\xff\xe1" + struct.pack(">H", len(tag) + 2) + tag + plain[2:]
    assert stated_size(turned) == (64, 48)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_more_pixels_than_allowed_are_refused(tmp_path, suffix):
    path = tmp_path / f"photo{suffix}"
    path.write_bytes(encoded(suffix))
    assert read_photograph(path, PictureLimits(64 * 48))[0].shape[:2] == (48, 64)
    with pytest.raises(ts.ImageError, match="64 x 48 pixels, more than the 3071 that max_pixels"):
        read_photograph(path, PictureLimits(64 * 48 - 1))


def test_a_size_of_a_thousand_digits_is_refused_in_a_line(tmp_path):
    many = 1000 * b"6"
    path = tmp_path / "a.pgm"
    path.write_bytes(b"P5\n%s %s\n255\n" % (many, many))
    with pytest.raises(ts.ImageError) as caught:
        read_image(path)
    assert len(str(caught.value)) < len(str(path)) + 100


def test_larger_files_than_allowed_are_not_read(tmp_path):
    path = tmp_path / "photo.png"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)  # which takes no disk space
    with pytest.raises(ts.ImageError, match="more than the 2147483647 that max_bytes allows"):
        read_image(path)


def test_the_environment_has_limits(tmp_path, monkeypatch):
    path = tmp_path / "photo.png"
    path.write_bytes(encoded(".png"))
    monkeypatch.setenv("TRISQUARE_MAX_PIXELS", "3k")
    with pytest.raises(ts.ImageError, match="max_pixels"):
        read_image(path)
    with pytest.raises(ts.ImageError, match="max_pixels"):
        ts.calibrate(path)
    with pytest.raises(ts.DetectionError):
        ts.calibrate(path, max_pixels=3072)
    monkeypatch.setenv("TRISQUARE_MAX_PIXELS", "")
    assert PictureLimits.stated() == PictureLimits()
    monkeypatch.setenv("TRISQUARE_MAX_PIXELS", "many")
    with pytest.raises(ValueError, match="TRISQUARE_MAX_PIXELS must be a positive number"):
        read_image(path)


@pytest.mark.parametrize(
    ("limit", "enough"), [("max_pixels", 3072), ("max_bytes", len(encoded(".png")))]
)
def test_calibrate_takes_limits(tmp_path, limit, enough):
    path = tmp_path / "photo.png"
    path.write_bytes(encoded(".png"))
    for source in (path, path.read_bytes()):
        with pytest.raises(ts.ImageError, match=f"{enough - 1} that {limit} allows"):
            ts.calibrate(source, **{limit: enough - 1})
        with pytest.raises(ts.DetectionError):
            ts.calibrate(source, **{limit: enough})
    for wrong, error in ((0, ValueError), (-1, ValueError), ("9", TypeError), (True, TypeError)):
        with pytest.raises(error, match=limit):
            ts.calibrate(path, **{limit: wrong})


@pytest.mark.parametrize(("option", "too_little"), [("max-pixels", "3k"), ("max-bytes", "30")])
def test_the_command_takes_limits(tmp_path, run, option, too_little):
    path = tmp_path / "photo.png"
    path.write_bytes(encoded(".png"))
    code, _, err = run("calibrate", path, f"--{option}", too_little)
    assert code == 5
    assert f"--{option} allows" in err
    code, _, err = run("calibrate", path, f"--{option}", "none")
    assert code == 2
    assert f"--{option}" in err


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's account of memory")
def test_a_small_file_that_unfolds_to_much_costs_nothing(tmp_path):
    """With the default limit, in a process of its own: the decoded picture is a gigabyte."""
    path = tmp_path / "bomb.png"
    path.write_bytes(png_bomb(32768, 32767))
    assert path.stat().st_size < 1 << 20
    assert MAX_PIXELS < 32768 * 32767
    kilobytes, said = growth("ts.calibrate(sys.argv[1])", path)
    assert "32768 x 32767 pixels" in said
    assert kilobytes < 100_000


@pytest.mark.parametrize(
    ("text", "amount"),
    [("7", 7.0), ("500M", 5e8), ("0.5G", 5e8), ("1e9", 1e9), ("12k", 12e3), (" 3 ", 3.0)],
)
def test_amounts(text, amount):
    assert parse_amount(text, "--max-pixels") == amount


@pytest.mark.parametrize("text", ["", "0", "-1", "many", "1T", "nan", "inf", "1e999", "1 000", "٣"])
def test_what_is_no_amount(text):
    with pytest.raises(ValueError, match="--max-pixels must be a positive number"):
        parse_amount(text, "--max-pixels")


def jpeg_of_many_scans(count):
    """A progressive JPEG with repeated scans, each of which is decoded over the whole picture."""
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    whole = cv2.imencode(".jpg", PICTURE, options)[1].tobytes()
    last = whole.rindex(b"\xff\xda")
    scans = whole.count(b"\xff\xda")
    return whole[:last] + whole[last:-2] * (count - scans + 1) + whole[-2:]


def test_a_jpeg_of_many_scans_is_refused(run, tmp_path, monkeypatch):
    path = tmp_path / "scans.jpg"
    path.write_bytes(jpeg_of_many_scans(3000))
    said = (
        f"{path}: the JPEG has more than the 100 scans that max_scans allows (TRISQUARE_MAX_SCANS)"
    )
    assert run("calibrate", path) == (5, "", f"trisquare: error: {said}\n")
    path.write_bytes(jpeg_of_many_scans(100))
    assert read_image(path).shape == PICTURE.shape
    monkeypatch.setenv("TRISQUARE_MAX_SCANS", "99")
    with pytest.raises(ts.ImageError, match="99 scans"):
        read_image(path)


def test_limits_may_be_numbers_of_numpy():
    limits = PictureLimits.stated(max_pixels=np.int64(10), max_bytes=np.float32(20))
    assert (limits.max_pixels, limits.max_bytes) == (10, 20)
    with pytest.raises(TypeError, match="max_pixels"):
        PictureLimits.stated(max_pixels=True)
