"""Formats of photographs: their content and orientation."""

import io
import struct
import zlib

import cv2
import numpy as np
import PIL.Image
import pytest

import trisquare as ts
from trisquare import simulate
from trisquare.errors import ImageError
from trisquare.images.encoding import encode_image
from trisquare.images.reading import read_image

GREY = cv2.GaussianBlur(
    np.random.default_rng(9).integers(0, 255, (60, 80), dtype=np.uint8), (0, 0), 2
)
COLOUR = np.dstack([GREY, 255 - GREY, GREY // 2])
BLACK_AND_WHITE = np.where(GREY > 127, 255, 0).astype(np.uint8)
SHORT, LONG = 3, 4
UNSIGNED, SIGNED, FLOATING = 1, 2, 3


def tiff(pixels, orientation=1, bits=None, sample_format=None, order="<", encoded=None, lighter=1):
    """A TIFF file of one strip with a given orientation tag, without compression."""
    height, width, channels = (*pixels.shape, 1)[:3]
    bits = bits or 8 * pixels.dtype.itemsize
    swapped = pixels if channels == 1 else pixels[:, :, ::-1]
    strip = encoded or swapped.astype(pixels.dtype.newbyteorder(order)).tobytes()
    kind = sample_format or (FLOATING if pixels.dtype.kind == "f" else UNSIGNED)
    tags = 11
    after = 8 + 2 + 12 * tags + 4
    listed = struct.pack(f"{order}{2 * channels}H", *[bits] * channels, *[kind] * channels)

    def shorts(tag, values, at):
        if len(values) < 3:
            return struct.pack(f"{order}HHIHH", tag, SHORT, len(values), *(*values, 0)[:2])
        return struct.pack(f"{order}HHII", tag, SHORT, len(values), at)

    def long(tag, value):
        return struct.pack(f"{order}HHII", tag, LONG, 1, value)

    directory = [
        long(256, width),
        long(257, height),
        shorts(258, [bits] * channels, after),
        shorts(259, [1], 0),
        shorts(262, [lighter if channels == 1 else 2], 0),
        long(273, after + len(listed)),
        shorts(274, [orientation], 0),
        shorts(277, [channels], 0),
        long(278, height),
        long(279, len(strip)),
        shorts(339, [kind] * channels, after + 2 * channels),
    ]
    start = {"<": b"II*\0", ">": b"MM\0*"}[order] + struct.pack(f"{order}I", 8)
    return b"".join([start, struct.pack(f"{order}H", tags), *directory, bytes(4), listed, strip])


def exif(orientation, order):
    entry = struct.pack(f"{order}HHIHH", 0x0112, SHORT, 1, orientation, 0)
    start = {"<": b"II*\0", ">": b"MM\0*"}[order]
    return start + struct.pack(f"{order}IH", 8, 1) + entry + bytes(4)


def jpeg_with_orientation(image, orientation, order=">"):
    encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    block = b"Exif\0\0" + exif(orientation, order)
    segment = b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block
    return encoded[:20] + segment + encoded[20:]  # after the JFIF segment


def png_chunk(kind, content):
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def png_with_orientation(image, orientation, order=">"):
    encoded = encode_image(image, "a.png")
    return encoded[:33] + png_chunk(b"eXIf", exif(orientation, order)) + encoded[33:]


def palette_png(indices, palette):
    height, width = indices.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    rows = b"".join(b"\0" + row.tobytes() for row in indices)
    chunks = [(b"IHDR", header), (b"PLTE", palette.tobytes()), (b"IDAT", zlib.compress(rows))]
    return b"\x89PNG\r\n\x1a\n" + b"".join(png_chunk(*c) for c in (*chunks, (b"IEND", b"")))


def read(tmp_path, encoded, name="photo"):
    path = tmp_path / name
    path.write_bytes(encoded)
    return read_image(path)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    "image",
    [GREY, COLOUR, GREY.astype(np.uint16) * 257, np.float32(GREY / 255), np.float32(COLOUR / 255)],
    ids=["grey", "colour", "16-bit", "float", "float-colour"],
)
@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_a_tiff_comes_as_it_is_stored(tmp_path, image, orientation, order):
    found = read(tmp_path, tiff(image, orientation, order=order))
    assert found.dtype == image.dtype
    np.testing.assert_array_equal(found, image)


def test_what_a_file_holds_is_read_like_the_file(tmp_path):
    content = cv2.imencode(".png", COLOUR)[1].tobytes()
    (tmp_path / "a.png").write_bytes(content)
    expected = ts.read_image(tmp_path / "a.png")
    for source in (content, io.BytesIO(content), PIL.Image.open(io.BytesIO(content))):
        np.testing.assert_array_equal(ts.read_image(source), expected)


def test_two_levels_and_palettes_become_grey_levels_and_colours(tmp_path):
    packed = np.packbits(GREY > 127, axis=1).tobytes()
    found = read(tmp_path, tiff(GREY, bits=1, encoded=packed))
    np.testing.assert_array_equal(found, BLACK_AND_WHITE)
    np.testing.assert_array_equal(read(tmp_path, tiff(GREY, lighter=0)), 255 - GREY)
    encoded = cv2.imencode(".png", BLACK_AND_WHITE, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes()
    np.testing.assert_array_equal(read(tmp_path, encoded), BLACK_AND_WHITE)
    palette = np.random.default_rng(3).integers(0, 256, (256, 3), dtype=np.uint8)
    np.testing.assert_array_equal(
        read(tmp_path, palette_png(GREY, palette)), palette[GREY][:, :, ::-1]
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_an_alpha_channel_is_dropped(tmp_path, dtype):
    colour = COLOUR.astype(dtype) * (257 if dtype == np.uint16 else 1)
    opaque = np.dstack([colour, np.full_like(colour[:, :, 0], np.iinfo(dtype).max)])
    np.testing.assert_array_equal(read(tmp_path, encode_image(opaque, "a.png")), colour)


@pytest.mark.parametrize(
    ("encoded", "reason"),
    [
        (tiff(GREY.astype(np.float64)), "float64"),
        (tiff(GREY.astype(np.int16), sample_format=SIGNED), "int16"),
        (tiff(np.full((60, 80), np.nan, np.float32)), "NaN"),
        (tiff(np.where(GREY > 127, np.float32(np.inf), np.float32(0))), "infinite"),
    ],
)
def test_other_pixels_are_refused_with_the_reason(tmp_path, encoded, reason):
    with pytest.raises(ImageError, match=f"photo: .*{reason}"):
        read(tmp_path, encoded)


@pytest.mark.parametrize("compression", [1, 5, 8, 32773], ids=["none", "lzw", "zip", "packbits"])
@pytest.mark.parametrize("image", [COLOUR, GREY.astype(np.uint16) * 257])
def test_a_truncated_tiff_is_noticed(tmp_path, compression, image):
    flag = [cv2.IMWRITE_TIFF_COMPRESSION, compression]
    written = cv2.imencode(".tif", image, flag)[1].tobytes()
    for whole in (written, tiff(image)):
        np.testing.assert_array_equal(read(tmp_path, whole), image)
        # The last four bytes state the position of a further picture.
        for length in {*range(0, len(whole) - 4, len(whole) // 9), len(whole) - 5}:
            with pytest.raises(ImageError, match="photo: "):
                read(tmp_path, whole[:length])


SCENE = simulate.random_scene(np.random.default_rng(41), image_size=(640, 480))
PHOTO = simulate.render(SCENE, np.random.default_rng(42), noise=2.0, tone="srgb")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("encode", [jpeg_with_orientation, png_with_orientation, tiff])
@pytest.mark.parametrize(("orientation", "turn"), [(3, "180 degrees"), (6, "clockwise by 90")])
def test_the_result_refers_to_the_picture_as_stored_and_says_so(
    tmp_path, encode, orientation, turn, order
):
    path = tmp_path / "turned.img"
    path.write_bytes(encode(PHOTO, orientation, order=order))
    result = ts.calibrate(path)
    assert result.camera.image_size == (640, 480)
    stored = ts.calibrate(read_image(path))
    assert result.camera.fx == stored.camera.fx
    assert abs(result.camera.cx - SCENE.camera.cx) < 5 * result.std["cx"]
    (remark,) = (text for text in result.warnings if "orientation" in text)
    assert "turned.img" in remark
    assert turn in remark
    assert "640 x 480" in remark
    assert not any("orientation" in text for text in stored.warnings)


def test_a_turned_picture_prints_nothing_else(run, tmp_path):
    for name, encode in (("a.png", png_with_orientation), ("a.tif", tiff)):
        (tmp_path / name).write_bytes(encode(PHOTO, 8))
        code, out, err = run("calibrate", tmp_path / name)
        assert (code, err.count("\n")) == (0, 1)
        assert "anticlockwise" in err
        assert "anticlockwise" not in out


@pytest.mark.parametrize("encode", [jpeg_with_orientation, png_with_orientation, tiff])
def test_an_upright_picture_needs_no_remark(tmp_path, encode):
    path = tmp_path / "upright.img"
    path.write_bytes(encode(PHOTO, 1))
    assert not any("orientation" in text for text in ts.calibrate(path).warnings)


def test_a_damaged_tag_is_no_tag(tmp_path):
    whole = jpeg_with_orientation(GREY, 6)
    place = whole.index(b"Exif\0\0") + 6
    for offset in range(len(exif(6, ">"))):
        damaged = bytearray(whole)
        damaged[place + offset] = 0xFF
        assert read(tmp_path, bytes(damaged)).shape == GREY.shape


def test_sixteen_bits_and_floats_say_what_eight_bits_say(tmp_path):
    words = simulate.render(SCENE, np.random.default_rng(42), noise=2.0, dtype=np.uint16)
    results = []
    for name, picture in [
        ("a.png", words),
        ("a.tif", words),
        ("b.tif", (words / 65535).astype(np.float32)),
    ]:
        path = tmp_path / name
        path.write_bytes(encode_image(picture, path))
        results.append(ts.calibrate(path, tone="linear"))
    for result in results:
        assert abs(result.camera.fx - SCENE.camera.fx) < 4 * result.std["fx"]
        assert result.camera.fx == pytest.approx(results[0].camera.fx, rel=1e-5)
