"""Orientation of pictures in formats other than JPEG, PNG and TIFF."""

import io
import struct

import cv2
import numpy as np
import PIL.features
import PIL.Image
import PIL.ImageOps
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trisquare as ts
from trisquare import simulate
from trisquare.images.orientation import TURNS, OrientationTag, find_orientation
from trisquare.images.reading import load_photograph

SIZE = (640, 480)
SCENE = simulate.random_scene(np.random.default_rng(11), image_size=SIZE)
PHOTO = simulate.render(SCENE, np.random.default_rng(12))
COLOUR = np.dstack([PHOTO, 255 - PHOTO, PHOTO // 2])[:, :, ::-1]


def exif(orientation):
    block = PIL.Image.Exif()
    block[0x0112] = orientation
    return block.tobytes()


def pillow_encoded(kind, orientation, **options):
    stream = io.BytesIO()
    PIL.Image.fromarray(COLOUR).save(stream, kind, exif=exif(orientation), **options)
    return stream.getvalue()


def heic(orientation):
    pillow_heif = pytest.importorskip("pillow_heif")
    stream = io.BytesIO()
    pillow_heif.encode("RGB", SIZE, COLOUR.tobytes(), stream, exif=exif(orientation))
    return stream.getvalue()


def avif(orientation):
    if not PIL.features.check("avif"):
        pytest.skip("this Pillow writes no AVIF")
    return pillow_encoded("AVIF", orientation)


def webp(orientation):
    return pillow_encoded("WebP", orientation, lossless=True)


def webp_as_jpeg(orientation):
    """The older form by Pillow and others: the block begins as in a JPEG."""
    plain = webp(orientation)
    place = plain.index(b"EXIF")
    block = plain[place + 8 :]
    if not block.startswith(b"Exif"):
        block = b"Exif\0\0" + block
    chunks = plain[8:place] + b"EXIF" + struct.pack("<I", len(block)) + block
    return b"RIFF" + struct.pack("<I", len(chunks)) + chunks


@pytest.mark.parametrize("encoded", [heic, avif, webp, webp_as_jpeg])
def test_pictures_come_as_they_are_stored(encoded):
    upright, tag = load_photograph(encoded(1))
    assert (upright.shape, tag) == (COLOUR.shape, None)
    for orientation in TURNS:
        picture, tag = load_photograph(encoded(orientation))
        assert tag == OrientationTag(orientation)
        np.testing.assert_array_equal(picture, upright)


@pytest.mark.parametrize("encoded", [heic, avif, webp])
def test_the_result_refers_to_the_picture_as_stored_and_says_so(tmp_path, encoded):
    path = tmp_path / "photo"
    path.write_bytes(encoded(6))
    result = ts.calibrate(path)
    assert result.camera.image_size == SIZE
    (warning,) = (each for each in result.warnings if each.code == "orientation_ignored")
    assert "turned clockwise by 90 degrees" in warning
    assert "640 x 480" in warning


def test_a_pillow_image_has_the_tag_of_its_file():
    stream = io.BytesIO(pillow_encoded("JPEG", 6))
    for opened, expected in (
        (PIL.Image.open(stream), OrientationTag(6)),
        (PIL.ImageOps.exif_transpose(PIL.Image.open(stream)), None),
        (PIL.Image.fromarray(COLOUR), None),
    ):
        assert load_photograph(opened)[1] == expected


def test_undistort_keeps_the_orientation(run, tmp_path):
    (tmp_path / "photo.heic").write_bytes(heic(6))
    ts.calibrate(tmp_path / "photo.heic").save(tmp_path / "camera.json")
    paths = tmp_path / "photo.heic", "--camera", tmp_path / "camera.json"
    assert run("undistort", *paths, "-o", tmp_path / "out.jpg")[::2] == (0, "")
    assert find_orientation((tmp_path / "out.jpg").read_bytes()) == OrientationTag(6)
    assert cv2.imread(str(tmp_path / "out.jpg")).shape[:2] == SIZE


# The boxes of HEIC and AVIF.


def box(kind, content, *, is_long=False):
    if is_long:
        return struct.pack(">I4sQ", 1, kind, 16 + len(content)) + content
    return struct.pack(">I4s", 8 + len(content), kind) + content


def container(turns, *, version=0, is_wide=False, is_long=False, of_none=False):
    """A file without pixels whose second item, the primary one, is turned by the given boxes."""
    item, index = "I" if version else "H", "H" if is_wide else "B"
    essential = 0x8000 if is_wide else 0x80
    turned = [0] * of_none + [essential | (at + 2) for at in range(len(turns))]
    associations = b"".join(
        struct.pack(f">{item}B{len(each)}{index}", name, len(each), *each)
        for name, each in ((1, [1, essential | 2]), (2, [1, *turned]))
    )
    properties = [box(b"ispe", bytes(12)), *(box(kind, bytes([value])) for kind, value in turns)]
    listed = struct.pack(">BBBBI", version, 0, 0, is_wide, 2) + associations
    meta = [
        box(b"pitm", struct.pack(f">I{item}", version << 24, 2)),
        box(b"iprp", box(b"ipco", b"".join(properties)) + box(b"ipma", listed)),
    ]
    start = box(b"ftyp", b"heic\0\0\0\0mif1")
    return start + box(b"meta", bytes(4) + b"".join(meta), is_long=is_long)


@pytest.mark.parametrize(
    "form", [{}, {"version": 1}, {"is_wide": True}, {"is_long": True}], ids=lambda form: str(form)
)
@pytest.mark.parametrize(
    ("turns", "orientation"),
    [
        ([], 1),
        ([(b"irot", 1)], 8),
        ([(b"irot", 2)], 3),
        ([(b"irot", 3)], 6),
        ([(b"imir", 0)], 4),
        ([(b"imir", 1)], 2),
        ([(b"irot", 1), (b"imir", 1)], 7),
        ([(b"imir", 1), (b"irot", 1)], 5),
    ],
)
def test_boxes_turn_in_their_order(turns, orientation, form):
    assert find_orientation(container(turns, **form)) == OrientationTag.of(orientation)


def test_an_association_with_no_property_turns_nothing():
    turned = container([(b"irot", 1)], of_none=True)
    assert find_orientation(turned) == OrientationTag(8)


BOXES = container([(b"irot", 3), (b"imir", 1)])


@given(st.integers(0, len(BOXES)), st.binary(min_size=1, max_size=8), st.integers(0, len(BOXES)))
def test_damaged_boxes_are_harmless(at, inserted, cut):
    damaged = BOXES[:at] + inserted + BOXES[at + len(inserted) :]
    for each in (damaged, damaged[:cut]):
        tag = find_orientation(BOXES[:8] + each[8:])
        assert tag is None or tag.value in TURNS
