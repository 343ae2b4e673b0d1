"""`trisquare undistort`: its files, its output, and its refusals."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from command_errors import error_text
from scenes import edges_of, squares

import trisquare as ts
from trisquare.images.orientation import find_orientation, with_orientation
from trisquare.images.reading import read_image

IMAGE_SIZE = (640, 480)
CALIBRATION = ts.calibrate_edges(edges_of(squares(11, image_size=IMAGE_SIZE)), IMAGE_SIZE)
CAMERA = CALIBRATION.camera
PHOTO = np.random.default_rng(2).integers(0, 256, IMAGE_SIZE[::-1], np.uint8)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "camera.json").write_text(CALIBRATION.to_json())
    cv2.imwrite(str(tmp_path / "photo.png"), PHOTO)
    return tmp_path


@pytest.fixture
def undistort(run, folder, monkeypatch):
    monkeypatch.chdir(folder)
    return lambda *arguments: run("undistort", *arguments)


def read(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def test_a_photograph_is_undistorted(undistort, folder):
    code, out, err = undistort(
        "photo.png", "--camera", "camera.json", "-o", "out.png", "--balance", 0.5
    )
    assert (code, err) == (0, "")
    np.testing.assert_array_equal(read(folder / "out.png"), ts.undistort(PHOTO, CAMERA, 0.5))
    new = CAMERA.undistorted(0.5)
    x, y, width, height = ts.Undistorter(CAMERA, 0.5).valid_rectangle
    assert f"640 x 480, fx {new.fx:.6g}, fy {new.fy:.6g}, cx {new.cx:.6g}" in out
    assert f"from ({x}, {y}) of {width} x {height}" in out
    assert "wrote out.png" in out


def test_json_and_quiet(undistort, folder):
    code, out, err = undistort("photo.png", "--camera", "camera.json", "-o", "out.png", "--json")
    assert (code, err) == (0, "")
    (picture,) = json.loads(out)["pictures"]
    new = CAMERA.undistorted()
    assert [picture[name] for name in ("photo", "output")] == ["photo.png", "out.png"]
    assert [picture["camera"][name] for name in ("fx", "fy", "cx", "cy")] == [
        *(new.fx, new.fy, new.cx, new.cy)
    ]
    assert picture["camera"]["distortion"] == [0.0] * 5
    assert picture["image_size"] == [640, 480]
    assert picture["valid_rectangle"] == [0, 0, 640, 480]
    assert undistort("photo.png", "--camera", "camera.json", "-o", "o.png", "-q") == (0, "", "")
    np.testing.assert_array_equal(read(folder / "o.png"), read(folder / "out.png"))


@pytest.mark.parametrize("name", ["new.json", "new.yaml"])
def test_the_new_camera_is_written(undistort, folder, name):
    arguments = ("photo.png", "--camera", "camera.json", "-o", "out.png", "--balance", 0.5)
    code, out, err = undistort(*arguments, "--new-camera", name)
    assert (code, err) == (0, "")
    assert f"wrote {name}\n" in out
    assert ts.Camera.load(folder / name) == CAMERA.undistorted(0.5)
    assert "--new-camera" not in out
    assert "(--new-camera FILE keeps it)\n" in undistort(*arguments)[1]
    answer = json.loads(undistort(*arguments, "--new-camera", name, "--json")[1])
    assert answer["new_camera"] == name
    assert json.loads(undistort(*arguments, "--json")[1])["new_camera"] is None


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--new-camera", "new.obj"), "let it end with one of"),
        (("--new-camera", "new.json", "--view", "cylinder"), "--new-camera is for a pinhole"),
        (("--new-camera", "camera.json"), "would overwrite"),
        (("small.png", "--rescale", "--new-camera", "new.json"), "2 sizes"),
        (("--new-camera", "missing/new.json"), "missing"),
    ],
)
def test_a_new_camera_that_cannot_be_written_writes_nothing(undistort, folder, more, said):
    cv2.imwrite(str(folder / "small.png"), PHOTO[::2, ::2])
    before = sorted(folder.iterdir())
    code, out, err = undistort("photo.png", "--camera", "camera.json", "-o", "out.png", *more)
    assert (code, out) == (2, "")
    assert said in error_text(err)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("view", ["cylinder", "equirectangular"])
def test_a_panorama(undistort, folder, view):
    arguments = ("photo.png", "--camera", "camera.json", "-o", "out.png", "--view", view)
    code, out, err = undistort(*arguments, "--field", 30, "--json")
    assert (code, err) == (0, "")
    panorama = ts.Panorama.of(CAMERA, view, 30)
    expected = ts.undistort(PHOTO, CAMERA, new_camera=panorama)
    np.testing.assert_array_equal(read(folder / "out.png"), expected)
    answer = json.loads(out)
    assert (answer["view"], answer["field"]) == (view, 30)
    (picture,) = answer["pictures"]
    assert picture["panorama"]["projection"] == view
    assert picture["panorama"]["focal"] == panorama.focal
    assert picture["image_size"] == list(panorama.image_size)
    assert "camera" not in picture
    code, out, _ = undistort(*arguments)
    assert code == 0
    assert f"{view}, without distortion: " in out


def test_a_chosen_field(undistort, folder):
    code, *_ = undistort("photo.png", "--camera", "camera.json", "-o", "out.png", "--field", 30)
    assert code == 0
    expected = ts.undistort(PHOTO, CAMERA, new_camera=CAMERA.undistorted(field=30))
    np.testing.assert_array_equal(read(folder / "out.png"), expected)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--view", "sphere"), "unknown view"),
        (("--field", "200"), "at most 160 degrees"),
        (("--field", "30", "--balance", "1"), "balance or field"),
        (("--view", "cylinder", "--balance", "1"), "--field"),
    ],
)
def test_bad_views_are_refused(undistort, folder, options, message):
    code, _, err = undistort("photo.png", "--camera", "camera.json", "-o", "out.png", *options)
    assert code == 2
    assert message in err
    assert not (folder / "out.png").exists()


def test_several_photographs_of_several_sizes(undistort, folder):
    small = cv2.resize(cv2.merge([PHOTO, PHOTO, 255 - PHOTO]), (320, 240)).astype(np.uint16) * 257
    cv2.imwrite(str(folder / "small.png"), small)
    photos = ("photo.png", "small.png", "photo.png")
    options = ("--camera", "camera.json", "--rescale", "--interpolation", "cubic", "--json")
    code, out, _ = undistort(*photos, *options, "-o", "out.png")
    assert code == 0
    expected = [ts.undistort(PHOTO, CAMERA, interpolation="cubic")]
    expected += [ts.undistort(small, CAMERA, rescale=True, interpolation="cubic"), expected[0]]
    for number, picture in enumerate(expected, 1):
        np.testing.assert_array_equal(read(folder / f"out-{number}.png"), picture)
    sizes = [picture["image_size"] for picture in json.loads(out)["pictures"]]
    assert sizes == [[640, 480], [320, 240], [640, 480]]
    (folder / "into").mkdir()
    code, out, _ = undistort(*photos[:2], *options[:-1], "-o", "into")
    assert (code, out.count("new camera"), out.count("wrote")) == (0, 2, 2)
    np.testing.assert_array_equal(read(folder / "into" / "small.png"), expected[1])


@pytest.mark.parametrize(
    ("arguments", "exit_code", "said"),
    [
        ("photo.png -o out.png", 2, "--camera"),
        ("photo.png --camera camera.json", 2, "--output"),
        ("photo.png --camera gone.json -o out.png", 5, "gone.json"),
        (
            "photo.png --camera photo.png -o out.png",
            2,
            "photo.png: not a text file, as",
        ),
        ("gone.png --camera camera.json -o out.png", 5, "gone.png"),
        ("photo.png camera.json --camera camera.json -o out.png", 5, "camera.json"),
        ("photo.png small.png --camera camera.json -o out.png", 2, "small.png: the picture has 32"),
        ("photo.png wide.png --camera camera.json -o out.png --rescale", 2, "another aspect ratio"),
        ("turned.png --camera camera.json -o out.png", 2, "turned.png: pictures of 480 x 640 have"),
        ("photo.png deep.png --camera camera.json -o out.jpg --rescale", 2, "uint16"),
        ("photo.png --camera camera.json -o photo.png", 2, "overwrite"),
        ("photo.png --camera camera.json -o .", 2, "overwrite"),
        ("photo.png --camera camera.json -o missing/out.png", 2, "no folder"),
        ("photo.png --camera camera.json -o out.xyz", 2, "extension"),
        ("photo.png photo.png --camera camera.json -o out", 2, "out: write a folder as out/"),
        ("photo.png --camera camera.json -o out.png --balance 1.5", 2, "balance"),
        ("photo.png --camera camera.json -o out.png --balance nan", 2, "balance"),
        ("photo.png --camera camera.json -o out.png --interpolation x", 2, "interpolation"),
        ("photo.png --camera camera.json -o out.png --json -q", 2, "--quiet"),
    ],
)
def test_what_is_wrong_is_one_line_and_writes_nothing(
    undistort, folder, arguments, exit_code, said
):
    cv2.imwrite(str(folder / "small.png"), PHOTO[:240, :320])
    cv2.imwrite(str(folder / "wide.png"), PHOTO[:360])
    cv2.imwrite(str(folder / "deep.png"), PHOTO.astype(np.uint16))
    cv2.imwrite(str(folder / "turned.png"), cv2.rotate(PHOTO, cv2.ROTATE_90_CLOCKWISE))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, out, err = undistort(*arguments.split())
    assert (code, out) == (exit_code, "")
    assert said in error_text(err, as_json="--json" in arguments)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_jpeg_is_written_as_well_as_the_help_says(undistort, folder):
    written = ts.undistort(PHOTO, CAMERA)
    assert undistort("photo.png", "--camera", "camera.json", "-o", "out.jpg", "-q") == (0, "", "")
    expected = cv2.imencode(".jpg", written, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    assert (folder / "out.jpg").read_bytes() == expected


def test_what_the_lens_does_not_reach_is_said(undistort, folder):
    """The polynomial folds back within the picture: its corners have no direction."""
    camera = ts.Camera(CAMERA.K, [-0.45, 0, 0, 0, 0], IMAGE_SIZE, "radial1")
    pixels = np.stack(np.meshgrid(*map(np.arange, IMAGE_SIZE)), axis=-1).reshape(-1, 2)
    beyond = np.hypot(*(pixels - camera.K[:2, 2]).T) > camera.valid_radius_px
    part = 100 * beyond.mean()
    assert 2 < part < 40
    camera.save(folder / "short.json")
    words = ("photo.png", "--camera", "short.json", "-o", "out.png", "--json", "--balance")
    code, out, _ = undistort(*words, 1)
    (warning,) = json.loads(out)["warnings"]
    assert code == 0
    assert abs(float(warning.split()[0]) - part) < 0.6
    assert warning.split(None, 1)[1].startswith("% of the photograph is left out: it lies beyond")
    # There is no warning without black pixels, nor with a lens that covers the picture.
    assert json.loads(undistort(*words, 0)[1])["warnings"] == []
    assert json.loads(undistort(*words, 1, "--camera", "camera.json")[1])["warnings"] == []


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_the_orientation_tag_is_kept_or_missed(undistort, folder, suffix):
    """The output of a picture with an orientation tag is shown upright as well."""
    tagged = with_orientation((folder / "photo.png").read_bytes(), 6)
    (folder / "turned.png").write_bytes(tagged)
    code, _, err = undistort("turned.png", "--camera", "camera.json", "-o", f"out{suffix}")
    assert code == 0
    written = (folder / f"out{suffix}").read_bytes()
    tag = find_orientation(written)
    if suffix == ".tif":
        assert tag is None or tag.turn is None
        assert "turned clockwise by 90 degrees" in err
    else:
        assert (tag.value, err) == (6, "")
        shown = cv2.imread(str(folder / f"out{suffix}"))
        assert shown.shape[:2] == PHOTO.shape[::-1]
    assert read_image(folder / f"out{suffix}").shape == PHOTO.shape


@pytest.mark.parametrize("named", ["straight/", "deep/er/"])
def test_a_folder_is_made(undistort, folder, named):
    (folder / "frames").mkdir()
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / "frames" / name), PHOTO)
    for photographs in (["frames/a.png", "frames/b.png"], ["frames"], ["frames/*.png"]):
        code, out, err = undistort(*photographs, "--camera", "camera.json", "-o", named)
        assert (code, err) == (0, "")
        assert out.endswith(f"wrote {named}a.png\nwrote {named}b.png\n")
        np.testing.assert_array_equal(read(folder / named / "b.png"), ts.undistort(PHOTO, CAMERA))


def test_a_folder_is_not_made_for_nothing(undistort, folder):
    before = sorted(folder.iterdir())
    outcome = undistort("gone.png", "--camera", "camera.json", "-o", "deep/er/")
    assert outcome == (5, "", "trisquare: error: gone.png: No such file or directory\n")
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(("field", "warned"), [(110, False), (130, True)])
def test_a_pinhole_that_is_too_wide_is_said(undistort, folder, field, warned):
    code, _, err = undistort(
        "photo.png", "--camera", "camera.json", "-o", "out.png", "--field", field
    )
    assert code == 0
    assert (f"the new camera sees {field} degrees" in err) is warned
    assert ("--view cylinder" in err) is warned


def test_what_the_calibration_warns_of_the_rim_is_said_again(undistort, folder):
    """A straight line there is bent in the output, as is any line with a doubtful camera."""
    about = "the lens is known to 16 px in 42 % of the picture only"
    rim = ts.CalibrationWarning(about, "lens_extrapolated")
    other = ts.CalibrationWarning("plane 1 is odd", "plane_disagrees")
    doubt = "fx is known to 900 px only"
    doubtful = ts.CalibrationWarning(doubt, "barely_determined", severity="high")
    told = replace(CALIBRATION, warnings=(rim, other, doubtful))
    (folder / "camera.json").write_text(told.to_json())
    code, _, err = undistort("photo.png", "--camera", "camera.json", "-o", "out.png")
    said = [f"warning: camera.json: {own} [{own.code}]\n" for own in (rim, doubtful)]
    assert (code, err) == (0, "".join(said))
