"""Camera files that are damaged, hostile or of another kind: refused, with a reason, at once."""

import contextlib
import json
import os
import pickle
import re

import numpy as np
import pytest
from camera_files import FILES, PANORAMA
from command_errors import error_text
from hypothesis import given, settings
from hypothesis import strategies as st

import trisquare as ts
from trisquare import Camera
from trisquare.formats import FORMAT_NAMES
from trisquare.formats.yaml_text import parse_yaml

FISHEYE = "equidistant"
K = np.array([[1000.5, 0.0, 640.25], [0.0, 1001.5, 480.75], [0.0, 0.0, 1.0]])
CAMERA = Camera(K, [-0.1, 0.02, 0.001, -0.002, 0.0], (1280, 960), "brown")
SIMPLE = Camera(
    [[1000.5, 0, 640.25], [0, 1000.5, 480.75], [0, 0, 1]], [-0.1, 0, 0, 0, 0], (1280, 960)
)


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    """The camera in every format, as text."""
    folder = tmp_path_factory.mktemp("whole")
    for name, known in FILES.items():
        (SIMPLE if known in PANORAMA else CAMERA).save(folder / name, known)
    return {name: (folder / name).read_text() for name in FILES}


def size_for(path):
    """The size of a file's pictures that the caller must state, if the file does not."""
    return SIMPLE.image_size if path.name == "lensfun.xml" else None


def refusal(path, **options):
    """Return the error message about a file, which must begin with its name."""
    with pytest.raises(ValueError, match=re.escape(f"{path}: ")) as info:
        Camera.load(path, **{"image_size": size_for(path), **options})
    return str(info.value)


def load_text(folder, name, text, **options):
    path = folder / name
    path.write_text(text, "utf-8")
    return refusal(path, **options)


# A missing key, or one of the wrong type.
@pytest.mark.parametrize(
    ("name", "written", "instead", "said"),
    [
        ("camera.json", '"fx": 1000.5, ', "", '"camera.fx" is missing'),
        ("camera.json", '"fx": 1000.5', '"fx": "wide"', '"camera.fx" must contain real numbers'),
        ("camera.json", '"fx": 1000.5', '"fx": NaN', "NaN, which is not JSON"),
        ("camera.json", '"fx": 1000.5', '"fx": 1e999', '"camera.fx" contains NaN or infinite'),
        ("camera.json", "trisquare-camera/1", "trisquare-camera/2", "newer than this trisquare"),
        ("camera.json", "trisquare-camera/1", "trisquare/17", "newer than this trisquare"),
        ("camera.json", "trisquare-camera/1", "trisquare-plan/1", '"format" must be'),
        ("camera.json", '"format"', '"kind"', "missing: the JSON of trisquare, of OpenCV and of"),
        ("camera.json", "[1280, 960]", "[1280.5, 960]", '"image_size" must be a list of whole'),
        ("camera.json", '"brown"', '"green"', "unknown model 'green': choose one of none"),
        ("camera.yaml", "rows: 3", "rows: 4", '"camera_matrix.data" has 9 numbers, not 4 x 3'),
        ("camera.yaml", "1000.5", ".nan", '"camera_matrix.data" contains NaN'),
        ("camera.yaml", "1000.5", "wide", '"camera_matrix.data" must contain real numbers'),
        ("camera.yaml", "1000.5", "-1000.5", "positive fx"),
        ("camera.yaml", "image_height: 960", "", '"image_height" is missing'),
        ("camera.yaml", "distortion_coefficients:", "d:", '"distortion_coefficients" is missing'),
        ("camera.yaml", "camera_matrix: !!opencv-matrix", "camera_matrix:", ""),
        ("camera.xml", "1000.5", "nan", '"camera_matrix.data" contains NaN'),
        ("camera.xml", "<rows>3</rows>", "", '"camera_matrix.rows" is missing'),
        ("camera.xml", "<image_width>1280", "<image_width>wide", '"image_width" must be a whole'),
        ("camera.xml", "</camera_matrix>", "", "not XML"),
        ("opencv.json", '"cols": 3', '"cols": true', '"camera_matrix.cols" must be a whole'),
        (
            "camera_info.yaml",
            "plumb_bob",
            "plum_bob",
            '"distortion_model" must be one of plumb_bob',
        ),
        ("camera_info.yaml", "plumb_bob", "rational_polynomial", ""),
        ("camera_info.yaml", "plumb_bob", "equidistant", '"distortion_coefficients.data" has 5'),
        ("camera_info.yaml", "image_width: 1280", "", '"image_width" is missing'),
        ("camera_info.yaml", "image_width: 1280", "image_width: 0", "image_size must be positive"),
        ("camera_info.yaml", "1000.5", "~", '"camera_matrix.data" must contain real numbers'),
        ("camchain.yaml", "radtan", "fov", "'fov': only radtan"),
        ("camchain.yaml", "pinhole", "omni", "'omni': only pinhole"),
        ("camchain.yaml", "1000.5, ", "", '"cam0.intrinsics" must have shape (4)'),
        ("camchain.yaml", "[1280, 960]", "[1280]", '"resolution" must be [width, height]'),
        ("left.cameramodel", "1280, 960", "1280", '"imagersize" must be [width, height]'),
        ("cameras.txt", "1000.5", "nan", "camera 1: PARAMS[0] must be a finite number"),
        ("cameras.txt", " 1000.5", "", "camera 1: OPENCV has 8 parameters, not 7"),
        ("cameras.txt", " 1280 ", " 12.5 ", "camera 1: WIDTH must be a whole number"),
        ("cameras.txt", " 1280 ", " -1280 ", "camera 1: WIDTH must be a whole number"),
        ("cameras.txt", "OPENCV", "CLOSEDCV", "the model 'CLOSEDCV' cannot be read"),
        ("cameras.txt", "\n1 OPENCV", "\nhello OPENCV", "no line is a camera of COLMAP's"),
        ("transforms.json", '"fl_x": 1000.5', '"fl_x": null', '"fl_x"'),
        ("transforms.json", '"w": 1280', '"w": 1280.5', '"w" and "h" must be whole numbers'),
        ("transforms.json", '"OPENCV"', '"EQUIRECTANGULAR"', "'EQUIRECTANGULAR'; of nerfstudio"),
        ("lens.pto", " f0 v", " f3 v", '"f" of image 0 is 3: only f0'),
        ("lens.pto", "i w1280", "i w1280.5", '"w" and "h" of image 0 must be whole'),
        ("lens.pto", "i w1280 ", "i ", '"w" of image 0 is missing'),
        ("lens.pto", " f0 v", " f0 v=3 u", '"v" of image 0 is linked to'),
        ("lens.pto", " f0 v", " f0 vx", '"v" of image 0 must be a number'),
        ("lens.pto", " f0 v", " f0 v3", '"v" of image 0 must be from 0 to 180'),
        ("lens.pto", " a0.0", " anan", '"a" of image 0 must be a number'),
        ("lens.pto", ' n"photo.jpg"', "", ""),
        ("lens.pto", " a0.0", " a1.5", "a, b and c add up to"),
        ("lens.pto", " g0", " g0.5", "shear the picture"),
        ("lensfun.xml", "rectilinear", "fisheye", '"type" is not rectilinear'),
        ("lensfun.xml", "poly5", "acm", "'acm'; of lensfun's these are read"),
        ("lensfun.xml", ' focal="', ' local="', '"focal" is missing'),
        ("lensfun.xml", ' k1="', ' k1="x', '"k1" must be a finite number'),
        ("lensfun.xml", "<cropfactor>1.0", "<cropfactor>0", '"cropfactor" and "focal" must be'),
        ("lensfun.xml", "<cropfactor>1.0", "<cropfactor>1e200", "numbers that are too large"),
        ("lensfun.xml", "1279:959", "1279:0", '"aspect-ratio" must be written 3:2'),
        ("lensfun.xml", "<distortion", "<contortion", "no <lens> with a <distortion>"),
        ("metashape.xml", "frame", "spherical", "'spherical'; of Metashape's these are read"),
        ("metashape.xml", "<width>1280", "<width>1280.5", '"width" and "height" must be whole'),
        ("metashape.xml", "<width>1280", "<width>0", "image_size must be positive"),
        ("metashape.xml", "<f>1001.5</f>", "", '"f" is missing'),
        ("metashape.xml", "<f>1001.5</f>", "<fx>9</fx>", "PhotoScan before 1.2"),
        ("metashape.xml", "<f>1001.5", "<f>-1001.25", "positive fx"),
        ("metashape.xml", "<f>1001.5", "<f>1e999", '"f" must be a finite number'),
        ("metashape.xml", "<k1>", "<k1>x", '"k1" must be a finite number'),
        ("metashape.xml", "<k4>0.0", "<k4>0.1</k4><p4>0.2</p4><k4>", '"p4" is 0.2; of a frame'),
        ("metashape.xml", "frame", "fisheye", '"p1" is -0.002; of a fisheye it must be 0'),
        ("metashape.xml", "<b2>0.0", "<b2>0.5</b2><b2>", ""),
        ("metashape.xml", "<calibration>", "<calibrations>", "not XML"),
        ("left.cameramodel", "1000.5, ", "", '"intrinsics" must have shape (8)'),
        ("left.cameramodel", "1000.5", "nan", "not a dictionary of names and numbers"),
        ("left.cameramodel", "OPENCV4", "SPLINED_STEREOGRAPHIC_order=3", "these can be read"),
        ("left.cameramodel", "'imagersize'", "'imagesize'", '"imagersize" is missing'),
    ],
)
def test_the_message_names_what_is_wrong(tmp_path, texts, name, written, instead, said):
    assert written in texts[name]
    text = texts[name].replace(written, instead, 1)
    if said:
        assert said in load_text(tmp_path, name, text, format=FILES[name])
    else:  # not required, or harmless
        (tmp_path / name).write_text(text)
        camera = Camera.load(tmp_path / name, image_size=size_for(tmp_path / name))
        assert camera.fx == pytest.approx(1000.5, rel=1e-15)


@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file_is_refused_or_whole(tmp_path, texts, name):
    """Text formats have no end mark: a cut file may be complete, but must not give other values."""
    text, path = texts[name], tmp_path / name
    for length in range(0, len(text), 7):
        path.write_text(text[:length])
        try:
            camera = Camera.load(path, image_size=size_for(path))
        except ValueError:
            continue
        assert camera.image_size[0] == 1280
        if FILES[name] not in PANORAMA:  # whose numbers may be cut
            assert (camera.fx, camera.fy) == (1000.5, 1001.5)


PIECES = (
    *("", "-", "1e309", "nan", "[", "{", "}", "]", "'", '"', ":", "*a", "&a ", "!!int ", "~", "#"),
    *("\n", "  ", "0", "9" * 40, "<", "]]>", "&lt;", "2026-99-99", ",", "? ", "!!opencv-matrix "),
)


@pytest.mark.slow
@settings(max_examples=200)
@given(data=st.data())
def test_garbled_files_are_a_camera_or_a_value_error(tmp_path_factory, texts, data):
    name = data.draw(st.sampled_from(sorted(FILES)))
    text = texts[name]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 12)))
        piece = data.draw(st.sampled_from(PIECES) | st.text(max_size=5))
        text = text[:start] + piece + text[end:]
    path = tmp_path_factory.mktemp("garbled", numbered=True) / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with contextlib.suppress(ValueError):
        known = data.draw(st.sampled_from([None, FILES[name]]))
        camera = Camera.load(path, format=known, image_size=size_for(path))
        assert np.isfinite(camera.K).all()


DEEP = 20_000
BOMBS = {
    "nested.json": '{"format": "trisquare-camera/1", "camera": ' + "[" * DEEP,
    "nested.yaml": "camera_matrix:\ndistortion_model: " + "[" * DEEP,
    "dashes.yaml": "camera_matrix:\ndistortion_model: \n" + "- " * DEEP,
    "maps.yaml": "camera_matrix:\ndistortion_model: " + "{a: " * DEEP,
    "nested.xml": "<opencv_storage>" + "<a>" * DEEP,
    "nested.cameramodel": "{'lensmodel': " + "(" * DEEP,
    "commas.cameramodel": "{'lensmodel': " + ", " * DEEP,
    "alias.yaml": "camera_matrix: &a [1]\ndistortion_model: &b [*a, *a]\nc: [*b, *b]\n",
    "entities.xml": '<?xml version="1.0"?><!DOCTYPE o [<!ENTITY a "aa">]>'
    "<opencv_storage><image_width>&a;</image_width></opencv_storage>",
    "entities-lensfun.xml": '<!DOCTYPE o [<!ENTITY a "aa">]><lensdatabase>&a;</lensdatabase>',
    "comments.xml": "<opencv_storage>" + "<!--" * DEEP,
    "object.yaml": "camera_matrix: !!python/object/apply:os.system ['true']\ndistortion_model: a\n",
    "no-integer.yaml": "camera_matrix: !!int\ndistortion_model: !!timestamp 2026-99-99\n",
    "digits.json": '{"format": "trisquare-camera/1", "image_size": [' + "9" * 5000 + "]}",
    # A reader that restarts at each position would take minutes for these.
    "digits.cameramodel": "{'lensmodel': " + "1" * 10 * DEEP + "}",
    "lines.txt": "\n" * 3 * DEEP,
    "lenses.xml": "<lensdatabase>" + "<lens>" * DEEP + "</lens>" * DEEP + "</lensdatabase>",
    "digits.txt": "1 PINHOLE " + "9" * 5000 + " 5 1 1 1 1\n",
    "empty.json": "",
    "list.json": "[]",
    "list.yaml": "- 1\n",
    "word.yaml": "camera",
    "header.yaml": "%YAML:1.0\n---\n",
    "picture.txt": "\x01\x02",
}


@pytest.mark.parametrize("name", BOMBS)
def test_hostile_files_are_refused(tmp_path, name):
    assert len(load_text(tmp_path, name, BOMBS[name])) < 1000


MB = 1_000_000
LONG = {
    "the YAML text is nested more than 32 levels deep": (
        "a: [" + ("[" * 250 + "]" * 250 + ",") * (MB // 501) + "1]",
        "".join(f"a{i}: " + "[" * 250 + "]" * 250 + "\n" for i in range(MB // 510)),
        "a: [" + ("{a: " * 240 + "1" + "}" * 240 + ",") * (MB // 1300) + "1]",
        "a:\n" + ("- " * 250 + "1\n") * (MB // 502),
    ),
    "a number of more than 400 digits": (
        "a: 1" + ":59" * (MB // 3),
        "a: 1" + ":59" * (MB // 3) + ".5",
        "a: 0x" + "f" * MB,
    ),
    "the YAML text has more than 100000 values": (
        "a: [" + "1," * (MB // 2) + "1]",
        "".join(f"k{i}: 1\n" for i in range(MB // 11)),
        "a: [" + "!!str 1," * (MB // 8) + "1]",
    ),
}
"""Texts of a megabyte that used to take the reader seconds to minutes, by error message."""


@pytest.mark.parametrize(
    ("said", "text"),
    [
        pytest.param(said, text, id=f"{said[-20:]} {number}")
        for said, texts in LONG.items()
        for number, text in enumerate(texts)
    ],
)
def test_long_texts_are_refused_before_they_take_time(tmp_path, run, said, text):
    (tmp_path / "long.yaml").write_text(text)
    code, out, err = run("convert", tmp_path / "long.yaml", tmp_path / "out.json")
    assert (code, out) == (2, "")
    assert error_text(err).endswith(f"{said}\n")


def test_what_is_within_the_limits_is_read():
    assert parse_yaml("a: [" + "1.5, " * 99_990 + "1]")["a"][-2:] == [1.5, 1]
    assert parse_yaml("[" * 32 + "7" * 400 + "]" * 32)
    assert parse_yaml("a: 1:30\nb: 0x1f\nc: 1e-05\nd: 190:20:30.15\n") == {
        **{"a": 90, "b": 31, "c": 1e-05, "d": 685230.15}
    }


@pytest.mark.parametrize("name", BOMBS)
def test_hostile_files_are_refused_as_any_format(tmp_path, name):
    for known in FORMAT_NAMES:
        load_text(tmp_path, name, BOMBS[name], format=known)


def test_what_is_no_text_or_too_large_is_refused(tmp_path):
    (tmp_path / "zeros.json").touch()
    os.truncate(tmp_path / "zeros.json", 20 << 30)
    assert "larger than 64 MB" in refusal(tmp_path / "zeros.json")
    (tmp_path / "zeros.yaml").write_bytes(bytes(1000))
    assert "not a text file" in refusal(tmp_path / "zeros.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"camera_name: caf\xe9\n")
    assert "not a text file" in refusal(tmp_path / "latin.yaml")
    (tmp_path / "cameras.bin").write_bytes(b"\x01" + bytes(7) + b"\x04" + bytes(60))
    assert "not a text file, which COLMAP makes of it: " in refusal(tmp_path / "cameras.bin")
    (tmp_path / "long.yaml").write_text(
        "distortion_model: a\ncamera_matrix: b\n" + "# long\n" * 10**6
    )
    assert "longer than" in refusal(tmp_path / "long.yaml")
    refused = load_text(tmp_path, "notes", "Hello\n")
    assert "not a camera file of a known format" in refused
    assert refused.endswith("trisquare convert --from, whose output every command reads")


def test_what_cannot_be_opened_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.json: No such file"):
        Camera.load(tmp_path / "none.json")
    with pytest.raises(IsADirectoryError):
        Camera.load(tmp_path)
    with pytest.raises(OSError, match="no folder"):
        CAMERA.save(tmp_path / "nowhere" / "camera.json")
    assert not list(tmp_path.iterdir())


def test_a_lens_that_sees_too_much_has_no_nearest(tmp_path):
    path = tmp_path / "fisheye.cameramodel"
    for focal, said in (
        (200, "no lens of the model LENSMODEL_OPENCV5"),
        (20, "only 1 % of the picture"),
    ):
        wide = Camera(
            [[focal, 0, 320], [0, focal, 240], [0, 0, 1]], np.zeros(4), (640, 480), FISHEYE
        )
        with pytest.raises(
            ValueError, match=rf"cannot store this camera \(model {FISHEYE}\).*{said}"
        ):
            wide.save(path, approximate=True)
    assert not path.exists()


def test_a_lens_model_error_says_its_numbers_and_survives_pickling():
    lens = Camera(K, [-0.1, 0.02, 0.001, -0.002, 0.05], (1280, 960), "brown")
    with pytest.raises(ts.LensModelError) as info:
        lens.save("camchain.yaml")
    error = pickle.loads(pickle.dumps(info.value))
    assert (str(error), error.rms, error.worst) == (
        str(info.value),
        info.value.rms,
        info.value.worst,
    )
    assert 0 < error.rms < error.worst < 50


# The command.


def convert(run, folder, *arguments):
    before = sorted(path.name for path in folder.iterdir())
    code, out, err = run("convert", *arguments)
    if code:
        assert out == ""
        assert err.startswith("trisquare: error: ")
        assert err.count("\n") == 1
        assert sorted(path.name for path in folder.iterdir()) == before
    return code, out, err


def test_converting_from_each_format_to_each(run, tmp_path):
    for source, from_name in FILES.items():
        camera = SIMPLE if from_name in PANORAMA else CAMERA
        camera.save(tmp_path / source, from_name)
        for target, to_name in FILES.items():
            if to_name in PANORAMA and from_name not in PANORAMA:
                continue
            path = tmp_path / f"new-{target}"
            options = [
                "--to",
                to_name,
                "-q",
                *(("--size", "1280x960") if from_name == "lensfun" else ()),
            ]
            code, out, err = convert(run, tmp_path, tmp_path / source, path, *options)
            assert (code, out, err) == (0, "", "")
            read = Camera.load(path, to_name, image_size=(1280, 960))
            np.testing.assert_allclose(read.K, camera.K, rtol=1e-14)
            np.testing.assert_allclose(read.distortion, camera.distortion, atol=1e-15)


def test_what_is_converted_is_said(run, tmp_path):
    CAMERA.save(tmp_path / "a.json")
    target = tmp_path / "camera_info.yaml"
    code, out, _ = convert(run, tmp_path, tmp_path / "a.json", target)
    assert code == 0
    said = f"{tmp_path / 'a.json'} (trisquare) -> {target} (ros): 1280 x 960, brown"
    assert out == f"{said}\nwrote {target}\n"
    code, out, _ = convert(run, tmp_path, target, tmp_path / "b.json", "--json")
    members = json.loads(out)
    assert (members["from"], members["to"], members["camera"]["fx"]) == ("ros", "trisquare", 1000.5)
    assert members["read_approximation"] is members["write_approximation"] is None


def test_what_cannot_be_held_is_approximated_only_if_asked(run, tmp_path):
    Camera(K, [-0.1, 0.02, 0, 0, 0.05], (1280, 960), "radial3").save(tmp_path / "a.json")
    target = tmp_path / "camchain.yaml"
    code, _, err = convert(run, tmp_path, tmp_path / "a.json", target)
    assert code == 2
    assert "cannot store" in err
    assert "trisquare convert --approximate" in err  # no other command has it
    code, out, _ = convert(run, tmp_path, tmp_path / "a.json", target, "--approximate")
    assert code == 0
    assert "written as the nearest lens: radtan" in out
    code, out, _ = convert(run, tmp_path, tmp_path / "a.json", target, "--approximate", "--json")
    lost = json.loads(out)["write_approximation"]
    assert 0 < lost["rms_px"] < lost["worst_px"]


def test_the_commands_exit_codes(run, tmp_path):
    good, bad, out = tmp_path / "a.json", tmp_path / "bad.json", tmp_path / "b.yaml"
    CAMERA.save(good)
    bad.write_text(good.read_text().replace('"fx"', '"gx"'))
    assert convert(run, tmp_path, bad, out)[0] == 2
    assert convert(run, tmp_path, tmp_path / "none.json", out)[0] == 5
    assert convert(run, tmp_path, tmp_path, out)[0] == 5
    assert convert(run, tmp_path, good, tmp_path / "no" / "b.yaml")[0] == 2
    assert convert(run, tmp_path, good, tmp_path / "b.doc")[0] == 2
    assert convert(run, tmp_path, good, out, "--to", "doc")[0] == 2
    assert convert(run, tmp_path, good, out, "--from", "doc")[0] == 2
    assert convert(run, tmp_path, good, out, "--size", "wide")[0] == 2
    assert convert(run, tmp_path, good, out, "--size", "640x480")[0] == 2
    assert convert(run, tmp_path, good, out, "--camera", "cam7")[0] == 2
    assert convert(run, tmp_path, good, good)[0] == 2
    assert convert(run, tmp_path, good, out, "--size", "1280x960")[0] == 0


def test_xml_that_is_nested_deeply_is_refused_at_once(tmp_path):
    path = tmp_path / "camera.xml"
    path.write_text("<opencv_storage>" + "<a>" * 1_000_000)
    with pytest.raises(ValueError, match="nested more than 32 levels"):
        ts.Camera.load(path)
