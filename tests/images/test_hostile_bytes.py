"""A picture's content is refused in the same way as a path, as bytes and as an open file."""

import io
import struct
import tempfile

import cv2
import numpy as np
import PIL.Image
import pytest
from raw_files import dng

import trisquare as ts

PICTURE = np.dstack([np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)] * 3)
PNG, JPEG, TIFF = (
    cv2.imencode(suffix, PICTURE)[1].tobytes() for suffix in (".png", ".jpg", ".tif")
)
PROGRESSIVE = cv2.imencode(".jpg", PICTURE, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
LAST_SCAN = PROGRESSIVE.rindex(b"\xff\xda")
RANDOM = np.random.default_rng(1).bytes(3000)

CONTENTS = {
    "empty": b"",
    "text": b"hello",
    "random": RANDOM,
    "a cut PNG": PNG[: len(PNG) // 2],
    "a PNG with a wrong checksum": PNG[:60] + b"\0" + PNG[61:],
    "a PNG of too many pixels": PNG[:16] + struct.pack(">II", 32768, 32767) + PNG[24:],
    "a cut JPEG": JPEG[:-20],
    "a JPEG of many scans": PROGRESSIVE[:-2] + PROGRESSIVE[LAST_SCAN:-2] * 200 + PROGRESSIVE[-2:],
    "a cut TIFF": TIFF[:100],
    "a TIFF of 64-bit floats": cv2.imencode(".tif", PICTURE.astype(np.float64))[1].tobytes(),
    "NaN": cv2.imencode(".tif", np.full((9, 9), np.nan, np.float32))[1].tobytes(),
    "a video": struct.pack(">I", 24) + b"ftypisom\0\0\2\0isomiso2" + RANDOM,
    "a damaged HEIC": struct.pack(">I", 24) + b"ftypheic\0\0\0\0mif1heic" + RANDOM,
    "a damaged raw picture": dng(np.zeros((4, 4), np.uint16))[:270],
}

FORMS = {
    "bytes": bytes,
    "bytearray": bytearray,
    "memoryview": memoryview,
    "an open file": io.BytesIO,
    "a list of a file": lambda content: [io.BytesIO(content)],
    "a list of bytes": lambda content: [content],
}


@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS)
def test_what_is_refused_as_a_path_is_refused_alike_as_bytes(tmp_path, content):
    path = tmp_path / "photo"
    path.write_bytes(content)
    with pytest.raises(ts.ImageError) as refused:
        ts.calibrate(path)
    _, _, reason = str(refused.value).partition(f"{path}: ")
    assert reason
    for form in FORMS.values():
        with pytest.raises(ts.ImageError) as error:
            ts.calibrate(form(content))
        assert type(error.value) is type(refused.value)
        assert str(error.value).endswith(f"the encoded picture: {reason}")


@pytest.mark.parametrize("function", [ts.calibrate, ts.detect])
def test_every_function_that_takes_pictures_refuses_them(function):
    for form in (bytes, io.BytesIO):
        with pytest.raises(ts.ImageError, match="the PNG is truncated"):
            function(form(CONTENTS["a cut PNG"]))


def test_the_limit_of_bytes_is_that_of_any_form(tmp_path, monkeypatch):
    path = tmp_path / "photo.png"
    path.write_bytes(PNG)
    monkeypatch.setenv("TRISQUARE_MAX_BYTES", str(len(PNG) - 1))
    for source in (path, PNG, io.BytesIO(PNG)):
        with pytest.raises(ts.ImageError, match=f"has {len(PNG)} bytes, more than the"):
            ts.calibrate(source)
    monkeypatch.setenv("TRISQUARE_MAX_BYTES", str(len(PNG)))
    with pytest.raises(ts.DetectionError):
        ts.calibrate(PNG)


def test_a_file_that_is_open_as_text_is_no_picture(tmp_path):
    """Otherwise its text would be taken for the name of a file."""
    path = tmp_path / "photo.png"
    path.write_bytes(PNG)
    with path.open(encoding="utf-8") as file, pytest.raises(TypeError, match="open as binary"):
        ts.calibrate(file)
    for source in (io.StringIO(str(path)), [io.StringIO(str(path))]):
        with pytest.raises(TypeError, match="must be open as binary"):
            ts.calibrate(source)


def test_a_file_that_cannot_be_read_is_an_image_error(tmp_path):
    class Broken(io.RawIOBase):
        def read(self, size=-1):
            raise OSError(5, "Input/output error")

    with pytest.raises(ts.ImageError, match="the open file: Input/output error"):
        ts.calibrate(Broken())
    with tempfile.SpooledTemporaryFile() as file:
        file.write(PNG)
        with pytest.raises(ts.ImageError, match="the file is empty"):  # because it is at its end
            ts.calibrate(file)


@pytest.mark.parametrize("name", ["a cut JPEG", "a PNG with a wrong checksum", "a cut PNG"])
def test_damage_under_a_pillow_image_is_an_image_error(name):
    image = PIL.Image.open(io.BytesIO(CONTENTS[name]))
    with pytest.raises(ts.ImageError, match="the Pillow image: "):
        ts.calibrate(image)


def test_pillow_images_have_the_limit_of_pixels():
    image = PIL.Image.open(io.BytesIO(PNG))
    with pytest.raises(ts.ImageError, match="the Pillow image: has 64 x 48 pixels"):
        ts.calibrate(image, max_pixels=64 * 48 - 1)
